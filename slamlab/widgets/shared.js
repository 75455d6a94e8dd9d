// What all figures share: unpacking, colours that follow the theme, the view that zooms and pans,
// axes, small controls, keys, and the life of a figure. Plain JavaScript, joined in front of each.

// ---- unpacking (see _pack.py) ---------------------------------------------------------------

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

/** Unpack to {shape, values}: numbers as Float32Array with NaN, images as levels 0..252. */
function unpack(packed) {
  const bytes = bytesOf(packed.data);
  if (packed.type === "runs") return { shape: packed.shape, values: expandRuns(bytes, packed.shape) };
  const view = new DataView(bytes.buffer);
  const columns = packed.middle.length;
  const values = new Float32Array(bytes.length / 2);
  for (let i = 0; i < values.length; i++) {
    const code = view.getInt16(2 * i, true);
    const c = i % columns;
    values[i] = code === -32768 ? NaN : packed.middle[c] + code * packed.scale[c];
  }
  return { shape: packed.shape, values };
}

function expandRuns(bytes, shape) {
  const values = new Uint8Array(shape.reduce((a, b) => a * b, 1));
  let at = 0;
  for (let i = 0; i < bytes.length; i += 2) {
    values.fill(bytes[i + 1], at, at + bytes[i]);
    at += bytes[i];
  }
  return values;
}

// ---- colours --------------------------------------------------------------------------------

const LIGHT = {
  truth: "#000000", dead_reckoning: "#D55E00", estimate: "#0072B2", landmark: "#000000",
  particle: "#0072B2", lidar: "#009E73", wall: "#555555", wrong: "#CC79A7",
  paper: "#ffffff", ink: "#24292f", muted: "#57606a", grid: "#eaeef2", frame: "#8c959f",
};
const DARK = {
  truth: "#dfe3e8", dead_reckoning: "#E8731A", estimate: "#4BA3E3", landmark: "#dfe3e8",
  particle: "#4BA3E3", lidar: "#1DB88C", wall: "#9aa4b0", wrong: "#E09CC4",
  paper: "#12161c", ink: "#e6eaef", muted: "#a3adb8", grid: "#212831", frame: "#6b7683",
};
const DASH = {
  truth: [], dead_reckoning: [7, 4], estimate: [], wrong: [9, 3, 2, 3], lidar: [2, 3], wall: [],
  landmark: [], particle: [2, 2],
};
const WIDTH = { truth: 1.2, wall: 2.4, dead_reckoning: 1.8, estimate: 2, wrong: 1.8 };
const MARK = {
  truth: "circle", dead_reckoning: "square", estimate: "cross", wrong: "diamond", lidar: "dot",
  wall: "square", landmark: "star", particle: "dot",
};

/** Is the page dark? The book, JupyterLab and VS Code each say it in their own way. */
function isDark() {
  const book = document.documentElement.dataset.theme;
  if (book === "dark" || book === "light") return book === "dark";
  const lab = document.body.dataset.jpThemeLight;
  if (lab === "false" || lab === "true") return lab === "false";
  if (document.body.classList.contains("vscode-dark")) return true;
  if (document.body.classList.contains("vscode-light")) return false;
  return window.matchMedia("(prefers-color-scheme: dark)").matches;
}

/** Call `changed(dark)` now and whenever the theme changes, until the signal aborts. */
function followTheme(changed, signal) {
  const tell = () => changed(isDark());
  const observer = new MutationObserver(tell);
  observer.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  observer.observe(document.body, { attributeFilter: ["data-jp-theme-light", "class"] });
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  system.addEventListener("change", tell, { signal });
  signal.addEventListener("abort", () => observer.disconnect());
  tell();
}

// ---- small controls -------------------------------------------------------------------------

/** Make an element: h("button", {class: "x", onclick: f}, "text", child). */
function h(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "html") node.innerHTML = value;
    else if (value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.filter((c) => c !== null && c !== undefined));
  return node;
}

