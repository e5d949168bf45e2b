// Records the events of drags, the edits that carry them, and the images that the page has painted. Times are
// milliseconds of the page's clock, those of events are the times at which the browser received them.
(() => {
  const record = { events: [], images: [], released: 0, edits: 0, painted: null };
  window.record = record;
  let input = 0, waiting = [], reported = "", covered = null;
  for (const type of ["pointerdown", "pointermove", "pointerup", "benchinput"])
    addEventListener(type, e => { input = e.timeStamp; if (type === "pointerup") record.released = input; }, true);
  const [oldDrag, oldEdit, oldPaneled, oldPixels] = [drag, edit, paneled, pixels];
  drag = what => { waiting.push(input); oldDrag(what); };
  edit = what => {
    oldEdit(what);
    record.edits = desk.sent;
    if (!what.light) return;
    for (const time of waiting) record.events.push({ time, number: desk.sent });
    waiting = [];
  };
  pixels = buffer => {
    const head = new DataView(buffer), [x, y, w, h] = [2, 3, 4, 5].map(i => head.getUint32(i * 4, true));
    if (!covered) covered = new Uint8Array(current.width * current.height);
    for (let row = y; row < y + h; row++) covered.fill(1, row * current.width + x, row * current.width + x + w);
    oldPixels(buffer);
  };
  paneled = news => {
    oldPaneled(news);
    const { edit: number, coarse } = state().image || {}, key = `${number} ${coarse}`;
    if (news.panel !== desk.id || number === null || number === undefined || key === reported) return;
    reported = key;
    // Without pixels, the edit changed nothing.
    const share = covered ? covered.reduce((sum, v) => sum + v, 0) / covered.length : 0;
    covered = null;
    // The page paints in the next frame, before this function. Reading a pixel waits until that is drawn.
    requestAnimationFrame(() => {
      if (gl) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      record.painted = { time: performance.now(), number, coarse, share };
      if (share > 0) record.images.push(record.painted);
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
