"""The formulas of P1 as the paper prints them, as models that a filter can be run with.

P1 (17), (18), (26)-(29), (34) and (41). For tests and for chapter 09, which runs them to see what
each one costs.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_instance
from slamlab.logs import Log
from slamlab.models import LandmarkSensor, MotionModel
from slamlab.sensors import RangeBearing
from slamlab.slam import EKFSlamBatch

__all__ = [
    "BearingAsPrinted",
    "BearingWithoutQuadrant",
    "BeamlessLocate",
    "LeverlessBearingSlopes",
    "LeverlessBearingSlopesWorst",
    "LeverlessRangeSlope",
    "MotionAsPrinted",
    "SlopesAndBeamAsPrinted",
    "Variant",
    "gain_as_printed",
    "together",
    "variants",
]


@dataclass(frozen=True)
class MotionAsPrinted(MotionModel):
    """A motion model whose F_u lacks the factor dt, P1 (17).

    A velocity acts for the time dt, so the paper's process noise F_u V F_u^T is 1/dt^2 times too
    large: a hundred times at ten steps a second.

    Parameters
    ----------
    motion : motion model
        The right one; its `step`, by which `sample` draws, and its F_x are kept.
    """

    motion: MotionModel

    def step(self, pose: ArrayLike, u: ArrayLike, dt: float) -> Array:
        """Return the pose after the step, P1 (10), as the right model does."""
        return np.asarray(self.motion.step(pose, u, dt))

    def jacobians(self, pose: ArrayLike, u: ArrayLike, dt: float) -> tuple[Array, Array]:
        """Return the right F_x, P1 (16), and F_u as printed in (17)."""
        F_x, F_u = self.motion.jacobians(pose, u, dt)
        return F_x, F_u / dt


@dataclass(frozen=True)
class BearingAsPrinted(RangeBearing):
    """Bearing arctan(d_x / d_y) - theta, P1 (18): the fraction inverted, no quadrant."""

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Return range and the printed bearing, neither reflected back nor wrapped."""
        pose, d_x, d_y, _, _ = _lever(self, pose, landmark)
        with np.errstate(divide="ignore"):
            bearing = np.arctan(d_x / d_y) - pose[..., 2]
        return np.stack([np.hypot(d_x, d_y), bearing], -1)


@dataclass(frozen=True)
class BearingWithoutQuadrant(RangeBearing):
    """Bearing arctan(d_y / d_x) - theta: P1 (18) with the fraction the right way up."""

    def observe(self, pose: ArrayLike, landmark: ArrayLike) -> Array:
        """Return range and a bearing that takes a landmark behind for one ahead."""
        pose, d_x, d_y, _, _ = _lever(self, pose, landmark)
        with np.errstate(divide="ignore"):
            bearing = np.arctan(d_y / d_x) - pose[..., 2]
        return np.stack([np.hypot(d_x, d_y), bearing], -1)


