"""Points laid upon points, or upon the lines through them: ICP.

Besl and McKay 1992; point to line: Censi, ICRA 2008; gate and weights: Vizzo et al., RA-L 2023
(KISS-ICP). Chapter 14 derives it: (A) to (C) are its formulas.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slamlab._checks import Array, as_array, as_choice, as_count, as_scalar
from slamlab.geometry import transform, wrap_angle
from slamlab.kernels import compiled
from slamlab.matching._covariance import covariance
from slamlab.matching.match import (
    Match,
    capped_inverse,
    finite_points,
    prior_information,
    solved,
)
from slamlab.matching.normals import PointsWithNormals

__all__ = ["match_icp"]


def match_icp(
    reference: ArrayLike | PointsWithNormals,
    points: ArrayLike,
    guess: ArrayLike,
    metric: str = "line",
    width: float = 0.05,
    gate: float = 0.5,
    fine_gate: float = 0.2,
    n_iterations: int = 15,
    prior_cov: ArrayLike | None = None,
    noise: float = 0.05,
) -> Match:
    """Lay points upon a reference: pair with the nearest, step, again.

    With `prior_cov` the guess is a measurement like the pairs, and the result the most probable
    pose: where no wall holds it, the guess does.

    Parameters
    ----------
    reference : array_like, shape (m, 2), or PointsWithNormals
        Points of the map (m); a `PointsWithNormals` brings its normals along.
    points : array_like, shape (k, 2)
        The scan in the frame of the body (m), at least three points; rows with NaN are left out.
    guess : array_like, shape (3,)
        Where to begin (m, m, rad).
    metric : {"line", "point"}
        Error of a pair: its distance across the wall, n . (R p + t - q), or all of R p + t - q.
    width : float, default 0.05
        From this error (m) on a pair counts for less: weight (width^2 / (width^2 + e^2))^2.
    gate : float, default 0.5
        Farther neighbours (m) are no pairs, until the pose rests;
    fine_gate : float, default 0.2
        then the same with this gate (never more than `gate`).
    n_iterations : int, default 15
        Rounds at most, for each gate.
    prior_cov : array_like, shape (3, 3), optional
        Covariance of the guess, if it is to pull.
    noise : float, default 0.05
        With `prior_cov`: standard deviation of a pair's error (m).

    Returns
    -------
    Match
        With `prior_cov`, `cov` is that of both together, (J^T w J / noise^2 + prior_cov^-1)^-1.
        Without it, `cov` holds the noise of scan and reference, both estimated from what is left
        of the errors; information along a wall that only the noise of its normals pretends is
        taken off, and a direction that fewer than three pairs would hold is held by none.
        `score` is the sum of the weights over the number of points; 0 if fewer than three
        pairs were found: then the pose is the guess and `cov` large, or `prior_cov`.

    Raises
    ------
    ValueError
        If the reference has fewer than three points; for lines, fewer than three on walls.

    Examples
    --------
    >>> x, y = np.linspace(0, 3, 61), np.linspace(0, 2, 41)
    >>> corner = np.vstack([np.stack([x, 0 * x], -1), np.stack([0 * y, y], -1)])
    >>> from slamlab.geometry import inverse_transform
    >>> scan = inverse_transform([0.1, 0.05, 0.02], corner)
    >>> match_icp(corner, scan, guess=[0, 0, 0]).pose.round(3).tolist()
    [0.1, 0.05, 0.02]

    One wall holds y and the heading; x is the guess's, and as unsure as it.

    >>> prior_cov = np.diag([0.02, 0.1, 0.1]) ** 2
    >>> match = match_icp(corner[:61], scan[:61], [0.07, 0, 0], prior_cov=prior_cov)
    >>> match.pose.round(3).tolist(), np.sqrt(match.cov[0, 0]).round(3).item()
    ([0.07, 0.049, 0.02], 0.02)
    """
    line = as_choice("metric", metric, ["line", "point"]) == "line"
    base = _reference(reference, line)
    points = finite_points("points", points, 3)
    guess = as_array("guess", guess, (3,)).astype(np.float64)
    width = as_scalar("width", width, 1e-6, 1e6)
    gate = as_scalar("gate", gate, 1e-6, 1e6)
    gates = np.array([gate, min(as_scalar("fine_gate", fine_gate, 1e-6, 1e6), gate)])
    rounds = as_count("n_iterations", n_iterations, 1)
    noise = as_scalar("noise", noise, 1e-6, 1e6)
    prior = np.zeros((3, 3))
    if prior_cov is not None:
        prior = noise**2 * prior_information("prior_cov", prior_cov)
    pose = guess.copy()
    pair = align(base.points, base.normals, points, pose, width, gates, rounds, line, prior)
    reach = float(np.sqrt((points**2).sum(1).mean()))
    met = pair >= 0
    if met.sum() < 3 or not np.isfinite(pose).all():
        cov = capped_inverse(np.zeros((3, 3)), reach) if prior_cov is None else prior_cov
        return Match(guess, np.array(cov, float), 0.0, 0)
    e, J, w = errors(base.points, base.normals, points, pose, pair, width, line)
    H = information(w, J)
    if prior_cov is None:
        arms = turned_by(pose[2], points[met])
        cov = covariance(base, pair[met], arms, e, J, w, H, width, reach)
    else:
        cov = noise**2 * np.linalg.inv(H + prior)
        cov = 0.5 * (cov + cov.T)
    pose[2] = wrap_angle(pose[2])
    total = float(w.sum())
    rmse = float(np.sqrt(w @ (e**2).sum(1) / total))
    return Match(pose, cov, total / len(points), int(met.sum()), rmse=rmse)


@compiled("icp.align")
def align(
    reference: Array, normals: Array, points: Array, pose: Array, width: float, gates: Array,
    n_iterations: int, line: bool, prior: Array,
) -> NDArray[np.int64]:  # fmt: skip
    """Move `pose` (3,) to where points (k, 2) lie best; return the partner of each, -1 for none.

    `prior` (3, 3) is the information of the pose given, in units of that of a pair. No partners
    at all if they hold no pose.
    """
    tree, guess = cKDTree(reference), pose.copy()
    for gate in gates:  # first wide, then narrow
        for _ in range(n_iterations):
            pair = partners(tree, transform(pose, points), gate)  # the nearest, within the gate
            e, J, w = errors(reference, normals, points, pose, pair, width, line)
            H = information(w, J) + prior
            g = -((w[:, None] * e)[..., None] * J).sum((0, 1)) - prior @ (pose - guess)  # (C)
            # Next to nothing on the diagonal keeps a direction that no wall holds where it is.
            step = solved(H + 1e-9 * (H[0, 0] + H[1, 1]) * np.eye(3), g)  # (C): H^-1 g
            if len(w) < 3 or step is None:
                return np.full(len(points), -1)
            pose += step
            if np.abs(step[:2]).sum() < 1e-6 and abs(step[2]) < 1e-7:
                break
    return partners(tree, transform(pose, points), gates[-1])


def partners(tree: cKDTree, world: Array, gate: float) -> NDArray[np.int64]:
    """Row of the nearest point of the tree within the gate (m), for points (k, 2); -1 for none."""
    distance, nearest = tree.query(world, distance_upper_bound=gate)
    return np.where(np.isfinite(distance), nearest, -1)


def errors(
    reference: Array, normals: Array, points: Array, pose: Array, pair: NDArray[np.int64],
    width: float, line: bool,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Errors e (n, d) of the pairs, their Jacobians J (n, d, 3) and weights w (n,).

    To points d is 2, to lines 1; in the order of the points that have a partner.
    """
    j, arm = pair[pair >= 0], turned_by(pose[2], points[pair >= 0])
    e = arm + pose[:2] - reference[j]  # (A): R p + t - q
    (x, y), (ex, ey) = arm.T, e.T
    if line:
        nx, ny = normals[j].T
        e = (nx * ex + ny * ey)[:, None]  # (B): n . (R p + t - q)
        J = np.array([nx, ny, ny * x - nx * y]).T[:, None]  # (B)
    else:
        one, zero = np.ones(len(j)), np.zeros(len(j))
        J = np.array([one, zero, -y, zero, one, x]).T.reshape(-1, 2, 3)
    w = (width**2 / (width**2 + (e**2).sum(1))) ** 2  # Geman and McClure
    return e, J, w


def turned_by(angle: float, points: Array) -> Array:
    """R p (n, 2) of points p."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def information(w: Array, J: Array) -> Array:
    """Sum of w J^T J (3, 3) over Jacobians (n, d, 3)."""
    return np.asarray((w[:, None, None] * J).reshape(-1, 3).T @ J.reshape(-1, 3))


def _reference(reference: ArrayLike | PointsWithNormals, line: bool) -> PointsWithNormals:
    """Outline of the reference: for lines only the points on walls, for points no normals."""
    if not line:
        given = reference.points if isinstance(reference, PointsWithNormals) else reference
        points = finite_points("reference", given, 3)
        return PointsWithNormals(points, np.zeros_like(points), np.zeros(len(points)))
    if not isinstance(reference, PointsWithNormals):
        reference = PointsWithNormals.estimate(reference)
    walls = reference.on_lines()
    n = len(walls.points)
    if n < 3:
        raise ValueError(f"reference: expected at least 3 points on walls, got {n}")
    return walls
