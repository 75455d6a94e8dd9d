"""How a path is stored, by P3's four fits: the drive of chapter 17 twenty times, a stored trial.

python tools/path_fits.py      (minutes; options as in tools/trials.py)

Writes slamlab/datasets/data/path_fits.json, which `slamlab.datasets.stored_runs` reads.
"""

import sys
from itertools import accumulate
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.geometry import compose
from slamlab.navigation import VARIANTS, Cubic, PathMemory
from slamlab.sensors import VisualOdometer
from tools.trials import Trial, main

E = 0.05  # tolerance of P3 (m)
SEEDS = range(20)
NOISE = ("1", "0.05")  # parts of the noise of a step of chapter 17


def drive(part, seed):
    """Points of the odometer: six legs of half a metre, five right angles."""
    leg, bend = [[0.01, 0, 0]] * 50, [[0, 0, -np.pi / 2 / 68]] * 68
    start = np.array([0, 0, np.pi / 2])
    truth = np.array([*accumulate(2 * leg + 3 * (bend + leg) + leg, compose, initial=start)])
    odometer = VisualOdometer.simple(0.009 * part, 0.005 * part)
    return odometer.run(truth, np.random.default_rng([17, seed]))[:, :2]


def kink(memory):
    """Mean angle (degrees) by which a path turns at its inner knots."""
    a, b = (memory.tangent_at(memory.knots[1:-1] + h) for h in (-1e-9, 1e-9))
    return np.degrees(np.arccos(np.clip((a * b).sum(1), -1, 1))).mean()


def distances(c, points):
    """Distance of each point from a cubic in 400 straight parts: the two at its nearest knot."""
    knots = Cubic(c)(np.linspace(0, 1, 401))
    k = np.clip(cKDTree(knots).query(points)[1], 1, 399)
    a, b = knots[[k - 1, k]], knots[[k, k + 1]]
    t = np.clip(((points - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1), 0, 1)
    return np.linalg.norm(a + t[..., None] * (b - a) - points, axis=-1).min(0)


def nearer(c, points):
    """From cubic c on, least squares of the distances themselves; both ends are held."""

    def cubic(free):
        return np.array([c[0], free[:2], c[1:].sum(0) - free[:2] - free[2:], free[2:]])

    first = np.r_[c[1], c[3]]
    return cubic(least_squares(lambda free: distances(cubic(free), points), first, x_scale=0.1).x)


def excess(points):
    """Root mean square distance from P3's cubics, over that from the nearer ones."""
    memory = PathMemory.from_points(points, E, min_step=0, loop_accuracy=None, check_between=False)
    at = cKDTree(points).query(memory.point_at(memory.knots))[1]
    squares = np.zeros(2)
    for cubic, i, j in zip(memory.segments, at[:-1], at[1:], strict=True):
        first, piece = cubic.coefficients, points[i : j + 1]
        squares += [(distances(c, piece) ** 2).sum() for c in (first, nearer(first, piece))]
    return np.sqrt(squares[0] / squares[1])


def one(part, fit, seed):
    """Store one drive by one of the fits; or compare P3's with the nearest cubics."""
    points = drive(float(part), seed)
    if fit == "nearest":
        return {"excess": round(float(excess(points)), 3)}
    memory = PathMemory.from_points(points, E, fit, loop_accuracy=None, check_between=False)
    return {"segments": memory.n_segments, "kink": round(float(kink(memory)), 2)}


TRIAL = Trial(
    "path_fits",
    {("1", fit): SEEDS for fit in VARIANTS} | {(part, "nearest"): SEEDS for part in NOISE},
    one,
    sample=(("1", "two-points", 0), ("1", "point", 3), ("1", "nearest", 1)),
    off=0.02,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
