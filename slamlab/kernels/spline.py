"""A chain of cubics in compiled loops: points at arc lengths, the nearest point.

P3 section 4. The plain twins stand in `slamlab.navigation.spline`. Chapter 17.
"""

from __future__ import annotations

import numpy as np

from slamlab.kernels import cubic
from slamlab.kernels.compiling import njit


@njit(cache=True)
def _segment_at(starts, s):  # type: ignore[no-untyped-def]
    """Segment, of those that begin at the arc lengths `starts`, on which s lies."""
    i = np.searchsorted(starts, s, side="right") - 1
    return min(max(i, 0), len(starts) - 1)


@njit(cache=True)
def points_at(coefficients, tables, starts, s, derivative):  # type: ignore[no-untyped-def]
    """Points, or unit tangents, at the arc lengths s."""
    out = np.empty((len(s), 2))
    for row in range(len(s)):
        i = _segment_at(starts, s[row])
        c = coefficients[i]
        t = cubic.parameter_at(c, tables[i], s[row] - starts[i])
        if not derivative:
            out[row, 0], out[row, 1] = cubic.value(c, t, cubic.X), cubic.value(c, t, cubic.Y)
            continue
        dx, dy = cubic.slope(c, t, cubic.X), cubic.slope(c, t, cubic.Y)
        speed = np.hypot(dx, dy)
        out[row, 0], out[row, 1] = (dx / speed, dy / speed) if speed > 0.0 else (1.0, 0.0)
    return out


@njit(cache=True)
def nearest(coefficients, tables, starts, boxes, places, low, high):  # type: ignore[no-untyped-def]
    """Arc length and distance of the nearest point between `low` and `high` to each place."""
    s, distance = np.empty(len(places)), np.empty(len(places))
    for row in range(len(places)):
        x, y = places[row, 0], places[row, 1]
        first, last = _segment_at(starts, low[row]), _segment_at(starts, high[row])
        best, best_i, best_t = np.inf, first, 0.0
        for i in range(first, last + 1):
            box = boxes[i]
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
    return s, distance
