// Handles: things on the floor that the reader drags, with a mouse, a finger or the arrow keys.
// Needs shared.js in front of it.

const REACH = 22; // pixels from a handle that still take hold of it
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

/** `items`: {name, kind, marker, at() -> [x, y], move(x, y), turn(angle) or nothing}. */
class Handles {
  constructor(view, items, changed, signal) {
    Object.assign(this, { view, items, changed, chosen: 0, held: -1 });
    this.samples = items.map(({ kind, marker }) => swatch(kind, marker));
    this.buttons = items.map(({ name }, k) => h("button", {
      class: "slam-chip slam-choice", type: "button", "aria-pressed": String(k === 0), "data-handle": name,
      onclick: () => this.choose(k),
    }, this.samples[k], name));
    this.row = h("div", { class: "slam-chips", role: "group", "aria-label": "What the arrow keys move" }, ...this.buttons);
    const on = (name, act, options = {}) => view.canvas.addEventListener(name, act, { signal, ...options });
    on("pointerdown", (e) => this.grab(e), { capture: true });
    on("pointermove", (e) => this.pull(e), { capture: true });
    for (const name of ["pointerup", "pointercancel"]) on(name, () => { this.held = -1; });
    // a finger on a handle moves the handle, elsewhere it scrolls the page
    on("touchstart", (e) => { if (this.under(e.touches[0]) >= 0) e.preventDefault(); }, { passive: false });
  }

  choose(k) {
    this.chosen = k;
    this.buttons.forEach((button, j) => button.setAttribute("aria-pressed", String(j === k)));
    this.changed();
  }

  place(e) {
    const box = this.view.canvas.getBoundingClientRect();
    return [e.clientX - box.left, e.clientY - box.top];
  }

  /** Row of the handle under a pointer, -1 if there is none. */
  under(e) {
    if (!this.view.plot) return -1;
    const [x, y] = this.place(e);
    const far = this.items.map(({ at }) => Math.hypot(this.view.px(at()[0]) - x, this.view.py(at()[1]) - y));
    const nearest = far.indexOf(Math.min(...far));
    return far[nearest] <= REACH ? nearest : -1;
  }

  grab(e) {
    const k = e.button === 0 ? this.under(e) : -1;
    if (k < 0) return;
    e.stopImmediatePropagation();
    this.view.canvas.setPointerCapture(e.pointerId);
    this.held = k;
    this.choose(k);
  }

  pull(e) {
    if (this.held < 0) {
      this.view.canvas.style.cursor = this.under(e) >= 0 ? "move" : "";
      return;
    }
    e.stopImmediatePropagation();
    const [x, y] = this.place(e);
    this.items[this.held].move((x - this.view.ox) / this.view.sx, (y - this.view.oy) / this.view.sy);
    this.changed();
  }

  /** Arrow keys move what is chosen by `step` metres (Shift: ten times), Q and E turn it. */
  key(e, step) {
    const item = this.items[this.chosen];
    const turn = { q: 1, e: -1 }[e.key.toLowerCase()];
    if (ARROWS[e.key]) {
      const [x, y] = item.at();
      const far = e.shiftKey ? 10 * step : step;
      item.move(x + far * ARROWS[e.key][0], y + far * ARROWS[e.key][1]);
    } else if (turn && item.turn) item.turn((turn * 2 * Math.PI) / 180);
    else return false;
    this.changed();
    return true;
  }

  /** A ring round what the arrow keys move. */
  draw(ctx, colours) {
    const [x, y] = this.items[this.chosen].at();
    ctx.setLineDash([3, 3]);
    ctx.strokeStyle = colours.muted;
    ctx.lineWidth = 1.2;
    ctx.beginPath();
    ctx.arc(this.view.px(x), this.view.py(y), 17, 0, 2 * Math.PI);
    ctx.stroke();
    ctx.setLineDash([]);
  }
}

/** Rows of a packed matrix. */
function rowsOf(packed) {
  const { shape: [count, width], values } = unpack(packed);
  return Array.from({ length: count }, (_, k) => [...values.slice(k * width, (k + 1) * width)]);
}

/** A card of one view with handles lives: it follows theme and width until the notebook drops it. */
function liveHandles({ view, samples }, card) {
  return live({
    ...card, views: [view], samples, event: "change:payload", moved: () => {},
    fit: () => {
      const width = Math.floor(view.node.clientWidth);
      if (width > 0) view.resize(width, Math.round(Math.min(430, Math.max(0.8 * width, 240))));
    },
  });
}

/** A slider over given values, with its name and its value beside it. */
function knob(name, values, start, moved) {
  const [label, unit] = splitUnit(name);
  const text = (i) => `${show(values[i])}${unit ? ` ${unit}` : ""}`;
  const output = h("output", { class: "slam-value" });
  const put = (i) => { output.textContent = text(i); input.put(i, text(i)); };
  const input = rangeInput(values.length - 1, name, (i) => { put(i); moved(values[i]); });
  put(start);
  return h("div", { class: "slam-slider" }, h("span", { class: "slam-space" }),
    h("span", { class: "slam-name", "aria-hidden": "true" }, label), input, output);
}

const wrap = (a) => a - 2 * Math.PI * Math.round(a / (2 * Math.PI));
