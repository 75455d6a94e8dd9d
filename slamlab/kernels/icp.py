"""Compiled loops under the outlines and `match_icp`: a hash of cells, neighbours, Gauss-Newton."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.linear import solve3


@njit(cache=True)
def thinned(points, spacing):  # type: ignore[no-untyped-def]
    """Rows of the first point of every square of that spacing, in their order."""
    keep = np.zeros(len(points), np.bool_)
    if len(points) == 0:
        return np.flatnonzero(keep)
    cells = np.floor(points / spacing).astype(np.int64)
    c0, r0 = cells[:, 0].min(), cells[:, 1].min()
    columns, rows = cells[:, 0].max() - c0 + 1, cells[:, 1].max() - r0 + 1
    keys = (cells[:, 1] - r0) * columns + cells[:, 0] - c0
    if rows <= 4096 and columns <= 4096:
        seen = np.zeros(rows * columns, np.bool_)
        for k in range(len(points)):
            keep[k] = not seen[keys[k]]
            seen[keys[k]] = True
        return np.flatnonzero(keep)
    order = np.argsort(keys, kind="mergesort")
    for n in range(len(order)):
        keep[order[n]] = n == 0 or keys[order[n]] != keys[order[n - 1]]
    return np.flatnonzero(keep)


@njit(cache=True)
def hashed(points, side):  # type: ignore[no-untyped-def]
    """Sort points into squares: frame (x, y, side, columns, rows), starts, order, points in it."""
    x0, y0 = points[:, 0].min(), points[:, 1].min()
    columns = int((points[:, 0].max() - x0) / side) + 1
    rows = int((points[:, 1].max() - y0) / side) + 1
    while columns * rows > 16 * len(points) + 65536:
        side *= 2.0
        columns = int((points[:, 0].max() - x0) / side) + 1
        rows = int((points[:, 1].max() - y0) / side) + 1
    start = np.zeros(columns * rows + 1, np.int64)
    cell = np.empty(len(points), np.int64)
    for k in range(len(points)):
        cell[k] = int((points[k, 1] - y0) / side) * columns + int((points[k, 0] - x0) / side)
        start[cell[k] + 1] += 1
    start = np.cumsum(start)
    fill = start.copy()
    order, laid = np.empty(len(points), np.int64), np.empty_like(points)
    for k in range(len(points)):
        at = fill[cell[k]]
        order[at], laid[at, 0], laid[at, 1] = k, points[k, 0], points[k, 1]
        fill[cell[k]] += 1
    return (x0, y0, side, columns, rows), start, order, laid


@njit(cache=True)
def nearest(hashes, x, y, limit):  # type: ignore[no-untyped-def]
    """Row and distance of the nearest point within `limit`, else -1; and how near no other is."""
    (x0, y0, side, columns, rows), start, order, laid = hashes
    # Most points have a partner near by: a look at few squares finds it.
    for reach in (min(0.25 * side, limit), limit):
        best, least, second = -1, limit * limit, limit * limit
        left, low = max(0, int(np.floor((x - reach - x0) / side))), y - reach - y0
        right, high = min(int((x + reach - x0) / side), columns - 1), y + reach - y0
        for r in range(max(0, int(np.floor(low / side))), min(int(high / side), rows - 1) + 1):
            if left > right:
                break
            # The squares of a row follow one another.
            for n in range(start[r * columns + left], start[r * columns + right + 1]):
                d = (laid[n, 0] - x) ** 2 + (laid[n, 1] - y) ** 2
                if d < least:
                    best, least, second = n, d, least
                elif d < second:
                    second = d
        if least <= reach * reach:
            break
    return order[best] if best >= 0 else -1, np.sqrt(least), min(np.sqrt(second), reach)


@njit(cache=True)
def lines_through(points, hashes, neighbours, radius, flatness):  # type: ignore[no-untyped-def]
    """Return normals (k, 2) by total least squares, NaN off walls, and their variances (k,).

    Noise s turns the normal by s / sqrt(a), with a the sum of squares along the wall; and the sum
    of squares across it, over count - 2 degrees of freedom, estimates s^2.
    """
    (x0, y0, side, columns, rows), start, order, laid = hashes
    normals, turned = np.full((len(points), 2), np.nan), np.zeros(len(points))
    near = np.empty(neighbours, np.int64)
    far = np.empty(neighbours)
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        count = 0
        first_c, last_c = int((x - radius - x0) / side), int((x + radius - x0) / side)
        first_r, last_r = int((y - radius - y0) / side), int((y + radius - y0) / side)
        for r in range(max(first_r, 0), min(last_r, rows - 1) + 1):
            for c in range(max(first_c, 0), min(last_c, columns - 1) + 1):
                for n in range(start[r * columns + c], start[r * columns + c + 1]):
                    d = (laid[n, 0] - x) ** 2 + (laid[n, 1] - y) ** 2
                    if d > radius * radius or (count == neighbours and d >= far[count - 1]):
                        continue
                    if count < neighbours:
                        count += 1
                    at = count - 1
                    while at > 0 and far[at - 1] > d:
                        near[at], far[at] = near[at - 1], far[at - 1]
                        at -= 1
                    near[at], far[at] = order[n], d
        if count < 3:
            continue
        mx, my = 0.0, 0.0
        for n in range(count):
            mx += points[near[n], 0] / count
            my += points[near[n], 1] / count
        xx, xy, yy = 0.0, 0.0, 0.0
        for n in range(count):
            dx, dy = points[near[n], 0] - mx, points[near[n], 1] - my
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        half, root = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        if half + root <= 0.0 or half - root > flatness * (half + root):
            continue
        # The normal stands across the direction of the larger eigenvalue.
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        normals[k, 0], normals[k, 1] = -np.sin(angle), np.cos(angle)
        turned[k] = max(half - root, 0.0) / (half + root) / (count - 2)
    return normals, turned


@njit(cache=True)
def _pairs(reference, hashes, points, pose, gate, pair, places):  # type: ignore[no-untyped-def]
    """Nearest reference point of each moved point, -1 beyond the gate; returns how many.

    `places` (k, 3) says where each point was when its partner was looked for, and how near no
    other was. While others cannot have come nearer than the partner, nobody looks again.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    count = 0
    for k in range(len(points)):
        x = c * points[k, 0] - s * points[k, 1] + pose[0]
        y = s * points[k, 0] + c * points[k, 1] + pose[1]
        others = places[k, 2] - np.sqrt((x - places[k, 0]) ** 2 + (y - places[k, 1]) ** 2)
        j, d = pair[k], gate
        if j >= 0:
            d = np.sqrt((x - reference[j, 0]) ** 2 + (y - reference[j, 1]) ** 2)
        if (j >= 0 and d >= gate) or d > others:
            # A little beyond the gate: who finds nobody there may move a little unasked.
            j, d, others = nearest(hashes, x, y, 1.1 * gate)
            if d >= gate:
                j, others = -1, d
            pair[k], places[k, 0], places[k, 1], places[k, 2] = j, x, y, others
        count += j >= 0
    return count


