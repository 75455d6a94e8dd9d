"""The formulas of P2 as the paper prints them, as filters that can be run.

P2 (9) read alone. For tests and for chapter 10.
"""

from __future__ import annotations

from slamlab._checks import Array
from slamlab.slam import EKFSlamBatch

__all__ = ["ForgetsCrossCovariance"]


class ForgetsCrossCovariance(EKFSlamBatch):
    """A filter that predicts P_xx and leaves P_xm as it was: what P2 (9) says if read alone."""

    def move_cov(self, F: Array, Q: Array) -> None:
        """Move the covariance of the pose and nothing else."""
        cross = self._P[:, :3, 3:].copy()
        super().move_cov(F, Q)
        self._P[:, :3, 3:], self._P[:, 3:, :3] = cross, cross.swapaxes(1, 2)
