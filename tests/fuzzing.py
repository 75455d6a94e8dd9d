"""How often the fuzz tests try: once in the unit tests, N times by ``make fuzz N=3``."""

import os

ROUNDS = int(os.environ.get("SLAMLAB_FUZZ", "1"))
