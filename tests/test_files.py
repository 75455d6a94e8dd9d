"""Archives: read with a limit, refused by name, whatever is in them."""

import contextlib
import gzip
import sys
import zipfile

import numpy as np
import pytest

from slamlab._files import read_bytes, read_npz
from slamlab.datasets.rosbag import read_rosbag
from slamlab.localization import SignatureMap
from slamlab.logs import Log
from slamlab.mapping import OccupancyGrid
from slamlab.navigation import PathMemory
from slamlab.worlds import BitmapWorld


def test_plain_and_packed_files_read_the_same(tmp_path):
    text = b"a line\nand another"
    path = tmp_path / "a"
    path.write_bytes(text)
    assert read_bytes(path) == text
    path.write_bytes(gzip.compress(text))
    assert read_bytes(path) == text
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.g2o", text)
        archive.writestr("b.txt", b"")
    assert read_bytes(path, lambda name: name.endswith(".g2o")) == text
    with pytest.raises(ValueError, match="expected one file to read in it, got .*a.g2o"):
        read_bytes(path)
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "none")


def test_what_unpacks_to_too_much_is_not_unpacked(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(gzip.compress(bytes(10_000)))
    assert len(read_bytes(path, max_bytes=10_000)) == 10_000
    with pytest.raises(ValueError, match="it unpacks to more than 9999 bytes"):
        read_bytes(path, max_bytes=9999)
    np.savez_compressed(path.with_suffix(".npz"), a=np.zeros(10_000))
    with pytest.raises(ValueError, match="unpacks to .* bytes, more than 9999"):
        read_npz(path.with_suffix(".npz"), 9999)


@pytest.mark.parametrize("seed", range(3))
def test_damaged_archives_are_refused_and_nothing_else_comes_out(tmp_path, seed):
    rng, path = np.random.default_rng(seed), tmp_path / "a.npz"
    np.savez_compressed(path, a=np.arange(30.0), b=np.array("text"))
    good = path.read_bytes()
    refused = 0
    for _ in range(400):
        data = bytearray(good[: rng.integers(1, len(good) + 1)])
        for at in rng.integers(0, len(data), rng.integers(1, 6)):
            data[at] = rng.integers(256)
        path.write_bytes(bytes(data))
        refused += 1
        with contextlib.suppress(ValueError):
            read_npz(path)
            refused -= 1
        with contextlib.suppress(ValueError):
            read_bytes(path, lambda name: name == "a.npy")
    assert refused > 300


def test_an_array_whose_header_breaks_off_is_refused_by_name(tmp_path):
    # numpy hands such a header to Python's tokenizer, whose error is no ValueError.
    path = tmp_path / "a.npz"
    np.savez(path, times=np.arange(4.0))
    with zipfile.ZipFile(path) as archive:
        good = archive.read("times.npy")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("times.npy", good.replace(b"), }", b"(, {"))
    for read in (read_npz, Log.load, PathMemory.load, SignatureMap.load):
        with pytest.raises(ValueError, match="a.npz: expected a"):
            read(path)


@pytest.mark.parametrize("method", ["ZIP_DEFLATED", "ZIP_BZIP2", "ZIP_LZMA"])
def test_damaged_bytes_of_any_method_of_packing_are_refused_by_name(tmp_path, method):
    path, rng = tmp_path / "a.zip", np.random.default_rng(1)
    text = b"".join(b"%d " % n for n in rng.integers(0, 9999, 500))
    with zipfile.ZipFile(path, "w", getattr(zipfile, method)) as archive:
        archive.writestr("a.txt", text)
    good, refused = path.read_bytes(), 0
    for _ in range(100):
        data = bytearray(good)
        data[int(rng.integers(35, len(good) - 100))] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        refused += 1
        with contextlib.suppress(ValueError):
            assert read_bytes(path) == text
            refused -= 1
    assert refused > 90


def test_no_object_is_unpickled(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="expected a npz archive of arrays"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("missing", "call", "extra"),
    [
        ("PIL.Image", lambda path: BitmapWorld.from_file(path / "a.png"), "course"),
        ("yaml", lambda path: BitmapWorld.from_file(path / "a.yaml"), "course"),
        ("yaml", lambda path: OccupancyGrid((3, 3), 0.1).save_ros(path / "b.yaml"), "course"),
        ("rosbags.highlevel", lambda path: read_rosbag(path / "a.bag"), "maps"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(missing, call, extra, tmp_path, monkeypatch):
    for name in ("a.png", "a.yaml", "a.bag"):
        (tmp_path / name).write_bytes(b"a: 1")
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ImportError, match=rf"pip install .*slamlab-course\[{extra}\]"):
        call(tmp_path)
