"""The map of an explorer: what is seen, where the unknown begins, where the body gets through."""

import numpy as np
import pytest
from scipy import ndimage

from slamlab.kernels import floor as loops
from slamlab.logs import ScanGeometry
from slamlab.navigation import exploration_grid
from slamlab.navigation.exploration_grid import FREE, OCCUPIED, UNKNOWN, ExplorationGrid, box_of
from slamlab.sensors import Lidar
from slamlab.worlds import BitmapWorld, free_poses, rooms

LIDAR = Lidar(120)
ROOM = rooms.thesis_room()
SPANS = loops._spans
# The compiled loop as it is written.
CELL_BY_CELL = getattr(loops.mark_free, "py_func", loops.mark_free)


def floor_of(text, resolution=0.1):
    """A floor drawn with '.' free, '#' occupied, '?' unknown; the first line is the top."""
    rows = text.split()[::-1]
    floor = ExplorationGrid([0, 0, len(rows[0]) * resolution, len(rows) * resolution], resolution)
    code = {".": FREE, "#": OCCUPIED, "?": UNKNOWN}
    floor.state[...] = [[code[c] for c in row] for row in rows]
    return floor


def test_free_cells_are_truly_free_and_the_rest_is_no_lie():
    floor = ExplorationGrid(ROOM.bounds)
    for pose in free_poses(ROOM, 12, np.random.default_rng(1), 0.25):
        floor.insert(pose, LIDAR.scan(ROOM, pose), LIDAR)
    free = ROOM.is_free(floor.centres())
    claimed = floor.state == FREE
    assert claimed.sum() > 0.85 * free.sum()
    assert (claimed & ~free).sum() < 0.002 * claimed.sum()
    walls = floor.centres()[floor.state == OCCUPIED]
    assert ROOM.clearance(walls).max() < 0.08


def test_without_the_shorter_of_two_beams_free_cells_would_lie_behind_edges():
    pose = np.array([2.0, 2.0, 0.3])
    floor = ExplorationGrid(ROOM.bounds)
    floor.insert(pose, LIDAR.scan(ROOM, pose), LIDAR)
    ranges = LIDAR.scan(ROOM, pose)
    longer = np.maximum(ranges, np.maximum(np.roll(ranges, 1), np.roll(ranges, -1)))
    bold = ExplorationGrid(ROOM.bounds)
    bold.insert(pose, longer, LIDAR)
    lies = [((f.state == FREE) & ~ROOM.is_free(f.centres())).sum() for f in (floor, bold)]
    assert lies[0] <= 2 < 20 < lies[1]


def everywhere(shape, *scan):
    """Spans that hold all cells."""
    return np.zeros(shape[0], int), np.full(shape[0], shape[1])


def too_narrow(shape, x, y, heading, angles, reach):
    """The wrong spans: two cells short of what the wedges reach."""
    left, right = SPANS(shape, x, y, heading, angles, reach)
    return left + 2, right - 2


def seen_by(spans, monkeypatch, seed):
    """State and doubts after scans of random beams among random walls, cell by cell in Python."""
    rng, floor = np.random.default_rng(seed), ExplorationGrid([0, 0, 2.5, 2], 0.1)
    if spans is not None:
        monkeypatch.setattr(exploration_grid, "mark_free", CELL_BY_CELL)
        monkeypatch.setattr(loops, "_spans", spans)
    for _ in range(8):
        n = int(rng.choice([1, 5, 30, 90]))
        # From inside the grid and from beyond its edges, near and far, beams lost and endless.
        pose = rng.uniform([-0.5, -0.5, -np.pi], [3.0, 2.5, np.pi])
        ranges = rng.uniform(0.0, rng.choice([0.6, 3.0]), n)
        ranges[rng.random(n) < 0.1], ranges[rng.random(n) < 0.1] = np.nan, np.inf
        beams = ScanGeometry(np.sort(rng.uniform(-np.pi, np.pi, n)), rng.choice([2.0, np.inf]))
        for scan in (ranges, ranges * 1.5, ranges * 2.0, ranges * 2.5):
            floor.insert(pose, scan, beams)
    monkeypatch.undo()
    return np.stack([floor.state, floor._passes])


