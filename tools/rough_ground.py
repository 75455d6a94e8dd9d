"""Gamma-SLAM's likelihood on trial, one thing changed at a time: chapter 15b's stored trial.

python tools/rough_ground.py       (a quarter of an hour; options as in tools/trials.py)

The page and this tool import the same functions, of `slamlab.exercises.rough_ground`. Writes
slamlab/datasets/data/rough_ground.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import ate, run
from slamlab.exercises import rough_ground as page
from slamlab.localization import DeadReckoning
from slamlab.robots import RelativePose
from tools.trials import Trial, main

# Worlds of which the other units are asked, too; of the first also the other density.
ASKED = ("heights as (F) has them", "the ground, camera leans")


@lru_cache(maxsize=2)
def met(seed):
    """How many cells each picture meets, at each offset."""
    return np.array([page.cells_met(page.country(seed), k) for k in page.TEN])


def pictures(name, seed):
    """Ten pictures of a drive: how many 95 % intervals hold the true place.

    Of two worlds also with another density, or another unit; and of each picture whether it does,
    its best place (m) and the roll of its camera (rad).
    """
    lines = page.WORLDS[name](seed)
    counts = {"held": page.held(lines), "smoothed": page.held(page.smooth(lines))}
    counts |= {f"power {power}": page.held(power * lines) for power in page.POWERS}
    counts |= {f"of {n}": page.by_particles(lines, n, seed) for n in page.PLACES}
    if name in ASKED:
        log = page.country(seed)
        counts |= {
            f"L {unit}": page.held(lines - met(seed) * np.log(metres))
            for unit, metres in page.UNITS.items()
        }
        counts["inside"] = [page.held(line[None]) for line in lines]
        counts["best"] = page.FINE[lines.argmax(1)]
        counts["roll"] = log.notes["sway"][page.TEN, 2]
    if name == ASKED[0]:
        camera = page.drawn(log, seed)
        rest = np.array([page.difference(log, camera, k) for k in page.TEN])
        counts["by E"] = page.held(lines + rest)
    return counts


def maps(camera, seed):
    """Error of the best place by each map (m); if the camera sways also intervals that hold."""
    sway = page.CAMERAS[camera]
    found = {name: page.off(lines) for name, lines in page.profiles(seed, sway).items()}
    if camera == "sways":
        log = page.country(seed)
        for name in list(page.MAPS)[1:]:
            lines = page.slide(log, page.MAPS[name](), page.FINE, page.FIVE)
            found[f"held, {name}"] = page.held(lines)
    return found


def drives(name, seed):
    """Path error (m), NEES and parents of the filter; of the odometry alone the error."""
    if name == "odometry alone":
        log = page.country(seed)
        wheels = run(DeadReckoning(RelativePose(), log.truth[0]), log)
        return {"error": ate(wheels, aligned=False).rmse}
    return page.scores(page.FILTERS[name](seed))


MAKE = {"pictures": pictures, "maps": maps, "drives": drives}
SEEDS = range(1, 21)


def few(x):
    """Four digits."""
    return x if isinstance(x, int) else float(f"{x:.4g}")


def one(what, name, seed):
    """Make one run of one of the three tables, in few digits."""
    found = MAKE[what](name, seed)
    return {k: [few(v) for v in x] if np.ndim(x) else few(x) for k, x in found.items()}


TRIAL = Trial(
    "rough_ground",
    {("pictures", name): SEEDS for name in page.WORLDS}
    | {("maps", camera): SEEDS for camera in page.CAMERAS}
    | {("drives", name): SEEDS for name in ("odometry alone", *page.FILTERS)},
    one,
    sample=(
        ("pictures", "... of these, only mixed roughness", 3),
        ("pictures", "the ground, camera leans", 4),
        ("maps", "level", 2),
        ("drives", "power 0.1", 5),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
