"""Returns to an orchard, known on the first half of the lap: trial of chapters 11, 11b.

python tools/orchard_returns.py      (two minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/orchard_returns.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import association_scores, run
from slamlab.robots import Unicycle
from slamlab.simulation import ORCHARD_SENSOR, orchard_loop
from slamlab.slam import EKFSlam
from slamlab.slam.association import (
    IGNORED,
    Confirmation,
    nearest_euclidean,
    nearest_neighbour,
)
from tools.orchard import DECIDERS, RETURN
from tools.trials import Trial, main

DRIFTS = ("0.25", "0.75", "1.25", "2.0")
BACK = 97  # three steps before the lap is closed
MIDDLE = DRIFTS[1:3]  # where the fixed gate has the better recall
AGAIN = "1.25, other drives"  # the table of the lesson, on a hundred drives more


def within_a_metre(slam, z):
    """Nearest neighbour that leaves out what is a metre or more from its tree."""
    rows = nearest_neighbour(slam, z)
    metres = np.hypot(*(slam.sensor.locate(slam.pose, z) - slam.landmarks[rows]).T)
    return np.where((rows >= 0) & (metres >= 1.0), IGNORED, rows)


def or_within_a_metre(slam, z):
    """Nearest neighbour; what it leaves over goes to a free tree within a metre."""
    rows, near = nearest_neighbour(slam, z), nearest_euclidean(slam, z, gate=1.0)
    return np.where((rows < 0) & (near >= 0) & ~np.isin(near, rows), near, rows)


METHODS = {
    "P4, fixed 1 m": partial(nearest_euclidean, gate=1.0),
    "nearest neighbour": DECIDERS["nearest neighbour"],
    "nearest, margin 4.6": DECIDERS["nearest, with a margin"],
    "maximum likelihood": DECIDERS["maximum likelihood"],
    "joint compatibility": DECIDERS["joint compatibility"],
}
GATES = {"nearest, at most 1 m": within_a_metre, "nearest, or within 1 m": or_within_a_metre}


def one(drift, name, seed):
    """Drive once: precision and recall after the return, σ of the place, error at the end (m)."""
    amount = float(drift.partition(",")[0])
    log = orchard_loop(np.random.default_rng(100 + seed), drift=amount, laps=1.03)
    slam = EKFSlam(
        Unicycle(), ORCHARD_SENSOR, log.truth[0], associate=Confirmation((METHODS | GATES)[name])
    )
    result = run(slam, log, known_ids=RETURN)
    score = association_scores(result, RETURN)
    sigma = np.sqrt(np.trace(result.covs[BACK, :2, :2]))
    end = np.hypot(*(result.poses[-1] - log.truth[-1])[:2])
    found = {"precision": score.precision, "recall": score.recall, "sigma": sigma, "end": end}
    return {key: round(float(value), 6) for key, value in found.items()}


TRIAL = Trial(
    "orchard_returns",
    {(drift, name): range(20) for drift in DRIFTS for name in METHODS}
    | {(drift, name): range(20) for drift in MIDDLE for name in GATES}
    | {(AGAIN, name): range(20, 120) for name in METHODS},
    one,
    sample=(
        ("0.75", "nearest neighbour", 2),
        ("2.0", "joint compatibility", 7),
        ("1.25", "nearest, or within 1 m", 3),
    ),
    off=0.002,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
