// Replay: one run of a robot, drawn step by step. Needs shared.js in front of it.

const LAYERS = [
  ["occupancy", "map", "wall", "area"],
  ["walls", "walls", "wall", "line"],
  ["scans", "lidar", "lidar", "dot"],
  ["beams", "beams", "lidar", "line"],
  ["landmarks", "true landmarks", "landmark", "star"],
  ["landmark_estimates", "estimated landmarks", "estimate", "cross"],
  ["particles", "particles", "particle", "dot"],
  ["truth", "true path", "truth", "line"],
  ["dead_reckoning", "dead reckoning", "dead_reckoning", "line"],
  ["wrong", "wrong variant", "wrong", "line"],
  ["estimate", "estimate", "estimate", "line"],
  ["ellipses", "95 % ellipse", "estimate", "area"],
];
const PATHS = ["dead_reckoning", "wrong", "truth", "estimate"];

/** One point of a packed array (steps, 2 or 3). */
function poseAt(path, step) {
  const columns = path.shape[path.shape.length - 1];
  const at = step * columns;
  return [path.values[at], path.values[at + 1], columns > 2 ? path.values[at + 2] : NaN];
}

/** The data of a run, unpacked once. */
function readRun(payload) {
  const run = { ...payload, data: {} };
  for (const [name, packed] of Object.entries(payload.arrays)) run.data[name] = unpack(packed);
  run.times = payload.times ? unpack(payload.times).values : null;
  if (payload.maps) run.maps = { ...payload.maps, images: unpack(payload.maps.images), drawn: new Map() };
  run.robot = run.data.estimate || run.data.truth || run.data.dead_reckoning || run.data.wrong;
  return run;
}

/** Does this run have this layer? */
function hasLayer(run, name) {
  if (name === "occupancy") return Boolean(run.maps);
  if (name === "beams") return run.beams && Boolean(run.data.scans) && Boolean(run.robot);
  return Boolean(run.data[name]);
}

// ---- drawing ----------------------------------------------------------------------------------

function drawMap(ctx, view, run, step, colours) {
  const { images, extent, steps, drawn } = run.maps;
  let index = -1;
  while (index + 1 < steps.length && steps[index + 1] <= step) index++;
  if (index < 0) return;
  const key = `${index} ${colours.paper}`;
  if (!drawn.has(key)) {
    const [, height, width] = images.shape;
    const levels = images.values.subarray(index * width * height, (index + 1) * width * height);
    if (drawn.size > 12) drawn.clear();
    drawn.set(key, View.picture(levels, width, height, colours, 1.6));
  }
  view.drawPicture(ctx, drawn.get(key), extent);
}

function drawWalls(ctx, view, walls, colours) {
  strokeStyle(ctx, colours, "wall");
  ctx.beginPath();
  const v = walls.values;
  for (let i = 0; i < v.length; i += 4) {
    ctx.moveTo(view.px(v[i]), view.py(v[i + 1]));
    ctx.lineTo(view.px(v[i + 2]), view.py(v[i + 3]));
  }
  ctx.stroke();
}

/** The points of all steps so far, written pixel by pixel into a buffer that only grows. */
class Trace {
  draw(ctx, view, scans, step, colours) {
    const key = view.key + colours.lidar;
    if (key !== this.key || step < this.done) this.start(view, key);
    const perStep = 2 * scans.shape[1];
    const [r, g, b] = rgb(colours.lidar);
    const ink = (150 << 24) | (b << 16) | (g << 8) | r;
    const [w, height, size] = [this.canvas.width, this.canvas.height, view.ratio >= 1.5 ? 2 : 1];
    const v = scans.values;
    for (let i = perStep * (this.done + 1); i < perStep * (step + 1); i += 2) {
      const x = Math.round(view.px(v[i]) * view.ratio);
      const y = Math.round(view.py(v[i + 1]) * view.ratio);
      if (!(x >= 0 && y >= 0 && x < w - 1 && y < height - 1)) continue;
      for (let dy = 0; dy < size; dy++) for (let dx = 0; dx < size; dx++) this.pixels[(y + dy) * w + x + dx] = ink;
    }
    if (step !== this.done) this.canvas.getContext("2d").putImageData(this.image, 0, 0);
    this.done = step;
    ctx.drawImage(this.canvas, 0, 0, view.width, view.height);
  }

  start(view, key) {
    const [width, height] = [view.canvas.width, view.canvas.height];
    this.canvas = this.canvas || h("canvas");
    Object.assign(this.canvas, { width, height });
    this.image = this.canvas.getContext("2d").createImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.key = key;
    this.done = -1;
  }
}

