"""Send robots out and home again: the stored table of chapter 20, run by run.

python tools/expeditions.py [MINUTES]     (5 s of computing a run; what is stored is not run again)

Results go to slamlab/datasets/data/expeditions.json, which `simulation.expedition.results` reads.
"""

import json
import sys
import time

from slamlab.simulation.expedition import BELIEFS, BUILDINGS, STORED, WAYS, come_home, explore

# In this order: buildings with the beliefs that are tried in each, up to so many seeds.
MATCHERS = ["scan graph", "dead reckoning", "scan matching"]
OTHERS = ["EKF-SLAM, walls", "grid FastSLAM"]
PLAN = [
    *((building, MATCHERS, 2) for building in ("corridor", "office")),
    *((building, MATCHERS, 5) for building in ("ring", "corridor", "office")),
    *((building, OTHERS, 3) for building in BUILDINGS),
    *((building, MATCHERS, 10) for building in BUILDINGS),
    *((building, MATCHERS, 30) for building in BUILDINGS),
    *((building, OTHERS, 30) for building in BUILDINGS),
]


def row(building, belief, seed):
    """One way out and all ways home, in few digits."""
    out = explore(BUILDINGS[building], BELIEFS[belief], seed)
    homes = [come_home(out, way) for way in WAYS]
    return {
        "coverage": round(float(out.coverage), 4),
        "error": [round(home.error, 3) for home in homes],
        "believed": [round(home.believed, 3) for home in homes],
        "nees": [float(f"{home.nees:.3g}") for home in homes],
        "touched": [int(home.touched) for home in homes],
        "seconds": [round(home.seconds) for home in homes],
        "metres": [round(home.metres) for home in homes],
    }


def main():
    deadline = time.time() + 60 * float(sys.argv[1] if len(sys.argv) > 1 else 1e9)
    stored = json.loads(STORED.read_text()) if STORED.exists() else {}
    for building, beliefs, seeds in PLAN:
        for seed in range(seeds):
            for belief in beliefs:
                rows = stored.setdefault(building, {}).setdefault(belief, [])
                if len(rows) > seed:
                    continue
                if time.time() > deadline:
                    return
                rows.append(row(building, belief, seed))
                print(building, belief, seed, rows[-1], flush=True)
                text = json.dumps(stored, separators=(",", ":")).replace("},{", "},\n{")
                STORED.write_text(text + "\n")


if __name__ == "__main__":
    main()
