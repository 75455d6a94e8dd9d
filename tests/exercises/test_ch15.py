"""Chapter 15: right answers that are written in other ways, and what the pictures show."""

import ast
import json
import re
from pathlib import Path

import numpy as np
import pytest

from slamlab.exercises import ch15_other_maps as ch15


def one_after_the_other(alphas, betas, alpha, beta):
    a, b = alpha.copy(), beta.copy()
    for their_a, their_b in zip(alphas, betas, strict=True):
        a, b = a + (their_a - alpha), b + (their_b - beta)
    return a, b


def cell_by_cell(ended, sent, stretch):
    rates, left = [], sent
    for n in ended:
        rates.append(-np.log((left - n) / left) if n < left else np.inf)
        left -= n
    chance, comes = np.zeros(len(ended)), 1.0
    for k in range(len(ended) - 1, -1, -1):
        free = np.exp(-rates[k] * stretch)
        chance[k], comes = comes * (1 - free), comes * free
    return chance


def without_a_loop(parents, leaves, chosen):
    copied = np.bincount(chosen)[chosen] > 1
    result = leaves[chosen]
    above = result[copied]
    result[copied] = len(parents) + np.arange(len(above))
    return np.append(parents, above), result


def with_logarithms(poses, moves, points, heights, robots, march, u, power):
    M, log_w, track, clouds = len(poses), np.zeros(len(poses)), [], []
    alpha, beta = march + (robots - march[:, None]).sum(axis=1)
    maps = np.tile(alpha.ravel(), (M, 1)), np.tile(beta.ravel(), (M, 1))
    for t in range(len(moves)):
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y, turn = moves[t].T
        poses = poses + np.stack([c * x - s * y, s * x + c * y, turn], axis=-1)
        c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
        px, py = points[t].T
        column = (poses[:, :1] + c * px - s * py) // 0.5
        row = (poses[:, 1:2] + s * px + c * py) // 0.5
        cells = (row * alpha.shape[1] + column).astype(int)
        with np.errstate(divide="ignore"):  # a weight may be 0
            log_w = log_w + power * np.log(ch15.weights(*maps, cells, heights[t], 1.0))
        w = np.exp(log_w - log_w.max())
        w = w / w.sum()
        track.append([w @ poses[:, 0], w @ poses[:, 1]])
        clouds.append(poses[:, :2])
        if np.sum(w**2) * M > 2.0:
            sums = np.cumsum(w)
            poses = poses[[int(np.argmax(sums > (k + u[t]) / M)) for k in range(M)]]
            log_w = np.zeros(M)
    return track, clouds


@pytest.mark.parametrize(
    ("check", "right"),
    [
        (ch15.check_merged, one_after_the_other),
        (ch15.check_from_behind, cell_by_cell),
        (ch15.check_branch, without_a_loop),
        (ch15.check_localize, with_logarithms),
    ],
)
def test_right_answers_that_are_written_in_other_ways_pass(check, right):
    report = check.judge(check.observe(right))
    assert report.passed, report


