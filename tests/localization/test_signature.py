"""Signature maps: the right place in a room without symmetry, a raised flag in one with it."""

import pickle
import sys

import numpy as np
import pytest

from slamlab.geometry import wrap_angle
from slamlab.localization.signature import (
    SEPARATION,
    SIGNATURES,
    SignatureMap,
    spectrum,
    three_numbers,
)
from slamlab.sensors.lidar import Lidar
from slamlab.worlds import BitmapWorld, WallWorld, free_poses, rooms

LIDAR = Lidar(120)
STEP = 2 * np.pi / 120
ROOM = rooms.thesis_room()
HALF_SIDE = 0.15


@pytest.fixture(scope="module")
def atlas():
    return SignatureMap.build(ROOM, LIDAR, stride=2)


@pytest.fixture(scope="module")
def queries():
    """True poses anywhere in the room, off the grid, with any heading."""
    return free_poses(ROOM, 300, np.random.default_rng(1), HALF_SIDE)


def gap(found, poses):
    return np.linalg.norm(found.pose[..., :2] - poses[..., :2], axis=-1)


def turn(found, poses):
    return np.abs(wrap_angle(found.pose[..., 2] - poses[..., 2]))


# Building.


def test_a_map_holds_the_scan_of_every_free_place(atlas):
    centres = ROOM.centres(2)
    assert len(atlas) == ROOM.is_free(centres).sum()
    rows = np.random.default_rng(2).integers(0, len(atlas), 50)
    poses = np.column_stack([atlas.places[rows], np.zeros(50)])
    np.testing.assert_allclose(atlas.scans[rows], LIDAR.scan(ROOM, poses), atol=1e-6)
    assert (atlas.pitch, atlas.n_beams) == (0.02, 120)


def test_the_stride_thins_rows_and_columns():
    assert len(SignatureMap.build(ROOM, LIDAR, stride=8)) == pytest.approx(34778 / 16, rel=0.02)


def test_a_world_of_walls_is_scanned_on_a_grid_of_the_given_resolution():
    world = WallWorld.from_polygons([[0, 0], [4, 0], [4, 3], [0, 3]], [[1, 1], [2, 1], [2, 1.5]])
    atlas = SignatureMap.build(world, Lidar(90), stride=2, resolution=0.05)
    assert atlas.pitch == pytest.approx(0.1)
    poses = free_poses(world, 20, np.random.default_rng(3), 0.1)
    found = atlas.locate(Lidar(90).scan(world, poses))
    assert gap(found, poses).max() < 0.1
    with pytest.raises(ValueError, match="resolution: expected the side of a cell"):
        SignatureMap.build(world, Lidar(90))
    with pytest.raises(ValueError, match="resolution: expected None, a bitmap has its own"):
        SignatureMap.build(ROOM, LIDAR, resolution=0.01)


def test_noise_of_the_lidar_does_not_enter_the_map():
    noisy = Lidar(120, sigma_range=0.1, p_miss=0.3)
    quiet, other = (SignatureMap.build(ROOM, lidar, 40) for lidar in (LIDAR, noisy))
    np.testing.assert_array_equal(quiet.scans, other.scans)


@pytest.mark.parametrize("lidar", [Lidar(120, field_of_view=np.pi), Lidar(2), Lidar(1)])
def test_a_lidar_without_full_circle_is_refused(lidar):
    with pytest.raises(ValueError, match="lidar: expected three or more beams over the full"):
        SignatureMap.build(ROOM, lidar)


def test_a_world_without_free_cell_is_refused():
    with pytest.raises(ValueError, match="no cell is free"):
        SignatureMap.build(BitmapWorld(np.ones((4, 4)), 0.1), LIDAR)


@pytest.mark.parametrize("stride", [0, -1, 1.5])
def test_a_stride_that_is_no_count_is_refused(stride):
    with pytest.raises(ValueError, match="stride"):
        SignatureMap.build(ROOM, LIDAR, stride=stride)


