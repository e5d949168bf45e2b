// The desk for lighting: the panel beside an image whose sender describes one, and the lights in the image.
const desk = { id: 0, parts: {}, cards: new Map(), chosen: null, mode: null, drag: null, sent: 0, later: null, handles: new Map(), may: false };
// The image before the last edit, which a connection of its own brings, and where it is cut.
const compare = { on: false, at: 0.5, id: 0, socket: null, tiles: null };

const make = (tag, props = {}, ...inside) => {
  const made = Object.assign(document.createElement(tag), props);
  made.append(...inside);
  return made;
};
const state = () => desk.parts.state || {};
const lights = () => (state().lights || []).map(id => desk.parts["light/" + id]).filter(l => l);
const lightOf = id => desk.parts["light/" + id];

// Edits. What is dragged is sent once for each picture on the screen.
function visible() {
  if (!current) return undefined;
  const within = (v, most) => Math.min(Math.max(v, 0), most);
  const x0 = within(-left / zoom, current.width), y0 = within(-top_ / zoom, current.height);
  const x1 = within((view.clientWidth - left) / zoom, current.width), y1 = within((view.clientHeight - top_) / zoom, current.height);
  return [x0, y0, x1 - x0, y1 - y0];
}
function edit(what) {
  if (desk.may && socket && socket.readyState === 1) socket.send(JSON.stringify({ edit: { ...what, visible: visible(), number: ++desk.sent }, image: desk.id }));
}
function drag(what) {
  if (!desk.drag) { desk.drag = true; edit({ do: "begin" }); }
  const due = desk.later;
  desk.later = what;
  if (!due) requestAnimationFrame(flush);
}
function flush() {
  const what = desk.later;
  desk.later = null;
  if (what) edit(what);
}
function drop_() {
  flush();
  if (desk.drag) { desk.drag = null; edit({ do: "end" }); }
}

// What the server says.
function paneled(news) {
  if (news.panel !== desk.id) return;
  const shown = () => JSON.stringify(state().image), before = shown();
  if (news.all) desk.parts = {};
  for (const [part, text] of Object.entries(news.parts)) {
    if (text === null) delete desk.parts[part];
    else try { desk.parts[part] = JSON.parse(text); } catch { delete desk.parts[part]; }
  }
  showDesk();
  // The pixels of an image come before the panel that calls it complete.
  if (shown() !== before) draw();
}
function seekDesk() {
  const found = images.find(p => p.panel && current && p.id === current.id) || images.find(p => p.panel);
  const id = found ? found.id : 0;
  desk.may = !!found && found.edits;
  if (id !== desk.id || desk.socket !== socket) {
    desk.id = id;
    desk.socket = socket;
    desk.parts = {};
    if (id && socket && socket.readyState === 1) socket.send(JSON.stringify({ panel: id }));
  }
  showDesk();
}

// A number as short as it can be without loss to the eye.
const short = v => Number.isFinite(v) ? String(+v.toPrecision(5)) : String(v);
const label = p => p.label || p.name;
const toScreen = v => { v = Math.min(Math.max(v, 0), 1); return v <= 0.0031308 ? v * 12.92 : 1.055 * Math.pow(v, 1 / 2.4) - 0.055; };
const toLinear = v => v <= 0.04045 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4);
const hex = c => { const most = Math.max(1, ...c); return "#" + c.map(v => Math.round(255 * toScreen(v / most)).toString(16).padStart(2, "0")).join(""); };

// The range of a slider: that of the shader, or one around the value.
function range(p) {
  let low = p.softmin ?? p.min ?? null, high = p.softmax ?? p.max ?? null;
  const size = Math.max(Math.abs(p.value || 0), Math.abs(p.default || 0)) || 1;
  if (p.units === "radians") { low = low ?? 0; high = high ?? Math.PI; }
  if (low === null) low = (p.value < 0 || p.default < 0) ? -2 * size : 0;
  if (high === null) high = Math.max(low + 1, Math.pow(2, Math.ceil(Math.log2(2 * size))));
  return [low, high];
}

