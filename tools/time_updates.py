"""Time updates with and without the cross-covariance: chapter 10d's stored trial.

python tools/time_updates.py      (a minute; options as in tools/trials.py)

The functions are those of the page, notebooks/10d_convergence_consistency_and_cost.ipynb.
Writes slamlab/datasets/data/time_updates.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("10d_convergence_consistency_and_cost")


def one(wheels, name, seed):
    """Run a set of ten drives: mean NEES of the pose, error of the position (m)."""
    nees, error = page["time_update"](name, seed)
    return {"nees": float(f"{nees:.4g}"), "error": float(f"{error:.4g}")}


TRIAL = Trial(
    "time_updates",
    {("slippery wheels", name): range(1, 21) for name in page["VARIANTS"]},
    one,
    sample=(("slippery wheels", "(9) read alone: $P_{xx}$", 3),),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