def test_a_progress_bar_is_shown_or_its_package_named(monkeypatch, capsys):
    class Tqdm:
        @staticmethod
        def tqdm(parts, total, unit):
            print(f"{total} {unit}s, {sum(len(p) for p in parts)} directions")
            return parts

    monkeypatch.setitem(sys.modules, "tqdm", Tqdm)
    SignatureMap.build(ROOM, LIDAR, 100, progress=True)
    assert capsys.readouterr().out == "16 parts, 120 directions\n"
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with pytest.raises(ImportError, match="tqdm is needed for a progress bar: pip install"):
        SignatureMap.build(ROOM, LIDAR, 100, progress=True)


# Locating.


def test_place_and_heading_are_found_from_one_scan(atlas, queries):
    found = atlas.locate(LIDAR.scan(ROOM, queries))
    assert (gap(found, queries) > 0.1).mean() < 0.02
    assert np.median(gap(found, queries)) < atlas.pitch
    assert np.rad2deg(np.median(turn(found, queries))) < 0.25  # a twelfth of a beam
    assert np.rad2deg(np.quantile(turn(found, queries), 0.95)) < 1.0


def test_on_a_place_of_the_map_with_a_heading_of_the_lattice_the_fit_is_exact(atlas):
    rows, beams = np.array([100, 20_000]), np.array([7, 77])
    poses = np.column_stack([atlas.places[rows], wrap_angle(beams * STEP)])
    found = atlas.locate(LIDAR.scan(ROOM, poses))
    np.testing.assert_allclose(found.pose, poses, atol=1e-5)
    assert found.residual.max() < 1e-6
    assert not found.ambiguous.any()


def errors(tree_of, queries, scans):
    """Share of queries that the nearest signature puts more than 10 pixels away."""
    rows = tree_of.tree.query(SIGNATURES[tree_of.signature](scans))[1]
    return (np.linalg.norm(tree_of.places[rows] - queries[:, :2], axis=1) > 0.1).mean()


def test_full_signatures_find_what_three_numbers_do_not(atlas, queries):
    scans = LIDAR.scan(ROOM, queries)
    share = {name: errors(atlas.with_signature(name), queries, scans) for name in SIGNATURES}
    assert share["spectrum"] < 0.02
    assert share["autocorrelation"] < 0.04
    for name in ("printed", "modular", "three numbers"):
        assert share[name] > 0.1


@pytest.mark.parametrize("signature", SIGNATURES)
def test_every_signature_can_carry_a_map(atlas, queries, signature):
    other = atlas.with_signature(signature)
    assert other.signature in repr(other)
    found = other.locate(LIDAR.scan(ROOM, queries[:5]), n_candidates=192)
    assert found.pose.shape == (5, 3)


def test_one_candidate_trusts_the_signature_alone(atlas, queries):
    scans = LIDAR.scan(ROOM, queries[:50])
    found = atlas.locate(scans, n_candidates=1)
    nearest = atlas.tree.query(spectrum(scans, 16))[1]
    np.testing.assert_array_equal(found.pose[:, :2], atlas.places[nearest])
    assert (found.residual >= atlas.locate(scans).residual).all()


def test_leading_axes_are_batches(atlas, queries):
    scans = LIDAR.scan(ROOM, queries[:6]).reshape(2, 3, 120)
    found = atlas.locate(scans)
    assert found.pose.shape == found.second_pose.shape == (2, 3, 3)
    assert found.residual.shape == found.margin.shape == found.ambiguous.shape == (2, 3)
    one = atlas.locate(scans[1, 2])
    assert one.pose.shape == (3,)
    assert one.margin.shape == ()
    np.testing.assert_allclose(one.pose, found.pose[1, 2], atol=1e-12)
    assert atlas.locate(scans[:0]).pose.shape == (0, 3, 3)


def test_a_lidar_ahead_of_the_centre_still_gives_the_pose_of_the_body():
    lidar = Lidar(120, offset=0.1)
    atlas = SignatureMap.build(ROOM, lidar, stride=4)
    poses = free_poses(ROOM, 40, np.random.default_rng(5), 0.3)
    scans = lidar.scan(ROOM, poses)
    assert np.median(gap(atlas.locate(scans), poses)) < 0.04
    ignored = SignatureMap(atlas.places, atlas.scans, atlas.pitch, atlas.reach)
    assert np.median(gap(ignored.locate(scans), poses)) > 0.08