// One control. `send` gets the value and whether a drag goes on; the result takes new values.
function numberControl(p, send) {
  const slider = make("input", { type: "range", step: "any" }), box = make("input", { type: "number", step: "any" });
  let active = false;
  const set = q => {
    if (active) return;
    const [low, high] = range(q);
    slider.min = low; slider.max = high; slider.value = q.value;
    if (q.widget === "int") slider.step = 1; else if (q.step) slider.step = q.step;
    if (document.activeElement !== box) box.value = short(q.value);
  };
  slider.oninput = () => { active = true; box.value = short(+slider.value); send(+slider.value, true); };
  slider.onchange = () => { active = false; drop_(); };
  box.onchange = () => { if (box.value !== "" && Number.isFinite(+box.value)) send(+box.value); };
  set(p);
  slider.setAttribute("aria-label", p.name);
  box.setAttribute("aria-label", p.name);
  return { nodes: [slider, box], set };
}
function checkControl(p, send) {
  const box = make("input", { type: "checkbox" });
  box.onchange = () => send(box.checked ? 1 : 0);
  const set = q => { box.checked = q.value !== 0; };
  set(p);
  return { nodes: [box], set };
}
function choiceControl(p, send) {
  const text = p.type === "string";
  const options = p.widget.slice(5).split(",").map((word, i) => {
    const [name, value] = word.split("=");
    return new Option(name, text ? name : value ?? i);
  });
  const select = make("select", {}, ...options);
  select.onchange = () => send(text ? select.value : +select.value);
  const set = q => { select.value = String(q.value); };
  set(p);
  return { nodes: [select], set };
}
function colorControl(p, send) {
  const pick = make("input", { type: "color" }), boxes = [0, 1, 2].map(() => make("input", { type: "number", step: "any" }));
  let value = p.value, active = false;
  const set = q => {
    if (active || !Array.isArray(q.value)) return;
    value = q.value;
    pick.value = hex(value);
    boxes.forEach((b, i) => { if (document.activeElement !== b) b.value = short(value[i]); });
  };
  pick.oninput = () => {
    active = true;
    // Colours brighter than the screen keep their brightness.
    const most = Math.max(1, ...value), of = i => toLinear(parseInt(pick.value.slice(1 + 2 * i, 3 + 2 * i), 16) / 255) * most;
    send([0, 1, 2].map(i => +of(i).toPrecision(4)), true);
  };
  pick.onchange = () => { active = false; drop_(); };
  boxes.forEach((b, i) => b.onchange = () => { if (b.value !== "") { const next = [...value]; next[i] = +b.value; send(next); } });
  set(p);
  pick.setAttribute("aria-label", p.name);
  return { nodes: [pick, make("span", { className: "value triple" }, ...boxes)], set };
}
function tripleControl(p, send, drags) {
  const count = (p.value || []).length, boxes = Array.from({ length: count }, () => make("input", { type: "number", step: "any" }));
  let value = p.value;
  const set = q => { value = q.value; boxes.forEach((b, i) => { if (document.activeElement !== b) b.value = short(value[i]); }); };
  boxes.forEach((b, i) => b.onchange = () => { if (b.value !== "") { const next = [...value]; next[i] = +b.value; send(next); } });
  set(p);
  return { nodes: [make("span", { className: "value triple" }, ...boxes)], set };
}
function textControl(p, send) {
  const box = make("input", { type: "text", spellcheck: false });
  const list = v => Array.isArray(v) ? v.join(", ") : v ?? "";
  box.onchange = () => {
    if (!Array.isArray(p.value)) return send(box.value);
    const words = box.value.split(",").map(w => w.trim());
    send(p.type.startsWith("string") ? words : words.map(Number));
  };
  const set = q => { p = q; if (document.activeElement !== box) box.value = list(q.value); };
  set(p);
  box.setAttribute("aria-label", p.name);
  return { nodes: [box], set };
}
function controlOf(p, send) {
  if (p.widget && p.widget.startsWith("enum:")) return choiceControl(p, send);
  if (p.type === "float" && p.widget === "bool") return checkControl(p, send);
  if (p.type === "float" && typeof p.value === "number") return numberControl(p, send);
  if (p.type === "color" && Array.isArray(p.value)) return colorControl(p, send);
  if (["point", "vector", "normal"].includes(p.type) && Array.isArray(p.value)) return tripleControl(p, send);
  return textControl(p, send);
}
function line(name, help, control, reset) {
  const word = make("span", { textContent: name, title: help || "" });
  const made = make("div", { className: "control" }, word, make("span", { className: "value" }, ...control.nodes));
  if (reset) word.onclick = () => made.classList.contains("set") && reset();
  return made;
}