@njit(cache=True)
def icp_equations(reference, normals, points, pose, pair, width, line, H, g):  # type: ignore[no-untyped-def]
    """J^T w J and -J^T w e of all pairs; returns sums: (w, w e^2, 1, w^2, w^2 e^2, psi').

    psi' is the derivative of w e, by which a robust fit is less sure than its weights say.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    H[:], g[:] = 0.0, 0.0
    J = np.empty((2, 3))
    e = np.empty(2)
    sums = np.zeros(6)
    for k in range(len(points)):
        j = pair[k]
        if j < 0:
            continue
        px, py = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        dx, dy = px + pose[0] - reference[j, 0], py + pose[1] - reference[j, 1]
        n_rows = _rows(line, normals[j, 0], normals[j, 1], px, py, dx, dy, J, e)
        e2 = e[0] ** 2 + e[1] ** 2
        w = (width**2 / (width**2 + e2)) ** 2  # Geman and McClure
        for q in range(n_rows):
            for i in range(3):
                g[i] -= w * J[q, i] * e[q]
                for m in range(3):
                    H[i, m] += w * J[q, i] * J[q, m]
        slope = w * (width**2 - 3.0 * e2) / (width**2 + e2)
        for i, term in enumerate((w, w * e2, 1.0, w * w, w * w * e2, slope)):
            sums[i] += term
    return sums


@njit(cache=True)
def _rows(line, nx, ny, px, py, dx, dy, J, e):  # type: ignore[no-untyped-def]
    """Error and Jacobian of one pair: n . (R p + t - q), or both coordinates of R p + t - q."""
    if line:
        e[0], e[1] = nx * dx + ny * dy, 0.0
        J[0, 0], J[0, 1], J[0, 2] = nx, ny, ny * px - nx * py
        return 1
    e[0], e[1] = dx, dy
    J[0, 0], J[0, 1], J[0, 2] = 1.0, 0.0, -py
    J[1, 0], J[1, 1], J[1, 2] = 0.0, 1.0, px
    return 2


@njit(cache=True)
def iterate(reference, normals, hashes, points, pose, width, gates, n_iterations, line, pair):  # type: ignore[no-untyped-def]
    """Pair and step, first with the wide gate, then with the narrow one; `pose` is moved.

    False if the points hold no pose.
    """
    H, g, step = np.empty((3, 3)), np.empty(3), np.zeros(3)
    places = np.zeros((len(points), 3))
    for gate in gates:
        for _ in range(n_iterations):
            if _pairs(reference, hashes, points, pose, gate, pair, places) < 3:
                return False
            icp_equations(reference, normals, points, pose, pair, width, line, H, g)
            # Next to nothing on the diagonal keeps a direction that no wall holds where it is.
            little = 1e-9 * (H[0, 0] + H[1, 1])
            for i in range(3):
                H[i, i] += little
            if not solve3(H, g, step):
                return False
            pose += step
            if abs(step[0]) + abs(step[1]) < 1e-6 and abs(step[2]) < 1e-7:
                break
    return _pairs(reference, hashes, points, pose, gates[-1], pair, places) >= 3


@njit(cache=True)
def noise_of(  # type: ignore[no-untyped-def]
    reference, normals, turned, points, pose, pair, width, line, axes, noise, blur, shares
):
    """Sum up what the covariance is made of.

    `noise` (3, 3): what unit noise of the points and of the reference, whose points serve several
    pairs, puts into J^T w e. `blur` (3, 3): the information that the noise of the normals
    pretends. `shares` (2, 3): sums of h and h^2, h a pair's information along each of the `axes`.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    J = np.empty((2, 3))
    e = np.empty(2)
    shared = np.zeros((len(reference), 2, 3))
    noise[:], blur[:], shares[:] = 0.0, 0.0, 0.0
    for k in range(len(points)):
        j = pair[k]
        if j < 0:
            continue
        px, py = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        dx, dy = px + pose[0] - reference[j, 0], py + pose[1] - reference[j, 1]
        nx, ny = normals[j, 0], normals[j, 1]
        n_rows = _rows(line, nx, ny, px, py, dx, dy, J, e)
        w = (width**2 / (width**2 + e[0] ** 2 + e[1] ** 2)) ** 2
        for q in range(n_rows):
            for i in range(3):
                shared[j, q, i] += w * J[q, i]
                for m in range(3):
                    noise[i, m] += w * w * J[q, i] * J[q, m]
        for m in range(3):
            h = 0.0
            for q in range(n_rows):
                h += w * (J[q, 0] * axes[0, m] + J[q, 1] * axes[1, m] + J[q, 2] * axes[2, m]) ** 2
            shares[0, m] += h
            shares[1, m] += h * h
        if line:
            T = (-ny, nx, nx * px + ny * py)
            for i in range(3):
                for m in range(3):
                    blur[i, m] += w * turned[j] * T[i] * T[m]
    for j in range(len(reference)):
        for q in range(2):
            for i in range(3):
                for m in range(3):
                    noise[i, m] += shared[j, q, i] * shared[j, q, m]
