"""How well a filter did: consistency, trajectories, repeated runs. Floor 5 of the house."""

from slamlab.evaluation.consistency import chi2_band, monte_carlo, nees, nis
from slamlab.evaluation.trajectory import TrajectoryError, align, ate, rpe

__all__ = ["TrajectoryError", "align", "ate", "chi2_band", "monte_carlo", "nees", "nis", "rpe"]
