// What the simulator computes: rooms of pixels, beams, the body, P5's rules and listings as printed
// and repaired, two ways to find the place, and the log. No page in it: a test runs it beside the
// library, function by function. Names in brackets are those of the library or of P5.

const HARMONICS = 16;
const CANDIDATES = 32;
const DEGREE = Math.PI / 180;
const TOUCH = 1e-9;
/** A table of signatures has at most about so many places. */
const PLACES = 2500;
/** Two places whose scans fit equally well up to this (m a beam) cannot be told apart. */
const AMBIGUOUS = 0.02;
const MARGIN = 0.02;
const STRIDE = 0.5;

const wrap = (a) => Math.PI - ((((Math.PI - a) % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI));

const apartOf = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

/** A small generator of its own: the same series on every machine. */
function generator(seed) {
  let state = seed >>> 0;
  const next = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  next.normal = () => Math.sqrt(-2 * Math.log(1 - next())) * Math.cos(2 * Math.PI * next());
  return next;
}

// ---- rooms --------------------------------------------------------------------------------------

/** A room from its cells (row 0 at the bottom, > 0 is wall). */
function roomOf(name, solid, rows, columns, resolution, origin, start = null) {
  const size = [columns * resolution, rows * resolution];
  const bounds = [origin[0], origin[0] + size[0], origin[1], origin[1] + size[1]];
  return { name, solid, rows, columns, resolution, origin, start, bounds, reach: Math.hypot(...size), tables: new Map() };
}

/** A room of the payload. */
function readRoom(packed) {
  const solid = unpack(packed.occupied).values;
  return roomOf(packed.name, solid, packed.rows, packed.columns, packed.resolution, packed.origin, packed.start);
}

/** A room from the pixels of a picture (RGBA, row 0 at the top): darker than half is wall, and so
 *  is nothing that is transparent [BitmapWorld.from_file]. */
function roomFromPixels(name, rgba, width, height, resolution) {
  const solid = new Uint8Array(width * height);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const k = 4 * (row * width + column);
      const grey = (299 * rgba[k] + 587 * rgba[k + 1] + 114 * rgba[k + 2]) / 1000;
      const seen = grey * (rgba[k + 3] / 255) + 255 - rgba[k + 3];
      solid[(height - 1 - row) * width + column] = seen < 127.5 ? 1 : 0;
    }
  }
  return roomOf(name, solid, height, width, resolution, [0, 0]);
}

/** A copy of a room that may be drawn into. */
const copyOf = (room, name) =>
  roomOf(name, Uint8Array.from(room.solid), room.rows, room.columns, room.resolution, room.origin, room.start);

/** Draw walls, or rub them out, in discs of pixels along a line. */
function paintWall(room, [xa, ya], [xb, yb], radius, wall) {
  const parts = Math.max(Math.ceil(Math.hypot(xb - xa, yb - ya) / (0.5 * radius)), 1);
  const far = radius / room.resolution;
  for (let k = 0; k <= parts; k++) {
    const px = (xa + (k / parts) * (xb - xa) - room.origin[0]) / room.resolution;
    const py = (ya + (k / parts) * (yb - ya) - room.origin[1]) / room.resolution;
    for (let row = Math.max(Math.floor(py - far), 0); row <= Math.min(py + far, room.rows - 1); row++) {
      for (let column = Math.max(Math.floor(px - far), 0); column <= Math.min(px + far, room.columns - 1); column++) {
        if (Math.hypot(column + 0.5 - px, row + 0.5 - py) <= far) room.solid[row * room.columns + column] = wall ? 252 : 0;
      }
    }
  }
  room.tables.clear();
}

/** Is this cell occupied? There is nothing for beams beyond the bitmap. */
const isSolid = (room, row, column) =>
  row >= 0 && row < room.rows && column >= 0 && column < room.columns && room.solid[row * room.columns + column] > 0;

/** Distance (m) at which a beam meets an occupied cell: from grid line to grid line, exact
 *  [BitmapWorld.cast]. Through a corner it goes only if one of the two cells beside it is free. */
function castRay(room, x, y, angle, maxRange = Infinity) {
  const { rows, columns, solid, resolution } = room;
  const dx = Math.cos(angle);
  const dy = Math.sin(angle);
  const px = (x - room.origin[0]) / resolution;
  const py = (y - room.origin[1]) / resolution;
  const stepX = dx > 0 ? 1 : -1;
  const stepY = dy > 0 ? 1 : -1;
  const longest = maxRange / resolution;
  let column = Math.floor(px);
  let row = Math.floor(py);
  let t = 0;
  while (t <= longest) {
    if (row < 0 || row >= rows || column < 0 || column >= columns) return Infinity;
    if (solid[row * columns + column] > 0) return t * resolution;
    const tx = dx !== 0 ? (column + (dx > 0 ? 1 : 0) - px) / dx : Infinity;
    const ty = dy !== 0 ? (row + (dy > 0 ? 1 : 0) - py) / dy : Infinity;
    const corner = Math.abs(tx - ty) <= TOUCH;
    if (corner && isSolid(room, row, column + stepX) && isSolid(room, row + stepY, column)) {
      return tx <= longest ? tx * resolution : Infinity;
    }
    t = corner ? Math.max(tx, ty) : Math.min(tx, ty);
    if (tx < ty || corner) column += stepX;
    if (ty < tx || corner) row += stepY;
  }
  return Infinity;
}

