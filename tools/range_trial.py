"""Ranges over twenty fields of trees: chapter 16b's stored trial.

python tools/range_trial.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/range_trial.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import nees, run
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import AdaptiveRange, EKFSlamBatch
from tools.trials import Trial, main

SEEDS = tuple(range(1, 21))
FAR = PointSensor(FIELD_SENSOR.cov, max_range=40.0)
LAW = {"n_target": 5, "min_range": 8.0, "max_range": 40.0}


def fixed(metres):
    return {"min_range": metres, "max_range": metres}


# Field: the share of trees felled on its right half, and the ranges to compare there. The fixed
# range comes first; it sees as many trees on average as the law does.
FIELDS = {
    "clearing": (
        0.75,
        {"fixed, 20 m": fixed(20.0), "law, 5 wanted": LAW, "fixed, 40 m": fixed(40.0)},
    ),
    # Lanes are 30 m apart: from 15 m on, trees of the next lane are seen.
    "even": (
        0.0,
        {
            "fixed, 14 m": fixed(14.0),
            "law, 5 wanted": LAW,
            "law, up to 15 m": LAW | {"max_range": 15.0},
            "law, own lane": LAW,  # trees of all other lanes are hidden
            "law, new names": LAW,
        },
    ),
}


def new_names(flights, lane=30.0):
    """Give each tree a name of its own in each lane over which the aircraft is: no loop closes."""
    here = np.floor(flights.truth[:, :, 1] / lane)[..., None, None]
    z = np.array(flights.landmark_measurements)
    z = np.concatenate([np.where(here == k, z, np.nan) for k in np.unique(here)], 2)
    seen = np.isfinite(z).any((0, 1, 3))
    trees = np.tile(flights.landmarks, (len(seen) // len(flights.landmarks), 1))[seen]
    ids = (np.arange(len(trees)),) * len(z)
    return replace(flights, landmark_measurements=z[:, :, seen], landmarks=trees, ids=ids)


def one(field, name, seed, n_runs=50):
    """Flights over one field: trees at once, error (m), NEES at the end, shares of the steps.

    The shares: the next range is beyond 15 m; no tree was seen.
    """
    felled, ranges = FIELDS[field]
    hidden = name == "law, own lane"
    flights = field_flights(
        n_runs, np.random.default_rng(seed), FAR, felled=felled, own_lane=hidden
    )
    if name == "law, new names":
        flights = new_names(flights)
    filters = EKFSlamBatch(Unicycle(), FAR, flights.truth[0], n_landmarks=len(flights.landmarks))
    result = run(AdaptiveRange(filters, **ranges[name]), flights, record=("n_seen", "range"))
    off = (result.poses - result.truth)[..., :2]
    return {
        "seen": round(float(np.mean(result.recorded["n_seen"])), 3),
        "error": round(float(np.sqrt((off**2).sum(-1).mean())), 4),
        "nees": round(float(nees(result)[-1].mean()), 3),
        "beyond": round(float((np.array(result.recorded["range"]) > 15.0).mean()), 4),
        "none": round(float((np.array(result.recorded["n_seen"]) == 0).mean()), 4),
    }


TRIAL = Trial(
    "range_trial",
    {(field, name): SEEDS for field, (_, ranges) in FIELDS.items() for name in ranges},
    one,
    sample=(
        ("clearing", "fixed, 20 m", 3),
        ("clearing", "law, 5 wanted", 17),
        ("even", "law, 5 wanted", 8),
        ("even", "law, own lane", 2),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
