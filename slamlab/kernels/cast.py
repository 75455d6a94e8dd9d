"""Beams through cells: the compiled loop under `BitmapWorld.cast`.

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
def cast_grid(skip, x, y, angles, max_range):  # type: ignore[no-untyped-def]
    """Ranges (cells) of beams through a grid; infinite where a beam met nothing.

    `skip` (rows, columns) is the chessboard distance to the nearest occupied cell, 0 in one.
    """
    out = np.empty(len(x))
    for i in range(len(out)):
        out[i] = _beam(skip, x[i], y[i], np.cos(angles[i]), np.sin(angles[i]), max_range[i])
    return out


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
    if not t <= min(max_range, 1e9):
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
