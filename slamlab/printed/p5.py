"""P5's program as its thesis prints it, faults included: the lidar, `CanMove`, two motions.

Chapters 06, 08 and 18 run these beside `sensors.Lidar`, `SquareRobot.drive_hits`, `turn_between`
and `motion_between`, which replace them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_scalar, as_shaped

__all__ = [
    "can_move_as_printed",
    "displacement_as_printed",
    "dots_as_printed",
    "forward_is_open_as_printed",
    "scan_as_printed",
    "turn_as_printed",
]


def scan_as_printed(
    occupied: ArrayLike, column: int, row: int, resolution: int, guarded: bool = False
) -> list[int]:
    """P5's `Scan`: walk each beam from pixel to pixel along its longer side.

    All in pixels and in P5's frame: beam 0 points up in the picture, the next ones turn
    clockwise, whatever the robot's heading.

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


def can_move_as_printed(ranges: ArrayLike, step: float) -> int:
    """P5's `CanMove`: whether the robot may go `step` ahead, and back.

    It compares the distance of every beam in the front quarter, [0, 45) and [315, 360) degrees,
    with the step, and forgets that the body reaches half a side beyond its centre. At 44 degrees
    it counts a wall at the side as a wall ahead. Its integer eighths skew the sectors when the
    number of beams is no multiple of eight. `robots.SquareRobot.drive_hits` is the right test.

    Parameters
    ----------
    ranges : array_like, shape (n_beams,)
        A full circle, beam 0 straight ahead. A beam that met nothing is longer than any step.
    step : float
        Metres.

    Returns
    -------
    int
        0 both ways open, 1 blocked backward, 2 blocked forward, 3 blocked both ways.

    Raises
    ------
    ValueError
        If there is no beam or `step` is negative.
    """
    ranges = as_shaped("ranges", ranges, ("n_beams",))
    if len(ranges) == 0:
        raise ValueError("ranges: expected at least one beam, got none")
    step = as_scalar("step", step, 0.0)
    eighth = len(ranges) // 8
    short = ranges < step
    forward = bool(short[:eighth].any() or short[eighth * 7 :].any())
    backward = bool(short[eighth * 3 : eighth * 5].any())
    return 2 * forward + backward


def forward_is_open_as_printed(ranges: ArrayLike, step: float) -> bool:
    """Answer of `can_move_as_printed` to a way ahead: a guard for `navigation.explore`.

    A lost beam (NaN) is taken as one that met nothing.
    """
    ranges = np.nan_to_num(as_shaped("ranges", ranges), nan=np.inf, posinf=np.inf)
    return can_move_as_printed(ranges, step) in (0, 1)


def turn_as_printed(before: ArrayLike, after: ArrayLike) -> NDArray[np.intp]:
    """P5's `Whatangle`: how many places the longest beam has moved. An index, no angle.

    Three faults: the result must still be multiplied by the angular resolution; it knows
    whole beams only; and the longest beam after the turn need not be the longest before.

    Parameters
    ----------
    before, after : array_like, shape (..., n_beams)
        Ranges of full-circle scans (m); leading axes broadcast.

    Returns
    -------
    ndarray of int, shape (...)
        Places, in [-n_beams / 2, n_beams / 2]. Half a turn comes back with either sign.

    Raises
    ------
    ValueError
        If the scans have no beams or not equally many.
    """
    before, after = _scans(before, after)
    n_beams = before.shape[-1]
    i, j = np.argmax(before, axis=-1), np.argmax(after, axis=-1)
    moved, half = i - j, n_beams // 2
    moved = np.where(
        moved >= half, moved - n_beams, np.where(moved <= -half, moved + n_beams, moved)
    )
    return moved.astype(np.intp)


def displacement_as_printed(before: ArrayLike, after: ArrayLike) -> Array:
    """P5's `whatmove`: by how much the beams to the back and to the front became shorter.

    Exact after a straight drive: the beams ahead and astern stay on one line and meet the same
    two points. A slip to the side or in heading breaks that, at an edge by any amount; and with
    an odd number of beams no beam points straight back.

    Parameters
    ----------
    before, after : array_like, shape (..., n_beams)
        Ranges of full-circle scans (m), beam 0 straight ahead; leading axes broadcast.

    Returns
    -------
    ndarray, shape (..., 2)
        Back and front (m): (-s, +s) after a step s forward.

    Raises
    ------
    ValueError
        If the scans have no beams or not equally many.
    """
    before, after = _scans(before, after)
    half = before.shape[-1] // 2
    return np.stack([before[..., half] - after[..., half], before[..., 0] - after[..., 0]], -1)


def _scans(before: ArrayLike, after: ArrayLike) -> tuple[Array, Array]:
    before = as_shaped("before", before, ("...", "n_beams"))
    if before.shape[-1] == 0:
        raise ValueError("before: expected at least one beam, got none")
    after = as_shaped("after", after, ("...", before.shape[-1]))
    first, second = np.broadcast_arrays(before, after)
    return first, second