# Ambiguity.


def test_in_a_symmetric_room_the_flag_is_raised():
    room = rooms.symmetric_room()
    poses = free_poses(room, 300, np.random.default_rng(1), HALF_SIDE)
    found = SignatureMap.build(room, LIDAR, stride=2).locate(LIDAR.scan(room, poses))
    assert found.ambiguous.mean() >= 0.99
    # The second pose is the twin: half a turn around the middle of the room.
    wrong = gap(found, poses) > 0.1
    assert 0.3 < wrong.mean() < 0.7
    second = found.second_pose[wrong]
    close = np.linalg.norm(second[:, :2] - poses[wrong, :2], axis=1) < 0.1
    assert close.mean() > 0.97


def test_in_a_room_without_symmetry_the_flag_is_rarely_raised(atlas, queries):
    found = atlas.locate(LIDAR.scan(ROOM, queries))
    assert found.ambiguous.mean() < 0.05
    wrong = gap(found, queries) > 0.1
    assert not (wrong & ~found.ambiguous).any()


def test_second_pose_is_distinct_and_fits_no_better(atlas, queries):
    found = atlas.locate(LIDAR.scan(ROOM, queries))
    far = gap(found, found.second_pose) > SEPARATION * atlas.pitch
    assert (far | (turn(found, found.second_pose) > np.deg2rad(29))).all()
    assert (found.margin >= 0).all()
    np.testing.assert_array_equal(found.ambiguous, found.margin < atlas.pitch)


