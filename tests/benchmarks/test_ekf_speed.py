"""EKF-SLAM against the textbook's dense matrices and against the bare arithmetic of one update."""

from __future__ import annotations

import numpy as np
import pytest
from in_turn import alternate
from scipy.linalg.blas import dgemm

from slamlab.robots import YOUBOT
from slamlab.sensors import RangeBearing
from slamlab.slam import CompressedEKFSlam, EKFSlam, FastSlam

DT, U, V = 0.1, np.array([0.5, 0.1, 0.2]), YOUBOT.control_cov(0.4)
SENSOR = RangeBearing(0.05, 0.02, offset=0.3)
SEEN = 10


def scene(n, kind=EKFSlam):
    """A filter with n correlated landmarks, and one look at the first ten of them."""
    rng, seen = np.random.default_rng(5), min(n, SEEN)
    there = rng.uniform(-20, 20, (n, 2))
    slam = kind(YOUBOT, SENSOR, np.zeros(3), 0.01 * np.eye(3))
    slam.update(SENSOR.observe(np.zeros(3), there[:seen]), range(seen))
    slam.predict(U, DT, V)
    slam.update(SENSOR.observe(slam.pose, there[seen:]), range(seen, n))
    z = SENSOR.observe(YOUBOT.step(slam.pose, U, DT), there[:seen])
    return slam, z, np.arange(seen)


def our_step(slam, z, rows):
    slam.predict(U, DT, V)
    slam.update(z, rows)


def textbook_step(mean, P, z, rows):
    """The step as a textbook prints it: dense F and H, K S K^T."""
    N = len(mean)
    F_x, F_u = YOUBOT.jacobians(mean[:3], U, DT)
    mean = np.concatenate([YOUBOT.step(mean[:3], U, DT), mean[3:]])
    F, G = np.eye(N), np.zeros((N, 3))
    F[:3, :3], G[:3] = F_x, F_u
    P = F @ P @ F.T + G @ V @ G.T
    landmarks = mean[3:].reshape(-1, 2)[rows]
    H = np.zeros((2 * len(rows), N))
    H_pose, H_landmark = SENSOR.jacobians(mean[:3], landmarks)
    for k, row in enumerate(rows):
        H[2 * k : 2 * k + 2, :3] = H_pose[k]
        H[2 * k : 2 * k + 2, 3 + 2 * row : 5 + 2 * row] = H_landmark[k]
    v = SENSOR.residual(z, SENSOR.observe(mean[:3], landmarks)).ravel()
    S = H @ P @ H.T + np.kron(np.eye(len(rows)), SENSOR.cov)
    K = P @ H.T @ np.linalg.inv(S)
    return mean + K @ v, P - K @ S @ K.T


def measure_textbook(n, rounds=5, burst=1):
    slam, z, rows = scene(n)
    mean, P = slam.mean, slam.cov

    def ours():
        slam._x = mean.copy()  # the textbook steps from the same place every time
        our_step(slam, z, rows)

    return alternate(
        ours,
        lambda: textbook_step(mean, P, z, rows),
        rounds=rounds,
        burst=burst,
    )


def measure_bare(n=1000, rounds=9):
    """Our step against nothing but P - B B^T in place, B of rank 20."""
    slam, z, rows = scene(n)
    N = len(slam.mean)
    P = np.asfortranarray(slam.cov)
    B = np.asfortranarray(1e-3 * np.random.default_rng(6).standard_normal((N, 2 * SEEN)))

    def bare():
        dgemm(-1.0, B, B, beta=1.0, c=P, trans_b=1, overwrite_c=1)

    return alternate(lambda: our_step(slam, z, rows), bare, rounds=rounds, burst=5)


def measure_slope(rounds=7, sizes=(200, 400, 800, 1400, 2000)):
    """Slope of log time over log n, and the seconds themselves."""
    scenes = [scene(n) for n in sizes]
    seconds = alternate(*(lambda s=s: our_step(*s) for s in scenes), rounds=rounds)
    return np.polyfit(np.log(sizes), np.log(seconds), 1)[0], seconds


def other_scene(kind, n):
    """A compressed EKF with a region of 20 among n landmarks, or FastSLAM with 100 particles."""
    if kind == "compressed EKF":
        slam, z, rows = scene(n, CompressedEKFSlam)
        slam.set_region(range(20))
        return slam, z, rows
    slam, z, rows = scene(n)
    fast = FastSlam(YOUBOT, SENSOR, [0, 0, 0], 100, rng=np.random.default_rng(7))
    fast.update(SENSOR.observe(np.zeros(3), slam.landmarks), range(n))
    return fast, z, rows