def test_cells_that_no_wedge_can_reach_need_no_look(monkeypatch):
    wrong = 0
    for seed in range(12):
        seen = seen_by(None, monkeypatch, seed)
        np.testing.assert_array_equal(seen, seen_by(everywhere, monkeypatch, seed))
        wrong += (seen != seen_by(too_narrow, monkeypatch, seed)).sum()
    assert wrong > 50


def test_a_lost_beam_says_nothing_and_an_endless_one_frees():
    beams = ScanGeometry(np.deg2rad([-8.0, 0.0, 8.0]))
    pose = np.array([0.05, 0.55, 0.0])
    states = {}
    for name, middle in (("lost", np.nan), ("endless", np.inf), ("met", 1.0)):
        floor = ExplorationGrid([0, 0, 2, 1.1], 0.1)
        floor.insert(pose, [3.0, middle, 3.0], beams)
        states[name] = floor.state[5]
    assert not (states["lost"][1:] == FREE).any()
    assert (states["endless"][1:] == FREE).all()
    assert states["met"].tolist() == [FREE] * 10 + [OCCUPIED] + [UNKNOWN] * 9


def test_the_neighbours_of_one_lost_beam_speak_for_it():
    ranges = LIDAR.scan(ROOM, [2.0, 2.0, 0.0])
    seen = {}
    for name, scan in (("whole", ranges), ("lost", ranges.copy()), ("none", ranges * np.nan)):
        if name == "lost":
            scan[::7] = np.nan
        floor = ExplorationGrid(ROOM.bounds)
        floor.insert([2.0, 2.0, 0.0], scan, LIDAR)
        seen[name] = (floor.state == FREE).sum()
    assert 0.9 * seen["whole"] < seen["lost"] < seen["whole"]
    assert seen["none"] == 0


def test_beams_beyond_the_range_free_only_up_to_it():
    lidar = Lidar(120, max_range=1.0)
    floor = ExplorationGrid(ROOM.bounds)
    pose = np.array([0.9, 1.2, 0.0])
    floor.insert(pose, lidar.scan(ROOM, pose), lidar)
    far = np.hypot(*(floor.centres() - pose[:2]).transpose(2, 0, 1))
    assert far[floor.state == FREE].max() <= 1.0
    assert (floor.state[far < 0.8] == FREE).all()


def test_a_narrow_view_and_an_offset_are_understood():
    lidar = Lidar(61, field_of_view=np.pi / 2, offset=0.1)
    floor = ExplorationGrid(ROOM.bounds)
    pose = np.array([1.5, 1.0, np.pi / 2])
    floor.insert(pose, lidar.scan(ROOM, pose), lidar)
    free = floor.centres()[floor.state == FREE] - [1.5, 1.1]
    angle = np.arctan2(free[:, 1], free[:, 0])
    assert len(free) > 100
    assert (np.abs(angle - np.pi / 2) <= np.pi / 4 + 1e-9).all()


def test_a_wall_that_a_wrong_pose_put_into_a_doorway_is_looked_through_and_a_real_one_is_not():
    beams = ScanGeometry(np.deg2rad(np.arange(-30.0, 31.0)))
    floor = ExplorationGrid([0, 0, 3, 2], 0.05)
    wrong, right, pose = np.full(61, 1.0), np.full(61, 2.0), [0.2, 1.0, 0.0]
    wall = floor.cell([1.21, 1.0])
    floor.insert(pose, wrong, beams)
    for _ in range(2):
        floor.insert(pose, right, beams)
        assert floor.state[wall] == OCCUPIED, "twice might be noise"
    floor.insert(pose, right, beams)
    assert floor.state[wall] == FREE
    assert floor.state[floor.cell([2.21, 1.0])] == OCCUPIED
    # A post that every fourth scan meets stays.
    for k in range(12):
        floor.insert(pose, wrong if k % 3 == 0 else right, beams)
        assert floor.state[wall] == (FREE if k < 0 else OCCUPIED)


