"use strict";
// Every <figure data-chart> becomes an SVG. Charts share one cursor, a time, and zoom together in x
// where they are linked. Colours, and with them dark mode and print, are the style sheet's.

const page = JSON.parse(document.getElementById("data").textContent);
const arrays = page.arrays.map(text =>
  new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer));
const several = page.recordings.length > 1;
const hidden = new Set();  // recordings that are switched off
const zoomed = {};         // link: [from, to] in x
const plots = [];
const DASHES = ["", "7 3", "2 2.5", "10 3 2 3", "4 2", "14 4", "1 3"];
const DOTS = ["", "round", "square"];  // on the lines of the first seven recordings, of the next seven, ...
const LEFT = 54, RIGHT = 10, TOP = 8, BOTTOM = 36;

const escaped = text => text.replace(/[&<>"']/g, c => `&#${c.charCodeAt(0)};`);
const px = v => Math.max(-1e5, Math.min(1e5, v)).toFixed(1);

const magnitude = v => Math.floor(Math.log10(v) + 1e-9);

function shown(v, step) {  // a number as people write it; step: what tells neighbours apart
  if (!Number.isFinite(v)) return "–";
  const size = Math.abs(v);
  if (size >= 1e6 || (step ? step < 1e-4 : size && size < 1e-4))
    return v ? v.toExponential(step ? Math.max(0, magnitude(size) - magnitude(step)) : 3).replace("e+", "e").replace(/-/g, "−") : "0";
  const digits = step ? Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)) : Math.max(0, 3 - magnitude(size || 1));
  const text = v.toFixed(Math.min(digits, 8));
  return Number(text) ? text.replace("-", "−") : text.replace("-", "");
}

function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find(m => m * power >= raw * 0.999) * power;
  const all = [];
  for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9 && all.length < 50; k++) all.push(k * step);
  return {step, all};
}

function decades(low, high, count) {  // ticks and their texts between two powers of ten
  const isWide = high - low > 1.5, {step, all} = isWide ? ticks(low, high, Math.min(count, high - low)) : ticks(10 ** low, 10 ** high, count);
  return all.map(v => isWide ? [10 ** v, shown(10 ** v, 10 ** v)] : [v, shown(v, step)]);
}

const swatch = ({kind, colour, dash, dots}) => `<svg class="swatch" viewBox="0 0 26 9" aria-hidden="true"><path class="line ${kind} ${colour}" stroke-dasharray="${dash}" d="${kind === "area" ? "M1,1h24v7h-24z" : "M0,4.5h26"}"/>${dots ? `<path class="line dot ${dots} ${colour}" d="M13,4.5h0"/>` : ""}</svg>`;
const look = recording => ({colour: `k${recording % 7}`, dash: DASHES[recording % 7], dots: DOTS[Math.floor(recording / 7)]});

function nearest(sorted, v) {  // index of the nearest of ascending values
  let low = 0, high = sorted.length - 1;
  while (high - low > 1) { const mid = (low + high) >> 1; sorted[mid] <= v ? low = mid : high = mid; }
  return v - sorted[low] <= sorted[high] - v ? low : high;
}

class Plot {
  constructor(figure, number) {
    this.spec = page.charts[number];
    this.lines = this.spec.lines.map(line => {
      const x = arrays[line.x], isTimed = line.t !== null || this.spec.link === "time";
      return {...line, x, y: arrays[line.y], t: !isTimed ? null : line.t === null ? x : arrays[line.t]};
    });
    const styles = new Set(this.lines.filter(l => l.kind !== "area" && l.kind !== "faint" && l.recording !== null).map(l => l.style));
    for (const line of this.lines) {
      const own = several && line.recording !== null, who = page.recordings[line.recording];
      const {colour, dash, dots} = look(own ? line.recording : line.style % 7), isPlain = ["faint", "area", "broad"].includes(line.kind);
      line.colour = own || !several ? colour : "shared";
      line.dash = isPlain ? "" : own && styles.size > 1 ? DASHES[line.style % 7] : dash;
      line.dots = isPlain ? "" : dots;
      line.label = !own ? line.name : styles.size < 2 ? who : `${who}: ${line.name}`;
    }
    this.figure = figure;
    this.plot = figure.querySelector(".plot");
    this.legend = figure.querySelector("ul");
    this.when = figure.querySelector("output");
    this.zoomY = null;
    this.zoomX = null;  // of charts without a link
    this.id = `clip${number}`;
    this.listen();
    new ResizeObserver(() => {
      if (this.plot.clientWidth !== this.width) requestAnimationFrame(() => this.draw());
    }).observe(this.plot);
  }

