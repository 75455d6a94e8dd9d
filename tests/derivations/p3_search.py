"""P3's own search for loops, section 3: boxes halved until both are smaller than the accuracy.

The library's stops as soon as both pieces are straight and computes where they meet.
"""

import numpy as np

from slamlab.navigation.cubic import monotone_cuts, point


def search_as_printed(c, spline, accuracy):
    """Boxes compared until a new cubic meets a path, and the parameter there (None without)."""
    path, half = spline.coefficients[: spline.n], len(spline.boxes) // 2
    pairs, tests = [(piece, 1, None) for piece in pieces(c)], 0
    while pairs:
        new, node, old = pairs.pop()
        inside = spline.boxes[node] if old is None else box_of(path[node - half], *old)
        around = box_of(c, *new)
        tests += 1
        if (inside[:2] > around[2:]).any() or (around[:2] > inside[2:]).any():
            continue
        if old is None and node < half:
            pairs += [
                (new, k, None) for k in (2 * node, 2 * node + 1) if holds(k, half, len(path))
            ]
        elif old is None:
            pairs += [(new, node, piece) for piece in pieces(path[node - half])]
        elif max(size(inside), size(around)) <= accuracy:
            return tests, new[1]
        elif size(around) >= size(inside):
            pairs += [(piece, node, old) for piece in halves(*new)]
        else:
            pairs += [(new, node, piece) for piece in halves(*old)]
    return tests, None


def holds(node, half, n):
    """Whether a box of the heap holds any of the first n segments."""
    while node < half:
        node *= 2
    return node - half < n


def pieces(c):
    cuts = monotone_cuts(c).tolist()
    return list(zip(cuts[:-1], cuts[1:], strict=True))


def halves(a, b):
    return [(a, 0.5 * (a + b)), (0.5 * (a + b), b)]


def box_of(c, a, b):
    """Box of a monotone piece: that of its ends."""
    ends = point(c, a), point(c, b)
    return np.concatenate([np.minimum(*ends), np.maximum(*ends)])


def size(box):
    return max(box[2] - box[0], box[3] - box[1])
