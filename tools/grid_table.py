"""Grid FastSLAM on two real logs: the stored table of chapter 15c.

SLAMLAB_DATA=FOLDER python tools/grid_table.py      (some minutes a row; the folder holds the two
"corrected" logs of the Radish archive, csail and freiburg-101; options as in tools/trials.py)

Writes slamlab/datasets/data/grid_logs.json. Before the table it prints the scans that the
reference turns.
"""

import os
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import read_carmen
from slamlab.evaluation import ate, run
from slamlab.filters.particle import lineage
from slamlab.geometry import wrap_angle
from slamlab.matching import LikelihoodGrid, match_correlative
from slamlab.simulation import drifted
from slamlab.slam import GridFastSlam
from slamlab.slam._grid_maps import EMPTY
from tools.trials import Trial, main

LOGS = {"Freiburg 101": "freiburg-101", "CSAIL": "csail"}
# Particles, power of the likelihood, share below which a match is lost (then it climbs from more
# places), and whether scans are left out that the reference turns.
ROWS = {
    ("Freiburg 101", "10 particles"): (10, 0.3, 0.0, False),
    ("Freiburg 101", "30 particles"): (30, 0.3, 0.0, False),
    ("Freiburg 101", "30 particles, power 1"): (30, 1.0, 0.0, False),
    ("CSAIL", "10 particles"): (10, 0.3, 0.0, False),
    ("CSAIL", "30 particles"): (30, 0.3, 0.0, False),
    ("CSAIL", "30 particles, power 0.03"): (30, 0.03, 0.0, False),
    ("CSAIL", "30 particles, power 1"): (30, 1.0, 0.0, False),
    ("CSAIL", "30 particles, more climbs"): (30, 0.3, 0.6, False),
    ("CSAIL", "30 particles, power 1, more climbs"): (30, 1.0, 0.6, False),
    ("CSAIL", "30 particles, without five"): (30, 0.3, 0.0, True),
    ("CSAIL", "30 particles, power 1, without five"): (30, 1.0, 0.0, True),
}


@cache
def read(name):
    folder = Path(os.environ["SLAMLAB_DATA"])
    return read_carmen(folder / f"{name}-corrected.log.gz", corrected=True)


def turned(log, steps=None, around=6.0):
    """Turn (degrees) at which each scan fits those around best, off the reference's heading."""
    points = log.scan.points(log.ranges, log.truth)
    steps = np.arange(len(log)) if steps is None else np.asarray(steps)
    off = np.zeros(len(steps))
    for i, k in enumerate(steps):
        near = np.hypot(*(log.truth - log.truth[k])[:, :2].T) < around
        near[k] = False
        field = LikelihoodGrid.of_points(points[near].reshape(-1, 2))
        scan = log.scan.points(log.ranges[k])
        found = match_correlative(field, scan, log.truth[k], 0.4, np.deg2rad(30))
        off[i] = np.rad2deg(wrap_angle(found.pose[2] - log.truth[k, 2]))
    return off


def without(log, steps):
    """Return the log with the scans of these steps lost; the robot moves as before."""
    ranges = log.ranges.copy()
    ranges[steps] = np.nan
    return replace(log, ranges=ranges)


def drive(whole, seed, n, temper, lost):
    """Run with the wheels of one drive: run, system, processor's milliseconds a scan."""
    log = drifted(whole, np.random.default_rng(seed))
    rng = np.random.default_rng(10 + seed)
    system = GridFastSlam(log.scan, log.truth[0], n, rng=rng, temper=temper, lost=lost)
    begin = time.process_time()
    result = run(system, log, record=("ancestors", "poses"))
    return result, system, 1e3 * (time.process_time() - begin) / len(log)


def best_path(result):
    """Path (T, 3) of the particle of a run that has the largest weight in the end."""
    parents = lineage(result.recorded["ancestors"])[:, result.system.log_weights.argmax()]
    return np.array(result.recorded["poses"])[np.arange(len(parents)), parents]


def followed(path, truth, off, within=4.0):
    """Count the steps at which a path turns as the scans say; of how many the reference misses."""
    due = np.diff(np.where(np.abs(off) > 5, off, 0.0))
    jumps = np.abs(due) > 5
    found = np.rad2deg(wrap_angle(np.diff(path[:, 2]) - np.diff(truth[:, 2])))
    return np.count_nonzero(np.abs(found - due)[jumps] < within), np.count_nonzero(jumps)


@cache
def turns_of(name):
    """Turn (degrees) of each scan of a log off the reference, and the scans where it is over 5."""
    off = turned(read(name))
    wrong = np.flatnonzero(np.abs(off) > 5)
    print(f"{name}: scans {wrong.tolist()} are turned by {off[wrong].tolist()}")
    print(f"the others at most {np.abs(np.delete(off, wrong)).max():.0f} degrees", flush=True)
    return off, wrong


def one(log, row, seed):
    """One drive: path error as believed on the way and of the best particle in the end (m).

    Also the turns to such scans that the best path followed, milliseconds a scan, and the memory
    of the tiles as a share of what copies would need.
    """
    n, temper, lost, left_out = ROWS[log, row]
    off, wrong = turns_of(LOGS[log])
    whole = without(read(LOGS[log]), wrong) if left_out else read(LOGS[log])
    result, system, ms = drive(whole, seed, n, temper, lost)
    best = best_path(result)
    copies = np.count_nonzero(system._maps.shared.table) * EMPTY.nbytes
    return {
        "error": round(float(ate(result).rmse), 3),
        "best": round(float(ate(best, whole.truth).rmse), 3),
        "followed": int(followed(best, whole.truth, off)[0]),
        "ms": round(ms, 1),
        "tiles": round(float(system.map_bytes / copies), 2),
    }


TRIAL = Trial(
    "grid_logs",
    dict.fromkeys(ROWS, range(1, 21)),
    one,
    sample=(("Freiburg 101", "10 particles", 4), ("CSAIL", "10 particles", 2)),
    off=0.002,
    needs_data=tuple(LOGS),
    machine=("ms",),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
