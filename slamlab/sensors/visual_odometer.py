"""A visual odometer: stereo pictures of a room, matched, aligned, and a light model of its noise.

P3 drives by such a device (its references 5 to 7) and gives no formula for it; the alignment is
that of Arun, Huang and Blostein (1987). Chapter 17 records paths with it and drives home by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import (
    Array,
    as_array,
    as_count,
    as_covariance,
    as_rng,
    as_scalar,
    as_shaped,
    shown,
)
from slamlab.geometry import between, compose, wrap_angle

__all__ = [
    "MeasuredMotion",
    "StereoOdometer",
    "VisualOdometer",
    "rigid_motion",
    "fit_noise",
    "room_points",
]


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """What the odometer says about one step.

    Attributes
    ----------
    increment : ndarray, shape (3,)
        Pose of the body after the step, seen from before it (m, m, rad).
    cov : ndarray, shape (3, 3)
        Its covariance.
    inliers : ndarray of bool, shape (n,)
        Which matches agree with it.
    """

    increment: Array
    cov: Array
    inliers: np.ndarray


def room_points(
    rng: np.random.Generator, n: int = 400, size: tuple[float, float] = (10.0, 8.0)
) -> Array:
    """Draw points (n, 3) of texture on the four walls, 2.5 m high, of a room round the origin (m).

    Examples
    --------
    >>> points = room_points(np.random.default_rng(0), 100, size=(4.0, 2.0))
    >>> points.shape, bool((np.isclose(abs(points), [2, 1, np.nan]).any(1)).all())
    ((100, 3), True)
    """
    rng, n = as_rng("rng", rng), as_count("n", n, 1)
    width, depth = as_array("size", size, (2,))
    if not 0 < min(width, depth) <= max(width, depth) <= 1e9:
        raise ValueError(f"size: expected two positive lengths up to 1e9 m, got {shown(size)}")
    along = rng.uniform(0, 2 * (width + depth), n)
    corners = np.cumsum([0, width, depth, width, depth])
    x = np.interp(along, corners, [0, width, width, 0, 0]) - 0.5 * width
    y = np.interp(along, corners, [0, 0, depth, depth, 0]) - 0.5 * depth
    return np.stack([x, y, rng.uniform(0, 2.5, n)], -1)


def rigid_motion(p: ArrayLike, q: ArrayLike) -> tuple[Array, Array]:
    """Rigid motion (R, t) with the smallest sum of squares of q - (R p + t).

    Parameters
    ----------
    p, q : array_like, shape (..., n, 3)
        Matching points of space (m); leading axes are a batch.

    Returns
    -------
    R : ndarray, shape (..., 3, 3)
        A proper rotation, never a reflection.
    t : ndarray, shape (..., 3)
    """
    p, q = as_array("p", p, ("...", "n", 3)), as_array("q", q, ("...", "n", 3))
    if p.shape != q.shape:
        raise ValueError(f"q: expected the shape of p {p.shape}, got {q.shape}")
    mean_p, mean_q = p.mean(-2, keepdims=True), q.mean(-2, keepdims=True)
    U, _, Vt = np.linalg.svd(np.swapaxes(q - mean_q, -1, -2) @ (p - mean_p))
    # R = U diag(1, 1, det) V^T: the last axis turns round where U V^T would be a mirror.
    U[..., :, 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    R = U @ Vt
    return R, (mean_q - mean_p @ np.swapaxes(R, -1, -2))[..., 0, :]


@dataclass(frozen=True)
class StereoOdometer:
    """A stereo pair on the robot, looking ahead, that measures its own motion.

    Two cameras with parallel axes stand side by side; a point is seen as (u, v) in the left
    picture and u in the right one. Motion is estimated from points seen before and after a step:
    three matches at a time propose a rigid motion, the motion with the smallest sum of clipped
    errors wins, and its followers are fitted again, weighted by what a pixel does to each of them.

    Parameters
    ----------
    focal : float
        Focal length (pixels).
    baseline : float
        Distance between the cameras (m).
    width, height : float
        Size of a picture (pixels).
    sigma_pixel : float
        Standard deviation of u and v (pixels).
    outliers : float
        Share of matches that belong to another point, in [0, 1).
    max_matches : int
        So many matches at most are used, 3 or more.
    camera_height : float
        Height of the cameras above the floor (m).
    n_trials : int
        Proposals of the random search.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> motions = StereoOdometer().run([[0, 0, 0], [0.2, 0, 0]], room_points(rng), rng)
    >>> round(float(motions[0].increment[0]), 1)
    0.2
    """

    focal: float = 500.0
    baseline: float = 0.2
    width: float = 640.0
    height: float = 480.0
    sigma_pixel: float = 0.5
    outliers: float = 0.2
    max_matches: int = 60
    camera_height: float = 0.5
    n_trials: int = 60

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("focal", "baseline", "width", "height", "sigma_pixel"):
            as_scalar(name, getattr(self, name), low=1e-12, high=1e9)
        as_scalar("outliers", self.outliers, low=0.0, high=0.99)
        as_scalar("camera_height", self.camera_height, low=-1e9, high=1e9)
        as_count("max_matches", self.max_matches, 3)
        as_count("n_trials", self.n_trials, 1)

    def project(self, pose: ArrayLike, points: ArrayLike) -> Array:
        """Pictures of points: u and v on the left, u on the right (pixels from the centre).

        Parameters
        ----------
        pose : array_like, shape (3,)
        points : array_like, shape (n, 3)

        Returns
        -------
        ndarray, shape (n, 3)
            NaN where a point is behind, or outside one of the pictures.
        """
        pose, points = as_array("pose", pose, (3,)), as_array("points", points, ("n", 3))
        seen = self._pixels(_to_body(pose, points, self.camera_height))
        inside = (np.abs(seen[:, [0, 2]]) <= 0.5 * self.width).all(1)
        inside &= np.abs(seen[:, 1]) <= 0.5 * self.height
        return np.where(inside[:, None], seen, np.nan)

    def _pixels(self, body: Array) -> Array:
        """Pinhole: u = -f y / x, v = -f z / x, and the right camera stands b to the right."""
        x, y, z = body[..., 0], body[..., 1], body[..., 2]
        depth = np.where(x > 0.1, x, np.nan)
        f, half = self.focal, 0.5 * self.baseline
        return np.stack([f * (half - y) / depth, -f * z / depth, f * (-half - y) / depth], -1)

    def _pixel_jacobians(self, body: Array) -> Array:
        """Derive `_pixels` at points: (n, 3, 3); the inverse is that of `triangulate`."""
        J = np.zeros((len(body), 3, 3))
        J[:, :, 0] = -self._pixels(body) / body[:, :1]
        J[:, 0, 1] = J[:, 1, 2] = J[:, 2, 1] = -self.focal / body[:, 0]
        return J

    def triangulate(self, pixels: ArrayLike) -> Array:
        """Points (..., 3) of the body frame, ahead, left, up (m), from pictures (..., 3)."""
        pixels = as_shaped("pixels", pixels, ("...", 3))
        u, v, right = pixels[..., 0], pixels[..., 1], pixels[..., 2]
        # Depth from disparity: x = f b / (u_left - u_right).
        x = self.focal * self.baseline / np.maximum(u - right, 1e-3)
        return np.stack([x, -0.5 * (u + right) * x / self.focal, -v * x / self.focal], -1)

    def observe(self, pose: ArrayLike, points: ArrayLike, rng: np.random.Generator) -> Array:
        """Take the picture of `project` with noise."""
        seen = self.project(pose, points)
        return seen + self.sigma_pixel * as_rng("rng", rng).standard_normal(seen.shape)

    def match(self, before: Array, after: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Pair what both pictures show; some pairs are wrong. Returns two arrays (m, 3)."""
        before, after = as_shaped("before", before, ("m", 3)), as_shaped("after", after, ("m", 3))
        if len(before) != len(after):
            raise ValueError(f"after: expected {len(before)} rows as before, got {len(after)}")
        rng = as_rng("rng", rng)
        both = np.flatnonzero(np.isfinite(before).all(1) & np.isfinite(after).all(1))
        if len(both) > self.max_matches:
            both = np.sort(rng.choice(both, self.max_matches, replace=False))
        partner = both.copy()
        wrong = np.flatnonzero(rng.random(len(both)) < self.outliers)
        partner[wrong] = both[(wrong + rng.integers(1, max(len(both), 2), len(wrong))) % len(both)]
        return before[both], after[partner]

    def estimate(self, before: Array, after: Array, rng: np.random.Generator) -> MeasuredMotion:
        """Estimate the motion from matched pictures (m, 3) before and after.

        Raises
        ------
        ValueError
            If there are fewer than three matches, or no three agree with one motion.
        """
        before = as_array("before", before, ("m", 3))
        after = as_array("after", after, (len(before), 3))
        if len(before) < 3:
            raise ValueError(f"before: expected at least three matches, got {len(before)}")
        motion = self._search(before, after, as_rng("rng", rng))
        points = self.triangulate(before)
        to_point = np.linalg.inv(self._pixel_jacobians(points))
        # The followers of the proposal, then of their own fit, in an ever narrower gate.
        for gate in (20.0, 8.0, 3.5, 3.5):
            error = np.abs(self._errors(motion, before, after))
            inliers = (error < gate * self.sigma_pixel * np.sqrt(2.0)).all(-1)
            if inliers.sum() < 3:
                raise ValueError("after: expected three matches that agree, got fewer")
            motion, cov = self._refine(motion, points[inliers], to_point[inliers], after[inliers])
        return MeasuredMotion(motion, cov, inliers)

    def _errors(self, motion: Array, before: Array, after: Array) -> Array:
        """Pixels by which the second picture differs from what a motion predicts, (m, 3)."""
        return after - self._pixels(_to_body(motion, self.triangulate(before)))

    def _search(self, before: Array, after: Array, rng: np.random.Generator) -> Array:
        """Random search: three matches propose a motion; smallest sum of clipped errors wins."""
        p, q = self.triangulate(before), self.triangulate(after)
        triples = np.argsort(rng.random((self.n_trials, len(p))), axis=1)[:, :3]
        R, t = rigid_motion(p[triples], q[triples])
        # Seen from the body the world moves by the inverse of the body's motion; in the plane.
        turn = np.arctan2(R[:, 0, 1] - R[:, 1, 0], R[:, 0, 0] + R[:, 1, 1])
        c, s = np.cos(turn), np.sin(turn)
        x, y = -c * t[:, 0] + s * t[:, 1], -s * t[:, 0] - c * t[:, 1]
        proposals = np.stack([x, y, turn], -1)
        error = np.abs(self._errors(proposals[:, None], before, after)).max(-1)
        limit = 20.0 * self.sigma_pixel
        return proposals[np.where(error < limit, error, limit).sum(-1).argmin()]

    def _refine(
        self, motion: Array, points: Array, to_point: Array, after: Array
    ) -> tuple[Array, Array]:
        """Gauss-Newton on the second picture over x, y, theta; covariance from both pictures."""
        for _ in range(4):
            body = _to_body(motion, points)
            error = after - self._pixels(body)
            to_pixel = self._pixel_jacobians(body)
            c, s = np.cos(motion[2]), np.sin(motion[2])
            R = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
            # d body / d (x, y, theta): -R^T for the shift; the turn moves (x, y) to (y, -x).
            d_body = np.zeros((len(points), 3, 3))
            d_body[:, :, :2] = -R[:, :2]
            d_body[:, 0, 2], d_body[:, 1, 2] = body[:, 1], -body[:, 0]
            H = to_pixel @ d_body
            from_first = to_pixel @ R @ to_point
            S = self.sigma_pixel**2 * (np.eye(3) + from_first @ np.swapaxes(from_first, -1, -2))
            weighted = np.linalg.solve(S, H)
            information = H.reshape(-1, 3).T @ weighted.reshape(-1, 3)
            step = np.linalg.solve(information, weighted.reshape(-1, 3).T @ error.ravel())
            motion = motion + step
            if np.abs(step).max() < 1e-9:
                break
        cov = np.linalg.inv(information)
        motion[2] = wrap_angle(motion[2])
        return motion, 0.5 * (cov + cov.T)

    def run(
        self, poses: ArrayLike, points: ArrayLike, rng: np.random.Generator
    ) -> list[MeasuredMotion]:
        """Estimate every step of a drive; a picture serves the step before and the step after.

        Parameters
        ----------
        poses : array_like, shape (n, 3)
            True poses, ten a second.
        points : array_like, shape (m, 3)
            Points of the room.
        rng : numpy.random.Generator

        Returns
        -------
        list of MeasuredMotion, n - 1 of them
        """
        poses, rng = as_array("poses", poses, ("n", 3)), as_rng("rng", rng)
        motions, before = [], None
        for pose in poses:
            after = self.observe(pose, points, rng)
            if before is not None:
                motions.append(self.estimate(*self.match(before, after, rng), rng))
            before = after
        return motions


