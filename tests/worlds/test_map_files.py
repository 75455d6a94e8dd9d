"""Reading rooms from files: images, ROS maps, and what is wrong with them."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from slamlab.worlds import BitmapWorld

CELLS = np.array([[1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 1, 1]], bool)  # row 0 at the bottom
YAML = """image: room.png
resolution: 0.05
origin: [-1.0, 2.0, 0.0]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write(path, cells=CELLS):
    Image.fromarray(np.where(cells[::-1], 0, 255).astype(np.uint8)).save(path)
    return path


@pytest.mark.parametrize("suffix", ["bmp", "png", "pgm"])
def test_images_are_read_with_y_up(tmp_path, suffix):
    world = BitmapWorld.from_file(write(tmp_path / f"room.{suffix}"), 0.01)
    assert (world.occupied == CELLS).all()
    assert world.bounds == pytest.approx((0, 0, 0.04, 0.03))


def test_transparent_pixels_are_free_as_in_p5(tmp_path):
    pixels = np.zeros((3, 4, 4), np.uint8)
    pixels[..., 3] = np.where(CELLS[::-1], 255, 0)
    Image.fromarray(pixels).save(tmp_path / "room.png")
    assert (BitmapWorld.from_file(tmp_path / "room.png", 0.01).occupied == CELLS).all()


def test_a_room_drawn_in_light_colours_is_said_and_read_with_a_threshold(tmp_path):
    grey = np.where(CELLS[::-1], 230, 255).astype(np.uint8)
    Image.fromarray(grey).save(tmp_path / "light.png")
    with pytest.raises(ValueError, match=r"light.png: .*the darkest is 0.90, so give a threshold"):
        BitmapWorld.from_file(tmp_path / "light.png", 0.01)
    world = BitmapWorld.from_file(tmp_path / "light.png", 0.01, threshold=0.95)
    assert (world.occupied == CELLS).all()
    with pytest.raises(ValueError, match="threshold: expected a number in"):
        BitmapWorld.from_file(tmp_path / "light.png", 0.01, threshold=95)


@pytest.mark.parametrize("negate", [0, 1])
def test_ros_maps_bring_resolution_and_origin(tmp_path, negate):
    write(tmp_path / "room.png", ~CELLS if negate else CELLS)
    (tmp_path / "room.yaml").write_text(YAML.format(negate=negate))
    world = BitmapWorld.from_file(tmp_path / "room.yaml")
    assert (world.occupied == CELLS).all()
    assert world.bounds == pytest.approx((-1.0, 2.0, -0.8, 2.15))


def test_unknown_cells_of_a_ros_map_are_no_place_for_a_robot(tmp_path):
    grey = np.array([[0, 205, 254, 255]], np.uint8)
    Image.fromarray(grey).save(tmp_path / "room.png")
    (tmp_path / "room.yaml").write_text(YAML.format(negate=0))
    world = BitmapWorld.from_file(tmp_path / "room.yaml")
    assert world.occupied.tolist() == [[True, True, False, False]]


def huge_png(width, height):
    """A PNG file of 100 bytes that claims to be enormous."""
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(b"\0")), (b"IEND", b"")]
    packed = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("room.png", b"", "expected a readable image"),
        ("room.png", b"\x89PNG\r\n\x1a\nnonsense", "expected a readable image"),
        ("room.bmp", b"BM" + bytes(60), "expected a readable image"),
        ("room.pgm", b"P5 4 3 255\n\0\0", "expected a readable image"),
        ("room.pgm", b"P5 4 x 255\n", "expected a readable image"),
        ("room.txt", b"walls", "expected a readable image"),
        ("room.png", huge_png(9000, 9000), "expected at most 64000000 pixels, got 9000 x 9000"),
        ("room.png", huge_png(90000, 90000), "expected a"),
        ("room.yaml", b"image: [", "expected YAML"),
        ("room.yaml", b"\xff\xfe\x00", "expected YAML"),
        ("room.yaml", b"- 1\n", "missing"),
        ("room.yaml", b"image: a.png\nresolution: 1\n", "missing .'origin'"),
        ("room.yaml", b"a: 1\n" * 50_000, "expected a short YAML file"),
        ("room.yaml", b"!!python/object/apply:os.getcwd []", "expected YAML"),
        ("room.yaml", YAML.format(negate=7).encode(), "negate: expected a number in"),
        ("room.yaml", YAML.replace("0.0]", "0.5]").format(negate=0).encode(), "not turned"),
        ("room.yaml", YAML.replace("0.05", "-1").format(negate=0).encode(), "resolution: exp"),
        ("room.yaml", (YAML + "mode: raw\n").format(negate=0).encode(), "mode trinary or scale"),
        ("room.yaml", YAML.replace("0.65", "0.1").format(negate=0).encode(), "occupied_thresh"),
    ],
)
def test_a_bad_file_is_named(tmp_path, name, content, message):
    write(tmp_path / "room.png")
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        BitmapWorld.from_file(path, 0.01)
    assert "room" in str(caught.value)


def test_deep_images_and_truncated_ones_are_refused(tmp_path):
    Image.fromarray(np.zeros((3, 4), np.uint16)).save(tmp_path / "deep.png")
    with pytest.raises(ValueError, match="expected 8 bits a channel"):
        BitmapWorld.from_file(tmp_path / "deep.png", 0.01)
    whole = write(tmp_path / "room.png", np.random.default_rng(1).random((50, 50)) < 0.5)
    (tmp_path / "cut.png").write_bytes(whole.read_bytes()[:200])
    with pytest.raises(ValueError, match="expected a readable image"):
        BitmapWorld.from_file(tmp_path / "cut.png", 0.01)


def test_a_missing_file_and_a_missing_resolution(tmp_path):
    with pytest.raises(FileNotFoundError):
        BitmapWorld.from_file(tmp_path / "none.png", 0.01)
    with pytest.raises(ValueError, match="resolution: expected the side of a pixel"):
        BitmapWorld.from_file(write(tmp_path / "room.png"))


@pytest.mark.parametrize("cells", [np.zeros((0, 3)), [[0, 2]], [[0.0, np.nan]], [0, 1], "walls"])
def test_cells_that_are_none(cells):
    with pytest.raises(ValueError, match="occupied: expected"):
        BitmapWorld(cells, 1.0)


def test_a_yaml_file_that_unfolds_into_gigabytes_is_refused_at_once(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 8)}]" for k in range(1, 10)]
    path = tmp_path / "bomb.yaml"
    path.write_text("\n".join([*lines, "mode: *a9"]))
    with pytest.raises(ValueError, match="aliases, which a map does not need"):
        BitmapWorld.from_file(path)
