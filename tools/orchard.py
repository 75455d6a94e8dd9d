"""Who decides which tree was observed: the orchard of chapters 11 and 12, a stored trial.

python tools/orchard.py      (some minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/orchard.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import association_scores, run
from slamlab.robots import Unicycle
from slamlab.simulation import ORCHARD_SENSOR, orchard_loop
from slamlab.slam import EKFSlam, FastSlam
from slamlab.slam.association import (
    Confirmation,
    joint_search,
    maximum_likelihood,
    nearest_neighbour,
)
from tools.trials import Trial, main

DRIFTS = ("1.25", "2.0")
SEEDS = range(48)  # four blocks of twelve
RETURN = 51  # half a lap: all later observations are of the return
# An association for a filter with one mean, or a number of particles that each decide.
DECIDERS = {
    "nearest neighbour": nearest_neighbour,
    "nearest, with a margin": partial(nearest_neighbour, margin=4.6),
    "maximum likelihood": maximum_likelihood,
    "joint compatibility": lambda slam, z: joint_search(slam, z).rows,
    "FastSLAM 2.0, 100 particles": 100,
    "FastSLAM 2.0, 400 particles": 400,
}


def found_again(result, since):
    """Observations from a step on of trees mapped before it: share paired with that landmark.

    `association_scores` also counts pairs with a second copy, of the same tree, that was started
    later. Of particles the pairs of all are counted.
    """
    kept, right, possible = result.recorded, 0, 0
    if not kept:
        before = {}  # landmarks by name: the tree that started each
        for k, (trees, report) in enumerate(zip(result.log.ids, result.reports, strict=True)):
            pairs = [pair for pair in zip(report.ids, trees.tolist(), strict=True) if pair[1] >= 0]
            if k < since:
                before = {name: tree for name, tree in pairs if name is not None} | before
            else:
                right += sum(before.get(name) == tree for name, tree in pairs)
                possible += sum(tree in before.values() for _, tree in pairs)
        return right / possible
    width = 1 + max(int(columns.max(initial=0)) for columns in kept["associations"])
    before = np.full((len(kept["ancestors"][0]), width), -1)  # the same, by particle and column
    mapped = None  # trees of each particle's map at the return
    for k, trees in enumerate(result.log.ids):
        columns, is_new = kept["associations"][k], kept["is_new"][k]
        if k >= since:
            mapped = before.copy() if mapped is None else mapped
            found = np.take_along_axis(before, np.maximum(columns, 0), 1)
            right += int(((columns >= 0) & ~is_new & (found == trees) & (trees >= 0)).sum())
            possible += int(((mapped[:, :, None] == trees).any(1) & (trees >= 0)).sum())
        particle, measurement = np.nonzero(is_new)
        before[particle, columns[is_new]] = trees[measurement] if k < since else -1
        before = before[kept["ancestors"][k]]
        mapped = None if mapped is None else mapped[kept["ancestors"][k]]
    return right / possible


def one(drift, name, seed):
    """Drive once, with no names given: pairs after the return, and how far off it ends (m).

    At the larger drift also the share of trees mapped before the return that are found again. Of
    particles the distance of the nearest one to the robot, before the first tree is back and at
    the end, and how many count when it is.
    """
    log = orchard_loop(np.random.default_rng(100 + seed), drift=float(drift), laps=1.03)
    world = Unicycle(), ORCHARD_SENSOR, log.truth[0]
    decide, more, near = DECIDERS[name], {}, {}
    if isinstance(decide, int):
        rng = np.random.default_rng(seed)
        slam = FastSlam(*world, decide, 2, rng=rng, detection_probabilities=(0.9, 0.05))
        more = {"record": ("associations", "is_new", "ancestors", "poses", "ess")}
    else:
        slam = EKFSlam(*world, associate=Confirmation(decide))
    result = run(slam, log, known_ids=False, **more)
    score = association_scores(result, since=RETURN)
    if more:
        first = next(k for k in range(RETURN, len(log)) if len(log.landmark_measurements[k]))
        near["count"] = round(float(result.recorded["ess"][first]), 4)
        for key, k in (("nearest_before", first - 1), ("nearest_end", -1)):
            off = (result.recorded["poses"][k] - log.truth[k])[:, :2]
            near[key] = round(float(np.hypot(*off.T).min()), 4)
    if drift == DRIFTS[-1]:
        near["found_again"] = round(found_again(result, RETURN), 4)
    return {
        "precision": round(float(score.precision), 4),
        "recall": round(float(score.recall), 4),
        "end": round(float(np.hypot(*(result.poses[-1] - log.truth[-1])[:2])), 4),
        **near,
    }


TRIAL = Trial(
    "orchard",
    {(drift, name): SEEDS for drift in DRIFTS for name in DECIDERS},
    one,
    sample=(
        ("1.25", "nearest, with a margin", 0),
        ("2.0", "joint compatibility", 5),
        ("2.0", "FastSLAM 2.0, 100 particles", 3),
    ),
    off=0.002,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
