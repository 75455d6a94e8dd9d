"""Where am I in a known map?."""

from slamlab.localization.likelihood_field import LikelihoodField
from slamlab.localization.monte_carlo import MonteCarloLocalization
from slamlab.localization.signature import Location, SignatureMap, autocorrelation

__all__ = [
    "LikelihoodField",
    "Location",
    "MonteCarloLocalization",
    "SignatureMap",
    "autocorrelation",
]
