"""One contract for every motion model, sensor of landmarks and estimator, ours and yours.

What scikit-learn's check_estimator is for classifiers: hand in what you wrote, and read which of
its promises (`slamlab.models`) it breaks. Page "Bring your own robot, sensor or filter".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_covariance, as_function
from slamlab.evaluation.run import MEASURES, run
from slamlab.geometry import compose, rotation, wrap_angle
from slamlab.logs import Log
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
Property = Callable[..., None]
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

    Raises
    ------
    ValueError
        If `u` or `control_cov` is none.

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

    case = {"model": model, "u": u, "dt": dt, "V": V, "poses": poses, "controls": controls}
    left_out = () if equivariant else ("equivariance",)
    return _judged(model, lambda: as_motion("model", model), _MOTION, case, left_out)


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

    case = {"sensor": sensor, "x": x, "m": m}
    return _judged(sensor, lambda: as_sensor("sensor", sensor), _SENSOR, case)


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

    Raises
    ------
    ValueError
        If `make` is no function, or `log` is none or too short.

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
    moving = next((step for step in log if step.dt > 0), log.step(0))
    case: dict[str, Any] = {"make": make, "log": log, "start": start, "half": len(log) // 2}
    case |= {"u": moving.u, "dt": moving.dt, "V": moving.control_cov}
    left_out = ("equivariance",) if equivariance is None else ()
    system = make(start.copy())

    case["equivariance"] = equivariance
    return _judged(system, lambda: _protocol(system), _ESTIMATOR, case, left_out)


# What a motion model promises: from poses (2, 4, 3), with controls (4, p).


def _motion_jacobians(model: MotionModel, u: Array, dt: float, poses: Array, **_rest: Any) -> None:
    F_x, F_u = model.jacobians(poses[0], u, dt)
    _close("by pose", F_x, _slopes(lambda x: model.step(x, u, dt), poses[0], _turned))
    _close("by u", F_u, _slopes(lambda v: model.step(poses[0], v, dt), u, _turned))


def _motion_leading_axes(
    model: MotionModel, u: Array, dt: float, poses: Array, controls: Array, **_rest: Any
) -> None:
    # Broadcast explicitly: four controls for the poses (2, 4, 3).
    pairs = [(x, v) for row in poses for x, v in zip(row, controls, strict=True)]
    ones = np.array([model.step(x, v, dt) for x, v in pairs]).reshape(2, 4, 3)
    _close("step", model.step(poses, controls, dt), ones)
    for k, name in enumerate(("F_x", "F_u")):
        alone = np.array([model.jacobians(x, v, dt)[k] for x, v in pairs])
        shape = (2, 4, 3, 3 if k == 0 else len(u))
        _close(name, model.jacobians(poses, controls, dt)[k], alone.reshape(shape))


def _motion_sample(
    model: MotionModel, u: Array, dt: float, V: Array, poses: Array, **_rest: Any
) -> None:
    pose = poses[0, 0]
    drawn = model.sample(np.tile(pose, (_DRAWS, 1)), u, dt, V, np.random.default_rng(1))
    again = model.sample(np.tile(pose, (_DRAWS, 1)), u, dt, V, np.random.default_rng(1))
    _close("the same seed", again, drawn)
    off = _turned(drawn, model.step(pose, u, dt))
    F_u = model.jacobians(pose, u, dt)[1]
    Q = F_u @ V @ F_u.T
    size = np.trace(Q)
    if np.linalg.norm(off.mean(0)) > 0.05 * np.sqrt(size):
        raise _Broken(f"the mean of many is off the step by {off.mean(0)}")
    if np.abs(np.cov(off.T) - Q).max() > 0.05 * size:
        raise _Broken("the covariance of many is not F_u V F_u^T")


def _motion_still(model: MotionModel, u: Array, dt: float, poses: Array, **_rest: Any) -> None:
    pose, moved = poses[0, 0], model.step(poses[0, 0], u, 2 * dt)
    matters = not np.allclose(moved, model.step(pose, u, dt))
    expected = pose if matters else moved
    _close("a step of dt = 0", model.step(pose, u, 0.0), expected)


def _motion_arguments(
    model: MotionModel, dt: float, V: Array, poses: Array, controls: Array, **_rest: Any
) -> None:
    _untouched(model.step, poses[0], controls, dt)
    _untouched(model.jacobians, poses[0], controls, dt)
    _untouched(model.sample, poses[0], controls, dt, V, np.random.default_rng(2))


def _motion_refusals(model: MotionModel, u: Array, dt: float, poses: Array, **_rest: Any) -> None:
    bad, generator = np.array([0.0, np.nan, 0.0]), np.random.default_rng(3)
    _refuses({"pose"}, "a pose of shape (2,)", lambda: model.step(np.zeros(2), u, dt))
    _refuses({"pose"}, "a pose with NaN", lambda: model.step(bad, u, dt))
    _refuses({"u"}, "a control with NaN", lambda: model.step(poses[0], u * np.nan, dt))
    _refuses({"u"}, "too long a control", lambda: model.step(poses[0], np.append(u, 0), dt))
    _refuses({"pose"}, "a pose with NaN", lambda: model.jacobians(bad, u, dt))
    _refuses(
        {"control_cov"},
        "a covariance with an eigenvalue below 0",
        lambda: model.sample(poses[0], u, dt, -np.eye(len(u)), generator),
    )


def _motion_equivariance(
    model: MotionModel, u: Array, dt: float, poses: Array, **_rest: Any
) -> None:
    here, there = model.step(poses, u, dt), model.step(compose(_TURN, poses), u, dt)
    off = _turned(there, compose(_TURN, here))
    _close("a step in a turned world", off, np.zeros_like(off))


_MOTION: dict[str, Property] = {
    "jacobians": _motion_jacobians,
    "leading axes": _motion_leading_axes,
    "sample": _motion_sample,
    "dt = 0": _motion_still,
    "arguments": _motion_arguments,
    "refusals": _motion_refusals,
    "equivariance": _motion_equivariance,
}


# What a sensor promises: from poses x (4, 3), of landmarks m (4, 2).


def _sensor_cov(sensor: LandmarkSensor, **_rest: Any) -> None:
    _covariance("cov", np.asarray(sensor.cov), (2, 2))


def _sensor_jacobians(sensor: LandmarkSensor, x: Array, m: Array, **_rest: Any) -> None:
    H_x, H_m = sensor.jacobians(x, m)
    z, off = sensor.observe(x, m), sensor.residual
    _close("H_pose", H_x, _slopes(lambda a: sensor.observe(a, m), x, off))
    _close("H_landmark", H_m, _slopes(lambda a: sensor.observe(x, a), m, off))
    G_x, G_z = sensor.locate_jacobians(x, z)
    _close("G_pose", G_x, _slopes(lambda a: sensor.locate(a, z), x))
    _close("G_z", G_z, _slopes(lambda a: sensor.locate(x, a), z))


def _sensor_locate(sensor: LandmarkSensor, x: Array, m: Array, **_rest: Any) -> None:
    z = sensor.observe(x, m)
    _close("locate(observe(landmark))", sensor.locate(x, z), m)
    off = sensor.residual(sensor.observe(x, sensor.locate(x, z)), z)
    _close("observe(locate(z)) - z", off, np.zeros((4, 2)))


def _sensor_residual(sensor: LandmarkSensor, x: Array, m: Array, **_rest: Any) -> None:
    z, small = sensor.observe(x, m), np.array([0.01, -0.02])
    _close("z - (z - d)", sensor.residual(z, z - small), np.broadcast_to(small, z.shape))
    # Once round on the spot, and back to the same heading with another number.
    turn = np.linspace(0, 2 * np.pi, 91)
    seen = sensor.observe(x[:1] + turn[:, None] * [0, 0, 1], m[:1])
    jumps = np.abs(sensor.residual(np.roll(seen, -1, 0), seen))
    if jumps.max() > 2:
        raise _Broken(
            f"jumps by {jumps.max():.3g} as the robot turns: wrap what measures an angle"
        )


def _sensor_leading_axes(sensor: LandmarkSensor, x: Array, m: Array, **_rest: Any) -> None:
    for name in ("observe", "locate", "jacobians", "locate_jacobians", "visible"):
        f, second = getattr(sensor, name), sensor.observe(x, m) if "locate" in name else m
        alone = [f(a, b) for a, b in zip(x, second, strict=True)]
        for got, each in _parts(f(x, second), alone):
            _close(name, got, each)
        for got, each in _parts(f(np.tile(x, (3, 1, 1)), second), alone):
            _close(name, got, np.broadcast_to(each, (3, *each.shape)))


def _sensor_arguments(sensor: LandmarkSensor, x: Array, m: Array, **_rest: Any) -> None:
    z = sensor.observe(x, m)
    for f, second in ((sensor.observe, m), (sensor.jacobians, m), (sensor.locate, z)):
        _untouched(f, x, second)
    _untouched(sensor.residual, z, z + 4.0)


def _sensor_refusals(sensor: LandmarkSensor, x: Array, m: Array, **_rest: Any) -> None:
    z, lost = sensor.observe(x, m), np.array([np.nan, 1.0])
    _refuses({"pose"}, "a pose of shape (2,)", lambda: sensor.observe(np.zeros(2), m))
    _refuses({"landmark", "wall"}, "a landmark with NaN", lambda: sensor.observe(x, lost))
    _refuses({"pose"}, "a pose with NaN", lambda: sensor.jacobians(x * np.nan, m))
    _refuses({"z"}, "a measurement with NaN", lambda: sensor.locate(x, lost))
    _refuses({"z"}, "a measurement of shape (4, 3)", lambda: sensor.locate(x, x))
    _close("observe after all that", sensor.observe(x, m), z)


_SENSOR: dict[str, Property] = {
    "cov": _sensor_cov,
    "jacobians": _sensor_jacobians,
    "locate": _sensor_locate,
    "residual": _sensor_residual,
    "leading axes": _sensor_leading_axes,
    "arguments": _sensor_arguments,
    "refusals": _sensor_refusals,
}


# What an estimator promises, driven along a log from `start`; u, dt and V are of one of its steps.


def _estimator_copies(
    make: Make, log: Log, start: Array, half: int, u: Array, dt: float, V: Array, **_rest: Any
) -> None:
    one, kept, then = make(start.copy()), [], []
    run(one, log[:half])
    for _ in range(4):
        one.predict(u, dt, V)
        kept.append((one.pose, one.pose_cov))
        then.append((one.pose.copy(), one.pose_cov.copy()))
    for held, was in zip(kept, then, strict=True):
        _same("a pose kept from before", held, was)
    pose, cov = one.pose, one.pose_cov
    pose[...], cov[...] = 99.0, 99.0
    _same("after writing into `pose` and `pose_cov`", (one.pose, one.pose_cov), then[-1])


def _estimator_arguments(make: Make, log: Log, start: Array, **_rest: Any) -> None:
    one, twin = make(start.copy()), make(start.copy())
    for k in range(len(log)):
        run(twin, log[k : k + 1])
        _fed_and_scribbled(one, log, k)
        _same(f"step {k}, arguments changed after the call", _belief(one), _belief(twin))


def _estimator_covariance(make: Make, log: Log, start: Array, **_rest: Any) -> None:
    result = run(make(start.copy()), log)
    if not np.isfinite(result.poses).all() or result.poses.shape[1:] != start.shape:
        raise _Broken(f"poses: expected finite {start.shape}, got {result.poses.shape}")
    for cov in result.covs:
        _covariance("pose_cov", cov, (*start.shape, 3))


def _estimator_repeatable(make: Make, log: Log, start: Array, **_rest: Any) -> None:
    one, two = run(make(start.copy()), log), run(make(start.copy()), log)
    _same("a second run", (one.poses, one.covs), (two.poses, two.covs))


def _estimator_refusals(make: Make, log: Log, start: Array, half: int, **_rest: Any) -> None:
    one, twin = make(start.copy()), make(start.copy())
    run(one, log[:half])
    run(twin, log[:half])
    for names, what, call in _bad_calls(one, log, half):
        _refuses(names, what, call)
        _same(f"after {what} was refused", _belief(one), _belief(twin))
    after, due = run(one, log[half:]), run(twin, log[half:])
    _same("going on after refusals", (after.poses, after.covs), (due.poses, due.covs))


def _estimator_still(
    make: Make, start: Array, u: Array, dt: float, V: Array, **_rest: Any
) -> None:
    beliefs = []
    for duration in (0.0, dt, 2 * dt):
        one = make(start.copy())
        one.predict(u, duration, V)
        beliefs.append(_belief(one))
    if not all(np.isfinite(part).all() for part in beliefs[0]):
        raise _Broken("predict with dt = 0 leads to numbers that are not finite")
    if not np.allclose(beliefs[1][0], beliefs[2][0]):
        _same("predict with dt = 0", beliefs[0], _belief(make(start.copy())))


def _estimator_nothing_seen(make: Make, log: Log, start: Array, half: int, **_rest: Any) -> None:
    one = make(start.copy())
    run(one, log[:half])
    before = _belief(one)
    if one.measures == "ranges" and log.ranges is not None:
        one.update(np.full(log.ranges.shape[1], np.nan))
    elif one.measures == "looks" and start.ndim == 1:
        one.update(np.empty((0, 2)), [] if log.ids is not None else None)
    _same("an update without any measurement", _belief(one), before)


def _estimator_turned_world(
    make: Make, log: Log, start: Array, equivariance: float, **_rest: Any
) -> None:
    one, other = run(make(start.copy()), log), run(make(compose(_TURN, start)), log)
    off = _turned(other.poses, compose(_TURN, one.poses))
    _close("poses in a turned world", off, np.zeros_like(off), equivariance)
    if equivariance > 1e-6:
        return
    R = np.eye(3)
    R[:2, :2] = rotation(_TURN[2])
    size = 1e-5 * np.abs(one.covs).max() + 1e-12
    _close("covariances in a turned world", other.covs, R @ one.covs @ R.T, size)


_ESTIMATOR: dict[str, Property] = {
    "copies": _estimator_copies,
    "arguments": _estimator_arguments,
    "covariance": _estimator_covariance,
    "repeatable": _estimator_repeatable,
    "refusals": _estimator_refusals,
    "dt = 0": _estimator_still,
    "nothing measured": _estimator_nothing_seen,
    "equivariance": _estimator_turned_world,
}


def _protocol(system: Any) -> None:
    as_estimator("system", system)
    if system.measures not in MEASURES:
        raise _Broken(f"measures: expected one of {MEASURES}, got {system.measures!r}")


# Feeding, and feeding wrongly.


def _belief(system: Estimator) -> tuple[Array, Array]:
    return np.array(system.pose), np.array(system.pose_cov)


def _measured(system: Estimator, log: Log, k: int) -> tuple[Array | None, Any]:
    """Copy what the system measures in step k, clutter left out, and the names."""
    step = log.step(k)
    z = {"ranges": step.ranges, "looks": step.z}.get(system.measures)
    if z is None or system.measures == "ranges" or step.ids is None:
        return None if z is None else z.copy(), None
    real = step.ids >= 0 if step.ids.dtype.kind in "iu" else np.ones(len(step.ids), bool)
    return z[..., real, :].copy(), step.ids[real].copy()


def _fed_and_scribbled(system: Estimator, log: Log, k: int) -> None:
    """Feed step k, see that the arguments are as they were, then overwrite them all."""
    step = log.step(k)
    u, V, (z, ids) = step.u.copy(), step.control_cov.copy(), _measured(system, log, k)
    was: list[Any] = [None if part is None else part.copy() for part in (u, V, z, ids)]
    if step.dt > 0:
        system.predict(u, step.dt, V)
    if z is not None:
        system.update(z, ids)
    for name, part, old in zip(("u", "control_cov", "z", "ids"), (u, V, z, ids), was, strict=True):
        if part is not None and not np.array_equal(part, old, equal_nan=part.dtype.kind == "f"):
            raise _Broken(f"step {k} changed its argument {name}")
        if part is not None:
            part[...] = 0


def _bad_calls(system: Estimator, log: Log, half: int) -> list[tuple[set[str], str, Any]]:
    """List calls to refuse: names of which the message begins with one, what is wrong, call."""
    step = next((step for step in log if step.dt > 0), log.step(0))
    u, dt, V = step.u, step.dt, step.control_cov
    calls: list[tuple[set[str], str, Any]] = [
        ({"u"}, "a control with NaN", lambda: system.predict(u * np.nan, dt, V)),
        ({"control_cov"}, "a covariance with NaN", lambda: system.predict(u, dt, V * np.nan)),
        (
            {"control_cov"},
            "a covariance with an eigenvalue below 0",
            lambda: system.predict(u, dt, -np.eye(u.shape[-1])),
        ),
        (
            {"control_cov"},
            "a covariance of another size",
            lambda: system.predict(u, dt, np.eye(u.shape[-1] + 1)),
        ),
        (
            {"u", "control_cov"},
            "too long a control",
            lambda: system.predict(np.append(u, 0.0), dt, V),
        ),
    ]
    seen = [_measured(system, log, k) for k in range(half, len(log))]
    fit = [(z, ids) for z, ids in seen if z is not None and len(z)]
    if not fit:
        return calls
    (z, ids), names = fit[0], {"z", "measurement", "ranges", "scan"}
    calls.append((names, "a measurement of words", lambda: system.update(["one", "two"], ids)))
    if system.measures == "ranges":
        calls.append((names, "too long a scan", lambda: system.update(np.append(z, 1.0))))
        below = np.append(z[:-1], -1.0)
        calls.append((names, "a range below 0", lambda: system.update(below)))
        return calls
    wide = np.concatenate([z, z[..., :1]], -1)
    calls.append((names, "measurements of three numbers", lambda: system.update(wide, ids)))
    if z.ndim == 2:
        lost = z.copy()
        lost[-1] = np.nan
        calls.append((names, "NaN in the last measurement", lambda: system.update(lost, ids)))
    if ids is not None:
        more = np.append(ids, ids[:1])
        calls.append(({"ids"}, "one id too many", lambda: system.update(z, more)))
    return calls


# Judging.


def _judged(
    subject: Any,
    protocol: Callable[[], Any],
    table: dict[str, Property],
    case: dict[str, Any],
    left_out: tuple[str, ...] = (),
) -> Verdict:
    """Try every property of a table; if the protocol is broken, that one alone."""
    found = {"protocol": _tried(protocol)}
    if not found["protocol"]:
        found["repr"] = _tried(lambda: _one_line(subject))
        kept = {name: check for name, check in table.items() if name not in left_out}
        found |= {name: _tried(partial(check, **case)) for name, check in kept.items()}
    return Verdict(type(subject).__name__, found)


def _tried(check: Callable[[], Any]) -> str:
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


def _close(what: str, got: ArrayLike, due: ArrayLike, tolerance: float = 1e-6) -> None:
    got, due = np.asarray(got, float), np.asarray(due, float)
    if got.shape != due.shape:
        raise _Broken(f"{what}: expected shape {due.shape}, got {got.shape}")
    worst = np.abs(got - due).max(initial=0.0)
    if not worst <= tolerance:
        square = got.shape[-2:] == due.shape[-2:][::-1]
        if square and got.ndim > 1 and np.allclose(np.swapaxes(got, -1, -2), due, atol=1e-6):
            raise _Broken(f"{what}: this is the transpose")
        raise _Broken(f"{what}: off by {worst:.3g}")


def _same(what: str, got: tuple[Array, ...], due: tuple[Array, ...]) -> None:
    for name, one, other in zip(("pose", "pose_cov"), got, due, strict=True):
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


def _refuses(names: set[str], what: str, call: Callable[[], Any]) -> None:
    try:
        call()
    except ValueError as error:
        said = str(error).partition(":")[0]
        if not any(said == name or said.startswith((f"{name}[", f"{name},")) for name in names):
            wanted = " or ".join(sorted(names))
            raise _Broken(
                f"{what}: the message does not name {wanted}: {str(error)[:80]}"
            ) from error
        return
    except Exception as error:
        raise _Broken(f"{what}: expected ValueError, got {type(error).__name__}") from error
    raise _Broken(f"{what}: expected ValueError, nothing was raised")


def _turned(a: Array, b: Array) -> Array:
    """Difference of poses, the heading wrapped."""
    off = np.asarray(a, float) - b
    off[..., 2] = wrap_angle(off[..., 2])
    return off


def _slopes(f: Callable[[Array], Array], x: Array, off: Any = np.subtract) -> Array:
    """Central differences of f by the last axis of x, shape (..., m, n)."""
    steps = _STEP * np.eye(x.shape[-1])
    return np.stack([off(f(x + h), f(x - h)) / (2 * _STEP) for h in steps], -1)


def _parts(got: Any, alone: list[Any]) -> list[tuple[Array, Array]]:
    """Each array of an answer beside those of single calls."""
    if isinstance(got, tuple):
        return [(part, np.array([each[k] for each in alone])) for k, part in enumerate(got)]
    return [(got, np.array(alone))]