const icon = (shapes) =>
  `<svg viewBox="0 0 24 24" width="20" height="20" aria-hidden="true" focusable="false">${shapes}</svg>`;
const ICONS = {
  play: icon('<path d="M7 4.5v15l12-7.5z" fill="currentColor"/>'),
  pause: icon('<path d="M6 5h4v14H6zM14 5h4v14h-4z" fill="currentColor"/>'),
  back: icon('<path d="M18 6v12l-8-6zM6 6h2.4v12H6z" fill="currentColor"/>'),
  forward: icon('<path d="M6 6v12l8-6zM15.6 6H18v12h-2.4z" fill="currentColor"/>'),
};

/** The sample of a legend: the line or marker as it is drawn on the canvas. */
function swatch(kind, marker) {
  const canvas = h("canvas", { class: "slam-swatch", width: 44, height: 24, "aria-hidden": "true" });
  canvas.paint = (colours) => {
    const ctx = canvas.getContext("2d");
    ctx.setTransform(2, 0, 0, 2, 0, 0);
    ctx.clearRect(0, 0, 22, 12);
    if (marker === "line") {
      strokeStyle(ctx, colours, kind);
      ctx.beginPath();
      ctx.moveTo(1, 6);
      ctx.lineTo(21, 6);
      ctx.stroke();
    } else if (marker === "area") {
      ctx.fillStyle = colours[kind];
      ctx.globalAlpha = 0.75;
      ctx.fillRect(4, 1, 14, 10);
      ctx.globalAlpha = 1;
    } else {
      drawMarkers(ctx, colours, kind, marker, [[11, 6]], 4.6);
    }
  };
  return canvas;
}

function strokeStyle(ctx, colours, kind) {
  ctx.strokeStyle = colours[kind];
  ctx.lineWidth = WIDTH[kind] || 1.6;
  ctx.setLineDash(DASH[kind] || []);
  ctx.lineJoin = "round";
}

function star(ctx, x, y, r) {
  for (let k = 0; k < 10; k++) {
    const a = -Math.PI / 2 + (k * Math.PI) / 5;
    const s = k % 2 ? 0.42 * r : r;
    if (k) ctx.lineTo(x + s * Math.cos(a), y + s * Math.sin(a));
    else ctx.moveTo(x + s * Math.cos(a), y + s * Math.sin(a));
  }
  ctx.closePath();
}

const SHAPES = {
  circle: (c, x, y, r) => { c.moveTo(x + 0.8 * r, y); c.arc(x, y, 0.8 * r, 0, 7); },
  dot: (c, x, y, r) => { c.moveTo(x + 0.6 * r, y); c.arc(x, y, 0.6 * r, 0, 7); },
  square: (c, x, y, r) => c.rect(x - 0.7 * r, y - 0.7 * r, 1.4 * r, 1.4 * r),
  diamond: (c, x, y, r) => {
    c.moveTo(x, y - r); c.lineTo(x + r, y); c.lineTo(x, y + r); c.lineTo(x - r, y); c.closePath();
  },
  cross: (c, x, y, r) => {
    c.moveTo(x - r, y); c.lineTo(x + r, y); c.moveTo(x, y - r); c.lineTo(x, y + r);
  },
  star,
};

/** Markers at pixel positions, in one path: filled for dots, outlined for the rest. */
function drawMarkers(ctx, colours, kind, marker, positions, radius) {
  ctx.setLineDash([]);
  ctx.beginPath();
  for (const [x, y] of positions) SHAPES[marker](ctx, x, y, radius);
  if (marker === "dot") {
    ctx.fillStyle = colours[kind];
    ctx.fill();
  } else {
    ctx.strokeStyle = colours[kind];
    ctx.lineWidth = marker === "cross" ? 2 : 1.3;
    ctx.stroke();
  }
}

// ---- numbers as text ------------------------------------------------------------------------