@dataclass(frozen=True)
class LeverlessBearingSlopes(RangeBearing):
    """P1 (26), (27), (29) in their most favourable reading: signs right, lever terms as printed.

    C and D use the body centre where the sensor should stand; F has -p_y s + L cos(2 theta) in
    place of +p_y s + L.
    """

    _illegible = 1.0  # the two signs that cannot be read

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return H with the printed C, D, F; A, B and E are right."""
        H_pose, _ = super().jacobians(pose, landmark)
        pose, d_x, d_y, c, s = _lever(self, pose, landmark)
        L, squared = self.offset, d_x * d_x + d_y * d_y
        p_x, p_y = d_x - L * c, d_y - L * s
        # (26), (27)
        H_pose[..., 1, 0], H_pose[..., 1, 1] = -self._illegible * p_y / squared, p_x / squared
        # (29)
        wrong = p_x * c - p_y * s + L * np.cos(2 * pose[..., 2])
        H_pose[..., 1, 2] = self._illegible * wrong * L / squared - 1.0
        # (31), (32)
        return H_pose, -H_pose[..., :2]


class LeverlessBearingSlopesWorst(LeverlessBearingSlopes):
    """P1 (26), (27), (29) in their worst reading: the illegible signs of C and F are wrong too."""

    _illegible = -1.0


@dataclass(frozen=True)
class LeverlessRangeSlope(RangeBearing):
    """P1 (28) without its factor L: the range seems to change by metres for a radian of turn."""

    def jacobians(self, pose: ArrayLike, landmark: ArrayLike) -> tuple[Array, Array]:
        """Return H with E = (p_y c - p_x s) / rho."""
        H_pose, H_landmark = super().jacobians(pose, landmark)
        pose, d_x, d_y, c, s = _lever(self, pose, landmark)
        # The lever cancels in p_y c - p_x s = d_y c - d_x s.
        H_pose[..., 0, 2] = (d_y * c - d_x * s) / np.hypot(d_x, d_y)
        return H_pose, H_landmark


@dataclass(frozen=True)
class BeamlessLocate(RangeBearing):
    """P1 (41): a new landmark turns with the lever of the sensor, but not with the beam."""

    def locate_jacobians(self, pose: ArrayLike, z: ArrayLike) -> tuple[Array, Array]:
        """Return G_pose with the heading column (-L s, L c) alone, and the right G_z."""
        G_pose, G_z = super().locate_jacobians(pose, z)
        theta = as_array("pose", pose, ("...", 3))[..., 2]
        G_pose[..., 0, 2] = -self.offset * np.sin(theta)
        G_pose[..., 1, 2] = self.offset * np.cos(theta)
        return G_pose, G_z


class SlopesAndBeamAsPrinted(LeverlessRangeSlope, LeverlessBearingSlopes, BeamlessLocate):
    """P1 (26)-(29) and (41) together: signs right, lever terms and heading column as printed."""


def gain_as_printed(P: ArrayLike, H: ArrayLike, S: ArrayLike, R: ArrayLike) -> Array:
    """Gain K = P H^T S^-1 + R, P1 (34): a sum of (N, 2) and (2, 2) that does not exist.

    Raises
    ------
    ValueError
        Always, by NumPy, unless the state happens to have two numbers.
    """
    P = as_array("P", P, ("N", "N"))
    H, S, R = as_array("H", H, ("m", len(P))), as_array("S", S), as_array("R", R, ("m", "m"))
    return np.asarray(P @ H.T @ np.linalg.inv(S) + R)


@dataclass(frozen=True)
class Variant:
    """One way to run the filter.

    Attributes
    ----------
    motion, sensor
        What the filter believes; the world keeps the right models.
    """

    motion: MotionModel
    sensor: LandmarkSensor

    def start(self, log: Log) -> EKFSlamBatch:
        """Return filters that start at the first true poses of a log and know no landmark."""
        if log.truth is None or log.landmarks is None:
            raise ValueError("log: expected one with truth and landmarks, from a simulation")
        n = len(log.landmarks)
        return EKFSlamBatch(self.motion, self.sensor, log.truth[0], n_landmarks=n)


def variants(motion: MotionModel, sensor: RangeBearing) -> dict[str, Variant]:
    """Return the repaired filter and each printed one, by the name the tables show.

    (34) is not among them: it cannot be run (`gain_as_printed`). Walls treated as points need
    another world: give ``Variant(motion, RangeBearing(...))`` a world seen by `Wall`.

    Parameters
    ----------
    motion : motion model
        The right one.
    sensor : RangeBearing
        The right one; the printed ones take over its parameters.

    Returns
    -------
    dict of str to Variant
        The repaired one first.
    """
    like = partial(_like, sensor)
    return {
        "repaired": Variant(motion, sensor),
        "(17) without dt": Variant(MotionAsPrinted(motion), sensor),
        "(18) as printed": Variant(motion, like(BearingAsPrinted)),
        "(18) arctan without quadrant": Variant(motion, like(BearingWithoutQuadrant)),
        "(26), (27), (29) best signs": Variant(motion, like(LeverlessBearingSlopes)),
        "(26), (27), (29) worst signs": Variant(motion, like(LeverlessBearingSlopesWorst)),
        "(28) without L": Variant(motion, like(LeverlessRangeSlope)),
        "(41) without the beam": Variant(motion, like(BeamlessLocate)),
    }


def together(motion: MotionModel, sensor: RangeBearing) -> dict[str, Variant]:
    """Return filters with several printed formulas at once; (18) is repaired in both.

    Parameters
    ----------
    motion, sensor
        As `variants`.

    Returns
    -------
    dict of str to Variant
        (17) and (41), whose mistakes nearly cancel; and all that P1 prints.
    """
    wheels, like = MotionAsPrinted(motion), partial(_like, sensor)
    return {
        "(17) and (41)": Variant(wheels, like(BeamlessLocate)),
        "(17), (26)-(29), (41)": Variant(wheels, like(SlopesAndBeamAsPrinted)),
    }


def _like(sensor: RangeBearing, kind: type[RangeBearing]) -> RangeBearing:
    """Return a sensor of another kind with the parameters of this one."""
    as_instance("sensor", sensor, RangeBearing)
    return kind(*(getattr(sensor, field.name) for field in fields(RangeBearing) if field.init))


def _lever(
    sensor: RangeBearing, pose: ArrayLike, landmark: ArrayLike
) -> tuple[Array, Array, Array, Array, Array]:
    """Pose, d_x, d_y (sensor minus landmark, as the paper has it), cosine and sine."""
    pose = as_array("pose", pose, ("...", 3))
    landmark = as_array("landmark", landmark, ("...", 2))
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    d_x = pose[..., 0] + sensor.offset * c - landmark[..., 0]
    d_y = pose[..., 1] + sensor.offset * s - landmark[..., 1]
    return pose, d_x, d_y, c, s
