"""Right answers of chapter 06, written in other ways: each passes."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from slamlab.exercises import ch06_lidar_simulation as ch
from slamlab.geometry import compose, wrap_angle
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


def by_all_crossings(cells, x, y, angle):
    """Another right answer: sort all grid lines by distance, look on both sides of each."""
    d = np.array([np.cos(angle), np.sin(angle)])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = [(np.arange(12) - p) / q for p, q in zip((x, y), d, strict=True)]
    lines = [(0.0, 0.0)] + [(s, abs(q)) for ts, q in zip(t, d, strict=True) for s in ts if s > 0]
    before = 0
    for s, square in sorted(line for line in lines if np.isfinite(line[0])):
        column, row = np.floor(np.array([x, y]) + (s + 1e-9) * d).astype(int)
        if not (0 <= row < len(cells) and 0 <= column < len(cells[0])):
            return np.inf
        here = cells[row, column]
        if here == 1 or (here == 2 and before == 0 and square > np.cos(np.deg2rad(30))):
            return float(s)
        before = here
    return np.inf


def beam_after_beam(n, view, turned):
    """Another right answer: the mirror's clock, one beam after the other."""
    gaps = n if view >= 2 * np.pi else max(n - 1, 1)
    share = view / (2 * np.pi) / gaps
    return [beam + i * share * turned for i, beam in enumerate(Lidar(n, view).beam_angles)]


def by_transform(pose, mount, ranges, angles):
    pose = compose(pose, mount)
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
        if abs(np.linalg.det(M)) > 1e-12:
            t, s = np.linalg.solve(M, a - [x, y])
            found += [float(t)] * bool(t >= 0 and 0 <= s <= 1)
    return min(found)


def by_lists(cells, resolution, poses, mount, n_beams, field_of_view, max_range):
    """Another right answer: the lidar's poses first, all beams of a pose in one list."""
    lidar, ranges, points = Lidar(int(n_beams), float(field_of_view)), [], []
    for pose in compose(poses, mount):
        beams = pose[2] + lidar.beam_angles
        cast = [by_all_crossings(cells, *(pose[:2] / resolution), beam) for beam in beams]
        scan = resolution * np.array(cast)
        ranges.append(np.where(scan <= max_range, scan, np.inf))
        points.append(lidar.points(ranges[-1], pose))
    return np.reshape(ranges, (-1, n_beams)), np.reshape(points, (-1, n_beams, 2))


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_first_hit, by_all_crossings),
        (ch.check_beam_angles, beam_after_beam),
        (
            ch.check_beam_angles,
            lambda *g: list(wrap_angle(ch.check_beam_angles.reference(*g))),
        ),
        (ch.check_scan_to_points, by_transform),
        (ch.check_nearest_wall, wall_by_wall),
        (ch.check_record, by_lists),
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


def test_without_glass_the_beam_is_the_librarys():
    for name, (cells, x, y, angle) in ch.check_first_hit.inputs:
        walls = np.minimum(cells, 1)
        if name != "any grid, any beam" or not walls[int(y), int(x)]:
            cast = BitmapWorld(walls, 1.0).cast([x, y], angle)
            np.testing.assert_allclose(ch.first_hit(walls, x, y, angle), cast, rtol=0, atol=1e-9)
