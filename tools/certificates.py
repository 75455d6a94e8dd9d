"""How often the map of a town from the linear start is certified: chapter 13b's stored trial.

python tools/certificates.py      (a minute; options as in tools/trials.py)

The functions are those of the page, notebooks/13b_pose_graphs.ipynb.
Writes slamlab/datasets/data/certificates.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

page = of_page("13b_pose_graphs")


def one(start, sigma, seed):
    """Certified or not (1, 0), gap of cost and bound (%), cheaper from the true poses (1, 0)."""
    certified, gap, cheaper = page["town_from_the_linear_start"](float(sigma), seed)
    return {"certified": int(certified), "gap": round(float(gap), 4), "cheaper": int(cheaper)}


TRIAL = Trial(
    "certificates",
    {("linear start", sigma): range(30) for sigma in ("0.15", "0.3", "0.4")},
    one,
    sample=(("linear start", "0.3", 2), ("linear start", "0.4", 5)),
    off=0.01,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