function drawBeams(ctx, view, run, step, colours) {
  const [x, y] = poseAt(run.robot, step);
  const v = run.data.scans.values;
  const perStep = 2 * run.data.scans.shape[1];
  ctx.setLineDash([]);
  ctx.strokeStyle = colours.lidar;
  ctx.globalAlpha = perStep > 120 ? 0.22 : 0.45;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let i = perStep * step; i < perStep * (step + 1); i += 2) {
    if (Number.isNaN(v[i])) continue;
    ctx.moveTo(view.px(x), view.py(y));
    ctx.lineTo(view.px(v[i]), view.py(v[i + 1]));
  }
  ctx.stroke();
  ctx.globalAlpha = 1;
}

function drawScan(ctx, view, scans, step, colours) {
  const v = scans.values;
  const perStep = 2 * scans.shape[1];
  ctx.fillStyle = colours.lidar;
  ctx.beginPath();
  for (let i = perStep * step; i < perStep * (step + 1); i += 2) {
    if (!Number.isNaN(v[i])) ctx.rect(view.px(v[i]) - 1.5, view.py(v[i + 1]) - 1.5, 3, 3);
  }
  ctx.fill();
}

function drawPath(ctx, view, path, kind, step, colours) {
  strokeStyle(ctx, colours, kind);
  ctx.beginPath();
  const columns = path.shape[1];
  let [lastX, lastY] = [Infinity, Infinity];
  for (let i = 0; i <= step; i++) {
    const x = view.px(path.values[i * columns]);
    const y = view.py(path.values[i * columns + 1]);
    if (i > 0 && i < step && Math.abs(x - lastX) < 0.5 && Math.abs(y - lastY) < 0.5) continue;
    if (i) ctx.lineTo(x, y);
    else ctx.moveTo(x, y);
    [lastX, lastY] = [x, y];
  }
  ctx.stroke();
}

function ellipseAt(ctx, view, x, y, [a, b, angle]) {
  if (Number.isNaN(a) || Number.isNaN(x)) return;
  const [cx, cy, ra] = [view.px(x), view.py(y), Math.max(a * view.sx, 0)]; // packed: -1e-10 is 0
  ctx.moveTo(cx + ra * Math.cos(angle), cy - ra * Math.sin(angle));
  ctx.ellipse(cx, cy, ra, Math.max(b * view.sx, 0.5), -angle, 0, 2 * Math.PI);
}

function fillEllipses(ctx, colour) {
  ctx.setLineDash([]);
  ctx.fillStyle = ctx.strokeStyle = colour;
  ctx.globalAlpha = 0.2;
  ctx.fill();
  ctx.globalAlpha = 0.9;
  ctx.lineWidth = 1;
  ctx.stroke();
  ctx.globalAlpha = 1;
}

function drawLandmarkEstimates(ctx, view, run, step, colours) {
  const { landmark_estimates: found, landmark_ellipses: spread } = run.data;
  const n = found.shape[1];
  const seen = [];
  ctx.beginPath();
  for (let i = 0; i < n; i++) {
    const [x, y] = found.values.subarray(2 * (step * n + i), 2 * (step * n + i) + 2);
    if (Number.isNaN(x)) continue;
    seen.push([view.px(x), view.py(y)]);
    if (spread) ellipseAt(ctx, view, x, y, spread.values.subarray(3 * (step * n + i), 3 * (step * n + i) + 3));
  }
  if (spread) fillEllipses(ctx, colours.estimate);
  drawMarkers(ctx, colours, "estimate", "cross", seen, 5);
}

