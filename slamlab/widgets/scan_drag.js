// ScanDrag: one scan lies on another; the reader drags and turns it, and ICP answers, a step at a
// time. Needs shared.js and drag.js in front.

// ---- the algorithm (matching.match_icp, without its covariance) -----------------------------------

/** Row of the nearest reference point within the gate, -1 if there is none. */
function nearestOf(reference, x, y, gate) {
  let [best, least] = [-1, gate * gate];
  reference.forEach(([qx, qy], j) => {
    const d = (qx - x) ** 2 + (qy - y) ** 2;
    if (d < least) [best, least] = [j, d];
  });
  return best;
}

/** Solve a system of three equations by Cramer's rule; null if it has no single answer. */
function solve3by3(A, b) {
  const det = (M) => M[0][0] * (M[1][1] * M[2][2] - M[1][2] * M[2][1])
    - M[0][1] * (M[1][0] * M[2][2] - M[1][2] * M[2][0]) + M[0][2] * (M[1][0] * M[2][1] - M[1][1] * M[2][0]);
  const whole = det(A);
  if (!(Math.abs(whole) > 1e-300)) return null;
  return [0, 1, 2].map((k) => det(A.map((row, i) => row.map((a, j) => (j === k ? b[i] : a)))) / whole);
}

/** One round: pair every point with the nearest, then one weighted least-squares step. */
function icpStep({ reference, normals, points }, pose, { gate, width, line }) {
  const H = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  const g = [0, 0, 0];
  const pairs = [];
  const [c, s] = [Math.cos(pose[2]), Math.sin(pose[2])];
  for (const [x, y] of points) {
    const [px, py] = [c * x - s * y, s * x + c * y];
    const j = nearestOf(reference, px + pose[0], py + pose[1], gate);
    if (j < 0) continue;
    const [dx, dy] = [px + pose[0] - reference[j][0], py + pose[1] - reference[j][1]];
    const [nx, ny] = normals[j];
    const rows = line ? [[nx * dx + ny * dy, [nx, ny, ny * px - nx * py]]] : [[dx, [1, 0, -py]], [dy, [0, 1, px]]];
    const e2 = rows.reduce((sum, [e]) => sum + e * e, 0);
    const w = (width ** 2 / (width ** 2 + e2)) ** 2;
    for (const [e, J] of rows) {
      for (let a = 0; a < 3; a++) {
        g[a] -= w * J[a] * e;
        for (let b = 0; b < 3; b++) H[a][b] += w * J[a] * J[b];
      }
    }
    pairs.push([px + pose[0], py + pose[1], j]);
  }
  const little = 1e-9 * (H[0][0] + H[1][1]);
  for (let a = 0; a < 3; a++) H[a][a] += little;
  const step = pairs.length >= 3 ? solve3by3(H, g) : null;
  return { pairs, pose: step ? pose.map((p, k) => p + step[k]) : pose, size: step ? Math.abs(step[0]) + Math.abs(step[1]) + Math.abs(step[2]) : 0 };
}

// ---- the figure ---------------------------------------------------------------------------------

function moved([x, y], pose) {
  const [c, s] = [Math.cos(pose[2]), Math.sin(pose[2])];
  return [c * x - s * y + pose[0], s * x + c * y + pose[1]];
}

