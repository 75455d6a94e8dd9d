"""Ways home with one thing changed: chapter 20b's stored trial.

python tools/return_variants.py       (a run takes 3 to 20 s; options as in tools/trials.py)

The functions are those of the page, notebooks/20b_explore_and_return.ipynb: it shows them, this
runs them. Writes slamlab/datasets/data/return_variants.json, which
`slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import lru_cache
from pathlib import Path
from unittest.mock import patch

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.navigation import YOUBOT_BODY, CollisionGuard, CoveragePilot, ReturnPilot
from slamlab.simulation import expedition
from slamlab.simulation.expedition import ENVIRONMENTS, ESTIMATORS, explore, results
from tools.trials import Trial, main, of_page

page = of_page("20b_explore_and_return", "ring", "hall")
FIRST_METRES = "first metres to their end"
METRES = results()["ring"]["scan graph"]["metres"]
# The drives whose way along the path is so much longer than by map that it leads round the ring.
ROUND_AGAIN = [int(k) for k in np.flatnonzero(METRES[:, 1] - METRES[:, 0] > 15)]


class ToItsEnd(CoveragePilot):
    """Drives its first metres once more to their end, also when the belief has moved the floor."""

    def _revisit(self, pose, ranges):
        first = self._map.place(self._map.scan_after(self._revisit_after))
        if np.hypot(*(first - pose[:2])) > 0.5:
            self._begin_revisit(pose)
        if not len(self._plan.path):
            super()._revisit(pose, ranges)


@lru_cache(maxsize=2)
def by_wheels(seed):
    """Out into the ring by the wheels alone, which have no noise."""
    return explore(page["SILENT"], ESTIMATORS["dead reckoning"], seed)


def one(what, name, seed):
    """Drive home with one thing changed: what `stored_runs` says of this trial."""
    if what == "no noise":
        out = by_wheels(seed)
        home, off, believed = page["along_own_path"](out, name == "cut out")
        numbers = {"off": off, "believed": believed}
        if name == "cut out":
            carried = page["carried_marker"](out.log)[:2]
            numbers["carried"] = np.hypot(*(carried - out.log.truth[0, :2]))
            numbers["apart"] = np.hypot(*(carried - home.truth[-1, :2]))
        return {key: round(float(value), 3) for key, value in numbers.items()}
    if what == "corridor":
        _, _, numbers = page["there_and_back"](name, seed)
        return {key: round(float(value), 3) for key, value in numbers.items()}
    if what == "far end":
        off, sigma = page["far_end"](seed, scale=0.02 if name == "worn" else 0.0)
        return {"off": round(float(off), 4), "sigma": round(float(sigma), 4)}
    ring = ENVIRONMENTS["ring"]
    with patch.object(expedition, "CoveragePilot", ToItsEnd):
        out = explore(ring, ESTIMATORS[name], seed)
    guard = CollisionGuard(YOUBOT_BODY, ring.margin)
    return {"path": round(ReturnPilot(out.belief.trajectory, guard, ring.lidar).memory.length, 1)}


TRIAL = Trial(
    "return_variants",
    {("no noise", loops): range(20) for loops in ("cut out", "kept")}
    | {("corridor", name): range(30) for name in page["MEMORIES"]}
    | {("far end", wheels): range(30) for wheels in ("worn", "of the right size")}
    | {(FIRST_METRES, "scan graph"): ROUND_AGAIN},
    one,
    sample=(
        ("no noise", "kept", 1),
        ("no noise", "cut out", 4),
        ("corridor", "EKF-SLAM, walls forgotten", 1),
        ("far end", "worn", 1),
    ),
    rel=0.1,
    off=0.05,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
