"""One contract for every motion model, sensor of landmarks and estimator, ours and yours.

What scikit-learn's check_estimator is for classifiers: hand in what you wrote, and read which of
its promises (`slamlab.models`) it breaks. Page "Bring your own robot, sensor or filter".
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_covariance, as_function
from slamlab.evaluation.consistency import pose_errors
from slamlab.evaluation.run import MEASURES, run
from slamlab.geometry import compose, rotation
from slamlab.logs import Log, Step
from slamlab.models import (
    Estimator,
    LandmarkSensor,
    MotionModel,
    as_estimator,
    as_motion,
    as_sensor,
)

__all__ = ["Verdict", "check_estimator", "check_landmark_sensor", "check_motion_model"]

Make = Callable[[Array], Estimator]
Call = Callable[[], Any]
Properties = dict[str, Callable[..., None]]
NEGATIVE = "a covariance with an eigenvalue below 0"
_TURN = np.array([3.0, -2.0, 0.8])  # the rigid motion of the world that changes nothing
_STEP = 1e-6  # of the finite differences
_DRAWS = 20_000


@dataclass(frozen=True)
class Verdict:
    """What was checked and what was found; true if all is well.

    Attributes
    ----------
    subject : str
        What was checked.
    found : dict of str to str
        What is wrong with each property by its name; empty where nothing is.
    """

    subject: str
    found: dict[str, str]

    @property
    def violations(self) -> list[str]:
        """One line for each broken property: its name, and what is wrong."""
        return [f"{name}: {wrong}" for name, wrong in self.found.items() if wrong]

    def __bool__(self) -> bool:
        """Whether no property is broken."""
        return not self.violations

    def __str__(self) -> str:
        """One line a property."""
        lines = [f"  {name}: {wrong or 'good'}" for name, wrong in self.found.items()]
        return "\n".join([self.subject, *lines])


class _Broken(Exception):
    """A property does not hold; the message says how."""


def check_motion_model(
    model: MotionModel,
    u: ArrayLike,
    dt: float = 0.4,
    control_cov: ArrayLike | None = None,
    *,
    equivariant: bool = True,
) -> Verdict:
    """Check what a motion model promises.

    Parameters
    ----------
    model : MotionModel
    u : array_like, shape (p,)
        A control that moves the robot.
    dt : float, default 0.4
        Duration of a step (s).
    control_cov : array_like, shape (p, p), optional
        Noise for `sample`, small enough for the step to be straight; 1e-4 on each if left out.
    equivariant : bool, default True
        Whether the world has no direction of its own, as wind would give it.

    Returns
    -------
    Verdict

    Examples
    --------
    >>> from slamlab.robots import Unicycle
    >>> bool(check_motion_model(Unicycle(), [1.0, 0.3]))
    True
    """
    u = as_array("u", u, ("p",))
    p = len(u)
    V = 1e-4 * np.eye(p) if control_cov is None else as_covariance("control_cov", control_cov, p)
    rng = np.random.default_rng(0)
    poses, controls = rng.uniform(-1, 1, (2, 4, 3)), u + rng.uniform(-0.1, 0.1, (4, p))

    trial = _Motion(model, u, dt, V, poses, controls)
    left_out = () if equivariant else ("equivariance",)
    return _judged(model, lambda: as_motion("model", model), _MOTION, trial, left_out)


def check_landmark_sensor(
    sensor: LandmarkSensor, poses: ArrayLike | None = None, landmarks: ArrayLike | None = None
) -> Verdict:
    """Check what a sensor of landmarks promises.

    Parameters
    ----------
    sensor : LandmarkSensor
    poses : array_like, shape (4, 3), optional
        Where it stands; within a metre of the origin if left out.
    landmarks : array_like, shape (4, 2), optional
        What it measures. If left out, four between 3 and 6 m; read as walls (r, alpha) they are
        walls just as well.

    Returns
    -------
    Verdict

    Examples
    --------
    >>> from slamlab.sensors import RangeBearing
    >>> print(check_landmark_sensor(RangeBearing(0.1, 0.02)))
    RangeBearing
      protocol: good
      repr: good
      cov: good
      jacobians: good
      locate: good
      residual: good
      leading axes: good
      arguments: good
      refusals: good
    """
    rng = np.random.default_rng(0)
    drawn = rng.uniform([3.0, -2.0], [6.0, 2.0], (4, 2))
    x = rng.uniform(-1, 1, (4, 3)) if poses is None else as_array("poses", poses, (4, 3))
    m = drawn if landmarks is None else as_array("landmarks", landmarks, (4, 2))
    trial = _Sensor(sensor, x, m)
    return _judged(sensor, lambda: as_sensor("sensor", sensor), _SENSOR, trial)


def check_estimator(
    make: Callable[[Array], Estimator], log: Log, *, equivariance: float | None = 1e-6
) -> Verdict:
    """Check what an estimator promises, on a log that feeds it.

    Parameters
    ----------
    make : callable
        ``make(pose) -> Estimator``: a new system each time, starting at `pose`, with the same
        seed if it draws random numbers. `pose` is (3,), or (M, 3) if the log has M runs.
    log : Log
        At least six steps, and not many more: it is driven about ten times. The system starts
        at ``log.truth[0]``, without truth at the origin.
    equivariance : float or None, default 1e-6
        How far poses (m, rad) may stray when the same log starts elsewhere: rounding for a
        system that is indifferent to the axes of the world, a cell for one that draws a grid.
        None for a system that is given a map: then it is not checked.

    Returns
    -------
    Verdict

    Examples
    --------
    >>> from slamlab.localization import DeadReckoning
    >>> from slamlab.robots import YOUBOT
    >>> from slamlab.simulation import room_drives
    >>> log = room_drives(1, np.random.default_rng(1), n_steps=10).single(0)
    >>> bool(check_estimator(lambda pose: DeadReckoning(YOUBOT, pose), log))
    True
    """
    as_function("make", make)
    if not isinstance(log, Log) or len(log) < 6:
        raise ValueError(f"log: expected a Log of at least six steps, got {log!r:.80}")
    start = np.zeros(3) if log.truth is None else log.truth[0].copy()
    trial = _Estimator(make, log, start, equivariance or 0.0)
    left_out = ("equivariance",) if equivariance is None else ()
    system = trial.begun()
    return _judged(system, lambda: _protocol(system), _ESTIMATOR, trial, left_out)


@dataclass(frozen=True)
class _Motion:
    """What a motion model promises: from poses (2, 4, 3), with one control or with (4, p)."""

    model: MotionModel
    u: Array
    dt: float
    V: Array
    poses: Array
    controls: Array

    def jacobians(self) -> None:
        step, pose, dt = self.model.step, self.poses[0], self.dt
        F_x, F_u = self.model.jacobians(pose, self.u, dt)
        _close("by pose", F_x, _derivative(lambda x: step(x, self.u, dt), pose, pose_errors))
        _close("by u", F_u, _derivative(lambda v: step(pose, v, dt), self.u, pose_errors))

    def leading_axes(self) -> None:
        model, poses, controls, dt = self.model, self.poses, self.controls, self.dt
        # Broadcast explicitly: four controls for the poses (2, 4, 3).
        pairs = [(x, v) for row in poses for x, v in zip(row, controls, strict=True)]
        ones = np.array([model.step(x, v, dt) for x, v in pairs]).reshape(2, 4, 3)
        _close("step", model.step(poses, controls, dt), ones)
        for k, name in enumerate(("F_x", "F_u")):
            alone = np.array([model.jacobians(x, v, dt)[k] for x, v in pairs])
            got = model.jacobians(poses, controls, dt)[k]
            _close(name, got, alone.reshape(2, 4, *alone.shape[1:]))

    def sample(self) -> None:
        pose, (u, dt, V) = self.poses[0, 0], (self.u, self.dt, self.V)
        many = np.tile(pose, (_DRAWS, 1))
        drawn = self.model.sample(many, u, dt, V, np.random.default_rng(1))
        again = self.model.sample(many, u, dt, V, np.random.default_rng(1))
        _close("the same seed", again, drawn)
        off = pose_errors(drawn, self.model.step(pose, u, dt))
        F_u = self.model.jacobians(pose, u, dt)[1]
        Q = F_u @ V @ F_u.T
        size = np.trace(Q)
        if np.linalg.norm(off.mean(0)) > 0.05 * np.sqrt(size):
            raise _Broken(f"the mean of many is off the step by {off.mean(0)}")
        if np.abs(np.cov(off.T) - Q).max() > 0.05 * size:
            raise _Broken("the covariance of many is not F_u V F_u^T")

    def still(self) -> None:
        step, pose, u, dt = self.model.step, self.poses[0, 0], self.u, self.dt
        moved = step(pose, u, 2 * dt)
        matters = not np.allclose(moved, step(pose, u, dt))
        _close("a step of dt = 0", step(pose, u, 0.0), pose if matters else moved)

    def arguments(self) -> None:
        given = self.poses[0], self.controls, self.dt
        _untouched(self.model.step, *given)
        _untouched(self.model.jacobians, *given)
        _untouched(self.model.sample, *given, self.V, np.random.default_rng(2))

    def refusals(self) -> None:
        model, pose, u, dt = self.model, self.poses[0], self.u, self.dt
        bad, below, rng = np.array([0.0, np.nan, 0.0]), -np.eye(len(u)), np.random.default_rng(3)
        _refuses("pose", "a pose of shape (2,)", lambda: model.step(np.zeros(2), u, dt))
        _refuses("pose", "a pose with NaN", lambda: model.step(bad, u, dt))
        _refuses("u", "a control with NaN", lambda: model.step(pose, u * np.nan, dt))
        _refuses("u", "too long a control", lambda: model.step(pose, np.append(u, 0), dt))
        _refuses("pose", "a pose with NaN", lambda: model.jacobians(bad, u, dt))
        _refuses("control_cov", NEGATIVE, lambda: model.sample(pose, u, dt, below, rng))

    def equivariance(self) -> None:
        here = self.model.step(self.poses, self.u, self.dt)
        there = self.model.step(compose(_TURN, self.poses), self.u, self.dt)
        off = pose_errors(there, compose(_TURN, here))
        _close("a step in a turned world", off, np.zeros_like(off))


_MOTION: Properties = {
    "jacobians": _Motion.jacobians,
    "leading axes": _Motion.leading_axes,
    "sample": _Motion.sample,
    "dt = 0": _Motion.still,
    "arguments": _Motion.arguments,
    "refusals": _Motion.refusals,
    "equivariance": _Motion.equivariance,
}


@dataclass(frozen=True)
class _Sensor:
    """What a sensor promises: from poses x (4, 3), of landmarks m (4, 2)."""

    sensor: LandmarkSensor
    x: Array
    m: Array

    @property
    def z(self) -> Array:
        return self.sensor.observe(self.x, self.m)

    def cov(self) -> None:
        _covariance("cov", np.asarray(self.sensor.cov), (2, 2))

    def jacobians(self) -> None:
        sensor, x, m, z = self.sensor, self.x, self.m, self.z
        H_x, H_m = sensor.jacobians(x, m)
        _close("H_pose", H_x, _derivative(lambda a: sensor.observe(a, m), x, sensor.residual))
        _close("H_landmark", H_m, _derivative(lambda a: sensor.observe(x, a), m, sensor.residual))
        G_x, G_z = sensor.locate_jacobians(x, z)
        _close("G_pose", G_x, _derivative(lambda a: sensor.locate(a, z), x))
        _close("G_z", G_z, _derivative(lambda a: sensor.locate(x, a), z))

    def locate(self) -> None:
        found = self.sensor.locate(self.x, self.z)
        _close("locate(observe(landmark))", found, self.m)
        off = self.sensor.residual(self.sensor.observe(self.x, found), self.z)
        _close("observe(locate(z)) - z", off, np.zeros((4, 2)))

    def residual(self) -> None:
        z, small = self.z, np.array([0.01, -0.02])
        _close("z - (z - d)", self.sensor.residual(z, z - small), np.tile(small, (4, 1)))
        # Once round on the spot, and back to the same heading with another number.
        turn = np.linspace(0, 2 * np.pi, 91)
        around, m = self.x[0] + turn[:, None] * [0, 0, 1], self.m[0]
        seen = np.asarray(self.sensor.visible(around, np.tile(m, (91, 1))), bool)
        pairs = np.flatnonzero(seen & np.roll(seen, -1))
        if len(pairs) == 0:
            return
        before, after = around[pairs], np.roll(around, -1, 0)[pairs]
        first, then = self.sensor.observe(before, m), self.sensor.observe(after, m)
        # A camera that measures pixels may change by many of them, as its derivative says.
        steep = [np.abs(self.sensor.jacobians(x, m)[0][..., 2]) for x in (before, after)]
        most = 2 + 3 * turn[1] * np.maximum(*steep)
        jump = np.abs(self.sensor.residual(then, first))
        if (jump > most).any():
            raise _Broken(
                f"jumps by {jump[jump > most].max():.3g} as the robot turns: wrap what measures "
                "an angle"
            )

    def leading_axes(self) -> None:
        for name in ("observe", "locate", "jacobians", "locate_jacobians", "visible"):
            f, x, second = getattr(self.sensor, name), self.x, self.z if "loc" in name else self.m
            alone = [f(a, b) for a, b in zip(x, second, strict=True)]
            for got, each in _parts(f(x, second), alone):
                _close(name, got, each)
            for got, each in _parts(f(np.tile(x, (3, 1, 1)), second), alone):
                _close(name, got, np.broadcast_to(each, (3, *each.shape)))

    def arguments(self) -> None:
        sensor, z = self.sensor, self.z
        for f, second in (
            (sensor.observe, self.m),
            (sensor.jacobians, self.m),
            (sensor.locate, z),
        ):
            _untouched(f, self.x, second)
        _untouched(sensor.residual, z, z + 4.0)

    def refusals(self) -> None:
        sensor, x, m, z = self.sensor, self.x, self.m, self.z
        lost = np.array([np.nan, 1.0])
        _refuses("pose", "a pose of shape (2,)", lambda: sensor.observe(np.zeros(2), m))
        _refuses("landmark wall", "a landmark with NaN", lambda: sensor.observe(x, lost))
        _refuses("pose", "a pose with NaN", lambda: sensor.jacobians(x * np.nan, m))
        _refuses("z", "a measurement with NaN", lambda: sensor.locate(x, lost))
        _refuses("z", "a measurement of shape (4, 3)", lambda: sensor.locate(x, x))
        _close("observe after all that", sensor.observe(x, m), z)


_SENSOR: Properties = {
    "cov": _Sensor.cov,
    "jacobians": _Sensor.jacobians,
    "locate": _Sensor.locate,
    "residual": _Sensor.residual,
    "leading axes": _Sensor.leading_axes,
    "arguments": _Sensor.arguments,
    "refusals": _Sensor.refusals,
}


@dataclass(frozen=True)
class _Estimator:
    """What an estimator promises, driven along a log from `start`."""

    make: Make
    log: Log
    start: Array
    tolerance: float

    def begun(self) -> Estimator:
        return self.make(self.start.copy())

    def halfway(self) -> Estimator:
        return run(self.begun(), self.log[: len(self.log) // 2]).system

    @property
    def moving(self) -> Step:
        return next((step for step in self.log if step.dt > 0), self.log.step(0))

    def copies(self) -> None:
        one, step, kept, then = self.halfway(), self.moving, [], []
        for _ in range(4):
            one.predict(step.u, step.dt, step.control_cov)
            kept.append((one.pose, one.pose_cov))
            then.append(_belief(one))
        for held, was in zip(kept, then, strict=True):
            _same("a pose kept from before", held, was)
        pose, cov = one.pose, one.pose_cov
        pose[...], cov[...] = 99.0, 99.0
        _same("after writing into `pose` and `pose_cov`", _belief(one), then[-1])

    def arguments(self) -> None:
        one, twin = self.begun(), self.begun()
        for k in range(len(self.log)):
            run(twin, self.log[k : k + 1])
            _fed_and_scribbled(one, self.log, k)
            _same(f"step {k}, arguments changed after the call", _belief(one), _belief(twin))

    def covariance(self) -> None:
        result, shape = run(self.begun(), self.log), self.start.shape
        if not np.isfinite(result.poses).all() or result.poses.shape[1:] != shape:
            raise _Broken(f"poses: expected finite {shape}, got {result.poses.shape}")
        for cov in result.covs:
            _covariance("pose_cov", cov, (*shape, 3))

    def repeatable(self) -> None:
        one, two = run(self.begun(), self.log), run(self.begun(), self.log)
        _same("a second run", (one.poses, one.covs), (two.poses, two.covs))

    def refusals(self) -> None:
        one, twin, rest = self.halfway(), self.halfway(), self.log[len(self.log) // 2 :]
        for names, what, call in _bad_calls(one, self.moving, rest):
            _refuses(names, what, call)
            _same(f"after {what} was refused", _belief(one), _belief(twin))
        after, expected = run(one, rest), run(twin, rest)
        beliefs = (after.poses, after.covs), (expected.poses, expected.covs)
        _same("going on after refusals", *beliefs)

    def still(self) -> None:
        beliefs, step = [], self.moving
        for duration in (0.0, step.dt, 2 * step.dt):
            one = self.begun()
            one.predict(step.u, duration, step.control_cov)
            beliefs.append(_belief(one))
        if not all(np.isfinite(part).all() for part in beliefs[0]):
            raise _Broken("predict with dt = 0 leads to numbers that are not finite")
        if not np.allclose(beliefs[1][0], beliefs[2][0]):
            _same("predict with dt = 0", beliefs[0], _belief(self.begun()))

    def nothing_seen(self) -> None:
        one = self.halfway()
        before = _belief(one)
        if one.measures == "scan" and self.log.ranges is not None:
            one.update(np.full(self.log.ranges.shape[1], np.nan))
        elif one.measures == "landmarks" and self.start.ndim == 1:
            one.update(np.empty((0, 2)), [] if self.log.ids is not None else None)
        _same("an update without any measurement", _belief(one), before)

    def equivariance(self) -> None:
        one = run(self.begun(), self.log)
        other = run(self.make(compose(_TURN, self.start)), self.log)
        off = pose_errors(other.poses, compose(_TURN, one.poses))
        _close("poses in a turned world", off, np.zeros_like(off), self.tolerance)
        if self.tolerance > 1e-6:
            return
        R = np.eye(3)
        R[:2, :2] = rotation(_TURN[2])
        size = 1e-5 * np.abs(one.covs).max() + 1e-12
        _close("covariances in a turned world", other.covs, R @ one.covs @ R.T, size)


_ESTIMATOR: Properties = {
    "copies": _Estimator.copies,
    "arguments": _Estimator.arguments,
    "covariance": _Estimator.covariance,
    "repeatable": _Estimator.repeatable,
    "refusals": _Estimator.refusals,
    "dt = 0": _Estimator.still,
    "nothing measured": _Estimator.nothing_seen,
    "equivariance": _Estimator.equivariance,
}


def _protocol(system: Any) -> None:
    as_estimator("system", system)
    if system.measures not in MEASURES:
        raise _Broken(f"measures: expected one of {MEASURES}, got {system.measures!r}")


# Feeding, and feeding wrongly.


def _belief(system: Estimator) -> tuple[Array, Array]:
    return np.array(system.pose), np.array(system.pose_cov)


def _measured(system: Estimator, step: Step) -> tuple[Array | None, Any]:
    """Copy what the system measures in a step, clutter left out, and the names."""
    z = {"scan": step.ranges, "landmarks": step.z}.get(system.measures)
    if z is None or system.measures == "scan" or step.ids is None:
        return None if z is None else z.copy(), None
    return z[..., step.is_landmark, :].copy(), step.ids[step.is_landmark].copy()


def _fed_and_scribbled(system: Estimator, log: Log, k: int) -> None:
    """Feed step k, see that the arguments are as they were, then overwrite them all."""
    step = log.step(k)
    z, ids = _measured(system, step)
    given = {"u": step.u.copy(), "control_cov": step.control_cov.copy(), "z": z, "ids": ids}
    given = {name: part for name, part in given.items() if part is not None}
    was = {name: part.copy() for name, part in given.items()}
    if step.dt > 0:
        system.predict(given["u"], step.dt, given["control_cov"])
    if z is not None:
        system.update(z, ids)
    for name, part in given.items():
        if not np.array_equal(part, was[name], equal_nan=part.dtype.kind == "f"):
            raise _Broken(f"step {k} changed its argument {name}")
        part[...] = 0


def _bad_calls(system: Estimator, step: Step, rest: Log) -> list[tuple[str, str, Any]]:
    """List calls to refuse: names of which the message begins with one, what is wrong, call."""
    predict, update = system.predict, system.update
    u, dt, V, below = step.u, step.dt, step.control_cov, -np.eye(step.u.shape[-1])
    wide, long = np.eye(u.shape[-1] + 1), np.append(u, 0.0)
    calls: list[tuple[str, str, Any]] = [
        ("u", "a control with NaN", lambda: predict(u * np.nan, dt, V)),
        ("control_cov", "a covariance with NaN", lambda: predict(u, dt, V * np.nan)),
        ("control_cov", NEGATIVE, lambda: predict(u, dt, below)),
        ("control_cov", "a covariance of another size", lambda: predict(u, dt, wide)),
        ("u control_cov", "too long a control", lambda: predict(long, dt, V)),
    ]
    seen = (_measured(system, later) for later in rest)
    z, ids = next(((z, ids) for z, ids in seen if z is not None and len(z)), (None, None))
    if z is None:
        return calls
    names = "z measurement ranges scan"
    calls.append((names, "a measurement of words", lambda: update(["one", "two"], ids)))
    if system.measures == "scan":
        calls.append((names, "too long a scan", lambda: update(np.append(z, 1.0))))
        calls.append((names, "a range below 0", lambda: update(np.append(z[:-1], -1.0))))
        return calls
    three = np.concatenate([z, z[..., :1]], -1)
    calls.append((names, "measurements of three numbers", lambda: update(three, ids)))
    if z.ndim == 2:
        lost = z.copy()
        lost[-1] = np.nan
        calls.append((names, "NaN in the last measurement", lambda: update(lost, ids)))
    if ids is not None:
        calls.append(("ids", "one id too many", lambda: update(z, np.append(ids, ids[:1]))))
    return calls


# Judging.


def _judged(
    subject: Any, protocol: Call, table: Properties, trial: Any, left_out: tuple[str, ...] = ()
) -> Verdict:
    """Try every property of a table; if the protocol is broken, that one alone."""
    found = {"protocol": _tried(protocol)}
    if not found["protocol"]:
        found["repr"] = _tried(lambda: _one_line(subject))
        kept = {name: check for name, check in table.items() if name not in left_out}
        found |= {name: _tried(partial(check, trial)) for name, check in kept.items()}
    return Verdict(type(subject).__name__, found)


def _tried(check: Call) -> str:
    try:
        with np.errstate(all="ignore"):
            check()
    except _Broken as broken:
        return str(broken)
    except Exception as error:  # what a student's code raises is what he has to read
        return f"raised {type(error).__name__}: {str(error)[:200]}"
    return ""


def _one_line(subject: Any) -> None:
    text = repr(subject)
    if "\n" in text or " at 0x" in text:
        raise _Broken(f"expected one readable line, got {text[:80]!r}")


def _close(what: str, got: ArrayLike, expected: ArrayLike, tolerance: float = 1e-6) -> None:
    got, expected = np.asarray(got, float), np.asarray(expected, float)
    if got.shape != expected.shape:
        raise _Broken(f"{what}: expected shape {expected.shape}, got {got.shape}")
    worst = np.abs(got - expected).max(initial=0.0)
    if not worst <= tolerance:
        square = got.shape[-2:] == expected.shape[-2:][::-1]
        if square and got.ndim > 1 and np.allclose(np.swapaxes(got, -1, -2), expected, atol=1e-6):
            raise _Broken(f"{what}: this is the transpose")
        raise _Broken(f"{what}: off by {worst:.3g}")


def _same(what: str, got: tuple[Array, ...], expected: tuple[Array, ...]) -> None:
    for name, one, other in zip(("pose", "pose_cov"), got, expected, strict=True):
        if not np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True):
            raise _Broken(f"{what}: {name} is another one, off by {np.abs(one - other).max():.3g}")


def _covariance(name: str, cov: Array, shape: tuple[int, ...]) -> None:
    if cov.shape != shape:
        raise _Broken(f"{name}: expected shape {shape}, got {cov.shape}")
    size = np.abs(cov).max(initial=0.0)
    if not np.isfinite(size):
        raise _Broken(f"{name}: expected finite numbers")
    if np.abs(cov - np.swapaxes(cov, -1, -2)).max() > 1e-9 * size:
        raise _Broken(f"{name}: not symmetric")
    least = np.linalg.eigvalsh(cov).min()
    if least < -1e-9 * size:
        raise _Broken(f"{name}: has the eigenvalue {least:.3g}")


def _untouched(f: Callable[..., Any], *given: Any) -> None:
    """Call f and see that its arrays are as they were, and that the answer is no view of them."""
    arrays = [part.copy() if isinstance(part, np.ndarray) else part for part in given]
    answer = f(*arrays)
    for part, was in zip(arrays, given, strict=True):
        if isinstance(part, np.ndarray) and not np.array_equal(part, was):
            raise _Broken(f"{f.__name__} changes its arguments")
        for one in answer if isinstance(answer, tuple) else (answer,):
            if isinstance(part, np.ndarray) and np.shares_memory(part, one):
                raise _Broken(f"{f.__name__} returns a view of its argument")


def _refuses(names: str, what: str, call: Call) -> None:
    """See that a call raises ValueError, with one of these words at the start of its message."""
    try:
        call()
    except ValueError as error:
        said = str(error).partition(":")[0]
        if re.split(r"[\[,]", said)[0] in names.split():
            return
        wanted, text = " or ".join(sorted(names.split())), str(error)[:80]
        raise _Broken(f"{what}: the message does not name {wanted}: {text}") from error
    except Exception as error:
        raise _Broken(f"{what}: expected ValueError, got {type(error).__name__}") from error
    raise _Broken(f"{what}: expected ValueError, nothing was raised")


def _derivative(f: Callable[[Array], Array], x: Array, off: Any = np.subtract) -> Array:
    """Central differences of f by the last axis of x, shape (..., m, n)."""
    steps = _STEP * np.eye(x.shape[-1])
    return np.stack([off(f(x + h), f(x - h)) / (2 * _STEP) for h in steps], -1)


def _parts(got: Any, alone: list[Any]) -> list[tuple[Array, Array]]:
    """Each array of an answer beside those of single calls."""
    if isinstance(got, tuple):
        return [(part, np.array([each[k] for each in alone])) for k, part in enumerate(got)]
    return [(got, np.array(alone))]
