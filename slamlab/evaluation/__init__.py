"""How well a filter did: consistency, trajectories, repeated runs. Floor 5 of the house."""

from slamlab.evaluation.consistency import chi2_band, monte_carlo, nees, nis
from slamlab.evaluation.trajectory import TrajectoryError, align, ate, rpe
from slamlab.evaluation.wall_maps import WallScores, seen_lengths, wall_scores

__all__ = [
    "TrajectoryError",
    "WallScores",
    "align",
    "ate",
    "chi2_band",
    "monte_carlo",
    "nees",
    "nis",
    "rpe",
    "seen_lengths",
    "wall_scores",
]
