// Sweep: sliders over precomputed results. Needs shared.js in front of it.

/** The part of a series that belongs to a slider position: a slice, or all of a constant. */
function slice(series, cell, cells, rank) {
  const whole = series.values.length;
  if (series.shape.length === rank) return series.values;
  const size = whole / cells;
  return series.values.subarray(cell * size, (cell + 1) * size);
}

const RANK = { curves: 1, bars: 1, scatter: 2, image: 2 };

function readPanel(packed) {
  const panel = { ...packed, data: {}, drawn: new Map() };
  for (const [label, series] of Object.entries(packed.series)) panel.data[label] = unpack(series);
  if (packed.x) panel.x = unpack(packed.x).values;
  return panel;
}

function drawBars(ctx, view, panel, series, colours) {
  const entries = Object.entries(series);
  const slot = (panel.width * 0.86 * view.sx) / entries.length;
  entries.forEach(([label, ys], k) => {
    const kind = panel.kinds[label];
    ctx.fillStyle = ctx.strokeStyle = colours[kind];
    ctx.lineWidth = 1.2;
    ctx.setLineDash(DASH[kind] || []);
    ctx.beginPath();
    for (let i = 0; i < ys.length; i++) {
      if (Number.isNaN(ys[i])) continue;
      const left = view.px(panel.x[i]) - (slot * entries.length) / 2 + k * slot;
      const top = view.py(Math.max(ys[i], 0));
      ctx.rect(left, top, Math.max(slot, 1), view.py(Math.min(ys[i], 0)) - top);
    }
    ctx.globalAlpha = 0.55;
    ctx.fill();
    ctx.globalAlpha = 1;
    if (slot > 4) ctx.stroke();
  });
}

function drawScatter(ctx, view, panel, series, colours) {
  for (const [label, points] of Object.entries(series)) {
    const kind = panel.kinds[label];
    const n = points.length / 2;
    const xs = new Float32Array(n);
    const ys = new Float32Array(n);
    for (let i = 0; i < n; i++) { xs[i] = points[2 * i]; ys[i] = points[2 * i + 1]; }
    if (panel.lines) { drawCurve(ctx, view, xs, ys, kind, false, colours); continue; }
    if (n > 300) { drawCloud(ctx, view, xs, ys, kind, colours); continue; }
    const places = [];
    for (let i = 0; i < n; i++) if (!Number.isNaN(xs[i])) places.push([view.px(xs[i]), view.py(ys[i])]);
    ctx.globalAlpha = kind === "particle" ? 0.4 : 1;
    drawMarkers(ctx, colours, kind, MARK[kind], places, kind === "landmark" ? 7 : 4);
    ctx.globalAlpha = 1;
  }
}

/** Thousands of points: small squares, lighter where they are many. */
function drawCloud(ctx, view, xs, ys, kind, colours) {
  const size = xs.length > 3000 ? 1.4 : 2.2;
  ctx.fillStyle = colours[kind];
  ctx.globalAlpha = xs.length > 3000 ? 0.6 : 0.5;
  for (let i = 0; i < xs.length; i++) {
    if (!Number.isNaN(xs[i])) ctx.fillRect(view.px(xs[i]) - size / 2, view.py(ys[i]) - size / 2, size, size);
  }
  ctx.globalAlpha = 1;
}

function drawImage(ctx, view, panel, levels, cell, colours) {
  const shape = panel.data.image.shape;
  const [height, width] = shape.slice(-2);
  const key = `${shape.length > 2 ? cell : 0} ${colours.paper}`;
  if (!panel.drawn.has(key)) {
    if (panel.drawn.size > 24) panel.drawn.clear();
    panel.drawn.set(key, View.picture(levels, width, height, colours));
  }
  view.drawPicture(ctx, panel.drawn.get(key), panel.extent);
}

function drawPanel(ctx, view, panel, cell, cells, colours) {
  const series = {};
  for (const [label, data] of Object.entries(panel.data)) series[label] = slice(data, cell, cells, RANK[panel.type]);
  view.clear(ctx, colours);
  view.axes(ctx, colours, {
    xLabel: panel.x_label, yLabel: panel.y_label, xLog: panel.x_log, yLog: panel.y_log,
  });
  view.clip(ctx);
  if (panel.type === "image") drawImage(ctx, view, panel, series.image, cell, colours);
  if (panel.type === "bars") drawBars(ctx, view, panel, series, colours);
  if (panel.type === "scatter") drawScatter(ctx, view, panel, series, colours);
  if (panel.type === "curves") {
    for (const [label, ys] of Object.entries(series)) {
      drawCurve(ctx, view, panel.x, ys, panel.kinds[label], panel.markers, colours);
    }
  }
  ctx.restore();
  view.frame(ctx, colours);
}

function legendOf(panel) {
  const labels = Object.keys(panel.kinds);
  const samples = labels.map((label) => {
    const kind = panel.kinds[label];
    const points = panel.type === "scatter" && !panel.lines;
    return swatch(kind, panel.type === "bars" ? "area" : points ? MARK[kind] : "line");
  });
  const items = labels.map((label, i) => h("span", { class: "slam-legend-item" }, samples[i], label));
  return { samples, node: h("div", { class: "slam-legend" }, ...items) };
}

// ---- the figure ---------------------------------------------------------------------------------

