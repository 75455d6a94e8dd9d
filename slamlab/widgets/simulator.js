// Simulator: P5's program, and what mends it. Drive a square robot with a lidar through a room of
// pixels, or let it explore; see what the beams measure, the map that grows, where two estimators
// put the robot, and what P5's listings recover of its motions. Needs shared.js and
// simulator_world.js in front of it.

const SIM_LAYERS = [
  ["walls", "walls", "wall", "area"],
  ["map", "map", "lidar", "dot"],
  ["beams", "beams", "lidar", "line"],
  ["track", "track", "truth", "line"],
  ["estimate", "repaired estimate", "estimate", "line"],
  ["printed", "three numbers, as printed", "wrong", "diamond"],
];
const GUARDS = { swept: "the area that the body sweeps", printed: "CanMove, as printed", none: "nobody" };
const MAPS = { truth: "true pose, as P5 does", estimate: "repaired estimate", printed: "three numbers, as printed" };
const POINTERS = { place: "place and turn the robot", wall: "draw walls", rub: "rub walls out", view: "look around" };
const PEN = 0.06;
const WRONG = 0.1;
const LARGEST = 640;

// ---- drawing ------------------------------------------------------------------------------------

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

function drawFloor(ctx, view, sim, colours) {
  view.clear(ctx, colours);
  view.axes(ctx, colours);
  view.clip(ctx);
  const { room, on, half } = sim;
  if (on.walls) {
    if (sim.pictureOf !== room || sim.pictureIn !== colours.paper) {
      const muted = { ...colours, ink: colours.frame };
      sim.picture = View.picture(room.solid.map((v) => (v ? 252 : 0)), room.columns, room.rows, muted);
      [sim.pictureOf, sim.pictureIn] = [room, colours.paper];
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
  if (on.track) {
    strokeStyle(ctx, colours, "truth");
    ctx.beginPath();
    sim.log.forEach(({ pose }, k) => (k ? ctx.lineTo(view.px(pose[0]), view.py(pose[1])) : ctx.moveTo(view.px(pose[0]), view.py(pose[1]))));
    ctx.stroke();
  }
  ctx.setLineDash([]);
  ctx.lineWidth = 2;
  ctx.strokeStyle = colours.truth;
  ctx.fillStyle = colours.paper;
  square(ctx, view, sim.pose, half, true);
  if (on.printed && sim.three) drawMarkers(ctx, colours, "wrong", "diamond", [[view.px(sim.three[0]), view.py(sim.three[1])]], 9);
  if (on.estimate && sim.found) {
    if (sim.found.ambiguous) {
      ctx.strokeStyle = colours.estimate;
      ctx.setLineDash([4, 3]);
      square(ctx, view, sim.found.second.pose, 0.75 * half, false);
    }
    ctx.strokeStyle = colours.estimate;
    ctx.setLineDash([]);
    ctx.lineWidth = 2.5;
    // A little smaller, so that the true robot shows around it.
    square(ctx, view, sim.found.best.pose, 0.75 * half, false);
  }
  ctx.restore();
  view.frame(ctx, colours);
}

function curve(ctx, view, ranges, reach) {
  const n = ranges.length;
  const first = Math.ceil(-n / 2);
  let open = false;
  ctx.beginPath();
  for (let i = first; i <= first + n; i++) {
    const range = ranges[((i % n) + n) % n];
    const at = [view.px((360 * i) / n), view.py(Math.min(range, reach))];
    if (Number.isNaN(range)) open = false;
    else if (open) ctx.lineTo(...at);
    else { ctx.moveTo(...at); open = true; }
  }
  ctx.stroke();
}

function drawChart(ctx, view, sim, colours) {
  view.clear(ctx, colours);
  view.axes(ctx, colours, { xLabel: "beam, degrees left of straight ahead", yLabel: "range (m)" });
  view.clip(ctx);
  if (sim.on.estimate && sim.found) {
    ctx.strokeStyle = colours.estimate;
    ctx.lineWidth = 1.5;
    ctx.setLineDash([5, 4]);
    curve(ctx, view, castScan(sim.room, sim.found.best.pose, sim.sensor.n_beams), sim.room.reach);
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
  const where = `Robot at ${pointOf(sim.pose)}`;
  if (!sim.found) return `${where} · the beams tell nothing`;
  const turn = Math.abs(wrap(sim.found.best.pose[2] - sim.pose[2])) / DEGREE;
  return `${where} · estimate off by ${centimetres(apartOf(sim.found.best.pose, sim.pose))} and ${fixed(turn, 0)}°`
    + ` · three numbers off by ${centimetres(apartOf(sim.three, sim.pose))}`;
}

function saysHow(sim) {
  const parts = [sim.note];
  if (sim.found) {
    const { best, second, margin, ambiguous } = sim.found;
    const turn = Math.abs(wrap(second.pose[2] - best.pose[2])) / DEGREE;
    const rival = `${centimetres(apartOf(second.pose, best.pose))} away, turned by ${fixed(turn, 0)}°`;
    if (ambiguous) parts.push(`Ambiguous: a pose ${rival}, fits nearly as well`);
    else parts.push(`The next best pose, ${rival}, fits worse by ${fixed(100 * margin, 1)} cm a beam`);
  }
  if (sim.library) parts.push(sim.library);
  return parts.filter(Boolean).join(" · ");
}

/** What P5's stack holds of a motion, beside the truth and the repair. */
function saysMotion({ kind, size, printed, better, beam }) {
  if (kind === "m") {
    const [back, front] = printed.map((v) => (Number.isFinite(v) ? `${fixed(100 * v, 1)} cm` : "no number"));
    return ["drive", `${fixed(100 * size, 1)} cm`, `m: back ${back}, front ${front}`, ""];
  }
  return ["turn", `${fixed(size / DEGREE, 1)}°`, `t: ${fixed(printed, 0)}, times ${show(beam)}° = ${fixed(printed * beam, 0)}°`, `${fixed(better / DEGREE, 1)}°`];
}

// ---- the figure ---------------------------------------------------------------------------------

const ARROWS = {
  left: icon('<path d="M8 5 3.5 9.5 8 14M4 9.5h9a6 6 0 0 1 6 6V19" fill="none" stroke="currentColor" stroke-width="2.4" stroke-linecap="round" stroke-linejoin="round"/>'),
  right: icon('<path d="M16 5l4.5 4.5L16 14M20 9.5h-9a6 6 0 0 0-6 6V19" fill="none" stroke="currentColor" stroke-width="2.4" stroke-linecap="round" stroke-linejoin="round"/>'),
  forward: icon('<path d="M12 4l7 9H5zM9.5 13h5v7h-5z" fill="currentColor"/>'),
  back: icon('<path d="M12 20l7-9H5zM9.5 4h5v7h-5z" fill="currentColor"/>'),
};

/** A number field with label and unit; a value out of range goes to the nearest end. */
function field(label, unit, value, [low, high, step], changed) {
  const input = h("input", { class: "slam-field", type: "number", min: low, max: high, step, value, "aria-label": `${label} (${unit})` });
  input.addEventListener("change", () => {
    const given = Number(input.value);
    input.value = String(Number.isFinite(given) && input.value !== "" ? Math.min(Math.max(given, low), high) : value);
    changed(Number(input.value));
  });
  return h("label", { class: "slam-setting" }, `${label} `, input, ` ${unit}`);
}

function select(label, options, changed) {
  const node = h("select", { class: "slam-speed", "aria-label": label, title: label, onchange: () => changed(node.value) },
    ...Object.entries(options).map(([value, text]) => h("option", { value }, text)));
  return node;
}

/** The pixels of a picture file; null where the browser cannot read it. */
async function pixelsOf(file) {
  try {
    const bitmap = await createImageBitmap(file);
    const { width, height } = bitmap;
    if (Math.max(width, height) > LARGEST) return { width, height, data: null };
    const ctx = h("canvas", { width, height }).getContext("2d", { willReadFrequently: true });
    ctx.drawImage(bitmap, 0, 0);
    return { width, height, data: ctx.getImageData(0, 0, width, height).data };
  } catch (error) {
    console.debug("no picture", error);
    return null;
  }
}

function render({ model, el }) {
  const stop = new AbortController();
  const { signal } = stop;
  const payload = model.get("payload");
  const rooms = payload.rooms.map(readRoom);
  const random = generator(1);
  const sim = {
    sensor: { n_beams: payload.n_beams, sigma: 0, lost: 0 }, half: payload.side / 2, on: {}, asked: 0, note: "", library: "",
    step: 0.05, turn: 5 * DEGREE, mapAt: "truth", pointer: "place", guard: "swept", strategy: "quadrants", pilot: null, log: [], dots: [], stack: [],
  };
  let colours = LIGHT;

  const root = card(el, payload, "simulator");
  const floor = new View(rooms[0].bounds, {
    label: `${payload.title || "Simulator"}. Plan of the room with robot, map and estimates. The text below tells the state.`,
    signal, draw: (ctx) => drawFloor(ctx, floor, sim, colours),
  });
  const chart = new View([-180, 180, 0, 1], {
    label: "Chart of the lidar: range over the direction of the beam.", equal: false, signal,
    draw: (ctx) => drawChart(ctx, chart, sim, colours),
  });
  const facts_ = h("span", { class: "slam-facts" });
  const caption = h("span", { class: "slam-caption" });
  const line = spokenLine(facts_, caption);
  const tally = h("table", { class: "slam-numbers" });
  const stackRows = h("tbody", {});

  // ---- state ----

  const refresh = () => {
    facts_.textContent = saysWhere(sim);
    caption.textContent = saysHow(sim);
    const wrong = (name) => `${sim.log.filter((entry) => entry[name] > WRONG).length} of ${sim.log.length}`;
    const rows = [
      ["driven", `${fixed(sim.driven, 2)} m`], ["collisions", String(sim.collisions)], ["floor seen", `${fixed(100 * sim.seen.share, 0)} %`],
      ["positions more than 10 cm off, repaired", wrong("off")], ["the same, three numbers", wrong("offPrinted")],
    ];
    tally.replaceChildren(...rows.map(([name, value]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, value))));
    stackRows.replaceChildren(...sim.stack.slice(-8).reverse().map((motion) => h("tr", {}, ...saysMotion(motion).map((text) => h("td", {}, text)))));
    root.dataset.pose = sim.pose.map((v) => v.toFixed(6)).join();
    root.dataset.estimate = sim.found ? sim.found.best.pose.map((v) => v.toFixed(6)).join() : "";
    root.dataset.printed = sim.three ? sim.three.map((v) => v.toFixed(6)).join() : "";
    root.dataset.ambiguous = String(Boolean(sim.found && sim.found.ambiguous));
    root.dataset.log = String(sim.log.length);
    floor.redraw();
    chart.redraw();
  };
  /** Measure, find the place in two ways, draw the map; a motion is a further step of the log. */
  const look = (note = "", motion = null) => {
    Object.assign(sim, { note, library: "", ranges: measure(sim.room, sim.pose, sim.sensor, random), found: null, three: null });
    if (sim.ranges.some((r) => Number.isFinite(r)) && tableOf(sim.room, sim.sensor.n_beams).places.length) {
      sim.found = locate(sim.room, sim.ranges);
      sim.three = locateAsPrinted(sim.room, sim.ranges);
    }
    const heading = sim.found ? sim.found.best.pose[2] : sim.pose[2];
    const at = { truth: sim.pose, estimate: sim.found && sim.found.best.pose, printed: sim.three && [...sim.three, heading] }[sim.mapAt];
    if (at) sim.dots.push(...ends(at, sim.ranges));
    if (sim.dots.length > 60000) sim.dots.splice(0, sim.dots.length - 60000);
    sim.seen.insert(sim.pose, sim.ranges);
    const last = sim.log[sim.log.length - 1];
    const u = motion && last ? betweenPoses(last.pose, sim.pose) : [0, 0, 0];
    if (motion || !last) {
      const off = sim.found ? [apartOf(sim.found.best.pose, sim.pose), apartOf(sim.three, sim.pose)] : [Infinity, Infinity];
      sim.log.push({ time: last ? last.time + 1 : 0, u, pose: sim.pose, ranges: sim.ranges, off: off[0], offPrinted: off[1] });
    }
    if (motion && last) {
      const kind = motion[1] ? "t" : "m";
      const better = kind === "t" ? turnBetween(last.ranges, sim.ranges) : NaN;
      const printed = kind === "t" ? whatAngle(last.ranges, sim.ranges) : whatMove(last.ranges, sim.ranges);
      sim.driven += Math.hypot(u[0], u[1]);
      sim.stack.push({ kind, size: kind === "t" ? u[2] : u[0], printed, better, beam: 360 / sim.sensor.n_beams });
    }
    refresh();
    sim.asked += 1;
    const known = rooms.indexOf(sim.room);
    if (known >= 0 && known < payload.rooms.length && !sim.sensor.sigma && !sim.sensor.lost) {
      tell(model, "ask", { id: sim.asked, room: known, pose: sim.pose, n_beams: sim.sensor.n_beams });
    }
  };
  /** Begin a new log where the robot stands. */
  const begin = (note = "") => {
    Object.assign(sim, { log: [], dots: [], stack: [], driven: 0, collisions: 0, seen: new Floor(sim.room, sim.pose) });
    look(note);
  };
  const enter = (room, note = "") => {
    const pose = room.start || roomyPlace(room, sim.half);
    halt();
    if (!pose) {
      sim.note = `${room.name}: there is no place where the robot can turn`;
      refresh();
      return false;
    }
    Object.assign(sim, { room, pose });
    floor.box = room.bounds;
    chart.box = [-180, 180, 0, room.reach];
    floor.reset();
    chart.reset();
    begin(note);
    return true;
  };
  const drive = (distance, angle) => {
    const [pose, whole] = move(sim.room, sim.pose, distance, angle, sim.half);
    sim.pose = pose;
    if (!whole) sim.collisions += 1;
    look(whole ? "" : "Blocked: the robot touches", [distance, angle]);
    return whole;
  };
  const put = (pose, note) => {
    halt();
    if (overlaps(sim.room, pose, sim.half)) return false;
    sim.pose = [pose[0], pose[1], wrap(pose[2])];
    begin(note);
    return true;
  };

  // ---- autonomous motion ----

  let timer = 0;
  const halt = (note = "") => {
    clearTimeout(timer);
    timer = 0;
    sim.pilot = null;
    explore.textContent = "Explore";
    explore.setAttribute("aria-pressed", "false");
    line.setAttribute("aria-live", "polite");
    if (note) { sim.note = note; refresh(); }
  };
  const go = (hit) => {
    const motion = sim.pilot.command(sim.pose, sim.ranges, sim.room.reach, hit, sim.seen);
    if (!motion || sim.driven > 40) { halt(motion ? "40 m driven: enough" : "Nothing left to see"); return; }
    const whole = drive(...motion);
    timer = setTimeout(() => go(!whole), 60);
  };
  const explore = h("button", {
    class: "slam-chip", type: "button", "aria-pressed": "false", title: "Explore, or stop (E)",
    onclick: () => {
      if (sim.pilot) { halt("Stopped"); return; }
      sim.pilot = new Pilot(sim.half, STRATEGIES[sim.strategy], sim.guard, random);
      explore.textContent = "Stop";
      explore.setAttribute("aria-pressed", "true");
      line.setAttribute("aria-live", "off");
      go(false);
    },
  }, "Explore");

  // ---- controls ----

  const moves = {
    ArrowUp: () => drive(sim.step, 0), ArrowDown: () => drive(-sim.step, 0),
    ArrowLeft: () => drive(0, sim.turn), ArrowRight: () => drive(0, -sim.turn),
    j: () => put(somewhere(sim.room, sim.half, random) || sim.pose, "Set down somewhere else"),
    e: () => explore.click(), Home: () => enter(sim.room),
  };
  /** A button that repeats while it is held. */
  const hold = (image, label, key, act) => {
    let again = 0;
    const release = () => { clearInterval(again); again = 0; };
    const node = h("button", { class: "slam-button", type: "button", "aria-label": label, title: `${label} (${key}); hold to go on`, html: image });
    const on = (name, f) => node.addEventListener(name, f, { signal });
    on("pointerdown", (e) => {
      if (e.button !== 0) return;
      release();
      halt();
      act();
      again = setInterval(act, 120);
    });
    for (const name of ["pointerup", "pointerleave", "pointercancel", "blur"]) on(name, release);
    on("contextmenu", (e) => e.preventDefault());
    on("click", (e) => { if (e.detail === 0) act(); });
    signal.addEventListener("abort", release);
    return node;
  };
  const word = (text, key, act) => h("button", { class: "slam-chip", type: "button", title: key ? `${text} (${key})` : text, onclick: act }, text);
  const choice = select("Room", Object.fromEntries(rooms.map((room, k) => [k, room.name])), (value) => enter(rooms[Number(value)]));
  const add = (room) => {
    rooms.push(room);
    choice.append(h("option", { value: rooms.length - 1 }, room.name));
    choice.value = String(rooms.length - 1);
  };
  const picture = h("input", { type: "file", accept: "image/bmp,image/png,.bmp,.png", class: "slam-file", "aria-label": "Load a room from a BMP or PNG picture", onchange: async () => {
    const file = picture.files[0];
    const pixels = file ? await pixelsOf(file) : null;
    picture.value = "";
    if (!file) return;
    if (!pixels || !pixels.data) {
      sim.note = pixels ? `${file.name}: ${pixels.width} by ${pixels.height} pixels, expected ${LARGEST} at most` : `${file.name}: expected a BMP or PNG picture`;
      refresh();
      return;
    }
    const room = roomFromPixels(file.name, pixels.data, pixels.width, pixels.height, 0.01);
    const before = sim.room;
    if (enter(room, `${file.name}: ${pixels.width} by ${pixels.height} pixels of 1 cm, dark is wall`)) add(room);
    else sim.room = before;
  } });
  const save = () => {
    const url = URL.createObjectURL(new Blob([csvOf(sim.log, sim.sensor.n_beams)], { type: "text/csv" }));
    const link = h("a", { href: url, download: "simulator.csv" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), 1000);
  };
  const lidar = (change) => {
    halt();
    Object.assign(sim.sensor, change);
    begin();
  };
  const setBeams = (degrees) => {
    const n = Math.round(360 / degrees);
    lidar({ n_beams: n });
    sim.note = `${n} beams, one every ${fixed(360 / n, 2)}°`;
    refresh();
  };

  const controls = h("div", { class: "slam-controls slam-drive", role: "group", "aria-label": "Drive" },
    hold(ARROWS.left, "Turn left", "left arrow", moves.ArrowLeft),
    hold(ARROWS.forward, "Drive forward", "up arrow", moves.ArrowUp),
    hold(ARROWS.back, "Drive back", "down arrow", moves.ArrowDown),
    hold(ARROWS.right, "Turn right", "right arrow", moves.ArrowRight),
    field("step", "cm", 5, [0.5, 100, 0.5], (v) => { sim.step = v / 100; }),
    field("turn", "°", 5, [0.5, 180, 0.5], (v) => { sim.turn = v * DEGREE; }));
  const row = (label, ...nodes) => h("div", { class: "slam-controls slam-drive", role: "group", "aria-label": label }, ...nodes);
  const strategy = select("Strategy", Object.fromEntries(Object.entries(STRATEGIES).map(([k, v]) => [k, v.label])), (v) => { halt(); sim.strategy = v; });
  strategy.value = sim.strategy;
  const named = (text, node) => h("label", { class: "slam-setting" }, `${text} `, node);
  const pointer = select("Pointer", POINTERS, (v) => { sim.pointer = v; });
  const layers = layerChips(SIM_LAYERS, sim.on, () => refresh());
  const panel = (title, ...nodes) => h("div", { class: "slam-panel" }, h("div", { class: "slam-panel-title" }, title), ...nodes);
  root.append(
    h("div", { class: "slam-panels" },
      panel("The room", floor.node, controls, line),
      panel("What the lidar measures", chart.node, row("Lidar",
        field("beam every", "°", Math.round(360 / payload.n_beams), [1, 30, 1], setBeams),
        field("noise", "cm", 0, [0, 20, 0.5], (v) => lidar({ sigma: v / 100 })),
        field("lost", "%", 0, [0, 50, 1], (v) => lidar({ lost: v / 100 }))), tally)),
    row("Room", named("room", choice), h("label", { class: "slam-chip" }, "Load a picture", picture), named("pointer", pointer),
      word("Set down elsewhere", "J", moves.j), word("Start again", "Home", moves.Home)),
    row("Explore", explore, named("by", strategy), named("guarded by", select("Guard", GUARDS, (v) => { halt(); sim.guard = v; }))),
    row("Map and log", named("map at", select("Map drawn at", MAPS, (v) => { sim.mapAt = v; sim.dots = []; look(); })), word("Save the log (CSV)", "", save)),
    layers.row,
    h("details", { class: "slam-stack" }, h("summary", {}, "The stack of motions, as P5 recovers them from two scans"),
      h("table", { class: "slam-numbers" }, h("thead", {}, h("tr", {}, ...["motion", "true", "P5's stack, as printed", "by correlation"].map((t) => h("th", { scope: "col" }, t)))), stackRows)),
    h("div", { class: "slam-help" }, "Tap to place the robot, drag from it to turn it. "
      + "Arrow keys drive and turn, J sets the robot down elsewhere, E explores, Home starts again, Ctrl and wheel zoom."),
  );

  // ---- the pointer in the room ----

  const worldAt = (e) => {
    const box = floor.canvas.getBoundingClientRect();
    return [(e.clientX - box.left - floor.ox) / floor.sx, (e.clientY - box.top - floor.oy) / floor.sy];
  };
  let held = null;
  const nearRobot = (point) => apartOf(point, sim.pose) < Math.max(1.6 * sim.half, 24 / floor.sx);
  const paint = (point) => {
    paintWall(sim.room, held.point, point, PEN, sim.pointer === "wall");
    held.point = point;
    sim.pictureOf = null;
    floor.redraw();
  };
  const on = (name, f, options = {}) => floor.node.addEventListener(name, f, { signal, capture: true, ...options });
  on("touchstart", (e) => {
    if (e.touches.length !== 1 || sim.pointer === "view") return;
    if (sim.pointer !== "place" || nearRobot(worldAt(e.touches[0]))) e.preventDefault();
  }, { passive: false });
  on("pointerdown", (e) => {
    if (e.button !== 0 || e.target !== floor.canvas || sim.pointer === "view" || !e.isPrimary) return;
    const point = worldAt(e);
    halt();
    held = { id: e.pointerId, from: [e.clientX, e.clientY], point, turning: nearRobot(point), moved: false };
    if (sim.pointer !== "place") {
      if (!sim.room.drawn) {
        const copy = copyOf(sim.room, `${sim.room.name}, redrawn`);
        copy.drawn = true;
        sim.room = copy;
        add(copy);
      }
      paint(point);
    }
    if (e.pointerType === "touch" && sim.pointer === "place" && !held.turning) return;
    e.stopPropagation();
    floor.canvas.focus();
    floor.canvas.setPointerCapture(e.pointerId);
  });
  on("pointermove", (e) => {
    if (!held || e.pointerId !== held.id) return;
    const point = worldAt(e);
    held.moved = held.moved || Math.hypot(e.clientX - held.from[0], e.clientY - held.from[1]) > 6;
    if (sim.pointer !== "place") paint(point);
    else if (held.moved && held.turning) {
      const turned = [sim.pose[0], sim.pose[1], Math.atan2(point[1] - sim.pose[1], point[0] - sim.pose[0])];
      if (!overlaps(sim.room, turned, sim.half)) { sim.pose = turned; floor.redraw(); }
    } else if (held.moved && e.pointerType !== "touch") {
      const aimed = [...held.point, Math.atan2(point[1] - held.point[1], point[0] - held.point[0])];
      if (!overlaps(sim.room, aimed, sim.half)) { sim.pose = aimed; floor.redraw(); }
    }
  });
  on("pointerup", (e) => {
    if (!held || e.pointerId !== held.id) return;
    const { point, turning, moved } = held;
    held = null;
    if (sim.pointer !== "place") {
      if (overlaps(sim.room, sim.pose, sim.half)) sim.pose = roomyPlace(sim.room, sim.half) || sim.pose;
      begin("The room was redrawn");
    } else if (moved && (turning || e.pointerType !== "touch")) begin("Placed and turned");
    else if (!moved && !turning && !put([...point, sim.pose[2]], "Placed")) {
      sim.note = "No room there: the robot would touch";
      refresh();
    }
  });
  on("pointercancel", () => { held = null; });

  keyboard(root, (e) => {
    if (e.target.tagName === "INPUT") return false;
    const act = moves[e.key] || moves[e.key.toLowerCase()];
    if (!act) return false;
    if (e.key.startsWith("Arrow")) halt();
    act();
    return true;
  }, signal);
  signal.addEventListener("abort", () => clearTimeout(timer));
  enter(rooms[0]);
  return live({
    root, views: [floor, chart], samples: layers.samples, model, stop, event: "change:answer",
    paint: (chosen) => { colours = chosen; },
    moved: () => {
      const answer = model.get("answer");
      if (!answer || answer.id !== sim.asked) return;
      let gap = 0;
      answer.ranges.forEach((r, i) => { if (r !== null) gap = Math.max(gap, Math.abs(r - sim.ranges[i])); });
      const off = apartOf(answer.pose, sim.pose);
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

export {
  Floor, Pilot, STRATEGIES, bridged, canMove, castRay, castScan, csvOf, driveHits, freeDistance, generator, locate, locateAsPrinted, move,
  overlaps, quarterBeams, readRoom, roomFromPixels, roomyPlace, spectrumOf, tableOf, threeNumbers, turnBetween, turnHits, turnable, whatAngle, whatMove,
};
export default { render };
