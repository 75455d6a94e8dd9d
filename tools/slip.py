"""Wheels that slip, an exact start, three kinds of Jacobians: chapter 10's stored trial.

python tools/slip.py      (a minute; options as in tools/trials.py)

The functions are those of the page, notebooks/10_convergence_consistency_and_cost.ipynb.
Writes slamlab/datasets/data/slip.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("10_convergence_consistency_and_cost", "youbot", "P_start", "rms")
KINDS = ("standard", "first-estimates", "invariant")


def one(wheels, kind, seed):
    """Run a set of ten drives: NEES at the end, error of the position (cm)."""
    nees, error = page["slipped"](float(wheels), kind, seed)
    return {"nees": float(f"{nees:.4g}"), "error": float(f"{error:.4g}")}


TRIAL = Trial(
    "slip",
    {(wheels, kind): range(3, 23) for wheels in ("0.4", "6.0") for kind in KINDS},
    one,
    sample=(("0.4", "standard", 5), ("6.0", "invariant", 7)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
