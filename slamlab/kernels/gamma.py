"""Compiled loops under Gamma-SLAM: sort a picture into cells and weigh it, for each particle.

Cells lie in tiles as in `_grid_kernels`. Kept of a cell are its degrees of freedom (the sum of nu)
and its squares (the sum of nu s^2): alpha = alpha0 + freedom / 2, beta = beta0 + squares / 2.
"""

from __future__ import annotations

import math

import numpy as np

from slamlab.kernels.compiling import njit

SHIFT = 4  # a tile is 2^4 = 16 cells wide
INSIDE = (1 << SHIFT) - 1
FREEDOM, SQUARES = range(2)
COUNT, SUM, SQUARE = range(3)
LOG_2_PI = math.log(2 * math.pi)


@njit(cache=True)
def gather(points, heights, poses, frame, corners, out):  # type: ignore[no-untyped-def]
    """Sort points (k, 2, in the body) into the cells round each pose: nu and nu s^2 of each.

    `frame` is the resolution and the corner of the floor, `corners` (M, 2) column and row of the
    first cell of the window ``out[i]`` (rows, columns, 2); nu is 0 where fewer than two fell.
    """
    rows, columns = out.shape[1:3]
    sums = np.empty((rows, columns, 3))
    for i in range(len(poses)):
        c, s = np.cos(poses[i, 2]) / frame[0], np.sin(poses[i, 2]) / frame[0]
        x = (poses[i, 0] - frame[1]) / frame[0] - corners[i, 0]
        y = (poses[i, 1] - frame[2]) / frame[0] - corners[i, 1]
        sums[:] = 0.0
        for k in range(len(points)):
            column = int(x + c * points[k, 0] - s * points[k, 1])
            row = int(y + s * points[k, 0] + c * points[k, 1])
            cell, h = sums[row, column], heights[k]
            cell[COUNT] += 1.0
            cell[SUM] += h
            cell[SQUARE] += h * h
        for row in range(rows):
            for column in range(columns):
                n, total, square = sums[row, column]
                enough = n >= 2.0
                out[i, row, column, FREEDOM] = n - 1.0 if enough else 0.0
                rest = max(square - total * total / n, 0.0) if enough else 0.0
                out[i, row, column, SQUARES] = rest


@njit(cache=True)
def log_gamma(alpha, freedom, known):  # type: ignore[no-untyped-def]
    """Log Gamma(alpha + freedom / 2); freedom is a whole number, and `known` has the first ones.

    A zero in `known` was not asked for before.
    """
    k = int(freedom)
    if k >= len(known):
        return math.lgamma(alpha + 0.5 * freedom)
    if known[k] == 0.0:
        known[k] = math.lgamma(alpha + 0.5 * freedom)
    return known[k]


@njit(cache=True)
def weigh(pages, table, columns, corners, seen, settings, known, score):  # type: ignore[no-untyped-def]
    """Log density of what was `seen` (M, rows, columns, 2) on each particle's map, in score (M,).

    `settings`: alpha and beta of an unseen cell; whether the density is that of the heights, or of
    their sample variances; then the fewest degrees of freedom and the floor of a variance. `known`
    (2, n) is that of `log_gamma` for this alpha and for 0.
    """
    alpha, beta, of_heights, fewest, floor = settings
    for i in range(len(seen)):
        score[i] = 0.0
        for r in range(seen.shape[1]):
            for q in range(seen.shape[2]):
                nu = seen[i, r, q, FREEDOM]
                if nu == 0.0 or (nu < fewest and not of_heights):
                    continue
                row, column = corners[i, 1] + r, corners[i, 0] + q
                tile = (row >> SHIFT) * columns + (column >> SHIFT)
                cell = pages[table[i, tile], row & INSIDE, column & INSIDE]
                a, b = alpha + 0.5 * cell[FREEDOM], beta + 0.5 * cell[SQUARES]
                half, squares = 0.5 * nu, seen[i, r, q, SQUARES]
                if not of_heights:
                    squares += nu * floor
                total = log_gamma(alpha, cell[FREEDOM] + nu, known[0])
                total -= log_gamma(alpha, cell[FREEDOM], known[0])
                total += a * math.log(b) - (a + half) * math.log(b + 0.5 * squares)
                if of_heights:
                    total -= half * LOG_2_PI + 0.5 * math.log(nu + 1.0)
                else:
                    total += half * math.log(half) - log_gamma(0.0, nu, known[1])
                    total += (half - 1.0) * math.log(squares / nu)
                score[i] += total


@njit(cache=True)
def mark(columns, corners, seen, out):  # type: ignore[no-untyped-def]
    """Mark in `out` (M, tiles) the tiles in which something was seen."""
    for i in range(len(seen)):
        for r in range(seen.shape[1]):
            for q in range(seen.shape[2]):
                if seen[i, r, q, FREEDOM] > 0.0:
                    row, column = corners[i, 1] + r, corners[i, 0] + q
                    out[i, (row >> SHIFT) * columns + (column >> SHIFT)] = True


@njit(cache=True)
def add(pages, table, columns, corners, seen):  # type: ignore[no-untyped-def]
    """Add what was seen to the pages of each particle, which it must own."""
    for i in range(len(seen)):
        for r in range(seen.shape[1]):
            for q in range(seen.shape[2]):
                nu = seen[i, r, q, FREEDOM]
                if nu > 0.0:
                    row, column = corners[i, 1] + r, corners[i, 0] + q
                    tile = (row >> SHIFT) * columns + (column >> SHIFT)
                    cell = pages[table[i, tile], row & INSIDE, column & INSIDE]
                    cell[FREEDOM] += nu
                    cell[SQUARES] += seen[i, r, q, SQUARES]
