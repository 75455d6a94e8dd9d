"""The folder of a command: whole, or as it was before; never half a run, never two."""

import errno

import numpy as np
import pytest

from slamlab.commands import graph as graph_command
from slamlab.commands import main
from slamlab.commands import map as map_command
from slamlab.commands._results import results
from slamlab.datasets.synthetic import manhattan_graph
from slamlab.geometry import between
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.worlds import rooms

OURS = ("map.yaml", "graph.g2o")


def put(folder, *names):
    """Make a run that leaves these files and a page."""
    with results(folder, OURS) as beside:
        for name in names:
            (beside / name).write_text(name)
        (beside / "index.html").write_text("<html><head></head></html>")


def there(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def town(tmp_path):
    path = tmp_path / "town.g2o"
    manhattan_graph(12, 18, np.random.default_rng(0)).graph.write_g2o(path)
    return path


@pytest.fixture
def drive(tmp_path):
    x = np.linspace(1.0, 3.0, 8)
    path = np.column_stack([x, np.full(8, 4.0), np.zeros(8)])
    lidar = Lidar(90, field_of_view=np.pi, max_range=20.0)
    u = np.zeros((8, 3))
    u[1:] = between(path[:-1], path[1:])
    ranges = lidar.scan(rooms.office(), path)
    dt, cov = np.r_[0.0, np.ones(7)], 1e-4 * np.eye(3)
    file = tmp_path / "drive.npz"
    log = Log(np.arange(8), u, dt, cov, ranges=ranges, scan=lidar, controls="displacement")
    log.save(file)
    return file


def test_files_of_an_earlier_run_that_this_one_does_not_make_are_gone(tmp_path):
    folder = tmp_path / "out"
    put(folder, "map.yaml", "graph.g2o")
    (folder / "notes.txt").write_text("mine")
    put(folder, "map.yaml")
    assert there(folder) == ["index.html", "map.yaml", "notes.txt"]


def test_a_file_that_no_run_made_stays_whatever_its_name(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "graph.g2o").write_text("mine")
    put(folder, "map.yaml")
    assert (folder / "graph.g2o").read_text() == "mine"
    # A page that names other files than ours takes nothing away.
    (tmp_path / "mine.txt").write_text("mine")
    named = '<head><meta name="slamlab-files" content="../mine.txt notes.txt graph.g2o"></head>'
    (folder / "notes.txt").write_text("mine")
    (folder / "index.html").write_text(named)
    put(folder, "map.yaml")
    assert (tmp_path / "mine.txt").exists()
    assert there(folder) == ["index.html", "map.yaml", "notes.txt"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, OSError(errno.ENOSPC, "full")])
def test_a_run_that_ends_early_leaves_the_folder_as_it_was(error, tmp_path):
    def stopped(folder):
        with results(folder, OURS) as beside:
            (beside / "map.yaml").write_text("half")
            raise error

    folder = tmp_path / "new" / "out"
    with pytest.raises((KeyboardInterrupt, ValueError, OSError)):
        stopped(folder)
    assert not (tmp_path / "new").exists()
    put(folder, "map.yaml", "graph.g2o")
    with pytest.raises((KeyboardInterrupt, ValueError, OSError)):
        stopped(folder)
    assert there(folder) == ["graph.g2o", "index.html", "map.yaml"]
    assert (folder / "map.yaml").read_text() == "map.yaml"


def test_a_full_disk_is_said_with_the_name_of_the_folder(tmp_path):
    folder = tmp_path / "out"
    with pytest.raises(OSError, match=r"out: the results cannot be written \(full\)"):
        with results(folder, OURS):
            raise OSError(errno.ENOSPC, "full")


@pytest.mark.parametrize("part", ["write_tum", "_replay"])
def test_an_interrupted_map_leaves_no_half_of_itself(part, drive, tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(map_command, part, stop)
    monkeypatch.setattr(map_command, "has", lambda name: name == "anywidget")
    assert main(["map", str(drive), "-o", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


def test_a_second_map_by_another_method_leaves_no_graph_of_the_first(drive, tmp_path, monkeypatch):
    monkeypatch.setattr(map_command, "has", lambda name: False)
    words = ["map", str(drive), "-o", str(tmp_path / "out"), "--method"]
    assert main([*words, "scan-graph"]) == 0
    assert "graph.g2o" in there(tmp_path / "out")
    assert main([*words, "hector"]) == 0
    assert there(tmp_path / "out") == ["index.html", "map.pgm", "map.yaml", "trajectory.tum"]


def test_graph_checks_its_folder_before_the_work_and_leaves_no_half(town, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("a file")
    with monkeypatch.context() as patch:
        patch.setattr(graph_command, "best_of_two", None)  # must not be reached
        assert main(["graph", str(town), "-o", str(tmp_path / "file")]) == 1
    monkeypatch.setattr(graph_command, "worst", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(["graph", str(town), "-o", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()
