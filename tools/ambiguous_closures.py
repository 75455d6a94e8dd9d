"""What a scan graph does with ambiguous closures, in a plain corridor: chapter 14b's stored trial.

python tools/ambiguous_closures.py      (a minute; options as in tools/trials.py)

The functions are those of the page, notebooks/14b_scan_matching_and_hector.ipynb.
Writes slamlab/datasets/data/ambiguous_closures.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("14b_scan_matching_and_hector")
KINDS = "rejected", "inflated (E)", "own covariance, no (E)", "believed to 3 cm, 0.4°"


def one(where, way, seed):
    """Drive there and back: closures kept, gaps and worst closure (m), and that in its sigmas."""
    log = page["there_and_back"](seed)
    found = page["judged"](page["closed"](log, way), log, way)
    return {name: float(f"{value:.3g}") for name, value in found.items()}


TRIAL = Trial(
    "ambiguous_closures",
    {("there and back", way): range(1, 21) for way in KINDS},
    one,
    sample=(("there and back", KINDS[0], 3), ("there and back", KINDS[2], 7)),
    off=0.002,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