/** All beams from a pose: beam i at 2 pi i / n to the left of straight ahead [Lidar.scan]. */
function castScan(room, [x, y, theta], n) {
  const ranges = new Float64Array(n);
  for (let i = 0; i < n; i++) ranges[i] = castRay(room, x, y, theta + (i * 2 * Math.PI) / n);
  return ranges;
}

/** What the lidar reports: noise on each return, and lost beams (NaN). */
function measure(room, pose, sensor, random) {
  const ranges = castScan(room, pose, sensor.n_beams);
  for (let i = 0; i < ranges.length; i++) {
    if (sensor.sigma > 0 && Number.isFinite(ranges[i])) ranges[i] = Math.max(ranges[i] + sensor.sigma * random.normal(), 0);
    if (sensor.lost > 0 && random() < sensor.lost) ranges[i] = NaN;
  }
  return ranges;
}

/** Ends of the beams that met something, from a pose. */
function ends(pose, ranges) {
  const points = [];
  for (let i = 0; i < ranges.length; i++) {
    if (!Number.isFinite(ranges[i])) continue;
    const a = pose[2] + (i * 2 * Math.PI) / ranges.length;
    points.push([pose[0] + ranges[i] * Math.cos(a), pose[1] + ranges[i] * Math.sin(a)]);
  }
  return points;
}

// ---- the body -----------------------------------------------------------------------------------

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

/** The free place nearest to the middle where the robot can turn; null without one. */
function roomyPlace(room, h) {
  const [x0, x1, y0, y1] = room.bounds;
  let [best, pose] = [Infinity, null];
  for (let row = 0; row < room.rows; row += 4) {
    for (let column = 0; column < room.columns; column += 4) {
      const [x, y] = [x0 + (column + 0.5) * room.resolution, y0 + (row + 0.5) * room.resolution];
      const away = Math.hypot(x - (x0 + x1) / 2, y - (y0 + y1) / 2);
      if (away < best && !overlaps(room, [x, y, 0], h * Math.SQRT2)) [best, pose] = [away, [x, y, 0]];
    }
  }
  return pose;
}

/** A free pose, free for any heading. */
function somewhere(room, h, random) {
  const [x0, x1, y0, y1] = room.bounds;
  for (let k = 0; k < 2000; k++) {
    const pose = [x0 + (x1 - x0) * random(), y0 + (y1 - y0) * random(), wrap(2 * Math.PI * random())];
    if (!overlaps(room, [pose[0], pose[1], 0], h * Math.SQRT2)) return pose;
  }
  return null;
}

/** Does the square touch one of these points (body frame) while it drives? [SquareRobot.drive_hits] */
function driveHits(points, distance, h, margin) {
  const half = h + margin;
  return points.some(([x, y]) => Math.abs(y) < half && x > Math.min(distance, 0) - half && x < Math.max(distance, 0) + half);
}

/** ... while it turns on the spot? [SquareRobot.turn_hits] */
function turnHits(points, angle, h, margin) {
  const half = h + margin;
  return points.some(([x, y]) => {
    const r = Math.hypot(x, y);
    if (r < half) return true;
    if (r >= half * Math.SQRT2) return false;
    const gap = Math.acos(Math.min(half / r, 1));
    let bearing = Math.atan2(y, x);
    bearing -= (Math.PI / 2) * Math.round(bearing / (Math.PI / 2));
    return Math.abs(bearing) > gap || Math.abs(bearing - angle) > gap;
  });
}

/** How far it may drive before a point touches [SquareRobot.free_distance]. */
function freeDistance(points, h, margin) {
  const half = h + margin;
  let far = Infinity;
  for (const [x, y] of points) if (Math.abs(y) < half && x > -half) far = Math.min(far, Math.max(x - half, 0));
  return far;
}

/** The farthest end, up to `free`, at which the circle of figure 14 is empty. */
function turnable(points, free, h) {
  const radius = h * Math.SQRT2 + MARGIN;
  const shut = [];
  for (const [x, y] of points) {
    if (Math.abs(y) >= radius) continue;
    const chord = Math.sqrt(radius * radius - y * y);
    shut.push([x - chord, x + chord]);
  }
  const open = (end) => !shut.some(([low, high]) => end > low + 1e-12 && end < high - 1e-12);
  return [free, ...shut.map(([low]) => low).filter((low) => low > 0 && low < free)].filter(open).reduce((a, b) => Math.max(a, b), 0);
}

