"""The square robot of the lidar thesis (P5): it turns on the spot, drives forward and back.

`SquareRobot` knows its body and tests a motion against the points of a scan, exactly. P5's own
test is `slamlab.printed.p5.can_move_as_printed`; chapter 18 counts what it costs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_positive, as_scalar, as_shaped
from slamlab.geometry import wrap_angle

__all__ = ["SquareRobot"]


class SquareRobot:
    """A square body with its centre at the pose, driven along its heading or turned in place.

    Parameters
    ----------
    side : float, default 0.30
        Side of the square (m), positive; P5's robot has 30 pixels of 1 cm.

    Attributes
    ----------
    side, half : float
        The side and half of it (m).
    circumradius : float
        Distance from the centre to a corner (m): P5's figure 14 draws this circle, the area that
        a full turn needs.
    footprint : ndarray, shape (4, 2)
        Corners in the body frame (m), counterclockwise from the front right one.

    Examples
    --------
    >>> robot = SquareRobot(0.30)
    >>> robot.forward([1.0, 1.0, np.pi / 2], 0.5).round(3).tolist()
    [1.0, 1.5, 1.571]
    >>> bool(robot.drive_hits([[0.40, 0.14]], 0.30)), bool(robot.drive_hits([[0.40, 0.16]], 0.30))
    (True, False)
    """

    def __init__(self, side: float = 0.30) -> None:
        self.side = as_positive("side", side, 1e9)
        self.half = 0.5 * self.side
        self.circumradius = self.half * float(np.sqrt(2.0))
        corners = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
        self.footprint = self.half * corners

    def __repr__(self) -> str:
        """Return the side."""
        return f"SquareRobot(side={self.side:g})"

    def turn(self, pose: ArrayLike, angle: ArrayLike) -> Array:
        """Turn on the spot (P5's `Turn`).

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        angle : array_like, shape (...)
            Radians, counterclockwise positive. P5's screen has y down: its positive angle is
            clockwise there.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        pose, angle = as_array("pose", pose, ("...", 3)), as_array("angle", angle)
        theta = wrap_angle(pose[..., 2] + angle)
        x, y, theta = np.broadcast_arrays(pose[..., 0], pose[..., 1], theta)
        return np.stack([x, y, theta], -1)

    def forward(self, pose: ArrayLike, distance: ArrayLike) -> Array:
        """Drive along the heading (P5's `Move`), backward if the distance is negative.

        Parameters
        ----------
        pose : array_like, shape (..., 3)
        distance : array_like, shape (...)
            Metres.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        pose, distance = as_array("pose", pose, ("...", 3)), as_array("distance", distance)
        theta = pose[..., 2]
        # P5's unit vector through centre and front is (cos theta, sin theta).
        x = pose[..., 0] + distance * np.cos(theta)
        y = pose[..., 1] + distance * np.sin(theta)
        return np.stack([x, y, np.broadcast_to(theta, x.shape)], -1)

    def drive_hits(
        self, points: ArrayLike, distance: ArrayLike, margin: float = 0.0
    ) -> NDArray[np.bool_]:
        """Whether driving straight would touch one of the points: the exact swept rectangle.

        Parameters
        ----------
        points : array_like, shape (..., k, 2)
            Points in the body frame (m), such as ``lidar.points(ranges)``; NaN is no point.
        distance : array_like, shape (...)
            How far (m), negative for backward.
        margin : float, default 0.0
            The body is taken this much larger on every side (m); not negative.

        Returns
        -------
        ndarray of bool, shape (...)
            True if a point lies inside the area that the body covers on the way, its start
            included. A point on the border is no hit.
        """
        x, y, half = self._near(points, margin)
        far = as_array("distance", distance)[..., None]
        # |d sin(phi)| < h  and  -h - back < d cos(phi) < h + forth
        ahead = (x > np.minimum(far, 0.0) - half) & (x < np.maximum(far, 0.0) + half)
        return np.asarray((ahead & (np.abs(y) < half)).any(-1))

    def turn_hits(
        self, points: ArrayLike, angle: ArrayLike, margin: float = 0.0
    ) -> NDArray[np.bool_]:
        """Whether turning on the spot would touch one of the points: the exact swept area.

        Between the inscribed and the circumscribed circle the square leaves four gaps. A point
        there stays free if the turn keeps it inside its gap.

        Parameters
        ----------
        points : array_like, shape (..., k, 2)
            Points in the body frame before the turn (m); NaN is no point.
        angle : array_like, shape (...)
            Radians, counterclockwise positive.
        margin : float, default 0.0
            The body is taken this much larger on every side (m); not negative.

        Returns
        -------
        ndarray of bool, shape (...)
        """
        x, y, half = self._near(points, margin)
        angle = as_array("angle", angle)[..., None]
        r = np.hypot(x, y)
        # Half the angle of a gap at radius r: cos(gap) = h / r.
        gap = np.arccos(np.minimum(half / np.maximum(r, half), 1.0))
        quarter = 0.5 * np.pi
        bearing = np.arctan2(y, x)
        bearing = bearing - quarter * np.rint(bearing / quarter)
        stays = (np.abs(bearing) <= gap) & (np.abs(bearing - angle) <= gap)
        return np.asarray(((r < half) | ((r < half * np.sqrt(2.0)) & ~stays)).any(-1))

    def free_distance(self, points: ArrayLike, margin: float = 0.0) -> Array:
        """How far the body can drive ahead until it touches a point.

        Parameters
        ----------
        points : array_like, shape (..., k, 2)
            Points in the body frame (m); NaN is no point.
        margin : float, default 0.0
            The body is taken this much larger on every side (m); not negative.

        Returns
        -------
        ndarray, shape (...)
            Metres; inf if no point lies in the way, 0 if one is touched already.
        """
        x, y, half = self._near(points, margin)
        in_the_way = (np.abs(y) < half) & (x > -half)
        gap = np.where(in_the_way, np.maximum(x - half, 0.0), np.inf)
        return gap.min(axis=-1, initial=np.inf)

    def _near(self, points: ArrayLike, margin: float) -> tuple[Array, Array, float]:
        """Coordinates x and y of the points, and half the side with its margin."""
        points = as_shaped("points", points, ("...", "k", 2))
        half = self.half + as_scalar("margin", margin, 0.0, 1e9)
        return points[..., 0], points[..., 1], half
