"""A lab's system at the other end of the pipe, driven like any other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array
from slamlab.commands._process import Process
from slamlab.models import View

__all__ = ["RemoteSmoother", "RemoteSystem", "remote_system"]


def remote_system(process: Process, setting: Any) -> RemoteSystem:
    """Return the system that the file's `make` builds for a drive."""
    process.start_clock()
    came = process.ask("make", setting)
    return (RemoteSmoother if came["smoother"] else RemoteSystem)(process, came["measures"])


class RemoteSystem:
    """A student's system at the other end of the pipe: an Estimator, and a Pilot if it is one."""

    def __init__(self, process: Process, measures: str) -> None:
        self.measures, self._process = measures, process
        self._pose, self._cov = np.zeros(3), np.zeros((3, 3))
        self._take(process.ask("belief"))

    def __repr__(self) -> str:
        """Return where it believes to be."""
        return f"RemoteSystem({np.round(self._pose, 2).tolist()})"

    @property
    def pose(self) -> Array:
        """Estimated pose (3,), a copy."""
        return self._pose.copy()

    @property
    def pose_cov(self) -> Array:
        """Its covariance (3, 3), a copy."""
        return self._cov.copy()

    def predict(self, u: ArrayLike, dt: float, control_cov: ArrayLike) -> None:
        """Move."""
        self._take(self._process.ask("predict", u, dt, control_cov))

    def update(self, measurement: ArrayLike, ids: Any = None) -> None:
        """Take in a measurement."""
        given = (measurement,) if self.measures == "scan" else (measurement, ids)
        self._take(self._process.ask("update", *given))

    def command(self, view: View) -> Array | None:
        """Return the next control, None when the student's pilot is done."""
        u = self._process.ask("command", view)
        return None if u is None else as_array("command", u, ("p",))

    def _take(self, belief: dict[str, Any]) -> None:
        self._pose = as_array("pose", belief["pose"], (3,))
        self._cov = as_array("pose_cov", belief["cov"], (3, 3))


class RemoteSmoother(RemoteSystem):
    """A student's system that revises its past."""

    @property
    def trajectory(self) -> Array:
        """Best poses (T, 3) of all steps so far."""
        return as_array("trajectory", self._process.ask("trajectory"), ("T", 3))