// ---- P5's listings, word by word ----------------------------------------------------------------

/** `CanMove`: 0 both ways, 1 ahead only, 2 back only, 3 neither. */
function canMove(arr, w) {
  const eighth = Math.floor(arr.length / 8);
  const short = (from, to) => arr.slice(from, to).some((r) => r < w);
  const [ahead, back] = [short(0, eighth) || short(eighth * 7, arr.length), short(eighth * 3, eighth * 5)];
  return (ahead ? 2 : 0) + (back ? 1 : 0);
}

/** `Whatangle`: by how many places the longest beam has moved. */
function whatAngle(arr1, arr2) {
  const longest = (arr) => arr.reduce((best, r, i) => (r > arr[best] ? i : best), 0);
  const [moved, half] = [longest(arr1) - longest(arr2), Math.floor(arr1.length / 2)];
  if (moved >= half) return moved - arr1.length;
  return moved <= -half ? arr1.length + moved : moved;
}

/** `whatmove`: how much shorter the beams to the back and to the front became. */
function whatMove(arr1, arr2) {
  const half = Math.floor(arr1.length / 2);
  return [arr1[half] - arr2[half], arr1[0] - arr2[0]];
}

/** The turn between two scans of one place: correlation, then below one beam [turn_between]. */
function turnBetween(before, after) {
  const n = before.length;
  const centred = (scan) => {
    const there = Array.from(scan).filter(Number.isFinite);
    const mean = there.reduce((a, b) => a + b, 0) / Math.max(there.length, 1);
    return Array.from(scan, (r) => (Number.isFinite(r) ? r - mean : 0));
  };
  const [a, b] = [centred(before), centred(after)];
  let [best, shift] = [-Infinity, 0];
  for (let k = 0; k < n; k++) {
    let sum = 0;
    for (let i = 0; i < n; i++) sum += a[(i + k) % n] * b[i];
    if (sum > best) [best, shift] = [sum, k];
  }
  const sorted = Array.from(before).filter(Number.isFinite).sort((p, q) => p - q);
  const middle = sorted.length >> 1;
  const limit = 0.05 * (sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2);
  const cost = (trial) => {
    let sum = 0;
    for (let i = 0; i < n; i++) {
      const lower = Math.floor(i + trial);
      const first = before[((lower % n) + n) % n];
      const second = before[(((lower + 1) % n) + n) % n];
      const difference = Math.abs(first + (i + trial - lower) * (second - first) - after[i]);
      sum += difference < limit ? difference : limit;
    }
    return sum;
  };
  for (const width of [1, 0.1]) {
    const trials = Array.from({ length: 21 }, (_, k) => shift + width * (-1 + k / 10));
    const costs = trials.map(cost);
    shift = trials[costs.indexOf(Math.min(...costs))];
  }
  return wrap((shift * 2 * Math.PI) / n);
}

// ---- where am I? --------------------------------------------------------------------------------

/** Lost beams from their neighbours on the circle, beams that met nothing as long as the room. */
function bridged(ranges, reach) {
  const n = ranges.length;
  const out = Float64Array.from(ranges, (r) => Math.min(r, reach));
  const known = Array.from(out.keys()).filter((i) => !Number.isNaN(out[i]));
  if (known.length === n || known.length === 0) return out;
  known.forEach((from, k) => {
    const to = known[(k + 1) % known.length] + (k + 1 === known.length ? n : 0);
    for (let i = from + 1; i < to; i++) out[i % n] = out[from] + ((i - from) / (to - from)) * (out[to % n] - out[from]);
  });
  return out;
}

const circles = new Map();

/** Cosines and sines of the n beams. */
function circle(n) {
  if (!circles.has(n)) {
    const angles = Float64Array.from({ length: n }, (_, i) => (2 * Math.PI * i) / n);
    circles.set(n, [angles.map(Math.cos), angles.map(Math.sin)]);
  }
  return circles.get(n);
}

/** Root of the power spectrum of a scan: what its autocorrelation holds [spectrum]. */
function spectrumOf(scan) {
  const n = scan.length;
  const [cos, sin] = circle(n);
  const out = new Float64Array(HARMONICS);
  for (let k = 0; k < Math.min(HARMONICS, Math.floor(n / 2)); k++) {
    let re = 0;
    let im = 0;
    for (let i = 0; i < n; i++) {
      re += scan[i] * cos[(k * i) % n];
      im += scan[i] * sin[(k * i) % n];
    }
    out[k] = Math.hypot(re, im) * Math.sqrt((k === 0 ? 1 : 2) / n);
  }
  return out;
}

/** P5's signature: the largest and the smallest range, and the difference of their places. */
function threeNumbers(scan) {
  let [i, j] = [0, 0];
  for (let k = 1; k < scan.length; k++) {
    if (scan[k] > scan[i]) i = k;
    if (scan[k] < scan[j]) j = k;
  }
  return [scan[i], scan[j], i - j];
}

