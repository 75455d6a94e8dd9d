"""Measure the matchers of chapter 14 on two real logs: the stored table of that chapter.

SLAMLAB_DATA=FOLDER python tools/matching_table.py      (a few minutes; the folder holds the two
"corrected" logs of the Radish archive, csail and freiburg-101)
"""

import os
from pathlib import Path

import numpy as np

from slamlab.datasets import read_carmen
from slamlab.evaluation import ate, run
from slamlab.geometry import compose
from slamlab.localization import DeadReckoning
from slamlab.matching import match_icp, voxel_downsample
from slamlab.robots import RelativePose
from slamlab.simulation import drifted
from slamlab.slam import HectorSlam, ScanGraphSlam


def chain(log, metric):
    """Each scan laid upon the one before it."""
    poses, before = [log.truth[0]], voxel_downsample(log.scan.points(log.ranges[0]))
    for u, ranges in zip(log.u[1:], log.ranges[1:], strict=True):
        now = voxel_downsample(log.scan.points(ranges))
        poses.append(compose(poses[-1], match_icp(before, now, u, metric).pose))
        before = now
    return np.array(poses)


def main():
    folder = Path(os.environ["SLAMLAB_DATA"])
    for name in ("csail", "freiburg-101"):
        whole = read_carmen(folder / f"{name}-corrected.log.gz", corrected=True)
        rows = {}
        for seed in (1, 2, 3):
            log = drifted(whole, np.random.default_rng(seed))
            start = log.truth[0]
            paths = {"odometry": run(DeadReckoning(RelativePose(), start), log).poses}
            paths["point to point, last scan"] = chain(log, "point")
            paths["point to line, last scan"] = chain(log, "line")
            for n in (1, 5, 20):
                slam = ScanGraphSlam(log.scan, start, n_keyframes=n, loops=False)
                paths[f"field, search, line; {n} scans"] = run(slam, log).poses
            paths["Hector, 3 levels"] = run(HectorSlam(log.scan, start), log).poses
            paths["Hector, 1 level"] = run(HectorSlam(log.scan, start, levels=1), log).poses
            slam = run(ScanGraphSlam(log.scan, start), log).system
            paths["20 scans and closures"] = slam.trajectory
            for key, path in paths.items():
                rows.setdefault(key, []).append(ate(path, log.truth).rmse)
        for key, errors in rows.items():
            print(f"{name:14s} {key:28s}", *(f"{error:7.3f}" for error in errors), flush=True)


if __name__ == "__main__":
    main()
