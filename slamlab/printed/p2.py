"""The formulas of P2 as the paper prints them, as filters that can be run.

P2 (9) read alone, and the forced decorrelation of its history. For tests and for chapter 10.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array
from slamlab.slam import EKFSlamBatch
from slamlab.slam.batch import Innovation

__all__ = ["ForcedDecorrelation", "ForgetsCrossCovariance"]


class ForgetsCrossCovariance(EKFSlamBatch):
    """A filter that predicts P_xx and leaves P_xm as it was: what P2 (9) says if read alone."""

    def move_cov(self, F: Array, Q: Array) -> None:
        """Move the covariance of the pose and nothing else."""
        cross = self._P[:, :3, 3:].copy()
        super().move_cov(F, Q)
        self._P[:, :3, 3:], self._P[:, 3:, :3] = cross, cross.swapaxes(1, 2)


class ForcedDecorrelation(EKFSlamBatch):
    """A filter that keeps pose and landmarks apart: all cross-covariances are set to zero."""

    def update(self, z: ArrayLike, ids: ArrayLike | None = None) -> Innovation:
        """Correct as ever, then forget what pose and landmarks have in common."""
        innovation = super().update(z, ids)
        owner = np.repeat(np.arange(1 + len(self.ids)), [3] + [2] * len(self.ids))
        self._P *= owner[:, None] == owner
        return innovation