  get visible() { return this.lines.filter(line => !hidden.has(line.recording)); }
  scale(v) { return this.spec.log ? Math.log10(v) : v; }  // what the y axis is linear in
  get view() { return this.spec.link ? zoomed[this.spec.link] : this.zoomX; }

  ranges() {
    const {extent, marks, categories} = this.spec;
    if (extent) {
      const [left, right, bottom, top] = extent;
      return {x: this.zoomX || [left, right], y: this.zoomY || [bottom, top]};
    }
    let x = this.view;
    if (!x) {
      x = [Infinity, -Infinity];
      for (const other of this.spec.link ? plots.filter(p => p.spec.link === this.spec.link) : [this])
        for (const line of other.visible) if (line.kind !== "faint" && line.x.length) {
          x[0] = Math.min(x[0], line.x[0]); x[1] = Math.max(x[1], line.x[line.x.length - 1]);
        }
      if (!(x[1] > x[0])) x = Number.isFinite(x[0]) ? [x[0] - 0.5, x[0] + 0.5] : [0, 1];
    }
    const names = Object.keys(categories).map(Number);
    if (names.length) return {x, y: [Math.min(...names) - 0.4, Math.max(...names) + 0.4]};
    if (this.zoomY) return {x, y: this.zoomY};
    let low = Infinity, high = -Infinity;
    const see = v => { if (Number.isFinite(v)) { low = Math.min(low, this.scale(v)); high = Math.max(high, this.scale(v)); } };
    for (const line of this.visible) if (line.kind !== "faint")
      for (let i = 0; i < line.x.length; i++) if (line.x[i] >= x[0] && line.x[i] <= x[1]) see(line.y[i]);
    if (!this.view) for (const mark of marks) if (mark.y !== null) see(mark.y);
    if (low > high) [low, high] = [0, 1];
    const pad = high > low ? 0.06 * (high - low) : 0.05 * Math.abs(high) || 0.5;
    return {x, y: [low - pad, high + pad]};
  }

  draw() {
    this.width = this.plot.clientWidth;
    if (!this.width) return;
    const W = this.width, {x, y} = this.range = this.ranges(), {spec} = this;
    const names = Object.entries(spec.categories);
    const left = names.length ? Math.min(W / 3, 16 + 6 * Math.max(...names.map(([, text]) => text.length))) : LEFT;
    const w = W - left - RIGHT;
    const wide = this.figure.classList.contains("wide");
    const h = spec.extent
      ? w * (spec.extent[3] - spec.extent[2]) / (spec.extent[1] - spec.extent[0])
      : names.length ? Math.max(60, 20 * names.length) : wide ? Math.min(320, Math.max(180, W / 3.5)) : 150;
    const H = h + TOP + BOTTOM;
    this.box = {left, w, h};
    const X = this.X = v => left + (v - x[0]) / (x[1] - x[0]) * w;
    const Y = this.Y = v => TOP + h - (this.scale(v) - y[0]) / (y[1] - y[0]) * h;
    const out = [`<svg viewBox="0 0 ${W} ${H.toFixed(0)}" aria-hidden="true"${spec.extent ? ' class="map"' : ""}>`,
      `<clipPath id="${this.id}"><rect x="${left}" y="${TOP}" width="${w}" height="${h}"/></clipPath>`];
    if (spec.picture) {
      const [l, r, b, t] = spec.picture.extent;
      out.push(`<g clip-path="url(#${this.id})"><image href="${spec.picture.href}" x="${X(l)}" y="${Y(t)}" width="${X(r) - X(l)}" height="${Y(b) - Y(t)}" preserveAspectRatio="none"/></g>`);
    }
    const across = ticks(x[0], x[1], w / 75), count = Math.max(h / 36, Math.min(4, h / 20)), up = ticks(y[0], y[1], count);
    for (const v of across.all) out.push(
      spec.picture ? "" : `<line class="grid" x1="${px(X(v))}" x2="${px(X(v))}" y1="${TOP}" y2="${TOP + h}"/>`,
      `<text x="${px(X(v))}" y="${TOP + h + 14}" text-anchor="middle">${shown(v, across.step)}</text>`);
    const rows = names.length ? names.map(([v, text]) => [Number(v), text]) : spec.log ? decades(...y, count) : up.all.map(v => [v, shown(v, up.step)]);
    for (const [v, text] of rows) out.push(
      spec.picture ? "" : `<line class="grid" x1="${left}" x2="${left + w}" y1="${px(Y(v))}" y2="${px(Y(v))}"/>`,
      `<text x="${left - 6}" y="${px(Y(v) + 4)}" text-anchor="end">${escaped(text)}</text>`);
    const axis = ([name, unit]) => escaped(unit ? `${name}, ${unit}` : name);
    out.push(`<text x="${left + w}" y="${TOP + h + 29}" text-anchor="end">${axis(spec.x)}</text>`);
    if (spec.y[0]) out.push(`<text x="0" y="${TOP + h + 29}">↑ ${axis(spec.y)}</text>`);
    out.push(`<g clip-path="url(#${this.id})">`);
    if (spec.link === "time") for (const e of page.events) if (!hidden.has(e.recording))
      out.push(`<line class="event" x1="${px(X(e.t))}" x2="${px(X(e.t))}" y1="${TOP}" y2="${TOP + h}"><title>${escaped(e.text)}</title></line>`);
    const order = ["area", "faint", "broad"];
    for (const line of [...this.visible].sort((a, b) => (order.indexOf(a.kind) + 4) % 4 - (order.indexOf(b.kind) + 4) % 4)) out.push(this.path(line));
    out.push(this.marks(), `</g><rect class="frame" x="${left}" y="${TOP}" width="${w}" height="${h}"/>`);
    if (spec.north !== null) out.push(`<g class="compass" transform="translate(${left + w / 2 + 8} ${TOP + h + 26}) rotate(${spec.north + 90}) scale(.6)"><path d="M0,-14L6,12L0,7L-6,12Z"/></g>`,
      `<text class="label" x="${left + w / 2 - 6}" y="${TOP + h + 30}" text-anchor="end">N</text>`);
    out.push('<g class="cursor"></g><rect class="select" height="0" width="0"/></svg>');
    this.plot.innerHTML = out.join("");
    this.cursor = this.plot.querySelector(".cursor");
    this.selection = this.plot.querySelector(".select");
    this.explain();
  }