// The card of a light.
const shape = l => JSON.stringify([l.emission, !!l.direction, l.layers.map(y => [y.shader, y.layer, y.error, (y.params || []).map(p => [p.name, p.type])])]);
function card(l) {
  const made = { shape: shape(l), controls: [], node: make("section", { className: "lamp" }) };
  const id = l.id, dot = make("span", { className: "dot" }), name = make("span", { className: "name" });
  const on = make("button", { textContent: "on", title: "On or off" }), solo = make("button", { textContent: "solo", title: "Only this light and others with solo" });
  on.onclick = e => { e.stopPropagation(); edit({ do: "on", light: id, value: !lightOf(id).on }); };
  solo.onclick = e => { e.stopPropagation(); edit({ do: "solo", light: id, value: !lightOf(id).solo }); };
  const header = make("header", {}, dot, name, on, solo), body = make("div", { className: "body" });
  header.onclick = () => { desk.chosen = desk.chosen === id ? null : id; setMode(null); showDesk(); };
  made.node.append(header, body);
  const tools = make("div", { className: "row" });
  if (l.direction) {
    made.aim = make("button", { textContent: "Aim", title: "Click in the image at what the light shall shine at (A)" });
    made.aim.onclick = () => setMode(desk.mode === "aim" ? null : "aim");
    tools.append(made.aim);
  }
  if (l.emission === "position") {
    made.move = make("button", { textContent: "Move", title: "Drag in the image; the wheel over the light changes its distance (M)" });
    made.move.onclick = () => setMode(desk.mode === "move" ? null : "move");
    tools.append(made.move);
  }
  made.restore = make("button", { textContent: "Restore", title: "As in the scene", onclick: () => edit({ do: "restore", light: id }) });
  tools.append(make("span", { className: "wide" }), make("button", { textContent: "Copy", onclick: () => edit({ do: "copy", light: id }) }),
    made.restore, make("button", { textContent: "Delete", onclick: () => edit({ do: "delete", light: id }) }));
  body.append(tools);
  l.layers.forEach((layer, k) => {
    const title = make("div", { className: "title", textContent: layer.shader + (layer.layer ? ` (${layer.layer})` : ""), title: layer.help || "" });
    body.append(title);
    if (layer.error) body.append(make("div", { textContent: layer.error, style: "color:#ffc9c4" }));
    (layer.params || []).forEach((p, i) => {
      if (p.separator) body.append(make("div", { className: "title" }));
      if (p.group) body.append(make("div", { className: "title", textContent: p.group }));
      const what = value => ({ do: "set", light: id, layer: k, param: p.name, value });
      const control = controlOf(p, (value, drags) => drags ? drag(what(value)) : edit(what(value)));
      const node = line(label(p), `${p.help || ""}${p.units ? ` (${p.units})` : ""} [${p.type} ${p.name}]`, control, () => edit({ do: "reset", light: id, layer: k, param: p.name }));
      made.controls.push(now => {
        const q = now.layers[k].params[i];
        control.set(q);
        node.classList.toggle("set", q.set);
        const enabler = q.enabler && now.layers[k].params.find(o => o.name === q.enabler);
        node.hidden = !!enabler && !enabler.value;
      });
      body.append(node);
    });
  });
  if (l.emission === "position") {
    body.append(make("div", { className: "title", textContent: "In world space" }));
    const control = tripleControl({ value: l.position }, value => edit({ do: "position", light: id, value }));
    body.append(line("position", "x, y and z", control));
    made.controls.push(now => control.set({ value: now.position }));
  }
  if (l.direction) {
    for (const [k, name, low, high] of [[0, "around", -180, 180], [1, "above", -90, 90]]) {
      const all = now => now.direction, send = (v, drags) => {
        const value = [...all(lightOf(id))];
        value[k] = v;
        (drags ? drag : edit)({ do: "direction", light: id, value });
      };
      const p = now => ({ name, value: all(now)[k], min: low, max: high });
      const control = numberControl(p(l), send);
      body.append(line(name, "Direction of the light in degrees", control));
      made.controls.push(now => control.set(p(now)));
    }
  }
  // Objects.
  const count = make("div", { className: "title" }), rules = make("div"), pattern = make("input", { type: "text", placeholder: "pattern of names", spellcheck: false });
  pattern.setAttribute("list", "objects");
  pattern.classList.add("wide");
  const link = value => { edit({ do: "link", light: id, pattern: pattern.value, value }); pattern.value = ""; };
  body.append(count, rules, make("div", { className: "row" }, pattern,
    make("button", { textContent: "lit", title: "The light illuminates these objects", onclick: () => link(true) }),
    make("button", { textContent: "unlit", title: "The light does not illuminate these objects", onclick: () => link(false) })));
  made.update = now => {
    const first = now.layers[0].params || [], color = first.find(p => p.type === "color" && Array.isArray(p.value));
    dot.style.background = now.lit ? color ? hex(color.value) : "#fff" : "none";
    name.replaceChildren(now.id, make("small", { textContent: now.layers.map(y => y.shader).join(" + ") }));
    if (now.added || now.changed) name.append(make("small", { className: "edited", textContent: now.added ? "new" : "edited" }));
    on.setAttribute("aria-pressed", String(now.on));
    solo.setAttribute("aria-pressed", String(now.solo));
    made.restore.hidden = now.added;
    made.restore.disabled = !now.changed;
    made.node.classList.toggle("dark", !now.lit);
    made.node.classList.toggle("open", desk.chosen === id);
    if (made.aim) made.aim.setAttribute("aria-pressed", String(desk.chosen === id && desk.mode === "aim"));
    if (made.move) made.move.setAttribute("aria-pressed", String(desk.chosen === id && desk.mode === "move"));
    const o = desk.parts.objects || {};
    count.textContent = `Illuminates ${(o.lit || {})[id] ?? 0} of ${o.count ?? 0} objects`;
    rules.replaceChildren(...now.rules.map((rule, index) => make("div", { className: "rule" },
      make("code", { textContent: rule.pattern || "(all)" }), rule.on ? "lit" : "unlit",
      make("button", { textContent: "\u00d7", title: "Remove", onclick: () => edit({ do: "unlink", light: id, index }) }))));
    made.controls.forEach(set => set(now));
  };
  return made;
}