/** Three significant digits, no exponent for everyday sizes. */
function show(value) {
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return value.toExponential(2).replace("-", "−");
  const text = size >= 1000 ? value.toFixed(size >= 1e4 || Number.isInteger(value) ? 0 : 1)
    : String(parseFloat(value.toPrecision(size >= 100 ? 4 : 3)));
  return text.replace("-", "−");
}

/** "noise (m)" -> ["noise", "m"]. */
function splitUnit(name) {
  const found = /^(.*\S)\s*\(([^()]*)\)\s*$/.exec(name);
  return found ? [found[1], found[2]] : [name, ""];
}

/** A round step (1, 2 or 5 times a power of ten) that cuts `span` into about `count` parts. */
function roundStep(span, count) {
  const rough = Math.max(span, 1e-12) / Math.max(count, 1);
  const power = Math.pow(10, Math.floor(Math.log10(rough)));
  const lead = rough / power;
  return power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
}

function tickText(value, step) {
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const rounded = Math.abs(value) < step / 1e6 ? 0 : value;
  if (Math.abs(rounded) >= 1e6 || digits > 5) return show(rounded);
  return rounded.toFixed(digits).replace("-", "−");
}

const superscript = (n) => String(n).replace(/./g, (c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"["0123456789".indexOf(c)] || "⁻");

// ---- the view: a canvas that knows its data range -------------------------------------------

/** A canvas with a data range that zooms and pans. `box` is [x low, x high, y low, y high]. */
class View {
  constructor(box, { equal = true, label = "", draw, left = 46, bottom = 36, signal }) {
    Object.assign(this, { box, equal, draw, signal });
    this.margin = { left, right: 12, top: 10, bottom };
    this.canvas = h("canvas", { class: "slam-canvas", role: "img", tabindex: "0", "aria-label": label });
    this.resetButton = h("button", {
      class: "slam-reset", type: "button", hidden: "", onclick: () => { this.reset(); this.canvas.focus(); },
    }, "Reset view");
    this.node = h("div", { class: "slam-stage" }, this.canvas, this.resetButton);
    this.zoom = 1;
    this.shift = [0, 0];
    this.width = this.height = 0;
    this.queued = 0;
    this.scrolled = -1e9;
    this.listen();
    signal.addEventListener("abort", () => cancelAnimationFrame(this.queued));
  }

  /** Size the canvas to its place on the page, sharp on dense screens. */
  resize(width, height) {
    const ratio = Math.min(window.devicePixelRatio || 1, 3);
    if (width === this.width && height === this.height && ratio === this.ratio) return;
    Object.assign(this, { width, height, ratio });
    this.canvas.style.height = `${height}px`;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.redraw();
  }

  redraw() {
    if (this.queued || !this.width) return;
    this.queued = requestAnimationFrame(() => {
      this.queued = 0;
      this.locate();
      const ctx = this.canvas.getContext("2d");
      ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      this.draw(ctx, this);
    });
  }

  /** Find scale and offset of both axes: pixel = offset + scale * value. */
  locate() {
    const { left, right, top, bottom } = this.margin;
    this.plot = { x: left, y: top, w: this.width - left - right, h: this.height - top - bottom };
    const [x0, x1, y0, y1] = this.box;
    let sx = this.plot.w / (x1 - x0);
    let sy = this.plot.h / (y1 - y0);
    if (this.equal) sx = sy = Math.min(sx, sy);
    this.sx = sx * this.zoom;
    this.sy = -sy * this.zoom;
    this.ox = this.plot.x + this.plot.w / 2 - (this.sx * (x0 + x1)) / 2 + this.shift[0];
    this.oy = this.plot.y + this.plot.h / 2 - (this.sy * (y0 + y1)) / 2 + this.shift[1];
    this.key = [this.sx, this.sy, this.ox, this.oy, this.width, this.height, this.ratio].join();
  }

  px(x) { return this.ox + this.sx * x; }
  py(y) { return this.oy + this.sy * y; }

  /** Zoom by a factor around a pixel of the canvas, which keeps its place. */
  zoomAt(x, y, factor) {
    const zoom = Math.min(Math.max(this.zoom * factor, 1), 200);
    const f = zoom / this.zoom;
    const cx = this.plot.x + this.plot.w / 2;
    const cy = this.plot.y + this.plot.h / 2;
    this.shift = [(x - cx) * (1 - f) + this.shift[0] * f, (y - cy) * (1 - f) + this.shift[1] * f];
    this.zoom = zoom;
    if (zoom === 1) this.shift = [0, 0];
    this.moved();
  }

  pan(dx, dy) {
    const reach = [this.plot.w * this.zoom, this.plot.h * this.zoom];
    this.shift = this.shift.map((s, i) => Math.min(Math.max(s + [dx, dy][i], -reach[i]), reach[i]));
    this.moved();
  }

  reset() {
    this.zoom = 1;
    this.shift = [0, 0];
    this.moved();
  }

  get home() { return this.zoom === 1 && !this.shift[0] && !this.shift[1]; }

  moved() {
    this.resetButton.hidden = this.home;
    this.canvas.dataset.zoom = this.zoom.toFixed(3);
    this.canvas.dataset.shift = this.shift.map((s) => Math.round(s)).join();
    this.canvas.style.touchAction = this.home ? "pan-y" : "none";
    this.redraw();
  }

  listen() {
    const { canvas, signal } = this;
    const pointers = new Map();
    const place = (e) => {
      const r = canvas.getBoundingClientRect();
      return [e.clientX - r.left, e.clientY - r.top];
    };
    const on = (node, name, f, options = {}) => node.addEventListener(name, f, { signal, ...options });
    canvas.style.touchAction = "pan-y";
    on(window, "scroll", () => { this.scrolled = performance.now(); }, { passive: true, capture: true });
    on(canvas, "wheel", (e) => {
      // the wheel belongs to the page, unless the reader chose the figure or holds Ctrl
      const meant = e.ctrlKey || e.metaKey || canvas.matches(":focus");
      const outward = e.deltaY > 0 && this.home;
      if (!meant || outward || performance.now() - this.scrolled < 200 || !this.plot) return;
      e.preventDefault();
      const lines = e.deltaMode === 1 ? 16 : 1;
      this.zoomAt(...place(e), Math.exp(-Math.max(-240, Math.min(240, e.deltaY * lines)) * 0.002));
    }, { passive: false });
    on(canvas, "pointerdown", (e) => {
      if (e.button !== 0) return;
      pointers.set(e.pointerId, place(e));
      canvas.setPointerCapture(e.pointerId);
    });
    on(canvas, "pointermove", (e) => {
      const before = pointers.get(e.pointerId);
      if (!before || !this.plot) return;
      const now = place(e);
      if (pointers.size === 1) {
        if (e.pointerType === "touch" && this.home) return;
        this.pan(now[0] - before[0], now[1] - before[1]);
        canvas.classList.add("slam-dragging");
      } else {
        const [, other] = [...pointers].find(([id]) => id !== e.pointerId);
        const span = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
        this.zoomAt((now[0] + other[0]) / 2, (now[1] + other[1]) / 2, span(now) / span(before));
      }
      pointers.set(e.pointerId, now);
    });
    const lift = (e) => {
      pointers.delete(e.pointerId);
      canvas.classList.remove("slam-dragging");
    };
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) on(canvas, name, lift);
    on(canvas, "dblclick", () => this.reset());
    on(canvas, "keydown", (e) => {
      const middle = [this.width / 2, this.height / 2];
      if (e.key === "+" || e.key === "=") this.zoomAt(...middle, 1.25);
      else if (e.key === "-") this.zoomAt(...middle, 0.8);
      else if (e.key === "0") this.reset();
      else return;
      e.preventDefault();
    });
  }

  // ---- axes ----

  clear(ctx, colours) {
    ctx.globalAlpha = 1;
    ctx.setLineDash([]);
    ctx.fillStyle = colours.paper;
    ctx.fillRect(0, 0, this.width, this.height);
  }

  clip(ctx) {
    ctx.save();
    ctx.beginPath();
    ctx.rect(this.plot.x, this.plot.y, this.plot.w, this.plot.h);
    ctx.clip();
  }

  ticks(low, high, pixels, log, gap) {
    const count = Math.max(2, pixels / gap);
    if (log) {
      const step = Math.max(1, Math.ceil((high - low) / count));
      const marks = [];
      for (let v = Math.ceil(low / step) * step; v <= high; v += step) marks.push([v, `10${superscript(v)}`]);
      if (marks.length > 1) return marks;
      return [low, (low + high) / 2, high].map((v) => [v, show(Math.pow(10, v))]).slice(0, 3);
    }
    const step = roundStep(high - low, count);
    const marks = [];
    for (let k = Math.ceil(low / step); k * step <= high + step * 1e-9; k++) marks.push([k * step, tickText(k * step, step)]);
    return marks;
  }

  /** Grid, ticks, labels and frame. Called first, so that the data lie above the grid. */
  axes(ctx, colours, { xLabel = "x (m)", yLabel = "y (m)", xLog = false, yLog = false } = {}) {
    const { x, y, w, h: height } = this.plot;
    const data = (p, o, s) => (p - o) / s;
    const xs = this.ticks(data(x, this.ox, this.sx), data(x + w, this.ox, this.sx), w, xLog, 80);
    const ys = this.ticks(data(y + height, this.oy, this.sy), data(y, this.oy, this.sy), height, yLog, 56);
    ctx.setLineDash([]);
    ctx.lineWidth = 1;
    ctx.strokeStyle = colours.grid;
    ctx.beginPath();
    for (const [v] of xs) { const p = Math.round(this.px(v)) + 0.5; ctx.moveTo(p, y); ctx.lineTo(p, y + height); }
    for (const [v] of ys) { const p = Math.round(this.py(v)) + 0.5; ctx.moveTo(x, p); ctx.lineTo(x + w, p); }
    ctx.stroke();
    ctx.fillStyle = colours.muted;
    ctx.font = "12px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
    ctx.textAlign = "center";
    ctx.textBaseline = "top";
    const label = { x: ctx.measureText(xLabel).width, y: ctx.measureText(yLabel).width };
    for (const [v, text] of xs) {
      const half = ctx.measureText(text).width / 2;
      if (this.px(v) + half < this.width) ctx.fillText(text, this.px(v), y + height + 5);
    }
    ctx.fillText(xLabel, x + w / 2, y + height + 20);
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    for (const [v, text] of ys) ctx.fillText(text, x - 6, Math.max(this.py(v), 7));
    ctx.save();
    ctx.translate(9, y + height / 2);
    ctx.rotate(-Math.PI / 2);
    ctx.textAlign = "center";
    if (label.y < height) ctx.fillText(yLabel, 0, 0);
    ctx.restore();
  }

  frame(ctx, colours) {
    ctx.setLineDash([]);
    ctx.lineWidth = 1;
    ctx.strokeStyle = colours.frame;
    ctx.globalAlpha = 0.5;
    ctx.strokeRect(this.plot.x + 0.5, this.plot.y + 0.5, this.plot.w - 1, this.plot.h - 1);
    ctx.globalAlpha = 1;
  }

  /** A bar of a round length in metres, bottom right. */
  scaleBar(ctx, colours) {
    const metres = roundStep((this.plot.w / this.sx) * 0.2, 1);
    const length = metres * this.sx;
    const right = this.plot.x + this.plot.w - 12;
    const base = this.plot.y + this.plot.h - 12;
    const text = `${metres < 1 ? show(metres * 100) + " c" : show(metres) + " "}m`;
    ctx.font = "12px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
    ctx.setLineDash([]);
    ctx.fillStyle = colours.paper;
    ctx.globalAlpha = 0.8;
    ctx.fillRect(right - length - 6, base - 20, length + 12, 26);
    ctx.globalAlpha = 1;
    ctx.strokeStyle = ctx.fillStyle = colours.ink;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.moveTo(right - length, base - 4);
    ctx.lineTo(right - length, base);
    ctx.lineTo(right, base);
    ctx.lineTo(right, base - 4);
    ctx.stroke();
    ctx.textAlign = "center";
    ctx.textBaseline = "bottom";
    ctx.fillText(text, right - length / 2, base - 3);
  }

  /** Levels 0..252 as a grey image on its own canvas; white is 0 (dark theme: paper is 0).
   *  A gamma above 1 keeps the unknown, 0.5, lighter than half way. */
  static picture(levels, width, height, colours, gamma = 1) {
    const canvas = h("canvas", { width, height });
    const ctx = canvas.getContext("2d");
    const image = ctx.createImageData(width, height);
    const from = rgb(colours.paper);
    const to = rgb(colours.ink);
    for (let row = 0; row < height; row++) {
      for (let col = 0; col < width; col++) {
        const level = Math.pow(levels[(height - 1 - row) * width + col] / 252, gamma);
        const at = 4 * (row * width + col);
        for (let c = 0; c < 3; c++) image.data[at + c] = from[c] + (to[c] - from[c]) * level;
        image.data[at + 3] = 255;
      }
    }
    ctx.putImageData(image, 0, 0);
    return canvas;
  }

  drawPicture(ctx, picture, extent) {
    const [x0, x1, y0, y1] = extent;
    ctx.imageSmoothingEnabled = Math.abs(this.sx) * (x1 - x0) < picture.width;
    const [left, top] = [this.px(x0), this.py(y1)];
    ctx.drawImage(picture, left, top, this.px(x1) - left, this.py(y0) - top);
  }
}

function drawCurve(ctx, view, xs, ys, kind, markers, colours) {
  const marks = [];
  strokeStyle(ctx, colours, kind);
  ctx.beginPath();
  let open = false;
  for (let i = 0; i < ys.length; i++) {
    if (Number.isNaN(ys[i]) || Number.isNaN(xs[i])) { open = false; continue; }
    const [x, y] = [view.px(xs[i]), view.py(ys[i])];
    if (open) ctx.lineTo(x, y);
    else ctx.moveTo(x, y);
    open = true;
    if (markers) marks.push([x, y]);
  }
  ctx.stroke();
  if (markers) drawMarkers(ctx, colours, kind, MARK[kind], marks, 4);
}

const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));

