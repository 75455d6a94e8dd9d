"""`map` and `graph` on files that something befell: an answer, or one sentence naming the file.

Every kind of file, every accident, every method, on small drives; seeded.
"""

import gzip
import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from slamlab.commands import main
from slamlab.commands import map as map_command
from slamlab.datasets.synthetic import manhattan_graph
from slamlab.geometry import between, compose
from slamlab.logs import Log
from slamlab.sensors import Lidar
from slamlab.worlds import rooms
from tests.fuzzing import ROUNDS, damage

SECONDS = 60.0  # of CPU at most for one call, compiling included
# What is said of a whole text; whatever breaks the format is said with its line.
WHOLE = (
    "cannot unpack", "equations overflow", "not determine", "on one floor", "near the map",
    "joined to a fixed pose",
)  # fmt: skip
N = 14
LIDAR = Lidar(61, field_of_view=np.pi, max_range=20.0, sigma_range=0.01)
X = np.linspace(1.0, 8.0, N)
PATH = np.column_stack([X, 4.0 + 0.2 * np.sin(X), 0.2 * np.cos(X)])
RANGES = LIDAR.scan(rooms.office(), PATH, np.random.default_rng(0))
MOTIONS = np.vstack([np.zeros(3), between(PATH[:-1], PATH[1:])])
METHODS = ("scan-graph", "hector", "odometry")
NUMBERS = (
    b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"300", b"1e7", b"-1", b"0", b"",
    b"9" * 30, b"9" * 400, b"1_0", b"0x10", b"abc", b"\xff", b"1e9999", "٣".encode(),
)  # fmt: skip


def npz(path):
    cov = np.diag(np.square([0.05, 0.02, 0.02]))
    dt = np.minimum(np.arange(N), 1.0)
    Log(np.arange(N), MOTIONS, dt, cov, ranges=RANGES, scan=LIDAR).save(path)


def carmen(path):
    lines, at = [], np.zeros(3)
    for k, (u, scan) in enumerate(zip(MOTIONS, RANGES, strict=True)):
        at = compose(at, u)
        pose = " ".join(f"{v:.6f}" for v in at)
        readings = " ".join(f"{min(r, 81.91):.3f}" for r in scan)
        lines.append(f"ODOM {pose} 0.5 0 0 {k}.0 robot {k}.0")
        lines.append(f"FLASER {len(scan)} {readings} {pose} {pose} {k}.0 robot {k}.0")
    path.write_text("\n".join(lines) + "\n")


def g2o(path):
    manhattan_graph(12, 18, np.random.default_rng(0)).graph.write_g2o(path)


def toro(path):
    g2o(path)
    words = [line.split() for line in path.read_text().splitlines()]
    order = [0, 1, 3, 5, 2, 4]  # of the upper triangle: xx, xy, yy, tt, xt, yt
    lines = []
    for tag, *rest in words:
        if tag == "EDGE_SE2":
            rest = rest[:5] + [rest[5 + i] for i in order]
        lines.append(" ".join([{"EDGE_SE2": "EDGE2"}.get(tag, "VERTEX2"), *rest]))
    path.write_text("\n".join(lines) + "\n")


# A slow machine also says how far it is.
LEFT = re.compile(r"^\d+ of \d+ \w+, \d+ %, .* left\n", re.MULTILINE)


def wrong(words, name, capsys):
    """What is wrong with the answer to these words about the file `name`, or None."""
    began = time.process_time()
    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always")
        try:
            code = main(words)
        except BaseException as error:
            return f"{words}: {type(error).__name__}: {error}"[:400]
    told = LEFT.sub("", capsys.readouterr().err)
    if time.process_time() - began > SECONDS:
        return f"{words}: {time.process_time() - began:.0f} s"
    if noted:
        return f"{words}: {noted[0].message}"
    if code == 1:
        named = told.startswith(f"slamlab {words[0]}: ") and name in told
        placed = not name.endswith(("log", "o")) or "line" in told or any(w in told for w in WHOLE)
        short = told.count("\n") == 1 and len(told) < 400
        return None if named and placed and short else f"{words}: {told}"
    notes = [line for line in told.splitlines() if " encountered" in line or "note:" not in line]
    if code or (words[0] == "map" and told) or notes:
        return f"{words}: {code}, {told}"
    if words[0] == "map" and not Path(words[3], "map.yaml").exists():
        return f"{words}: no map"
    return None


def asked(path, folder, capsys):
    """All complaints on one file, whichever method is asked."""
    if path.name.endswith((".g2o", ".toro")):
        calls = [["graph", str(path), "--kernel", kernel] for kernel in ("none", "dcs")]
    else:
        calls = [["map", str(path), "-o", str(folder), "--method", one] for one in METHODS]
    return [found for words in calls if (found := wrong(words, path.name, capsys))]