/** Scans and signatures of every free place of a grid, cast once for a room and a lidar. */
function tableOf(room, n, stride = Math.max(10, Math.ceil(Math.sqrt((room.rows * room.columns) / PLACES)))) {
  const key = `${n} ${stride}`;
  if (room.tables.has(key)) return room.tables.get(key);
  const table = { stride, pitch: stride * room.resolution, places: [], scans: [], spectra: [], three: [] };
  for (let row = 0; row < room.rows; row += stride) {
    for (let column = 0; column < room.columns; column += stride) {
      if (isSolid(room, row, column)) continue;
      const place = [room.origin[0] + (column + 0.5) * room.resolution, room.origin[1] + (row + 0.5) * room.resolution];
      const scan = Float32Array.from(castScan(room, [...place, 0], n), (r) => Math.min(r, room.reach));
      table.places.push(place);
      table.scans.push(scan);
      table.spectra.push(spectrumOf(scan));
      table.three.push(threeNumbers(scan));
    }
  }
  room.tables.set(key, table);
  return table;
}

/** Indices of the places whose signatures lie nearest. */
function nearest(signatures, wanted, count) {
  const gaps = Float64Array.from(signatures, (signature) => {
    let sum = 0;
    for (let k = 0; k < wanted.length; k++) sum += (signature[k] - wanted[k]) ** 2;
    return sum;
  });
  return Array.from(gaps.keys()).sort((a, b) => gaps[a] - gaps[b]).slice(0, count);
}

/** P5 as printed: the place with the nearest three numbers. It has no heading. */
function locateAsPrinted(room, ranges) {
  const table = tableOf(room, ranges.length);
  return table.places[nearest(table.three, threeNumbers(bridged(ranges, room.reach)), 1)[0]];
}

/** Heading in whole beams, and mean misfit (m, a beam counts 0.5 m at most), of a scan at a place.
 *  A lost beam has no vote; headings within 30 degrees of `avoid` are left out. */
function alignAt(table, index, ranges, avoid = NaN) {
  const n = ranges.length;
  const there = table.scans[index];
  const free = Number.isNaN(avoid);
  let best = Infinity;
  let shift = 0;
  for (let k = 0; k < n; k++) {
    if (!free && Math.abs(wrap((k * 2 * Math.PI) / n - avoid)) < 30 * DEGREE) continue;
    let sum = 0;
    for (let i = 0, j = k; i < n && sum < best; i++, j = j + 1 === n ? 0 : j + 1) {
      const gap = Math.abs(ranges[i] - there[j]);
      if (gap >= 0) sum += gap < 0.5 ? gap : 0.5;
    }
    if (sum < best) {
      best = sum;
      shift = k;
    }
  }
  return { index, pose: [...table.places[index], wrap((shift * 2 * Math.PI) / n)], misfit: best / n };
}

/** Mean misfit (m) of a scan against what would be measured at a pose; a beam counts 0.5 m at most.
 *  Infinity as soon as it is worse than `limit`. */
function misfitAt(room, [x, y, theta], ranges, limit = Infinity) {
  const n = ranges.length;
  let sum = 0;
  for (let i = 0; i < n; i++) {
    if (Number.isNaN(ranges[i])) continue;
    const there = Math.min(castRay(room, x, y, theta + (i * 2 * Math.PI) / n, room.reach), room.reach);
    sum += Math.min(Math.abs(ranges[i] - there), 0.5);
    if (sum >= limit * n) return Infinity;
  }
  return sum / n;
}

/** Move a pose of the table to where the scan fits best: smaller and smaller steps, no derivative,
 *  and no farther than three quarters of the table's pitch. */
function refine(room, found, ranges, pitch) {
  let [pose, misfit] = [found.pose, misfitAt(room, found.pose, ranges)];
  const beam = (2 * Math.PI) / ranges.length;
  for (let size = 0.4; size > 0.02; size /= 2) {
    for (let better = true, rounds = 0; better && rounds < 3; rounds++) {
      better = false;
      for (const [k, step] of [[0, size * pitch], [1, size * pitch], [2, size * beam]]) {
        for (const sign of [1, -1]) {
          const next = pose.map((v, i) => (i === k ? v + sign * step : v));
          if (k < 2 && Math.abs(next[k] - found.pose[k]) > 0.75 * pitch) continue;
          const worth = misfitAt(room, next, ranges, misfit);
          if (worth < misfit) [pose, misfit, better] = [next, worth, true];
        }
      }
    }
  }
  return { pose: [pose[0], pose[1], wrap(pose[2])], misfit };
}

/** Where was this scan taken? The nearest signatures propose, the whole scans decide, and the best
 *  and the best elsewhere are refined before they are compared [SignatureMap.locate]. */
