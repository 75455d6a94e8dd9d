"""Right answers of chapter 06, written in other ways: each passes."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from slamlab.exercises import ch06_lidar_simulation as ch
from slamlab.geometry import wrap_angle
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


def by_the_library(occupied, x, y, angle):
    return BitmapWorld(occupied, 1.0).cast([x, y], angle)


def by_all_crossings(occupied, x, y, angle):
    """Another right answer: sort all grid lines by distance, look just behind each."""
    d = np.array([np.cos(angle), np.sin(angle)])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.concatenate([(np.arange(12) - p) / q for p, q in zip((x, y), d, strict=True)])
    for s in [0.0, *np.sort(t[np.isfinite(t) & (t > 0)])]:
        column, row = np.floor(np.array([x, y]) + (s + 1e-9) * d).astype(int)
        if not (0 <= row < len(occupied) and 0 <= column < len(occupied[0])):
            return np.inf
        if occupied[row, column]:
            return float(s)
    return np.inf


def by_transform(pose, ranges, angles):
    with np.errstate(invalid="ignore"):
        local = ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    local[~np.isfinite(ranges)] = np.nan
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (local @ np.array([[c, s], [-s, c]]) + pose[:2]).tolist()


def wall_by_wall(segments, x, y, angle):
    """Another right answer: solve the two equations of each wall, one after the other."""
    found = [np.inf]
    for a, b in segments:
        M = np.array([[np.cos(angle), a[0] - b[0]], [np.sin(angle), a[1] - b[1]]])
        if np.linalg.det(M) != 0:
            t, s = np.linalg.solve(M, a - [x, y])
            found += [float(t)] * bool(t >= 0 and 0 <= s <= 1)
    return min(found)


def by_the_lidar(occupied, resolution, poses, n_beams, field_of_view, max_range):
    lidar = Lidar(int(n_beams), float(field_of_view), float(max_range))
    world = BitmapWorld(occupied, resolution)
    ranges = [lidar.scan(world, pose) for pose in poses]
    points = [lidar.points(scan, pose) for scan, pose in zip(ranges, poses, strict=True)]
    return np.reshape(ranges, (-1, n_beams)), np.reshape(points, (-1, n_beams, 2))


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_first_hit, by_the_library),
        (ch.check_first_hit, by_all_crossings),
        (ch.check_beam_angles, lambda n, view: Lidar(n, view).beam_angles),
        (
            ch.check_beam_angles,
            lambda *g: list(wrap_angle(ch.check_beam_angles.reference(*g))),
        ),
        (ch.check_scan_to_points, by_transform),
        (ch.check_nearest_wall, wall_by_wall),
        (ch.check_record, by_the_lidar),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def walk_of_the_chapter():
    """Return `cells_on_beam`, as chapter 06 has it on the page."""
    cells = json.loads((NOTEBOOKS / "06_lidar_simulation.ipynb").read_text("utf-8"))["cells"]
    source = next(s for c in cells if "def cells_on_beam" in (s := "".join(c["source"])))
    names = {"np": np}
    exec(source, names)
    return names["cells_on_beam"]


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.3])
def test_the_walk_on_the_page_ends_in_every_direction(angle):
    walk = walk_of_the_chapter()
    # The walk has no end of its own. One that divides by zero would stand at its first distance.
    walked = list(itertools.islice(walk(0.5, 0.5, angle), 20))
    found = list(itertools.takewhile(lambda cell: cell[2] < 5.0, walked))
    assert len(found) <= 8
    entered = np.array([t for _, _, t in found])
    assert (np.diff(entered) >= 0).all()
    way = np.array([0.5, 0.5]) + (entered[:, None] + 1e-9) * [np.cos(angle), np.sin(angle)]
    np.testing.assert_array_equal(np.array(found)[:, :2], np.floor(way))
