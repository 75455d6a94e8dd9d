"""Branch and bound for `slamlab.matching.correlative`; scores are 0 to 255 a point."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit

_HIGHEST = 6  # blocks of at most 2^6 cells


def search(values, cells, reach, least, apart):  # type: ignore[no-untyped-def]
    """Do what `slamlab.matching.correlative.search` does, opening only what may be better."""
    levels = [values]
    while 2 ** len(levels) <= reach and len(levels) <= _HIGHEST:
        levels.append(max_pool(levels[-1], 2 ** (len(levels) - 1)))
    top = len(levels) - 1
    # Always as many, so that the search is compiled once.
    pyramid = tuple(levels + [values] * (_HIGHEST - top))
    a, dc, dr, score = branch_and_bound(pyramid, top, cells, reach, least, (0.0, 0.0, -1.0))
    second = 0
    if a >= 0 and np.isfinite(apart):
        disc = (float(dc), float(dr), float(apart))
        *_, second = branch_and_bound(pyramid, top, cells, reach, score // 2, disc)
    return a, dc, dr, score, second if second > score // 2 else 0


@njit(cache=True)
def max_pool(blocks, width):  # type: ignore[no-untyped-def]
    """Largest value of blocks of 2 width cells, from those of width; overhanging ones included.

    Of blocks of width w, cell (r, c) is the one whose lowest cell is (r - w + 1, c - w + 1).
    """
    rows, columns = blocks.shape
    out = np.zeros((rows + width, columns + width), blocks.dtype)
    for r in range(rows):
        for c in range(columns):
            value = blocks[r, c]
            if value > 0:
                out[r, c] = max(out[r, c], value)
                out[r, c + width] = max(out[r, c + width], value)
                out[r + width, c] = max(out[r + width, c], value)
                out[r + width, c + width] = max(out[r + width, c + width], value)
    return out


@njit(cache=True)
def score_of(blocks, width, cells, dc, dr):  # type: ignore[no-untyped-def]
    """Sum over the points of the block whose lowest cell is the point's, shifted by (dc, dr)."""
    rows, columns = blocks.shape
    total = 0
    for k in range(len(cells)):
        c, r = cells[k, 0] + dc + width - 1, cells[k, 1] + dr + width - 1
        if 0 <= c < columns and 0 <= r < rows:
            total += int(blocks[r, c])
    return total


@njit(cache=True)
def _outside(dc, dr, width, excluded):  # type: ignore[no-untyped-def]
    """Whether a block of shifts reaches beyond the disc (column, row, radius; below 0: none)."""
    c = max(abs(dc - excluded[0]), abs(dc + width - 1 - excluded[0]))
    r = max(abs(dr - excluded[1]), abs(dr + width - 1 - excluded[1]))
    return c * c + r * r > excluded[2] * abs(excluded[2])


@njit(cache=True)
def _put(table, row, numbers):  # type: ignore[no-untyped-def]
    """Write five numbers one by one: to compile the assignment of a slice takes three seconds."""
    for k in range(5):
        table[row, k] = numbers[k]


@njit(cache=True)
def branch_and_bound(levels, top, cells, reach, least, excluded):  # type: ignore[no-untyped-def]
    """Angle number and shift of the best score above `least`: (angle, dc, dr, score).

    `levels[h]` holds blocks of 2^h cells, h up to `top`; `cells` (angles, k, 2) the turned
    points; shifts go from -reach to reach; those inside the disc `excluded` are left out.
    Angle -1: nothing found.
    """
    width = 1 << top
    per_side = (2 * reach + width) // width
    n_roots = len(cells) * per_side * per_side
    scores = np.empty(n_roots, np.int64)
    for n in range(n_roots):
        a, rest = n // (per_side * per_side), n % (per_side * per_side)
        dc, dr = (rest % per_side) * width - reach, (rest // per_side) * width - reach
        scores[n] = score_of(levels[top], width, cells[a], dc, dr)
    best = (-1, 0, 0, least)
    # A depth of `top` with four children each: 3 wait on each level.
    stack = np.empty((4 * top + 8, 5), np.int64)
    child, worth = np.empty((4, 5), np.int64), np.empty(4, np.int64)
    for n in np.argsort(-scores):
        if scores[n] <= best[3]:
            break
        a, rest = n // (per_side * per_side), n % (per_side * per_side)
        dc, dr = (rest % per_side) * width - reach, (rest // per_side) * width - reach
        _put(stack, 0, (top, a, dc, dr, scores[n]))
        size = 1
        while size > 0:
            size -= 1
            h, a, dc, dr, score = stack[size]
            if score <= best[3] or not _outside(dc, dr, 1 << h, excluded):
                continue
            if h == 0:
                best = (a, dc, dr, score)
                continue
            half = 1 << (h - 1)
            count = 0
            for q in range(4):
                x, y = dc + (q % 2) * half, dr + (q // 2) * half
                if x > reach or y > reach:
                    continue
                score = score_of(levels[h - 1], half, cells[a], x, y)
                if score > best[3]:
                    _put(child, count, (h - 1, a, x, y, score))
                    worth[count] = score
                    count += 1
            # The best child is put down last and so taken first.
            for q in np.argsort(worth[:count]):
                _put(stack, size, child[q])
                size += 1
    return best[0], best[1], best[2], best[3]
