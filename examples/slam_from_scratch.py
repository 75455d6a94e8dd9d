"""SLAM from scratch: raw lidar scans and odometry become a consistent map.

Read it in an evening, top to bottom: poses, points, point-to-line ICP, the search of a
window by FFT, the front end, loop closures, the pose graph, the occupancy map, the loop
over a log. A pose is (x, y, heading) in m, m, rad; compose(a, b) is the pose b of frame
a, seen from the world. Lab V writes this file step by step.
"""

# 0. What is imported, and the constants.
import numpy as np
from scipy import fft, ndimage, sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

MAX_RANGE, VOXEL = 30.0, 0.1  # beams count up to here (m); a point in each such cell
NOISE, KERNEL_WIDTH = 0.05, 0.1  # of a point across its wall (m); beyond, weights fall
KEYFRAMES, NEW_KEYFRAME = 20, (0.3, np.deg2rad(15))  # in a submap; from one to the next
ODOMETRY_INFLATION = 9.0  # odometry errs the same way again: its covariance times this
MIN_LOOP, CLOSURE_SPACING = 20.0, 1.5  # path (m) inside a closure; between two attempts
MIN_RADIUS, MAX_RADIUS, RADIUS_GROWTH = 2.5, 12.0, 0.03  # of the search (m); per metre
SUBMAP_LENGTH, N_AROUND = 6.0, 3  # path of the old place (m); scans on each side of k
SEARCH_ANGLE, SEARCH_RANGE = np.deg2rad(20), 15.0  # window; points beyond (m) stay out
MIN_SCORE, MAX_SECOND_PEAK = 0.5, 0.8  # of a closure; share of the best score
SECOND_PEAK_DISTANCE = 0.8  # from the best (m): nearer ones are the same peak
CONSISTENCY_SPAN, MIN_CONSISTENT = 15.0, 2  # of path (m) to closures that must agree
MIN_COV = np.diag([0.02, 0.02, np.deg2rad(0.3)]) ** 2  # of any match
KERNEL_WIDTHS = (1e4, 1e3, 1e2, 3e1)  # of the robust kernel, one after the other (chi2)


# 1. Poses.
def wrap(angle):
    """Angle in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def compose(a, b):
    """Pose b of frame a, seen from the world; leading axes are batches."""
    a, b = np.asarray(a), np.asarray(b)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrap(a[..., 2] + b[..., 2])], -1)


def between(a, b):
    """Pose b seen from a: compose(a, between(a, b)) is b."""
    d = np.asarray(b) - np.asarray(a)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0]
    return np.stack([x, y, wrap(d[..., 2])], -1)


def rotation(angle):
    """Rotation of a pose about the origin, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def transform(pose, points):
    """Points (n, 2) of the frame of a pose, seen from the world."""
    return points @ rotation(pose[2])[:2, :2].T + pose[:2]


# 2. Points of a scan.
def voxel_downsample(points, cell=VOXEL):
    """One point of each square of a grid."""
    _, first = np.unique(np.floor(points / cell).astype(int), axis=0, return_index=True)
    return points[np.sort(first)]


def scan_points(ranges, angles):
    """End points (n, 2) of the beams that met something, in the frame of the robot."""
    good = (ranges > 0.05) & (ranges < MAX_RANGE)
    r, a = ranges[good], angles[good]
    return voxel_downsample(np.stack([r * np.cos(a), r * np.sin(a)], -1))


# 3. Point-to-line ICP, pulled by a prior.
def estimate_normals(points, k=5, radius=0.5):
    """Normals (n, 2) of the lines through the points; NaN where there is no line."""
    distance, i = cKDTree(points).query(points, min(k, len(points)))
    w = (distance < radius)[..., None]
    near = points[i]
    off = w * (near - (w * near).sum(1, keepdims=True) / w.sum(1, keepdims=True))
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))
    line = (w.sum((1, 2)) >= 3) & (values[:, 0] < 0.15 * values[:, 1])
    return np.where(line[:, None], vectors[:, :, 0], np.nan)


def local_map(nodes, poses):
    """Points of some keyframes, normals of those on lines, and a tree of these."""
    points = np.concatenate([transform(x, p) for (p, _), x in zip(nodes, poses)])
    n = np.concatenate([transform([0, 0, x[2]], n) for (_, n), x in zip(nodes, poses)])
    wall = np.isfinite(n[:, 0])
    return points, n[wall], cKDTree(points[wall])