/** The card around a figure: title, question, and the theme that its children follow. */
function card(el, payload, kind) {
  const root = h("section", {
    class: `slam-figure slam-${kind}`, role: "group", "data-lm-suppress-shortcuts": "true",
    "aria-label": payload.title || payload.question || `${kind} figure`,
  });
  if (payload.title) root.append(h("div", { class: "slam-title" }, payload.title));
  if (payload.question) root.append(h("div", { class: "slam-question" }, payload.question));
  el.append(root);
  return root;
}

/** Play at a number of steps a second; `tick(n)` advances n steps and says whether to go on. */
class Player {
  constructor(tick, changed, signal) {
    Object.assign(this, { tick, changed, request: 0, rate: 20 });
    signal.addEventListener("abort", () => this.pause());
  }

  get playing() { return this.request !== 0; }

  play() {
    if (this.playing) return;
    let last = null;
    let owed = 0;
    const frame = (now) => {
      owed += last === null ? 1 : Math.min((now - last) / 1000, 0.25) * this.rate;
      last = now;
      const whole = Math.floor(owed);
      owed -= whole;
      this.request = requestAnimationFrame(frame);
      if (whole > 0 && !this.tick(whole)) this.pause();
    };
    this.request = requestAnimationFrame(frame);
    this.changed(true);
  }

