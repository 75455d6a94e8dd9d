"""Victoria Park with a noise that is fitted by parts, and with others: chapter 10c's stored trial.

python tools/park_fitted.py      (some minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/10c_convergence_consistency_and_cost.ipynb.
Writes slamlab/datasets/data/park_fitted.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import victoria_park
from tools.trials import Trial, main, of_page

page = of_page("10c_convergence_consistency_and_cost", "world")


@cache
def log_with(noise):
    return page["with_noise"](victoria_park(), *page["NOISES"][noise])


def one(noise, linearisation, seed):
    """Error of the trees after the drive (m); infinite where the filter has no covariance left."""
    return {"trees": float(f"{page['trees_off'](log_with(noise), linearisation):.3g}")}


TRIAL = Trial(
    "park_fitted",
    {
        (noise, kind): range(1)
        for noise in page["NOISES"]
        for kind in page["KINDS"]
        if noise == "noise by parts" or kind != "first-estimates"
    },
    one,
    sample=(("noise by parts", "standard", 0),),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