def icp(submap, scan, guess, cov, gates=(0.5, 0.2), rounds=12):
    """Pose, covariance, fit: robust distances across the walls, and the guess."""
    _, n, tree = submap
    prior, x = np.linalg.inv(cov), np.array(guess, float)
    for gate in gates:
        for _ in range(rounds):
            p = transform(x, scan)
            distance, i = tree.query(p, distance_upper_bound=gate)
            pair = distance < gate
            p, i = p[pair], i[pair]
            e = ((p - tree.data[i]) * n[i]).sum(1)
            w = (KERNEL_WIDTH**2 / (KERNEL_WIDTH**2 + e**2)) ** 2
            arm = p - x[:2]
            J = np.column_stack([n[i], arm[:, 0] * n[i, 1] - arm[:, 1] * n[i, 0]])
            H = (J.T * w) @ J / NOISE**2 + prior
            step = -np.linalg.solve(H, J.T @ (w * e) / NOISE**2 + prior @ (x - guess))
            x += step
            if np.abs(step).max() < 1e-4:
                break
    fit = w.sum() / max(len(scan), 1)
    x[2] = wrap(x[2])
    return x, np.linalg.inv(H) + MIN_COV, fit


# 4. Search: all poses of a window at once, by the FFT.
def likelihood_field(points, centre, half, cell):
    """1 at the points, a Gaussian of one cell beside; a square about the centre."""
    n = fft.next_fast_len(int(2 * half / cell) + 2, True)
    ij = np.floor((points - centre + half) / cell).astype(int)
    empty = np.ones((n, n), bool)
    empty[tuple(ij[((ij >= 0) & (ij < n)).all(1)].T)] = False
    return np.exp(-0.5 * ndimage.distance_transform_edt(empty) ** 2).astype(np.float32)


def search(points, scan, guess, radius, turn, step=np.deg2rad(1.5), cell=0.1):
    """Best pose of the window, its score, and the second peak as a share of it."""
    half = np.hypot(*scan.T).max() + radius  # reach of a shifted scan: no wrap-around
    field = likelihood_field(points, guess[:2], half, cell)
    angles = np.arange(-turn, turn + 0.5 * step, step)
    images = np.zeros((len(angles), *field.shape), np.float32)
    for image, angle in zip(images, angles):
        ij = np.floor(transform([half, half, guess[2] + angle], scan) / cell)
        np.add.at(image, tuple(ij.T.astype(int)), 1.0 / len(scan))
    product = fft.rfft2(field) * np.conj(fft.rfft2(images))
    m = int(radius / cell)
    scores = np.roll(fft.irfft2(product, s=field.shape), (m, m), (1, 2))
    scores = scores[:, : 2 * m + 1, : 2 * m + 1]
    a, i, j = np.unravel_index(scores.argmax(), scores.shape)
    best = scores[a, i, j]
    rows, columns = np.indices(scores.shape[1:])
    far = np.hypot(rows - i, columns - j) * cell > SECOND_PEAK_DISTANCE
    second_peak = scores[:, far].max() / max(best, 1e-6) if far.any() else 0.0
    return guess + [cell * (i - m), cell * (j - m), angles[a]], best, second_peak


# 5. Front end: where is this scan among the last keyframes?
def propagate(x, cov, u, Q):
    """Pose and covariance after a step u of the odometry, of covariance Q."""
    R = rotation(x[2])
    dx, dy, _ = R @ u
    F = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1.0]])
    return compose(x, u), F @ cov @ F.T + ODOMETRY_INFLATION * R @ Q @ R.T


def track(submap, scan, guess, cov):
    """Pose and covariance; the guess itself if the scan fits nowhere."""
    x, new, fit = icp(submap, scan, guess, cov)
    if fit < 0.5:
        y, _, _ = search(submap[0], scan, guess, 1.0, np.deg2rad(15))
        y, other, better = icp(submap, scan, y, cov + np.diag([0.3, 0.3, 0.1]) ** 2)
        if better > fit + 0.1:
            x, new, fit = y, other, better
    return (x, new) if fit > 0.25 else (guess, cov)