  path(line) {
    const {x, y, kind} = line, {X, Y, range, box} = this, bottom = TOP + box.h;
    const ordered = line.t !== null && !this.spec.extent;
    let from = 0, to = x.length - 1;
    if (ordered && x.length) {
      from = Math.max(0, nearest(x, range.x[0]) - 2);
      to = Math.min(x.length - 1, nearest(x, range.x[1]) + 2);
    }
    let d = "", start = null, last = 0, count = 0, alone = "", dotted = -Infinity;
    const close = () => {
      if (kind === "area" && start !== null) d += `L${px(last)},${bottom}L${px(start)},${bottom}Z`;
      if (count === 1) alone += `M${px(last)},${px(height)}h0`;
      start = null; count = 0;
    };
    let height = 0;
    for (let i = from; i <= to; i++) {
      const a = X(x[i]), b = Y(y[i]);
      if (!Number.isFinite(a + b)) { close(); continue; }
      d += start === null ? `M${px(a)},${px(b)}` : kind === "steps" ? `H${px(a)}V${px(b)}` : `L${px(a)},${px(b)}`;
      if (start === null) start = a;
      if (line.dots && Math.abs(a - dotted) > 60) { alone += `M${px(a)},${px(b)}h0`; dotted = a; }
      last = a; height = b; count++;
    }
    close();
    const dots = alone ? `<path class="line dot ${line.dots} ${line.colour}" d="${alone}"/>` : "";
    return `<path class="line ${kind} ${line.colour}" d="${d}" stroke-dasharray="${line.dash}"/>${dots}`;
  }

  marks() {
    const {X, Y, box} = this, right = box.left + box.w;
    const placed = [];
    return this.spec.marks.filter(m => m.recording === null || !hidden.has(m.recording)).map(m => {
      const text = escaped(m.text);
      if (m.x === null) {  // hatched beyond it, labelled within
        const at = Math.max(TOP, Math.min(TOP + box.h, Y(m.y)));
        return `<rect class="beyond" x="${box.left}" y="${m.upper ? TOP : px(at)}" width="${box.w}" height="${px(m.upper ? at - TOP : TOP + box.h - at)}"/>` +
          `<line class="limit" x1="${box.left}" x2="${right}" y1="${px(Y(m.y))}" y2="${px(Y(m.y))}"/>` +
          `<text class="label" x="${right - 4}" y="${px(Y(m.y) + (m.upper ? 13 : -4))}" text-anchor="end">${text}</text>`;
      }
      const x = X(m.x), y = Y(m.y), own = several && m.recording !== null, colour = own ? `k${m.recording % 7}` : "";
      const end = x > right - 130 ? "end" : x < box.left + 130 ? "start" : "middle";
      const crowd = placed.filter(other => Math.abs(other - x) < 190).length, above = y - 9 - 14 * crowd > TOP + 12;
      placed.push(x);
      return `<circle class="mark ${colour}" cx="${px(x)}" cy="${px(y)}" r="4.5"><title>${text}</title></circle>` + (own ? "" :
        `<text class="label" x="${px(end === "middle" ? x : end === "end" ? x + 4 : x - 4)}" y="${px(above ? y - 9 - 14 * crowd : y + 18 + 14 * crowd)}" text-anchor="${end}">${text}</text>`);
    }).join("");
  }