function buildPanel(packed, state, signal) {
  const panel = readPanel(packed);
  const labels = Object.keys(panel.kinds).join(", ");
  const view = new View(panel.box, {
    equal: Boolean(panel.equal), left: 56, signal,
    label: `${panel.title}: ${panel.type} of ${panel.y_label} over ${panel.x_label}${labels ? `; ${labels}` : ""}.`,
    draw: (ctx) => drawPanel(ctx, view, panel, state.cell(), state.cells, state.colours),
  });
  const legend = legendOf(panel);
  const node = h("div", { class: "slam-panel" }, h("div", { class: "slam-panel-title" }, panel.title), legend.node, view.node);
  return { node, view, samples: legend.samples };
}

function buildSlider(slider, k, state, player, go) {
  const [name, unit] = splitUnit(slider.name);
  const text = (i) => `${show(slider.values[i])}${unit ? ` ${unit}` : ""}`;
  const output = h("output", { class: "slam-value" });
  const input = rangeInput(slider.values.length - 1, slider.name, (v) => { player.pause(); go(k, () => v); });
  const play = k === 0 && slider.values.length > 1 ? playButton(player) : null;
  const row = h("div", { class: "slam-slider" }, play || h("span", { class: "slam-space" }),
    h("span", { class: "slam-name", "aria-hidden": "true" }, name), input, output);
  const put = () => {
    output.textContent = text(state.indices[k]);
    input.put(state.indices[k], text(state.indices[k]));
  };
  return { row, put, play, input, sentence: () => `${name} = ${text(state.indices[k])}` };
}

function buildNumbers(numbers) {
  const cells = numbers.map(() => h("td", {}));
  const rows = numbers.map((n, i) => h("tr", {}, h("th", { scope: "row" }, n.name), cells[i]));
  const table = numbers.length ? h("table", { class: "slam-numbers" }, h("tbody", {}, ...rows)) : null;
  const put = (cell) => cells.forEach((c, i) => { c.textContent = show(numbers[i].values[cell]); });
  const sentence = (cell) => numbers.map((n) => {
    const [name, unit] = splitUnit(n.name);
    return `${name} ${show(n.values[cell])}${unit ? ` ${unit}` : ""}`;
  });
  return { table, put, sentence };
}

/** Space plays; arrows, Page, Home and End move the focused slider, up and down the second one. */
function keysOf(player, sliders, go) {
  const jumps = {
    ArrowRight: (i) => i + 1, ArrowUp: (i) => i + 1, ArrowLeft: (i) => i - 1, ArrowDown: (i) => i - 1,
    PageUp: (i) => i + 5, PageDown: (i) => i - 5, Home: () => 0, End: () => Infinity,
  };
  return (e) => {
    const focused = sliders.findIndex((s) => s.input === e.target);
    const vertical = (e.key === "ArrowUp" || e.key === "ArrowDown") && sliders.length > 1;
    if (e.key === " ") player.toggle();
    else if (jumps[e.key]) {
      player.pause();
      go(focused >= 0 ? focused : Number(vertical), jumps[e.key]);
    } else return false;
    return true;
  };
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const payload = model.get("payload");
  const sizes = payload.sliders.map((s) => s.values.length);
  const state = {
    indices: [...model.get("indices")],
    cells: sizes.reduce((a, b) => a * b, 1),
    cell: () => state.indices.reduce((at, index, k) => at * sizes[k] + index, 0),
    colours: LIGHT,
  };
  const root = card(el, payload, "sweep");
  const panels = payload.panels.map((p) => buildPanel(p, state, signal));
  const numbers = buildNumbers(payload.numbers);
  const line = spokenLine();
  const refresh = () => {
    for (const s of sliders) s.put();
    numbers.put(state.cell());
    line.textContent = [...sliders.map((s) => s.sentence()), ...numbers.sentence(state.cell())].join(" · ");
    root.dataset.indices = state.indices.join();
    for (const p of panels) p.view.redraw();
  };
  const go = (k, next) => {
    state.indices[k] = Math.min(Math.max(next(state.indices[k]), 0), sizes[k] - 1);
    refresh();
    if (!player.playing) tell(model, "indices", [...state.indices]);
  };
  const player = new Player(
    (n) => { go(0, (i) => i + n); return state.indices[0] < sizes[0] - 1; },
    (playing) => {
      if (playing && state.indices[0] === sizes[0] - 1) go(0, () => 0);
      if (sliders[0].play) sliders[0].play.mark(playing);
      line.setAttribute("aria-live", playing ? "off" : "polite");
      if (!playing) tell(model, "indices", [...state.indices]);
    },
    signal,
  );
  player.rate = Math.min(Math.max(sizes[0] / 6, 2), 20);
  const sliders = payload.sliders.map((s, k) => buildSlider(s, k, state, player, go));
  const row = h("div", { class: "slam-panels" }, ...panels.map((p) => p.node));
  root.append(h("div", { class: "slam-sliders" }, ...sliders.map((s) => s.row)), row);
  if (numbers.table) root.append(numbers.table);
  root.append(line);

  keyboard(root, keysOf(player, sliders, go), signal);
  refresh();
  return live({
    root, views: panels.map((p) => p.view), samples: panels.flatMap((p) => p.samples), model, stop,
    event: "change:indices",
    paint: (colours) => { state.colours = colours; },
    moved: () => {
      const given = model.get("indices");
      if (given.join() !== state.indices.join() && !player.playing) { state.indices = [...given]; refresh(); }
    },
    fit: () => {
      for (const { view } of panels) {
        const width = Math.floor(view.node.clientWidth);
        if (width > 0) view.resize(width, Math.round(Math.min(380, Math.max(0.75 * width, 220))));
      }
    },
  });
}

export default { render };