function locate(room, measured) {
  const table = tableOf(room, measured.length);
  const ranges = Float64Array.from(measured, (r) => Math.min(r, room.reach));
  const wanted = spectrumOf(bridged(measured, room.reach));
  const found = nearest(table.spectra, wanted, CANDIDATES).map((index) => alignAt(table, index, ranges));
  found.sort((a, b) => a.misfit - b.misfit);
  const apart = (f, g) => Math.hypot(f.pose[0] - g.pose[0], f.pose[1] - g.pose[1]) > 0.5
    || Math.abs(wrap(f.pose[2] - g.pose[2])) > 30 * DEGREE;
  // The rival stands elsewhere, or at the same place and looks elsewhere.
  const turned = alignAt(table, found[0].index, ranges, found[0].pose[2]);
  const rivals = [found.find((f) => apart(f, found[0])), turned].filter(Boolean);
  rivals.sort((f, g) => f.misfit - g.misfit);
  const pair = [found[0], rivals[0]].map((f) => refine(room, f, ranges, table.pitch));
  pair.sort((f, g) => f.misfit - g.misfit);
  const [best, second] = pair;
  const margin = second.misfit - best.misfit;
  return { best, second, margin, ambiguous: margin < AMBIGUOUS };
}

// ---- the floor that was seen --------------------------------------------------------------------

const [UNKNOWN, FREE, OCCUPIED] = [0, 1, 2];
const AROUND = [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]];

/** What scans have shown of the floor, cell by cell [ExplorationGrid], and how much of what can be reached
 *  from the start that is [tours.coverage]. */
class Floor {
  constructor(room, [x, y], cell = 0.05) {
    const [x0, x1, y0, y1] = room.bounds;
    Object.assign(this, { cell, origin: [x0, y0], columns: Math.ceil((x1 - x0) / cell - 1e-9), rows: Math.ceil((y1 - y0) / cell - 1e-9) });
    const size = this.rows * this.columns;
    for (const name of ["due", "state", "shut", "doubt"]) this[name] = new Uint8Array(size);
    this.total = 0;
    const free = (row, column) => {
      const at = [(column + 0.5) * cell, (row + 0.5) * cell].map((v) => Math.floor(v / room.resolution + 1e-9));
      return at[1] < room.rows && at[0] < room.columns && !isSolid(room, at[1], at[0]);
    };
    const open = [this.cellAt([x, y])];
    while (open.length) {
      const [row, column] = open.pop();
      if (!this.holds(row, column) || this.due[row * this.columns + column] || !free(row, column)) continue;
      this.due[row * this.columns + column] = 1;
      this.total += 1;
      open.push([row + 1, column], [row - 1, column], [row, column + 1], [row, column - 1]);
    }
  }

  holds(row, column) { return row >= 0 && row < this.rows && column >= 0 && column < this.columns; }

  cellAt([x, y]) { return [Math.floor((y - this.origin[1]) / this.cell), Math.floor((x - this.origin[0]) / this.cell)]; }

  centre(k) { return [this.origin[0] + ((k % this.columns) + 0.5) * this.cell, this.origin[1] + (Math.floor(k / this.columns) + 0.5) * this.cell]; }

  get share() {
    let seen = 0;
    for (let k = 0; k < this.due.length; k++) if (this.due[k] && this.state[k] !== UNKNOWN) seen += 1;
    return this.total ? seen / this.total : 0;
  }

