// Records the events of drags, the edits that carry them, and the images that the page has painted. Times are
// milliseconds of the page's clock, those of events are the times at which the browser received them.
(() => {
  const record = { events: [], images: [], released: 0, edits: 0, painted: null };
  window.record = record;
  let input = 0, waiting = [], reported = "";
  for (const type of ["pointerdown", "pointermove", "pointerup", "benchinput"])
    addEventListener(type, e => { input = e.timeStamp; if (type === "pointerup") record.released = input; }, true);
  const [oldDrag, oldEdit, oldPaneled] = [drag, edit, paneled];
  drag = what => { waiting.push(input); oldDrag(what); };
  edit = what => {
    oldEdit(what);
    record.edits = desk.sent;
    if (!what.light) return;
    for (const time of waiting) record.events.push({ time, number: desk.sent });
    waiting = [];
  };
  paneled = news => {
    oldPaneled(news);
    const { edit: number, coarse } = state().image || {}, key = `${number} ${coarse}`;
    if (news.panel !== desk.id || number === null || number === undefined || key === reported) return;
    reported = key;
    // The pixels came before the panel. The page paints them in the next frame, before this function. Reading a pixel
    // waits until they are drawn.
    requestAnimationFrame(() => {
      if (gl) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      record.painted = { time: performance.now(), number, coarse };
      record.images.push(record.painted);
    });
  };
  // The final image with all edits is painted, and nothing is rendered.
  record.done = () => {
    const last = record.painted;
    return state().status === "idle" && !desk.drag && (!record.edits || last && last.number >= record.edits && !last.coarse);
  };
  record.take = () => {
    const taken = { events: record.events, images: record.images, released: record.released };
    [record.events, record.images] = [[], []];
    return taken;
  };
})();
