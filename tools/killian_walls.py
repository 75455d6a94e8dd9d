"""EKF-SLAM on the walls of Killian Court, in nine parts: chapter 09b's stored trial.

python tools/killian_walls.py      (a minute; options as in tools/trials.py)

Writes slamlab/datasets/data/killian_walls.json, which `slamlab.datasets.stored_runs` reads. The
noise of the first part is measured against the pose graph, and used on all nine.
"""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import killian
from slamlab.evaluation import run
from slamlab.geometry import between, wrap_angle
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose
from slamlab.slam import WallSlam
from tools.trials import Trial, main

STEPS = 400
BUILDING = {"sigma_wall": (0.02, np.radians(0.35))}
# Name: the noise of the odometry, and what the filter is told of walls. None: the odometry alone.
FILTERS = {
    "odometry alone": None,
    "noise as the file says": ("file", {}),
    "odometry as measured": ("measured", {}),
    "... and walls": ("measured", BUILDING),
    "only its heading as measured": ("heading", {}),
}


@cache
def full():
    return killian().log


@cache
def noise():
    """Covariances of the odometry, by name: as measured on the first part, or its heading only."""
    first = full()[:STEPS]
    steps = first.u[1:] - between(first.truth[:-1], first.truth[1:])
    steps[:, 2] = wrap_angle(steps[:, 2])
    measured = np.diag(steps.var(0))
    heading = np.array(first.control_cov[1])
    heading[2, 2] = measured[2, 2]
    return {"measured": measured, "heading": heading}


def one(part, name, seed):
    """Run a filter over a part, from where the step before it ended: position RMSE (m)."""
    k = STEPS * (int(part) - 1)
    log, start = full()[k : k + STEPS], full().truth[max(k - 1, 0)]
    if FILTERS[name] is None:
        result = run(DeadReckoning(RelativePose(), start), log)
    else:
        kind, more = FILTERS[name]
        told = replace(log, control_cov=noise()[kind]) if kind in noise() else log
        result = run(WallSlam(RelativePose(), log.scan, start, sigma_range=0.03, **more), told)
    off = (result.poses - result.truth)[:, :2]
    return {"error": round(float(np.sqrt((off**2).sum(1).mean())), 4)}


TRIAL = Trial(
    "killian_walls",
    {(str(part), name): range(1) for part in range(1, 10) for name in FILTERS},
    one,
    sample=(("1", "odometry as measured", 0), ("3", "... and walls", 0)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
