"""Correlative search: branch and bound gives what trying everything gives."""

import os
import subprocess
import sys

import numpy as np
import pytest

from slamlab.geometry import compose, rotation
from slamlab.matching import LikelihoodGrid, match_correlative, voxel_downsample
from slamlab.sensors import Lidar
from slamlab.worlds import rooms


def all_scores(field, points, guess, reach, angles):
    """Score of every pose, one by one: (angles, rows, columns)."""
    values = np.rint(255.0 * field.values).astype(int)
    values = np.pad(values, 1)  # beyond the grid there is nothing
    shifts = np.arange(-reach, reach + 1)
    out = np.zeros((len(angles), len(shifts), len(shifts)), int)
    for n, angle in enumerate(angles):
        turned = points @ rotation(angle).T + guess[:2]
        cell = np.floor((turned - field.origin) / field.resolution).astype(int) + 1
        for i, dr in enumerate(shifts):
            r = np.clip(cell[:, 1] + dr, 0, values.shape[0] - 1)
            for j, dc in enumerate(shifts):
                c = np.clip(cell[:, 0] + dc, 0, values.shape[1] - 1)
                out[n, i, j] = values[r, c].sum()
    return out / (255 * len(points))


@pytest.mark.parametrize("seed", range(100))
def test_branch_and_bound_is_exactly_brute_force(seed):
    rng = np.random.default_rng(seed)
    field = LikelihoodGrid.of_points(rng.uniform(-1, 1, (12, 2)), sigma=0.15, resolution=0.1)
    points = rng.uniform(-1, 1, (9, 2))
    guess = rng.uniform(-1, 1, 3) * [0.5, 0.5, 3.0]
    reach, side, step = int(rng.integers(0, 13)), int(rng.integers(0, 4)), 0.07
    angles = guess[2] + step * np.arange(-side, side + 1)
    scores = all_scores(field, points, guess, reach, angles)
    found = match_correlative(field, points, guess, 0.1 * reach, side * step, step, 0.0, 0.35)
    if scores.max() == 0:
        assert found is None
        return
    assert found.score == scores.max()
    dc, dr = np.rint((found.pose[:2] - guess[:2]) / 0.1).astype(int)
    a = np.argmin(np.abs(np.angle(np.exp(1j * (angles - found.pose[2])))))
    assert scores[a, dr + reach, dc + reach] == found.score
    # The rival: the best score farther than 0.35 m from the winner, if it reaches half of it.
    shifts = np.arange(-reach, reach + 1)
    far = np.hypot(shifts[:, None] - dr, shifts - dc) > 3.5
    second = scores[:, far].max(initial=0.0)
    half = np.floor(found.score * 255 * 9 / 2) / (255 * 9)
    assert found.second_peak == pytest.approx(second / found.score if second > half else 0.0)


def test_a_lost_robot_is_found_again():
    lidar = Lidar(180, max_range=20.0, sigma_range=0.01)
    rng = np.random.default_rng(0)
    pose, motion = np.array([2.0, 4.0, 0.3]), np.array([1.3, 0.05, 0.5])
    a = lidar.points(lidar.scan(rooms.office(), pose, rng))
    b = lidar.points(lidar.scan(rooms.office(), compose(pose, motion), rng))
    match = match_correlative(
        LikelihoodGrid.of_points(a),
        voxel_downsample(b),
        np.zeros(3),
        2.0,
        0.8,
        second_peak_distance=0.8,
    )
    assert np.hypot(*(match.pose - motion)[:2]) < 0.1
    assert abs(match.pose[2] - motion[2]) < 0.02
    assert match.second_peak < 0.85


def test_a_corridor_has_rivals_and_a_room_has_not():
    lidar = Lidar(180, max_range=4.0, sigma_range=0.01)
    rng = np.random.default_rng(0)
    along = lidar.points(lidar.scan(rooms.corridor(), [6.0, 1.0, 0.0], rng))
    inside = lidar.points(lidar.scan(rooms.office(), [2.0, 1.8, 0.0], rng))
    rivals = [
        match_correlative(
            LikelihoodGrid.of_points(p), p, np.zeros(3), 2.0, 0.1, second_peak_distance=0.8
        ).second_peak
        for p in (along, inside)
    ]
    assert rivals[0] > 0.75
    assert rivals[1] < 0.65


def test_nothing_is_found_below_the_least_score():
    field = LikelihoodGrid.of_points([[0.0, 0.0]])
    points = [[0.0, 0.0], [50.0, 0.0]]
    assert match_correlative(field, points, np.zeros(3), 0.5, 0.1, min_score=0.6) is None
    assert match_correlative(field, points, np.zeros(3), 0.5, 0.1, min_score=0.4).score > 0.4


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f, p: match_correlative(None, p, np.zeros(3), 1.0, 0.1), "field"),
        (
            lambda f, p: match_correlative(f, np.full((2, 2), np.nan), np.zeros(3), 1, 0.1),
            "points",
        ),
        (lambda f, p: match_correlative(f, p, [0, 0], 1.0, 0.1), "guess"),
        (lambda f, p: match_correlative(f, p, np.zeros(3), -1.0, 0.1), "window"),
        (lambda f, p: match_correlative(f, p, np.zeros(3), 1.0, 4.0), "angle_window"),
        (lambda f, p: match_correlative(f, p, np.zeros(3), 1.0, 0.1, 0.0), "angle_step"),
        (lambda f, p: match_correlative(f, p, np.zeros(3), 1, 0.1, min_score=2), "min_score"),
        (
            lambda f, p: match_correlative(f, p, np.zeros(3), 1, 0.1, second_peak_distance=-1),
            "second_peak",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(LikelihoodGrid.of_points([[0.0, 0.0]]), np.zeros((3, 2)))


def test_the_search_gives_the_same_pose_compiled_or_not():
    code = (
        "import numpy as np\n"
        "from slamlab.matching import LikelihoodGrid, match_correlative\n"
        "angle = np.linspace(0.0, 5.0, 60)\n"
        "wall = (3.0 + np.sin(3 * angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)\n"
        "field = LikelihoodGrid.of_points(wall, 0.1, 0.1)\n"
        "best = match_correlative(field, wall, [0.25, -0.1, 0.0], 0.4, 0.1)\n"
        "print(best.pose.tolist(), float(best.score))\n"
    )
    answers = [
        subprocess.run(
            [sys.executable, "-W", "error::RuntimeWarning", "-c", code],
            env=os.environ | {"NUMBA_DISABLE_JIT": off},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for off in ("0", "1")
    ]
    assert answers[0] == answers[1]  # sums of bytes, uncompiled, began anew at 256
    assert float(answers[0].split()[-1]) > 0.8
