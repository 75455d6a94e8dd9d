"""Scan matchers in Killian Court over twenty drifts of the wheels: chapter 14b's stored trial.

python tools/court_drifts.py      (two minutes; options as in tools/trials.py)

The function is that of the page, notebooks/14b_scan_matching_and_hector.ipynb.
Writes slamlab/datasets/data/court_drifts.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("14b_scan_matching_and_hector", "court")


def one(scans, name, seed):
    """Error of the path (m)."""
    return {"error": float(f"{page['in_the_court'](name, seed):.3g}")}


TRIAL = Trial(
    "court_drifts",
    {
        ("600 scans", name): range(1, 21)
        for name in ("Hector, with wheels", "matching, 20 scans", "with closures")
    },
    one,
    sample=(("600 scans", "Hector, with wheels", 1),),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
