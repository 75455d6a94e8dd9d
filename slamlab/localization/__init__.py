"""Where am I in a known map?."""

from slamlab.localization.dead_reckoning import DeadReckoning
from slamlab.localization.global_localization import GlobalLocalization
from slamlab.localization.likelihood_field import LikelihoodField
from slamlab.localization.monte_carlo import MonteCarloLocalization
from slamlab.localization.signature import (
    Location,
    SignatureMap,
    autocorrelation,
    spectrum,
    three_numbers,
)

__all__ = [
    "DeadReckoning",
    "GlobalLocalization",
    "LikelihoodField",
    "Location",
    "MonteCarloLocalization",
    "SignatureMap",
    "autocorrelation",
    "spectrum",
    "three_numbers",
]
