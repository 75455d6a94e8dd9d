"""What a shorter range costs, by the Jacobians of the filter: chapter 16b's stored trial.

python tools/short_range.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/short_range.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import nees, run
from slamlab.robots import Unicycle
from slamlab.sensors import PointSensor
from slamlab.simulation import FIELD_SENSOR, field_flights
from slamlab.slam import EKFSlamBatch
from tools.trials import Trial, main

KINDS = ("standard", "invariant")
# The range (m), and what else of the field is another one.
RANGES = {f"{metres} m": (metres, {}) for metres in (8, 12, 16, 20, 28)} | {
    "20 m, 15 trees": (20, {"n_landmarks": 15}),
    "20 m, 15 trees, own lane": (20, {"n_landmarks": 15, "own_lane": True}),
}


def one(kind, name, seed, n_runs=50):
    """Flights over one field: trees at once, error (m), NEES of the pose at the end."""
    metres, options = RANGES[name]
    sensor = PointSensor(FIELD_SENSOR.cov, max_range=metres)
    flights = field_flights(n_runs, np.random.default_rng(seed), sensor, **options)
    n = len(flights.landmarks)
    filters = EKFSlamBatch(Unicycle(), sensor, flights.truth[0], linearisation=kind, n_landmarks=n)
    result = run(filters, flights)
    off = (result.poses - result.truth)[..., :2]
    seen = np.isfinite(np.array(flights.landmark_measurements)[..., 0]).sum(-1)
    return {
        "seen": round(float(seen.mean()), 3),
        "error": round(float(np.sqrt((off**2).sum(-1).mean())), 4),
        "nees": round(float(nees(result)[-1].mean()), 3),
    }


TRIAL = Trial(
    "short_range",
    {(kind, name): range(1, 21) for kind in KINDS for name in RANGES},
    one,
    sample=(("standard", "12 m", 6), ("invariant", "20 m, 15 trees, own lane", 3)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
