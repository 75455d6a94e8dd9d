"""A log goes into a system, a run comes out: the one loop of the house."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import Array, as_choice, as_count, as_instance, as_tuple
from slamlab._optional import with_bar
from slamlab.logs import Log, Step
from slamlab.models import Estimator, Smoother, as_estimator

__all__ = ["Run", "run"]

# What a system measures, and the part of a log that tells it.
_PARTS = {"landmarks": "landmark_measurements", "scan": "ranges"}
MEASURES = (*_PARTS, "odometry")


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """What a system made of a log; R steps were recorded.

    Attributes
    ----------
    log : Log
        What it was fed.
    system : Estimator
        The system as the log left it: its map is still in there.
    rows : ndarray of int, shape (R,)
        Which steps of the log were recorded.
    poses : ndarray, shape (R, 3) or (R, M, 3)
        What it believed then (m, m, rad).
    covs : ndarray, shape (R, 3, 3) or (R, M, 3, 3)
    reports : tuple of length T
        What `update` returned in each step of the log; None where nothing was measured.
    seconds : ndarray, shape (T,)
        Computing time of each step (s).
    recorded : dict of name to list of length R
        The attributes of the system that were asked for with `record`.
    """

    log: Log
    system: Estimator
    rows: NDArray[np.intp]
    poses: Array
    covs: Array
    reports: tuple[Any, ...]
    seconds: Array
    recorded: dict[str, list[Any]]

    def __repr__(self) -> str:
        """Say in one line who ran over what."""
        name = type(self.system).__name__
        return f"Run({name} over {len(self.log)} steps, {len(self.rows)} recorded)"

    @property
    def times(self) -> Array:
        """When the recorded steps ended (s), shape (R,)."""
        return self.log.times[self.rows]

    @property
    def truth(self) -> Array:
        """True poses of the recorded steps; ValueError if the log knows none."""
        if self.log.truth is None:
            raise ValueError("run: expected a log with truth to compare with, it has none")
        return self.log.truth[self.rows]

    @property
    def trajectory(self) -> Array:
        """Best poses (R, 3) when all is over: revised ones of a smoother, else `poses`."""
        if isinstance(self.system, Smoother):
            return self.system.trajectory[self.rows]
        return self.poses


def run(
    system: Estimator,
    log: Log,
    every: int = 1,
    *,
    record: Sequence[str] = (),
    known_ids: bool | int = True,
    progress: bool | Callable[[int, int], object] = False,
) -> Run:
    """Feed a log to a system, step by step: predict, update, record.

    Parameters
    ----------
    system : Estimator
        It is changed, and found again in the result. `system.measures` says whether it is fed the
        measurements of landmarks or the scans of the log.
    log : Log
        A step of dt = 0 is not predicted. Where `ids` are handed over, clutter (-1) is left out.
    every : int, default 1
        Record every so many steps, and the last one.
    record : sequence of str, default ()
        Names of attributes of the system, such as "landmarks" or "particles", to record as well.
    known_ids : bool or int, default True
        Whether the system is given which landmark is which: always, never, or in the first so
        many steps.
    progress : bool or callable, default False
        Show a progress bar; or call ``progress(done, total)`` after each step.

    Returns
    -------
    Run

    Raises
    ------
    ValueError
        If the log lacks what `system` measures; or what the system says of a step, with its
        number.
    ImportError
        If tqdm is not installed and `progress` is wanted.

    Examples
    --------
    >>> from slamlab.localization import DeadReckoning
    >>> from slamlab.robots import Unicycle
    >>> log = Log([0, 1, 2], [[0, 0], [1, 0], [1, 0]], [0, 1, 1], np.eye(2) * 0.01,
    ...           truth=[[0, 0, 0], [1.1, 0, 0], [2.1, 0, 0]])
    >>> run(DeadReckoning(Unicycle(), [0, 0, 0]), log).poses[:, 0].tolist()
    [0.0, 1.0, 2.0]
    """
    as_estimator("system", system)
    as_instance("log", log, Log)
    names = as_tuple("record", record)
    every = as_count("every", every, 1)
    what = as_choice("system.measures", system.measures, MEASURES)
    part = _PARTS.get(what)
    if part is not None and getattr(log, part) is None:
        raise ValueError(f"log: expected {part} for {type(system).__name__}, it has none")
    given = (
        len(log) * known_ids if isinstance(known_ids, bool) else as_count("known_ids", known_ids)
    )
    rows, records, reports, seconds = [], [], [], np.zeros(len(log))
    for k, step in enumerate(with_bar(log, progress, len(log), "step")):
        start = perf_counter()
        try:
            reports.append(_advance(system, step, what, k < given))
        except ValueError as error:
            raise ValueError(f"step {k} of the log: {error}") from error
        seconds[k] = perf_counter() - start
        if k % every == 0 or k == len(log) - 1:
            rows.append(k)
            records.append((system.pose, system.pose_cov, [_copy(system, name) for name in names]))
    poses, covs = (np.array([one[i] for one in records]) for i in (0, 1))
    kept: dict[str, list[Any]] = {name: [r[2][i] for r in records] for i, name in enumerate(names)}
    return Run(log, system, np.array(rows, int), poses, covs, tuple(reports), seconds, kept)


def _advance(system: Any, step: Step, what: str, given: bool) -> Any:
    """One step: predict if anything moved, update if anything was measured."""
    if step.dt > 0:
        system.predict(step.u, step.dt, step.control_cov)
    if what == "scan":
        return system.update(step.ranges)
    if what == "odometry" or step.z is None:
        return None
    z, covs, ids = step.z, step.covs, None
    if given and step.ids is not None:
        kept = step.is_landmark
        z, ids = z[..., kept, :], step.ids[kept]
        covs = None if covs is None else covs[kept]
    return system.update(z, ids) if covs is None else system.update(z, ids, covs=covs)


def _copy(system: Estimator, name: str) -> Any:
    if not (isinstance(name, str) and hasattr(system, name)):
        raise ValueError(f"record: expected attributes of {type(system).__name__}, got {name!r}")
    value = getattr(system, name)
    return value.copy() if isinstance(value, np.ndarray) else value
