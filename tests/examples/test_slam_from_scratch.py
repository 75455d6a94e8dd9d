"""The capstone's file: each of its eight steps, wrong forms of them, and whole logs."""

import importlib.util
import os
from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import killian, read_carmen
from slamlab.evaluation import ate
from slamlab.geometry import between
from slamlab.sensors import Lidar
from slamlab.simulation import drifted, ring_laps

FILE = Path(__file__).resolve().parents[2] / "examples" / "slam_from_scratch.py"


def loaded(*edits):
    """The file as a module, with pieces of its text replaced."""
    source = FILE.read_text()
    for old, new in edits:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    module = importlib.util.module_from_spec(importlib.util.spec_from_file_location("own", FILE))
    exec(compile(source, "own", "exec"), vars(module))
    return module


OWN = loaded()


def room(n=400, w=8.0, h=5.0):
    """Points on the walls of a room with a niche; nothing in it is symmetric."""
    t = np.linspace(0, 1, n // 4)
    line = lambda a, b: np.outer(1 - t, a) + np.outer(t, b)
    c = [(0, 0), (w, 0), (w, 3), (w - 2, 3), (w - 2, h), (0, h)]
    return np.vstack([line(a, b) for a, b in zip(c, c[1:] + c[:1])]) - [2.0, 1.5]


def corridor(length=20.0):
    x = np.linspace(-length / 2, length / 2, 400)
    return np.vstack([np.stack([x, 0 * x + 1], -1), np.stack([x, 0 * x - 1], -1)])


def poses(n, rng):
    return np.column_stack([rng.normal(size=(n, 2)) * 3, rng.uniform(-np.pi, np.pi, n)])


def node(m, points):
    return points, m.estimate_normals(points)


def step1(m, rng):
    a, b, c = poses(50, rng), poses(50, rng), poses(50, rng)
    assert np.allclose(m.between(a, m.compose(a, b)), b), "between undoes compose"
    left, right = m.compose(m.compose(a, b), c), m.compose(a, m.compose(b, c))
    assert np.allclose(np.cos(left[:, 2]), np.cos(right[:, 2])) and np.allclose(
        left[:, :2], right[:, :2]
    ), "associative"
    assert np.allclose(m.compose([0, 0, np.pi / 2], [1.0, 0, 0])[:2], [0, 1]), (
        "ahead is along the heading"
    )
    p = rng.normal(size=(7, 2))
    assert np.allclose(
        m.transform(m.compose(a[0], b[0]), p), m.transform(a[0], m.transform(b[0], p))
    ), "points move as poses do"
    assert (
        abs(m.wrap(np.pi + 0.1) + np.pi - 0.1) < 1e-9
        and (np.abs(m.compose(a, b)[:, 2]) <= np.pi).all()
    ), "angles wrapped"


def step2(m, rng):
    angles = np.deg2rad([-90, 0, 90])
    p = m.scan_points(np.array([1.0, 2.0, np.inf]), angles)
    assert p.shape == (2, 2) and np.allclose(sorted(map(tuple, p.round(9))), [(0, -1), (2, 0)]), (
        "first beam looks right, inf is no point"
    )
    assert len(m.scan_points(np.array([np.nan, 100.0, 0.0]), angles)) == 0, (
        "no point from nan, far, 0"
    )
    q = rng.uniform(-3, 3, (4000, 2))
    t = m.voxel_downsample(q, 0.5)
    cells = np.floor(t / 0.5).astype(int)
    assert (
        len(np.unique(cells, axis=0))
        == len(t)
        == len(np.unique(np.floor(q / 0.5).astype(int), axis=0))
    ), "one point a cell, every cell, also left of 0"
    assert all((x == q).all(1).any() for x in t), "points are kept, not invented"


def step3(m, rng):
    walls = room() + 0.002 * rng.normal(size=room().shape)
    n = m.estimate_normals(walls)
    ok = np.isfinite(n[:, 0])
    assert ok.mean() > 0.8 and np.allclose(np.hypot(*n[ok].T), 1), "unit normals on most"
    assert (np.abs(n[ok]).max(1) > 0.97).mean() > 0.9, "normals stand across the walls"
    assert np.isnan(m.estimate_normals(rng.uniform(0, 4, (600, 2)))[:, 0]).mean() > 0.5, (
        "no normals in a cloud"
    )
    there = np.array([1.0, 2.0, 0.7])
    _, placed, tree = m.local_map([node(m, walls)], there[None])
    again = m.estimate_normals(m.transform(there, walls))[ok]
    assert np.allclose(np.abs((placed * again).sum(1)), 1, atol=0.02), (
        "normals turn with the keyframe and do not shift"
    )
    submap = m.local_map([node(m, walls)], np.zeros((1, 3)))
    for true in ([0.2, -0.15, 0.05], [-0.1, 0.2, -0.08]):
        R = m.rotation(true[2])[:2, :2]
        scan = m.voxel_downsample((room() - true[:2]) @ R, 0.15)
        x, cov, fit = m.icp(submap, scan, np.zeros(3), np.diag([1, 1, 0.3]) ** 2)
        assert np.abs(x - true).max() < 0.01 and fit > 0.9, f"a room is found: {x}"
        far = scan.copy()
        far[::4] += [0.35, 0.3]
        assert (
            np.abs(m.icp(submap, far, np.zeros(3), np.diag([1, 1, 0.3]) ** 2)[0] - true).max()
            < 0.02
        ), "a quarter of outliers does no harm"
        near = scan.copy()
        near[::5] += np.array([0.13, 0.13]) @ R
        assert (
            np.abs(m.icp(submap, near, np.zeros(3), np.diag([1, 1, 0.3]) ** 2)[0] - true).max()
            < 0.02
        ), "nor does a fifth that is near"
    away = np.array([50.0, -30.0, 0.0])
    far_off = m.local_map([node(m, walls)], away[None])
    x, _, _ = m.icp(far_off, scan, away, np.diag([1, 1, 0.3]) ** 2)
    assert np.abs(x - away - true).max() < 0.01, "the same far from the origin"
    x, _, _ = m.icp(submap, scan, np.zeros(3), np.diag([1e-3, 1e-3, 1e-3]) ** 2)
    assert np.abs(x).max() < 0.01, "a certain guess stays"
    hall = m.local_map([node(m, corridor())], np.zeros((1, 3)))
    guess, spread = np.array([0.3, 0.15, 0.04]), np.diag([0.2, 0.2, 0.1]) ** 2
    x, cov, _ = m.icp(hall, corridor(6.0)[::4], guess, spread)
    assert np.abs(x[1:]).max() < 0.01 and abs(x[0] - 0.3) < 0.03, (
        "along a corridor the guess stays"
    )
    assert 0.02 < cov[0, 0] < 0.042 and cov[1, 1] < 0.01, "and the covariance says so"
    k = np.pi - 0.02
    R = m.rotation(k)[:2, :2]
    x, _, _ = m.icp(
        submap,
        m.voxel_downsample(room() @ R, 0.15),
        np.array([0.0, 0.0, -k]),
        np.diag([0.5, 0.5, 0.2]) ** 2,
    )
    assert abs(m.wrap(x[2] - k)) < 0.01, "across the seam of the angles"


def step4(m, rng):
    x, cov = np.array([1.0, 2.0, 0.7]), np.diag([0.04, 0.01, 0.02])
    u, Q = np.array([0.5, 0.1, 0.2]), np.diag([0.01, 0.002, 0.003])
    xs = m.compose(
        rng.multivariate_normal(x, cov * 0.01, 40000),
        rng.multivariate_normal(u, Q * 0.01 * m.ODOMETRY_INFLATION, 40000),
    )
    y, P = m.propagate(x, cov * 0.01, u, Q * 0.01)
    assert np.allclose(y, m.compose(x, u)) and np.allclose(P, np.cov(xs.T), atol=0.05 * P.max()), (
        "covariance as of a cloud of samples"
    )
    walls = room()
    submap = m.local_map([node(m, walls)], np.zeros((1, 3)))
    true = np.array([-0.9, 0.9, 0.25])
    scan = m.voxel_downsample((walls - true[:2]) @ m.rotation(true[2])[:2, :2], 0.15)
    y, P = m.track(submap, scan, np.zeros(3), np.diag([0.3, 0.3, 0.1]) ** 2)
    assert np.abs(y - true).max() < 0.03, f"a bad guess is searched for: {y}"
    y, P = m.track(
        submap, rng.uniform(-1.8, 3.3, (100, 2)), np.zeros(3), np.diag([0.3, 0.3, 0.1]) ** 2
    )
    assert np.allclose(y, 0) and P[0, 0] >= 0.089, "a scan that lies nowhere changes nothing"


def step5(m, rng):
    walls, true = room(), np.array([1.8, -1.0, 0.2618])
    scan = m.voxel_downsample((walls - true[:2]) @ m.rotation(true[2])[:2, :2], 0.2)
    x, score, second_peak = m.search(walls, scan, np.zeros(3), 2.5, np.deg2rad(20))
    assert np.hypot(*(x - true)[:2]) < 0.25 and abs(x[2] - true[2]) < np.deg2rad(1.6), f"found {x}"
    assert second_peak < 0.8 < 0.1 + score, (score, second_peak)
    half = np.hypot(*scan.T).max() + 2.5
    field = m.likelihood_field(walls, [0.0, 0.0], half, 0.1)
    at = np.floor((m.transform(x, scan) + half) / 0.1).astype(int)
    assert abs(score - field[tuple(at.T)].mean()) < 1e-3, (
        "the FFT's score is the sum over the points"
    )
    field = m.likelihood_field(walls, [0.0, 0.0], 12.0, 0.1)
    assert field.max() == 1 and field[0].max() < 1e-3, "1 on walls, 0 at the margin"
    wall = m.likelihood_field(
        np.stack([np.linspace(-9, 9, 400), np.zeros(400)], -1), [0.0, 0.0], 5.0, 0.1
    )
    assert np.allclose(wall[50, [50, 51, 52]], np.exp([0, -0.5, -2])), "a bell one cell wide"
    y = np.linspace(-0.5, 0.5, 20)
    here, there = np.stack([0 * y + 5.0, y], -1), np.stack([0 * y - 4.6, y], -1)
    assert m.search(there, here, np.zeros(3), 2.5, 0.05)[1] < 0.3, (
        "what leaves on the right does not come in on the left"
    )
    x, _, second_peak = m.search(
        corridor(40), corridor(6.0)[::4], np.zeros(3), 2.5, np.deg2rad(20)
    )
    assert second_peak > 0.95, "a corridor has a second peak"


def loop(m, n=40, r=8.0):
    """A circle driven twice, in truth; chain with drift in heading."""
    t = np.arange(n) * 4 * np.pi / n
    true = np.column_stack([r * np.sin(t), r * (1 - np.cos(t)), m.wrap(t)])
    z = m.between(true[:-1], true[1:])
    est = [true[0]]
    for s in z:
        est.append(m.compose(est[-1], s + [0.02, 0, 0.01]))
    est = np.array(est)
    travel = np.r_[0, np.cumsum(np.hypot(*(est[1:] - est[:-1])[:, :2].T))]
    return true, est, travel


def step6(m, rng):
    true, est, travel = loop(m)
    half = len(true) // 2
    aside = np.zeros((len(true), 3))
    aside[::2, 1] = 1.0  # moves along one circle commute: no check of their order
    true, est = m.compose(true, aside), m.compose(est, aside)
    old, radius = m.candidates(half + 5, est, travel, 100.0)
    assert (
        old
        and all(travel[half + 5] - travel[j] >= m.MIN_LOOP for j in old)
        and radius <= m.MAX_RADIUS
    ), "old places only"
    assert not m.candidates(8, est, travel, 100.0)[0], "nothing old yet"
    closure = lambda j, off=(0, 0, 0): (
        j,
        j + half + 2,
        m.between(true[j], true[j + half + 2]) + off,
        np.eye(3) * 1e-3,
        0.9,
    )
    good, outlier = [closure(j) for j in (3, 4, 5)], closure(4, (2.0, 0, 0))
    every = good + [outlier]
    assert all(m.is_consistent(one, every, est, travel) for one in good), "three that agree"
    assert not m.is_consistent(outlier, every, est, travel) and not m.is_consistent(
        good[0], good[:2], est, travel
    ), "an outlier, a lone pair"


def step7(m, rng):
    true, est, travel = loop(m)
    i, j = np.array([0, 3, 7]), np.array([1, 9, 2])
    z = m.between(true[i], true[j]) + 0.1
    e, J = m.residuals(est, i, j, z)
    for side, rows in ((0, i), (1, j)):
        for c in range(3):
            moved = est.copy()
            moved[rows, c] += 1e-6
            numeric = m.wrap(m.residuals(moved, i, j, z)[0] - e) / 1e-6
            assert np.allclose(numeric, J[:, :, 3 * side + c], atol=1e-4), (
                "derivatives as by differences"
            )
    turn = np.array([[0, 0, 0], [0, 0, 3.1]])
    e, _ = m.residuals(turn, np.array([0]), np.array([1]), np.array([[0, 0, -3.1]]))
    assert abs(e[0, 2]) < 0.1, "errors of the heading are wrapped"
    S = rng.normal(size=(3, 3, 3))
    covs = S @ np.swapaxes(S, 1, 2) + 0.1 * np.eye(3)
    two = np.array([[0, 0, 0], [1.0, 0.2, 0.3]])
    z2, C2 = np.array([[1.0, 0, 0], [1.4, 0.5, 0.1]]), covs[:2]
    out, chi2 = m.solve(two, [(0, 1), (0, 1)], z2, C2, np.zeros(2, bool))
    best = (
        np.linalg.inv(np.linalg.inv(C2).sum(0)) @ (np.linalg.inv(C2) @ z2[:, :, None]).sum(0)[:, 0]
    )
    assert np.allclose(out[1], best, atol=1e-3), (
        "two measurements are weighed by their covariances"
    )
    n = len(true)
    chain = [
        (m.between(est[k], est[k + 1]), np.diag([0.02, 0.02, 0.01]) ** 2) for k in range(n - 1)
    ]
    half = n // 2
    closures = [
        (k, k + half, m.between(true[k], true[k + half]), np.eye(3) * 1e-4, 0.9)
        for k in range(2, half, 2)
    ]
    out = m.optimize(est, chain, closures)
    assert np.allclose(out[0], est[0]), "the first pose is held"
    gap = m.between(out[2], out[2 + half]) - closures[0][2]
    assert (
        np.abs(gap).max() < 0.02
        and np.abs(out - true)[:, :2].max() < 0.5 * np.abs(est - true)[:, :2].max()
    ), "bent onto itself"
    outlier = (4, 4 + half, np.array([5.0, 1.0, 1.0]), np.eye(3) * 1e-4, 0.9)
    assert np.abs(m.optimize(est, chain, [*closures, outlier]) - out).max() < 0.05, (
        "an outlier is rejected"
    )
    assert np.allclose(m.optimize(est, chain, []), est, atol=1e-6), "a chain alone stays"


def step8(m, rng):
    angles = np.deg2rad(np.arange(-90, 91, 1.0))
    ranges = np.clip(2.0 / np.maximum(np.cos(angles), 1e-9), 0, 35)
    poses = np.array([[1.0, 0.5, 0.0]] * 3)
    ranges = np.tile(ranges, (3, 1))
    odds, low = m.occupancy(ranges, angles, poses, 0.1)
    at = lambda x, y: odds[int((y - low[1]) / 0.1), int((x - low[0]) / 0.1)]
    assert at(3.0, 0.55) > 0 or at(3.05, 0.55) > 0, "the wall 2 m ahead is occupied"
    assert at(2.0, 0.55) < 0 and at(3.15, 0.55) == 0 and at(4.0, 0.55) == 0, (
        "before it free, behind it unknown"
    )
    assert at(0.0, 0.55) == 0, "nothing behind the robot"
    often = m.occupancy(np.tile(ranges[:1], (30, 1)), angles, np.tile(poses[:1], (30, 1)), 0.1)[0]
    assert np.abs(often).max() <= 5, "evidence has a limit: a door that opens is seen in the end"
    none = m.occupancy(np.full_like(ranges, np.inf), angles, poses, 0.1)[0]
    assert none.max() <= 0, "beams that met nothing make no walls"
    odds, low = m.occupancy(np.array([[2.0]]), np.array([0.0]), np.array([[0, 0, np.pi / 2]]), 0.1)
    assert odds[int((2.0 - low[1]) / 0.1), int((0.0 - low[0]) / 0.1)] > 0, "rows are y"


STEPS = [step1, step2, step3, step4, step5, step6, step7, step8]


@pytest.mark.parametrize("step", STEPS)
def test_a_step_keeps_its_properties(step):
    step(OWN, np.random.default_rng(0))


# One piece of text replaced, and the step whose check must notice.
MISTAKES = {
    "compose turns the wrong way": (step1, "c * b[..., 0] - s * b[..., 1]", "c * b[..., 0] + s * b[..., 1]"),
    "between does not turn": (step1, "x, y = c * d[..., 0] + s * d[..., 1], c * d[..., 1] - s * d[..., 0]", "x, y = d[..., 0], d[..., 1]"),
    "cells by truncation": (step2, "np.floor(points / cell).astype(int), axis=0", "(points / cell).astype(int), axis=0"),
    "beams without an end kept": (step2, "(ranges > 0.05) & (ranges < MAX_RANGE)", "ranges > 0.05"),
    "tangents for normals": (step3, "vectors[:, :, 0], np.nan)", "vectors[:, :, 1], np.nan)"),
    "no prior": (step3, "/ NOISE**2 + prior\n", "/ NOISE**2 + 1e-9 * prior\n"),
    "no kernel": (step3, "(KERNEL_WIDTH**2 / (KERNEL_WIDTH**2 + e**2)) ** 2", "np.ones(len(e))"),
    "the heading adds nothing": (step4, "np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1.0]])", "np.eye(3)"),
    "no search": (step4, "if fit < 0.5:", "if fit < -1:"),
    "the second peak is the first": (step5, "* cell > SECOND_PEAK_DISTANCE", "* cell >= 0"),
    "no other closure is asked": (step6, "return agree >= MIN_CONSISTENT and 2 * agree >= near", "return True"),
    "young places": (step6, "travel[k] - MIN_LOOP)", "travel[k])"),
    "the heading's derivative": (step7, "J[:, 0, 2], J[:, 1, 2] = d[:, 1], -d[:, 0]", "J[:, 0, 2], J[:, 1, 2] = -d[:, 1], d[:, 0]"),
    "no wrap": (step7, "    e[:, 2] = wrap(e[:, 2])\n", ""),
    "closures without a kernel": (step7, "np.where(robust, width / (width + chi2), 1.0)", "np.ones(len(chi2))"),
    "evidence without a limit": (step8, "np.clip(odds[cells] + value, -5.0, 5.0)", "odds[cells] + value"),
    "rows are x": (step8, "return odds.reshape(shape).T, low", "return odds.reshape(shape), low"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_noticed(name):
    step, old, new = MISTAKES[name]
    with np.errstate(all="ignore"), pytest.raises((AssertionError, IndexError, ValueError)):
        step(loaded((old, new)), np.random.default_rng(0))


# Whole logs.


def driven(log, loops=True):
    """Poses, accepted closures, and how many of these are off by more than a metre or 15 degrees."""
    path, closures, steps = OWN.slam(
        log.ranges, log.scan.beam_angles, log.u, log.control_cov, loops
    )
    first = [
        next(k for k, (n, _) in enumerate(steps) if n == node) for node in range(steps[-1][0] + 1)
    ]
    off = [
        between(between(log.truth[first[j]], log.truth[first[k]]), z) for j, k, z, *_ in closures
    ]
    false = sum(np.hypot(*e[:2]) > 1.0 or abs(e[2]) > np.deg2rad(15) for e in off)
    return path, len(closures), false


def test_a_ring_of_corridors_closes():
    lidar = Lidar(180, max_range=8.0, sigma_range=0.01)
    log = ring_laps((20.0, 14.0), np.random.default_rng(1), lidar, laps=1.6)
    path, closures, false = driven(log)
    open_path, none, _ = driven(log, loops=False)
    assert (false, none) == (0, 0)
    assert closures >= 5
    assert ate(path, log.truth).rmse < 0.05
    assert ate(path, log.truth).rmse < ate(open_path, log.truth).rmse


@pytest.mark.parametrize("name", ["csail", "freiburg-101"])
def test_a_real_log_with_bad_odometry_closes(name):
    file = Path(os.environ.get("SLAMLAB_DATA", "")) / f"{name}-corrected.log.gz"
    if not file.is_file():
        pytest.skip(f"no {file.name} in SLAMLAB_DATA")
    log = drifted(read_carmen(file, corrected=True), np.random.default_rng(1))
    path, closures, false = driven(log)
    assert false == 0
    assert closures >= 20
    assert ate(path, log.truth).rmse < 0.15


@pytest.mark.slow
def test_killian_court_closes():
    """Its reference is the optimum of the file's own graph, no truth: 2 m, as for the library."""
    log = killian().log
    path, closures, _ = driven(log)
    assert closures > 100
    assert ate(path, log.truth).rmse < 2.0