def errors(seed, *powers):
    """Mean error of the second half of a drive: with powers, and of the odometry."""
    given, truth, driven = ch15._field.__wrapped__(seed)
    ways = [ch15.localize(*given, power)[0] for power in powers] + [driven]
    return [np.hypot(*(way - truth)[len(truth) // 2 :].T).mean() for way in ways]


@pytest.mark.parametrize("seed", [1, 8, 25])
def test_the_robot_of_the_picture_finds_its_place(seed):
    found, odometry = errors(seed, 0.1)
    assert found < 0.1 < 0.2 <= odometry


def test_with_power_1_the_robot_of_the_picture_is_worse_off_than_its_odometry():
    found, sharp, odometry = errors(25, 0.1, 1.0)
    assert found < 0.1 < 0.6 < odometry < 0.8 < 1.2 < sharp


def test_the_thirty_drives_of_the_solution_are_those_of_the_picture():
    page = Path(__file__).parents[2] / "notebooks" / "solutions" / "15_other_maps.ipynb"
    codes = [cell["source"] for cell in json.loads(page.read_text())["cells"]]
    code = next("".join(one) for one in codes if "# stored: what the picture" in "".join(one))
    off = ast.literal_eval(re.search(r"off = (\{.*?\n\})", code, re.DOTALL)[1])
    for seed in (2, 21):
        mild, sharp, odometry = errors(seed, 0.1, 1.0)
        stored = [off[name][seed] for name in ("power 0.1", "power 1", "odometry")]
        np.testing.assert_allclose([mild, sharp, odometry], stored, atol=0.006)


def test_with_power_1_one_picture_leaves_few_particles():
    few, many = [], []
    for seed in range(12):
        (poses, _, points, heights, maps, march, *_), *_ = ch15._field.__wrapped__(seed)
        alpha, beta = (np.tile(one.ravel(), (30, 1)) for one in ch15.merged(*maps, *march))
        column, row = np.floor(ch15.transform(poses, points[0]) / 0.5).astype(int).T
        w = ch15.weights(alpha, beta, (row * 40 + column).T, heights[0], 1.0)
        for power, found in ((1.0, few), (0.1, many)):
            found.append(np.sum(w**power) ** 2 / np.sum(w ** (2 * power)))
    assert max(few) < 3 < min(many)


def test_weights_are_largest_at_the_true_place_of_the_picture():
    right = ch15.check_weights.draw(ch15.weights).axes[1]
    assert "heaviest at 0 cm" in right.get_title(loc="left")


FAULTS = {
    "expected two arrays": lambda p, l, c: p,
    "3 survivors, and 2 leaves": lambda p, l, c: (p, l[:2]),
    "had other parents": lambda p, l, c: (p[::-1], l),
    "no way leads from node 9": lambda p, l, c: (p, np.array([9, 9, 9])),
    "no way leads from node -1": lambda p, l, c: (p, np.array([-1, 1, 2])),
    "which read the nodes [2, 0], not [1, 0]": lambda p, l, c: (p, np.array([1, 3, 2])),
    "its node 2, survivor 2 reads": lambda p, l, c: (np.append(p, 2), np.array([2, 3, 4])),
    "fewer new nodes": lambda p, l, c: (np.append(p, l[c]), np.array([4, 5, 6])),
    "not in the order of the survivors": lambda p, l, c: (
        np.append(p, [2, 2]),
        np.array([5, 3, 4]),
    ),
}


@pytest.mark.parametrize("said", FAULTS)
def test_the_hunt_says_what_a_tree_does_and_not_what_it_should_be(said):
    tree = np.array([-1, 0, 0, 0]), np.array([3, 1, 2]), np.array([2, 0, 2])
    fault = ch15._grown(FAULTS[said], *tree)
    assert said in fault
    assert ch15._grown(ch15.branch, *tree) == ""
    right = [str(part.tolist()) for part in ch15.branch(*tree)]
    assert not any(part in fault.partition("got")[0] for part in right)
    report = ch15.check_branch.judge(ch15.check_branch.observe(FAULTS[said]))
    assert not report.passed
    assert "expected shape" not in report.text


def test_a_tree_of_an_hour_is_tidied_to_fewer_nodes_than_two_for_each_particle():
    parents, leaves, *_ = ch15._an_hour()
    assert len(parents) == 211
    assert ch15.survivors(parents, leaves).sum() == 30


def test_only_a_tidied_tree_is_smaller_than_sixteen_copied_maps():
    entries = ch15._an_hour()[2]
    title = ch15.check_survivors.draw(ch15.survivors).axes[1].get_title(loc="left")
    kept, total = map(int, re.search(r"(\d+) of (\d+) entries", title).groups())
    assert 2 * kept < 16 * len(set().union(*entries)) == 10_400 < total
