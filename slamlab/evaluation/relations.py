"""How well a path keeps relations measured by hand: the metric of the SLAM benchmark.

Kuemmerle et al. 2009, "On measuring the accuracy of SLAM algorithms", (3) and (4): it needs no
common frame and no alignment. A relation sees only the stretch that it spans: to short ones a
corridor that slid as one piece costs next to nothing (chapter 13).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from slamlab._checks import as_array, as_scalar, as_tuple
from slamlab.evaluation.trajectory import TrajectoryError
from slamlab.geometry import between, compose, inverse, wrap_angle

__all__ = ["relation_error"]


def relation_error(
    times: ArrayLike,
    poses: ArrayLike,
    relations: tuple[ArrayLike, ArrayLike],
    tolerance: float = 1e-3,
) -> TrajectoryError:
    """Errors of the relative poses between given moments.

    Parameters
    ----------
    times : array_like, shape (n,)
        When each pose was taken (s).
    poses : array_like, shape (n, 3)
        Estimated path (m, m, rad), in any frame.
    relations : Relations
        As `datasets.relations.read_relations` gives them: moments (m, 2), relative poses (m, 3).
    tolerance : float, default 1e-3
        Largest difference (s) between a relation's moment and that of a pose.

    Returns
    -------
    TrajectoryError
        One entry a relation both of whose moments have a pose; the others are left out, so
        compare ``len(error.translation)`` with the number of relations.

    Raises
    ------
    ValueError
        If no relation has both its poses.

    Examples
    --------
    >>> error = relation_error([0, 1, 2], [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
    ...                        ([[0, 2], [0, 5]], [[2.1, 0, 0], [5, 0, 0]]))
    >>> error.translation.round(3).tolist()
    [0.1]
    """
    times = as_array("times", times, ("n",))
    poses = as_array("poses", poses, (len(times), 3))
    pair = as_tuple("relations", relations)
    if len(pair) != 2:
        raise ValueError(f"relations: expected moments and relative poses, got {len(pair)} things")
    moments = as_array("relations[0]", pair[0], ("m", 2))
    measured = as_array("relations[1]", pair[1], (len(moments), 3))
    # By absolute differences (p=1); where there is no pose, the row is the number of poses.
    gaps, rows = cKDTree(times[:, None]).query(moments[..., None], p=1)
    near = (gaps <= as_scalar("tolerance", tolerance, 0.0)) & (rows < len(times))
    both = near.all(1)
    if not both.any():
        raise ValueError(
            f"relations: expected some between the moments of the path, none of {len(both)} is"
        )
    i, j = rows[both].T
    # (4): e = relation^-1 (+) (x_i^-1 (+) x_j)
    e = compose(inverse(measured[both]), between(poses[i], poses[j]))
    return TrajectoryError(np.hypot(e[:, 0], e[:, 1]), np.abs(wrap_angle(e[:, 2])))
