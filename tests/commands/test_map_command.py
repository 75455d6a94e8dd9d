"""``python -m slamlab map``: a log in, a map out; damage ends in a sentence."""

import gzip
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamlab.commands import main
from slamlab.datasets.tum import read_tum
from slamlab.evaluation import ate
from slamlab.geometry import compose
from slamlab.logs import Log
from slamlab.robots import YOUBOT
from slamlab.sensors import Lidar
from slamlab.simulation import PerfectEstimator, record
from slamlab.simulation.record import Script
from slamlab.slam import PoseGraph
from slamlab.worlds import BitmapWorld, rooms

LIDAR = Lidar(180, field_of_view=np.pi, max_range=20.0, sigma_range=0.01)
N = 30


def path():
    x = np.linspace(1.0, 8.0, N)
    return np.column_stack([x, 4.0 + 0.2 * np.sin(x), 0.2 * np.cos(x)])


def ranges():
    return LIDAR.scan(rooms.office(), path(), np.random.default_rng(0))


def motions(rng=None):
    from slamlab.geometry import between

    u = np.zeros((N, 3))
    u[1:] = between(path()[:-1], path()[1:]) * (1.05 if rng is None else 1.0)
    return u


@pytest.fixture
def npz(tmp_path):
    file = tmp_path / "drive.npz"
    dt = np.r_[0.0, np.ones(N - 1)]
    cov = np.diag(np.square([0.05, 0.02, 0.02]))
    Log(
        np.arange(N), motions(), dt, cov, ranges=ranges(), scan=LIDAR, controls="displacement"
    ).save(file)
    return file


@pytest.fixture
def carmen(tmp_path):
    odometry, lines = np.array([0.0, 0.0, 0.0]), []
    for k, (u, scan) in enumerate(zip(motions(), ranges(), strict=True)):
        odometry = compose(odometry, u)
        pose = " ".join(f"{v:.6f}" for v in odometry)
        readings = " ".join(f"{min(r, 81.91):.3f}" for r in scan)
        lines.append(f"FLASER 180 {readings} {pose} {pose} {k}.0 robot {k}.0")
    file = tmp_path / "drive.log"
    file.write_text("\n".join(lines) + "\n")
    return file


def said(capsys):
    lines = capsys.readouterr().out.splitlines()
    return {line[:24].strip(): line[25:] for line in lines}


def moved_path():
    from slamlab.geometry import between

    return between(path()[0], path())


@pytest.mark.parametrize("kind", ["npz", "carmen"])
def test_a_log_becomes_a_map(kind, request, tmp_path, capsys):
    folder = tmp_path / "out"
    file = request.getfixturevalue(kind)
    assert main(["map", str(file), "-o", str(folder)]) == 0
    told = said(capsys)
    assert told["method"] == "scan-graph"
    assert told["lost"] == "never"
    times, poses = read_tum(folder / "trajectory.tum")
    assert len(times) == N
    assert ate(poses, moved_path()).rmse < 0.03
    world = BitmapWorld.from_file(folder / "map.yaml")
    assert world.resolution == pytest.approx(0.05)
    assert (folder / "map.png").read_bytes().startswith(b"\x89PNG")
    assert len(PoseGraph.read_g2o(folder / "graph.g2o").poses) <= N
    page = (folder / "index.html").read_text()
    assert "id='figure'" in page
    assert "http" not in page.replace("http://www.w3.org", "")


@pytest.mark.parametrize("method", ["hector", "odometry"])
def test_other_methods(method, npz, tmp_path, capsys):
    assert main(["map", str(npz), "-o", str(tmp_path / "out"), "--method", method]) == 0
    assert said(capsys)["method"] == method
    _, poses = read_tum(tmp_path / "out" / "trajectory.tum")
    limit = 0.05 if method == "hector" else 1.0
    assert ate(poses, moved_path()).rmse < limit


