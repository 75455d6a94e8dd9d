// Simulator: P5's program. Drive a square robot with a lidar through a room of pixels, see what the
// beams measure, the map that grows from them, and where their signature says that the robot is.
// Needs shared.js in front of it. Beams and bodies are those of slamlab.worlds.BitmapWorld, in the
// same arithmetic; a test compares both.

const HARMONICS = 16;
const CANDIDATES = 32;
const STEP = 0.05;
const TURN = (5 * Math.PI) / 180;
const DEGREE = Math.PI / 180;
const TOUCH = 1e-9;
/** Two places whose scans fit equally well up to this (m a beam) cannot be told apart. */
const AMBIGUOUS = 0.02;

const wrap = (a) => Math.PI - ((((Math.PI - a) % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI));

// ---- the world ----------------------------------------------------------------------------------

/** A room of the payload, unpacked: cells, table of signatures, and the places of the table. */
function readRoom(room, sensor) {
  const solid = unpack(room.occupied).values;
  const places = [];
  for (let row = 0; row < room.rows; row += room.stride) {
    for (let column = 0; column < room.columns; column += room.stride) {
      if (solid[row * room.columns + column]) continue;
      places.push([
        room.origin[0] + (column + 0.5) * room.resolution, room.origin[1] + (row + 0.5) * room.resolution,
      ]);
    }
  }
  const size = [room.columns * room.resolution, room.rows * room.resolution];
  const bounds = [room.origin[0], room.origin[0] + size[0], room.origin[1], room.origin[1] + size[1]];
  const reach = Math.min(sensor.max_range ?? Infinity, Math.hypot(...size));
  return { ...room, solid, places, bounds, reach, spectra: unpack(room.spectra).values, scans: new Map() };
}

/** Is this cell occupied? There is nothing for beams beyond the bitmap. */
const isSolid = (room, row, column) =>
  row >= 0 && row < room.rows && column >= 0 && column < room.columns && room.solid[row * room.columns + column] > 0;

/** Distance (m) at which a beam meets an occupied cell: from grid line to grid line, exact.
 *  Through a corner it goes only if one of the two cells beside it is free. */
function castRay(room, x, y, angle, maxRange = Infinity) {
  const [dx, dy] = [Math.cos(angle), Math.sin(angle)];
  const [px, py] = [(x - room.origin[0]) / room.resolution, (y - room.origin[1]) / room.resolution];
  const [stepX, stepY] = [dx > 0 ? 1 : -1, dy > 0 ? 1 : -1];
  let [column, row] = [Math.floor(px), Math.floor(py)];
  const longest = maxRange / room.resolution;
  let t = 0;
  while (t <= longest) {
    if (row < 0 || row >= room.rows || column < 0 || column >= room.columns) return Infinity;
    if (isSolid(room, row, column)) return t * room.resolution;
    const tx = dx !== 0 ? (column + (dx > 0 ? 1 : 0) - px) / dx : Infinity;
    const ty = dy !== 0 ? (row + (dy > 0 ? 1 : 0) - py) / dy : Infinity;
    const corner = Math.abs(tx - ty) <= TOUCH;
    if (corner && isSolid(room, row, column + stepX) && isSolid(room, row + stepY, column)) {
      return tx <= longest ? tx * room.resolution : Infinity;
    }
    t = corner ? Math.max(tx, ty) : Math.min(tx, ty);
    if (tx < ty || corner) column += stepX;
    if (ty < tx || corner) row += stepY;
  }
  return Infinity;
}

/** All beams from a pose: beam i at 2 pi i / n to the left of straight ahead. */
function castScan(room, [x, y, theta], sensor) {
  const ranges = new Float64Array(sensor.n_beams);
  const turn = (2 * Math.PI) / sensor.n_beams;
  for (let i = 0; i < ranges.length; i++) ranges[i] = castRay(room, x, y, theta + i * turn, sensor.max_range ?? Infinity);
  return ranges;
}

/** Does a square of half side h overlap an occupied cell, or leave the bitmap? Separating axes. */
function overlaps(room, [x, y, theta], h) {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  const e = room.resolution / 2;
  const inner = h - TOUCH;
  const spread = Math.abs(c) + Math.abs(s);
  const low = (v, origin) => Math.floor((v - inner * spread - origin) / room.resolution);
  const high = (v, origin) => Math.floor((v + inner * spread - origin) / room.resolution);
  for (let row = low(y, room.origin[1]); row <= high(y, room.origin[1]); row++) {
    for (let column = low(x, room.origin[0]); column <= high(x, room.origin[0]); column++) {
      const inside = row >= 0 && row < room.rows && column >= 0 && column < room.columns;
      if (inside && !room.solid[row * room.columns + column]) continue;
      const dx = room.origin[0] + (column + 0.5) * room.resolution - x;
      const dy = room.origin[1] + (row + 0.5) * room.resolution - y;
      if (Math.abs(dx) >= inner * spread + e || Math.abs(dy) >= inner * spread + e) continue;
      if (Math.abs(dx * c + dy * s) >= inner + e * spread) continue;
      if (Math.abs(dy * c - dx * s) >= inner + e * spread) continue;
      return true;
    }
  }
  return false;
}

/** Turn and drive in small parts; stop before the first that touches. Returns [pose, whole way?]. */
function move(room, pose, distance, angle, h) {
  const parts = Math.max(Math.ceil(Math.abs(distance) / 0.005), Math.ceil(Math.abs(angle) / (0.5 * DEGREE)), 1);
  let here = pose;
  for (let k = 0; k < parts; k++) {
    const next = [
      here[0] + (distance / parts) * Math.cos(here[2]), here[1] + (distance / parts) * Math.sin(here[2]),
      wrap(here[2] + angle / parts),
    ];
    if (overlaps(room, next, h)) return [here, false];
    here = next;
  }
  return [here, true];
}

// ---- localization -------------------------------------------------------------------------------

/** Root of the power spectrum of a scan: what its autocorrelation holds. See chapter 19. */
function spectrumOf(ranges, reach) {
  const n = ranges.length;
  const out = new Float64Array(HARMONICS);
  for (let k = 0; k < HARMONICS; k++) {
    let [re, im] = [0, 0];
    for (let i = 0; i < n; i++) {
      const value = Math.min(ranges[i], reach);
      re += value * Math.cos((2 * Math.PI * k * i) / n);
      im += value * Math.sin((2 * Math.PI * k * i) / n);
    }
    out[k] = Math.hypot(re, im) * Math.sqrt((k === 0 ? 1 : 2) / n);
  }
  return out;
}

/** Heading in whole beams, and mean misfit (m, a beam counts 0.5 m at most), of a scan at a place.
 *  Headings within 30 degrees of `avoid` are left out. */
function alignAt(room, index, ranges, sensor, avoid = NaN) {
  const n = ranges.length;
  if (!room.scans.has(index)) room.scans.set(index, castScan(room, [...room.places[index], 0], sensor));
  const there = room.scans.get(index);
  let [best, shift] = [Infinity, 0];
  for (let k = 0; k < n; k++) {
    if (Math.abs(wrap((k * 2 * Math.PI) / n - avoid)) < 30 * DEGREE) continue;
    let sum = 0;
    for (let i = 0; i < n && sum < best * n; i++) {
      const gap = Math.abs(Math.min(ranges[i], room.reach) - Math.min(there[(i + k) % n], room.reach));
      sum += gap < 0.5 ? gap : 0.5;
    }
    if (sum / n < best) [best, shift] = [sum / n, k];
  }
  return { index, pose: [...room.places[index], wrap((shift * 2 * Math.PI) / n)], misfit: best };
}

/** Mean misfit (m) of a scan against what would be measured at a pose; a beam counts 0.5 m at most.
 *  Infinity as soon as it is worse than `limit`. */
function misfitAt(room, [x, y, theta], ranges, sensor, limit = Infinity) {
  const n = ranges.length;
  let sum = 0;
  for (let i = 0; i < n; i++) {
    const there = castRay(room, x, y, theta + (i * 2 * Math.PI) / n, room.reach);
    sum += Math.min(Math.abs(Math.min(ranges[i], room.reach) - Math.min(there, room.reach)), 0.5);
    if (sum >= limit * n) return Infinity;
  }
  return sum / n;
}

/** Move a pose of the table to where the scan fits best: smaller and smaller steps, no derivative,
 *  and no farther than three quarters of the table's pitch. */
function refine(room, found, ranges, sensor) {
  let [pose, misfit] = [found.pose, misfitAt(room, found.pose, ranges, sensor)];
  const pitch = room.stride * room.resolution;
  const beam = (2 * Math.PI) / sensor.n_beams;
  for (let size = 0.4; size > 0.02; size /= 2) {
    for (let better = true, rounds = 0; better && rounds < 3; rounds++) {
      better = false;
      for (const [k, step] of [[0, size * pitch], [1, size * pitch], [2, size * beam]]) {
        for (const sign of [1, -1]) {
          const next = pose.map((v, i) => (i === k ? v + sign * step : v));
          if (k < 2 && Math.abs(next[k] - found.pose[k]) > 0.75 * pitch) continue;
          const worth = misfitAt(room, next, ranges, sensor, misfit);
          if (worth < misfit) [pose, misfit, better] = [next, worth, true];
        }
      }
    }
  }
  return { pose: [pose[0], pose[1], wrap(pose[2])], misfit };
}

/** Where was this scan taken? The nearest signatures propose, the whole scans decide, and the best
 *  and the best elsewhere are refined before they are compared. */
function locate(room, ranges, sensor) {
  const wanted = spectrumOf(ranges, room.reach);
  const order = room.places.map((_, index) => {
    let sum = 0;
    for (let k = 0; k < HARMONICS; k++) sum += (room.spectra[index * HARMONICS + k] - wanted[k]) ** 2;
    return [sum, index];
  }).sort((a, b) => a[0] - b[0]);
  const found = order.slice(0, CANDIDATES).map(([, index]) => alignAt(room, index, ranges, sensor));
  found.sort((a, b) => a.misfit - b.misfit);
  const apart = (f, g) => Math.hypot(f.pose[0] - g.pose[0], f.pose[1] - g.pose[1]) > 0.5
    || Math.abs(wrap(f.pose[2] - g.pose[2])) > 30 * DEGREE;
  // The rival stands elsewhere, or at the same place and looks elsewhere.
  const turned = alignAt(room, found[0].index, ranges, sensor, found[0].pose[2]);
  const rivals = [found.find((f) => apart(f, found[0])), turned].filter(Boolean);
  rivals.sort((f, g) => f.misfit - g.misfit);
  const pair = [found[0], rivals[0]].map((f) => refine(room, f, ranges, sensor));
  pair.sort((f, g) => f.misfit - g.misfit);
  const [best, second] = pair;
  const margin = second.misfit - best.misfit;
  return { best, second, margin, ambiguous: margin < AMBIGUOUS };
}

// ---- drawing ------------------------------------------------------------------------------------

const SIM_LAYERS = [
  ["walls", "walls", "wall", "area"],
  ["map", "map", "lidar", "dot"],
  ["beams", "beams", "lidar", "line"],
  ["estimate", "estimate", "estimate", "line"],
];

function square(ctx, view, [x, y, theta], h, fill) {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  ctx.beginPath();
  for (const [a, b] of [[h, -h], [h, h], [-h, h], [-h, -h]]) ctx.lineTo(view.px(x + a * c - b * s), view.py(y + a * s + b * c));
  ctx.closePath();
  if (fill) ctx.fill();
  ctx.stroke();
  ctx.beginPath();
  ctx.moveTo(view.px(x), view.py(y));
  ctx.lineTo(view.px(x + h * c), view.py(y + h * s));
  ctx.stroke();
}

function ends(pose, ranges) {
  const points = [];
  for (let i = 0; i < ranges.length; i++) {
    if (!Number.isFinite(ranges[i])) continue;
    const a = pose[2] + (i * 2 * Math.PI) / ranges.length;
    points.push([pose[0] + ranges[i] * Math.cos(a), pose[1] + ranges[i] * Math.sin(a)]);
  }
  return points;
}

function drawFloor(ctx, view, sim, colours) {
  view.clear(ctx, colours);
  view.axes(ctx, colours);
  view.clip(ctx);
  const { room, on, half } = sim;
  if (on.walls) {
    const key = `${room.name} ${colours.paper}`;
    if (sim.pictureKey !== key) {
      const muted = { ...colours, ink: colours.frame };
      sim.picture = View.picture(room.solid, room.columns, room.rows, muted);
      sim.pictureKey = key;
    }
    view.drawPicture(ctx, sim.picture, room.bounds);
  }
  if (on.beams) {
    ctx.strokeStyle = colours.lidar;
    ctx.globalAlpha = 0.3;
    ctx.lineWidth = 1;
    ctx.beginPath();
    for (const [x, y] of ends(sim.pose, sim.ranges)) {
      ctx.moveTo(view.px(sim.pose[0]), view.py(sim.pose[1]));
      ctx.lineTo(view.px(x), view.py(y));
    }
    ctx.stroke();
    ctx.globalAlpha = 1;
  }
  if (on.map) {
    ctx.fillStyle = colours.lidar;
    const r = Math.max(1.2, 0.012 * view.sx);
    for (const [x, y] of sim.dots) ctx.fillRect(view.px(x) - r, view.py(y) - r, 2 * r, 2 * r);
  }
  ctx.setLineDash([]);
  ctx.lineWidth = 2;
  ctx.strokeStyle = colours.truth;
  ctx.fillStyle = colours.paper;
  square(ctx, view, sim.pose, half, true);
  if (on.estimate) {
    if (sim.found.ambiguous) {
      ctx.strokeStyle = colours.wrong;
      ctx.setLineDash([4, 3]);
      square(ctx, view, sim.found.second.pose, 0.75 * half, false);
    }
    ctx.strokeStyle = colours.estimate;
    ctx.setLineDash([]);
    ctx.lineWidth = 2.5;
    // A little smaller, so that the true robot shows around it.
    square(ctx, view, sim.estimate, 0.75 * half, false);
  }
  ctx.restore();
  view.frame(ctx, colours);
}

function curve(ctx, view, ranges, reach) {
  const n = ranges.length;
  ctx.beginPath();
  for (let k = 0; k <= n; k++) {
    const degrees = -180 + (360 * k) / n;
    const i = (((k - n / 2) % n) + n) % n;
    ctx.lineTo(view.px(degrees), view.py(Math.min(ranges[Math.round(i) % n], reach)));
  }
  ctx.stroke();
}

function drawChart(ctx, view, sim, colours) {
  view.clear(ctx, colours);
  view.axes(ctx, colours, { xLabel: "beam, degrees left of straight ahead", yLabel: "range (m)" });
  view.clip(ctx);
  if (sim.on.estimate) {
    ctx.strokeStyle = colours.estimate;
    ctx.lineWidth = 1.5;
    ctx.setLineDash([5, 4]);
    curve(ctx, view, castScan(sim.room, sim.estimate, sim.sensor), sim.room.reach);
  }
  ctx.strokeStyle = colours.lidar;
  ctx.lineWidth = 2;
  ctx.setLineDash([]);
  curve(ctx, view, sim.ranges, sim.room.reach);
  ctx.restore();
  view.frame(ctx, colours);
}

// ---- words --------------------------------------------------------------------------------------

const fixed = (v, digits) => v.toFixed(digits).replace("-", "−").replace(/^−(0(\.0+)?)$/, "$1");
const centimetres = (v) => (v < 0.01 ? "less than 1 cm" : v < 1 ? `${fixed(100 * v, 0)} cm` : `${fixed(v, 2)} m`);
const pointOf = ([x, y, theta]) => `x ${fixed(x, 2)} m, y ${fixed(y, 2)} m, heading ${fixed(theta / DEGREE, 0)}°`;

function saysWhere(sim) {
  const [x, y, theta] = sim.pose;
  const off = Math.hypot(sim.estimate[0] - x, sim.estimate[1] - y);
  const turn = Math.abs(wrap(sim.estimate[2] - theta)) / DEGREE;
  return `Robot at ${pointOf(sim.pose)} · estimate off by ${centimetres(off)} and ${fixed(turn, 0)}°`;
}

function saysHow(sim) {
  const parts = [sim.note];
  const { best, second, margin, ambiguous } = sim.found;
  const away = Math.hypot(second.pose[0] - best.pose[0], second.pose[1] - best.pose[1]);
  const turn = Math.abs(wrap(second.pose[2] - best.pose[2])) / DEGREE;
  const rival = `${centimetres(away)} away, turned by ${fixed(turn, 0)}°`;
  if (ambiguous) parts.push(`Ambiguous: a pose ${rival}, fits nearly as well`);
  else parts.push(`The next best pose, ${rival}, fits worse by ${fixed(100 * margin, 1)} cm a beam`);
  if (sim.library) parts.push(sim.library);
  return parts.filter(Boolean).join(" · ");
}

// ---- the figure ---------------------------------------------------------------------------------

const ARROWS = {
  left: icon('<path d="M8 5 3.5 9.5 8 14M4 9.5h9a6 6 0 0 1 6 6V19" fill="none" stroke="currentColor" stroke-width="2.4" stroke-linecap="round" stroke-linejoin="round"/>'),
  right: icon('<path d="M16 5l4.5 4.5L16 14M20 9.5h-9a6 6 0 0 0-6 6V19" fill="none" stroke="currentColor" stroke-width="2.4" stroke-linecap="round" stroke-linejoin="round"/>'),
  forward: icon('<path d="M12 4l7 9H5zM9.5 13h5v7h-5z" fill="currentColor"/>'),
  back: icon('<path d="M12 20l7-9H5zM9.5 4h5v7h-5z" fill="currentColor"/>'),
};

/** A free pose drawn by a small generator of its own: the same series on every machine. */
function somewhere(sim) {
  const next = () => {
    sim.seed = (Math.imul(sim.seed, 1664525) + 1013904223) >>> 0;
    return sim.seed / 4294967296;
  };
  const [x0, x1, y0, y1] = sim.room.bounds;
  for (let k = 0; k < 1000; k++) {
    const pose = [x0 + (x1 - x0) * next(), y0 + (y1 - y0) * next(), wrap(2 * Math.PI * next())];
    // Free for any heading: the robot must be able to turn where it is set down.
    if (!overlaps(sim.room, [pose[0], pose[1], 0], sim.half * Math.SQRT2)) return pose;
  }
  return sim.pose;
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const payload = model.get("payload");
  const sensor = payload.sensor;
  const rooms = payload.rooms.map((room) => readRoom(room, sensor));
  const sim = { sensor, half: payload.side / 2, on: {}, dots: [], seed: 1, asked: 0, note: "" };
  let colours = LIGHT;

  const root = card(el, payload, "simulator");
  const floor = new View(rooms[0].bounds, {
    label: `${payload.title || "Simulator"}. Plan of the room with robot, map and estimate. The text below tells the state.`,
    signal, draw: (ctx) => drawFloor(ctx, floor, sim, colours),
  });
  const chart = new View([-180, 180, 0, 1], {
    label: "Chart of the lidar: range over the direction of the beam.", equal: false, signal,
    draw: (ctx) => drawChart(ctx, chart, sim, colours),
  });
  const facts_ = h("span", { class: "slam-facts" });
  const caption = h("span", { class: "slam-caption" });
  const line = h("div", { class: "slam-text", "aria-live": "polite", "aria-atomic": "true" }, facts_, caption);

  const refresh = () => {
    facts_.textContent = saysWhere(sim);
    caption.textContent = saysHow(sim);
    root.dataset.pose = sim.pose.map((v) => v.toFixed(6)).join();
    root.dataset.estimate = sim.estimate.map((v) => v.toFixed(6)).join();
    root.dataset.ambiguous = String(sim.found.ambiguous);
    floor.redraw();
    chart.redraw();
  };
  const look = (note = "") => {
    sim.note = note;
    sim.library = "";
    sim.ranges = castScan(sim.room, sim.pose, sensor);
    sim.found = locate(sim.room, sim.ranges, sensor);
    sim.estimate = sim.found.best.pose;
    sim.dots.push(...ends(sim.pose, sim.ranges));
    if (sim.dots.length > 60000) sim.dots.splice(0, sim.dots.length - 60000);
    refresh();
    sim.asked += 1;
    tell(model, "ask", { id: sim.asked, room: rooms.indexOf(sim.room), pose: sim.pose });
  };
  const enter = (room) => {
    sim.room = room;
    sim.pose = room.start;
    sim.dots = [];
    floor.box = room.bounds;
    chart.box = [-180, 180, 0, room.reach];
    floor.reset();
    chart.reset();
    look();
  };
  const drive = (distance, angle) => {
    const [pose, whole] = move(sim.room, sim.pose, distance, angle, sim.half);
    sim.pose = pose;
    look(whole ? "" : "Blocked: the robot touches");
  };

  const moves = {
    ArrowUp: () => drive(STEP, 0), ArrowDown: () => drive(-STEP, 0),
    ArrowLeft: () => drive(0, TURN), ArrowRight: () => drive(0, -TURN),
    j: () => { sim.pose = somewhere(sim); look("Set down somewhere else"); },
    Home: () => enter(sim.room),
  };
  const button = (image, label, key, act) => h("button", {
    class: "slam-button", type: "button", "aria-label": label, title: `${label} (${key})`, html: image, onclick: act,
  });
  const word = (text, key, act) => h("button", { class: "slam-chip", type: "button", title: `${text} (${key})`, onclick: act }, text);
  const choice = h("select", { class: "slam-speed", "aria-label": "Room", title: "Room", onchange: () => enter(rooms[Number(choice.value)]) },
    ...rooms.map((room, k) => h("option", { value: k }, room.name)));
  const controls = h("div", { class: "slam-controls slam-drive", role: "group", "aria-label": "Drive" },
    button(ARROWS.left, "Turn left", "left arrow", moves.ArrowLeft),
    button(ARROWS.forward, "Drive forward", "up arrow", moves.ArrowUp),
    button(ARROWS.back, "Drive back", "down arrow", moves.ArrowDown),
    button(ARROWS.right, "Turn right", "right arrow", moves.ArrowRight),
    word("Set down elsewhere", "J", moves.j), word("Start again", "Home", moves.Home), rooms.length > 1 ? choice : null);
  const layers = layerChips(SIM_LAYERS, sim.on, () => refresh());
  const panel = (title, ...nodes) => h("div", { class: "slam-panel" }, h("div", { class: "slam-panel-title" }, title), ...nodes);
  root.append(
    h("div", { class: "slam-panels" }, panel("The room", floor.node, controls), panel("What the lidar measures", chart.node)),
    layers.row, line,
    h("div", { class: "slam-help" }, "Arrow keys drive and turn by 5 cm and 5°, J sets the robot down elsewhere, Home starts again, Ctrl and wheel zoom."),
  );

  keyboard(root, (e) => {
    const act = moves[e.key] || moves[e.key.toLowerCase()];
    if (act) act();
    return Boolean(act);
  }, signal);
  enter(rooms[0]);
  return live({
    root, views: [floor, chart], samples: layers.samples, model, stop, event: "change:answer",
    paint: (chosen) => { colours = chosen; },
    moved: () => {
      const answer = model.get("answer");
      if (!answer || answer.id !== sim.asked) return;
      let gap = 0;
      answer.ranges.forEach((r, i) => { if (r !== null) gap = Math.max(gap, Math.abs(r - sim.ranges[i])); });
      const off = Math.hypot(answer.pose[0] - sim.pose[0], answer.pose[1] - sim.pose[1]);
      sim.library = `Python: same beams to ${fixed(1000 * gap, 3)} mm; its finer map is off by ${centimetres(off)}${answer.ambiguous ? ", ambiguous" : ""}`;
      refresh();
    },
    fit: () => {
      for (const view of [floor, chart]) {
        const width = Math.floor(view.node.clientWidth);
        if (width <= 0) continue;
        const shape = view === floor ? (sim.room.bounds[3] - sim.room.bounds[2]) / (sim.room.bounds[1] - sim.room.bounds[0]) : 0.62;
        view.resize(width, Math.round(Math.min(Math.max(shape * width, 200), 460)));
      }
    },
  });
}

export { castRay, castScan, locate, overlaps, readRoom, spectrumOf };
export default { render };