  pause() {
    if (!this.playing) return;
    cancelAnimationFrame(this.request);
    this.request = 0;
    this.changed(false);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }
}

/** The line under a figure that says its numbers, to screen readers too. */
const spokenLine = (...parts) => h("div", { class: "slam-text", "aria-live": "polite", "aria-atomic": "true" }, ...parts);

/** The play button, whose name says what pressing it does. */
function playButton(player) {
  const button = h("button", { class: "slam-button slam-play", type: "button", onclick: () => player.toggle() });
  button.mark = (playing) => {
    button.innerHTML = playing ? ICONS.pause : ICONS.play;
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
    button.title = playing ? "Pause (space)" : "Play (space)";
  };
  button.mark(false);
  return button;
}

/** A range input that fills up to its handle. */
function rangeInput(last, label, moved) {
  const input = h("input", {
    class: "slam-range", type: "range", min: 0, max: last, step: 1, value: 0, "aria-label": label,
    oninput: () => moved(Number(input.value)),
  });
  input.put = (value, text) => {
    input.value = value;
    input.setAttribute("aria-valuetext", text);
    input.style.setProperty("--slam-done", `${last ? (100 * value) / last : 0}%`);
  };
  return input;
}

/** Does the focused control use this key itself? Then the figure leaves it alone. */
function usesKey(target, key) {
  if (target.tagName === "SELECT" || target.tagName === "SUMMARY") return true;
  return target.tagName === "BUTTON" && (key === " " || key === "Enter");
}

