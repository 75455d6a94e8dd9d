"""Where am I in a known map?."""

from slamlab.localization.dead_reckoning import DeadReckoning
from slamlab.localization.likelihood_field import LikelihoodField
from slamlab.localization.monte_carlo import MonteCarloLocalization
from slamlab.localization.signature import SignatureMap, autocorrelation, spectrum, three_numbers

__all__ = [
    "DeadReckoning",
    "LikelihoodField",
    "MonteCarloLocalization",
    "SignatureMap",
    "autocorrelation",
    "spectrum",
    "three_numbers",
]