def test_in_the_middle_of_a_square_the_heading_is_ambiguous():
    cells = np.ones((81, 81))
    cells[2:-2, 2:-2] = 0
    atlas = SignatureMap.build(BitmapWorld(cells, 0.05), LIDAR, stride=1)
    middle = atlas.places[len(atlas) // 2]
    found = atlas.locate(LIDAR.scan(BitmapWorld(cells, 0.05), [*middle, 0.0]))
    assert found.ambiguous
    assert np.linalg.norm(found.second_pose[:2] - middle) < 0.1
    turned = abs(wrap_angle(found.second_pose[2] - found.pose[2]))
    assert np.cos(4 * turned) == pytest.approx(1, abs=1e-6)  # a quarter turn, or a half


def test_a_mirrored_room_fits_badly_though_its_signatures_agree(atlas, queries):
    mirrored = rooms.mirrored_pair()[1]
    there = queries * [-1, 1, -1] + [ROOM.bounds[2], 0, np.pi]
    scans, here = LIDAR.scan(mirrored, there), LIDAR.scan(ROOM, queries)
    distance = atlas.tree.query(spectrum(scans, 16))[0]
    np.testing.assert_allclose(distance, atlas.tree.query(spectrum(here, 16))[0], atol=1e-6)
    residual = atlas.locate(here).residual
    assert np.median(atlas.locate(scans).residual) > 2 * np.quantile(residual, 0.99)


# Noise, missed returns, beams that met nothing.


def test_noise_and_missed_returns_are_borne(atlas, queries):
    lidar = Lidar(120, sigma_range=0.01, p_miss=0.2)
    found = atlas.locate(lidar.scan(ROOM, queries, np.random.default_rng(6)))
    assert (gap(found, queries) > 0.1).mean() < 0.02


def test_a_missed_return_has_no_vote(atlas):
    pose = np.array([*atlas.places[20_000], 3 * STEP])
    scan = LIDAR.scan(ROOM, pose)
    holes = scan.copy()
    holes[[4, 5, 60, 100]] = np.nan
    found = atlas.locate(holes)
    np.testing.assert_allclose(found.pose[:2], pose[:2], atol=1e-6)
    assert found.pose[2] == pytest.approx(pose[2], abs=0.1 * STEP)
    assert found.residual < 0.002
    # Wrong rules: zero, or the whole reach, for what was not seen. The fit suffers.
    for filled in (np.nan_to_num(holes), np.where(np.isnan(holes), atlas.reach, holes)):
        assert atlas.locate(filled).residual > 2 * found.residual


def test_missed_beams_left_out_of_the_list_are_refused(atlas):
    # P5's scan appends nothing for a lost beam, so that all later indices shift.
    scan = LIDAR.scan(ROOM, [2.0, 2.0, 0.0])
    with pytest.raises(ValueError, match=r"scan: expected shape \(..., 120\), got \(119,\)"):
        atlas.locate(np.delete(scan, 5))


def test_a_beam_that_met_nothing_counts_as_the_reach(queries):
    lidar = Lidar(120, max_range=1.2)
    atlas = SignatureMap.build(ROOM, lidar, stride=2)
    assert atlas.reach == 1.2
    assert atlas.scans.max() == np.float32(1.2)
    scans = lidar.scan(ROOM, queries)
    assert np.isinf(scans).any()
    found = atlas.locate(scans)
    beyond = atlas.locate(np.where(np.isinf(scans), 1.2, scans))
    np.testing.assert_array_equal(found.pose, beyond.pose)
    # That it is free so far is knowledge: as good as missed, the places are found less often.
    ignorant = atlas.locate(np.where(np.isinf(scans), np.nan, scans))
    assert (gap(found, queries) > 0.1).mean() < 0.05
    assert (gap(ignorant, queries) > 0.1).mean() > 1.5 * (gap(found, queries) > 0.1).mean()


def test_without_max_range_the_diagonal_of_the_world_is_the_reach():
    open_hall = BitmapWorld(np.pad(np.zeros((28, 38)), ((2, 0), (2, 0)), constant_values=1), 0.1)
    atlas = SignatureMap.build(open_hall, LIDAR)
    assert atlas.reach == pytest.approx(5.0)
    assert atlas.scans.max() == np.float32(5.0)


@pytest.mark.parametrize(
    ("scan", "message"),
    [
        (np.ones(119), r"scan: expected shape \(..., 120\)"),
        (np.full(120, -1.0), "scan: expected distances, got -1"),
        (np.full(120, np.nan), "scan: expected at least three returns, scan 0 has 0"),
        ("here", "scan: expected an array of numbers"),
    ],
)
def test_a_scan_that_tells_nothing_is_refused(atlas, scan, message):
    with pytest.raises(ValueError, match=message):
        atlas.locate(scan)


def test_no_candidate_is_refused(atlas):
    with pytest.raises(ValueError, match="n_candidates: expected at least 1"):
        atlas.locate(np.ones(120), n_candidates=0)


# Files.


@pytest.fixture
def small():
    return SignatureMap.build(ROOM, Lidar(36, max_range=2.0, offset=0.05), stride=40)


def test_a_saved_map_comes_back(small, tmp_path):
    path = tmp_path / "room.map"
    small.save(path)
    back = SignatureMap.load(path)
    np.testing.assert_array_equal(back.scans, small.scans)
    np.testing.assert_array_equal(back.places, small.places)
    assert (back.pitch, back.reach, back.offset) == (small.pitch, small.reach, small.offset)
    assert repr(back) == repr(small)
    with np.load(path, allow_pickle=False) as file:  # no pickle is needed for any part
        assert all(file[name].dtype != object for name in file.files)


def saved_with(path, small, **changes):
    parts = {
        "format": np.array("slamlab signature map 1"),
        "places": small.places,
        "scans": small.scans,
        "numbers": np.array([small.pitch, small.reach, small.offset]),
        "signature": np.array("spectrum"),
    } | changes
    with open(path, "wb") as file:
        np.savez(file, **{name: part for name, part in parts.items() if part is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scans": None}, "'scans' is missing"),
        ({"format": np.array("slamlab signature map 0")}, "format: expected 'slamlab signature"),
        ({"signature": np.array("smell")}, "signature: expected one of"),
        ({"numbers": np.ones(2)}, r"numbers: expected shape \(3\), got \(2,\)"),
        ({"numbers": np.array([0.0, 1.0, 0.0])}, "pitch: expected a positive number"),
        ({"numbers": np.array([0.1, np.nan, 0.0])}, "numbers: expected finite numbers"),
        ({"scans": np.ones((3, 36))}, "scans: expected shape"),
        ({"scans": np.array(["a"])}, "scans: expected an array of numbers"),
        ({"places": np.array([{}])}, "Object arrays cannot be loaded"),
        ({"places": np.ones((0, 2))}, "places: expected at least one"),
    ],
)
def test_a_file_with_a_wrong_part_is_named(small, tmp_path, changes, message):
    path = tmp_path / "broken.npz"
    saved_with(path, small)
    assert len(SignatureMap.load(path)) == len(small)
    saved_with(path, small, **changes)
    with pytest.raises(ValueError, match=message) as error:
        SignatureMap.load(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("cut", [0, 1, 100, 1000, -1, -30])
def test_a_truncated_file_is_named(small, tmp_path, cut):
    path = tmp_path / "cut.npz"
    small.save(path)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(ValueError, match="cut.npz: expected a signature map"):
        SignatureMap.load(path)


def test_damaged_bytes_are_noticed(small, tmp_path):
    path = tmp_path / "damaged.npz"
    small.save(path)
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 8] = bytes(b ^ 0xFF for b in content[middle : middle + 8])
    path.write_bytes(content)
    with pytest.raises(ValueError, match="damaged.npz: expected a signature map"):
        SignatureMap.load(path)


@pytest.mark.parametrize("kind", ["text", "pickle", "npy"])
def test_another_kind_of_file_is_named(tmp_path, kind):
    path = tmp_path / "other.npz"
    if kind == "npy":
        with open(path, "wb") as file:
            np.save(file, np.ones(3))
    else:
        path.write_bytes(b"a map" if kind == "text" else pickle.dumps({"places": 1}))
    with pytest.raises(ValueError, match="other.npz: expected a signature map"):
        SignatureMap.load(path)


def test_a_missing_file_is_a_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError):
        SignatureMap.load(tmp_path / "nowhere.npz")


