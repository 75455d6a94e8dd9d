"""Intervals of Gamma-SLAM's likelihood, one assumption broken at a time: chapter 15b's trial.

python tools/rough_ground.py       (some minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/15b_other_maps.ipynb: it shows them, this runs them.
Writes slamlab/datasets/data/rough_ground.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("15b_other_maps")


def one(what, name, seed):
    """Ten pictures of a drive: how many 95 % intervals hold the true place."""
    lines, held = page["WORLDS"][name](seed), page["held"]
    powers = {f"power {power}": held(power * lines) for power in page["POWERS"]}
    places = {f"of {n}": page["by_particles"](lines, n, seed) for n in page["PLACES"]}
    counts = {"held": held(lines), "smoothed": held(page["smooth"](lines))} | powers | places
    return {key: int(n) for key, n in counts.items()}


TRIAL = Trial(
    "rough_ground",
    {("pictures", name): range(1, 21) for name in page["WORLDS"]},
    one,
    sample=(
        ("pictures", "... of these, only mixed roughness", 3),
        ("pictures", "the ground, camera leans", 4),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