  /** Walls where beams end and between two ends that are neighbours; free what lies nearer than the
   *  ends of both beams beside it. A lost beam is left out. */
  insert([x, y, theta], ranges) {
    const kept = Array.from(ranges.keys()).filter((i) => !Number.isNaN(ranges[i]));
    const n = kept.length;
    if (!n) return;
    const angles = kept.map((i) => (i * 2 * Math.PI) / ranges.length);
    const reach = kept.map((i) => Math.min(ranges[i] / this.cell, this.rows + this.columns));
    const [px, py] = [(x - this.origin[0]) / this.cell, (y - this.origin[1]) / this.cell];
    const end = (i) => {
      const [a, r] = [theta + angles[i], reach[i] + 0.02];
      return [px + r * Math.cos(a), py + r * Math.sin(a)];
    };
    for (let i = 0; i < n; i++) {
      if (!Number.isFinite(ranges[kept[i]])) continue;
      const [xa, ya] = end(i);
      let [xb, yb, steps] = [xa, ya, 0];
      if (Number.isFinite(ranges[kept[(i + 1) % n]])) {
        [xb, yb] = end((i + 1) % n);
        const length = Math.hypot(xb - xa, yb - ya);
        if (length <= 3) steps = Math.floor(2 * length) + 1;
      }
      for (let k = 0; k <= steps; k++) {
        const u = steps ? k / steps : 0;
        const [row, column] = [Math.floor(ya + u * (yb - ya)), Math.floor(xa + u * (xb - xa))];
        if (this.holds(row, column)) this.state[row * this.columns + column] = OCCUPIED;
        if (this.holds(row, column)) this.doubt[row * this.columns + column] = 0;
      }
    }
    for (let row = 0; row < this.rows; row++) {
      for (let column = 0; column < this.columns; column++) {
        const k = row * this.columns + column;
        if (this.state[k] === FREE) continue;
        const [dx, dy] = [column + 0.5 - px, row + 0.5 - py];
        const angle = (((Math.atan2(dy, dx) - theta) % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI);
        let after = Math.min(Math.ceil((angle / (2 * Math.PI)) * n), n);
        while (after > 0 && angles[after - 1] >= angle) after -= 1;
        while (after < n && angles[after] < angle) after += 1;
        const before = (after + n - 1) % n;
        after %= n;
        let wedge = angles[after] - angles[before];
        if (wedge <= 0) wedge += 2 * Math.PI;
        const [distance, nearer] = [Math.hypot(dx, dy), Math.min(reach[before], reach[after])];
        if (this.state[k] === UNKNOWN) {
          if (distance <= nearer && wedge <= 12.5 * DEGREE) this.state[k] = FREE;
        } else if (distance <= nearer - 1.5 && distance * wedge <= 1) {
          this.doubt[k] += 1;
          if (this.doubt[k] === 3) this.state[k] = FREE;
        }
      }
    }
  }

  /** Free cells beside an unknown one, in parts of three cells or more, without those given up. */
  frontier() {
    const edge = new Uint8Array(this.state.length);
    for (let k = 0; k < edge.length; k++) {
      if (this.state[k] !== FREE || this.shut[k]) continue;
      const [row, column] = [Math.floor(k / this.columns), k % this.columns];
      edge[k] = [[1, 0], [-1, 0], [0, 1], [0, -1]].some(([i, j]) =>
        this.holds(row + i, column + j) && this.state[k + i * this.columns + j] === UNKNOWN) ? 1 : 0;
    }
    const found = [];
    for (let k = 0; k < edge.length; k++) {
      if (edge[k] !== 1) continue;
      const part = [k];
      edge[k] = 2;
      for (let at = 0; at < part.length; at++) {
        const [row, column] = [Math.floor(part[at] / this.columns), part[at] % this.columns];
        for (const [i, j] of AROUND) {
          const next = part[at] + i * this.columns + j;
          if (!this.holds(row + i, column + j) || edge[next] !== 1) continue;
          edge[next] = 2;
          part.push(next);
        }
      }
      if (part.length >= 3) found.push(...part);
    }
    return found;
  }

  /** Cells where a disc lies on seen free floor. */
  fits(radius) {
    const far = radius / this.cell + Math.SQRT1_2;
    const disc = [];
    for (let i = -Math.ceil(far); i <= far; i++) for (let j = -Math.ceil(far); j <= far; j++) if (Math.hypot(i, j) < far - 1e-9) disc.push([i, j]);
    return this.state.map((state, k) => {
      if (state !== FREE) return 0;
      const [row, column] = [Math.floor(k / this.columns), k % this.columns];
      return disc.every(([i, j]) => this.holds(row + i, column + j) && this.state[k + i * this.columns + j] === FREE) ? 1 : 0;
    });
  }

  /** Shortest ways (cells) of a disc from a point, and the cell before each. */
  ways(point, radius) {
    const fits = this.fits(radius);
    const lengths = new Float64Array(fits.length).fill(Infinity);
    const parents = new Int32Array(fits.length).fill(-1);
    let [start, gap] = [-1, radius];
    for (let k = 0; k < fits.length; k++) {
      const away = fits[k] ? apartOf(this.centre(k), point) : Infinity;
      if (away <= gap) [start, gap] = [k, away];
    }
    const queue = start < 0 ? [] : [start];
    if (start >= 0) lengths[start] = 0;
    for (let at = 0; at < queue.length; at++) {
      const k = queue[at];
      const [row, column] = [Math.floor(k / this.columns), k % this.columns];
      for (const [i, j] of AROUND) {
        const next = k + i * this.columns + j;
        if (!this.holds(row + i, column + j) || !fits[next]) continue;
        if (i && j && !(fits[k + i * this.columns] && fits[k + j])) continue;
        const length = lengths[k] + Math.hypot(i, j);
        if (length < lengths[next] - 1e-9) {
          lengths[next] = length;
          parents[next] = k;
          queue.push(next);
        }
      }
    }
    return { fits, lengths, parents };
  }

  /** Points at which the way to a cell bends, the cell last. */
  wayTo({ fits, parents }, goal) {
    const cells = [];
    for (let k = goal; k >= 0; k = parents[k]) cells.unshift([Math.floor(k / this.columns), k % this.columns]);
    const straight = (a, b) => {
      const steps = 4 * Math.max(Math.abs(b[0] - a[0]), Math.abs(b[1] - a[1]));
      for (let k = 1; k < steps; k++) {
        const at = a.map((v, i) => v + (k / steps) * (b[i] - v));
        for (const i of [-0.25, 0.25]) for (const j of [-0.25, 0.25]) if (!fits[Math.round(at[0] + i) * this.columns + Math.round(at[1] + j)]) return false;
      }
      return true;
    };
    const points = [];
    for (let at = 0; at < cells.length - 1;) {
      let ahead = cells.length - 1;
      while (ahead > at + 1 && !straight(cells[at], cells[ahead])) ahead -= 1;
      at = ahead;
      points.push(this.centre(cells[at][0] * this.columns + cells[at][1]));
    }
    return points.length ? points : [this.centre(goal)];
  }

  /** The way to the nearest place from which the edge of the unknown is at hand [NearestFrontier];
   *  null when nothing is left. One visit a frontier: what it does not clear up is no way on. */
  nearestFrontier(pose, radius) {
    for (const k of this.frontier()) if (apartOf(this.centre(k), pose) <= radius + 3 * this.cell) this.shut[k] = 1;
    const ways = this.ways(pose, radius);
    const stands = Array.from(ways.lengths.keys()).filter((k) => Number.isFinite(ways.lengths[k]));
    let [best, goal] = [Infinity, -1];
    const nearest = this.frontier().map((k) => {
      let [gap, place] = [Infinity, -1];
      const [row, column] = [Math.floor(k / this.columns), k % this.columns];
      for (const stand of stands) {
        const away = (Math.floor(stand / this.columns) - row) ** 2 + ((stand % this.columns) - column) ** 2;
        if (away < gap) [gap, place] = [away, stand];
      }
      gap = Math.sqrt(gap);
      const cost = gap * this.cell > 2 ? Infinity : ways.lengths[place] + gap;
      if (cost < best) [best, goal] = [cost, place];
      return [k, place];
    });
    if (goal < 0) return null;
    for (const [k, place] of nearest) if (place === goal) this.shut[k] = 1;
    return this.wayTo(ways, goal);
  }
}

// ---- autonomous motion --------------------------------------------------------------------------

const bearing = (i, n) => (i * 2 * Math.PI) / n;

/** Longest beams of the quarters; as printed the third one begins at 160 degrees [Quadrants.quarters]. */
function quarterBeams(lengths, asPrinted) {
  const n = lengths.length;
  return [[0, 90], [90, 180], [asPrinted ? 160 : 180, 270], [270, 360]].map(([low, high]) => {
    let best = -1;
    for (let i = 0; i < n; i++) {
      const degrees = (360 * i) / n;
      if (degrees >= low - 1e-9 && degrees < high - 1e-9 && (best < 0 || lengths[i] > lengths[best])) best = i;
    }
    return best;
  }).filter((i) => i >= 0);
}

/** Part of the longest beam to drive; as printed a division by 0.1 to 2.0 [strategies._part]. */
const partOf = (length, asPrinted, random) => (asPrinted ? length / (0.1 + 1.9 * random()) : length * (0.5 + 0.5 * random()));

const STRATEGIES = {
  longest: { label: "longest beam, half of it", part: (length) => 0.5 * length },
  fraction: { label: "longest beam, a random part", part: (length, random) => partOf(length, false, random) },
  "fraction-printed": { label: "… as printed: / U(0.1, 2)", part: (length, random) => partOf(length, true, random) },
  quadrants: { label: "four quarters", quarters: true, part: (length, random) => partOf(length, false, random) },
  "quadrants-printed": { label: "… as printed: from 160°, / U(0.1, 2)", quarters: true, printed: true, part: (length, random) => partOf(length, true, random) },
  frontier: { label: "nearest frontier (not P5's)" },
};

/** Where to go next: a beam and a distance [LongestBeam, RandomFraction, Quadrants]. */
function choose(strategy, lengths, { refused, cameFrom, theta, side }, random) {
  const n = lengths.length;
  const any = () => {
    const open = Array.from(lengths.keys()).filter((i) => lengths[i] > side);
    return open.length ? open[Math.floor(random() * open.length)] : Math.floor(random() * n);
  };
  let beam = lengths.reduce((best, r, i) => (r > lengths[best] ? i : best), 0);
  if (strategy.quarters) {
    let best = quarterBeams(lengths, strategy.printed).filter((i) => lengths[i] > side);
    const onward = best.filter((i) => cameFrom === null || Math.cos(theta + bearing(i, n) - cameFrom) < Math.SQRT1_2);
    best = onward.length ? onward : best;
    beam = best.length ? best[Math.floor(random() * best.length)] : any();
  }
  if (refused) beam = any();
  return [beam, strategy.part(lengths[beam], random)];
}

/** A pilot: turns and drives in strides to the point that a strategy chose [Explorer]. */
class Pilot {
  constructor(half, strategy, guard, random) {
    Object.assign(this, { half, strategy, guard, random, way: [], aimed: false, begun: true, tries: 0, cameFrom: null, refused: 0 });
  }

