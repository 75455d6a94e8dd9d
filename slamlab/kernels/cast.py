"""Beams through cells and against segments: the compiled loops under `cast`.

A beam is walked from grid line to grid line (Amanatides and Woo 1987); where the chessboard
distance to the nearest occupied cell allows it, it jumps instead. Chapter 06 derives both.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit

# A jump ends this far (cells) short of its safe square, which is far more than any rounding.
_SHORT = 1e-9
# A beam that passes a corner at this distance (cells) or less goes through the corner: blocked if
# the cells on both sides are occupied, free otherwise.
_TOUCH = 1e-9
# Directions this close to an axis run along it: the cosine of a quarter turn is 6e-17, not 0.
_AXIS = 1e-12


@njit(cache=True)
def cast_grid(skip, x, y, angles, max_range, out):  # type: ignore[no-untyped-def]
    """Ranges (cells) of beams through a grid; infinite where a beam met nothing.

    `skip` (rows, columns) is the chessboard distance to the nearest occupied cell, 0 in one.
    """
    for i in range(len(out)):
        out[i] = _beam(skip, x[i], y[i], np.cos(angles[i]), np.sin(angles[i]), max_range[i])


@njit(cache=True)
def _beam(skip, x, y, dx, dy, max_range):  # type: ignore[no-untyped-def]
    rows, columns = skip.shape
    dx, dy = (dx if abs(dx) > _AXIS else 0.0), (dy if abs(dy) > _AXIS else 0.0)
    inv_x = 1.0 / dx if dx != 0.0 else np.inf
    inv_y = 1.0 / dy if dy != 0.0 else np.inf
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    # The grid line ahead is the cell's far side.
    ahead_x, ahead_y = (1 if dx > 0 else 0), (1 if dy > 0 else 0)
    per_cell = 1.0 / max(abs(dx), abs(dy))
    t = _entry(x, y, dx, dy, inv_x, inv_y, rows, columns)
    if not t <= max_range:
        return np.inf
    c, r = int(np.floor(x + t * dx)), int(np.floor(y + t * dy))
    if t > 0.0 or c == columns or r == rows:
        c, r = min(max(c, 0), columns - 1), min(max(r, 0), rows - 1)
    while t <= max_range:
        free = int(skip[r, c])
        if free == 0:
            return t
        if free > 1:
            # All cells nearer than `free` are empty: nothing can be met on the way.
            t += (free - 1) * per_cell - _SHORT
            c, r = int(np.floor(x + t * dx)), int(np.floor(y + t * dy))
        else:
            t_x = (c + ahead_x - x) * inv_x if dx != 0.0 else np.inf
            t_y = (r + ahead_y - y) * inv_y if dy != 0.0 else np.inf
            corner = abs(t_x - t_y) <= _TOUCH
            if corner and _corner_is_shut(skip, r, c, step_x, step_y):
                return t_x if t_x <= max_range else np.inf
            # A start on a grid line may cross it late, after a jump: never step back.
            t = max(t, max(t_x, t_y) if corner else min(t_x, t_y))
            if t_x < t_y or corner:
                c += step_x
            if t_y < t_x or corner:
                r += step_y
        if c < 0 or c >= columns or r < 0 or r >= rows:
            return np.inf
    return np.inf


@njit(cache=True)
def _corner_is_shut(skip, r, c, step_x, step_y):  # type: ignore[no-untyped-def]
    """Tell whether the two cells beside the corner ahead are both occupied."""
    rows, columns = skip.shape
    if not (0 <= c + step_x < columns and 0 <= r + step_y < rows):
        return False
    return skip[r, c + step_x] == 0 and skip[r + step_y, c] == 0


@njit(cache=True)
def _entry(x, y, dx, dy, inv_x, inv_y, rows, columns):  # type: ignore[no-untyped-def]
    """Distance at which a beam enters the grid: 0 if it starts there, inf if it passes by."""
    if 0 <= x < columns and 0 <= y < rows:
        return 0.0
    near, far = 0.0, np.inf
    for p, d, inv, size in ((x, dx, inv_x, columns), (y, dy, inv_y, rows)):
        if d == 0.0:
            if not 0 <= p < size:
                return np.inf
            continue
        a, b = -p * inv, (size - p) * inv
        near, far = max(near, min(a, b)), min(far, max(a, b))
    # From farther away than a billion cells rounding would choose the cell.
    return near if near < min(far, 1e9) else np.inf


@njit(cache=True)
def cast_everywhere(skip, angle, max_range, stride, out):  # type: ignore[no-untyped-def]
    """Ranges (cells) in one direction from the centres of every `stride`-th cell.

    All beams of one direction cross the same pattern of cells, shifted: it is found once, and
    then every beam only looks up and jumps.
    """
    rows, columns = skip.shape
    pattern = _pattern(angle, rows, columns)
    steps = (1 if np.cos(angle) > 0 else -1), (1 if np.sin(angle) > 0 else -1)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = _follow(skip, i * stride, j * stride, pattern, steps, max_range)


@njit(cache=True)
def _pattern(angle, rows, columns):  # type: ignore[no-untyped-def]
    """Cells (k, 2: row, column) from a cell's centre on, distances, shut corners, first rows."""
    dx, dy = np.cos(angle), np.sin(angle)
    most = rows + columns + 4
    cells = np.zeros((most, 2), np.int64)
    ts, corner = np.zeros(most), np.zeros(most, np.bool_)
    # first[0, m]: number of the first cell m columns away; first[1, m]: m rows away.
    first = np.full((2, max(rows, columns) + 3), most)
    c = r = 0
    inv_x = 1.0 / abs(dx) if dx != 0.0 else np.inf
    inv_y = 1.0 / abs(dy) if dy != 0.0 else np.inf
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    k = 0
    while c <= columns and r <= rows and k < most - 1:
        t_x = (c + 0.5) * inv_x if dx != 0.0 else np.inf
        t_y = (r + 0.5) * inv_y if dy != 0.0 else np.inf
        k += 1
        corner[k] = abs(t_x - t_y) <= _TOUCH
        ts[k] = min(t_x, t_y)
        if t_x < t_y or corner[k]:
            c += 1
            first[0, c] = k
        if t_y < t_x or corner[k]:
            r += 1
            first[1, r] = k
        cells[k, 0], cells[k, 1] = r * step_y, c * step_x
    # Columns and rows that the pattern does not reach lie behind its end.
    return cells[: k + 1], ts[: k + 1], corner[: k + 1], np.minimum(first, k + 1)