def measure_other(kind, rounds=7, sizes=(125, 250, 500, 1000)):
    """Slope of log time over log n of another way to SLAM, and the seconds."""
    scenes = [other_scene(kind, n) for n in sizes]
    seconds = alternate(*(lambda s=s: our_step(*s) for s in scenes), rounds=rounds, burst=3)
    return np.polyfit(np.log(sizes), np.log(seconds), 1)[0], seconds


# How many landmarks: how the step is measured, and the most of the textbook's time it may take.
# At five and ten landmarks Python's calls are all there is, and the textbook makes fewer of them:
# it checks no argument and adds no landmark.
TEXTBOOK = {
    5: ({"rounds": 60, "burst": 20}, 1.3),
    10: ({"rounds": 60, "burst": 20}, 1.3),
    50: ({"rounds": 20, "burst": 20}, 0.8),
    100: ({"rounds": 9, "burst": 20}, 1 / 2),
    200: ({"rounds": 3}, 1 / 3),
    1000: ({"rounds": 1, "burst": (20, 1)}, 1 / 80),
}


def rows(rounds=9):
    """Rows of the performance page: what, ours (ms), peer (ms), peer / ours or ours / peer."""
    dense = {n: measure_textbook(n, **how) for n, (how, _) in TEXTBOOK.items()}
    bare = measure_bare(rounds=rounds)
    slope, seconds = measure_slope(rounds)
    compressed = measure_other("compressed EKF", rounds)
    fast = measure_other("FastSLAM", rounds)
    what = "EKF-SLAM, predict and 10 observations"
    return [
        (name, 1e3 * ours, 1e3 * peer, ours / peer, promise)
        for name, (ours, peer), promise in (
            *(
                (
                    f"{what.replace('10', str(min(n, SEEN)))}, n = {n}; dense textbook",
                    dense[n],
                    promise,
                )
                for n, (_, promise) in TEXTBOOK.items()
            ),
            (f"{what}, n = 1000; bare rank-20 update, both triangles", bare, 3.0),
            (
                f"{what}, n = 2000 against n = 200 (slope {slope:.2f})",
                (seconds[-1], seconds[0]),
                10**2.2,
            ),
            (
                f"compressed EKF, 20 local; n = 1000 against 125 (slope {compressed[0]:.2f})",
                (compressed[1][-1], compressed[1][0]),
                2.0,
            ),
            (
                f"FastSLAM, 100 particles; n = 1000 against 125 (slope {fast[0]:.2f})",
                (fast[1][-1], fast[1][0]),
                2.0,
            ),
        )
    ]


def test_our_step_and_the_textbooks_do_the_same():
    slam, z, rows = scene(30)
    mean, P = textbook_step(slam.mean, slam.cov, z, rows)
    our_step(slam, z, rows)
    np.testing.assert_allclose(slam.mean, mean, atol=1e-12)
    np.testing.assert_allclose(slam.cov, P, atol=1e-12)


@pytest.mark.parametrize(
    ("measure", "promise"),
    [
        *(
            pytest.param(
                lambda n=n, how=how: measure_textbook(n, **how),
                promise,
                id=f"dense textbook, n = {n}",
            )
            for n, (how, promise) in TEXTBOOK.items()
        ),
        pytest.param(measure_bare, 3.0, id="bare rank-20 update"),
    ],
)
def test_speed_within_its_promise(measure, promise):
    for _ in range(5):
        ours, peer = measure()
        if ours < promise * peer:
            return
    pytest.fail(f"{1e3 * ours:.2f} ms, peer {1e3 * peer:.2f} ms, promised {promise:.3f} x")


def test_cost_grows_with_the_square_of_the_landmarks():
    assert any(measure_slope()[0] < 2.2 for _ in range(2))


@pytest.mark.parametrize("kind", ["compressed EKF", "FastSLAM"])
def test_the_others_hardly_grow_with_the_landmarks(kind):
    for _ in range(3):
        slope, seconds = measure_other(kind)
        if seconds[-1] < 2 * seconds[0]:
            return
    pytest.fail(f"slope {slope:.2f}")
