"""A chain of cubics in compiled loops: tables of arc length, points, the nearest point.

P3 sections 3 and 4. Chapter 17.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels import cubic
from slamlab.kernels.boxes import set_box
from slamlab.kernels.compiling import njit


@njit(cache=True)
def refresh(coefficients, tables, starts, boxes, i):  # type: ignore[no-untyped-def]
    """Renew what depends on the coefficients of the last segment i."""
    cubic.fill_table(coefficients[i], tables[i])
    starts[i + 1] = starts[i] + tables[i, cubic.PIECES]
    set_box(boxes, coefficients, i, i + 1)


@njit(cache=True)
def segment_at(starts, n, s):  # type: ignore[no-untyped-def]
    """Segment, of n that begin at the arc lengths `starts`, on which s lies."""
    i = np.searchsorted(starts[:n], s, side="right") - 1
    return min(max(i, 0), n - 1)


@njit(cache=True)
def points(coefficients, tables, starts, n, s, derivative, out):  # type: ignore[no-untyped-def]
    """Points, or unit tangents, at the arc lengths s."""
    for row in range(len(s)):
        i = segment_at(starts, n, s[row])
        c = coefficients[i]
        t = cubic.parameter_at(c, tables[i], s[row] - starts[i])
        if not derivative:
            out[row, 0], out[row, 1] = cubic.value(c, t, cubic.X), cubic.value(c, t, cubic.Y)
            continue
        dx, dy = cubic.slope(c, t, cubic.X), cubic.slope(c, t, cubic.Y)
        speed = np.hypot(dx, dy)
        out[row, 0], out[row, 1] = (dx / speed, dy / speed) if speed > 0.0 else (1.0, 0.0)


@njit(cache=True)
def nearest(coefficients, tables, starts, boxes, n, points, low, high, s, distance):  # type: ignore[no-untyped-def]
    """Arc length and distance of the nearest place between `low` and `high` of each point."""
    half = len(boxes) // 2
    for row in range(len(points)):
        x, y = points[row, 0], points[row, 1]
        first, last = segment_at(starts, n, low[row]), segment_at(starts, n, high[row])
        best, best_i, best_t = np.inf, first, 0.0
        for i in range(first, last + 1):
            box = boxes[half + i]
            away_x = max(box[0] - x, 0.0, x - box[2])
            away_y = max(box[1] - y, 0.0, y - box[3])
            if away_x * away_x + away_y * away_y >= best:
                continue
            a, b = 0.0, 1.0
            if i == first:
                a = cubic.parameter_at(coefficients[i], tables[i], low[row] - starts[i])
            if i == last:
                b = cubic.parameter_at(coefficients[i], tables[i], high[row] - starts[i])
            t, squared = cubic.nearest_parameter(coefficients[i], x, y, a, b)
            if squared < best:
                best, best_i, best_t = squared, i, t
        at = starts[best_i] + cubic.length_to(coefficients[best_i], tables[best_i], best_t)
        s[row] = min(max(at, low[row]), high[row])
        distance[row] = np.sqrt(best)
