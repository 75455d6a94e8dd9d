"""How well a filter did: consistency, trajectories, repeated runs."""

from slamlab.evaluation.association_scores import association_scores
from slamlab.evaluation.consistency import chi2_band, invariant_nees, monte_carlo, nees, nis
from slamlab.evaluation.relations import relation_error
from slamlab.evaluation.run import run
from slamlab.evaluation.trajectory import align, ate, rpe
from slamlab.evaluation.trials import Trial, changed, trial
from slamlab.evaluation.wall_maps import line_errors, seen_lengths, wall_scores

__all__ = [
    "Trial",
    "align",
    "ate",
    "association_scores",
    "changed",
    "chi2_band",
    "invariant_nees",
    "line_errors",
    "monte_carlo",
    "nees",
    "nis",
    "relation_error",
    "rpe",
    "run",
    "seen_lengths",
    "trial",
    "wall_scores",
]
