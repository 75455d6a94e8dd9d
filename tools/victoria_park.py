"""Victoria Park, all 6969 steps: every landmark system of the course, and the associations.

python tools/victoria_park.py      (an hour; options as in tools/trials.py)

Writes slamlab/datasets/data/victoria_park.json, which chapters 10 to 12 read. One log: a system
that draws nothing has one run, FastSLAM one for each of twenty seeds.
"""

import sys
import warnings
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import victoria_park
from slamlab.evaluation import align, association_scores, nis, run
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose
from slamlab.sensors import PointSensor
from slamlab.slam import CompressedEKFSlam, EKFSlam, FastSlam
from slamlab.slam.association import (
    Confirmation,
    SearchLimitWarning,
    joint_compatibility,
    maximum_likelihood,
    nearest_euclidean,
    nearest_neighbour,
)
from tools.trials import Trial, main

WORLD = RelativePose(), PointSensor(0.4 * np.eye(2)), np.zeros(3)
SCALES = (25, 1)  # the odometry's variance of the file, and times 25


def of_fast(version):
    return lambda seed: FastSlam(*WORLD, 100, version, rng=np.random.default_rng(seed))


def of_ekf(linearisation="standard", associate=None):
    return lambda seed: EKFSlam(*WORLD, linearisation=linearisation, associate=associate)


def confirmed(linearisation="standard", n=3):
    # A confirmation remembers what it observed: each run has its own.
    return lambda seed: of_ekf(linearisation, Confirmation(nearest_neighbour, n))(seed)


# Name: what makes it from a seed, how many seeds, whether the trees are told by name.
SYSTEMS = {
    "dead reckoning": (lambda seed: DeadReckoning(WORLD[0], WORLD[2]), 1, True),
    "EKF-SLAM": (of_ekf(), 1, True),
    "EKF-SLAM, first estimates": (of_ekf("first-estimates"), 1, True),
    "EKF-SLAM, invariant": (of_ekf("invariant"), 1, True),
    "compressed EKF-SLAM": (lambda seed: CompressedEKFSlam(*WORLD, radius=40.0), 1, True),
    "fixed gate, 3 m": (of_ekf(associate=partial(nearest_euclidean, gate=3.0)), 1, False),
    "nearest neighbour": (of_ekf(associate=nearest_neighbour), 1, False),
    "maximum likelihood": (of_ekf(associate=maximum_likelihood), 1, False),
    "joint compatibility": (of_ekf(associate=joint_compatibility), 1, False),
    "nearest neighbour, invariant": (of_ekf("invariant", nearest_neighbour), 1, False),
    "joint compatibility, invariant": (of_ekf("invariant", joint_compatibility), 1, False),
    "nearest neighbour, confirmed": (confirmed(), 1, False),
    "nearest neighbour, confirmed, invariant": (confirmed("invariant"), 1, False),
    "nearest neighbour, confirmed by 2": (confirmed(n=2), 1, False),
    "nearest neighbour, confirmed by 4": (confirmed(n=4), 1, False),
    "nearest neighbour, confirmed by 5": (confirmed(n=5), 1, False),
    "nearest neighbour, confirmed by 2, invariant": (confirmed("invariant", 2), 1, False),
    "nearest neighbour, confirmed by 4, invariant": (confirmed("invariant", 4), 1, False),
    "nearest neighbour, confirmed by 5, invariant": (confirmed("invariant", 5), 1, False),
    "FastSLAM 2.0": (of_fast(2), 20, True),
    "FastSLAM 1.0": (of_fast(1), 20, True),
}


def judged(result, told):
    """Errors against the optimum of all measurements (m), what is claimed, and what is paired."""
    off = np.hypot(*(result.poses - result.truth)[:, :2].T)
    row = {
        "error": np.sqrt((off**2).mean()),
        "largest": off.max(),
        "end": off[-1],
        "claimed": np.sqrt(np.trace(result.covs[-1][:2, :2]) / 2),
    }
    slam, ids = result.system, getattr(result.system, "ids", ())
    row["trees"] = len(ids)
    if told and ids:
        found, due = (np.column_stack([trees, np.zeros(len(ids))]) for trees in
                      (slam.landmarks, result.log.landmarks[list(ids)]))  # fmt: skip
        moved = align(found, due)
        row["map"] = np.sqrt(((found - due) ** 2).sum(1).mean())
        row["map aligned"] = np.sqrt(((moved - due)[:, :2] ** 2).sum(1).mean())
        row["turned"] = abs(np.degrees(moved[0, 2]))
    if told and isinstance(slam, EKFSlam):
        covs = [slam.landmark_cov(name) for name in ids]
        row["claimed of a tree"] = np.median([np.sqrt(np.trace(cov) / 2) for cov in covs])
        row["nis"] = np.nansum(nis(result)) / sum(
            report.innovation.size for report in result.reports
        )
    if not told:
        score = association_scores(result)
        row |= {"precision": score.precision, "recall": score.recall}
    return {name: float(f"{value:.3g}") for name, value in row.items()}


@cache
def park():
    return victoria_park()


def judged_over(log, name, scale, seed):
    """Run a system over a log with the odometry's variance of the file times `scale`."""
    make, _, told = SYSTEMS[name]
    log = replace(log, control_cov=log.control_cov * float(scale))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SearchLimitWarning)
        return judged(run(make(seed), log, every=10, known_ids=told), told)


def one(name, scale, seed):
    """Run a system over the whole park."""
    return judged_over(park(), name, scale, seed)


TRIAL = Trial(
    "victoria_park",
    {(name, str(scale)): range(n) for name, (_, n, _) in SYSTEMS.items() for scale in SCALES},
    one,
    sample=(
        ("EKF-SLAM", "25", 0),
        ("nearest neighbour, confirmed, invariant", "25", 0),
        ("FastSLAM 1.0", "25", 3),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