function showDesk() {
  const here = !!desk.id && !!desk.parts.state;
  $("desk").hidden = !here;
  if (!here) { showHandles(); setCompare(); return; }
  const s = state(), d = desk.parts.desk || {};
  const words = { idle: "up to date", preparing: "up to date, preparing drags", coarse: "rendering, coarse", final: "rendering" };
  $("deskstate").textContent = desk.may ? words[s.status] || "" : "the renderer has ended, or this page only watches";
  $("deskstate").className = "wide " + (desk.may ? s.status : "off");
  $("deskmessage").hidden = !s.message;
  if (s.message) { $("deskmessage").textContent = s.message.text; $("deskmessage").className = s.message.error ? "error" : ""; }
  for (const [name, what] of [["undo", s.undo], ["redo", s.redo]]) {
    $(name).disabled = !what || !desk.may;
    $(name).title = what ? `${name === "undo" ? "Undo" : "Redo"} ${what}` : "";
  }
  $("before").disabled = !s.before;
  if ($("file").dataset.name !== d.file) $("file").value = $("file").dataset.name = d.file || "";
  $("save").textContent = s.saved ? "Saved" : "Save";
  $("save").title = s.saved ? `in ${s.patch}` : "Writes the edits as Pyg, into the folder of the renderer";
  const shaders = JSON.stringify(d.shaders);
  if ($("shader").dataset.key !== shaders) {
    $("shader").dataset.key = shaders;
    $("shader").replaceChildren(...(d.shaders || []).map(n => new Option(n, n)));
    if ((d.shaders || []).includes("spotlight")) $("shader").value = "spotlight";
  }
  const names = JSON.stringify((desk.parts.objects || {}).names || []);
  if ($("objects").dataset.key !== names) {
    $("objects").dataset.key = names;
    $("objects").replaceChildren(...JSON.parse(names).map(n => new Option(n)));
  }
  const all = lights(), ids = new Set(all.map(l => l.id));
  for (const [id, c] of desk.cards) if (!ids.has(id)) { c.node.remove(); desk.cards.delete(id); if (desk.chosen === id) desk.chosen = null; }
  let place = null;
  for (const l of all) {
    let c = desk.cards.get(l.id);
    if (!c || c.shape !== shape(l)) {
      const next = card(l);
      if (c) c.node.replaceWith(next.node); else $("lamps").append(next.node);
      desk.cards.set(l.id, c = next);
    }
    // Most of what arrives concerns few of the lights. The controls of the open one take back values that were refused.
    const open = desk.chosen === l.id, news = [l, desk.parts.objects, open];
    if (open || !c.shown || c.shown.some((part, i) => part !== news[i])) { c.update(l); c.shown = news; }
    if (place ? place.nextElementSibling !== c.node : $("lamps").firstElementChild !== c.node) place ? place.after(c.node) : $("lamps").prepend(c.node);
    place = c.node;
  }
  for (const b of $("desk").querySelectorAll("button, input, select")) if (!["undo", "redo", "before"].includes(b.id) && !b.closest(".lamp")) b.disabled = !desk.may;
  $("lamps").inert = !desk.may;
  setCompare();
  drawMarks();
}

