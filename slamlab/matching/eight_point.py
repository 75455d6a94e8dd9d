"""The normalised eight-point algorithm: how a moving camera turns, from pairs of image points.

P4's abstract names it as its way from pictures to landmarks. Longuet-Higgins (1981); Hartley
(1997) for the normalisation without which it is not worth using. Chapter 16.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array

__all__ = ["eight_point_rows", "epipolar_distances", "fundamental_matrix", "hartley_transform"]

_RANK = 1e-13  # s_8 of the rows as a part of s_1: rounding leaves 1e-15, a camera that moved 1e-10


def hartley_transform(points: ArrayLike) -> Array:
    """Return T (3, 3) that moves points to their centre and scales them to a mean length sqrt 2.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        Points of one image (pixels), not all the same.

    Examples
    --------
    >>> hartley_transform([[0.0, 0.0], [200.0, 0.0]]).round(4).tolist()
    [[0.0141, 0.0, -1.4142], [0.0, 0.0141, -0.0], [0.0, 0.0, 1.0]]
    """
    points = as_array("points", points, ("n", 2))
    centre = points.mean(0) if len(points) else np.zeros(2)
    spread = np.linalg.norm(points - centre, axis=-1).mean() if len(points) else 0.0
    if not spread > 0.0:
        raise ValueError(f"points: expected different points, got {len(points)} at one place")
    s = np.sqrt(2.0) / spread
    return np.array([[s, 0.0, -s * centre[0]], [0.0, s, -s * centre[1]], [0.0, 0.0, 1.0]])


def eight_point_rows(first: ArrayLike, second: ArrayLike) -> Array:
    """Return the rows (n, 9) of A f = 0: x'^T F x = 0 for each pair, F row by row in f.

    Parameters
    ----------
    first, second : array_like, shape (n, 2)
        The same n points in two images.

    Examples
    --------
    >>> eight_point_rows([[2.0, 3.0]], [[5.0, 7.0]]).tolist()
    [[10.0, 15.0, 5.0, 14.0, 21.0, 7.0, 2.0, 3.0, 1.0]]
    """
    first, second = _pairs(first, second)
    x = np.column_stack([first, np.ones(len(first))])
    x_there = np.column_stack([second, np.ones(len(second))])
    return (x_there[:, :, None] * x[:, None, :]).reshape(-1, 9)


def fundamental_matrix(first: ArrayLike, second: ArrayLike, *, normalised: bool = True) -> Array:
    """Return F (3, 3) of rank 2 with x'^T F x = 0 for n >= 8 pairs of points, in least squares.

    Parameters
    ----------
    first, second : array_like, shape (n, 2)
        The same points in two images (pixels), at least eight, not all at one place.
    normalised : bool, default True
        Centre and scale both images first. Without, the numbers of A differ by the square of an
        image's width, and so does what an error of a pixel does to F.

    Returns
    -------
    ndarray, shape (3, 3)
        Of unit length; its sign means nothing.

    Raises
    ------
    ValueError
        If the pairs do not determine F: the camera stood still or only turned, or all points lie
        in one plane or come again. With noise in the points this is not seen: then s_8 of the
        rows is small.

    Examples
    --------
    A camera that moves to its right: a point stays in its row of pixels.

    >>> rng = np.random.default_rng(0)
    >>> first = rng.uniform(0, 640, (12, 2))
    >>> second = first - np.column_stack([rng.uniform(5, 50, 12), np.zeros(12)])
    >>> F = fundamental_matrix(first, second)
    >>> np.allclose(F / F[2, 1], [[0, 0, 0], [0, 0, -1], [0, 1, 0]])
    True
    """
    first, second = _pairs(first, second)
    if len(first) < 8:
        raise ValueError(f"first: expected at least 8 points, got {len(first)}")
    T, T_there = np.eye(3), np.eye(3)
    if normalised:
        T, T_there = hartley_transform(first), hartley_transform(second)
    rows = eight_point_rows(_moved(T, first), _moved(T_there, second))
    # min |A f| with |f| = 1: the last right singular vector
    _, s, Vt = np.linalg.svd(rows)
    if s[7] <= _RANK * s[0]:
        raise ValueError(
            "first, second: expected pairs that determine F, got pairs that many F fit (a camera "
            "that stood still or only turned, points of one plane, or the same ones again)"
        )
    F = Vt[-1].reshape(3, 3)
    # The nearest matrix of rank 2: all epipolar lines meet.
    U, s, Vt = np.linalg.svd(F)
    F = T_there.T @ (U[:, :2] * s[:2]) @ Vt[:2] @ T
    return np.asarray(F / np.linalg.norm(F))


def epipolar_distances(F: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Return how far (pixels) each second point lies from the line that its first allows, (n,).

    Parameters
    ----------
    F : array_like, shape (3, 3)
    first, second : array_like, shape (n, 2)

    Raises
    ------
    ValueError
        If `F` allows a point no line.

    Examples
    --------
    >>> sideways = [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    >>> epipolar_distances(sideways, [[100.0, 40.0]], [[80.0, 43.0]]).tolist()
    [3.0]
    """
    F, (first, second) = as_array("F", F, (3, 3)), _pairs(first, second)
    lines = np.column_stack([first, np.ones(len(first))]) @ F.T
    size = np.linalg.norm(lines[:, :2], axis=-1)
    if not size.all():
        i = int(np.argmin(size))
        raise ValueError(f"F: expected a line for each point of first, got none for point {i}")
    off = np.abs((lines[:, :2] * second).sum(-1) + lines[:, 2])
    return np.asarray(off / size)


def _pairs(first: ArrayLike, second: ArrayLike) -> tuple[Array, Array]:
    first = as_array("first", first, ("n", 2))
    return first, as_array("second", second, (len(first), 2))


def _moved(T: Array, points: Array) -> Array:
    return points @ T[:2, :2].T + T[:2, 2]
