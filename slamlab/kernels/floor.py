"""Cells that a scan frees or occupies, ways over free cells, unknown area: compiled loops.

Coordinates are in cells. Chapters 18 and 20.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.floor_rules import (
    FREE,
    MOST_PASSES,
    OCCUPIED,
    THROUGH,
    UNKNOWN,
    WALL_STEP,
    WIDEST_WEDGE,
)


@njit(cache=True)
def mark_walls(state, passes, x, y, heading, angles, reach, met):  # type: ignore[no-untyped-def]
    """Mark the cells in which beams ended, and those between two ends that are neighbours."""
    n, rows, columns = len(angles), state.shape[0], state.shape[1]
    for i in range(n):
        if not met[i]:
            continue
        # A little behind the surface: on a grid line the free side must not be blamed.
        a, r = heading + angles[i], reach[i] + 0.02
        x0, y0 = x + r * np.cos(a), y + r * np.sin(a)
        steps, x1, y1 = 0, x0, y0
        j = (i + 1) % n
        if met[j]:
            a, r = heading + angles[j], reach[j] + 0.02
            x1, y1 = x + r * np.cos(a), y + r * np.sin(a)
            length = np.hypot(x1 - x0, y1 - y0)
            if length <= WALL_STEP:
                steps = int(2 * length) + 1
        for k in range(steps + 1):
            u = k / steps if steps else 0.0
            column = int(np.floor(x0 + u * (x1 - x0)))
            row = int(np.floor(y0 + u * (y1 - y0)))
            if 0 <= row < rows and 0 <= column < columns:
                state[row, column], passes[row, column] = OCCUPIED, 0


@njit(cache=True)
def mark_free(state, passes, x, y, heading, angles, reach):  # type: ignore[no-untyped-def]
    """Mark cells whose centre lies nearer than the ends of both beams beside it."""
    n = len(angles)
    left, right = _spans(state.shape, x, y, heading, angles, reach)
    for row in range(len(left)):
        for column in range(left[row], right[row]):
            if state[row, column] == FREE:
                continue
            dx, dy = column + 0.5 - x, row + 0.5 - y
            angle = np.arctan2(dy, dx) - heading
            angle -= 2 * np.pi * np.rint(angle / (2 * np.pi))
            after = np.searchsorted(angles, angle) % n
            before = after - 1 if after > 0 else n - 1
            wedge = angles[after] - angles[before]
            if wedge <= 0:
                wedge += 2 * np.pi
            distance, end = np.hypot(dx, dy), min(reach[before], reach[after])
            if state[row, column] == UNKNOWN:
                if distance <= end and wedge <= WIDEST_WEDGE:
                    state[row, column] = FREE
            # Nothing as large as the cell hides between two beams less than a cell apart.
            elif distance <= end - THROUGH and distance * wedge <= 1.0:
                passes[row, column] += 1
                if passes[row, column] == MOST_PASSES:
                    state[row, column] = FREE


@njit(cache=True)
def _spans(shape, x, y, heading, angles, reach):  # type: ignore[no-untyped-def]
    """Row by row the first column in reach of a wedge between two beams, and that after the last.

    A wedge lies in the box round its three corners, and all boxes hold the sensor. So a box is
    noted in its lowest and its highest row, and those between have what the rows outside have.
    """
    rows, columns = shape
    left, right = np.full(rows, columns), np.zeros(rows, np.int64)
    # A wedge too wide for unknown cells may still raise doubts about occupied ones right here.
    near = 1.0 + 1.0 / WIDEST_WEDGE
    _hold(left, right, columns, (x - near, x + near, y - near, y + near))
    for after in range(len(angles)):
        before = after - 1 if after > 0 else len(angles) - 1
        wedge = angles[after] - angles[before]
        if (wedge if wedge > 0 else wedge + 2 * np.pi) > WIDEST_WEDGE:
            continue
        end, a, b = min(reach[before], reach[after]), angles[before], angles[after]
        px, py = x + end * np.cos(heading + a), y + end * np.sin(heading + a)
        qx, qy = x + end * np.cos(heading + b), y + end * np.sin(heading + b)
        # An arc bulges by less than 0.6 % of its radius beyond its ends.
        pad = 1.0 + 0.006 * end
        beside = min(x, px, qx) - pad, max(x, px, qx) + pad
        _hold(left, right, columns, (*beside, min(y, py, qy) - pad, max(y, py, qy) + pad))
    sensor_row = min(max(int(np.floor(y)), 0), rows - 1)
    for row in range(rows - 1, sensor_row, -1):
        _widen(left, right, row - 1, left[row], right[row])
    for row in range(sensor_row):
        _widen(left, right, row + 1, left[row], right[row])
    return left, right


@njit(cache=True)
def _hold(left, right, columns, box):  # type: ignore[no-untyped-def]
    """Note a box (x low, x high, y low, y high) in its lowest and its highest row."""
    first = max(int(np.floor(box[0])), 0)
    last = min(int(np.floor(box[1])) + 1, columns)
    for y in box[2:]:
        _widen(left, right, min(max(int(np.floor(y)), 0), len(left) - 1), first, last)


@njit(cache=True)
def _widen(left, right, row, first, last):  # type: ignore[no-untyped-def]
    left[row], right[row] = min(left[row], first), max(right[row], last)


@njit(cache=True)
def wavefront(fits, row, column, lengths, parents):  # type: ignore[no-untyped-def]
    """Lengths (cells) of the shortest eight-connected ways, and the cell before each.

    SciPy's `dijkstra` gives the same lengths (a test holds that) and takes 5 to 18 times as long,
    most of it to build its graph anew for every floor.
    """
    rows, columns = fits.shape
    size = rows * columns
    queue, waiting = np.empty(size, dtype=np.int32), np.zeros(size, dtype=np.bool_)
    queue[0], head, count = row * columns + column, 0, 1
    lengths[row, column] = 0.0
    while count:
        cell = queue[head]
        head, count = (head + 1) % size, count - 1
        waiting[cell] = False
        r, c = cell // columns, cell % columns
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                i, j = r + dr, c + dc
                if not (0 <= i < rows and 0 <= j < columns) or not fits[i, j]:
                    continue
                # A diagonal step must not cut a corner.
                if dr != 0 and dc != 0 and not (fits[r, j] and fits[i, c]):
                    continue
                length = lengths[r, c] + np.sqrt(float(dr * dr + dc * dc))
                if length < lengths[i, j] - 1e-9:
                    lengths[i, j], parents[i, j] = length, cell
                    if not waiting[i * columns + j]:
                        waiting[i * columns + j] = True
                        queue[(head + count) % size] = i * columns + j
                        count += 1


@njit(cache=True)
def unknown_area(state, points, reach, n_rays, out):  # type: ignore[no-untyped-def]
    """Unknown area (cells) around each point, sector by sector up to the first occupied cell."""
    rows, columns = state.shape
    width = 2 * np.pi / n_rays
    for i in range(len(points)):
        for k in range(n_rays):
            dx, dy = np.cos(k * width), np.sin(k * width)
            r = 0.5
            while r <= reach:
                row = int(np.floor(points[i, 1] + r * dy))
                column = int(np.floor(points[i, 0] + r * dx))
                inside = 0 <= row < rows and 0 <= column < columns
                if not inside or state[row, column] == OCCUPIED:
                    break
                if state[row, column] == UNKNOWN:
                    out[i] += r * width
                r += 1.0
