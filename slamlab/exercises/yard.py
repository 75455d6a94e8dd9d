"""A yard with a robot far from its marker: what the last exercise of chapter 20 drives home.

Formula (1) of chapter 20: worn wheels and noise move the true pose, SLAM gives the believed one.
The way out is the same for all; what wheels have counted on it is not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array
from slamlab.geometry import compose, wrap_angle

__all__ = ["HEDGES", "SHEDS", "Robot", "expedition"]

_NOISE = np.array([0.012, 0.012, 0.012])  # of one motion (m, m, rad)
_SLAM = np.array([0.003, 0.003, 0.002])  # of a pose that SLAM gives (m, m, rad)
_STEPS = 8  # motions from one node of the graph to the next


def _bend(turn: Any) -> Any:
    """Return where one metre of driving ends that turns evenly, as a complex number x + iy."""
    return np.sinc(turn / (2 * np.pi)) * np.exp(0.5j * turn)


def _moved(twist: Array) -> Array:
    """Return the motion (..., 3) of a velocity that is held for one unit of time."""
    place = (twist[..., 0] + 1j * twist[..., 1]) * _bend(twist[..., 2])
    return np.stack([place.real, place.imag, twist[..., 2]], -1)


def _twist(motion: Array) -> Array:
    """Return the velocity that gives a motion (..., 3) in one unit of time."""
    turn = wrap_angle(motion[..., 2])
    speed = (motion[..., 0] + 1j * motion[..., 1]) / _bend(turn)
    return np.stack([speed.real, speed.imag, turn], -1)


_AHEAD, _LEFT = [0.5, 0.0, 0.0], [0.5, 0.0, np.pi / 6]
_ARC = _moved(np.array([2.0, 0.0, -np.pi / 2])).tolist()  # two metres of a bend to the right
# Eleven metres ahead, once round a shed, and on.
_TOUR = np.array(
    [*[_AHEAD] * 22, *([*[_AHEAD] * 9, *[_LEFT] * 3, *[_AHEAD] * 7, *[_LEFT] * 3] * 2)]
    + [*[_AHEAD] * 14, _ARC, *[_AHEAD] * 5, *[_LEFT] * 3, *[_AHEAD] * 12]
)


def _true_way() -> Array:
    """Return the true poses of the way out, ten for each motion."""
    poses = [np.zeros(3)]
    for twist in _twist(_TOUR):
        begin = poses[-1]
        poses += [compose(begin, _moved(part * twist)) for part in np.linspace(0.1, 1.0, 10)]
    return np.array(poses)


_WAY = _true_way()
# The last six metres lead between two of them: x, y (m) of their ends.
HEDGES = _WAY[-1, :2] + np.array([[[-5.5, y], [0.5, y]] for y in (-1.0, 1.0)])
# The first is the one that the way goes round: x, y (m) of two opposite corners.
SHEDS = np.array(
    [[[11.6, 1.2], [15.8, 4.2]], [[2.0, -5.0], [9.0, -2.0]], [[20.5, 0.0], [26.0, 4.0]]]
)


class Robot:
    """A robot at the far end of its way out, with worn wheels and with SLAM.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        Where it is.
    scale : float
        Its wheels are so many times as large as they should be.
    drift : float
        Heading gained on each metre ahead (rad/m).
    noise : float
        0: the wheels are only worn; 1: each motion has a random error as well.
    seed : int
        Of the random numbers.

    Attributes
    ----------
    truth : list of ndarray, shape (3,)
        Its true poses; the robot does not know them.
    asked : set of int
        After how many motions SLAM was asked for the pose.
    """

    def __init__(self, pose: Array, scale: float, drift: float, noise: float, seed: int) -> None:
        self._wear = scale, drift
        self._noise = noise
        self._wheels, self._slam = (np.random.default_rng([seed, k]) for k in (1, 2))
        self.truth = [pose]
        self.asked: set[int] = set()
        self._scan = self._slam.standard_normal(3)

    def __repr__(self) -> str:
        """Return how far it is from the marker."""
        return f"<Robot, {self.off:.2f} m from its marker>"

    @property
    def off(self) -> float:
        """Metres from the marker."""
        return float(np.hypot(*self.truth[-1][:2]))

    @property
    def beside(self) -> float:
        """Largest distance from the way out, until now (m)."""
        gaps = np.array(self.truth)[:, None, :2] - _WAY[None, :, :2]
        return float(np.hypot(gaps[..., 0], gaps[..., 1]).min(1).max())

    @property
    def crossed(self) -> list[Array]:
        """Places x, y (m) where it has passed through a hedge, until now."""
        track = np.array(self.truth)[:, :2]
        found = []
        for (west, y), (east, _) in HEDGES:
            for a, b in zip(track[:-1], track[1:], strict=True):
                if (a[1] - y) * (b[1] - y) < 0:
                    place = a + (y - a[1]) / (b[1] - a[1]) * (b - a)
                    found += [place] * int(west < place[0] < east)
        return found

    def drive(self, motion: Array) -> None:
        """Drive a motion: dx, dy (m) and turn (rad), in the frame of the robot before it.

        The wheels count exactly this motion; the floor gets that of worn and noisy wheels.
        """
        x, y, turn = np.asarray(motion, dtype=float).tolist()
        turn = float(wrap_angle(turn))
        speed = complex(x, y) / _bend(turn)
        errors = self._noise * _NOISE * self._wheels.standard_normal(3)
        scale, drift = self._wear
        speed += complex(errors[0], errors[1])
        turn = scale * (turn + errors[2]) + drift * speed.real
        place = scale * speed * _bend(turn)
        self.truth.append(compose(self.truth[-1], [place.real, place.imag, turn]))
        self._scan = self._slam.standard_normal(3)

    def pose(self) -> Array:
        """Pose by SLAM, from a scan of the sheds: x, y (m) and heading (rad)."""
        self.asked.add(len(self.truth) - 1)
        return compose(self.truth[-1], _SLAM * self._scan)


def expedition(
    scale: float = 1.02, drift: float = np.deg2rad(0.1), noise: float = 0.0, seed: int = 0
) -> tuple[Robot, Array, tuple[Array, NDArray[np.int_], Array, Array]]:
    """Send a robot out into the yard.

    Parameters
    ----------
    scale, drift, noise, seed
        As of `Robot`.

    Returns
    -------
    robot : Robot
        At the far end of the way.
    steps : ndarray, shape (n, 3)
        The motions on the way out, as the wheels have counted them.
    memory : tuple
        The stored path (n + 1, 3), marker first, as the wheels counted it; the node of each of its
        poses (n + 1,); the poses of all nodes as counted, and as SLAM has them at the far end.
    """
    rng = np.random.default_rng([seed, 0])
    really = _twist(_TOUR)
    counted = really / scale
    counted[:, 2] -= drift * really[:, 0] / scale**2
    counted -= noise * _NOISE * rng.standard_normal(counted.shape)
    steps = _moved(counted)
    path, truth = [np.zeros(3)], _WAY[::10]
    for step in steps:
        path.append(compose(path[-1], step))
    nodes = np.arange(len(path)) // _STEPS
    before, after = np.array(path[::_STEPS]), truth[::_STEPS].copy()
    after[1:] = compose(after[1:], _SLAM * rng.standard_normal(after[1:].shape))
    robot = Robot(truth[-1].copy(), scale, drift, noise, seed)
    return robot, steps, (np.array(path), nodes, before, after)
