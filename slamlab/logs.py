"""What a robot recorded: controls, measurements, and the truth where somebody knows it.

*A log goes into a system, a run comes out*: simulations and real data give a `Log`, every
estimator eats one (`evaluation.run`). Every chapter from 03 on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_covariance,
    as_distances,
    as_index,
    as_instance,
    as_positive,
    as_scalar,
    as_shaped,
    as_tuple,
)
from slamlab._files import read_npz
from slamlab.models import ScanSensor, as_scan_sensor

__all__ = ["CONTROLS", "Log", "ScanGeometry", "Step"]

CONTROLS = ("velocity", "displacement")


@dataclass(frozen=True, eq=False)
class ScanGeometry:
    """Beams of a planar lidar: what a map needs to know to read a scan.

    Parameters
    ----------
    beam_angles : array_like, shape (n_beams,)
        Directions of the beams, at least one, in the frame of the body (rad); copied.
    max_range : float, default inf
        A range of at least this (m), positive, is a beam that met nothing.
    offset : float, default 0.0
        Distance of the lidar ahead of the body centre (m).

    Examples
    --------
    >>> scan = ScanGeometry([-np.pi / 2, 0.0, np.pi / 2], max_range=10.0)
    >>> scan.points([1.0, 2.0, np.inf]).round(3).tolist()
    [[0.0, -1.0], [2.0, 0.0], [nan, nan]]
    """

    beam_angles: Array
    max_range: float = np.inf
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        angles = as_array("beam_angles", self.beam_angles, ("n_beams",))
        if len(angles) == 0:
            raise ValueError("beam_angles: expected at least one beam, got none")
        object.__setattr__(self, "beam_angles", _frozen(angles))
        as_positive("max_range", self.max_range)
        as_scalar("offset", self.offset, -1e300, 1e300)

    @property
    def n_beams(self) -> int:
        """Number of beams."""
        return len(self.beam_angles)

    def points(self, ranges: ArrayLike, poses: ArrayLike | None = None) -> Array:
        """End points of scans, in the body frame or, with poses, in the world.

        Parameters
        ----------
        ranges : array_like, shape (..., n_beams)
            Measured ranges (m), not negative; NaN, or `max_range` and more, is a beam that met
            nothing.
        poses : array_like, shape (..., 3), optional
            One pose (m, m, rad) a scan.

        Returns
        -------
        ndarray, shape (..., n_beams, 2)
            NaN where a beam met nothing.
        """
        ranges = as_distances("ranges", ranges, ("...", self.n_beams))
        ranges = np.where(ranges < self.max_range, ranges, np.nan)
        pose = np.zeros(3) if poses is None else as_array("poses", poses, ("...", 3))
        heading = pose[..., 2, None]
        beams = heading + self.beam_angles
        x = pose[..., 0, None] + self.offset * np.cos(heading) + ranges * np.cos(beams)
        y = pose[..., 1, None] + self.offset * np.sin(heading) + ranges * np.sin(beams)
        return np.stack([x, y], -1)


@dataclass(frozen=True, eq=False)
class Step:
    """One step of a log: what was commanded, then what was measured. None is "not recorded".

    Attributes
    ----------
    time, dt : float
        When the step ended and how long it took (s); dt = 0 moved nothing.
    u : ndarray, shape (p,)
    control_cov : ndarray, shape (p, p)
    z, ids, covs : ndarray or None, shapes (k, 2), (k,), (k, 2, 2)
        Measurements of landmarks, which ones they are (-1 is clutter), their own covariances.
    ranges : ndarray or None, shape (n_beams,)
    truth : ndarray or None, shape (3,)
    """

    time: float
    dt: float
    u: Array
    control_cov: Array
    z: Array | None
    ids: NDArray[Any] | None
    covs: Array | None
    ranges: Array | None
    truth: Array | None

    @property
    def is_landmark(self) -> NDArray[np.bool_]:
        """Which measurements are, by their ids, of landmarks and not clutter; shape (k,)."""
        ids = np.asarray(self.ids)
        return ids >= 0 if ids.dtype.kind in "iu" else np.ones(len(ids), bool)


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """What a robot recorded in T steps.

    In step k it drove with control ``u[k]`` for ``dt[k]`` seconds; at ``times[k]`` the step was
    over and it measured. A step with dt = 0 moves nothing: logs begin with one, so that the
    first measurement, the first scan and the first true pose have their place.

    Everything is copied and read-only. A batch of M runs side by side has ``u`` (T, p) or
    (T, M, p), ``truth`` (T, M, 3) and `landmark_measurements` (T, M, n, 2), NaN where a
    landmark was not seen.

    Parameters
    ----------
    times : array_like, shape (T,)
        Ends of the steps (s).
    u : array_like, shape (T, p)
        Controls as the motion model takes them; `controls` says which kind they are.
    dt : float or array_like, shape (T,)
        Durations (s), not negative.
    control_cov : array_like, shape (p, p) or (T, p, p)
        Covariance of the control.
    landmark_measurements : sequence of T array_like, shapes (k, 2), optional
        Measurements of landmarks after each step, as the sensor gives them.
    ids : sequence of T array_like, shapes (k,), optional
        Which landmark each measurement belongs to: whole numbers (-1 is clutter) or names.
    covs : sequence of T array_like, shapes (k, 2, 2), optional
        Covariances of single measurements, if they are not the sensor's.
    ranges : array_like, shape (T, n_beams), optional
        Scans (m), not negative; inf is a beam that met nothing, NaN a lost reading.
    scan : ScanSensor, optional
        How the beams lie; needed with `ranges`.
    truth : array_like, shape (T, 3), optional
        True poses at `times`, or the best reference there is.
    landmarks : array_like, shape (n, 2), optional
        True landmarks; row i is the one with id i.
    notes : mapping of name to array_like, shapes (T, ...), optional
        Whatever else was noted in each step, such as collisions.
    controls : {"velocity", "displacement"}, optional
        What `u` means: velocities of the body, driven for `dt` (`robots.Mecanum`, `Unicycle`), or
        the motion of the whole step (dx, dy, dtheta) of `robots.RelativePose`. None: not recorded.

    Examples
    --------
    >>> log = Log([0, 1, 2], [[0, 0], [1, 0], [1, 0]], [0, 1, 1], np.eye(2) * 0.01,
    ...           landmark_measurements=[[[2.0, 0.0]], [[1.0, 0.0]], []], ids=[[7], [7], []])
    >>> log, len(log[1:])
    (Log(3 steps over 2 s, 2 measurements of landmarks), 2)
    >>> [step.z.tolist() for step in log]
    [[[2.0, 0.0]], [[1.0, 0.0]], []]
    """

    times: Array
    u: Array
    dt: Array
    control_cov: Array
    landmark_measurements: tuple[Array, ...] | None = field(default=None, kw_only=True)
    ids: tuple[NDArray[Any], ...] | None = field(default=None, kw_only=True)
    covs: tuple[Array, ...] | None = field(default=None, kw_only=True)
    ranges: Array | None = field(default=None, kw_only=True)
    scan: ScanSensor | None = field(default=None, kw_only=True)
    truth: Array | None = field(default=None, kw_only=True)
    landmarks: Array | None = field(default=None, kw_only=True)
    notes: Mapping[str, NDArray[Any]] = field(default_factory=dict, kw_only=True)
    controls: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check every part and keep copies."""
        T = len(times := as_array("times", self.times, ("T",)))
        u = as_array("u", self.u, ("...", "p"))
        if u.ndim not in (2, 3) or len(u) != T:
            raise ValueError(f"u: expected shape ({T}, p) or ({T}, M, p), got {u.shape}")
        dt = as_array("dt", self.dt, None if np.ndim(self.dt) == 0 else (T,))
        dt = np.broadcast_to(dt, (T,))
        if (dt < 0).any():
            k = int(np.argmax(dt < 0))
            raise ValueError(f"dt[{k}]: expected a duration that is not negative, got {dt[k]:g}")
        checked: dict[str, Any] = {"times": times, "u": u, "dt": dt}
        checked["control_cov"] = self._checked_control_cov(T, u.shape[-1])
        checked |= self._checked_landmark_measurements(T) | self._checked_scans(T)
        if self.truth is not None:
            truth = as_array("truth", self.truth, ("...", 3))
            if truth.ndim not in (2, 3) or len(truth) != T:
                raise ValueError(f"truth: expected shape ({T}, 3), got {truth.shape}")
            checked["truth"] = truth
        if self.landmarks is not None:
            checked["landmarks"] = as_array("landmarks", self.landmarks, ("...", "n", 2))
        as_instance("notes", self.notes, Mapping)
        if self.controls is not None:
            as_choice("controls", self.controls, CONTROLS)
        checked["notes"] = {name: _note(name, value, T) for name, value in self.notes.items()}
        for name, value in checked.items():
            object.__setattr__(self, name, _frozen(value))

    def _checked_control_cov(self, T: int, p: int) -> Array:
        cov = as_covariance("control_cov", self.control_cov, p)
        if cov.ndim > 3 or (cov.ndim == 3 and len(cov) != T):
            shapes = f"({p}, {p}) or ({T}, {p}, {p})"
            raise ValueError(f"control_cov: expected shape {shapes}, got {cov.shape}")
        return cov

    def _checked_landmark_measurements(self, T: int) -> dict[str, Any]:
        if self.landmark_measurements is None:
            if self.ids is not None or self.covs is not None:
                raise ValueError(
                    "landmark_measurements: expected measurements because ids or covs are given"
                )
            return {}
        observations = tuple(
            _measurements(f"landmark_measurements[{k}]", z)
            for k, z in enumerate(_of("landmark_measurements", self.landmark_measurements, T))
        )
        checked: dict[str, Any] = {"landmark_measurements": observations}
        for name, given, check in (("ids", self.ids, _names), ("covs", self.covs, _covs)):
            if given is not None:
                each = enumerate(zip(_of(name, given, T), observations, strict=True))
                checked[name] = tuple(check(f"{name}[{k}]", c, z.shape[-2]) for k, (c, z) in each)
        return checked

    def _checked_scans(self, T: int) -> dict[str, Any]:
        if self.ranges is None:
            return {}
        scan = as_scan_sensor("scan", self.scan)
        ranges = as_shaped("ranges", self.ranges, (T, scan.n_beams))
        if (ranges < 0).any():
            k, beam = np.argwhere(ranges < 0)[0]
            raise ValueError(f"ranges[{k}, {beam}]: expected a distance, got {ranges[k, beam]:g}")
        return {"ranges": ranges}

    def __len__(self) -> int:
        """Return the number T of steps."""
        return len(self.times)

    def __repr__(self) -> str:
        """Say in one line what is in it."""
        over = float(self.times[-1] - self.times[0]) if len(self) else 0.0
        parts = [f"{len(self)} steps over {over:.6g} s"]
        if self.n_runs is not None:
            parts.append(f"{self.n_runs} runs")
        if self.landmark_measurements is not None:
            count = sum(int(np.isfinite(z[..., 0]).sum()) for z in self.landmark_measurements)
            parts.append(f"{count} measurements of landmarks")
        if self.ranges is not None:
            parts.append(f"scans of {self.ranges.shape[1]} beams")
        return f"Log({', '.join(parts)}{', truth' if self.truth is not None else ''})"

    def __iter__(self) -> Iterator[Step]:
        """Give one step after another."""
        return (self.step(k) for k in range(len(self)))

    def step(self, k: int) -> Step:
        """Step number k; counted from the end if negative."""
        k = as_index("k", k, len(self), "steps")
        cov = self.control_cov if self.control_cov.ndim == 2 else self.control_cov[k]
        parts = (self.landmark_measurements, self.ids, self.covs, self.ranges, self.truth)
        z, ids, covs, ranges, truth = (None if part is None else part[k] for part in parts)
        time, dt = float(self.times[k]), float(self.dt[k])
        return Step(time, dt, self.u[k], cov, z, ids, covs, ranges, truth)

    def __getitem__(self, steps: slice) -> Log:
        """Return a stretch of the log; ``log[a:b]`` begins where step a - 1 ended."""
        if not isinstance(steps, slice):
            raise ValueError(f"steps: expected a slice such as log[10:20], got {steps!r:.80}")
        cut: dict[str, Any] = {}
        for name in (
            "times",
            "u",
            "dt",
            "landmark_measurements",
            "ids",
            "covs",
            "ranges",
            "truth",
        ):
            part = getattr(self, name)
            cut[name] = None if part is None else part[steps]
        if self.control_cov.ndim == 3:
            cut["control_cov"] = self.control_cov[steps]
        cut["notes"] = {name: note[steps] for name, note in self.notes.items()}
        return replace(self, **cut)

    @property
    def n_runs(self) -> int | None:
        """Number M of runs side by side, None if the log is of one robot."""
        observations = self.landmark_measurements[0] if self.landmark_measurements else None
        for part, axis in ((self.u, 1), (self.truth, 1), (observations, 0)):
            if part is not None and part.ndim > 2:
                return int(part.shape[axis])
        return None

    def single(self, run: int) -> Log:
        """Return run number `run` of a batch, without the landmarks that it did not see."""
        if self.n_runs is None:
            raise ValueError("run: expected a batch of runs, the log is of one robot")
        run = as_index("run", run, self.n_runs, "runs")
        own: dict[str, Any] = {}
        for name, part in (("u", self.u), ("truth", self.truth)):
            if part is not None and part.ndim == 3:
                own[name] = part[:, run]
        if self.landmarks is not None and self.landmarks.ndim == 3:
            own["landmarks"] = self.landmarks[run]
        if self.landmark_measurements is not None:
            seen = [np.isfinite(z[run]).all(-1) for z in self.landmark_measurements]
            own["landmark_measurements"] = [
                z[run][s] for z, s in zip(self.landmark_measurements, seen, strict=True)
            ]
            if self.ids is not None:
                own["ids"] = [ids[s] for ids, s in zip(self.ids, seen, strict=True)]
        return replace(self, **own)

    # Files.

    def save(self, path: str | Path) -> None:
        """Write the log to a npz archive of plain arrays (no pickle); `load` reads it again."""
        arrays: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                arrays[name] = value
            elif isinstance(value, tuple):
                arrays[f"{name}_sizes"] = np.array([len(part) for part in value], dtype=int)
                arrays[name] = np.concatenate(value) if value else np.empty(0)
        if self.scan is not None:
            arrays["beam_angles"] = self.scan.beam_angles
            arrays["lidar"] = np.array([self.scan.max_range, self.scan.offset])
        if self.controls is not None:
            arrays["controls"] = np.array(self.controls)
        arrays |= {f"note_{name}": note for name, note in self.notes.items()}
        with open(path, "wb") as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a log that `save` wrote.

        Raises
        ------
        ValueError
            If the file is no such archive, is damaged, or its parts do not fit together.
        FileNotFoundError
            If there is no such file.
        """
        arrays = read_npz(path)
        try:
            due = [f.name for f in fields(cls) if f.name in arrays or not f.kw_only]
            parts: dict[str, Any] = {name: arrays[name] for name in due}
            for name in ("landmark_measurements", "ids", "covs"):
                if name in parts:
                    with np.errstate(over="ignore"):  # what is no size is no place to cut at
                        ends = np.cumsum(arrays[f"{name}_sizes"])[:-1]
                    parts[name] = np.split(parts[name], ends) if len(arrays["times"]) else ()
            if "controls" in parts:
                parts["controls"] = str(parts["controls"])
            if "beam_angles" in arrays:
                parts["scan"] = ScanGeometry(
                    arrays["beam_angles"], *as_shaped("lidar", arrays["lidar"], ("n",))
                )
            notes = {name[5:]: note for name, note in arrays.items() if name.startswith("note_")}
            return cls(**parts, notes=notes)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: expected a saved log ({str(error)[:200]})") from error


def _of(name: str, parts: Any, T: int) -> Sequence[Any]:
    if not (isinstance(parts, np.ndarray) and parts.ndim):
        parts = as_tuple(name, parts)
    if len(parts) != T:
        raise ValueError(f"{name}: expected one entry for each of {T} steps, got {len(parts)}")
    return tuple(parts)


def _measurements(name: str, z: Any) -> Array:
    """Measurements (k, 2), or (M, n, 2) of a batch, where NaN is allowed."""
    z = as_shaped(name, z)
    if z.size == 0:
        return z.reshape(0, 2) if z.ndim < 3 else z
    if z.ndim not in (2, 3) or z.shape[-1] != 2:
        raise ValueError(f"{name}: expected shape (k, 2), got {z.shape}")
    return z if z.ndim == 3 else as_array(name, z)


def _names(name: str, ids: Any, k: int) -> NDArray[Any]:
    names = np.asarray(ids)
    if names.size == 0:
        names = names.astype(int)
    if names.shape != (k,) or names.dtype.kind not in "iuU":
        got = f"{names.dtype} of {names.shape}"
        raise ValueError(f"{name}: expected {k} whole numbers or names, got {got}")
    return _native(names)


def _covs(name: str, covs: Any, k: int) -> Array:
    array = as_covariance(name, np.asarray(covs, dtype=float).reshape(-1, 2, 2), 2)
    if len(array) != k:
        raise ValueError(f"{name}: expected {k} covariances, got {len(array)}")
    return array


def _note(name: str, value: Any, T: int) -> NDArray[Any]:
    note = np.asarray(value)
    if note.ndim == 0 or len(note) != T or note.dtype.kind not in "biufU":
        raise ValueError(f"notes[{name!r}]: expected an array with {T} rows, got {note.shape}")
    return _native(note)


def _native(array: NDArray[Any]) -> NDArray[Any]:
    """Return the same entries in the byte order of the machine."""
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def _frozen(value: Any) -> Any:
    """Read-only copies, also inside tuples and mappings."""
    if isinstance(value, tuple):
        return tuple(_frozen(part) for part in value)
    if isinstance(value, dict):
        return {name: _frozen(part) for name, part in value.items()}
    copy = np.array(value)
    copy.setflags(write=False)
    return copy
