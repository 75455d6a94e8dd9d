"""How far from the start robots end that drive home along a long path: chapter 17's stored trial.

python tools/long_way.py      (two minutes; options as in tools/trials.py)

The functions are those of the page, notebooks/17_the_way_home.ipynb.
Writes slamlab/datasets/data/long_way.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

DRIVE = "E", "leg", "start", "truth", "room", "camera", "light"
page = of_page("17_the_way_home", *DRIVE)


def one(metres, noise, seed):
    """Sixty robots: median distance of their ends from the start, and these to the cm (m)."""
    ends = page["way_back"](float(metres), seed, noise)
    end = float(f"{np.median(np.hypot(*ends.T)):.3g}")
    return {"end": end, "stops": (ends.round(2) + 0.0).tolist()}


TRIAL = Trial(
    "long_way",
    {(metres, "light model"): range(20) for metres in ("3.5", "14", "42")}
    | {("42", page["CALM"]): range(20)},
    one,
    sample=(("14", "light model", 3),),
    off=0.011,  # a stop may be rounded the other way
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
