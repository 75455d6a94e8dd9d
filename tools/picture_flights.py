"""EKF-SLAM of trees from two pictures, by the covariance it is given: chapter 16d's trial.

python tools/picture_flights.py     (some minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/16d_uav_local_range.ipynb: it shows them, this
runs them. Writes slamlab/datasets/data/picture_flights.json, which
`slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("16d_uav_local_range", "K")


def one(what, field, seed):
    """One flight by all filters: mean squared error of its positions, NEES of the last pose."""
    return {key: float(f"{number:.6g}") for key, number in page["flown"](seed).items()}


TRIAL = Trial(
    "picture_flights",
    {("flights", "one field each"): range(1, 41)},
    one,
    sample=(("flights", "one field each", 2), ("flights", "one field each", 3)),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
