"""Where am I, with hardly a guess? All poses of a window are tried, most of them unseen.

Olson, ICRA 2009 (correlative matching); branch and bound as Hess, Kohler, Rapp and Andor,
ICRA 2016. Chapter 14.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import as_array, as_scalar
from slamlab.geometry import transform, wrap_angle
from slamlab.kernels import compiled
from slamlab.matching.field import LikelihoodGrid
from slamlab.matching.match import Match, finite_points

__all__ = ["match_correlative"]


def match_correlative(
    field: LikelihoodGrid,
    points: ArrayLike,
    guess: ArrayLike,
    window: float,
    angle_window: float,
    angle_step: float = np.deg2rad(1.0),
    min_score: float = 0.0,
    second_peak_distance: float = np.inf,
) -> Match | None:
    """Best of all poses in a window, exactly: every shift by whole cells, at every angle.

    Where numba is installed most are never scored: a block of shifts can score at most what its
    best cells give, and one that promises less than the best pose so far is left unopened.

    Parameters
    ----------
    field : LikelihoodGrid
        Shifts are whole cells of it.
    points : array_like, shape (k, 2)
        The scan in the frame of the body (m), at least one point; rows with NaN are left out.
    guess : array_like, shape (3,)
        Middle of the window (m, m, rad).
    window : float
        Shifts up to this in x and in y (m).
    angle_window : float
        Turns up to this to either side (rad).
    angle_step : float, default 1 degree
        Distance between the angles tried (rad).
    min_score : float, default 0
        Poses must score more than this.
    second_peak_distance : float, default inf
        Search also for the best pose farther than this (m) from the winner: `Match.second_peak`.

    Returns
    -------
    Match or None
        None if no pose scores more than `min_score`. Its `score` is the mean of the field, in
        steps of 1/255, at the cells in which the points lie; `cov` that of the grid
        of poses searched: a step's width.

    Examples
    --------
    >>> from slamlab.geometry import inverse_transform
    >>> x, y = np.linspace(0, 3, 61), np.linspace(0, 2, 41)
    >>> corner = 0.01 + np.vstack([np.stack([x, 0 * x], -1), np.stack([0 * y, y], -1)])
    >>> scan, field = inverse_transform([0.5, 0.2, 0.0], corner), LikelihoodGrid.of_points(corner)
    >>> found = match_correlative(field, scan, [0, 0, 0], window=1.0, angle_window=0.3)
    >>> found.pose.round(2).tolist()
    [0.5, 0.2, 0.0]
    """
    if not isinstance(field, LikelihoodGrid) or field.log_odds:
        raise ValueError(f"field: expected a LikelihoodGrid of likelihoods, got {field!r}")
    points = finite_points("points", points)
    guess = as_array("guess", guess, (3,)).astype(np.float64)
    reach = int(np.ceil(as_scalar("window", window, 0.0, 1e4) / field.resolution - 1e-9))
    step = as_scalar("angle_step", angle_step, 1e-6, np.pi)
    side = int(np.ceil(as_scalar("angle_window", angle_window, 0.0, np.pi) / step - 1e-9))
    min_score = as_scalar("min_score", min_score, 0.0, 1.0)
    second_peak_distance = as_scalar("second_peak_distance", second_peak_distance, 0.0)
    angles = guess[2] + step * np.arange(-side, side + 1)
    poses = np.tile(guess, (len(angles), 1))
    poses[:, 2] = angles
    turned = transform(poses, points)
    cells = np.floor((turned - field.origin) / field.resolution).astype(np.int64)
    values, full = np.rint(255.0 * field.values).astype(np.uint8), 255 * len(points)
    apart = second_peak_distance / field.resolution
    a, dc, dr, score, second = search(values, cells, reach, int(min_score * full), apart)
    if a < 0:
        return None
    second_peak = second / score if np.isfinite(apart) else float("nan")
    pose = np.array([*(guess[:2] + field.resolution * np.array([dc, dr])), wrap_angle(angles[a])])
    cov = np.diag([field.resolution**2, field.resolution**2, step**2]) / 12
    return Match(pose, cov, score / full, len(points), second_peak)


@compiled("correlative.search")
def search(
    values: NDArray[np.uint8], cells: NDArray[np.int64], reach: int, least: int, apart: float
) -> tuple[int, int, int, int, int]:
    """Score every shift by -reach..reach cells at every angle: angle, dc, dr, score, second.

    `cells` (angles, k, 2: column, row) are the turned points. Angle -1: no score is above `least`.
    `second` is the best score more than `apart` cells away, 0 if that is not above half of the
    best, or not asked for (inf). Among equals the kernel may name another one.
    """
    width, size = 2 * reach + 1, np.array(values.shape[::-1])
    padded = np.pad(values, width)  # beyond the field a score is 0
    best, angle = np.zeros((width, width), np.int64), np.zeros((width, width), int)
    for a, corners in enumerate(np.clip(cells + reach + 1, 0, size + width)):
        scores = np.zeros_like(best)  # bytes would overflow
        for column, row in corners:
            scores += padded[row : row + width, column : column + width]
        angle[scores > best] = a
        best = np.maximum(best, scores)
    row, column = np.unravel_index(best.argmax(), best.shape)
    score, second = int(best[row, column]), 0
    if score <= least:
        return -1, 0, 0, least, 0
    if np.isfinite(apart):
        y, x = np.ogrid[:width, :width]
        far = (x - column) ** 2 + (y - row) ** 2 > apart**2
        second = int(best[far].max(initial=0))
    return (
        int(angle[row, column]), int(column) - reach, int(row) - reach,
        score, second if second > score // 2 else 0,
    )  # fmt: skip
