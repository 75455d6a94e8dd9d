// Sighting: a blind drive, then one landmark; the reader drags robot and landmark, and the extended
// filter answers beside the belief that it approximates. Needs shared.js and drag.js in front.

// ---- small matrices -----------------------------------------------------------------------------

const times = (A, B) => A.map((row) => B[0].map((_, j) => row.reduce((sum, a, k) => sum + a * B[k][j], 0)));
const flipped = (A) => A[0].map((_, j) => A.map((row) => row[j]));
const plus = (A, B, sign = 1) => A.map((row, i) => row.map((a, j) => a + sign * B[i][j]));
const diagonal = (values) => values.map((v, i) => values.map((_, j) => (i === j ? v : 0)));
const inverse2 = ([[a, b], [c, d]]) => {
  const det = a * d - b * c;
  return [[d / det, -b / det], [-c / det, a / det]];
};

// ---- the filter ---------------------------------------------------------------------------------

/** Range and bearing of a landmark. */
function observe([x, y, theta], [lx, ly]) {
  return [Math.hypot(lx - x, ly - y), wrap(Math.atan2(ly - y, lx - x) - theta)];
}

/** Predict over a straight blind drive of `way` metres from the origin, heading 0. */
function predictStraight(spread, way) {
  const F = [[1, 0, 0], [0, 1, way], [0, 0, 1]];
  return { mean: [way, 0, 0], cov: times(times(F, diagonal(spread.map((s) => s * s))), flipped(F)) };
}

/** One update of the extended filter, P5 (11), (13), (6)-(9). */
function updateBelief({ mean, cov }, z, landmark, sigmas) {
  const [dx, dy] = [landmark[0] - mean[0], landmark[1] - mean[1]];
  const r = Math.hypot(dx, dy);
  const H = [[-dx / r, -dy / r, 0], [dy / (r * r), -dx / (r * r), -1]];
  const due = observe(mean, landmark);
  const y = [[z[0] - due[0]], [wrap(z[1] - due[1])]];
  const S = plus(times(times(H, cov), flipped(H)), diagonal(sigmas.map((s) => s * s)));
  const K = times(times(cov, flipped(H)), inverse2(S));
  const step = times(K, y);
  return {
    mean: mean.map((m, i) => m + step[i][0]),
    cov: plus(cov, times(times(K, S), flipped(K)), -1),
    nis: times(times(flipped(y), inverse2(S)), y)[0][0],
  };
}

/** Weights of sampled robots after the sighting, largest 1, and their mean place. */
function weigh(cloud, z, landmark, sigmas) {
  const logs = cloud.map((pose) => {
    const due = observe(pose, landmark);
    return -0.5 * (((z[0] - due[0]) / sigmas[0]) ** 2 + (wrap(z[1] - due[1]) / sigmas[1]) ** 2);
  });
  const top = logs.reduce((a, b) => Math.max(a, b), -Infinity);
  const weights = logs.map((l) => Math.exp(l - top));
  const sum = weights.reduce((a, b) => a + b, 0);
  const mean = [0, 1].map((i) => cloud.reduce((m, pose, k) => m + weights[k] * pose[i], 0) / sum);
  return { weights, mean };
}

/** Robots that agree with the start, each after its own straight drive. */
function driven(normals, spread, way) {
  return normals.map(([a, b, c]) => {
    const theta = spread[2] * c;
    return [spread[0] * a + way * Math.cos(theta), spread[1] * b + way * Math.sin(theta), theta];
  });
}

/** Half axes and angle of the 95 % ellipse of a covariance, x and y. */
function ellipseOf([[a, b], [, d]]) {
  const [half, root] = [(a + d) / 2, Math.hypot((a - d) / 2, b)];
  const axis = (v) => Math.sqrt(5.991464547107979 * Math.max(v, 0));
  return [axis(half + root), axis(half - root), 0.5 * Math.atan2(2 * b, a - d)];
}

// ---- the figure ---------------------------------------------------------------------------------

function drawEllipse(ctx, view, belief, colours, kind, dashed) {
  const [a, b, angle] = ellipseOf(belief.cov);
  ctx.beginPath();
  ctx.ellipse(view.px(belief.mean[0]), view.py(belief.mean[1]), Math.max(a * view.sx, 1), Math.max(b * view.sx, 1), -angle, 0, 7);
  ctx.strokeStyle = ctx.fillStyle = colours[kind];
  ctx.setLineDash(dashed ? [6, 4] : []);
  ctx.lineWidth = 1.6;
  ctx.globalAlpha = dashed ? 0 : 0.2;
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.stroke();
}