def test_a_sheet_that_may_grow_keeps_what_was_seen():
    pose = free_poses(ROOM, 1, np.random.default_rng(3), 0.4)[0]
    small = ExplorationGrid([*(pose[:2] - 0.1), *(pose[:2] + 0.1)], 0.05, grow=True)
    small.insert(pose, LIDAR.scan(ROOM, pose), LIDAR)
    # The same cells on a grid that was large enough from the start.
    low = np.rint((small.origin - ROOM.origin) / 0.05) * 0.05 + ROOM.origin
    large = ExplorationGrid(small.bounds, 0.05)
    large.insert(pose, LIDAR.scan(ROOM, pose), LIDAR)
    np.testing.assert_array_equal(small.state, large.state)
    assert np.abs(low - small.origin).max() <= 0.026
    left, right, bottom, top = small.extent
    assert left < 0 < 4 < right
    assert bottom < 0 < 4 < top
    before, blacklisted = small.state.copy(), small.blacklisted.copy()
    small.insert(pose, LIDAR.scan(ROOM, pose), LIDAR)
    np.testing.assert_array_equal(small.state, before)
    assert small.blacklisted.shape == blacklisted.shape == small.shape


def test_frontier_is_free_beside_unknown():
    floor = floor_of("???? .... ####")
    assert floor.frontier().astype(int).tolist() == [[0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 0, 0]]
    floor.blacklist_frontier([0.05, 0.15], 0.12)
    assert floor.frontier()[1].tolist() == [False, False, True, True]


def test_where_a_disc_fits_is_asked_anew_when_the_floor_has_changed():
    floor = floor_of("...... ...... ...... ......")
    wide, narrow = floor.traversable(0.1), floor.traversable(0.02)
    floor.state[1, 1] = OCCUPIED
    for before, radius in ((wide, 0.1), (narrow, 0.02)):
        fresh = floor_of("...... ...... .#.... ......").traversable(radius)
        np.testing.assert_array_equal(floor.traversable(radius), fresh)
        assert (fresh != before).any()
    floor.state = np.pad(floor.state, 2)
    assert floor.traversable(0.1).shape == (8, 10)


def test_where_a_disc_fits_does_not_hang_on_the_size_of_the_grid():
    rng = np.random.default_rng(2)
    wrong = 0
    for radius in (0.0, 0.06, 0.15, 0.3):
        small = ExplorationGrid([0, 0, 2, 1.5], 0.05)
        small.state[5:-5, 8:-3] = rng.choice(
            [FREE, OCCUPIED, UNKNOWN], (20, 29), p=[0.96, 0.02, 0.02]
        )
        large = ExplorationGrid([-1, -0.5, 4, 3], 0.05)
        large.state[10:40, 20:60] = small.state
        fits = large.traversable(radius)
        free = np.pad(large.state == FREE, 1)
        everywhere = ndimage.distance_transform_edt(free)[1:-1, 1:-1] * 0.05
        np.testing.assert_array_equal(fits, everywhere >= radius + 0.05 * np.sqrt(0.5))
        np.testing.assert_array_equal(fits[10:40, 20:60], small.traversable(radius))
        # A box without a rim would take the end of the floor for more floor.
        box = box_of(free)
        rimless = ndimage.distance_transform_edt(free[box]) * 0.05
        wrong += (
            (rimless >= radius + 0.05 * np.sqrt(0.5)) != fits[10:40, 20:60][5:-5, 8:-3]
        ).sum()
    assert wrong > 50
    assert not ExplorationGrid([0, 0, 1, 1]).traversable(0.1).any()


def test_way_avoids_what_the_disc_cannot_pass():
    room = "\n".join(["." * 20] * 6 + ["#" * 14 + "." * 6] + ["." * 20] * 6)
    floor = floor_of(room)
    thin, thick = (
        floor.plan([0.3, 0.3], [0.3, 1.0], 0.0),
        floor.plan([0.3, 0.3], [0.3, 1.0], 0.15),
    )
    assert thin is not None
    assert thick is not None
    assert thin[:, 0].max() > 1.4
    lengths = [
        np.hypot(*np.diff(np.vstack([[0.3, 0.3], way]), axis=0).T).sum() for way in (thin, thick)
    ]
    assert 2.3 < lengths[0] < lengths[1]
    assert floor.plan([0.3, 0.3], [0.3, 1.0], 0.4) is None


