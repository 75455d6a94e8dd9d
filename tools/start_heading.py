"""EKF-SLAM from an uncertain heading, by its Jacobians: chapter 10c's stored trial.

python tools/start_heading.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/start_heading.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import invariant_nees, run
from slamlab.robots import YOUBOT
from slamlab.simulation import ROOM_SENSOR, room_drives
from slamlab.slam import EKFSlamBatch
from tools.trials import Trial, main

HEADINGS = ("0", "2", "10")  # degrees (σ)
KINDS = ("standard", "first-estimates", "invariant")
START = np.array([0.0, -2.4, 0.0])


@lru_cache(maxsize=len(HEADINGS))
def start_and_drives(degrees, seed):
    """Give the covariance of the start, and twenty drives from starts drawn from it."""
    cov = np.diag([0.0, 0.0, np.radians(float(degrees)) ** 2])
    return cov, room_drives(20, np.random.default_rng(seed), n_steps=400, start_cov=cov)


def one(degrees, kind, seed):
    """Run twenty drives: invariant NEES (all steps, and the end), σ at the end (°), NIS."""
    cov, drives = start_and_drives(degrees, seed)
    starts, n = np.tile(START, (drives.truth.shape[1], 1)), len(drives.landmarks)
    filters = EKFSlamBatch(YOUBOT, ROOM_SENSOR, starts, cov, n_landmarks=n, linearisation=kind)
    result = run(filters, drives)
    scores = invariant_nees(result)
    reports = [report for report in result.reports if report is not None]
    numbers = {
        "nees": np.nanmean(scores[1:]),
        "end": np.nanmean(scores[-1]),
        "sigma": np.degrees(np.sqrt(result.covs[-1, :, 2, 2])).mean(),
        "nis": sum(r.nis.sum() for r in reports) / sum(r.dof.sum() for r in reports),
    }
    return {key: float(f"{value:.6g}") for key, value in numbers.items()}


TRIAL = Trial(
    "start_heading",
    {(degrees, kind): range(1, 21) for degrees in HEADINGS for kind in KINDS},
    one,
    sample=(("2", "first-estimates", 4), ("10", "standard", 7)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
