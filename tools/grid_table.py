"""Measure grid FastSLAM on two real logs and two corridors: the stored tables of chapter 15.

SLAMLAB_DATA=FOLDER python tools/grid_table.py [SEEDS [ROW ...]]      (a minute a row; the folder
holds the two "corrected" logs of the Radish archive, csail and freiburg-101; rows count from 0)
python tools/grid_table.py loops [SEEDS [ROW ...]]      (half an hour; corridors, no folder)
"""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from slamlab.datasets import read_carmen
from slamlab.evaluation import ate, run
from slamlab.filters.particle import lineage
from slamlab.geometry import wrap_angle
from slamlab.matching import LikelihoodGrid, match_correlative
from slamlab.simulation import drifted, ring_laps
from slamlab.slam import GridFastSlam
from slamlab.slam._grid_maps import EMPTY

# Log, particles, power of the likelihood, share below which a match is lost, and whether scans are
# left out that the reference turns.
ROWS = [
    ("freiburg-101", 10, 0.3, 0.0, False),
    ("freiburg-101", 30, 0.3, 0.0, False),
    ("csail", 10, 0.3, 0.0, False),
    ("csail", 30, 0.3, 0.0, False),
    ("csail", 30, 0.03, 0.0, False),
    ("csail", 30, 1.0, 0.0, False),
    ("csail", 30, 0.3, 0.6, False),
    ("csail", 30, 1.0, 0.6, False),
    ("csail", 30, 0.3, 0.0, True),
    ("csail", 30, 1.0, 0.0, True),
    ("freiburg-101", 30, 1.0, 0.0, False),
]

# Corridors: size (m), model, particles.
LOOPS = [
    ((12.0, 8.0), "matching", 10),
    ((12.0, 8.0), "matching", 30),
    ((12.0, 8.0), "penetration", 30),
    ((12.0, 8.0), "penetration", 200),
    ((24.0, 16.0), "matching", 10),
    ((24.0, 16.0), "matching", 30),
    ((24.0, 16.0), "matching", 200),
    ((24.0, 16.0), "penetration", 30),
    ((24.0, 16.0), "penetration", 200),
    ((24.0, 16.0), "penetration", 1000),
]


def loop(size, model, n, seed):
    """Return how far off its place a drive ends, and its path error (m)."""
    log = ring_laps(size, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    result = run(GridFastSlam(log.scan, log.truth[0], n, model=model, rng=rng), log)
    return np.hypot(*(result.poses[-1] - log.truth[-1])[:2]), ate(result).rmse


def loops(seeds=10, *rows):
    """Print both errors of every drive."""
    for size, model, n in [LOOPS[row] for row in rows] or LOOPS:
        for seed in range(1, seeds + 1):
            end, path = loop(size, model, n, seed)
            print(f"{size} {model} {n} seed {seed}: end {end:.3f}, path {path:.3f}", flush=True)


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


def followed(path, truth, off, within=4.0):
    """Count the steps at which a path turns as the scans say; of how many the reference misses."""
    due = np.diff(np.where(np.abs(off) > 5, off, 0.0))
    jumps = np.abs(due) > 5
    found = np.rad2deg(wrap_angle(np.diff(path[:, 2]) - np.diff(truth[:, 2])))
    return np.count_nonzero(np.abs(found - due)[jumps] < within), np.count_nonzero(jumps)


def main():
    seeds = int(sys.argv[1] if sys.argv[1:] else 10)
    rows = [ROWS[int(row)] for row in sys.argv[2:]] or ROWS
    logs = {name: read(name) for name in ("csail", "freiburg-101")}
    wrong, offs = {}, {}
    for name, log in logs.items():
        off = offs[name] = turned(log)
        wrong[name] = np.flatnonzero(np.abs(off) > 5)
        print(f"{name}: scans {wrong[name].tolist()} are turned by {off[wrong[name]].tolist()}")
        print(f"the others at most {np.abs(np.delete(off, wrong[name])).max():.0f} degrees")
    for name, n, temper, lost, left_out in rows:
        whole = without(logs[name], wrong[name]) if left_out else logs[name]
        for seed in range(1, seeds + 1):
            result, system, ms = drive(whole, seed, n, temper, lost)
            parents = lineage(result.recorded["ancestors"])
            paths = np.array(result.recorded["poses"])[np.arange(len(whole))[:, None], parents]
            best = paths[:, system.log_weights.argmax()]
            turns, jumps = followed(best, whole.truth, offs[name])
            copies = np.count_nonzero(system._maps.shared.table) * EMPTY.nbytes
            print(
                f"{name:13s} {n:3d} particles, power {temper:g}, lost below {lost:g}, "
                f"{len(wrong[name]) if left_out else 0} scans left out, seed {seed:2d}: "
                f"as believed on the way {ate(result).rmse:.3f} m, "
                f"path of the best in the end {ate(best, whole.truth).rmse:.3f} m, "
                f"{turns} of {jumps} turns followed, "
                f"{ms:.1f} ms a scan, tiles / copies {system.map_bytes / copies:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    if sys.argv[1:2] == ["loops"]:
        loops(*(int(word) for word in sys.argv[2:]))
    else:
        main()
