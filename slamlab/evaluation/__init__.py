"""How well a filter did: consistency, trajectories, repeated runs."""

from slamlab.evaluation.association_runs import Loop, LoopRun, run_loop, simulate_loop
from slamlab.evaluation.consistency import chi2_band, monte_carlo, nees, nis
from slamlab.evaluation.relations import relation_error
from slamlab.evaluation.run import Run, run
from slamlab.evaluation.trajectory import TrajectoryError, align, ate, rpe
from slamlab.evaluation.wall_maps import WallScores, seen_lengths, wall_scores

__all__ = [
    "Loop",
    "LoopRun",
    "Run",
    "TrajectoryError",
    "WallScores",
    "align",
    "ate",
    "chi2_band",
    "monte_carlo",
    "nees",
    "nis",
    "relation_error",
    "rpe",
    "run",
    "run_loop",
    "seen_lengths",
    "simulate_loop",
    "wall_scores",
]
