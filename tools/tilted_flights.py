"""What an attitude costs that is off by one degree, over forty flights: chapter 16c's trial.

python tools/tilted_flights.py      (two minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/16c_uav_local_range.ipynb: it shows them, this
runs them. Writes slamlab/datasets/data/tilted_flights.json, which
`slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("16c_uav_local_range")


def one(what, case, seed):
    """One flight, by the plane with a filter of heights, and by the filter in three dimensions."""
    return {key: float(f"{number:.6g}") for key, number in page["flown"](case, seed).items()}


TRIAL = Trial(
    "tilted_flights",
    {("flights", case): range(1, 41) for case in page["CASES"]},
    one,
    sample=(
        ("flights", "exact", 2),
        ("flights", "1°, anew, given as shared", 3),
        ("flights", "1°, kept, given", 4),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
