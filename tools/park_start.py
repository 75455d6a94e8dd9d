"""Victoria Park, its first 1500 steps: chapter 12b's stored trial.

python tools/park_start.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/park_start.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import run
from tools.trials import Trial, main
from tools.victoria_park import SCALES, SYSTEMS, judged, park

STEPS = 1500  # 0.9 km
NAMES = ("EKF-SLAM", "EKF-SLAM, invariant", "FastSLAM 1.0", "FastSLAM 2.0")
SEEDS = {name: range(SYSTEMS[name][1]) for name in NAMES}


def one(name, scale, seed):
    """Run a system over the start with the odometry's variance of the file times `scale`."""
    log = park()[:STEPS]
    log = replace(log, control_cov=log.control_cov * float(scale))
    return judged(run(SYSTEMS[name][0](seed), log, every=10), told=True)


TRIAL = Trial(
    "park_start",
    {(name, str(scale)): SEEDS[name] for name in NAMES for scale in SCALES},
    one,
    sample=(("EKF-SLAM", "1", 0), ("FastSLAM 2.0", "25", 3)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
