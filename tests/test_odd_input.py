"""Arguments and files at the edge: a short sentence with a name, a copy, a bound on memory."""

import contextlib
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest

from slamlab._files import read_npz
from slamlab.datasets import read_simulator
from slamlab.datasets.relations import read_relations
from slamlab.datasets.rosbag import read_rosbag
from slamlab.datasets.tum import read_tum
from slamlab.datasets.victoria_park import read_landmark_log
from slamlab.grids import Grid
from slamlab.localization import LikelihoodField
from slamlab.matching import LikelihoodGrid
from slamlab.robots import RelativePose, Unicycle
from slamlab.sensors import VisualOdometer, room_points
from slamlab.simulation.record import Script
from slamlab.slam import PoseGraph
from slamlab.worlds import BitmapWorld, Terrain

HUGE = "9" * 400 + "x" * 100_000
FILES = {
    "graph.g2o": (PoseGraph.read_g2o, f"VERTEX_SE2 0 {HUGE} 0 0\n", 1),
    "drive.tum": (read_tum, f"0 0 0 0 0 0 0 1\n1 {HUGE} 0 0 0 0 0 1\n", 2),
    "some.relations": (read_relations, f"0 1 {HUGE} 0 0 0 0 0\n", 1),
    "park.txt": (read_landmark_log, f"ODOMETRY 0 1 {HUGE} 0 0 1 0 0 1 0 1\n", 1),
}


@pytest.mark.parametrize("name", FILES)
def test_a_word_that_is_no_number_is_not_quoted_to_its_end(name, tmp_path):
    read, text, line = FILES[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=f"{name}: line {line}: expected numbers") as caught:
        read(tmp_path / name)
    assert len(str(caught.value)) < 250


def test_the_log_of_the_simulator_does_not_quote_it_either(tmp_path):
    from slamlab.datasets.simulator_log import _HEAD

    path = tmp_path / "simulator.csv"
    row = ",".join(["0"] * len(_HEAD))
    path.write_text(f"# log\n{','.join([*_HEAD, 'r0'])}\n{row},{HUGE}\n")
    with pytest.raises(ValueError, match=r"simulator.csv: line 3: expected numbers") as caught:
        read_simulator(path)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("dt", ["x", np.nan, -1.0, None, [1.0]])
def test_no_robot_takes_for_a_duration_what_is_none(dt):
    for robot, u in ((RelativePose(), [1.0, 0, 0]), (Unicycle(), [1.0, 0])):
        for call in (robot.step, robot.jacobians):
            with pytest.raises(ValueError, match="dt: expected"):
                call([0, 0, 0], u, dt)


def test_what_is_given_is_copied():
    values, controls = np.ones((3, 3)), np.ones((2, 2))
    field, script = LikelihoodGrid(values, 1.0), Script(controls)
    values[:], controls[:] = 5.0, 7.0
    assert field.value([1.5, 1.5]) == 1.0
    assert script.command(None).tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda rng: VisualOdometer(*[1e-4 * np.eye(3)] * 3).run(np.zeros((0, 3)), rng),
            "poses: expected at least one pose",
        ),
        (lambda rng: room_points(rng, size=(1e308, 1e308)), "size: expected two positive lengths"),
        (lambda rng: room_points(rng, size=(1.0, 0.0)), "size: expected two positive lengths"),
        (lambda rng: Terrain.rough(rng, size=(1e308, 1e308)), "bounds: expected a rectangle of"),
        (lambda rng: Terrain.rough(rng, size=(1e6, 1e6)), "bounds: expected a rectangle of"),
        (lambda rng: Grid.over([-1e308, 0, 1e308, 1], 1.0), "bounds: expected a rectangle of"),
        (lambda rng: BitmapWorld(np.full((50, 50), 0.3), 1.0), "occupied: expected at least one"),
    ],
)
def test_numbers_out_of_all_proportion_are_refused_in_a_short_sentence(call, message):
    with pytest.raises(ValueError, match=message) as caught:
        call(np.random.default_rng(0))
    assert len(str(caught.value)) < 300