  /** The next motion [distance, angle], from the pose, the newest scan, the floor that was seen and
   *  whether it touched; null when nothing is left. */
  command(pose, ranges, reach, hit, floor) {
    this.points = ends([0, 0, 0], ranges);
    this.ranges = Array.from(ranges, (r) => (Number.isNaN(r) ? Infinity : r));
    if (hit) this.way = [];
    for (let k = 0; k < 50; k++) {
      const motion = this.follow(pose);
      if (motion) return motion;
      if (!this.begun) this.refused += 1;
      if (this.strategy.part) this.way = [this.drawn(pose, ranges, reach)];
      else this.way = floor.nearestFrontier(pose, this.half * Math.SQRT2 + 0.02);
      if (!this.way) return null;
      Object.assign(this, { begun: false, aimed: false, tries: 0 });
    }
    return null;
  }

  /** The point that one of P5's rules draws. */
  drawn(pose, ranges, reach) {
    const lengths = Array.from(ranges, (r) => (Number.isNaN(r) ? 0 : Math.min(r, reach)));
    const state = { refused: !this.begun, cameFrom: this.cameFrom, theta: pose[2], side: 2 * this.half };
    const [beam, far] = choose(this.strategy, lengths, state, this.random);
    const a = pose[2] + bearing(beam, ranges.length);
    return [pose[0] + far * Math.cos(a), pose[1] + far * Math.sin(a)];
  }