def _to_body(pose: Array, points: Array, camera_height: float = 0.0) -> Array:
    """Points seen from a pose, or those of the body frame before a step from the body after it."""
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    dx, dy = points[..., 0] - pose[..., 0], points[..., 1] - pose[..., 1]
    z = np.broadcast_to(points[..., 2] - camera_height, dx.shape)
    return np.stack([c * dx + s * dy, -s * dx + c * dy, z], -1)


@dataclass(frozen=True, eq=False)
class VisualOdometer:
    """A light stand-in for a visual odometer: relative increments with Gaussian noise.

    The covariance of an increment is a part for every step, one that grows with the square of
    the distance, and one with the square of the turn; so that heading is a random walk.

    Parameters
    ----------
    cov_step, cov_distance, cov_turn : array_like, shape (3, 3)
        Covariances (m, m, rad), for a step, for 1 m and for 1 rad.

    Examples
    --------
    >>> odometer = VisualOdometer.simple(sigma_position=0.001, sigma_heading=0.002)
    >>> odometer.cov([0.1, 0, 0]).diagonal().round(9).tolist()
    [1e-06, 1e-06, 4e-06]
    """

    cov_step: Array
    cov_distance: Array
    cov_turn: Array

    def __post_init__(self) -> None:
        """Check the covariances."""
        for name in ("cov_step", "cov_distance", "cov_turn"):
            object.__setattr__(self, name, as_covariance(name, getattr(self, name), 3))

    @classmethod
    def simple(
        cls,
        sigma_position: float,
        sigma_heading: float,
        distance_error: float = 0.0,
        turn_error: float = 0.0,
    ) -> VisualOdometer:
        """Build one from four numbers.

        The noise is one of each step, however short: the stereo pair of chapter 17, ten times a
        second in a small room, has about 0.009 m and 0.005 rad, and drifts 0.2 m in 50 s.

        Parameters
        ----------
        sigma_position, sigma_heading : float
            Noise of every step (m) and (rad).
        distance_error : float
            Relative error of the distance.
        turn_error : float
            Relative error of a turn.
        """
        sigma_position = as_scalar("sigma_position", sigma_position, 0.0, 1e9)
        sigma_heading = as_scalar("sigma_heading", sigma_heading, 0.0, 1e9)
        distance_error = as_scalar("distance_error", distance_error, 0.0, 1e9)
        turn_error = as_scalar("turn_error", turn_error, 0.0, 1e9)
        step = np.diag([sigma_position, sigma_position, sigma_heading]) ** 2
        return cls(step, np.diag([distance_error**2] * 2 + [0]), np.diag([0, 0, turn_error**2]))

    def cov(self, increment: ArrayLike) -> Array:
        """Covariance (..., 3, 3) of a measured increment (..., 3)."""
        increment = as_array("increment", increment, ("...", 3))
        squared = (increment[..., :2] ** 2).sum(-1)[..., None, None]
        turn = (increment[..., 2] ** 2)[..., None, None]
        return self.cov_step + squared * self.cov_distance + turn * self.cov_turn

    def measure(self, before: ArrayLike, after: ArrayLike, rng: np.random.Generator) -> Array:
        """Measure the step between true poses, with fresh noise for each.

        Parameters
        ----------
        before, after : array_like, shape (..., 3)
            True poses.
        rng : numpy.random.Generator

        Returns
        -------
        ndarray, shape (..., 3)
            The measured increment: pose after, seen from before.
        """
        increment, rng = between(before, after), as_rng("rng", rng)
        # The symmetric root: unlike eigenvectors it has no sign to choose.
        values, vectors = np.linalg.eigh(self.cov(increment))
        scaled = vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :]
        noise = np.swapaxes(vectors, -1, -2) @ rng.standard_normal((*increment.shape, 1))
        noisy = increment + (scaled @ noise)[..., 0]
        noisy[..., 2] = wrap_angle(noisy[..., 2])
        return noisy

    def run(
        self, poses: ArrayLike, rng: np.random.Generator, start: ArrayLike | None = None
    ) -> Array:
        """Dead-reckoned poses (..., n, 3) of a drive along true poses (..., n, 3)."""
        poses = as_array("poses", poses, ("...", "n", 3))
        if poses.shape[-2] == 0:
            raise ValueError(f"poses: expected at least one pose, got shape {poses.shape}")
        increments = self.measure(poses[..., :-1, :], poses[..., 1:, :], rng)
        track = np.empty_like(poses)
        track[..., 0, :] = poses[..., 0, :] if start is None else as_array("start", start, (3,))
        for k in range(increments.shape[-2]):
            track[..., k + 1, :] = compose(track[..., k, :], increments[..., k, :])
        return track