def test_a_pose_beyond_all_maps_sees_nothing_of_this_one():
    walls = np.zeros((5, 5), bool)
    walls[2] = True
    field = LikelihoodField(walls, 0.05)
    near, nowhere = [0.1, 0.1, 0.0], [[1e308, -1e308, 1.0], [1e17, 0.0, 0.0]]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scores = field.log_likelihood([near, *nowhere], [[0.0, 0.0], [1e308, 0.0]])
    assert scores[1] == scores[2] < scores[0]


@pytest.mark.parametrize("image", ["a\0b.png", "x" * 5000, "two\nlines.png", ""])
def test_a_map_of_ros_with_an_impossible_image_is_named(image, tmp_path):
    import yaml

    entries = {"image": image, "resolution": 0.05, "origin": [0, 0, 0], "negate": 0}
    text = yaml.safe_dump(entries | {"occupied_thresh": 0.65, "free_thresh": 0.2})
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(ValueError, match="map.yaml: expected the name of an image") as caught:
        BitmapWorld.from_file(tmp_path / "map.yaml")
    assert len(str(caught.value)) < 400


def test_an_archive_that_unpacks_to_hundreds_of_times_its_size_is_refused(tmp_path):
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, a=np.zeros(2**24 + 10))
    with pytest.raises(ValueError, match=r"bomb.npz: .*unpacks to 1342\d+ bytes, \d+ times"):
        read_npz(path)
    np.savez_compressed(path, a=np.zeros(2**23))  # as much as a long log of nothing
    assert read_npz(path)["a"].size == 2**23


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux says it")
def test_a_transparent_picture_takes_little_more_memory_than_its_pixels(tmp_path):
    from PIL import Image

    side = 4000
    pixels = np.zeros((side, side, 4), np.uint8)
    pixels[:, : side // 2, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "room.png", compress_level=1)
    code = """
        import re, sys
        from pathlib import Path
        from PIL import Image, PngImagePlugin
        from slamlab.worlds._image import read_grey
        def peak():  # of this process alone, in kB
            return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
        before = peak()
        grey = read_grey(Path(sys.argv[1]))
        assert grey.shape == (4000, 4000), grey.shape
        assert (grey[:, :2000] == 0).all() and (grey[:, 2000:] == 255).all()
        print(peak() - before)
    """
    words = [sys.executable, "-c", textwrap.dedent(code), str(tmp_path / "room.png")]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert int(done.stdout) * 1024 / side**2 < 8.0  # bytes a pixel; as a whole it took 13


def test_a_folder_that_is_no_bag_is_told_so(tmp_path):
    pytest.importorskip("rosbags")
    with pytest.raises(ValueError, match="expected a bag of ROS 2, a folder with a meta"):
        read_rosbag(tmp_path)


def bounded(result):
    """Tell whether a bound on the cost can be had."""
    try:
        return result.certificate is not None
    except ValueError:
        return False


def test_asking_whether_a_result_is_certified_raises_nothing():
    rng, without = np.random.default_rng(1), []
    while len(without) < 2:
        n, m = int(rng.integers(2, 5)), int(rng.integers(0, 3))
        edges = [[i, i + 1] for i in range(n - 1)]
        edges += [sorted(rng.choice(n, 2, replace=False).tolist()) for _ in range(m)]
        diagonals = 10.0 ** rng.uniform(-12, 12, (len(edges), 3, 1))  # far apart
        start, measured = rng.normal(size=(n, 3)), rng.normal(size=(len(edges), 3))
        with contextlib.suppress(ValueError), np.errstate(all="ignore"):
            graph = PoseGraph(start, edges, measured, diagonals * np.eye(3))
            result = graph.optimize()
            without += [] if bounded(result) else [result]
    with np.errstate(all="ignore"):
        assert not any(result.certified for result in without)