  explain() {  // the legend; it also shows values
    const seen = new Set();
    this.listed = this.visible.filter(l => !seen.has(l.label + l.kind) && seen.add(l.label + l.kind) && (l.kind !== "faint" || !several));
    const one = this.listed.length === 1 && this.listed[0].kind !== "faint" && !several;
    this.legend.innerHTML = this.listed.map(line => `<li>${one ? "" : swatch(line) + escaped(line.label)}<b></b></li>`).join("") ;
    const {categories, extent, log} = this.spec, {y} = this.range, texts = Object.values(categories);
    const most = magnitude(Math.max(...y.map(Math.abs)));
    this.digit = log ? 0 : 10 ** (most < -2 ? most - 3 : Math.max(most - 3, -4));  // of values
    const longest = texts.length ? texts : extent ? extent.map(v => `${shown(v, 0.1)}, ${shown(v, 0.1)}`) : log ? ["0.0001234"] : y.map(v => shown(v, this.digit));
    this.legend.style.setProperty("--room", `${Math.max(...longest.map(text => text.length))}ch`);
    this.values = [...this.legend.querySelectorAll("b")];
  }

  // show the values at a moment; where the pointer is on a linked axis, at that x
  point(t, x = null) {
    if (!this.cursor) return;
    let across = null, parts = "";
    this.listed.forEach((line, k) => {
      this.values[k].textContent = "";
      if (t === null || !line.t || !line.t.length) return;
      const by = x !== null && !this.spec.extent ? line.x : line.t, v = by === line.x && x !== null ? x : t;
      let i = nearest(by, v);
      if (line.kind === "steps" && by[i] > v && i > 0) i--;
      if (v < by[0] || !Number.isFinite(line.y[i])) return;
      if (across === null) across = line.x[i];
      const text = this.spec.categories[line.y[i]];
      this.values[k].textContent = text === undefined ? this.spec.extent ? `${shown(line.x[i], 0.1)}, ${shown(line.y[i], 0.1)}` : shown(line.y[i], this.digit) : text;
      if (line.kind !== "area") parts += `<circle class="${line.colour}" cx="${px(this.X(line.kind === "steps" && by === line.x ? v : line.x[i]))}" cy="${px(this.Y(line.y[i]))}" r="3.5"/>`;
    });
    const inside = across !== null && across >= this.range.x[0] && across <= this.range.x[1];
    const bar = inside && !this.spec.extent ? `<line x1="${px(this.X(x ?? across))}" x2="${px(this.X(x ?? across))}" y1="${TOP}" y2="${TOP + this.box.h}"/>` : "";
    this.cursor.innerHTML = inside ? bar + parts : "";
    this.when.textContent = across === null ? "" : this.spec.link === "distance" ? `${shown(x ?? across, 0.1)} m` : `${t.toFixed(2)} s`;
  }

  at(event) {  // data coordinates of a pointer
    const {left, w, h} = this.box, {x, y} = this.range, box = this.plot.getBoundingClientRect();
    const a = event.clientX - box.left, b = event.clientY - box.top;
    const clamp = (v, most) => Math.max(0, Math.min(most, v));
    return {a, b, x: x[0] + clamp(a - left, w) / w * (x[1] - x[0]), y: y[1] - clamp(b - TOP, h) / h * (y[1] - y[0])};
  }

  moment({x, y}) {  // the time that a place in this chart stands for
    if (this.spec.link === "time") return x;
    let best = Infinity, t = null;
    for (const line of this.visible) if (line.t && line.kind !== "area")
      for (let i = 0; i < line.x.length; i++) {
        const away = this.spec.extent ? Math.hypot(line.x[i] - x, line.y[i] - y) : Math.abs(line.x[i] - x);
        if (away < best) { best = away; t = line.t[i]; }
      }
    return t;
  }

