"""How often the fuzz tests try, and with which damage: ``make fuzz N=3 SEED=7``.

Once, and always the same, in the unit tests.
"""

import os

import numpy as np

ROUNDS = int(os.environ.get("SLAMLAB_FUZZ", "1"))
SEED = int(os.environ.get("SLAMLAB_FUZZ_SEED", "0"))


def damage(number):
    """Random numbers for the damage of one test, others with every seed."""
    return np.random.default_rng(number if SEED == 0 else [SEED, number])