function drawParticles(ctx, view, particles, step, colours) {
  const [, n, columns] = particles.shape;
  const v = particles.values;
  const size = n > 400 ? 1.5 : 2.5;
  ctx.fillStyle = ctx.strokeStyle = colours.particle;
  ctx.globalAlpha = n > 1500 ? 0.18 : 0.3;
  ctx.setLineDash([]);
  ctx.lineWidth = 1;
  for (let i = step * n; i < (step + 1) * n; i++) {
    const x = view.px(v[i * columns]);
    const y = view.py(v[i * columns + 1]);
    if (n > 400) {
      ctx.fillRect(x - size, y - size, 2 * size, 2 * size);
      continue;
    }
    ctx.beginPath();
    ctx.arc(x, y, size, 0, 2 * Math.PI);
    ctx.fill();
  }
  if (columns > 2 && n <= 400) {
    ctx.globalAlpha = 0.45;
    ctx.beginPath();
    for (let i = step * n; i < (step + 1) * n; i++) {
      const [x, y, a] = [view.px(v[i * columns]), view.py(v[i * columns + 1]), v[i * columns + 2]];
      ctx.moveTo(x, y);
      ctx.lineTo(x + 8 * Math.cos(a), y - 8 * Math.sin(a));
    }
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

function drawRobot(ctx, view, [x, y, theta], radius, kind, colours) {
  if (Number.isNaN(x)) return;
  const r = Math.max(radius * view.sx, 5);
  const [cx, cy] = [view.px(x), view.py(y)];
  ctx.beginPath();
  ctx.arc(cx, cy, r, 0, 2 * Math.PI);
  ctx.fillStyle = kind === "estimate" ? colours.estimate : colours.paper;
  ctx.globalAlpha = kind === "estimate" ? 0.9 : 0.7;
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.strokeStyle = colours[kind];
  ctx.lineWidth = 1.6;
  ctx.setLineDash(kind === "dead_reckoning" ? [3, 2] : []);
  ctx.stroke();
  if (Number.isNaN(theta)) return;
  ctx.setLineDash([]);
  ctx.strokeStyle = kind === "estimate" ? colours.paper : colours[kind];
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(cx, cy);
  ctx.lineTo(cx + r * Math.cos(theta), cy - r * Math.sin(theta));
  ctx.stroke();
}

/** One frame: the floor first, what the robot knows above it, the robot on top. */
function drawRun(ctx, view, run, step, on, colours, trace) {
  const { data } = run;
  view.clear(ctx, colours);
  view.axes(ctx, colours);
  view.clip(ctx);
  if (on.occupancy) drawMap(ctx, view, run, step, colours);
  if (on.walls) drawWalls(ctx, view, data.walls, colours);
  if (on.scans && run.accumulate) trace.draw(ctx, view, data.scans, step, colours);
  if (on.beams) drawBeams(ctx, view, run, step, colours);
  if (on.scans) drawScan(ctx, view, data.scans, step, colours);
  for (const kind of PATHS) if (on[kind]) drawPath(ctx, view, data[kind], kind, step, colours);
  if (on.landmarks) {
    const v = data.landmarks.values;
    const columns = data.landmarks.shape[1];
    const places = [];
    for (let i = 0; i < v.length; i += columns) places.push([view.px(v[i]), view.py(v[i + 1])]);
    drawMarkers(ctx, colours, "landmark", "star", places, 7);
  }
  if (on.landmark_estimates) drawLandmarkEstimates(ctx, view, run, step, colours);
  if (on.particles) drawParticles(ctx, view, data.particles, step, colours);
  if (on.ellipses) {
    const [x, y] = poseAt(data.estimate, step);
    ctx.beginPath();
    ellipseAt(ctx, view, x, y, poseAt(data.ellipses, step));
    fillEllipses(ctx, colours.estimate);
  }
  for (const kind of PATHS) {
    if (on[kind]) drawRobot(ctx, view, poseAt(data[kind], step), run.robot_radius, kind, colours);
  }
  ctx.restore();
  view.frame(ctx, colours);
  view.scaleBar(ctx, colours);
}

// ---- error over time ----------------------------------------------------------------------------

/** Distance from the truth at every step, of each path that has one; null without. */
function errorsOf(run) {
  const { truth } = run.data;
  const curves = {};
  for (const kind of truth && run.steps > 1 ? PATHS : []) {
    if (kind === "truth" || !run.data[kind]) continue;
    curves[kind] = Float32Array.from({ length: run.steps }, (_, k) => {
      const [[x, y], [tx, ty]] = [poseAt(run.data[kind], k), poseAt(truth, k)];
      return Math.hypot(x - tx, y - ty);
    });
  }
  return Object.keys(curves).length ? curves : null;
}

/** What the ellipse claims: the error stays below its longer half axis in 95 % of the steps. */
function claimOf(run) {
  if (!run.data.ellipses) return null;
  return Float32Array.from({ length: run.steps }, (_, k) => poseAt(run.data.ellipses, k)[0]);
}

function drawClaim(ctx, view, ts, claim, colours) {
  ctx.beginPath();
  ctx.moveTo(view.px(ts[0]), view.py(0));
  claim.forEach((c, k) => ctx.lineTo(view.px(ts[k]), view.py(Number.isNaN(c) ? 0 : c)));
  ctx.lineTo(view.px(ts[ts.length - 1]), view.py(0));
  ctx.fillStyle = colours.estimate;
  ctx.globalAlpha = 0.16;
  ctx.fill();
  ctx.globalAlpha = 1;
}

/** The plot under the map: errors over time, a mark at the step shown; a tap goes to its step. */
function errorView(run, { signal, step, on, colours, choose }) {
  const curves = errorsOf(run);
  if (!curves) return null;
  const claim = claimOf(run);
  const ts = run.times || Float32Array.from({ length: run.steps }, (_, k) => k + 1);
  const steady = Object.entries(curves).filter(([kind]) => kind !== "dead_reckoning" && kind !== "wrong");
  const shown = (steady.length ? steady.map(([, c]) => c) : Object.values(curves)).concat(claim ? [claim] : []);
  let top = 0;
  for (const curve of shown) for (const v of curve) if (v > top) top = v;
  const view = new View([ts[0], Math.max(ts[run.steps - 1], ts[0] + 1e-6), 0, 1.1 * top || 1], {
    equal: false, signal, bottom: 34,
    label: "Distance from the truth in metres over time; shaded: what the 95 % ellipse claims. A tap goes to that moment.",
    draw: (ctx) => {
      view.clear(ctx, colours());
      view.axes(ctx, colours(), { xLabel: run.times ? "t (s)" : "step", yLabel: "error (m)" });
      view.clip(ctx);
      if (claim && on.ellipses) drawClaim(ctx, view, ts, claim, colours());
      for (const [kind, errors] of Object.entries(curves)) {
        if (on[kind]) drawCurve(ctx, view, ts, errors, kind, false, colours());
      }
      const x = Math.round(view.px(ts[step()])) + 0.5;
      ctx.setLineDash([]);
      ctx.lineWidth = 1;
      ctx.strokeStyle = colours().ink;
      ctx.beginPath();
      ctx.moveTo(x, view.plot.y);
      ctx.lineTo(x, view.plot.y + view.plot.h);
      ctx.stroke();
      ctx.restore();
      view.frame(ctx, colours());
    },
  });
  view.canvas.className = "slam-errors";
  let pressed = NaN;
  view.canvas.addEventListener("pointerdown", (e) => { pressed = e.clientX; }, { signal });
  view.canvas.addEventListener("click", (e) => {
    if (!view.plot || Math.abs(e.clientX - pressed) > 4) return;  // a drag is no tap
    const t = (e.clientX - view.canvas.getBoundingClientRect().left - view.ox) / view.sx;
    let best = 0;
    ts.forEach((at, k) => { if (Math.abs(at - t) < Math.abs(ts[best] - t)) best = k; });
    choose(best);
  }, { signal });
  return view;
}

// ---- words ------------------------------------------------------------------------------------

const metres = (v) => `${v.toFixed(v >= 100 ? 1 : 2)} m`;

/** As many decimals as the steps of the clock need, so that the text keeps its width. */
function clockDigits({ times, steps }) {
  const tick = (times[steps - 1] - times[0]) / Math.max(steps - 1, 1);
  return tick > 0.999 || tick === 0 ? 0 : tick > 0.0999 ? 1 : 2;
}

/** What is known at this step, in numbers with units. */
function facts(run, step) {
  const { data } = run;
  const parts = [`step ${step + 1} of ${run.steps}`];
  if (run.times) parts.unshift(`t = ${run.times[step].toFixed(clockDigits(run))} s`);
  const names = { estimate: "estimate", dead_reckoning: "dead reckoning", wrong: "wrong variant" };
  const truth = data.truth && poseAt(data.truth, step);
  for (const [kind, name] of Object.entries(names)) {
    if (!data[kind] || !truth) continue;
    const [x, y] = poseAt(data[kind], step);
    parts.push(`${name} off by ${metres(Math.hypot(x - truth[0], y - truth[1]))}`);
  }
  if (data.ellipses) {
    // packed into 16 bits, a zero may come back a little below
    const [a, b] = poseAt(data.ellipses, step).map((axis) => Math.max(axis, 0));
    const flat = b <= 1e-6 && a > 1e-6; // a world of one dimension
    parts.push(flat ? `95 % interval ± ${metres(a)}` : `95 % ellipse ± ${metres(a)} by ± ${metres(b)}`);
  }
  return parts.join(" · ");
}

function describe(run) {
  const shown = LAYERS.filter(([name]) => hasLayer(run, name)).map(([, label]) => label);
  return `${run.title || "Replay"}. Map in metres with ${shown.join(", ")}. The text below tells the current step.`;
}

// ---- the figure ---------------------------------------------------------------------------------

function buildControls(run, player, go) {
  const play = playButton(player);
  const button = (image, label, key, by) => h("button", {
    class: "slam-button", type: "button", "aria-label": label, title: `${label} (${key})`, html: image,
    onclick: () => { player.pause(); go((s) => s + by); },
  });
  const slider = rangeInput(run.steps - 1, "Step", (v) => { player.pause(); go(() => v); });
  const speed = h("select", {
    class: "slam-speed", "aria-label": "Speed", title: "Speed",
    onchange: () => { player.rate = run.fps * Number(speed.value); },
  }, ...[0.25, 0.5, 1, 2, 4].map((f) => h("option", { value: f }, `${f}×`)));
  speed.value = "1";
  player.rate = run.fps;
  const row = h("div", { class: "slam-controls" }, button(ICONS.back, "Step back", "left arrow", -1), play,
    button(ICONS.forward, "Step forward", "right arrow", 1), slider, speed);
  return { row, play, slider };
}

/** What a key does to the step: space plays, arrows, Page, Home and End move (Shift: by ten). */
function keysOf(player, go, last) {
  const jumps = {
    ArrowRight: (s) => s + 1, ArrowUp: (s) => s + 1, ArrowLeft: (s) => s - 1, ArrowDown: (s) => s - 1,
    PageUp: (s) => s + 10, PageDown: (s) => s - 10, Home: () => 0, End: () => last,
  };
  return (e) => {
    if (e.key === " ") player.toggle();
    else if (jumps[e.key]) {
      player.pause();
      const reach = e.shiftKey ? 10 : 1;
      go((s) => (reach > 1 && e.key.startsWith("Arrow") ? s + reach * (jumps[e.key](s) - s) : jumps[e.key](s)));
    } else return false;
    return true;
  };
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const run = readRun(model.get("payload"));
  const last = run.steps - 1;
  const on = {};
  const trace = new Trace();
  let step = Math.min(Math.max(model.get("step") || 0, 0), last);
  let colours = LIGHT;
  let told = step;

  const root = card(el, run, "replay");
  const view = new View(run.bounds, {
    label: describe(run), signal, draw: (ctx) => drawRun(ctx, view, run, step, on, colours, trace),
  });
  const errors = errorView(run, {
    signal, step: () => step, on, colours: () => colours, choose: (k) => { player.pause(); go(() => k); },
  });
  const views = errors ? [view, errors] : [view];
  const facts_ = h("span", { class: "slam-facts" });
  const caption = h("span", { class: "slam-caption" });
  const line = spokenLine(facts_, caption);
  const refresh = () => {
    facts_.textContent = facts(run, step);
    caption.textContent = run.captions ? run.captions[step] : "";
    controls.slider.put(step, `${facts(run, step).split(" · ").slice(0, 2).join(", ")}`);
    view.canvas.dataset.step = step;
    for (const each of views) each.redraw();
  };
  const report = () => {
    if (told === step) return;
    told = step;
    tell(model, "step", step);
  };
  const go = (next) => {
    step = Math.min(Math.max(next(step), 0), last);
    refresh();
    if (!player.playing) report();
  };
  const player = new Player(
    (n) => { go((s) => s + n); return step < last; },
    (playing) => {
      if (playing && step === last) go(() => 0);
      controls.play.mark(playing);
      line.setAttribute("aria-live", playing ? "off" : "polite");
      report();
    },
    signal,
  );
  const controls = buildControls(run, player, go);
  const layers = layerChips(LAYERS.filter(([name]) => hasLayer(run, name)), on, () => {
    for (const each of views) each.redraw();
  });
  const help = h("div", { class: "slam-help" }, "Space plays, arrows step, Ctrl and wheel zoom, drag moves, double click resets.");
  root.append(...views.map((each) => each.node), controls.row, layers.row, line, help);

  keyboard(root, keysOf(player, go, last), signal);
  refresh();
  return live({
    root, views, model, stop, samples: layers.samples, event: "change:step",
    paint: (chosen) => { colours = chosen; },
    moved: () => {
      if (model.get("step") !== step && !player.playing) { told = model.get("step"); go(() => told); }
    },
    fit: () => {
      const width = Math.floor(view.node.clientWidth);
      if (width <= 0) return;
      view.resize(width, Math.round(Math.min(run.height, Math.max(0.85 * width, 240))));
      if (errors) errors.resize(width, 130);
    },
  });
}

export default { render };
