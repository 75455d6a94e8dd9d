"""Filter and smoother over whole series against filterpy's batch_filter and rts_smoother."""

from __future__ import annotations

import time

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from slamlab.filters import kalman
from slamlab.gaussian import Gaussian

DT = 0.1
F = np.eye(4) + DT * np.eye(4, k=2)
H = np.eye(2, 4)
Q = 0.3 * np.kron([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]], np.eye(2))
R = np.diag([0.25, 0.36])
START = Gaussian(np.zeros(4), 10 * np.eye(4))
PEER_STEPS = 4000
COLUMNS = ("case", "slamlab (ms)", "filterpy (ms)", "times faster", "promised")


def series(*shape, seed=3):
    """Measurements of one track, or of a batch of them."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(DT * rng.normal(size=(*shape, 2)), -2)
    return walk + 0.5 * rng.normal(size=walk.shape)


def ours(z, evolution=F):
    return kalman.smooth(kalman.filter(z, evolution, H, Q, R, START))


def peer(z, evolution=F):
    """The same by filterpy, one series."""
    kf = KalmanFilter(dim_x=4, dim_z=2)
    kf.x, kf.P = np.zeros(4), START.cov.copy()
    kf.F, kf.H, kf.Q, kf.R = F, H, Q, R
    Fs = None if evolution.ndim == 2 else list(evolution)
    means, covs, _, _ = kf.batch_filter([None if np.isnan(x[0]) else x for x in z], Fs=Fs)
    return kf.rts_smoother(means, covs, Fs=Fs)[:2]


def seconds(function, *arguments):
    """CPU seconds of a call, so that no busy machine decides."""
    start = time.process_time()
    function(*arguments)
    return time.process_time() - start


def measure(z, evolution=F, rounds=3):
    """Median seconds of both in turn; filterpy on its first steps, scaled to all of them."""
    first = z.reshape(-1, *z.shape[-2:])
    n_series = min(len(first), max(1, PEER_STEPS // z.shape[-2]))
    part = first[:n_series, :PEER_STEPS]
    share = part.size / z.size
    short = evolution if evolution.ndim == 2 else evolution[:PEER_STEPS]
    pairs = [
        (seconds(ours, z, evolution), sum(seconds(peer, one, short) for one in part) / share)
        for _ in range(rounds)
    ]
    return np.median(pairs, axis=0)


def with_gaps(z):
    """Every third measurement is missing: the covariances never settle."""
    z[::3] = np.nan
    return z


CASES = {
    "one series of 1000 steps, filter and smoother": (series(1000), F, 1),
    "1000 series of 1000 steps in one call, filter and smoother": (series(1000, 1000), F, 50),
}


def rows(rounds=3):
    """Rows of the performance page: what, ours (ms), peer (ms), peer / ours, promised."""
    found = []
    for name, (z, evolution, promise) in CASES.items():
        mine, theirs = measure(z, evolution, rounds)
        found.append((name, 1e3 * mine, 1e3 * theirs, theirs / mine, promise))
    return found


@pytest.mark.parametrize("name", CASES)
def test_speed_against_filterpy_keeps_its_promise(name):
    z, evolution, promise = CASES[name]
    for _ in range(3):
        mine, theirs = measure(z, evolution, 1)
        if theirs > promise * mine:
            return
    pytest.fail(f"{1e3 * mine:.0f} ms, filterpy {1e3 * theirs:.0f} ms, promised {promise} x")


def test_what_is_measured_is_the_same_to_1e_9():
    z = series(3, 3000)
    smoothed = ours(z)
    for mean, cov, one in zip(smoothed.means, smoothed.covs, z, strict=True):
        means, covs = peer(one)
        np.testing.assert_allclose(mean, means, atol=1e-9)
        np.testing.assert_allclose(cov, covs, atol=1e-9)


def test_with_gaps_what_is_measured_is_the_same_to_1e_9():
    z = with_gaps(series(500))
    smoothed, (means, covs) = ours(z), peer(z)
    np.testing.assert_allclose(smoothed.means, means, atol=1e-9)
    np.testing.assert_allclose(smoothed.covs, covs, atol=1e-9)
