"""The lidar of P5 as its program prints it: `Scan` and `distancetodots`, faults included.

For the lessons only: chapters 06 and 08 put it beside `Lidar`. Everything is in pixels and in P5's
frame: beam 0 points up in the picture, the next ones turn clockwise, whatever the robot's heading.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count

__all__ = ["dots_as_printed", "scan_as_printed"]


def scan_as_printed(
    occupied: ArrayLike, column: int, row: int, resolution: int, guarded: bool = False
) -> list[int]:
    """P5's `Scan`: walk each beam from pixel to pixel along its longer side.

    `Distance` is not printed; the list holds whole numbers, taken here as rounded.

    Parameters
    ----------
    occupied : array_like of bool, shape (rows, columns)
        Row 0 at the bottom, as everywhere here; P5 counts from the top.
    column, row : int
        Pixel of the lidar.
    resolution : int
        Whole degrees between two beams.
    guarded : bool, default False
        Let a beam that leaves the picture end there instead of raising: it adds nothing to the
        list, and all later beams move up by one place.

    Returns
    -------
    list of int
        Distances from pixel centre to pixel centre; ``360 // resolution`` of them at most.

    Raises
    ------
    ValueError
        If an argument is wrong.
    IndexError
        If a beam leaves the picture, as `GetPixel` does.
    """
    cells = as_array("occupied", occupied, ("rows", "columns")) > 0
    column, row = as_count("column", column), as_count("row", row)
    resolution = as_count("resolution", resolution, 1)
    distances = []
    for i in range(360 // resolution):
        angle = np.deg2rad(i * resolution)
        step = np.array([np.cos(angle), np.sin(angle)])  # rows up, columns to the right
        # One pixel at a time along the longer side, rounded to the nearest pixel.
        j = np.arange(sum(cells.shape))[:, None]
        pixels = np.rint((row, column) + j * step / np.abs(step).max()).astype(int)
        inside = ((pixels >= 0) & (pixels < cells.shape)).all(1)
        walked = pixels[: len(pixels) if inside.all() else int(inside.argmin())]
        hit = cells[walked[:, 0], walked[:, 1]]
        if hit.any():
            distances.append(round(float(np.hypot(*(walked[hit.argmax()] - (row, column))))))
        elif not guarded:
            raise IndexError(f"beam {i} leaves the picture: GetPixel has no such pixel")
    return distances


def dots_as_printed(distances: ArrayLike) -> Array:
    """P5's `distancetodots`: the dots of a scan around the robot.

    Parameters
    ----------
    distances : array_like, shape (n,)
        What `scan_as_printed` returned (px).

    Returns
    -------
    ndarray, shape (n, 2)
        Columns to the right and rows up, from the lidar (px). The angle between two dots is
        ``360 // n`` degrees, in whole numbers: 0 if n is more than 360.

    Raises
    ------
    ValueError
        If there is no distance.
    """
    distances = as_array("distances", distances, ("n",))
    if len(distances) == 0:
        raise ValueError("distances: expected at least one, got none")
    angles = np.deg2rad((360 // len(distances)) * np.arange(len(distances)))
    return distances[:, None] * np.stack([np.sin(angles), np.cos(angles)], -1)
