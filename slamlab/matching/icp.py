"""Points laid upon points, or upon the lines through them: ICP.

Besl and McKay 1992; point to line: Censi, ICRA 2008; gate and weights: Vizzo et al., RA-L 2023
(KISS-ICP); covariance after Censi, ICRA 2007. Chapter 14 derives it: (A) to (C) are its formulas.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_instance,
    as_scalar,
    as_tuple,
)
from slamlab.geometry import transform, wrap_angle
from slamlab.kernels import compiled
from slamlab.matching.match import (
    CAP,
    Match,
    capped_inverse,
    finite_points,
    prior_information,
    solved,
)

__all__ = ["PointsWithNormals", "match_icp", "estimate_normals", "voxel_downsample"]

Rows = NDArray[np.intp]

# Thinning has a number for each square of an area with at most so many a side.
MOST_SQUARES = 2000
# A direction whose information comes from fewer pairs than this is held by nothing.
FEW = 3.0


def voxel_downsample(points: ArrayLike, spacing: float = 0.1) -> Array:
    """Keep one point in every square of `spacing` (m), so that the near wall does not win.

    A lidar lays thirty times as many points on a wall one metre away as on one thirty metres off.

    Parameters
    ----------
    points : array_like, shape (k, 2)
        Rows with NaN are left out.
    spacing : float, default 0.1

    Returns
    -------
    ndarray, shape (n, 2)
        The first point of each square, in their order.

    Examples
    --------
    >>> voxel_downsample([[0.01, 0.0], [0.02, 0.0], [0.15, 0.0]], spacing=0.1).tolist()
    [[0.01, 0.0], [0.15, 0.0]]
    """
    points = finite_points("points", points, 0)
    spacing = as_scalar("spacing", spacing, 1e-3, 1e6)
    squares, rows = np.floor(points / spacing), np.arange(len(points))
    column, row = (xy - xy.min(initial=np.inf) for xy in squares.T)
    columns = column.max(initial=0.0) + 1
    if max(columns, row.max(initial=0.0)) < MOST_SQUARES:
        square = (row * columns + column).astype(np.intp)
    else:  # too many to count all: only those that are met
        square = np.unique(squares.view(complex), return_inverse=True)[1].ravel()
    first = np.empty(square.max(initial=0) + 1, np.intp)
    first[square[::-1]] = rows[::-1]  # of several rows in one square the last written stays
    return points.compress(first[square] == rows, 0)


@dataclass(frozen=True, eq=False)
class PointsWithNormals:
    """Points on walls, with the direction in which each wall looks.

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        (m).
    normals : ndarray, shape (k, 2)
        Unit vectors across the wall, of either sign; NaN where the neighbours draw no line.
    normal_variances : ndarray, shape (k,)
        Variance of the normal's direction (rad^2), by how far its neighbours lie off the line.
    """

    points: Array
    normals: Array
    normal_variances: Array

    @classmethod
    def estimate(cls, points: ArrayLike) -> PointsWithNormals:
        """Find the walls through points, by total least squares over the five nearest of each.

        The point itself is one of them; three must lie within half a metre. A wall's smaller
        eigenvalue is at most 0.15 of the larger one.

        Parameters
        ----------
        points : array_like, shape (k, 2)
            Rows with NaN are left out.

        Returns
        -------
        PointsWithNormals
        """
        points = finite_points("points", points)
        distance, near = cKDTree(points).query(points, 6, distance_upper_bound=0.5)
        tied = np.flatnonzero(distance[:, 5] < distance[:, 4] + 1e-9)
        if len(tied):
            near[tied] = _earlier_first(points, tied, near[tied])
        near = near[:, :5].T
        here = near < len(points)
        x, y = (here * (x.take(near, mode="clip") - x) for x in points.T.copy())
        count, sum_x, sum_y, xx, xy, yy = np.array([here, x, y, x * x, x * y, y * y]).sum(1)
        xx, xy, yy = xx - sum_x**2 / count, xy - sum_x * sum_y / count, yy - sum_y**2 / count
        half, root = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        large, small = half + root, np.maximum(half - root, 0.0)  # the eigenvalues
        on_line = (count >= 3) & (large > 0) & (small <= 0.15 * large)
        angle = np.where(on_line, 0.5 * np.arctan2(2 * xy, xx - yy), np.nan)  # of the larger one
        normals = np.stack([-np.sin(angle), np.cos(angle)], -1)
        # Noise s turns the normal by s / sqrt(large); across the wall, s^2 = small / (count - 2).
        variances = np.where(on_line, small / np.where(on_line, large * (count - 2), 1.0), 0.0)
        return cls(points, normals, variances)

    def transformed(self, pose: ArrayLike) -> PointsWithNormals:
        """Return the outline, given in the frame of `pose`, in the frame of its parent.

        Parameters
        ----------
        pose : array_like, shape (3,) or (k, 3)
            One pose (m, m, rad), or one for each point.
        """
        pose = as_array("pose", pose, ("...", 3))
        c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        (x, y), (nx, ny) = self.points.T, self.normals.T
        points, normals = np.empty_like(self.points), np.empty_like(self.normals)
        points[:, 0], points[:, 1] = c * x - s * y + pose[..., 0], s * x + c * y + pose[..., 1]
        normals[:, 0], normals[:, 1] = c * nx - s * ny, s * nx + c * ny
        return PointsWithNormals(points, normals, self.normal_variances)

    def on_lines(self) -> PointsWithNormals:
        """Return the outline without the points whose neighbours draw no line."""
        on_wall = np.isfinite(self.normals[:, 0])
        parts = self.points, self.normals, self.normal_variances
        return PointsWithNormals(*(part[on_wall] for part in parts))

    @classmethod
    def concatenated(cls, outlines: Iterable[PointsWithNormals]) -> PointsWithNormals:
        """Several outlines of one frame as one; ValueError if there is none."""
        parts = [
            as_instance("outlines", one, PointsWithNormals)
            for one in as_tuple("outlines", outlines)
        ]
        if not parts:
            raise ValueError("outlines: expected at least one, got none")
        return cls(
            np.concatenate([one.points for one in parts]),
            np.concatenate([one.normals for one in parts]),
            np.concatenate([one.normal_variances for one in parts]),
        )


def _earlier_first(points: Array, rows: Rows, near: Rows) -> Rows:
    """Neighbours (k, 6) of some rows; of two that are as near the earlier one comes first.

    Which of them a tree finds first is chance. Beyond the last row there is none.
    """
    d = points[np.minimum(near, len(points) - 1)] - points[rows, None]
    squares = np.where(near < len(points), (d**2).sum(-1), np.inf)
    return near[np.arange(len(near))[:, None], np.lexsort((near, squares))]


def estimate_normals(points: ArrayLike) -> Array:
    """Return unit vectors across the walls through points (k, 2), NaN off walls.

    Examples
    --------
    >>> wall = np.stack([np.linspace(0, 1, 11), np.full(11, 2.0)], -1)
    >>> abs(estimate_normals(wall)[5]).round(6).tolist()
    [0.0, 1.0]
    """
    return PointsWithNormals.estimate(as_array("points", points, ("k", 2))).normals


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
        The scan in the frame of the body (m); rows with NaN are left out.
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
        If fewer than three points, or reference points on walls, are there, or an argument is
        out of range.

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
    arm = float(np.sqrt((points**2).sum(1).mean()))
    met = pair >= 0
    if met.sum() < 3 or not np.isfinite(pose).all():
        cov = capped_inverse(np.zeros((3, 3)), arm) if prior_cov is None else prior_cov
        return Match(guess, np.array(cov, float), 0.0, 0)
    e, J, w = errors(base.points, base.normals, points, pose, pair, width, line)
    if prior_cov is None:
        cov = covariance(base, pair[met], turned_by(pose[2], points[met]), e, J, w, width, arm)
    else:
        cov = noise**2 * np.linalg.inv(information(w, J) + prior)
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


def covariance(
    base: PointsWithNormals, j: NDArray[np.int64], arms: Array, e: Array, J: Array, w: Array,
    width: float, reach: float,
) -> Array:  # fmt: skip
    """A^-1 (s^2 / 2 N) A^-1: half of the error's variance is the scan's, half the reference's.

    N is what unit noise of the points and of the reference, whose points j (n,) serve several
    pairs, puts into J^T w e. A is H without what noise of the normals pretends. Nothing holds an
    axis along which that is half of H or more, or whose information comes from fewer than `FEW`
    pairs, any of which may be a wrong one: its standard deviation is CAP. Pairs count as
    (sum h)^2 / sum h^2. `arms` (n, 2) are R p, and `reach` (m) is how far out points lie.
    """
    (n, d), e2 = e.shape, (e**2).sum(1)
    # Variance of an error, as a robust fit feels it (Huber): E[psi^2] / E[psi']^2, psi = w e.
    slope = w @ ((width**2 - 3 * e2) / (width**2 + e2)) / w.sum()
    s2 = w**2 @ e2 / (w @ w) / max(slope, 0.2) ** 2 / d
    s2 = max(s2 * n / max(n - 3, 1), 1e-8)
    same = (j[:, None] == j).astype(float)
    N = sum(A.T @ (A + same @ A) for A in (w[:, None, None] * J).swapaxes(0, 1))
    (nx, ny), (x, y) = base.normals[j].T, arms.T
    turned = np.array([-ny, nx, nx * x + ny * y]).T  # dJ by the normal's angle
    H, blur = information(w, J), information(w * base.normal_variances[j], turned[:, None])
    # Heading counts as metres at the rim of the scan.
    scale = np.array([1.0, 1.0, 1.0 / max(reach, 1e-3)])
    values, axes = np.linalg.eigh(scale[:, None] * H * scale)
    axes = scale[:, None] * axes  # across these H is diagonal
    # Information of each pair along each axis.
    h = w[:, None] * ((J.reshape(-1, 3) @ axes) ** 2).reshape(n, d, 3).sum(1)
    crowded = values**2 >= FEW * (h**2).sum(0)
    pretended = axes.T @ blur @ axes
    A = np.diag(values) - pretended
    held = (A.diagonal() > np.maximum(pretended.diagonal(), s2 / CAP**2)) & crowded
    tight, loose = axes[:, held], CAP * axes[:, ~held]
    gain = tight @ np.linalg.inv(A[held][:, held]) @ tight.T
    cov = 0.5 * s2 * gain @ N @ gain + loose @ loose.T
    return 0.5 * (cov + cov.T)


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
