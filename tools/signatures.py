"""Localization by signatures: chapter 19b's weighing of beams and places, and particles after it.

python tools/signatures.py       (some minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/19b_autocorrelation_localization.ipynb: it shows
them, this runs them. Writes slamlab/datasets/data/signatures.json, which
`slamlab.datasets.stored_runs` reads.
"""

import sys
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

SHARED = ("room", "lidar", "atlas", "body", "field", "wheels", "x")
page = of_page("19b_autocorrelation_localization", *SHARED)
signature_map = lru_cache(page["signature_map"])
drives = lru_cache(maxsize=len(page["TABLES"]))(page["drives"])


def one(what, name, seed):
    """Ask for a hundred poses on one kind of map, or follow six drives from one kind of start."""
    if what == "maps":
        found = page["weigh"](*signature_map(*page["MAPS"][name]), seed)
        return {key: round(float(value), 4) for key, value in found.items()}
    ends = [page["went_on"](*drive, page["STARTS"][name]) for drive in drives(what, seed)]
    begun = np.array([end for end in ends if end is not None], bool).reshape(-1, 2)
    wrong, lost = begun.T
    return {
        "begun": len(begun),
        "wrong": int(wrong.sum()),
        "lost": int(lost.sum()),
        "lost from a right start": int((lost & ~wrong).sum()),
    }


TRIAL = Trial(
    "signatures",
    dict.fromkeys([("maps", name) for name in page["MAPS"]], range(1, 21))
    | dict.fromkeys(product(page["TABLES"], page["STARTS"]), range(5, 25)),
    one,
    sample=(
        ("maps", "6° 2 px", 4),
        ("maps", "3° 4 px", 7),
        ("table of 0.8 m", "two that agree", 6),
    ),
    rel=0.05,
    off=0.01,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