# Doors.


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((2, 3)), np.ones((2, 4)), 0.1, 1.0), "places: expected shape"),
        ((np.ones((2, 2)), np.ones((3, 4)), 0.1, 1.0), "scans: expected shape"),
        ((np.ones((2, 2)), np.ones((2, 2)), 0.1, 1.0), "scans: expected at least three beams"),
        ((np.ones((2, 2)), np.ones((2, 4)), 0.0, 1.0), "pitch"),
        ((np.ones((2, 2)), np.ones((2, 4)), 0.1, np.inf), "reach"),
        ((np.ones((2, 2)), np.full((2, 4), np.nan), 0.1, 1.0), "scans: expected no missed"),
        ((np.ones((2, 2)), -np.ones((2, 4)), 0.1, 1.0), "scans: expected distances"),
    ],
)
def test_a_map_refuses_parts_that_do_not_fit(arguments, message):
    with pytest.raises(ValueError, match=message):
        SignatureMap(*arguments)


def test_a_map_of_one_place_answers_with_another_heading():
    atlas = SignatureMap([[1.0, 1.0]], [[1.0, 2.0, 3.0, 4.0]], 0.1, 9.0)
    found = atlas.locate([2.0, 3.0, 4.0, 1.0])
    np.testing.assert_allclose(found.pose, [1, 1, np.pi / 2], atol=1e-9)
    assert found.second_pose[2] != pytest.approx(np.pi / 2, abs=0.5)


@pytest.mark.parametrize("form", ["raw", "", None])
def test_an_unknown_form_of_three_numbers_is_refused(form):
    with pytest.raises(ValueError, match="form: expected one of"):
        three_numbers(np.ones(4), form)


def test_signatures_refuse_scans_that_are_not_whole():
    for function in (spectrum, three_numbers):
        with pytest.raises(ValueError, match="expected finite numbers"):
            function([1.0, np.nan, 2.0])
        with pytest.raises(ValueError, match="expected at least one beam"):
            function(np.ones((3, 0)))
    with pytest.raises(ValueError, match="n_harmonics: expected at least 1"):
        spectrum(np.ones(4), 0)


def test_batches_of_signatures_are_row_by_row():
    scans = np.random.default_rng(7).uniform(0, 4, (2, 5, 9))
    for function in (spectrum, three_numbers):
        np.testing.assert_allclose(function(scans)[1, 3], function(scans[1, 3]), atol=1e-12)