def test_a_log_is_found_in_a_map_made_before(npz, tmp_path, capsys):
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["map", str(npz), "-o", str(first)]) == 0
    before = {file.name: file.read_bytes() for file in first.iterdir()}
    Log.load(npz)[10:].save(tmp_path / "later.npz")
    words = ["map", str(tmp_path / "later.npz"), "--localize", str(first), "-o", str(second)]
    assert main(words) == 0
    assert "localized                from scan" in capsys.readouterr().out
    assert {file.name for file in second.iterdir()} == {"index.html", "map.png", "trajectory.tum"}
    made, found = (read_tum(folder / "trajectory.tum")[1] for folder in (first, second))
    assert np.abs(found - made[10:])[:, :2].max() < 0.1
    assert {file.name: file.read_bytes() for file in first.iterdir()} == before


def test_a_log_from_elsewhere_is_not_found_and_a_senseless_call_harms_no_map(
    npz, tmp_path, capsys
):
    first = tmp_path / "first"
    assert main(["map", str(npz), "-o", str(first)]) == 0
    x = np.column_stack([np.full((N, 2), 0.5), np.linspace(0.0, 3.0, N)])
    scans = LIDAR.scan(rooms.thesis_room_two(), x, np.random.default_rng(0))
    replace(Log.load(npz), ranges=scans).save(tmp_path / "other.npz")
    words = ["map", str(tmp_path / "other.npz"), "--localize", str(first / "map.yaml")]
    assert main([*words, "-o", str(tmp_path / "out")]) == 0
    assert "not sure: no place in the map fits, do not trust the path" in capsys.readouterr().out
    for more, message in (
        (["-o", str(first)], "--output: expected another folder"),
        (["--method", "hector"], "--localize: expected no --method"),
    ):
        assert main([*words, *more]) == 1
        assert message in capsys.readouterr().err
    (first / "map.yaml").write_text("resolution: 0.05")
    assert main(words) == 1
    assert "map.yaml" in capsys.readouterr().err