def fit_noise(true_steps: ArrayLike, measured_steps: ArrayLike) -> VisualOdometer:
    """Fit the light model to drives of a real odometer, by least squares on products of errors.

    Parameters
    ----------
    true_steps, measured_steps : array_like, shape (n, 3)
        At least ten increments, true and as the odometer measured them; of different speeds and
        turns.

    Returns
    -------
    VisualOdometer

    Examples
    --------
    >>> rng, steps = np.random.default_rng(0), np.tile([[0.02, 0, 0], [0, 0, 0.03]], (200, 1))
    >>> measured = VisualOdometer.simple(0.01, 0.01).measure(np.zeros(3), steps, rng)
    >>> np.sqrt(fit_noise(steps, measured).cov([0.02, 0, 0]).diagonal()).round(2).tolist()
    [0.01, 0.01, 0.01]
    """
    true_steps = as_array("true_steps", true_steps, ("n", 3))
    measured = as_array("measured_steps", measured_steps, true_steps.shape)
    if len(true_steps) < 10:
        raise ValueError(f"true_steps: expected at least ten steps, got {len(true_steps)}")
    error = between(true_steps, measured)
    error -= error.mean(0)
    # E e e^T = cov_step + distance^2 cov_distance + turn^2 cov_turn
    squared, turn = (true_steps[:, :2] ** 2).sum(1), true_steps[:, 2] ** 2
    design = np.stack([np.ones(len(error)), squared, turn], -1)
    products = (error[:, :, None] * error[:, None, :]).reshape(-1, 9)
    scale = np.maximum(np.abs(design).max(0), 1e-300)
    parts = np.linalg.lstsq(design / scale, products, rcond=1e-6)[0] / scale[:, None]
    return VisualOdometer(*(_nearest_covariance(part.reshape(3, 3)) for part in parts))


def _nearest_covariance(matrix: Array) -> Array:
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return vectors * np.clip(values, 0.0, None) @ vectors.T
