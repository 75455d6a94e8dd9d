"""A world of points without extent, as a range-bearing sensor sees it: chapters 09 to 12."""

from __future__ import annotations

from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array
from slamlab.models import Bounds

__all__ = ["LandmarkWorld"]


class LandmarkWorld:
    """Point landmarks on an open floor.

    Parameters
    ----------
    points : array_like, shape (n, 2)
        Landmarks in the world (m), at least one; their row is their identity.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        Read-only.

    Examples
    --------
    >>> LandmarkWorld([[0, 0], [4, 3]]).bounds
    (0.0, 0.0, 4.0, 3.0)
    """

    def __init__(self, points: ArrayLike) -> None:
        self.points: Array = as_array("points", points, ("n", 2)).astype(float)
        if len(self.points) == 0:
            raise ValueError("points: expected at least one landmark, got none")
        self.points.setflags(write=False)

    def __len__(self) -> int:
        """Return the number of landmarks."""
        return len(self.points)

    def __repr__(self) -> str:
        """Return the number of landmarks."""
        return f"LandmarkWorld({len(self)} landmarks)"

    @property
    def bounds(self) -> Bounds:
        """Left, bottom, right and top of the box around all landmarks (m)."""
        left, bottom = self.points.min(0)
        right, top = self.points.max(0)
        return float(left), float(bottom), float(right), float(top)