  follow(pose) {
    while (this.way.length) {
      const [x, y] = betweenPoses(pose, [...this.way[0], 0]);
      const length = Math.hypot(x, y);
      if (length < 0.02) {
        this.arrive(pose);
        continue;
      }
      if (!this.aimed) return this.turn(pose, Math.atan2(y, x));
      const go = this.allowed(length);
      if (go >= 0.99 * Math.min(length, STRIDE, 0.02)) {
        this.begun = true;
        // After the stride the point lies there: does the robot still look at it?
        this.aimed = length - go < 0.1 || Math.abs(Math.atan2(y, x - go)) < 0.05;
        return [go, 0];
      }
      if (length >= 0.1) this.way = [];
      else this.arrive(pose);
    }
    return null;
  }

  arrive(pose) {
    Object.assign(this, { way: this.way.slice(1), aimed: false, tries: 0 });
    if (this.begun) this.cameFrom = wrap(pose[2] + Math.PI);
  }

  turn(pose, angle) {
    if (this.guard !== "swept" || !turnHits(this.points, angle, this.half, 0.5 * MARGIN)) {
      this.aimed = true;
      return [0, angle];
    }
    this.tries += 1;
    const room = this.tries <= 3 ? this.makeRoom(pose, angle) : null;
    if (!room) this.way = [];
    return room;
  }

  /** Drive back, or else ahead, a few centimetres, to where the turn is free. */
  makeRoom(pose, angle) {
    const steps = [1, 2, 3, 4, 5].map((k) => 0.5 * this.half * k);
    for (const way of [...steps.map((v) => -v), ...steps]) {
      if (driveHits(this.points, way, this.half, 0.5 * MARGIN)) continue;
      if (turnHits(this.points.map(([x, y]) => [x - way, y]), angle, this.half, MARGIN)) continue;
      const [x, y] = this.way[0];
      this.way[0] = [x + way * Math.cos(pose[2]), y + way * Math.sin(pose[2])];
      return [way, 0];
    }
    return null;
  }

  allowed(left) {
    // P5 asks for the whole way at once; the mended guard goes in strides, with a scan before each.
    if (this.guard === "none") return left;
    if (this.guard === "printed") return canMove(this.ranges, left) < 2 ? left : 0;
    return Math.min(left, STRIDE, turnable(this.points, Math.min(left, freeDistance(this.points, this.half, MARGIN)), this.half));
  }
}

// ---- the log ------------------------------------------------------------------------------------

/** Text that `slamlab.datasets.read_simulator` reads: what was driven, where it truly was, what was
 *  measured. inf met nothing, nan was lost. */
function csvOf(log, n) {
  const word = (v) => (Number.isNaN(v) ? "nan" : v === Infinity ? "inf" : String(Number(v.toFixed(9))));
  const head = ["time", "dx", "dy", "dtheta", "x", "y", "theta", ...Array.from({ length: n }, (_, i) => `r${i}`)];
  const rows = log.map(({ time, u, pose, ranges }) => [time, ...u, ...pose, ...ranges].map(word).join());
  return [`# slamlab simulator, ${n} beams`, head.join(), ...rows, ""].join("\n");
}

/** The motion from one pose to another, seen from the first. */
function betweenPoses(a, b) {
  const [dx, dy, c, s] = [b[0] - a[0], b[1] - a[1], Math.cos(a[2]), Math.sin(a[2])];
  return [c * dx + s * dy, c * dy - s * dx, wrap(b[2] - a[2])];
}
