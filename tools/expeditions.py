"""Send robots out and home again: the stored table of chapter 20, run by run.

python tools/expeditions.py [--building NAME ...] [--belief NAME ...] [--seeds 30] [--minutes N]

A run takes 10 to 60 s of computing; what is stored is not run again. Several of these may run
side by side. Results go to slamlab/datasets/data/expeditions.json, which
`simulation.expedition.results` reads.
"""

import argparse
import fcntl
import json
import time
from itertools import product

from slamlab.simulation.expedition import (
    ENVIRONMENTS,
    ESTIMATORS,
    RETURN_METHODS,
    STORED,
    come_home,
    explore,
)


def row(building, belief, seed):
    """One way out and all ways home, in few digits."""
    out = explore(ENVIRONMENTS[building], ESTIMATORS[belief], seed)
    homes = [come_home(out, way) for way in RETURN_METHODS]
    return {
        "coverage": round(float(out.coverage), 4),
        "error": [round(home.error, 3) for home in homes],
        "believed": [round(home.believed, 3) for home in homes],
        "nees": [float(f"{home.nees:.3g}") for home in homes],
        "touched": [int(home.touched) for home in homes],
        "seconds": [round(home.seconds) for home in homes],
        "metres": [round(home.metres) for home in homes],
    }


def read():
    """Read what is stored: rows in the order of their seeds, by building and belief."""
    return json.loads(STORED.read_text()) if STORED.exists() else {}


def write(building, belief, seed, new):
    """Add a row, unless another process was faster; nobody else writes meanwhile."""
    with open(STORED.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        stored = read()
        rows = stored.setdefault(building, {}).setdefault(belief, [])
        if len(rows) == seed:
            rows.append(new)
            text = json.dumps(stored, separators=(",", ":")).replace("},{", "},\n{")
            STORED.write_text(text + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--building", nargs="+", choices=list(ENVIRONMENTS), default=list(ENVIRONMENTS)
    )
    parser.add_argument("--belief", nargs="+", choices=list(ESTIMATORS), default=list(ESTIMATORS))
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--minutes", type=float, default=1e9)
    asked = parser.parse_args()
    deadline = time.time() + 60 * asked.minutes
    for seed, building, belief in product(range(asked.seeds), asked.building, asked.belief):
        if len(read().get(building, {}).get(belief, [])) > seed:
            continue
        if time.time() > deadline:
            return
        new = row(building, belief, seed)
        print(building, belief, seed, new, flush=True)
        write(building, belief, seed, new)


if __name__ == "__main__":
    main()
