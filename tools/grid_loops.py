"""Grid FastSLAM round two corridors: the stored table of chapter 15d.

python tools/grid_loops.py      (an hour; options as in tools/trials.py)

Writes slamlab/datasets/data/grid_loops.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.evaluation import run
from slamlab.filters.particle import lineage
from slamlab.geometry import between, compose
from slamlab.simulation import ring_laps
from slamlab.slam import GridFastSlam
from tools.trials import Trial, main

SIZES = {"28 m": (12.0, 8.0), "68 m": (24.0, 16.0)}
# Particles that match scans to their map first, and particles that are only weighed ("blind").
ROWS = {
    ("28 m", "10 that match"): ("matching", 10),
    ("28 m", "30 that match"): ("matching", 30),
    ("28 m", "30 blind"): ("penetration", 30),
    ("28 m", "200 blind"): ("penetration", 200),
    ("68 m", "10 that match"): ("matching", 10),
    ("68 m", "30 that match"): ("matching", 30),
    ("68 m", "200 that match"): ("matching", 200),
    ("68 m", "30 blind"): ("penetration", 30),
    ("68 m", "200 blind"): ("penetration", 200),
    ("68 m", "1000 blind"): ("penetration", 1000),
}


def one(corridor, particles, seed):
    """Measure a drive 8 m before the lap is complete (all but "end"), and at its end; metres.

    "before" is the error of the mean, "spread" the particles' RMS distance from it. "carried" is
    the error at the end if the true motion brought the mean there, with no loop and no new error;
    "nearest" is the least of that over the particles.

    "apart", "apart nearest" and "apart end" are "carried", "nearest" and "end" in the particles'
    own maps: off from where each particle was at that place on its own first lap.
    """
    model, n = ROWS[corridor, particles]
    log = ring_laps(SIZES[corridor], np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    result = run(
        GridFastSlam(log.scan, log.truth[0], n, model=model, rng=rng),
        log,
        record=("poses", "ancestors", "weights"),
    )
    k = int((float(corridor.split()[0]) - 8) / 0.4)
    last = log.truth[-1]
    first = int(np.hypot(*(log.truth[:k] - last)[:, :2].T).argmin())
    way = between(log.truth[first], last)
    rest = between(log.truth[k], last)
    cloud = compose(np.asarray(result.recorded["poses"][k]), rest) - last
    poses, weights = result.recorded["poses"], result.recorded["weights"]

    def apart(step: int) -> np.ndarray:
        """Give how far off its own first lap each particle of a step would end (M, 2)."""
        rows = lineage(result.recorded["ancestors"][: step + 1])[first]
        ends = compose(np.asarray(poses[step]), between(log.truth[step], last))
        return (ends - compose(np.asarray(poses[first])[rows], way))[:, :2]

    numbers = {
        "before": np.hypot(*(result.poses[k] - log.truth[k])[:2]),
        "spread": np.sqrt(np.trace(result.covs[k][:2, :2])),
        "carried": np.hypot(*(compose(result.poses[k], rest) - last)[:2]),
        "nearest": np.hypot(*cloud[:, :2].T).min(),
        "end": np.hypot(*(result.poses[-1] - last)[:2]),
        "apart": np.hypot(*(weights[k] @ apart(k))),
        "apart nearest": np.hypot(*apart(k).T).min(),
        "apart end": np.hypot(*(weights[-1] @ apart(len(log) - 1))),
    }
    return {name: round(float(number), 3) for name, number in numbers.items()}


TRIAL = Trial(
    "grid_loops",
    dict.fromkeys(ROWS, range(1, 21)),
    one,
    sample=(("28 m", "10 that match", 3), ("28 m", "30 blind", 4)),
    off=0.006,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
