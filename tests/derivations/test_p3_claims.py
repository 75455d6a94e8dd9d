"""P3's claims in words: a Kalman filter delays, loops cost log squared, 16 % of the way."""

import numpy as np
import pytest

from slamlab.filters import kalman
from slamlab.gaussian import Gaussian
from slamlab.localization import DeadReckoning
from slamlab.navigation import Homer, PathMemory, ReturnLaw
from slamlab.navigation._boxes import TESTS, search
from slamlab.navigation._spline import Spline
from slamlab.robots import RelativePose, Unicycle
from slamlab.sensors import VisualOdometer
from slamlab.simulation import record

DT = 0.1
CORNERS = 0.5 * np.array([[0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [1, 2], [1, 3], [0, 3]])


def place(t):
    """The robot at times t (n,): legs of 0.5 m, right angles, 50.4 s."""
    k = np.clip(np.asarray(t) / 50.4, 0, 1 - 1e-12) * 7
    leg = k.astype(int)
    return CORNERS[leg] + (k - leg)[:, None] * (CORNERS[leg + 1] - CORNERS[leg])


def filtered(z, sigma, acceleration):
    F, H = np.array([[1, DT], [0, 1]]), np.array([[1.0, 0.0]])
    Q = acceleration**2 * np.outer([DT**2 / 2, DT], [DT**2 / 2, DT])
    start = Gaussian([0.0, 0.0], np.diag([sigma, 0.1]) ** 2)
    return kalman.filter(z.T[..., None], F, H, Q, np.array([[sigma**2]]), start)


def delay_and_error(estimate, t):
    """Shift in time (s) with the smallest error, and the error without a shift (m)."""
    shifts = np.arange(-0.3, 0.6, 0.01)
    errors = [np.sqrt(((estimate - place(t - s)) ** 2).sum(1).mean()) for s in shifts]
    return shifts[int(np.argmin(errors))], errors[int(np.argmin(np.abs(shifts)))]


@pytest.mark.parametrize(("sigma", "samples"), [(0.005, 0.5), (0.02, 0.5), (0.05, 1.0)])
def test_a_tuned_kalman_filter_delays_a_sample_at_most(sigma, samples):
    """P3: "brings in too high a delay". Half a sample up to 20 mm of noise, below one at 50."""
    t = DT * np.arange(505)
    rng = np.random.default_rng(1)
    best = {}
    for run in range(5):
        z = place(t) + rng.normal(0, sigma, (505, 2))
        # Tuned without the truth: the acceleration that makes the data most likely.
        choices = np.geomspace(0.01, 3, 13)
        tried = [filtered(z, sigma, a) for a in choices]
        tuned = tried[int(np.argmax([f.log_likelihood.sum() for f in tried]))]
        smoothed = kalman.smooth(tuned).means[..., 0].T
        stiff = filtered(z, sigma, 0.002).means[..., 0].T
        best[run] = [
            *delay_and_error(tuned.means[..., 0].T, t),
            *delay_and_error(smoothed, t),
            *delay_and_error(stiff, t),
            np.sqrt(((z - place(t)) ** 2).sum(1).mean()),
        ]
    delay, error, smooth_delay, smooth_error, stiff_delay, _, raw = np.mean(list(best.values()), 0)
    assert abs(delay) <= samples * DT
    assert error < 0.8 * raw
    assert smooth_error < 0.75 * error
    assert abs(smooth_delay) <= 0.03
    assert stiff_delay > 0.2, "only a filter told that the robot never turns lags behind"


def boxes_for_a_return_beside(n, accuracy=1e-4):
    length = n * accuracy
    out = np.array([[0, 0], [length, 0], [0, 0.25 * length], [0, -0.1 * length]])
    back = np.stack(
        [out.sum(0), -(out[1] + 2 * out[2] + 3 * out[3]), out[2] + 3 * out[3], -out[3]]
    )
    back[0, 1] += 1.5 * accuracy
    spline = Spline()
    spline.append(out)
    arrays = spline.coefficients, spline.boxes
    return search(back, 0.0, 1.0, *arrays, 1, 1.0, accuracy, True)[TESTS]


def boxes_for_passing_many(m, accuracy=1e-3):
    """A new segment that passes m old ones on a staircase and enters the box of each."""
    spline = Spline()
    for k in range(m):
        spline.append(np.array([[k, k], [1, 0], [0, 1], [0, 0.0]]))
    beside = np.array([[m, m + 0.05], [-m, -m], [0, 0], [0, 0.0]])
    arrays = spline.coefficients, spline.boxes
    return search(beside, 0.0, 1.0, *arrays, m, 1.0, accuracy, True)[TESTS]


def test_the_search_for_loops_is_at_worst_linear_in_n_and_in_m():
    """P3: "in the worst case ... O((log2 n M)^2)"."""
    n = 2 ** np.arange(8, 14)
    counts = np.array([boxes_for_a_return_beside(k) for k in n])
    law = np.log2(n) ** 2
    assert counts[-1] / counts[0] > 25
    assert law[-1] / law[0] < 3
    m = 2 ** np.arange(3, 8)
    counts = np.array([boxes_for_passing_many(k) for k in m])
    assert (np.diff(np.log2(counts)) > 0.8).all()


def test_what_the_error_at_the_far_end_alone_costs():
    """16 % of 3.5 m: the part that F' - F and 7 degrees make is 9.4 % or 5.3 %."""
    believed, truth = np.array([-0.5, 0.5]), np.array([-0.25, 0.55])
    for degrees, share in ((7, 0.094), (-7, 0.053)):
        a = np.radians(degrees)
        R = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        end = truth + R @ ([0, 0] - believed)
        assert np.hypot(*end) / 3.5 == pytest.approx(share, abs=5e-4)
        # The heading's error forgotten, the share is another one.
        assert np.hypot(*(truth - believed)) / 3.5 != pytest.approx(share, abs=5e-3)
        # And the simulated return with perfect odometry ends there.
        memory = PathMemory(0.05)
        for point in np.concatenate([np.linspace([0, 0], [0, 0.5], 40),
                                     np.linspace([0, 0.5], [-0.5, 0.5], 40)]):  # fmt: skip
            memory.add(point)
        home = record(
            None, Unicycle(), None, Homer(memory, ReturnLaw(backwards=True), stop=0.001),
            DeadReckoning(RelativePose(), [*believed, np.pi]), np.random.default_rng(0),
            start=[*truth, np.pi + a], odometer=VisualOdometer.simple(0, 0),
        )  # fmt: skip
        assert np.hypot(*(home.truth[-1, :2] - end)) < 0.005


def test_forty_runs_prove_little_about_the_rest():
    """All 40 within a limit: with 95 % confidence the share of runs within it is above 0.928."""
    assert 0.05 ** (1 / 40) == pytest.approx(0.928, abs=5e-4)
    rng = np.random.default_rng(0)
    # Draw limits as the largest of 40; how much of the distribution lies within each?
    within = np.sort(rng.random((20000, 40)).max(1))
    assert within[1000] == pytest.approx(0.928, abs=0.003)
    assert within[1000] < 0.975, "one might take the sample for the 97.5 % quantile"
