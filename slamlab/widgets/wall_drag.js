// WallDrag: a wall before a lidar; the reader drags its ends, and the fitted line answers with what
// it claims, beside the lines of other scans of the same wall. Needs shared.js and drag.js in front.

/** End points of the beams that meet the wall, each range wrong by `sigma` times its number. */
function pointsOn([[ax, ay], [bx, by]], beams, sigma, numbers) {
  const [dx, dy] = [bx - ax, by - ay];
  return beams.flatMap((angle, i) => {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    const det = c * dy - s * dx;
    const range = (ax * dy - ay * dx) / det;
    const along = (ax * s - ay * c) / det;
    if (!(range > 0 && along >= 0 && along <= 1)) return [];
    const measured = range + sigma * numbers[i];
    return [[measured * c, measured * s]];
  });
}

/** Total least squares, as `mapping.fit_line`: [r, alpha] with r >= 0. */
function fitLine(points) {
  const k = points.length;
  const [mx, my] = [0, 1].map((j) => points.reduce((sum, p) => sum + p[j], 0) / k);
  let [skew, spread] = [0, 0];
  for (const [x, y] of points) {
    skew += (x - mx) * (y - my);
    spread += (y - my) ** 2 - (x - mx) ** 2;
  }
  const alpha = 0.5 * Math.atan2(-2 * skew, spread);
  const r = mx * Math.cos(alpha) + my * Math.sin(alpha);
  return r < 0 ? [-r, alpha > 0 ? alpha - Math.PI : alpha + Math.PI] : [r, alpha];
}

/** Covariance of [r, alpha], as `mapping.line_cov` of points whose ranges are wrong by sigma. */
function lineCov(points, alpha, sigma) {
  const [c, s] = [Math.cos(alpha), Math.sin(alpha)];
  const along = points.map(([x, y]) => y * c - x * s);
  const middle = along.reduce((a, b) => a + b, 0) / along.length;
  const S = along.reduce((sum, t) => sum + (t - middle) ** 2, 0);
  let [rr, ra, aa] = [0, 0, 0];
  points.forEach(([x, y], i) => {
    // variance across the wall of a point that errs along its beam
    const across = (sigma * (x * c + y * s) / Math.hypot(x, y)) ** 2;
    const a = -(along[i] - middle) / S;
    const r = 1 / points.length + middle * a;
    rr += r * r * across;
    ra += r * a * across;
    aa += a * a * across;
  });
  return [[rr, ra], [ra, aa]];
}

/** What a line errs by, (r, alpha): a wall has two names, the nearer one counts. */
function lineError([r, alpha], [dueR, dueAlpha]) {
  const turned = wrap(alpha - dueAlpha);
  return Math.abs(turned) <= Math.PI / 2 ? [r - dueR, turned] : [-r - dueR, wrap(turned + Math.PI)];
}

/** Where a line through all of the view begins and ends. */
const acrossView = ([r, alpha], t) => [r * Math.cos(alpha) - t * Math.sin(alpha), r * Math.sin(alpha) + t * Math.cos(alpha)];

function drawWall(ctx, view, state, colours, handles) {
  view.clear(ctx, colours);
  view.axes(ctx, colours);
  view.clip(ctx);
  const path = (places) => {
    ctx.beginPath();
    places.forEach(([x, y], k) => (k ? ctx.lineTo(view.px(x), view.py(y)) : ctx.moveTo(view.px(x), view.py(y))));
  };
  const steps = Array.from({ length: 81 }, (_, k) => (k - 40) / 2);
  if (state.line) {
    const [[rr, ra], [, aa]] = state.cov;
    const edge = (sign) => steps.map((t) => {
      const half = 2 * Math.sqrt(Math.max(rr - 2 * t * ra + t * t * aa, 0));
      return acrossView([state.line[0] + sign * half, state.line[1]], t);
    });
    path([...edge(1), ...edge(-1).reverse()]);
    ctx.fillStyle = colours.estimate;
    ctx.globalAlpha = 0.18;
    ctx.fill();
    ctx.globalAlpha = 0.35;
    ctx.strokeStyle = colours.estimate;
    ctx.lineWidth = 0.8;
    for (const line of state.others) {
      path([acrossView(line, -20), acrossView(line, 20)]);
      ctx.stroke();
    }
    ctx.globalAlpha = 1;
    strokeStyle(ctx, colours, "estimate");
    path([acrossView(state.line, -20), acrossView(state.line, 20)]);
    ctx.stroke();
  }
  strokeStyle(ctx, colours, "wall");
  path(state.ends);
  ctx.stroke();
  const pixels = (places) => places.map(([x, y]) => [view.px(x), view.py(y)]);
  drawMarkers(ctx, colours, "lidar", "dot", pixels(state.points), 4);
  drawMarkers(ctx, colours, "truth", "circle", pixels([[0, 0]]), 7);
  drawMarkers(ctx, colours, "wall", "square", pixels(state.ends), 6);
  handles.draw(ctx, colours);
  ctx.restore();
  view.frame(ctx, colours);
}

