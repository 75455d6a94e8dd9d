"""Every reader of files, fed with mutated ones: a value or a sentence, soon, and nothing else.

A sentence names the file, of a text also the line; a value is finite. ``make fuzz N=3`` tries
three times as many.
"""

import re
import resource
import time
import warnings

import numpy as np
import pytest

from slamlab.datasets import read_carmen, read_simulator
from slamlab.datasets.relations import read_relations
from slamlab.datasets.simulator_log import _HEAD
from slamlab.datasets.tum import read_tum
from slamlab.datasets.victoria_park import read_landmark_log
from slamlab.localization import SignatureMap
from slamlab.logs import Log, ScanGeometry
from slamlab.mapping import OccupancyGrid
from slamlab.navigation import Cubic, PathMemory
from slamlab.sensors import Lidar
from slamlab.slam import PoseGraph, ScanGraphSlam, Sessions
from slamlab.worlds import BitmapWorld, rooms
from tests import fuzzing
from tests.fuzzing import ROUNDS, damage

SECONDS, MEGABYTES = 2.0, 300.0


def peak():
    """Most memory that this process ever had (MB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def path_memory(path):
    memory = PathMemory(0.05)
    for t in np.linspace(0, 6, 120):
        memory.add([t, np.sin(t)])
    memory.save(path)


def log(path):
    scan = ScanGeometry(np.linspace(-1, 1, 5), 9.0)
    parts = {"ranges": np.ones((4, 5)), "scan": scan, "truth": np.zeros((4, 3))}
    Log(np.arange(4.0), np.ones((4, 2)), 1.0, np.eye(2), **parts).save(path)


def signature_map(path):
    SignatureMap.build(rooms.thesis_room(), Lidar(24), 100, progress=False).save(path)


def carmen(path):
    scan = "FLASER 3 1.0 2.5 0.5 {x} 2.0 0.3 {x} 2.0 0.3 10.{x} host 11.5"
    path.write_text("\n".join(scan.format(x=k) for k in range(6)) + "\n")


def graph(path):
    lines = [f"VERTEX_SE2 {k} {k} 0 0" for k in range(5)]
    lines += [f"EDGE_SE2 {k} {k + 1} 1 0 0 10 0 0 10 0 10" for k in range(4)]
    path.write_text("\n".join(lines) + "\n")


def tum(path):
    path.write_text("\n".join(f"{k}.0 {k} 0 0 0 0 0 1" for k in range(6)) + "\n")


def toro(path):
    lines = [f"VERTEX2 {k} {k} 0 0" for k in range(5)]
    lines += [f"EDGE2 {k} {k + 1} 1 0 0 10 0 10 10 0 0" for k in range(4)]
    path.write_text("\n".join(lines) + "\n")


def landmark_log(path):
    lines = [f"ODOMETRY {k} {k + 1} 1 0 0 100 0 0 100 0 100" for k in range(4)]
    lines += [f"LANDMARK {k} 7 {2 - k} 1 100 0 100" for k in range(3)]
    path.write_text("\n".join(lines) + "\n")


def simulator(path):
    head = ",".join([*_HEAD, "r0", "r1", "r2"])
    rows = "\n".join(",".join([f"0.{k}"] * (len(_HEAD) + 3)) for k in range(1, 6))
    path.write_text(f"# log\n{head}\n{rows}\n")


def relations(path):
    path.write_text("\n".join(f"{k}.0 {k + 1}.0 1 0 0 0 0 0.1" for k in range(6)) + "\n")


def sessions(path):
    lidar = Lidar(60, max_range=5.0)
    system, poses = ScanGraphSlam(lidar), [[1.5 + 0.3 * k, 1.5, 0.1 * k] for k in range(3)]
    scans = lidar.scan(rooms.box_room(), poses)
    for scan in scans:
        system.update(scan)
        system.predict([0.3, 0.0, 0.1], 1.0, 0.01 * np.eye(3))
    log = Log(np.arange(3.0), np.zeros((3, 3)), 1.0, np.eye(3), ranges=scans, scan=lidar)
    Sessions(system, log, "a.log").save(path)


def image(path):
    from PIL import Image

    room = np.full((6, 6), 255, np.uint8)
    room[0] = 0
    Image.fromarray(room).save(path, format="PNG")


def ros_map(path):
    path = path.with_suffix(".yaml")
    OccupancyGrid((6, 6), 0.1).save_ros(path)
    return path


READERS = {
    "path memory": (path_memory, lambda p: PathMemory.load(p).length, 300),
    "log": (log, Log.load, 400),
    "carmen": (carmen, read_carmen, 1500),
    "graph": (graph, PoseGraph.read_g2o, 1500),
    "graph of TORO": (toro, PoseGraph.read_g2o, 800),
    "landmark log": (landmark_log, read_landmark_log, 800),
    "simulator": (simulator, read_simulator, 800),
    "tum": (tum, read_tum, 800),
    "relations": (relations, read_relations, 800),
    "image": (image, lambda p: BitmapWorld.from_file(p, 0.1), 500),
    "map of ROS": (ros_map, BitmapWorld.from_file, 300),
    "map of drives": (sessions, lambda p: Sessions.load(p).graph(), 200),
    "signature map": (signature_map, SignatureMap.load, 60),
}


def mutated(good, rng):
    data = bytearray(good)
    for _ in range(rng.integers(1, 5)):
        kind, at = rng.integers(5), int(rng.integers(0, max(len(data), 1)))
        if kind == 0:
            del data[at:]
        elif kind == 1:
            data[at : at + 1] = bytes([rng.integers(256)])
        elif kind == 2:
            data[at:at] = rng.choice([b"nan", b"1e308", b"-", b"9" * 20, b"\x00", b"\n"])
        elif kind == 3:
            data[at : at + int(rng.integers(1, 30))] = b""
        else:
            data[at:at] = data[: int(rng.integers(0, 60))]
    return bytes(data)


# Formats of lines: what breaks one is named with its number, or is said of the end of the file.
TEXTS = {"carmen", "graph", "graph of TORO", "landmark log", "simulator", "tum", "relations"}


def finite(value):
    """Whether no number of what was read is NaN; ranges may be, a lost reading is one."""
    if isinstance(value, np.ndarray):
        return value.dtype.kind != "f" or not np.isnan(value).any()
    if isinstance(value, tuple | list):
        return all(map(finite, value))
    parts = getattr(value, "__dict__", {})
    return all(finite(part) for name, part in parts.items() if "ranges" not in name)


def complaint(read, path, name):
    """What is wrong with the answer to a file, "" or "refused" if nothing is."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", UserWarning)
            found = read(path)
    except FileNotFoundError:  # a map of ROS that names another image
        return "refused"
    except (ValueError, OSError) as error:
        said = str(error)
        placed = name not in TEXTS or re.search(r"\bline \d+|ends|at least one|near the map", said)
        return "refused" if path.name in said and placed and len(said) < 500 else said[:300]
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:300]
    return "" if finite(found) else "a silent NaN"


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_read_or_refused_soon(tmp_path, name, record_property):
    write, read, count = READERS[name]
    path = tmp_path / "file.npz"
    path = write(path) or path
    good, rng = path.read_bytes(), damage(len(name))
    assert complaint(read, path, name) == ""
    slowest, before, answers = 0.0, peak(), []
    for _ in range(count * ROUNDS):
        path.write_bytes(mutated(good, rng))
        begin = time.process_time()
        answers.append(complaint(read, path, name))
        slowest = max(slowest, time.process_time() - begin)
    record_property("files", len(answers))
    assert {one for one in answers if one not in ("", "refused")} == set()
    assert answers.count("refused") > 0.2 * len(answers)
    assert slowest < SECONDS
    assert peak() - before < MEGABYTES


def test_numbers_beyond_any_path_do_not_start_a_search_without_end():
    with pytest.raises(ValueError, match="coefficients: expected metres up to 1e"):
        Cubic(np.full((4, 2), 1e308))
    with pytest.raises(ValueError, match="point: expected metres"):
        PathMemory(0.05).add([1e12, 0.0])


def test_another_seed_damages_in_other_ways_and_none_as_ever(monkeypatch):
    def drawn(seed):
        monkeypatch.setattr(fuzzing, "SEED", seed)
        return fuzzing.damage(3).integers(2**60, size=4).tolist()

    assert drawn(0) == np.random.default_rng(3).integers(2**60, size=4).tolist()
    assert drawn(7) == drawn(7)
    assert drawn(0) != drawn(7) != drawn(8)
