"""Measure grid FastSLAM on two real logs, with ten drives' wheels: the stored table of chapter 15.

SLAMLAB_DATA=FOLDER python tools/grid_table.py [SEEDS]      (minutes; the folder holds the two
"corrected" logs of the Radish archive, csail and freiburg-101)
"""

import os
import sys
import time
from pathlib import Path

import numpy as np

from slamlab.datasets import read_carmen
from slamlab.evaluation import ate, run
from slamlab.filters.particle import lineage
from slamlab.simulation import drifted
from slamlab.slam import GridFastSlam
from slamlab.slam._grid_maps import EMPTY


def main():
    folder, seeds = Path(os.environ["SLAMLAB_DATA"]), int(sys.argv[1] if sys.argv[1:] else 10)
    for name in ("csail", "freiburg-101"):
        whole = read_carmen(folder / f"{name}-corrected.log.gz", corrected=True)
        for n in (30, 10):
            for seed in range(1, seeds + 1):
                log = drifted(whole, np.random.default_rng(seed))
                rng = np.random.default_rng(10 + seed)
                system = GridFastSlam(log.scan, log.truth[0], n, rng=rng)
                begin = time.process_time()
                result = run(system, log, keep=("ancestors", "poses"))
                ms = 1e3 * (time.process_time() - begin) / len(log)
                rows = lineage(result.kept["ancestors"])
                paths = np.array(result.kept["poses"])[np.arange(len(log))[:, None], rows]
                best = paths[:, system.log_weights.argmax()]
                copies = np.count_nonzero(system._maps.shared.table) * EMPTY.nbytes
                print(
                    f"{name:13s} {n:3d} particles, seed {seed:2d}: "
                    f"as believed on the way {ate(result).rmse:.3f} m, "
                    f"path of the best in the end {ate(best, log.truth).rmse:.3f} m, "
                    f"{ms:.1f} ms a scan, tiles / copies {system.map_bytes / copies:.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
