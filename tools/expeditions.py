"""Send robots out and home again: the stored table of chapter 20, run by run.

python tools/expeditions.py      (a run takes 10 to 60 s; options as in tools/trials.py)

Several of these may run side by side. Writes slamlab/datasets/data/expeditions.json, which
`simulation.expedition.results` reads.
"""

import sys
from itertools import product
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.simulation.expedition import (
    ENVIRONMENTS,
    ESTIMATORS,
    RETURN_METHODS,
    come_home,
    explore,
)
from tools.trials import Trial, main


def one(building, belief, seed):
    """One way out and all ways home, in few digits."""
    out = explore(ENVIRONMENTS[building], ESTIMATORS[belief], seed)
    homes = [come_home(out, way) for way in RETURN_METHODS]
    return {
        "coverage": round(float(out.coverage), 4),
        "error": [round(home.error, 3) for home in homes],
        "believed": [round(home.believed, 3) for home in homes],
        "nees": [float(f"{home.nees:.3g}") for home in homes],
        "touched": [int(home.touched) for home in homes],
        "seconds": [round(home.seconds) for home in homes],
        "metres": [round(home.metres) for home in homes],
    }


TRIAL = Trial(
    "expeditions",
    dict.fromkeys(product(ENVIRONMENTS, ESTIMATORS), range(30)),
    one,
    sample=(("corridor", "dead reckoning", 0), ("office", "scan graph", 17)),
    rel=0.1,
    off=0.01,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