// The lights in the image.
const onScreen = ([x, y]) => [x * zoom + left, y * zoom + top_];
const inImage = e => { const r = view.getBoundingClientRect(); return [(e.clientX - r.left - left) / zoom, (e.clientY - r.top - top_) / zoom]; };
function handle(key, className, l) {
  let h = desk.handles.get(key);
  if (!h) {
    h = make("button", { className: "handle" }, make("span"));
    const act = e => drag({ do: h.end ? "aim" : "place", light: h.light, at: inImage(e) });
    h.onpointerdown = e => { e.stopPropagation(); h.setPointerCapture(e.pointerId); h.moved = false; desk.chosen = h.light; };
    h.onpointermove = e => { e.stopPropagation(); if (h.hasPointerCapture(e.pointerId) && (h.moved || Math.abs(e.movementX) + Math.abs(e.movementY) > 0)) { h.moved = true; act(e); } };
    h.onpointerup = h.onpointercancel = e => { e.stopPropagation(); drop_(); showDesk(); };
    h.ondblclick = e => e.stopPropagation();
    h.onwheel = e => {
      if (h.end) return;
      e.preventDefault(); e.stopPropagation();
      drag({ do: "distance", light: h.light, value: Math.pow(2, -Math.sign(e.deltaY) / 16) });
      clearTimeout(h.rest);
      h.rest = setTimeout(drop_, 400);
    };
    view.append(h);
    desk.handles.set(key, h);
  }
  h.className = "handle " + className;
  h.light = l.id;
  h.title = l.id;
  return h;
}
function showHandles() {
  const used = new Set();
  const here = current && !$("desk").hidden && current.id === desk.id;
  for (const l of here ? lights() : []) {
    if (!l.at || l.emission !== "position") continue;
    const put = (key, at, className) => {
      const h = handle(key, className, l), [x, y] = onScreen(at);
      h.style.left = x + "px"; h.style.top = y + "px";
      used.add(key);
      return h;
    };
    const chosen = desk.chosen === l.id, color = l.layers.flatMap(y => y.params || []).find(p => p.type === "color" && Array.isArray(p.value));
    const h = put(l.id, l.at, (chosen ? "chosen " : "") + (l.lit ? "" : "dark"));
    h.style.background = color ? hex(color.value) : "#fff";
    h.firstChild.textContent = chosen ? l.id : "";
    if (chosen && l.toward) { const end = put(l.id + "\n", l.toward, "end"); end.end = true; }
  }
  for (const [key, h] of desk.handles) if (!used.has(key)) { h.remove(); desk.handles.delete(key); }
}
function paintDesk(over, ratio) {
  showHandles();
  const l = lightOf(desk.chosen);
  if (l && l.at && l.toward && l.emission === "position" && current && current.id === desk.id) {
    const [a, b] = [onScreen(l.at), onScreen(l.toward)];
    for (const [width, color] of [[4, "#000a"], [2, "#6ec1ff"]]) {
      over.lineWidth = width * ratio; over.strokeStyle = color;
      over.beginPath(); over.moveTo(a[0] * ratio, a[1] * ratio); over.lineTo(b[0] * ratio, b[1] * ratio); over.stroke();
    }
  }
  $("wipe").hidden = !compare.on;
  $("wipe").style.left = compare.at * 100 + "%";
}
function setMode(mode) {
  desk.mode = desk.chosen ? mode : null;
  view.classList.toggle("aiming", !!desk.mode);
  for (const c of desk.cards.values()) { const l = [...desk.cards].find(([, v]) => v === c)[0]; if (lightOf(l)) c.update(lightOf(l)); }
}
view.addEventListener("pointerdown", e => {
  if (!desk.mode || e.target.classList.contains("handle") || e.target.closest("#wipe")) return;
  e.stopPropagation();
  view.setPointerCapture(e.pointerId);
  desk.pointing = true;
  const what = at => ({ do: desk.mode === "aim" ? "aim" : "place", light: desk.chosen, at });
  drag(what(inImage(e)));
  view.onpointermove_ = m => drag(what(inImage(m)));
}, true);
view.addEventListener("pointermove", e => { if (desk.pointing) { e.stopPropagation(); view.onpointermove_(e); } }, true);
for (const end of ["pointerup", "pointercancel"]) view.addEventListener(end, e => {
  if (!desk.pointing) return;
  e.stopPropagation();
  desk.pointing = false;
  drop_();
  if (desk.mode === "aim") setMode(null);
}, true);

