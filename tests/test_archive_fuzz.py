"""Archives that are whole but hold wrong arrays: refused with the file's name, or of use.

`test_files_fuzz` damages bytes, which the checksums of an archive catch; here one array after the
other is put into a sound archive in a wrong form, and what loads must do its work.
"""

import os

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.geometry import between
from slamlab.localization import DeadReckoning, SignatureMap
from slamlab.logs import Log, ScanGeometry
from slamlab.navigation import PathMemory
from slamlab.robots import Unicycle
from slamlab.sensors import Lidar
from slamlab.slam import ScanGraphSlam, Sessions
from slamlab.worlds import rooms


def path_memory(path):
    memory = PathMemory(0.05, "two-points-derivative", loop_accuracy=1e-3)
    for t in np.linspace(0.5, 6.5, 150):
        memory.add([np.sin(t), np.sin(2 * t)])
    memory.save(path)


def walk_back(memory):
    s = np.linspace(0.0, memory.length, 20) if memory.n_points else []
    points = memory.point_at(s) if memory.n_points else np.zeros((1, 2))
    if memory.n_points:
        memory.nearest(points + 0.01)
    memory.add(points[-1] + [0.02, 0.01])
    memory.close()
    assert memory.loops is not None
    assert np.isfinite(memory.length)


def log(path):
    scan = ScanGeometry(np.linspace(-1, 1, 5), 9.0)
    Log(
        np.arange(4.0), np.ones((4, 2)), 1.0, np.eye(2) * 0.01, ranges=np.ones((4, 5)), scan=scan,
        landmark_measurements=[np.ones((2, 2)), [], [], np.ones((1, 2))],
        ids=[[1, 2], [], [], [1]],
        truth=np.zeros((4, 3)), landmarks=np.ones((3, 2)), notes={"hit": np.zeros(4, bool)},
        controls="velocity",
    ).save(path)  # fmt: skip


def drive(found):
    assert len(repr(found)) < 300
    for step in found[:3]:
        assert np.isfinite(step.u).all()
    if found.u.ndim == 2 and found.u.shape[1] == 2:
        run(DeadReckoning(Unicycle(), np.zeros(3)), found)
    if found.ranges is not None and found.scan is not None:
        found.scan.points(found.ranges)


def signature_map(path):
    SignatureMap.build(rooms.thesis_room(), Lidar(24), 60, progress=False).save(path)


def find_place(found):
    if found.n_beams < 10_000:
        found.locate(1.0 + 0.1 * np.arange(found.n_beams))


def sessions(path):
    """A map of two drives through an office, and one through another room that waits."""
    lidar, found = Lidar(60, max_range=8.0), None
    ends = (([1.0, 4.0, 0.0], [7.0, 4.0, 0.0]), ([7.0, 4.2, 3.0], [1.0, 4.2, 3.0]))
    office, room = rooms.office(), rooms.thesis_room()
    for world, (start, end) in (
        (office, ends[0]),
        (office, ends[1]),
        (room, ([0.5] * 3, [1.5] * 3)),
    ):
        poses = np.linspace(start, end, 24)
        u = np.vstack([np.zeros(3), between(poses[:-1], poses[1:])])
        log = Log(
            np.arange(24.0), u, np.r_[0.0, np.ones(23)], 1e-4 * np.eye(3),
            ranges=lidar.scan(world, poses), scan=lidar,
        )  # fmt: skip
        system = run(ScanGraphSlam(lidar), log).system
        if found is None:
            found = Sessions(system, log, "first")
        else:
            found.add(system, log, "another")
    assert len(found.drives) == 2
    assert len(found.waiting) == 1
    found.save(path)


def go_on(found):
    graph = found.graph()
    assert np.isfinite(graph.residuals()).all()
    for one in [*found.drives, *found.waiting]:
        assert np.isfinite(one.trajectory).all()
    found.save(os.devnull)


FORMATS = {
    "path memory": (path_memory, PathMemory.load, walk_back),
    "log": (log, Log.load, drive),
    "map of drives": (sessions, Sessions.load, go_on),
    "signature map": (signature_map, SignatureMap.load, find_place),
}
CHANGES = {
    "nan": lambda a: np.full(a.shape, np.nan),
    "infinity": lambda a: np.full(a.shape, np.inf),
    "1e308": lambda a: np.full(a.shape, 1e308),
    "minus one": lambda a: np.full(a.shape, -1),
    "zero": lambda a: np.zeros(a.shape),
    "2 to the 63": lambda a: np.full(a.shape, 2**63, np.uint64),
    "one nan": lambda a: np.where(np.arange(a.size).reshape(a.shape) == a.size // 2, np.nan, a),
    "words": lambda a: np.full(a.shape, "word"),
    "bytes": lambda a: np.full(a.shape, b"word"),
    "complex": lambda a: np.full(a.shape, 1j),
    "dates": lambda a: np.zeros(a.shape, "M8[s]"),
    "nothing": lambda a: np.zeros((0, *a.shape[1:])),
    "a number": lambda a: np.float64(1.0),
    "a row more": lambda a: np.concatenate([a, a[-1:]]) if a.ndim and len(a) else a[None],
    "a row less": lambda a: a[:-1] if a.ndim else a[None],
    "an axis more": lambda a: a[None],
    "flat": lambda a: a.ravel(),
    "transposed": lambda a: a.T,
    "reversed": lambda a: a[::-1] if a.ndim else a,
    "foreign": lambda a: a.astype(a.dtype.newbyteorder("S")),
    "no array": lambda a: None,
}


def outcome(read, use, path):
    """Whether it was refused or of use; else what went wrong."""
    try:
        found = read(path)
    except ValueError as error:
        said = str(error)
        return "refused" if path.name in said and len(said) < 500 else f"said {said[:300]}"
    except Exception as error:
        return f"loading: {type(error).__name__}: {error}"
    try:
        with np.errstate(all="ignore"):
            use(found)
    except ValueError:
        return "of use"  # a sentence on what is asked of it
    except Exception as error:
        return f"using: {type(error).__name__}: {error}"
    return "of use"


@pytest.mark.parametrize("name", FORMATS)
def test_a_wrong_array_in_a_sound_archive_is_refused_or_does_no_harm(
    name, tmp_path, record_property
):
    write, read, use = FORMATS[name]
    path = tmp_path / "file.npz"
    write(path)
    with np.load(path) as kept:
        good = dict(kept)
    assert outcome(read, use, path) == "of use"
    found = {}
    for key, array in good.items():
        for what, change in CHANGES.items():
            try:
                arrays = good | {key: change(array)}
            except (TypeError, ValueError):  # of words no such change
                continue
            with_it = {k: v for k, v in arrays.items() if v is not None}
            np.savez(path, **with_it)
            found[key, what] = outcome(read, use, path)
    record_property("files", len(found))
    bad = {k: v for k, v in found.items() if v not in ("refused", "of use")}
    assert bad == {}
    assert list(found.values()).count("refused") > 0.3 * len(found)
