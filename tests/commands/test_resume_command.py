"""``slamlab map --resume``: another drive in the map of an earlier run, or beside it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from slamlab.commands import main
from slamlab.datasets.tum import read_tum
from slamlab.evaluation import ate
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.slam import PoseGraph, Sessions
from tests.slam.ring import building, drive

DRIVES = {"first": (0, 0, 5), "second": (1, 2, 3), "elsewhere": (16, 2, 3, 6)}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The logs, and the map of the first."""
    folder = tmp_path_factory.mktemp("resume")
    for name, which in DRIVES.items():
        replace(drive(*which), controls="displacement").save(folder / f"{name}.npz")
    assert main(["map", str(folder / "first.npz"), "-o", str(folder / "map")]) == 0
    return folder


def files(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def said(capsys):
    return {line[:24].strip(): line[25:] for line in capsys.readouterr().out.splitlines()}


def test_a_second_drive_goes_on_with_the_map(made, tmp_path, capsys):
    before, out = files(made / "map"), tmp_path / "both"
    words = ["map", str(made / "second.npz"), "--resume", str(made / "map"), "-o", str(out)]
    assert main(words) == 0
    told = said(capsys)
    assert told["joined"].startswith("yes, by ")
    assert "closures with earlier drives; second.npz began at (11." in told["joined"]
    assert told["drive 1"] == "first.npz, 165 scans, in the map"
    assert told["drive 2"].startswith("second.npz")
    assert files(made / "map") == before
    assert set(files(out)) == {
        "map.yaml", "map.pgm", "map.png", "graph.g2o", "sessions.npz", "index.html",
        "trajectory-1.tum", "trajectory-2.tum",
    }  # fmt: skip
    poses = np.concatenate([read_tum(out / f"trajectory-{k}.tum")[1] for k in (1, 2)])
    truth = np.concatenate([drive(*DRIVES[name]).truth for name in ("first", "second")])
    assert ate(poses, truth).rmse < 0.05
    found = Sessions.load(out / "sessions.npz")
    graph = PoseGraph.read_g2o(out / "graph.g2o")
    assert len(graph.poses) == sum(len(one.nodes) for one in found.drives)
    assert "yes, by" in (out / "index.html").read_text()
    # A run of the usual kind into the same folder leaves nothing of this one.
    assert main(["map", str(made / "first.npz"), "-o", str(out)]) == 0
    assert set(files(out)) == set(before)


def test_a_drive_through_another_building_is_told_and_kept_beside_the_map(made, tmp_path, capsys):
    out, third = tmp_path / "out", tmp_path / "third"
    words = ["map", str(made / "elsewhere.npz"), "--resume", str(made / "map"), "-o", str(out)]
    assert main(words) == 0
    told = said(capsys)
    assert told["joined"].startswith("no: ")
    assert told["joined"].endswith(
        "too few agree; elsewhere.npz is kept beside the map, in a frame of its own"
    )
    assert told["drive 2"].endswith("scans, waits beside the map")
    for name in ("map.pgm", "graph.g2o"):
        assert (out / name).read_bytes() == (made / "map" / name).read_bytes()
    assert np.abs(read_tum(out / "trajectory-2.tum")[1][0]).max() < 0.1
    # What it is kept in can be resumed again.
    words = ["map", str(made / "second.npz"), "--resume", str(out), "-o", str(third)]
    assert main(words) == 0
    told = said(capsys)
    assert told["joined"].startswith("yes, by ")
    assert [told[f"drive {k}"].split(",")[0] for k in (1, 2, 3)] == [
        "first.npz", "second.npz", "elsewhere.npz",
    ]  # fmt: skip


def other_lidar(made, path):
    log = Log.load(made / "first.npz")[:20]
    lidar = Lidar(90, field_of_view=np.pi, max_range=8.0)
    scans = lidar.scan(building(), drive(*DRIVES["first"]).truth[:20])
    replace(log, ranges=scans, scan=lidar).save(path)


def blind(made, path):
    log = Log.load(made / "first.npz")[:5]
    replace(log, ranges=np.full(log.ranges.shape, np.inf)).save(path)


def no_sessions(folder):
    (folder / "sessions.npz").unlink()


def cut(folder):
    whole = (folder / "sessions.npz").read_bytes()
    (folder / "sessions.npz").write_bytes(whole[: len(whole) // 2])


def newer(folder):
    with np.load(folder / "sessions.npz") as kept:
        arrays = dict(kept) | {"version": np.array(2)}
    np.savez(folder / "sessions.npz", **arrays)


def pickled(folder):
    np.savez(folder / "sessions.npz", version=np.array([print], dtype=object))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (no_sessions, "--resume: expected a folder with sessions.npz"),
        (cut, "sessions.npz: expected a npz archive"),
        (newer, "version: expected 1, got 2: map the first log again"),
        (pickled, "sessions.npz: expected a npz archive"),
    ],
)
def test_a_folder_that_cannot_be_resumed_ends_in_a_sentence(
    damage, message, made, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("slamlab.commands.map.run_system", None)  # must not be reached
    folder = tmp_path / "map"
    folder.mkdir()
    for name, data in files(made / "map").items():
        (folder / name).write_bytes(data)
    damage(folder)
    words = ["map", str(made / "second.npz"), "--resume", str(folder)]
    refused([*words, "-o", str(tmp_path / "out")], message, capsys)
    assert not (tmp_path / "out").exists()


def refused(words, message, capsys):
    assert main(words) == 1
    error = capsys.readouterr().err
    assert error.startswith("slamlab map: ")
    assert message in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--localize", "map"], "--resume: expected no --localize"),
        (["--method", "hector"], "--resume: expected --method scan-graph"),
        (["--method", "scan-graph", "-o", "map"], "--output: expected another folder"),
        (["--resume", "nowhere"], "--resume: expected the folder of an earlier run, got nowhere"),
        (["--resume", "first.npz"], "--resume: expected the folder of an earlier run"),
    ],
)
def test_a_senseless_call_is_refused_before_anything_is_made(
    more, message, made, capsys, monkeypatch
):
    monkeypatch.chdir(made)
    before = {path.name for path in made.iterdir()}, files(made / "map")
    refused(["map", "second.npz", "--resume", "map", *more], message, capsys)
    assert ({path.name for path in made.iterdir()}, files(made / "map")) == before


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (other_lidar, "log: expected the lidar of the map, 180 beams from -90.0 to 90.0 degrees"),
        (blind, "expected scans with at least ten points, got none"),
    ],
)
def test_a_log_that_does_not_fit_names_itself(make, message, made, tmp_path, capsys):
    make(made, tmp_path / "log.npz")
    words = ["map", str(tmp_path / "log.npz"), "--resume", str(made / "map")]
    refused([*words, "-o", str(tmp_path / "out")], "log.npz: " + message, capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("where", ["recognised", "more"])
def test_an_interrupt_while_places_are_searched_leaves_nothing(
    where, made, tmp_path, capsys, monkeypatch
):
    def interrupted(*given, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"slamlab.slam.sessions.{where}", interrupted)
    before = files(made / "map")
    words = ["map", str(made / "second.npz"), "--resume", str(made / "map")]
    assert main([*words, "-o", str(tmp_path / "out")]) == 130
    *progress, last = capsys.readouterr().err.splitlines()
    assert last == "slamlab map: interrupted"
    # Before it a slow machine says how far it is, and nothing else.
    assert all(re.fullmatch(r"\d+ of \d+ places, .*", line) for line in progress)
    assert not (tmp_path / "out").exists()
    assert files(made / "map") == before
