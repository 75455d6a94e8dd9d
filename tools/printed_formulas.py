"""P1's printed formulas, each alone and together, in filters: chapter 09b's stored trial.

python tools/printed_formulas.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/printed_formulas.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import run, trial
from slamlab.localization import DeadReckoning
from slamlab.printed.p1 import together, variants
from slamlab.robots import YOUBOT
from slamlab.simulation import ROOM_SENSOR, room_drives
from tools.trials import Trial, main

MOTION = replace(YOUBOT, integration="euler")  # the motion model of P1 (10)
FILTERS = {**variants(MOTION, ROOM_SENSOR), **together(MOTION, ROOM_SENSOR)}
WHEELS = "wheels alone"
ELLIPSE = 5.99  # of two dimensions, 95 %


@lru_cache(maxsize=1)
def drives(seed):
    """Give a set of twenty drives."""
    return room_drives(20, np.random.default_rng(seed), n_steps=400, sigma_wheel=1.0)


def of_map(result):
    """Error of the landmarks (m, root mean square); the share inside its 95 % ellipse."""
    e = result.system.landmarks - result.log.landmarks
    squared = (e * np.linalg.solve(result.system.landmark_covs, e[..., None])[..., 0]).sum(-1)
    off = np.sqrt(np.nanmean((e**2).sum(-1)))
    return {"map": off, "inside": np.nanmean(squared < ELLIPSE)}


def one(room, name, seed):
    """Run a filter over one set: position (m, RMS), NEES after a step and at the end, map."""
    log = drives(seed)
    wheels = DeadReckoning(MOTION, log.truth[0])
    result = run(wheels if name == WHEELS else FILTERS[name].start(log), log)
    judged = trial(lambda _: result, log)
    found = {"rmse": judged.rmse[0], "first": judged.nees[0, 1], "nees": judged.nees[0, -1]}
    found |= {} if name == WHEELS else of_map(result)
    return {key: float(f"{value:.6g}") for key, value in found.items()}


TRIAL = Trial(
    "printed_formulas",
    {("room", name): range(20) for name in (*FILTERS, WHEELS)},
    one,
    sample=(("room", "repaired", 3), ("room", "(17) and (41)", 7)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
