"""P5's program as its thesis prints it, faults included: lidar, `CanMove`, motions, `acf`.

Chapters 06, 08, 18 and 19 run these beside `sensors.Lidar`, `SquareRobot`, `turn_between` and
`autocorrelation`, which replace them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_count, as_scalar, as_shaped, as_tuple
from slamlab.models import World
from slamlab.sensors import Lidar

__all__ = [
    "RobotAsPrinted",
    "acf_as_printed",
    "can_move_as_printed",
    "displacement_as_printed",
    "dots_as_printed",
    "forward_is_open_as_printed",
    "nvec_as_printed",
    "scan_as_printed",
    "turn_as_printed",
    "turndot_as_printed",
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
        What `scan_as_printed` returned (px), at least one.

    Returns
    -------
    ndarray, shape (n, 2)
        Columns to the right and rows up, from the lidar (px). The angle between two dots is
        ``360 // n`` degrees, in whole numbers: 0 if n is more than 360.
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
        A full circle of at least one beam, beam 0 straight ahead. A beam that met nothing is
        longer than any step.
    step : float
        Metres, not negative.

    Returns
    -------
    int
        0 both ways open, 1 blocked backward, 2 blocked forward, 3 blocked both ways.
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
        Ranges of full-circle scans (m), at least one beam; leading axes broadcast.

    Returns
    -------
    ndarray of int, shape (...)
        Places, in [-n_beams / 2, n_beams / 2]. Half a turn comes back with either sign.
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
        Ranges of full-circle scans (m), at least one beam, beam 0 straight ahead; leading axes
        broadcast.

    Returns
    -------
    ndarray, shape (..., 2)
        Back and front (m): (-s, +s) after a step s forward.
    """
    before, after = _scans(before, after)
    half = before.shape[-1] // 2
    return np.stack([before[..., half] - after[..., half], before[..., 0] - after[..., 0]], -1)


def acf_as_printed(arr: Sequence[int], bits: int = 32) -> list[int]:
    """P5's `acf`, line by line, with the `int` of C#.

    `i <= arrtmp.Count()` runs once too often: n + 1 values, the last repeats the first. And `s`
    wraps at 2^31, so that rooms of some thousand pixels give negative sums of squares.

    Examples
    --------
    >>> acf_as_printed([5, 1, 4, 2, 8, 3])
    [119, 72, 103, 60, 103, 72, 119]
    """
    arr, tmp = [as_count("arr", x, -(2**63)) for x in as_tuple("arr", arr)], []
    if not arr:
        raise ValueError("arr: expected at least one distance, got none")
    arrtmp, half = list(arr), 2 ** (as_count("bits", bits, 2) - 1)
    i = 0
    while i <= len(arrtmp):
        s = 0
        for a, b in zip(arr, arrtmp, strict=True):
            product = (a * b + half) % (2 * half) - half
            s = (s + product + half) % (2 * half) - half
        tmp.append(s)
        arrtmp = [arrtmp[-1], *arrtmp[:-1]]  # arrayShiftRight
        i += 1
    return tmp


def nvec_as_printed(dot1: ArrayLike, dot2: ArrayLike) -> Array:
    """P5's `nvec`: the unit vector (2,) from dot2 to dot1; NaN if they are one point.

    Examples
    --------
    >>> nvec_as_printed([3, 4], [0, 0]).tolist()
    [0.6, 0.8]
    """
    difference = as_array("dot1", dot1, (2,)) - as_array("dot2", dot2, (2,))
    with np.errstate(invalid="ignore"):
        return np.asarray(difference / np.hypot(*difference))


def turndot_as_printed(dot: ArrayLike, centre: ArrayLike, degrees: float) -> Array:
    """P5's `Turndot`: a point (2,) turned about another, in the frame it is given.

    The old x is kept for the second line, as it must be. On P5's screen y points down, so that a
    positive angle turns clockwise there.

    Examples
    --------
    >>> turndot_as_printed([2, 1], [1, 1], 90).round(9).tolist()
    [1.0, 2.0]
    """
    (x, y), (cx, cy) = as_array("dot", dot, (2,)), as_array("centre", centre, (2,))
    angle, xt = np.deg2rad(as_scalar("degrees", degrees)), x
    x = cx + (x - cx) * np.cos(angle) - (y - cy) * np.sin(angle)
    y = cy + (y - cy) * np.cos(angle) + (xt - cx) * np.sin(angle)
    return np.array([x, y])


class RobotAsPrinted:
    r"""P5's `Move` and `Turn`, which note on a stack what two scans say of each motion.

    The robot itself is set exactly; nothing asks for obstacles here (`CanMove` does elsewhere).

    Parameters
    ----------
    world : World
    lidar : Lidar
        A full circle.
    pose : array_like, shape (3,)
    pixel : float, default 0.01
        Side of a pixel (m): P5's list of distances holds whole ones.

    Attributes
    ----------
    pose : ndarray, shape (3,)
        The true one.
    stack : list of str
        ``"m\n<back>\n<front>"`` in pixels after a drive, ``"t\n<places>"`` after a turn.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> robot = RobotAsPrinted(rooms.thesis_room(), Lidar(120), [2.0, 2.4, 0.0])
    >>> robot.move(20)
    >>> robot.turn(25)  # 8 places of 3 degrees are 24
    >>> robot.stack
    ['m\n-20\n20', 't\n8']
    """

    def __init__(self, world: World, lidar: Lidar, pose: ArrayLike, pixel: float = 0.01) -> None:
        self._world, self._lidar = world, lidar
        self._pixel = as_scalar("pixel", pixel, 1e-9, 1e9)
        self.pose, self.stack = as_array("pose", pose, (3,)).copy(), list[str]()

    def _scan(self) -> Array:
        return np.rint(self._lidar.scan(self._world, self.pose) / self._pixel)

    def move(self, step: float) -> None:
        """Drive `step` pixels ahead."""
        tmp0 = self._scan()
        way = as_scalar("step", step) * self._pixel
        self.pose = self.pose + way * np.array([np.cos(self.pose[2]), np.sin(self.pose[2]), 0])
        back, front = displacement_as_printed(tmp0, self._scan())
        self.stack.append(f"m\n{back:.0f}\n{front:.0f}")

    def turn(self, angle: float) -> None:
        """Turn by `angle` degrees on the spot."""
        tmp0 = self._scan()
        self.pose = self.pose + [0.0, 0.0, np.deg2rad(as_scalar("angle", angle))]
        self.stack.append(f"t\n{turn_as_printed(tmp0, self._scan())}")


def _scans(before: ArrayLike, after: ArrayLike) -> tuple[Array, Array]:
    before = as_shaped("before", before, ("...", "n_beams"))
    if before.shape[-1] == 0:
        raise ValueError("before: expected at least one beam, got none")
    after = as_shaped("after", after, ("...", before.shape[-1]))
    first, second = np.broadcast_arrays(before, after)
    return first, second