def test_the_page_is_the_same_whatever_the_name(npz, tmp_path):
    odd = npz.rename(tmp_path / "<b>&.npz")
    assert main(["map", str(odd), "-o", str(tmp_path / "out")]) == 0
    assert "<b>&" not in (tmp_path / "out" / "index.html").read_text()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda f: f.unlink(), "No such file"),
        (lambda f: f.write_bytes(b""), "expected at least one FLASER"),
        (lambda f: f.write_text("HELLO 1 2 3\n"), "expected a CARMEN tag"),
        (lambda f: f.write_bytes(gzip.compress(f.read_bytes())[:-200]), "cannot unpack"),
    ],
)
def test_damage_ends_in_a_sentence(make, message, carmen, tmp_path, capsys):
    make(carmen)
    assert main(["map", str(carmen), "-o", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("slamlab map: ")
    assert message in error
    assert len(error.splitlines()) == 1


def test_a_log_without_scans_or_with_other_controls(tmp_path, capsys):
    file = tmp_path / "drive.npz"
    Log([0.0], [[0, 0, 0]], 0.0, np.eye(3)).save(file)
    assert main(["map", str(file), "-o", str(tmp_path / "out")]) == 1
    assert "expected a log with scans" in capsys.readouterr().err
    Log([0.0], [[0]], 0.0, [[1.0]], ranges=ranges()[:1], scan=LIDAR, controls="velocity").save(
        file
    )
    assert main(["map", str(file), "-o", str(tmp_path / "out")]) == 1
    assert "expected motions" in capsys.readouterr().err


def velocities(controls):
    """The same drive as velocities of the body, five steps a second, as simulations record it."""
    dt = np.r_[0.0, np.full(N - 1, 0.2)]
    u = motions() / np.maximum(dt, 0.2)[:, None]
    cov = np.diag(np.square([0.25, 0.1, 0.1]))
    return Log(np.cumsum(dt), u, dt, cov, ranges=ranges(), scan=LIDAR, controls=controls)


@pytest.mark.parametrize("method", ["scan-graph", "hector", "odometry"])
def test_velocities_of_a_simulated_log_are_driven_for_their_time(method, tmp_path, capsys):
    file = tmp_path / "drive.npz"
    velocities("velocity").save(file)
    assert main(["map", str(file), "-o", str(tmp_path / "out"), "--method", method]) == 0
    driven = float(said(capsys)["driven"].split()[0])
    length = np.hypot(*np.diff(path()[:, :2], axis=0).T).sum()
    assert abs(driven - length) < 0.1 * length
    # Taken for displacements, five times as far: what the command did before it asked.
    velocities("displacement").save(file)
    main(["map", str(file), "-o", str(tmp_path / "out"), "--method", "odometry"])
    assert float(said(capsys)["driven"].split()[0]) > 4 * length


def test_a_recorded_drive_says_what_its_controls_are(tmp_path):
    robot, world = YOUBOT, rooms.office()
    script = Script([[0.2, 0.0, 0.0]] * 3)
    log = record(
        world, robot, LIDAR, script, PerfectEstimator(), np.random.default_rng(0),
        start=[2.0, 4.0, 0.0], dt=0.2,
    )  # fmt: skip
    assert log.controls == "velocity"
    log.save(tmp_path / "drive.npz")
    assert Log.load(tmp_path / "drive.npz").controls == "velocity"


def test_controls_that_nobody_named_are_asked_for(tmp_path, capsys):
    file = tmp_path / "drive.npz"
    velocities(None).save(file)
    out = ["-o", str(tmp_path / "out"), "--method", "odometry"]
    assert main(["map", str(file), *out]) == 1
    assert "add --controls velocity" in capsys.readouterr().err
    assert main(["map", str(file), *out, "--controls", "velocity"]) == 0


@pytest.mark.parametrize("resolution", ["0", "-1", "nan", "1e-9", "inf"])
def test_a_senseless_resolution_is_named_before_anything_is_made(
    resolution, npz, tmp_path, capsys
):
    out = tmp_path / "out"
    assert main(["map", str(npz), "-o", str(out), f"--resolution={resolution}"]) == 1
    assert "resolution: expected a number in [0.005, 10]" in capsys.readouterr().err
    assert not out.exists()


def test_an_output_that_cannot_be_a_folder_is_named_before_the_run(
    npz, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("slamlab.commands.map.run_system", None)  # must not be reached
    (tmp_path / "out").write_text("a file")
    assert main(["map", str(npz), "-o", str(tmp_path / "out")]) == 1
    assert "out" in capsys.readouterr().err


def bad_header(file):
    """An archive whose array has a header that the tokenizer cannot read to its end."""
    with zipfile.ZipFile(file, "w") as archive:
        text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,"
        head = text + b" " * (118 - len(text) - 1) + b"\n"
        archive.writestr("u.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)


def bad_lzma(file):
    """A zip of method LZMA whose content is damaged."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("drive.log", b"FLASER " * 1000)
    whole = bytearray(file.read_bytes())
    whole[60:90] = bytes(30)
    file.write_bytes(bytes(whole))


@pytest.mark.parametrize(
    ("name", "damage"), [("a.npz", bad_header), ("a.log", bad_lzma), ("a.g2o", bad_lzma)]
)
def test_damaged_archives_end_in_a_sentence(name, damage, tmp_path, capsys):
    file = tmp_path / name
    damage(file)
    command = "graph" if name.endswith("g2o") else "map"
    assert main([command, str(file), "-o", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"slamlab {command}: ")
    assert name in error
    assert len(error.splitlines()) == 1


def test_an_interrupt_before_the_command_begins_ends_in_a_sentence():
    code = (
        "import sys, runpy, importlib.abc\n"
        "class Interrupt(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'slamlab.commands.map': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "sys.argv = ['slamlab', 'map', 'x.log']\n"
        "runpy.run_module('slamlab', run_name='__main__')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert done.stderr == "slamlab: interrupted\n"


@pytest.mark.parametrize("method", ["scan-graph", "hector", "odometry"])
@pytest.mark.parametrize("reading", [np.nan, np.inf, 0.0, 81.91])
def test_a_drive_that_saw_nothing_is_not_told_as_one_that_was_never_lost(
    reading, method, tmp_path, capsys
):
    file = tmp_path / "drive.npz"
    replace(velocities("velocity"), ranges=np.full((N, 180), reading)).save(file)
    assert main(["map", str(file), "-o", str(tmp_path / "out"), "--method", method]) == 0
    told = said(capsys)
    assert told["lost"] == "nothing was ever seen: do not trust the map"
    assert "few readings that met anything (0 %)" in told["suspects"]


def test_times_that_run_backwards_are_told_and_a_log_in_order_says_nothing(
    carmen, tmp_path, capsys
):
    words = ["map", str(carmen), "-o", str(tmp_path / "out"), "--method", "odometry"]
    assert main(words) == 0
    assert "times" not in said(capsys)
    carmen.write_text("\n".join(carmen.read_text().splitlines()[::-1]) + "\n")
    assert main(words) == 0
    assert (
        said(capsys)["times"]
        == f"run backwards in {N - 1} of {N - 1} steps: is the file in order?"
    )
    assert "run backwards" in (tmp_path / "out" / "index.html").read_text()


def test_scans_that_lie_nowhere_name_what_may_be_wrong(tmp_path, capsys):
    rng, lines = np.random.default_rng(0), []
    for k in range(N):
        readings = " ".join(f"{r:.3f}" for r in rng.uniform(1.0, 20.0, 180))
        pose, time = f"{0.3 * k:.3f} 0 0", k + 40.0 * (k > 20) - 3.0 * (k == 9)
        lines.append(f"FLASER 180 {readings} {pose} {pose} {time} robot {time}")
    (tmp_path / "noise.log").write_text("\n".join(lines) + "\n")
    out = ["-o", str(tmp_path / "out"), "--field-of-view", "200"]
    assert main(["map", str(tmp_path / "noise.log"), *out]) == 0
    told = said(capsys)
    assert told["lost"].endswith("do not trust the map")
    causes = told["suspects"].split("; ")
    assert causes[0] == "the field of view (200 degrees were taken)"
    assert causes[1] == f"times that run backwards (1 of {N - 1} steps)"
    assert causes[2] == "the clock, or a pause of 41.0 s before scan 21"
    # A log of the same drive that fits has no suspects.
    velocities("velocity").save(tmp_path / "good.npz")
    assert main(["map", str(tmp_path / "good.npz"), *out]) == 0
    assert "suspects" not in said(capsys)


def round_a_block(file, controls=1.0):
    """A CARMEN log of 180 degrees: five sides of a corridor, wheels whose lengths are scaled."""
    from tests.slam.ring import drive

    log, odometry, lines = drive(0, 0, 5), np.zeros(3), []
    for k, (u, scan) in enumerate(zip(log.u, log.ranges, strict=True)):
        odometry = compose(odometry, u * [controls, controls, 1.0])
        pose = " ".join(f"{v:.6f}" for v in odometry)
        readings = " ".join(f"{r if r < 8.0 else 81.91:.3f}" for r in scan)
        lines.append(f"FLASER {len(scan)} {readings} {pose} {pose} {k}.0 robot {k}.0")
    file.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("degrees", "scale", "words"),
    [
        (120, 1.0, "a turn of 10 degrees by the wheels is 6."),
        (270, 1.0, "a turn of 10 degrees by the wheels is 1"),
        (360, 1.0, "after 1 m, or 29 degrees, the scans are 0.2"),
        (180, 1.4, "1 m of the wheels is 0."),
        (180, 1.0, ""),
        (180, 1.1, ""),
    ],
)
def test_scans_that_fit_each_other_but_not_the_wheels_name_the_field_of_view(
    degrees, scale, words, tmp_path, capsys
):
    round_a_block(tmp_path / "ring.log", scale)
    out = ["-o", str(tmp_path / "out"), "--field-of-view", str(degrees)]
    assert main(["map", str(tmp_path / "ring.log"), *out]) == 0
    told = said(capsys)
    if not words:
        assert "wheels" not in told
        assert "suspects" not in told
        return
    assert words in told["wheels"]
    assert told["wheels"].endswith("one of the two is wrong: do not trust the map")
    assert told["suspects"].startswith(f"the field of view ({degrees} degrees were taken)")
    assert "the scale of the odometry" in told["suspects"]
    assert "do not trust" not in told["lost"]  # the wheels hold the scans where they can be


def test_a_large_picture_is_shrunk_and_keeps_its_walls_and_its_place():
    from slamlab.commands.map import _smaller

    image = np.full((4001, 300), 205, np.uint8)
    image[3000] = 0  # a wall one cell thick, which every third row would miss
    image[:1500, 150] = 254
    small, covered = _smaller(image)
    assert small.shape == (1334, 100)
    assert covered == (4002, 300)
    assert (small[1000] == 0).all()
    assert (small[:500, 50] == 254).all()
    assert (small == 205).sum() == small.size - 100 - 500
    same, covered = _smaller(image[:2000])
    assert same.shape == covered == (2000, 300)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux says it")
def test_a_map_of_twenty_million_cells_is_drawn_in_little_memory():
    code = (
        "import re, types, numpy as np\n"
        "from pathlib import Path\n"
        "from slamlab.commands.map import drawing\n"
        "from slamlab.mapping import OccupancyGrid\n"
        "def peak():\n"
        "    status = Path('/proc/self/status').read_text()\n"
        "    return int(re.search(r'VmHWM:\\s+(\\d+)', status)[1]) / 1024\n"
        "small, grid = OccupancyGrid((10, 10), 0.1), OccupancyGrid((4000, 5000), 0.05)\n"
        "run = types.SimpleNamespace(trajectory=np.zeros((2, 3)), system=None)\n"
        "drawing(run, small); before = peak(); drawing(run, grid); print(peak() - before)\n"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 350.0  # MB; the picture as a whole took 900


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux says it")
def test_a_log_of_two_thousand_scans_over_a_long_way_takes_less_than_a_gigabyte(tmp_path):
    """1.7 km to and fro over 130 m; the map, its picture and its page take what there is."""
    n, rng = 2000, np.random.default_rng(0)
    along = np.linspace(0.0, 1700.0, n) % 260.0
    x = np.column_stack([130.0 - np.abs(along - 130.0), np.arange(n) * 0.065, np.zeros(n)])
    u = np.diff(x, axis=0, prepend=x[:1])
    scans, lidar = rng.uniform(1.0, 30.0, (n, 91)), Lidar(91, max_range=40.0)
    log = Log(
        np.arange(n), u, np.r_[0.0, np.ones(n - 1)], 1e-4 * np.eye(3), ranges=scans, scan=lidar
    )
    replace(log, controls="displacement").save(tmp_path / "long.npz")
    code = (
        "import re, sys\n"
        "from pathlib import Path\n"
        "from slamlab.commands import main\n"
        "assert main(sys.argv[1:]) == 0\n"
        "status = Path('/proc/self/status').read_text()\n"
        "print(int(re.search(r'VmHWM:\\s+(\\d+)', status)[1]) / 1024)\n"
    )
    # Scan matching adds its minute, and no memory: 480 MB where the wheels alone took 510.
    words = ["map", str(tmp_path / "long.npz"), "-o", str(tmp_path / "out")]
    words = [sys.executable, "-c", code, *words, "--method", "odometry"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert float(done.stdout.splitlines()[-1]) < 900.0  # MB
    assert (tmp_path / "out" / "map.png").exists()
