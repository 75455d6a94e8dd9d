"""The matchers of chapter 14 on two real logs: the stored table of that chapter.

SLAMLAB_DATA=FOLDER python tools/matching_table.py      (a minute a run; the folder holds the two
"corrected" logs of the Radish archive, csail and freiburg-101; options as in tools/trials.py)

Writes slamlab/datasets/data/matching.json.
"""

import os
import sys
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import read_carmen
from slamlab.evaluation import ate, run
from slamlab.geometry import compose
from slamlab.localization import DeadReckoning
from slamlab.matching import match_icp, voxel_downsample
from slamlab.robots import RelativePose
from slamlab.simulation import drifted
from slamlab.slam import HectorSlam, ScanGraphSlam
from tools.trials import Trial, main

LOGS = {"CSAIL": "csail", "Freiburg 101": "freiburg-101"}


def slam(make):
    """Take the path that a system reports on the way."""
    return lambda log: run(make(log), log).poses


def scans(n):
    return slam(lambda log: ScanGraphSlam(log.scan, log.truth[0], n_keyframes=n, loops=False))


def chain(log, metric):
    """Each scan laid upon the one before it."""
    poses, before = [log.truth[0]], voxel_downsample(log.scan.points(log.ranges[0]))
    for u, ranges in zip(log.u[1:], log.ranges[1:], strict=True):
        now = voxel_downsample(log.scan.points(ranges))
        poses.append(compose(poses[-1], match_icp(before, now, u, metric).pose))
        before = now
    return np.array(poses)


METHODS = {
    "wheels alone": slam(lambda log: DeadReckoning(RelativePose(), log.truth[0])),
    "point to point, last scan": lambda log: chain(log, "point"),
    "point to line, last scan": lambda log: chain(log, "line"),
    "Hector, 1 level": slam(lambda log: HectorSlam(log.scan, log.truth[0], levels=1)),
    "Hector, 3 levels": slam(lambda log: HectorSlam(log.scan, log.truth[0])),
    "point to line, 5 keyframes": scans(5),
    "point to line, 20 keyframes": scans(20),
    "20 keyframes and closures": lambda log: (
        run(ScanGraphSlam(log.scan, log.truth[0]), log).system.trajectory
    ),
}


@cache
def whole(name):
    folder = Path(os.environ["SLAMLAB_DATA"])
    return read_carmen(folder / f"{LOGS[name]}-corrected.log.gz", corrected=True)


def one(name, method, seed):
    """Path error (m) with the drifting wheels of a seed."""
    log = drifted(whole(name), np.random.default_rng(seed))
    return {"error": round(float(ate(METHODS[method](log), log.truth).rmse), 3)}


TRIAL = Trial(
    "matching",
    {(name, method): range(1, 21) for name in LOGS for method in METHODS},
    one,
    sample=(
        ("CSAIL", "point to line, last scan", 1),
        ("CSAIL", "point to line, 5 keyframes", 2),
    ),
    off=0.006,
    needs_data=tuple(LOGS),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