def test_way_lies_on_fitting_cells_and_distances_are_shortest():
    rng = np.random.default_rng(3)
    for _ in range(5):
        floor = ExplorationGrid([0, 0, 4, 3], 0.1)
        floor.state[...] = np.where(rng.random((30, 40)) < 0.15, OCCUPIED, FREE)
        floor.state[:3, :3] = FREE
        ways = floor.shortest_paths([0.15, 0.15], 0.0)
        lengths = ways.lengths
        reached = np.argwhere(np.isfinite(lengths))
        for row, column in reached[rng.integers(len(reached), size=6)]:
            goal = (int(row), int(column))
            way = ways.to(goal)
            legs = np.vstack([[0.15, 0.15], way])
            np.testing.assert_allclose(way[-1], floor.centres()[goal], atol=1e-12)
            assert np.hypot(*np.diff(legs, axis=0).T).sum() <= lengths[goal] + 0.15
            dense = np.concatenate(
                [
                    a + np.linspace(0, 1, 30)[:, None] * (b - a)
                    for a, b in zip(legs, legs[1:], strict=False)
                ]
            )
            assert all(floor.state[floor.cell(p)] == FREE for p in dense)


def test_distances_agree_with_dijkstra_of_scipy():
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    rng = np.random.default_rng(4)
    floor = ExplorationGrid([0, 0, 2.0, 1.5], 0.1)
    floor.state[...] = np.where(rng.random((15, 20)) < 0.25, UNKNOWN, FREE)
    floor.state[7, 10] = FREE
    fits = floor.traversable(0.0)
    edges = []
    for r, c in np.argwhere(fits):
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            i, j = r + dr, c + dc
            if 0 <= i < 15 and 0 <= j < 20 and fits[i, j] and fits[r, j] and fits[i, c]:
                edges.append((r * 20 + c, i * 20 + j, np.hypot(dr, dc)))
    a, b, w = np.array(edges).T
    graph = coo_array((w, (a.astype(int), b.astype(int))), shape=(300, 300))
    due = dijkstra(graph, directed=False, indices=7 * 20 + 10).reshape(15, 20) * 0.1
    lengths = floor.shortest_paths([1.05, 0.75], 0.0).lengths
    np.testing.assert_allclose(lengths[fits], due[fits], atol=1e-9)


def test_where_the_body_fits_follows_the_floor_and_the_radius():
    floor = floor_of("\n".join(["." * 12] * 12))
    wide, narrow = floor.traversable(0.3).sum(), floor.traversable(0.1).sum()
    assert 0 < wide < narrow
    floor.state[6, 6] = OCCUPIED
    assert floor.traversable(0.1).sum() < narrow


def test_unseen_area_stops_at_walls_and_counts_the_unknown():
    open_floor, walled = floor_of("\n".join(["?" * 21] * 21)), floor_of("\n".join(["?" * 21] * 21))
    walled.state[:, 12] = OCCUPIED
    centre = [[1.05, 1.05]]
    disc = open_floor.expected_gain(centre, 0.9, n_rays=360)[0]
    assert disc == pytest.approx(np.pi * 0.81, rel=0.03)
    assert 0.5 * disc < walled.expected_gain(centre, 0.9, n_rays=360)[0] < 0.75 * disc
    open_floor.state[...] = FREE
    assert open_floor.expected_gain(centre, 0.9)[0] == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ExplorationGrid([0, 0, 0, 1]), "bounds"),
        (lambda: ExplorationGrid([0, 0, 1, 1], 0.0), "resolution"),
        (lambda: ExplorationGrid([0, 0, 1, 1]).insert([0, 0], [1.0], ScanGeometry([0.0])), "pose"),
        (
            lambda: ExplorationGrid([0, 0, 1, 1]).insert([0, 0, 0], [1, 2], ScanGeometry([0.0])),
            "ranges",
        ),
        (
            lambda: ExplorationGrid([0, 0, 1, 1]).insert([0, 0, 0], [-1], ScanGeometry([0.0])),
            "distances",
        ),
        (lambda: ExplorationGrid([0, 0, 1, 1]).plan([0, 0], [0], 0.1), "goal"),
        (lambda: ExplorationGrid([0, 0, 1, 1]).shortest_paths([0, 0], -0.1), "radius"),
        (lambda: ExplorationGrid([0, 0, 1, 1]).expected_gain([0, 0], 1.0), "points"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_nothing_seen_leads_nowhere():
    floor = ExplorationGrid([0, 0, 1, 1])
    assert floor.plan([0.5, 0.5], [0.2, 0.2], 0.1) is None
    assert not floor.frontier().any()
    world = BitmapWorld(np.zeros((10, 10)), 0.1)
    floor.insert([0.5, 0.5, 0.0], LIDAR.scan(world, [0.5, 0.5, 0.0]), LIDAR)
    assert (floor.state == FREE).all(), "without walls the whole grid is open"