# 6. Loop closures: which old places to try, and which matches to accept.
def candidates(k, poses, travel, since):
    """Nearest old node and nearest node of the oldest pass; radius of the search."""
    radius = min(MIN_RADIUS + RADIUS_GROWTH * since, MAX_RADIUS)
    old = np.searchsorted(travel, travel[k] - MIN_LOOP)
    distance = np.hypot(*(poses[:old, :2] - poses[k, :2]).T)
    near = np.flatnonzero(distance < radius)
    if len(near) == 0:
        return [], radius
    first = np.split(near, np.flatnonzero(np.diff(travel[near]) > MIN_LOOP) + 1)[0]
    return {int(some[distance[some].argmin()]) for some in (near, first)}, radius


def verify(j, k, radius, nodes, poses, travel):
    """Match the scans around node k with the place of node j; None if unclear."""
    around = range(max(k - N_AROUND, 0), min(k + N_AROUND + 1, len(nodes)))
    merged = [transform(between(poses[k], poses[n]), nodes[n][0]) for n in around]
    scan = voxel_downsample(np.concatenate(merged), 0.2)
    scan = scan[np.hypot(*scan.T) < SEARCH_RANGE]
    ends = travel[j] - SUBMAP_LENGTH, travel[j] + SUBMAP_LENGTH
    place = range(*np.searchsorted(travel, ends))
    submap = local_map([nodes[n] for n in place], poses[place])
    x, score, second_peak = search(submap[0], scan, poses[k], radius, SEARCH_ANGLE)
    if score < MIN_SCORE or second_peak > MAX_SECOND_PEAK:
        return None
    y, cov, fit = icp(submap, nodes[k][0], x, np.diag([0.5, 0.5, 0.1]) ** 2, (0.5, 0.2))
    if fit < 0.4 or np.hypot(*(y - x)[:2]) > 0.4:
        return None
    R = rotation(-poses[j, 2])
    return j, k, between(poses[j], y), R @ (4 * cov) @ R.T, score


def is_consistent(one, others, poses, travel):
    """Whether enough other closures near both ends agree with this one."""
    (j, k, z), agree, near = one[:3], 0, 0
    for a, b, other, *_ in others:
        path = abs(travel[a] - travel[j]) + abs(travel[b] - travel[k])
        if (a, b) == (j, k) or path > CONSISTENCY_SPAN:
            continue
        by_one = compose(z, between(poses[k], poses[b]))
        by_other = compose(between(poses[j], poses[a]), other)
        dx, dy, turn = between(by_one, by_other)
        near_enough = np.hypot(dx, dy) < 0.25 + 0.02 * path
        agree += near_enough and abs(turn) < np.deg2rad(2 + 0.15 * path)
        near += 1
    return agree >= MIN_CONSISTENT and 2 * agree >= near


# 7. Pose graph: Gauss-Newton on sparse normal equations, robust closures.
def residuals(poses, i, j, z):
    """Errors (m, 3) of edges i -> j measured as z; derivatives (m, 3, 6)."""
    d = between(poses[i], poses[j])
    c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
    J = np.zeros((len(i), 3, 6))
    J[:, 0, 3], J[:, 0, 4], J[:, 1, 3], J[:, 1, 4], J[:, 2, 5] = c, s, -s, c, 1.0
    J[:, :, :3] = -J[:, :, 3:]
    J[:, 0, 2], J[:, 1, 2] = d[:, 1], -d[:, 0]
    e = d - z
    e[:, 2] = wrap(e[:, 2])
    return e, J


def solve(poses, edges, z, covs, robust, rounds=5):
    """Poses after Gauss-Newton, first pose fixed; chi2 of each edge."""
    poses, (i, j) = poses.copy(), np.transpose(edges)
    root = np.swapaxes(np.linalg.cholesky(np.linalg.inv(covs)), 1, 2)
    rows = np.arange(3 * len(i)).reshape(-1, 3, 1).repeat(6, 2)
    columns = np.concatenate([3 * i[:, None] + range(3), 3 * j[:, None] + range(3)], 1)
    places = rows.ravel(), columns[:, None].repeat(3, 1).ravel()
    for width in KERNEL_WIDTHS:
        for _ in range(rounds):
            e, J = residuals(poses, i, j, z)
            e = (root @ e[:, :, None])[..., 0]
            chi2 = (e**2).sum(1)
            w = np.where(robust, width / (width + chi2), 1.0)  # root of the weight
            values = w[:, None, None] * (root @ J)
            J = sparse.csr_matrix((values.ravel(), places))[:, 3:]
            step = -splu((J.T @ J).tocsc()).solve(J.T @ (w[:, None] * e).ravel())
            poses[1:] += step.reshape(-1, 3)
            if np.abs(step).max() < 1e-3:
                break
    return poses, chi2