/** Tell Python, if there is one; the static page has nobody to tell. */
function tell(model, name, value) {
  try {
    model.set(name, value);
    model.save_changes();
  } catch (error) {
    console.debug("no kernel", error);
  }
}

// ---- keys, layers, and the life of a figure -----------------------------------------------------

/** Keys of a figure: `act(event)` says whether it used the key; then nobody else gets it. */
function keyboard(root, act, signal) {
  root.addEventListener("keydown", (e) => {
    if (usesKey(e.target, e.key) || e.ctrlKey || e.metaKey || e.altKey || !act(e)) return;
    e.preventDefault();
    e.stopPropagation();
  }, { signal });
}

/** Buttons that show and hide layers [name, label, kind, marker]; all are shown at first. */
function layerChips(layers, on, changed) {
  const chips = layers.map(([name, label, kind, marker]) => {
    on[name] = true;
    const sample = swatch(kind, marker);
    const chip = h("button", {
      class: "slam-chip", type: "button", "aria-pressed": "true", "data-layer": name,
      onclick: () => {
        on[name] = !on[name];
        chip.setAttribute("aria-pressed", String(on[name]));
        changed();
      },
    }, sample, label);
    chip.sample = sample;
    return chip;
  });
  const row = h("div", { class: "slam-chips", role: "group", "aria-label": "Layers" }, ...chips);
  return { row, samples: chips.map((chip) => chip.sample) };
}

/** Follow theme, size and model until the figure is taken away; returns what ends it.
 *  `paint(colours)` comes with the theme, `fit()` with the size, `moved()` with the model. */
function live({ root, views, samples, model, event, moved, paint, fit, stop }) {
  followTheme((dark) => {
    const colours = dark ? DARK : LIGHT;
    root.dataset.theme = dark ? "dark" : "light";
    for (const sample of samples) sample.paint(colours);
    paint(colours);
    for (const view of views) view.redraw();
  }, stop.signal);
  const observer = new ResizeObserver(fit);
  for (const view of views) observer.observe(view.node);
  if (model.on) model.on(event, moved);
  fit();
  return () => {
    stop.abort();
    observer.disconnect();
    if (model.off) model.off(event, moved);
    root.remove();
  };
}
