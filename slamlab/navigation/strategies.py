"""Where to go next: strategies of exploration behind one protocol.

P5's three (longest beam, random fraction of it, four quadrants), the nearest frontier of Yamauchi
(1997) and the expected information of Gonzalez-Banos and Latombe (2002). Chapter 18.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slamlab._checks import Array, as_positive, as_scalar
from slamlab.navigation.exploration_grid import ExplorationGrid, box_of
from slamlab.sensors.lidar import Lidar

__all__ = [
    "InformationGain",
    "LongestBeam",
    "NearestFrontier",
    "Quadrants",
    "RandomFraction",
    "Situation",
    "Strategy",
]


@dataclass(frozen=True)
class Situation:
    """What a strategy may know when it chooses.

    Attributes
    ----------
    pose : ndarray, shape (3,)
        Where the robot believes it is (m, m, rad).
    ranges : ndarray, shape (n_beams,)
        The scan taken here (m).
    lidar : Lidar
    floor : ExplorationGrid
        Everything seen so far, this scan included.
    body_length : float
        Of the robot (m).
    body_radius : float
        Radius (m) of the disc that needs room on a way: where it fits, the body does.
    refused : bool
        Whether the last choice could not even be begun.
    came_from : float or None
        Direction in the world (rad) from here to where the robot last came from.
    """

    pose: Array
    ranges: Array
    lidar: Lidar
    floor: ExplorationGrid
    body_length: float
    body_radius: float
    refused: bool = False
    came_from: float | None = None

    @property
    def beams(self) -> tuple[Array, Array]:
        """Directions in the world (rad) and lengths (m) of the beams; a lost one has length 0.

        A beam that met nothing is as long as the lidar sees, or as the floor is wide.
        """
        left, right, bottom, top = self.floor.extent
        longest = min(self.lidar.max_range, float(np.hypot(right - left, top - bottom)))
        lengths = np.minimum(np.nan_to_num(self.ranges, nan=0.0, posinf=longest), longest)
        return self.pose[2] + self.lidar.beam_angles, lengths

    def ahead(self, direction: float, distance: float) -> Array:
        """Return the point (1, 2) at a distance (m) in a direction of the world (rad)."""
        way = distance * np.array([np.cos(direction), np.sin(direction)])
        return (self.pose[:2] + way)[None]


class Strategy(Protocol):
    """Chooses where to go. Anything with this method can be given to an `Explorer`.

    A strategy that wants the robot home again returns ``now.floor.plan(now.pose[:2], home,
    now.body_radius)`` when it has seen enough.
    """

    def choose(self, now: Situation, rng: np.random.Generator) -> Array | None:
        """Return points (k, 2) to drive through one after the other (m), None to stop."""


class LongestBeam:
    """P5's first rule: turn to the longest beam and drive a fixed part of it.

    Where nothing else is said the thesis falls into its own trap: at the end of a diagonal the
    longest beam points back along it (figure 15).

    Parameters
    ----------
    fraction : float, default 0.5
        Part of the beam to drive, in (0, 1]; "50 per cent, or any other number".

    Examples
    --------
    >>> from slamlab.navigation import Explorer
    >>> from slamlab.robots import SquareRobot
    >>> rng = np.random.default_rng(1)
    >>> Explorer(SquareRobot(0.3), Lidar(120), LongestBeam(0.5), rng)
    Explorer(LongestBeam)
    """

    def __init__(self, fraction: float = 0.5) -> None:
        self.fraction = as_positive("fraction", fraction, 1.0)

    def choose(self, now: Situation, rng: np.random.Generator) -> Array:
        """See `Strategy`; after a refusal a random direction is tried."""
        directions, lengths = now.beams
        beam = _longest(now, lengths, rng)  # at the end of a diagonal: back, figure 15
        return now.ahead(directions[beam], self.fraction * lengths[beam])  # half, or another part


class RandomFraction:
    """P5's second rule: the longest beam, and a random part of it.

    Parameters
    ----------
    as_printed : bool, default False
        Divide the length by a number drawn from [0.1, 2.0], as the text says: nearly half of the
        steps are then longer than the beam. The text's aim, "more than half", is met by a factor
        drawn from [0.5, 1], the default.

    Examples
    --------
    >>> from slamlab.navigation import Explorer
    >>> from slamlab.robots import SquareRobot
    >>> rng = np.random.default_rng(1)
    >>> Explorer(SquareRobot(0.3), Lidar(120), RandomFraction(), rng)
    Explorer(RandomFraction)
    """

    def __init__(self, as_printed: bool = False) -> None:
        self.as_printed = bool(as_printed)

    def choose(self, now: Situation, rng: np.random.Generator) -> Array:
        """See `Strategy`; after a refusal a random direction is tried."""
        directions, lengths = now.beams
        beam = _longest(now, lengths, rng)
        return now.ahead(directions[beam], _part(lengths[beam], self.as_printed, rng))  # at random


class Quadrants:
    """P5's third rule: the longest beam of one of four quarters, and not back (figure 16).

    The thesis does not say how the quarter is drawn. Here: the longest beam of each quarter around
    the robot is a candidate, those that lead back to where it came from (within 45 degrees) are
    dropped unless nothing else is left, and one of the rest is drawn.

    Parameters
    ----------
    as_printed : bool, default False
        Use the quarters of the text, 0-90, 90-180, **160**-270, 270-360 degrees, and its random
        division (see `RandomFraction`). Beams from 160 to 180 degrees then count twice.

    Examples
    --------
    >>> from slamlab.navigation import Explorer
    >>> from slamlab.robots import SquareRobot
    >>> rng = np.random.default_rng(1)
    >>> Explorer(SquareRobot(0.3), Lidar(120), Quadrants(), rng)
    Explorer(Quadrants)
    """

    def __init__(self, as_printed: bool = False) -> None:
        self.as_printed = bool(as_printed)

    def quarters(self, beam_angles: Array) -> NDArray[np.bool_]:
        """Which beams (n_beams,) belong to which quarter, shape (4, n_beams)."""
        degrees = np.mod(np.rad2deg(beam_angles), 360.0)
        low = np.array([0.0, 90.0, 160.0 if self.as_printed else 180.0, 270.0])
        high = np.array([90.0, 180.0, 270.0, 360.0])
        return (degrees >= low[:, None] - 1e-9) & (degrees < high[:, None] - 1e-9)

    def choose(self, now: Situation, rng: np.random.Generator) -> Array:
        """See `Strategy`; after a refusal a random direction is tried."""
        directions, lengths = now.beams
        inside = self.quarters(now.lidar.beam_angles)
        # The longest beam of each quarter, A to D of figure 16.
        best = np.argmax(np.where(inside, lengths, -1.0), axis=1)[inside.any(axis=1)]
        best = best[lengths[best] > now.body_length]
        if now.came_from is not None and len(best):
            # Not back, figure 16: more than 45 degrees from where it came.
            onward = best[np.cos(directions[best] - now.came_from) < np.sqrt(0.5)]
            best = onward if len(onward) else best
        if now.refused or len(best) == 0:
            beam = _any_open(now, lengths, rng)
        else:
            beam = int(rng.choice(best))
        return now.ahead(directions[beam], _part(lengths[beam], self.as_printed, rng))


class NearestFrontier:
    """Drive to the nearest place from which the edge of the unknown is at hand (Yamauchi 1997).

    Parameters
    ----------
    smallest : int, default 3
        Frontiers of fewer cells are left alone; at least 1.

    Examples
    --------
    >>> from slamlab.navigation import Explorer
    >>> from slamlab.robots import SquareRobot
    >>> rng = np.random.default_rng(1)
    >>> Explorer(SquareRobot(0.3), Lidar(120), NearestFrontier(), rng)
    Explorer(NearestFrontier)
    """

    def __init__(self, smallest: int = 3) -> None:
        self.smallest = int(as_scalar("smallest", smallest, 1, 1e9))

    def choose(self, now: Situation, rng: np.random.Generator) -> Array | None:
        """See `Strategy`; None when no frontier can be reached any more."""
        floor, radius = now.floor, now.body_radius
        _blacklist_stale(now)
        frontier = _large_parts(floor.frontier(), self.smallest)
        ways = floor.shortest_paths(now.pose[:2], radius)
        reachable = np.isfinite(ways.lengths)
        if not frontier.any() or not reachable.any():
            return None
        # A floor that grew is larger than what matters here.
        box = box_of(frontier | reachable)
        frontier, reachable, lengths = frontier[box], reachable[box], ways.lengths[box]
        # For every frontier cell the nearest cell where the robot can stand.
        gap, (row, column) = ndimage.distance_transform_edt(~reachable, return_indices=True)
        cost = np.where(frontier, lengths[row, column] + gap * floor.resolution, np.inf)
        cost[gap * floor.resolution > min(now.lidar.max_range, 2.0)] = np.inf
        best = np.unravel_index(np.argmin(cost), cost.shape)
        if not np.isfinite(cost[best]):
            return None
        goal = int(row[best]), int(column[best])
        # One visit a frontier: what it does not clear up is no way on.
        floor.blacklisted[box] |= frontier & (row == goal[0]) & (column == goal[1])
        return ways.to((goal[0] + box[0].start, goal[1] + box[1].start))


class InformationGain:
    """Drive where a scan shows much and the way is short: gain x exp(-decay x length).

    Parameters
    ----------
    decay : float, default 0.5
        How quickly a long way spoils a place (1/m), not negative.
    reach : float, default 2.0
        How far a scan is trusted to show something new (m), not negative; never more than the
        lidar sees.
    smallest : float, default 0.05
        Places that would show less than this (square metres, not negative) are left alone.

    Examples
    --------
    >>> from slamlab.navigation import Explorer
    >>> from slamlab.robots import SquareRobot
    >>> rng = np.random.default_rng(1)
    >>> Explorer(SquareRobot(0.3), Lidar(120), InformationGain(decay=0.5), rng)
    Explorer(InformationGain)
    """

    def __init__(self, decay: float = 0.5, reach: float = 2.0, smallest: float = 0.05) -> None:
        self.decay = as_scalar("decay", decay, 0.0, 1e6)
        self.reach = as_scalar("reach", reach, 0.0, 1e6)
        self.smallest = as_scalar("smallest", smallest, 0.0, 1e6)

    def choose(self, now: Situation, rng: np.random.Generator) -> Array | None:
        """See `Strategy`; None when no place would show enough."""
        floor, radius = now.floor, now.body_radius
        _blacklist_stale(now)
        ways = floor.shortest_paths(now.pose[:2], radius)
        lengths = ways.lengths
        # Candidates: every fourth reachable cell that has frontier around it.
        frontier, reach = floor.frontier(), min(self.reach, now.lidar.max_range)
        near = ndimage.distance_transform_edt(~frontier) * floor.resolution <= reach
        fourth = np.add.outer(*map(np.arange, near.shape)) % 4 == 0
        rows, columns = np.nonzero(np.isfinite(lengths) & near & fourth)
        if not frontier.any() or len(rows) == 0:
            return None
        points = floor.centres()[rows, columns]
        gain = floor.expected_gain(points, reach)
        gain[np.hypot(*(points - now.pose[:2]).T) < radius] = 0.0
        value = np.where(gain >= self.smallest, gain, 0.0)
        value = value * np.exp(-self.decay * lengths[rows, columns])  # gain x exp(-decay x length)
        best = int(np.argmax(value))
        if value[best] <= 0.0:
            return None
        return ways.to((int(rows[best]), int(columns[best])))


def _part(length: float, as_printed: bool, rng: np.random.Generator) -> float:
    """P5's random step length: length / U(0.1, 2.0) as printed, length x U(0.5, 1) as meant."""
    return length / rng.uniform(0.1, 2.0) if as_printed else length * rng.uniform(0.5, 1.0)


def _longest(now: Situation, lengths: Array, rng: np.random.Generator) -> int:
    """Choose the longest beam, after a refusal any that is open."""
    return _any_open(now, lengths, rng) if now.refused else int(np.argmax(lengths))


def _any_open(now: Situation, lengths: Array, rng: np.random.Generator) -> int:
    """Draw a beam longer than the robot, or any beam if there is none."""
    open_beams = np.flatnonzero(lengths > now.body_length)
    return int(rng.choice(open_beams)) if len(open_beams) else int(rng.integers(len(lengths)))


def _large_parts(mask: NDArray[np.bool_], smallest: int) -> NDArray[np.bool_]:
    """Drop parts of the mask (connected over eight neighbours) with fewer cells."""
    labels, n = ndimage.label(mask, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=n + 1)
    keep = sizes >= smallest
    keep[0] = False
    return keep[labels]


def _blacklist_stale(now: Situation) -> None:
    """Leave alone what a scan from right here has not cleared up."""
    now.floor.blacklist_frontier(now.pose[:2], now.body_radius + 3 * now.floor.resolution)
