"""P4's region S_1 read word by word: only the block of the region is corrected. Chapter 16."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.slam import CompressedEKFSlam

__all__ = ["LocalBlockSlam"]


class LocalBlockSlam(CompressedEKFSlam):
    """`CompressedEKFSlam` that never tells the rest of the map what the region has learned.

    P_aa is corrected, P_ab and P_bb stay as they were: Phi = I, Psi = 0, theta = 0.
    """

    def predict(self, *step: Any) -> None:
        """As `EKFSlam.predict`, in the region, and nowhere else."""
        super().predict(*step)
        self._forget()

    def update(self, *measured: Any) -> Any:
        """As `EKFSlam.update`, in the region, and nowhere else."""
        report = super().update(*measured)
        self._forget()
        return report

    def _forget(self) -> None:
        n = len(self._Psi)
        self._Phi[:n] = np.eye(n)
        self._Psi[:], self._theta[:] = 0.0, 0.0