function drawSighting(ctx, view, state, colours, handles) {
  view.clear(ctx, colours);
  view.axes(ctx, colours);
  view.clip(ctx);
  ctx.fillStyle = colours.particle;
  state.cloud.forEach(([x, y], k) => {
    const share = state.seen.weights[k];
    ctx.globalAlpha = k % 4 ? 0 : 0.12;
    if (share > 0.01) ctx.globalAlpha = 0.25 + 0.75 * share;
    if (ctx.globalAlpha > 0) ctx.fillRect(view.px(x) - 1.5, view.py(y) - 1.5, 3, 3);
  });
  ctx.globalAlpha = 1;
  drawEllipse(ctx, view, state.prior, colours, "dead_reckoning", true);
  drawEllipse(ctx, view, state.posterior, colours, "estimate", false);
  ctx.strokeStyle = colours.lidar;
  ctx.lineWidth = 1;
  ctx.setLineDash([2, 3]);
  ctx.beginPath();
  ctx.moveTo(view.px(state.robot[0]), view.py(state.robot[1]));
  ctx.lineTo(view.px(state.landmark[0]), view.py(state.landmark[1]));
  ctx.stroke();
  const spot = ([x, y]) => [[view.px(x), view.py(y)]];
  drawMarkers(ctx, colours, "landmark", "star", spot(state.landmark), 9);
  drawMarkers(ctx, colours, "estimate", "cross", spot(state.posterior.mean), 7);
  drawMarkers(ctx, colours, "truth", "circle", spot(state.robot), 9);
  handles.draw(ctx, colours);
  ctx.restore();
  view.frame(ctx, colours);
}

function solve(state, { normals, way, sigmas }) {
  state.prior = predictStraight(state.spread, way);
  state.cloud = driven(normals, state.spread, way);
  // the robot drove straight from the start, so where it stands says where it faces
  const truth = [...state.robot, Math.atan2(state.robot[1], state.robot[0])];
  const z = observe(truth, state.landmark);
  state.posterior = updateBelief(state.prior, z, state.landmark, sigmas);
  state.seen = weigh(state.cloud, z, state.landmark, sigmas);
}

function wordsOf(state) {
  const off = (p) => show(Math.hypot(p[0] - state.robot[0], p[1] - state.robot[1]));
  const [a] = ellipseOf(state.posterior.cov);
  return `filter off by ${off(state.posterior.mean)} m, its ellipse claims ${show(a)} m · mean of the likely robots off by `
    + `${off(state.seen.mean)} m · NIS ${show(state.posterior.nis)} (2 is due)`;
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const payload = model.get("payload");
  const settings = { ...payload, normals: rowsOf(payload.normals) };
  const state = { robot: [...payload.robot], landmark: [...payload.landmark], spread: [...payload.spread] };
  let colours = LIGHT;
  const root = card(el, payload, "sighting");
  const view = new View(payload.bounds, {
    signal, draw: (ctx) => drawSighting(ctx, view, state, colours, handles),
    label: "Map in metres: possible robots after a blind drive, the ellipse of the extended filter before and after "
      + "one sighting. Arrow keys move what is chosen below.",
  });
  const line = spokenLine();
  const refresh = () => {
    solve(state, settings);
    line.textContent = wordsOf(state);
    root.dataset.state = JSON.stringify({ robot: state.robot, landmark: state.landmark, ...state.posterior });
    view.redraw();
  };
  const handles = new Handles(view, [
    { name: "robot", kind: "truth", marker: "circle", at: () => state.robot, move: (x, y) => { state.robot = [x, y]; } },
    { name: "landmark", kind: "landmark", marker: "star", at: () => state.landmark, move: (x, y) => { state.landmark = [x, y]; } },
  ], refresh, signal);
  const start = payload.headings.findIndex((d) => Math.abs((d * Math.PI) / 180 - payload.spread[2]) < 1e-9);
  const slider = knob("doubt about the heading (degrees)", payload.headings, start, (degrees) => {
    state.spread[2] = (degrees * Math.PI) / 180;
    refresh();
  });
  root.append(view.node, h("div", { class: "slam-sliders" }, slider), handles.row, line,
    h("div", { class: "slam-help" }, "Drag the robot or the star, or choose one and use the arrow keys. Dots: robots that agree with "
      + "the start; dark ones agree with the sighting too. Dashed: the filter before, filled: after."));
  keyboard(root, (e) => e.target.type !== "range" && handles.key(e, 0.1), signal);
  refresh();
  return liveHandles(handles, { root, model, stop, paint: (chosen) => { colours = chosen; } });
}

export { observe, predictStraight, updateBelief, weigh, ellipseOf };
export default { render };