def cut(data, rng):
    return data[: int(rng.integers(len(data)))]


def flipped(data, rng):
    data = bytearray(data)
    for at in rng.integers(0, len(data), 4):
        data[at] = rng.integers(256)
    return bytes(data)


def doubled(data, rng):
    at, length = int(rng.integers(len(data))), int(rng.integers(1, 400))
    return data[:at] + data[at // 2 : at // 2 + length] + data[at + length // 2 :]


def shuffled(data, rng):
    lines = data.splitlines()
    return b"\n".join(lines[i] for i in rng.permutation(len(lines)))


def reversed_(data, rng):
    return b"\n".join(data.splitlines()[::-1]) + b"\n"


def line_lost(data, rng):
    lines = data.splitlines(keepends=True)
    del lines[int(rng.integers(len(lines)))]
    return b"".join(lines)


def line_again(data, rng):
    lines = data.splitlines(keepends=True)
    at = int(rng.integers(len(lines)))
    return b"".join([*lines[:at], lines[at], *lines[int(rng.integers(at + 1)) :]])


def last_line_open(data, rng):
    return data.rstrip(b"\n")


def of_windows(data, rng):
    return data.replace(b"\n", b"\r\n")


def one_line(data, rng):
    lines = data.splitlines(keepends=True)
    return lines[int(rng.integers(len(lines)))]


def word_lost(data, rng):
    return in_a_line(data, rng, lambda words, at: words[:at] + words[at + 1 :])


def word_again(data, rng):
    return in_a_line(data, rng, lambda words, at: [*words[:at], words[at], *words[at:]])


def number(data, rng):
    bad = NUMBERS[int(rng.integers(len(NUMBERS)))]
    return in_a_line(data, rng, lambda words, at: [*words[:at], bad, *words[at + 1 :]])


def number_at_the_end(data, rng):
    # Of a scan: a pose or a time; of an edge: its information.
    bad = NUMBERS[int(rng.integers(len(NUMBERS)))]
    back = -int(rng.integers(1, 10))
    return in_a_line(data, rng, lambda words, _: [*words[:back], bad, *words[back:][1:]])


def in_a_line(data, rng, change):
    lines = data.split(b"\n")
    at = int(rng.integers(len(lines)))
    words = lines[at].split(b" ")
    lines[at] = b" ".join(change(words, int(rng.integers(len(words)))))
    return b"\n".join(lines)


def empty(data, rng):
    return b""


def junk(data, rng):
    return rng.bytes(2000)


def zipped_and_cut(data, rng):
    return gzip.compress(data)[: -int(rng.integers(1, 200))]


BYTES = {
    f.__name__: (f, n) for f, n in [(cut, 8), (flipped, 8), (doubled, 4), (empty, 1), (junk, 2)]
}
LINES = {
    f.__name__: (f, n)
    for f, n in [
        (shuffled, 2), (reversed_, 1), (line_lost, 3), (line_again, 3), (last_line_open, 1),
        (of_windows, 1), (one_line, 3), (word_lost, 8), (word_again, 8), (number, 24),
        (number_at_the_end, 24), (zipped_and_cut, 2),
    ]
}  # fmt: skip
WRITERS = {"drive.log": carmen, "drive.npz": npz, "town.g2o": g2o, "town.toro": toro}
CASES = [
    (name, accident)
    for name in WRITERS
    for accident in (BYTES if name.endswith("npz") else BYTES | LINES)
]


@pytest.mark.parametrize(("name", "accident"), CASES)
def test_a_damaged_file_gives_an_answer_or_one_sentence(
    name, accident, tmp_path, capsys, monkeypatch, record_property
):
    path = tmp_path / name
    WRITERS[name](path)
    befall, times = (BYTES | LINES)[accident]
    whole, rng, complaints = path.read_bytes(), damage(len(name + accident)), []
    for trial in range(times * ROUNDS):
        path.write_bytes(befall(whole, rng))
        monkeypatch.setattr(map_command, "has", lambda name: trial == 0)  # noqa: B023
        complaints += asked(path, tmp_path / "out", capsys)
    record_property("files", times * ROUNDS)
    assert complaints == []


# Arrays of a log: name of the accident -> the arrays that are put in place of the good ones.
T, B = N, LIDAR.n_beams
AT = np.arange(N)[:, None] == 5
ARRAYS = {
    "nothing lost": {},
    "one scan": {"times": [0.0], "u": np.zeros((1, 3)), "dt": [0.0], "ranges": RANGES[:1]},
    "no scan": {"ranges": None},
    "no step": {k: np.zeros((0, n)) for k, n in (("u", 3), ("ranges", B))}
    | {"times": [], "dt": []},
    "no odometry": {"u": np.zeros((T, 3))},
    "no beams": {"ranges": np.zeros((T, 0)), "beam_angles": []},
    "one beam": {"ranges": RANGES[:, :1], "beam_angles": [0.0]},
    "another number of beams": {"ranges": RANGES[:, :-1]},
    "no lidar": {"beam_angles": None, "lidar": None},
    "half a lidar": {"lidar": [20.0]},
    "a lidar and more": {"lidar": [20.0, 0.0, 1.0]},
    "a lidar of nan": {"lidar": [np.nan, 0.0]},
    "a lidar without sight": {"lidar": [0.0, 0.0]},
    "a lidar of endless sight": {"lidar": [np.inf, 0.0]},
    "a lidar far ahead": {"lidar": [20.0, 1e300]},
    "beams of nan": {"beam_angles": np.full(B, np.nan)},
    "beams in one": {"beam_angles": np.zeros(B)},
    "beams of many turns": {"beam_angles": np.linspace(-1e12, 1e12, B)},
    "times going back": {"times": -np.arange(N)},
    "times standing still": {"times": np.zeros(N), "dt": np.zeros(N)},
    "times of nan": {"times": np.full(N, np.nan)},
    "times of 1e308": {"times": np.arange(N) * 1e307 - 5e307},
    "dt negative": {"dt": -np.ones(N)},
    "dt of 1e308": {"dt": np.full(N, 1e308)},
    "lost scans": {"ranges": np.where(AT, np.nan, RANGES)},
    "all scans lost": {"ranges": np.full((T, B), np.nan)},
    "nothing met": {"ranges": np.full((T, B), np.inf)},
    "all at zero": {"ranges": np.zeros((T, B))},
    "all at one": {"ranges": np.ones((T, B))},
    "a negative range": {"ranges": np.where(AT, -1.0, RANGES)},
    "ranges of 1e308": {"ranges": np.full((T, B), 1e308), "lidar": [np.inf, 0.0]},
    "scans of noise": {"ranges": np.random.default_rng(1).uniform(0, 20, (T, B))},
    "scans of half a number": {"ranges": RANGES.astype(np.float16)},
    "whole numbers": {"ranges": RANGES.astype(int), "u": np.rint(MOTIONS).astype(int)},
    "complex numbers": {"ranges": RANGES.astype(complex)},
    "words": {"ranges": RANGES.astype(str)},
    "yes and no": {"ranges": RANGES > 3},
    "a motion of nan": {"u": np.where(AT, np.nan, MOTIONS)},
    "a motion of 1e308": {"u": np.where(AT, 1e308, MOTIONS)},
    "a motion of 1e12": {"u": np.where(AT, 1e12, MOTIONS)},
    "a motion of 200 m": {"u": np.where(AT, 200.0, MOTIONS)},
    "a motion of 1e-320": {"u": np.where(AT, 1e-320, MOTIONS)},
    "many turns": {"u": MOTIONS + [0.0, 0.0, 1e9]},
    "motions in one row": {"u": MOTIONS.ravel()},
    "other controls": {"u": MOTIONS[:, :2], "control_cov": np.eye(2)},
    "two robots": {"u": np.stack([MOTIONS, MOTIONS], 1)},
    "sure of everything": {"control_cov": np.zeros((3, 3))},
    "sure of nothing": {"control_cov": 1e12 * np.eye(3)},
    "sure of 1e308": {"control_cov": 1e308 * np.eye(3)},
    "no covariance": {"control_cov": -np.eye(3)},
    "a note too many": {"note_hit": np.zeros(3)},
    "a thing of nothing": {"times": np.array(None, dtype=object)},
}


@pytest.mark.parametrize("accident", ARRAYS)
def test_damaged_arrays_give_a_map_or_one_sentence(accident, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(map_command, "has", lambda name: accident.startswith(("one", "all")))
    path = tmp_path / "drive.npz"
    npz(path)
    with np.load(path) as good:
        arrays = {name: good[name] for name in good.files} | ARRAYS[accident]
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    assert asked(path, tmp_path / "out", capsys) == []


@pytest.mark.parametrize("name", ["drive.npz", "drive.bag", "drive.log", "drive.log.gz", "drive"])
@pytest.mark.parametrize("write", [npz, carmen, g2o])
def test_a_file_of_the_wrong_kind_gives_a_map_or_one_sentence(name, write, tmp_path, capsys):
    path = tmp_path / "as.it.is"
    write(path)
    assert asked(path.rename(tmp_path / name), tmp_path / "out", capsys) == []
