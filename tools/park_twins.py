"""Twins of Victoria Park: its path and trees, with odometry and observations drawn anew.

python tools/park_twins.py      (half an hour; options as in tools/trials.py)

Writes slamlab/datasets/data/park_twins.json, which chapters 10c and 12c read. On a twin the noise
is what the filter is given, and the truth is known; `twin` is the function of page 12c.
"""

import sys
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import victoria_park
from slamlab.evaluation import run
from slamlab.logs import Log
from slamlab.slam import EKFSlam, FastSlam
from tools.trials import Trial, main, of_page

page = of_page("12c_fastslam", "world", "odometry", "everyday")
WORLD = page["world"]
SYSTEMS = {
    "EKF-SLAM": lambda seed: EKFSlam(*WORLD),
    "EKF-SLAM, first estimates": lambda seed: EKFSlam(*WORLD, linearisation="first-estimates"),
    "EKF-SLAM, invariant": lambda seed: EKFSlam(*WORLD, linearisation="invariant"),
    "FastSLAM 2.0": lambda seed: FastSlam(*WORLD, 100, 2, rng=np.random.default_rng(seed)),
}
EARLY = 1500  # steps, 0.9 km


@cache
def park_twin(seed: int) -> Log:
    return page["twin"](victoria_park(), seed)


def one(park: str, name: str, seed: int) -> dict:
    """Errors (m, root mean square): of the path, of its first part, and of the trees.

    None where the system ends with a matrix that is no covariance.
    """
    log = park_twin(seed)
    try:
        result = run(SYSTEMS[name](seed), log, every=10)
    except ValueError:
        return dict.fromkeys(("early", "error", "trees"))
    off = np.hypot(*(result.poses - result.truth)[:, :2].T)
    trees = result.system.landmarks - log.landmarks[list(result.system.ids)]
    early = result.times <= log.times[EARLY - 1]
    found = {
        "early": np.sqrt((off[early] ** 2).mean()),
        "error": np.sqrt((off**2).mean()),
        "trees": np.sqrt((trees**2).sum(1).mean()),
    }
    return {key: float(f"{value:.3g}") for key, value in found.items()}


TRIAL = Trial(
    "park_twins",
    {("Victoria Park", name): range(20) for name in SYSTEMS},
    one,
    sample=(("Victoria Park", "EKF-SLAM", 0), ("Victoria Park", "FastSLAM 2.0", 3)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
