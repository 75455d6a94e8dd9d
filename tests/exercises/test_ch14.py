"""Right answers of chapter 14, written in other ways: each passes."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from slamlab.exercises import ch14_scan_matching_and_hector as ch
from slamlab.geometry import between, compose, rotation, transform


def row_by_differences(pose, point, normal):
    def error(motion):
        return normal @ transform(compose(pose, motion), point[None])[0]

    h = 1e-6
    return [(error(h * d) - error(-h * d)) / (2 * h) for d in np.eye(3)]


def row_in_the_world(pose, point, normal):
    R = rotation(pose[2])
    x, y = R @ point
    return np.append(normal @ R, normal[1] * x - normal[0] * y)


def shift_until_it_rests(gaps, width):
    shift, before = float(np.median(gaps)), np.inf
    while abs(shift - before) > 1e-9:
        e = gaps - shift
        shift, before = np.average(gaps, weights=(1 + (e / width) ** 2) ** -2.0), shift
    return shift


def follow_in_the_world(u, match, far, turn):
    """Another right answer: keep poses of the world only."""
    poses, key = [np.zeros(3)], 0
    for k, motion in enumerate(u, start=1):
        guess = between(poses[key], compose(poses[-1], motion))
        found = np.asarray(match(key, k, guess))
        poses.append(compose(poses[key], found))
        key = k if np.hypot(found[0], found[1]) > far or not -turn <= found[2] <= turn else key
    return poses


def bounds_by_padding(field, cells, n, width):
    field = np.pad(field, (0, n + width + int(cells.max())))
    tops = np.lib.stride_tricks.sliding_window_view(field, (width, width)).max((2, 3))
    first = np.arange(0, n, width)
    r, c = cells.T[:, :, None, None]
    return tops[r + first[:, None], c + first].mean(0)


def by_stacked_rows(reference, normals, points, guess, cov):
    """Another right answer: the wheels as three more rows of one least squares, and a tree."""
    pose, root = np.array(guess), np.linalg.inv(np.linalg.cholesky(cov))
    for _ in range(25):
        moved = transform(pose, points)
        gap, j = cKDTree(reference).query(moved)
        near = gap < 0.5
        n, arm = normals[j[near]], moved[near] - pose[:2]
        e = ((moved - reference[j])[near] * n).sum(1)
        J = np.column_stack([n, n[:, 1] * arm[:, 0] - n[:, 0] * arm[:, 1]])
        w = 0.1**2 / (0.1**2 + e**2) / 0.03
        A = np.vstack([w[:, None] * J, root])
        b = np.concatenate([w * e, root @ (pose - guess)])
        pose = pose - np.linalg.lstsq(A, b, rcond=None)[0]
    return pose


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_line_row, row_in_the_world),
        (ch.check_wall_shift, shift_until_it_rests),
        (ch.check_follow, follow_in_the_world),
        (ch.check_block_bounds, bounds_by_padding),
        (ch.check_icp, by_stacked_rows),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_a_row_by_differences_is_right_to_their_digits():
    for _, arguments in ch.check_line_row.inputs:
        np.testing.assert_allclose(
            row_by_differences(*arguments), ch.line_row(*arguments), atol=1e-8
        )


def test_a_matcher_goes_through_killian_court_within_a_metre_and_wheels_do_not():
    _, error = ch.court_path(by_stacked_rows, 2)
    _, wheels = ch.court_path(lambda reference, normals, points, guess, cov: guess, 2)
    assert error < 1.0 < 10.0 < wheels