def optimize(poses, chain, closures):
    """Poses after the chain and the closures were weighed against each other."""
    edges = [(n, n + 1) for n in range(len(chain))] + [one[:2] for one in closures]
    z = np.array([z for z, _ in chain] + [one[2] for one in closures])
    covs = np.array([c for _, c in chain] + [one[3] for one in closures])
    return solve(poses, edges, z, covs, np.arange(len(z)) >= len(chain))[0]


# 8. Occupancy map.
def occupancy(ranges, angles, poses, cell=0.1, hit=0.9, miss=-0.4):
    """Log odds (rows y, columns x) and the lower left corner."""
    low = poses[:, :2].min(0) - MAX_RANGE
    shape = ((poses[:, :2].max(0) + MAX_RANGE - low) / cell).astype(int) + 1
    odds = np.zeros(shape[0] * shape[1])
    steps = np.arange(0.0, MAX_RANGE, cell)
    for r, (x, y, heading) in zip(ranges, poses):
        ends = np.where(r < MAX_RANGE, r, 0.0)
        way = np.stack([np.cos(heading + angles), np.sin(heading + angles)], -1)
        along = steps[None, :, None] * way[:, None] + [x, y] - low
        free = along[steps < ends[:, None] - cell]
        wall = (ends[:, None] * way + [x, y] - low)[ends > 0]
        for seen, value in ((free, miss), (wall, hit)):
            cells = np.unique((seen / cell).astype(int) @ [shape[1], 1])
            odds[cells] = np.clip(odds[cells] + value, -5.0, 5.0)
    return odds.reshape(shape).T, low


# 9. The loop over a log.
def slam(ranges, angles, odometry, covs, loops=True):
    """Poses (T, 3) of all scans; accepted closures; node of each scan, pose there."""
    x, cov, nodes, submap = np.zeros(3), np.zeros((3, 3)), [], None
    poses, travel = np.zeros((0, 3)), np.zeros(0)
    chain, steps, pending, accepted, last_tried, last_closed = [], [], [], [], 0.0, 0.0
    for r, u, Q in zip(ranges, odometry, covs):
        x, cov = propagate(x, cov, u, Q)
        scan = scan_points(r, angles)
        if nodes and len(scan) >= 10:
            x, cov = track(submap, scan, x, cov + MIN_COV)
        off = between(poses[-1], x) if nodes else x
        far = np.hypot(*off[:2]) > NEW_KEYFRAME[0] or abs(off[2]) > NEW_KEYFRAME[1]
        if len(scan) >= 10 and (far or not nodes):
            if nodes:
                R = rotation(-poses[-1, 2])
                chain.append((off, R @ cov @ R.T + MIN_COV))
            way = np.hypot(*off[:2]) + (travel[-1] if nodes else 0.0)
            travel = np.append(travel, way)
            nodes.append((scan, estimate_normals(scan)))
            poses, cov, off = np.vstack([poses, x]), np.zeros((3, 3)), np.zeros(3)
            k = len(nodes) - 1 - N_AROUND
            if loops and k > 0 and travel[k] - last_tried > CLOSURE_SPACING:
                last_tried = travel[k]
                old, radius = candidates(k, poses, travel, travel[k] - last_closed)
                new = [verify(j, k, radius, nodes, poses, travel) for j in old]
                pending += [one for one in new if one]
                every = pending + accepted
                fresh = [p for p in pending if is_consistent(p, every, poses, travel)]
                if fresh:
                    pending = [p for p in pending if not any(p is f for f in fresh)]
                    accepted, last_closed = accepted + fresh, travel[k]
                    poses = optimize(poses, chain, accepted)
                    x = poses[-1]
            submap = local_map(nodes[-KEYFRAMES:], poses[-KEYFRAMES:])
        steps.append((len(nodes) - 1, off))
    return np.array([compose(poses[n], off) for n, off in steps]), accepted, steps