@njit(cache=True)
def _follow(skip, row, column, pattern, steps, max_range):  # type: ignore[no-untyped-def]
    """Range (cells) of one beam that follows the pattern from a cell's centre."""
    cells, ts, corner, first = pattern
    rows, columns = skip.shape
    k, last, size = 0, len(ts) - 1, first.shape[1] - 1
    while k <= last:
        r, c = row + cells[k, 0], column + cells[k, 1]
        if corner[k] and 0 <= r - steps[1] < rows and 0 <= c - steps[0] < columns:
            if _corner_is_shut(skip, r - steps[1], c - steps[0], steps[0], steps[1]):
                return ts[k] if ts[k] <= max_range else np.inf
        if r < 0 or r >= rows or c < 0 or c >= columns or ts[k] > max_range:
            return np.inf
        free = int(skip[r, c])
        if free == 0:
            return ts[k]
        # The first cell of the pattern that is `free` columns or rows away may be occupied.
        m, n = abs(cells[k, 1]) + free, abs(cells[k, 0]) + free
        k = min(first[0, min(m, size)], first[1, min(n, size)])
    return np.inf


@njit(cache=True)
def cast_segments(segments, x, y, angles, out):  # type: ignore[no-untyped-def]
    """Distances at which beams meet segments (k, 2, 2); infinite where they meet none."""
    for i in range(len(out)):
        dx, dy = np.cos(angles[i]), np.sin(angles[i])
        nearest = np.inf
        for segment in segments:
            nearest = min(nearest, _meet(segment, x[i], y[i], dx, dy))
        out[i] = nearest


@njit(cache=True)
def _meet(segment, x, y, dx, dy):  # type: ignore[no-untyped-def]
    """Solve origin + t d = a + u e for 0 <= t, 0 <= u <= 1."""
    ax, ay = segment[0, 0] - x, segment[0, 1] - y
    ex, ey = segment[1, 0] - segment[0, 0], segment[1, 1] - segment[0, 1]
    length = np.hypot(ex, ey)
    cross = dx * ey - dy * ex
    if abs(cross) < 1e-12 * length:
        # Along the wall: met end on if the beam's line is the wall's.
        if abs(dx * ay - dy * ax) > 1e-9:
            return np.inf
        t0, t1 = dx * ax + dy * ay, dx * (ax + ex) + dy * (ay + ey)
        if max(t0, t1) < 0.0:
            return np.inf
        return max(min(t0, t1), 0.0)
    t, u = (ax * ey - ay * ex) / cross, (ax * dy - ay * dx) / cross
    # Walls that share a corner leave no gap between them.
    slack = 1e-9 / length
    if t < -1e-12 or u < -slack or u > 1.0 + slack:
        return np.inf
    return max(t, 0.0)


@njit(cache=True)
def inside_segments(segments, points, out):  # type: ignore[no-untyped-def]
    """Tell which points (n, 2) see an odd number of walls to their right."""
    for i in range(len(points)):
        x, y = points[i]
        odd = False
        for segment in segments:
            y0, y1 = segment[0, 1], segment[1, 1]
            # Half-open, so that a corner counts once.
            if (y0 > y) != (y1 > y):
                u = (y - y0) / (y1 - y0)
                if segment[0, 0] + u * (segment[1, 0] - segment[0, 0]) > x:
                    odd = not odd
        out[i] = odd
