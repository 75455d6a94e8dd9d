"""Occupancy grid: free, occupied or never seen, a probability a cell (Moravec and Elfes 1985).

Every beam is evidence: the cells it crossed are free, the cell it ended in is not. Evidence adds
up as log odds. Chapter 00 shows one, chapter 08 builds it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import Array, as_array, as_distances, as_scalar
from slamlab._optional import needed
from slamlab.grids import Grid
from slamlab.kernels import compiled
from slamlab.models import ScanSensor, as_scan_sensor

__all__ = ["OccupancyGrid"]

_STRIP = 256  # rows of an image that are worked out at a time


class OccupancyGrid(Grid):
    """A map of square cells, each with the probability that it is occupied.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns; row 0 is at the bottom, column 0 at the left.
    resolution : float
        Side of a cell (m).
    origin : array_like, shape (2,), default (0, 0)
        Lower left corner of the map in the world (m).
    p_hit : float, default 0.7
        Probability that a cell is occupied, given that one beam ended in it; in [0.5, 1).
    p_miss : float, default 0.4
        The same, given that one beam crossed it; in (0, 0.5].
    clamp : float, default 0.97
        No probability leaves [1 - clamp, clamp], so that the map can still change its mind.
    grow : bool, default True
        Enlarge the map when a beam leaves it. If False, beams are cut at its edge.

    Attributes
    ----------
    log_odds : ndarray, shape (rows, columns)
        Logarithm of p / (1 - p); 0 where nothing was seen.

    Examples
    --------
    >>> from slamlab.logs import ScanGeometry
    >>> grid = OccupancyGrid((1, 4), 1.0)
    >>> grid.insert([0.5, 0.5, 0.0], [2.0], ScanGeometry([0.0]))
    >>> grid.probability.round(2).tolist()
    [[0.4, 0.4, 0.7, 0.5]]
    """

    def __init__(
        self,
        shape: tuple[int, int],
        resolution: float,
        origin: ArrayLike = (0.0, 0.0),
        p_hit: float = 0.7,
        p_miss: float = 0.4,
        clamp: float = 0.97,
        grow: bool = True,
    ) -> None:
        super().__init__(shape, resolution, origin)
        below_one = float(np.nextafter(1.0, 0.0))
        self._hit = _log_odds(as_scalar("p_hit", p_hit, 0.5, below_one))
        self._miss = _log_odds(as_scalar("p_miss", p_miss, 1e-12, 0.5))
        self._limit = _log_odds(as_scalar("clamp", clamp, 0.5, below_one))
        self._grow = grow
        self.log_odds = np.zeros(self.shape)

    @property
    def probability(self) -> Array:
        """Probability that each cell is occupied, shape (rows, columns); 0.5 where unknown."""
        return _probability(self.log_odds)

    @property
    def entropy(self) -> Array:
        """Entropy of each cell (bits), shape (rows, columns); 1 where unknown."""
        # -p ln p - (1 - p) ln(1 - p) in terms of |log odds|, which never takes the log of 0.
        size = np.abs(self.log_odds)
        small = np.exp(-size)
        return (np.log1p(small) + size * small / (1 + small)) / np.log(2)

    def insert(
        self,
        pose: ArrayLike,
        ranges: ArrayLike,
        lidar: ScanSensor,
        max_range: float = np.inf,
        free_missing: bool = True,
    ) -> None:
        """Add the evidence of one scan, or of many scans one after the other.

        Within one scan a cell counts once: occupied if any beam ended in it, free if beams only
        crossed it.

        Parameters
        ----------
        pose : array_like, shape (3,) or (n, 3)
            Poses of the body in the world (m, m, rad).
        ranges : array_like, shape (n_beams,) or (n, n_beams)
            Measured ranges (m), not negative; inf, or ``lidar.max_range`` and more, is a beam that
            met nothing; NaN is a lost reading and says nothing.
        lidar : ScanSensor
            Knows `beam_angles`, `max_range` and `offset`.
        max_range : float, default inf
            Trust beams up to this distance (m): longer ones free the cells before it and hit none.
        free_missing : bool, default True
            Whether a beam that met nothing frees the cells up to the smaller of `max_range` and
            ``lidar.max_range``. If False it says nothing: glass, black and slanting walls send no
            beam back, and maps of real scans lose walls to beams that claim to have met nothing.
            The command ``map`` uses False.

        Raises
        ------
        ValueError
            If a beam that met nothing should free cells without end, or the map would grow beyond
            64 million cells.
        """
        poses = as_array("pose", pose, ("...", 3))
        angles = np.asarray(as_scan_sensor("lidar", lidar).beam_angles, dtype=float)
        scans = as_distances("ranges", ranges, (*poses.shape[:-1], len(angles)))
        trusted = min(as_scalar("max_range", max_range, 0.0), float(lidar.max_range))
        met_nothing = scans >= lidar.max_range
        if free_missing and met_nothing.any() and not np.isfinite(trusted):
            raise ValueError(
                "max_range: expected a finite range, up to which beams that met nothing free "
                "cells, got inf (or say free_missing=False)"
            )
        lengths = np.where(met_nothing, trusted if free_missing else np.nan, scans)
        hits = ~met_nothing & (lengths <= trusted)
        # Beyond a billion cells no map lies, and cell numbers stay whole numbers.
        lengths = np.minimum(lengths, min(trusted, 1e9 * self.resolution))
        poses, shape = poses.reshape(-1, 3), (-1, len(angles))
        starts, ends = _beams(poses, lengths.reshape(shape), angles, float(lidar.offset))
        if self._grow:
            self._make_room(np.concatenate([starts.reshape(-1, 2), ends.reshape(-1, 2)]))
        self._add(starts, ends, hits.reshape(shape))

    def to_image(self) -> NDArray[np.uint8]:
        """Return the map as grey values, the way ROS draws it.

        Returns
        -------
        ndarray of uint8, shape (rows, columns)
            0 occupied (probability above 0.65), 254 free (below 0.35), 205 unknown. The first row
            is the top of the map.
        """
        image = np.full(self.shape, 205, dtype=np.uint8)
        for top in range(0, len(image), _STRIP):  # as a whole, probabilities need 24 bytes a cell
            probability = _probability(self.log_odds[::-1][top : top + _STRIP])
            strip = image[top : top + _STRIP]
            strip[probability > 0.65] = 0
            strip[probability < 0.35] = 254
        return image

    def save_ros(self, path: str | Path) -> None:
        """Write the map as ROS' `map_server` does: a YAML file and beside it a PGM image.

        ``BitmapWorld.from_file`` reads it back, unknown cells as occupied.

        Parameters
        ----------
        path : str or Path
            Name of the YAML file, ending in ``.yaml``; the image has the same name and ``.pgm``.
        """
        yaml = needed("yaml", "maps of ROS", package="pyyaml")
        Image = needed("PIL.Image", "images", package="pillow")
        path = Path(path)
        if path.suffix != ".yaml":
            raise ValueError(f"path: expected a name ending in .yaml, got {path.name!r}")
        image_path = path.with_suffix(".pgm")
        entries = {
            "image": image_path.name,
            "resolution": self.resolution,
            "origin": [*map(float, self.origin), 0.0],
            "negate": 0,
            # These belong to the grey values 0, 205 and 254, whatever was drawn as which.
            "occupied_thresh": 0.65,
            "free_thresh": 0.196,
        }
        Image.fromarray(self.to_image()).save(image_path)
        path.write_text(yaml.safe_dump(entries, sort_keys=False))

    def _add(self, starts: Array, ends: Array, hits: NDArray[np.bool_]) -> None:
        """Add scans: beams from starts (n, 2) to ends (n, k, 2), in the world."""
        starts = (starts - self.origin) / self.resolution
        ends = (ends - self.origin) / self.resolution
        near = np.abs(starts).max(1, initial=0.0) < 1e9  # others cannot reach the map
        for start, end, hit in zip(starts[near], ends[near], hits[near], strict=True):
            insert_scan(self.log_odds, start, end, hit, self._hit, self._miss, self._limit)

    def _make_room(self, points: Array) -> None:
        """Enlarge the map until it holds all points (n, 2)."""
        try:
            added = self.grow(points)
        except ValueError as error:
            raise ValueError(f"{error} (give max_range, or grow=False)") from None
        if added is not None:
            self.log_odds = np.pad(self.log_odds, added)


@compiled("occupancy.insert_scan")
def insert_scan(
    log_odds: Array,
    start: Array,
    ends: Array,
    hit: NDArray[np.bool_],
    gain: float,
    loss: float,
    limit: float,
) -> None:
    """Add one scan to log odds (rows, columns): each cell gains or loses once.

    Beams run from `start` (2,) to `ends` (k, 2: x, y in cells; NaN is no beam); those that `hit`
    (k,) end in an occupied cell. Log odds stay within [-limit, limit].
    """
    rows, columns = log_odds.shape
    size = np.array([columns, rows])
    crossed = [cells_of_beam(start, end, size) for end in ends if np.isfinite(end[0])]
    free = _inside(np.concatenate([np.zeros((0, 2), int), *crossed]), size)
    occupied = _inside(np.floor(ends[hit]), size)
    for cells, evidence in ((occupied, gain), (np.setdiff1d(free, occupied), loss)):
        row, column = cells // columns, cells % columns
        # l_k = l_{k-1} + l(z_k), chapter 08: the old log odds plus those of the reading.
        log_odds[row, column] = np.clip(log_odds[row, column] + evidence, -limit, limit)


def cells_of_beam(start: Array, end: Array, size: Array) -> NDArray[np.int64]:
    """Cells (k, 2: column, row) that a beam crosses, in order; -1 and `size` are "outside".

    `start`, `end` (2,) and `size` (columns, rows) are in cells.
    """
    first, last = (np.clip(np.floor(p), -1, size).astype(int) for p in (start, end))
    shares, steps = [], []
    for axis in (0, 1):  # a step at every grid line that is crossed
        way = 1 if last[axis] > first[axis] else -1
        lines = np.arange(first[axis], last[axis], way) + (way > 0)
        shares.append((lines - start[axis]) / (end[axis] - start[axis] or 1.0))
        steps.append(np.tile(way * np.eye(2, dtype=int)[axis], (len(lines), 1)))
    order = np.argsort(np.concatenate(shares), kind="stable")  # through a corner: columns first
    return first + np.concatenate([[[0, 0]], np.cumsum(np.concatenate(steps)[order], axis=0)])


def _inside(cells: Array, size: Array) -> NDArray[np.int64]:
    """Numbers, row after row, of the cells (k, 2) that lie on the map, each once."""
    column, row = cells[((cells >= 0) & (cells < size)).all(1)].astype(int).T
    return np.unique(row * size[0] + column)


def _probability(log_odds: Array) -> Array:
    return 1 / (1 + np.exp(-log_odds))


def _log_odds(p: float) -> float:
    return float(np.log(p / (1 - p)))


def _beams(poses: Array, lengths: Array, angles: Array, offset: float) -> tuple[Array, Array]:
    """Start (n, 2) and end points (n, k, 2) of the beams in the world."""
    heading = poses[:, 2]
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
    starts = poses[:, :2] + offset * ahead
    beams = heading[:, None] + angles
    direction = np.stack([np.cos(beams), np.sin(beams)], -1)
    return starts, starts[:, None] + lengths[..., None] * direction
