"""Victoria Park, its first 1500 steps: the stored trial of chapters 11b and 12c.

python tools/park_start.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/park_start.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main
from tools.victoria_park import SCALES, SYSTEMS, judged_over, park

STEPS = 1500  # 0.9 km
NAMES = (
    "EKF-SLAM",
    "EKF-SLAM, invariant",
    "nearest neighbour",
    "joint compatibility",
    "nearest neighbour, confirmed",
    "FastSLAM 1.0",
    "FastSLAM 2.0",
)
SEEDS = {name: range(SYSTEMS[name][1]) for name in NAMES}
FACTORS = ("4", "9", "16", "36", "50", "64", "100", "400")  # of the nearest neighbour


def one(name, scale, seed):
    """Run a system over the start of the park."""
    return judged_over(park()[:STEPS], name, scale, seed)


TRIAL = Trial(
    "park_start",
    {(name, str(scale)): SEEDS[name] for name in NAMES for scale in SCALES}
    | {("nearest neighbour", factor): range(1) for factor in FACTORS},
    one,
    sample=(("EKF-SLAM", "1", 0), ("nearest neighbour", "16", 0), ("FastSLAM 2.0", "25", 3)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