function solveWall(state, { beams, scans }) {
  const clouds = scans.map((numbers) => pointsOn(state.ends, beams, state.sigma, numbers));
  [state.points] = clouds;
  state.line = null;
  if (state.points.length < 3) return;
  state.truth = fitLine(state.ends);
  const lines = clouds.map(fitLine);
  [state.line, ...state.others] = lines;
  state.cov = lineCov(state.points, state.line[1], state.sigma);
  state.error = lineError(state.line, state.truth);
  const off = lines.map((line) => lineError(line, state.truth)[1]);
  state.turned = Math.sqrt(off.reduce((sum, a) => sum + a * a, 0) / off.length);
}

function wordsOfWall(state) {
  if (!state.line) return "fewer than three beams meet the wall: no line";
  const degrees = (a) => show((a * 180) / Math.PI);
  const [[rr], [, aa]] = state.cov;
  return `${state.points.length} points · claimed σ: distance ${show(1000 * Math.sqrt(rr))} mm, direction ${degrees(Math.sqrt(aa))}° · `
    + `this scan errs by ${show(Math.abs(1000 * state.error[0]))} mm and ${degrees(Math.abs(state.error[1]))}°, `
    + `all ${state.others.length + 1} by ${degrees(state.turned)}° (RMS)`;
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const payload = model.get("payload");
  const settings = { beams: payload.beams, scans: rowsOf(payload.scans) };
  const state = { ends: payload.ends.map((p) => [...p]), sigma: payload.sigmas[payload.sigma] };
  let colours = LIGHT;
  const root = card(el, payload, "walldrag");
  const view = new View(payload.bounds, {
    signal, draw: (ctx) => drawWall(ctx, view, state, colours, handles),
    label: "Map in metres: a lidar at the origin, a wall, the points of one scan on it, the fitted line and the band that its "
      + "covariance claims, and the lines of other scans. Arrow keys move the end that is chosen below.",
  });
  const line = spokenLine();
  const refresh = () => {
    solveWall(state, settings);
    line.textContent = wordsOfWall(state);
    root.dataset.state = JSON.stringify({ ends: state.ends, sigma: state.sigma, points: state.points.length, line: state.line, cov: state.cov });
    view.redraw();
  };
  const end = (k, name) => ({ name, kind: "wall", marker: "square", at: () => state.ends[k], move: (x, y) => { state.ends[k] = [x, y]; } });
  const whole = {
    name: "whole wall", kind: "wall", marker: "square",
    at: () => [0, 1].map((j) => (state.ends[0][j] + state.ends[1][j]) / 2),
    move: (x, y) => {
      const [mx, my] = whole.at();
      state.ends = state.ends.map(([ex, ey]) => [ex + x - mx, ey + y - my]);
    },
  };
  const handles = new Handles(view, [end(0, "one end"), end(1, "other end"), whole], refresh, signal);
  const slider = knob("noise of a range (m)", payload.sigmas, payload.sigma, (sigma) => {
    state.sigma = sigma;
    refresh();
  });
  root.append(view.node, h("div", { class: "slam-sliders" }, slider), handles.row, line,
    h("div", { class: "slam-help" }, "Drag an end of the wall or its middle, or choose one and use the arrow keys. Band: two sigma of "
      + "the fitted line, as its covariance claims; thin lines: other scans of the same wall."));
  keyboard(root, (e) => e.target.type !== "range" && handles.key(e, 0.1), signal);
  refresh();
  return liveHandles(handles, { root, model, stop, paint: (chosen) => { colours = chosen; } });
}

export { pointsOn, fitLine, lineCov, lineError };
export default { render };
