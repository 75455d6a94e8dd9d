"""Images and ROS maps as occupied cells, read with suspicion: size first, then content."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import as_array, as_scalar, shown
from slamlab._optional import needed

MOST_PIXELS = 64_000_000
_STRIP = 256  # rows of a transparent image that are laid on white at a time
MOST_YAML_BYTES = 10_000
_BROKEN = (OSError, ValueError, SyntaxError, EOFError, LookupError, TypeError, OverflowError)


class MapImage(NamedTuple):
    """Occupied cells (row 0 at the bottom), resolution (m) if known, lower left corner (m)."""

    occupied: NDArray[np.bool_]
    resolution: float | None
    origin: tuple[float, float]


def read_map(path: Path, threshold: float = 0.5, unknown: bool = True) -> MapImage:
    """Read an image or a map of ROS; `BitmapWorld.from_file` says what it means."""
    threshold = as_scalar("threshold", threshold, 0.0, 1.0)
    if path.suffix.lower() in (".yaml", ".yml"):
        return _read_ros(path, unknown)
    grey = read_grey(path)
    occupied = grey < 255 * threshold
    if not occupied.any():
        wanted = f"pixels darker than {threshold:g} of white, for walls"
        hint = f"the darkest is {grey.min() / 255:.2f}, so give a threshold above that"
        raise ValueError(f"{path}: expected {wanted}, found none; {hint}")
    return MapImage(occupied, None, (0.0, 0.0))


def read_grey(path: Path) -> NDArray[np.uint8]:
    """Grey values (rows, columns) of an image, row 0 at the bottom; transparent is white."""
    Image = _pillow()
    with path.open("rb") as file:
        image = _guarded(path, lambda: Image.open(file))
        # Only the head of the file has been read so far.
        if image.width * image.height > MOST_PIXELS:
            size = f"{image.width} x {image.height}"
            raise ValueError(f"{path}: expected at most {MOST_PIXELS} pixels, got {size}")
        if image.mode.startswith(("I", "F")):
            raise ValueError(f"{path}: expected 8 bits a channel, got mode {image.mode}")
        return _guarded(path, lambda: _grey(image))[::-1]


def _grey(image: Any) -> NDArray[np.uint8]:
    Image = _pillow()
    if not image.has_transparency_data:
        return np.asarray(image.convert("L"))
    grey = np.empty((image.height, image.width), np.uint8)
    for top in range(0, image.height, _STRIP):  # in strips: as a whole it takes 12 bytes a pixel
        bottom = min(top + _STRIP, image.height)
        strip = image.crop((0, top, image.width, bottom)).convert("RGBA")
        on_white = Image.alpha_composite(Image.new("RGBA", strip.size, "white"), strip)
        grey[top:bottom] = np.asarray(on_white.convert("L"))
    return grey


def _pillow() -> Any:
    return needed("PIL.Image", "reading images", package="pillow")


def _guarded(path: Path, read: Callable[[], Any]) -> Any:
    """Let Pillow read, and name the file whatever goes wrong in it."""
    try:
        return read()
    except (*_BROKEN, struct.error, _pillow().DecompressionBombError) as error:
        raise ValueError(f"{path}: expected a readable image, got: {error}") from error


def _read_ros(path: Path, unknown: bool) -> MapImage:
    yaml = needed("yaml", "maps of ROS", package="pyyaml")
    if path.stat().st_size > MOST_YAML_BYTES:
        raise ValueError(f"{path}: expected a short YAML file, got {path.stat().st_size} bytes")
    try:
        text = path.read_text()
        # An alias can make 440 bytes unfold into gigabytes; a map needs none.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)):
            raise ValueError("aliases, which a map does not need")
        entries = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected YAML, got: {str(error)[:200]}") from error
    due = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
    missing = [k for k in due if not isinstance(entries, dict) or k not in entries]
    if missing:
        raise ValueError(f"{path}: expected the entries of a ROS map, missing {missing}")
    origin = as_array(f"{path}: origin", entries["origin"], (3,))
    if origin[2] != 0:
        raise ValueError(f"{path}: expected a map that is not turned, got yaw {origin[2]:g}")
    image = str(entries["image"])
    if not 0 < len(image) <= 255 or not image.isprintable():
        raise ValueError(f"{path}: expected the name of an image, got {shown(image)}")
    solid = _solid(path, entries, read_grey(path.parent / image) / 255.0, unknown)
    resolution = as_scalar(f"{path}: resolution", entries["resolution"], 1e-9, 1e9)
    return MapImage(solid, resolution, tuple(origin[:2]))


def _solid(
    path: Path, entries: dict[str, Any], grey: NDArray[np.float64], unknown: bool
) -> NDArray[np.bool_]:
    """Cells that are occupied, or unknown where that counts."""
    if entries.get("mode", "trinary") not in ("trinary", "scale"):
        raise ValueError(f"{path}: expected mode trinary or scale, got {entries['mode']!r:.80}")
    negate = as_scalar(f"{path}: negate", entries["negate"], 0.0, 1.0)
    free = as_scalar(f"{path}: free_thresh", entries["free_thresh"], 0.0, 1.0)
    solid = as_scalar(f"{path}: occupied_thresh", entries["occupied_thresh"], free, 1.0)
    # ROS: black is occupied, unless negated.
    probability = grey if negate else 1.0 - grey
    return probability >= free if unknown else probability > solid