// The image before.
function setCompare() {
  const found = compare.on && images.find(p => p.name === state().before);
  const id = found ? found.id : 0;
  if (compare.on && !state().before) compare.on = false;
  $("before").setAttribute("aria-pressed", String(compare.on));
  if (id === compare.id) return;
  compare.id = id;
  if (compare.socket) compare.socket.close();
  drop(compare.tiles);
  compare.socket = compare.tiles = null;
  if (!id) return draw();
  const own = compare.socket = new WebSocket(socket.url);
  own.binaryType = "arraybuffer";
  own.onopen = () => { if (colors.state) seeThrough(own, colors.state.display, colors.state.view); own.send(JSON.stringify({ show: id, channels: selection.split(",").map(Number) })); };
  own.onmessage = ({ data }) => {
    if (compare.socket !== own) return;
    if (typeof data !== "string") return new DataView(data).getUint32(0, true) !== 0 && unpack(data, (word, x, y, w, h, scale, values) => {
      if (compare.tiles && word(0) === compare.id && scale === compare.tiles.scale) { put(compare.tiles, x, y, w, h, values); draw(); }
    });
    const news = JSON.parse(data);
    if (news.image === compare.id) { drop(compare.tiles); compare.tiles = tiles(0, 0, news.width, news.height, news.scale, TILE); compare.tiles.list.forEach(prepareTile); }
  };
}
$("wipe").onpointerdown = e => { e.stopPropagation(); $("wipe").setPointerCapture(e.pointerId); };
$("wipe").onpointermove = e => {
  e.stopPropagation();
  if (!$("wipe").hasPointerCapture(e.pointerId)) return;
  const r = view.getBoundingClientRect();
  compare.at = Math.min(0.99, Math.max(0.01, (e.clientX - r.left) / r.width));
  draw();
};
$("before").onclick = () => { compare.on = !compare.on; setCompare(); draw(); };
$("undo").onclick = () => edit({ do: "undo" });
$("redo").onclick = () => edit({ do: "redo" });
$("save").onclick = () => edit({ do: "save", file: $("file").value.trim() });
$("add").onclick = () => edit({ do: "add", shader: $("shader").value });
$("finish").onclick = () => { if (state().saved || !state().changed || confirm("End gelato? It keeps the edits in a file of its own.")) edit({ do: "quit" }); };
addEventListener("keydown", e => {
  if ($("desk").hidden || isTyping(e.target)) return;
  const main = e.ctrlKey || e.metaKey, key = e.key.toLowerCase();
  const act = main && key === "z" ? () => edit({ do: e.shiftKey ? "redo" : "undo" }) : main && key === "y" ? () => edit({ do: "redo" })
    : main && key === "s" ? $("save").onclick : main || e.altKey ? null : key === "w" ? $("before").onclick
    : key === "a" && desk.chosen ? () => setMode(desk.mode === "aim" ? null : "aim") : key === "m" && desk.chosen ? () => setMode(desk.mode === "move" ? null : "move")
    : key === "escape" ? () => { setMode(null); } : null;
  if (act) { e.preventDefault(); act(); }
});
let seen = "";
setInterval(() => { const now = JSON.stringify(visible()); if (desk.id && now !== seen) { seen = now; edit({ do: "see" }); } }, 400);
