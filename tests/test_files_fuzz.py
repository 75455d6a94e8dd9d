"""Every reader of files, fed with mutated ones: a value or a sentence, soon, and nothing else."""

import contextlib
import os
import resource
import time

import numpy as np
import pytest

from slamlab.datasets import read_carmen, read_relations, read_tum
from slamlab.localization import SignatureMap
from slamlab.logs import Log, ScanGeometry
from slamlab.mapping import OccupancyGrid
from slamlab.navigation import Cubic, PathMemory
from slamlab.sensors import Lidar
from slamlab.slam import PoseGraph, ScanGraphSlam, Sessions
from slamlab.worlds import BitmapWorld, rooms

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


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_read_or_refused_soon(tmp_path, name):
    write, read, count = READERS[name]
    path = tmp_path / "file.npz"
    path = write(path) or path
    good, rng = path.read_bytes(), np.random.default_rng(len(name))
    read(path)
    slowest, refused, before = 0.0, 0, peak()
    for _ in range(count * int(os.environ.get("SLAMLAB_FUZZ", "1"))):
        path.write_bytes(mutated(good, rng))
        begin = time.process_time()
        refused += 1
        with contextlib.suppress(ValueError, OSError):
            read(path)
            refused -= 1
        slowest = max(slowest, time.process_time() - begin)
    assert refused > 0.2 * count
    assert slowest < SECONDS
    assert peak() - before < MEGABYTES


def test_numbers_beyond_any_path_do_not_start_a_search_without_end():
    with pytest.raises(ValueError, match="coefficients: expected metres up to 1e"):
        Cubic(np.full((4, 2), 1e308))
    with pytest.raises(ValueError, match="point: expected metres"):
        PathMemory(0.05).add([1e12, 0.0])