  show(place) {
    const t = this.moment(place);
    for (const plot of plots) plot.point(t, plot.spec.link && plot.spec.link === this.spec.link ? place.x : null);
    this.place = place;
  }

  zoom(x, y) {
    if (this.spec.extent && x) {  // keep the scales equal
      const [l, r, b, t] = this.spec.extent, size = Math.max((x[1] - x[0]) / (r - l), (y[1] - y[0]) / (t - b)) / 2;
      const cx = (x[0] + x[1]) / 2, cy = (y[0] + y[1]) / 2;
      x = [cx - size * (r - l), cx + size * (r - l)]; y = [cy - size * (t - b), cy + size * (t - b)];
    }
    this.zoomY = y;
    if (!this.spec.link) this.zoomX = x;
    else zoomed[this.spec.link] = x;
    for (const plot of plots) if (plot === this || (this.spec.link && plot.spec.link === this.spec.link)) {
      if (!x) plot.zoomY = null;
      plot.draw();
    }
  }

  listen() {
    let start = null;
    const {plot} = this;
    plot.addEventListener("pointerdown", event => {
      if (event.button) return;
      start = this.at(event);
      plot.setPointerCapture(event.pointerId);
      this.show(start);
    });
    plot.addEventListener("pointermove", event => {
      if (!this.box) return;
      const now = this.at(event);
      this.show(now);
      if (!start) return;
      const {left, w, h} = this.box, tall = this.spec.extent || Math.abs(now.b - start.b) > 24;
      const from = Math.max(left, Math.min(start.a, now.a)), to = Math.min(left + w, Math.max(start.a, now.a));
      const top = tall ? Math.max(TOP, Math.min(start.b, now.b)) : TOP, end = tall ? Math.min(TOP + h, Math.max(start.b, now.b)) : TOP + h;
      for (const [name, v] of Object.entries({x: from, width: Math.max(0, to - from), y: top, height: Math.max(0, end - top)})) this.selection.setAttribute(name, v);
    });
    plot.addEventListener("pointerup", event => {
      if (!start) return;
      const end = this.at(event), from = start, sorted = (a, b) => [Math.min(a, b), Math.max(a, b)];
      start = null;
      this.selection.setAttribute("width", 0);
      if (Math.abs(end.a - from.a) < 8) return;
      const tall = this.spec.extent || Math.abs(end.b - from.b) > 24;
      this.zoom(sorted(from.x, end.x), tall ? sorted(from.y, end.y) : null);
    });
    plot.addEventListener("pointercancel", () => { start = null; this.selection?.setAttribute("width", 0); });
    plot.addEventListener("pointerleave", () => { if (!start) for (const each of plots) each.point(null); });
    plot.addEventListener("dblclick", () => this.zoom(null, null));
    plot.addEventListener("keydown", event => {
      const {x, y} = this.range, place = this.place || {x: (x[0] + x[1]) / 2, y: (y[0] + y[1]) / 2};
      const half = (x[1] - x[0]) / 2, step = half / 50 * (event.shiftKey ? 10 : 1);
      if (event.key === "ArrowLeft") this.show({...place, x: Math.max(x[0], place.x - step)});
      else if (event.key === "ArrowRight") this.show({...place, x: Math.min(x[1], place.x + step)});
      else if (event.key === "+" && !this.spec.extent) this.zoom([place.x - half / 2, place.x + half / 2], null);
      else if (event.key === "-" && !this.spec.extent) this.zoom([place.x - 2 * half, place.x + 2 * half], null);
      else if (event.key === "Escape" || event.key === "-") this.zoom(null, null);
      else return;
      event.preventDefault();
    });
  }
}

for (const figure of document.querySelectorAll("figure[data-chart]"))
  plots.push(new Plot(figure, Number(figure.dataset.chart)));
for (const plot of plots) plot.draw();

if (several) for (const named of document.querySelectorAll("[data-recording]"))
  named.insertAdjacentHTML("afterbegin", swatch(look(Number(named.dataset.recording))));
for (const button of document.querySelectorAll("button[data-recording]"))
  button.addEventListener("click", () => {
    const recording = Number(button.dataset.recording);
    hidden.has(recording) ? hidden.delete(recording) : hidden.add(recording);
    button.setAttribute("aria-pressed", String(!hidden.has(recording)));
    for (const plot of plots) plot.draw();
  });
