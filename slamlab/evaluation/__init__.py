"""How well a filter did: consistency, trajectories, repeated runs. Floor 5 of the house."""

from slamlab.evaluation.consistency import chi2_band, monte_carlo, nees, nis

__all__ = ["chi2_band", "monte_carlo", "nees", "nis"]
