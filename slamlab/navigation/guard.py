"""What keeps a body off what the scan shows: its rectangle, and a guard of its velocity.

The guard moves the body ahead by P1 (10), midpoint, for two steps. Chapters 09 and 20.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array, as_array, as_positive, as_scalar

__all__ = ["YOUBOT_BODY", "Body", "CollisionGuard"]

# The guard tries the body in so many places along the next two steps.
_PLACES_AHEAD = 6
# It escapes so fast (m/s).
_ESCAPE_SPEED = 0.1


@dataclass(frozen=True)
class Body:
    """A rectangle around the body centre.

    Parameters
    ----------
    length, width : float
        Sizes along and across the body (m), positive.

    Examples
    --------
    >>> Body(0.6, 0.4)
    Body(length=0.6, width=0.4)
    """

    length: float
    width: float

    def __post_init__(self) -> None:
        """Check the sizes."""
        as_positive("length", self.length, 1e300)
        as_positive("width", self.width, 1e300)

    @property
    def footprint(self) -> Array:
        """Corners in the body frame (m), counterclockwise, shape (4, 2)."""
        corners = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])
        return 0.5 * corners * [self.length, self.width]

    @property
    def circumradius(self) -> float:
        """Distance of the corners from the centre (m)."""
        return 0.5 * float(np.hypot(self.length, self.width))

    def clearance(self, points: Array) -> Array:
        """Distance (m) of points (..., 2), in the body frame, from the body; negative inside."""
        half = 0.5 * np.array([self.length, self.width])
        beside = np.abs(as_array("points", points, ("...", 2))) - half
        outside = np.maximum(beside, 0.0)
        deepest = np.maximum(beside[..., 0], beside[..., 1])
        return np.hypot(outside[..., 0], outside[..., 1]) + np.minimum(deepest, 0.0)


# The platform of the youBot: 0.58 m long, 0.38 m wide.
YOUBOT_BODY = Body(0.58, 0.38)


class CollisionGuard:
    """Slows a body down, or lets it stand still, so that it stays clear of what the scan shows.

    Parameters
    ----------
    body : Body
    margin : float, default 0.06
        It refuses what would bring the body nearer than this to a point of the scan (m); not
        negative. If the body is nearer than half of it, for no wheel obeys exactly, it goes away
        from that point, whatever is desired.

    Examples
    --------
    Ten centimetres from a wall ahead it may not go on, but sidle along:

    >>> wall = np.stack([np.full(41, 0.39), np.linspace(-1, 1, 41)], -1)
    >>> guard = CollisionGuard(YOUBOT_BODY)
    >>> guard.safe_velocity(np.array([0.5, 0.0, 0.0]), wall, 0.2).tolist()
    [0.05, 0.0, 0.0]
    >>> guard.safe_velocity(np.array([0.0, 0.5, 0.0]), wall, 0.2).tolist()
    [0.0, 0.5, 0.0]
    """

    def __init__(self, body: Body, margin: float = 0.06) -> None:
        self._body, self._margin = body, as_scalar("margin", margin, 0, 1e3)

    def __repr__(self) -> str:
        """Return body and margin."""
        return f"CollisionGuard({self._body}, margin={self._margin:g})"

    def safe_velocity(self, desired: Array, points: Array, dt: float) -> Array:
        """Return the part of the body velocity `desired` (3,) that is safe among points (k, 2)."""
        here = float(self._body.clearance(points).min(initial=np.inf))
        # Noise would bring who drives along a wall nearer to it, step by step, until they touch.
        if here < 0.5 * self._margin:
            desired = self.escape_velocity(points)
        # Already nearer than the margin: it may leave, and must not come nearer.
        least = min(self._margin, here - 1e-9)
        # In the open nothing can come so near: most velocities need no closer test.
        if here - self._travel(desired, dt) > least + 1e-9:
            return 1.0 * desired
        for part in ([1, 1, 1], [1, 1, 0], [0, 0, 1]):
            for scale in (1.0, 0.5, 0.25, 0.1):
                u: Array = scale * desired * part
                if self._closest(u, points, dt) >= least:
                    return u
        return np.zeros(3)

    def escape_velocity(self, points: Array) -> Array:
        """Return a slow body velocity (3,) away from the nearest of points (k, 2), k > 0."""
        x, y = points[np.argmin(self._body.clearance(points))]
        return np.array([-x, -y, 0.0]) * (_ESCAPE_SPEED / max(float(np.hypot(x, y)), 1e-9))

    def _travel(self, u: Array, dt: float) -> float:
        """How far any part of the body moves at most within the next two steps (m)."""
        turn = abs(float(u[2])) * self._body.circumradius
        return 2 * dt * (float(np.hypot(u[0], u[1])) + turn)

    def _closest(self, u: Array, points: Array, dt: float) -> float:
        """Least distance from the points within the next two steps if u goes on."""
        t = np.linspace(0, 2 * dt, _PLACES_AHEAD + 1)[1:, None]
        reach = float(np.hypot(u[0], u[1])) * t[-1, 0] + self._body.circumradius + self._margin
        near = points[points[:, 0] ** 2 + points[:, 1] ** 2 < reach**2]
        if len(near) == 0:
            return np.inf
        # Where the points will be, seen from the body after a time t (P1 (10), midpoint).
        half, turned = 0.5 * u[2] * t, u[2] * t
        dx = near[:, 0] - t * (u[0] * np.cos(half) - u[1] * np.sin(half))
        dy = near[:, 1] - t * (u[0] * np.sin(half) + u[1] * np.cos(half))
        c, s = np.cos(turned), np.sin(turned)
        return float(self._body.clearance(np.stack([c * dx + s * dy, c * dy - s * dx], -1)).min())
