"""FastSLAM round and round a circle, what it forgets and reports: chapter 12b's stored trial.

python tools/fast_rounds.py      (a minute; options as in tools/trials.py)

The functions are those of the page, notebooks/12b_fastslam.ipynb: it shows them, this runs them.
Writes slamlab/datasets/data/fast_rounds.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("12b_fastslam", "motion", "odometry", "everyday")


def one(rounds, name, seed):
    """Five rounds: steps that all particles share. Two: NEES of the pose, every third step."""
    number = int(float(name.split()[rounds == "five rounds"]))
    if rounds == "five rounds":
        return {"shared": page["shared"](page["ancestors"](number, seed))}
    scores = page["nees_of_rounds"](number, seed)[3::3]
    return {"nees": [float(f"{score:.3g}") for score in scores]}


ROWS = (
    ("five rounds", "version 1.0"),
    ("five rounds", "version 2.0"),
    ("two rounds", "30 particles"),
    ("two rounds", "300 particles"),
)
TRIAL = Trial(
    "fast_rounds",
    {row: range(20) for row in ROWS},
    one,
    sample=(("five rounds", "version 2.0", 4), ("two rounds", "30 particles", 7)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