function drawScans(ctx, view, scans, state, colours, handles) {
  view.clear(ctx, colours);
  view.axes(ctx, colours);
  view.clip(ctx);
  const spot = ([x, y]) => [view.px(x), view.py(y)];
  ctx.strokeStyle = colours.wrong;
  ctx.lineWidth = 1;
  ctx.setLineDash([]);
  ctx.beginPath();
  for (const [x, y, j] of state.round.pairs) {
    ctx.moveTo(...spot([x, y]));
    ctx.lineTo(...spot(scans.reference[j]));
  }
  ctx.stroke();
  drawMarkers(ctx, colours, "lidar", "dot", scans.reference.map(spot), 3);
  drawMarkers(ctx, colours, "estimate", "cross", scans.points.map((p) => spot(moved(p, state.pose))), 3);
  const [x, y] = spot(state.pose);
  ctx.strokeStyle = colours.estimate;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.arc(x, y, 9, 0, 7);
  ctx.moveTo(x, y);
  ctx.lineTo(x + 16 * Math.cos(state.pose[2]), y - 16 * Math.sin(state.pose[2]));
  ctx.stroke();
  handles.draw(ctx, colours);
  ctx.restore();
  view.frame(ctx, colours);
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const payload = model.get("payload");
  const [reference, normals, points] = [payload.reference, payload.normals, payload.points].map(rowsOf);
  const scans = { reference, normals, points };
  const settings = { gate: payload.gates[payload.gate], width: payload.width, line: true };
  const state = { pose: [...payload.start], rounds: 0 };
  let colours = LIGHT;
  const root = card(el, payload, "scandrag");
  const view = new View(payload.bounds, {
    signal, draw: (ctx) => drawScans(ctx, view, scans, state, colours, handles),
    label: "Two scans in metres: dots stay, crosses move with the robot; thin lines join each cross with the nearest "
      + "dot. Arrow keys move the scan, Q and E turn it.",
  });
  const line = spokenLine();
  const refresh = () => {
    state.round = icpStep(scans, state.pose, settings);
    const off = [0, 1].map((k) => state.pose[k] - payload.truth[k]);
    const turn = (wrap(state.pose[2] - payload.truth[2]) * 180) / Math.PI;
    line.textContent = `${state.rounds} rounds · off by ${show(Math.hypot(...off))} m and ${show(turn)}° · ${state.round.pairs.length} of ${scans.points.length} points have a partner`;
    root.dataset.state = JSON.stringify({ pose: state.pose, rounds: state.rounds });
    view.redraw();
  };
  const put = (pose) => { player.pause(); state.pose = pose; state.rounds = 0; };
  const advance = () => {
    const { pose, size } = icpStep(scans, state.pose, settings);
    state.pose = pose;
    state.rounds += 1;
    refresh();
    return size > 1e-6 && state.rounds < 60;
  };
  const player = new Player(advance, (playing) => { play.mark(playing); line.setAttribute("aria-live", playing ? "off" : "polite"); }, signal);
  player.rate = 5;
  const play = playButton(player);
  const handles = new Handles(view, [{
    name: "scan", kind: "estimate", marker: "cross", at: () => state.pose,
    move: (x, y) => put([x, y, state.pose[2]]), turn: (angle) => put([state.pose[0], state.pose[1], wrap(state.pose[2] + angle)]),
  }], () => refresh(), signal);
  const word = (text, act) => h("button", { class: "slam-chip", type: "button", onclick: act }, text);
  const turned = (angle) => () => { handles.items[0].turn((angle * Math.PI) / 180); refresh(); };
  const metric = word("point to line", () => {
    settings.line = !settings.line;
    metric.textContent = settings.line ? "point to line" : "point to point";
    put(state.pose);
    refresh();
  });
  const controls = h("div", { class: "slam-chips" }, play, word("one round", () => { player.pause(); advance(); }),
    word("turn left", turned(5)), word("turn right", turned(-5)), metric,
    word("start again", () => { put([...payload.start]); refresh(); }));
  const slider = knob("gate (m)", payload.gates, payload.gate, (gate) => { settings.gate = gate; put(state.pose); refresh(); });
  root.append(view.node, controls, h("div", { class: "slam-sliders" }, slider), line,
    h("div", { class: "slam-help" }, "Drag the robot and its scan moves along; Q and E turn it by 2°, arrow keys move it, space plays."));
  keyboard(root, (e) => {
    if (e.target.type === "range") return false;
    if (e.key !== " ") return handles.key(e, 0.05);
    player.toggle();
    return true;
  }, signal);
  refresh();
  return liveHandles(handles, { root, model, stop, paint: (chosen) => { colours = chosen; } });
}

export { icpStep };
export default { render };
