"""Is a filter consistent, and does a changed one still seem so? Many drives, one criterion.

The NEES of Bar-Shalom over several sets of drives, and the same code with one piece replaced;
every lesson that asks which line matters most.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_instance, as_tuple
from slamlab.evaluation.consistency import chi2_band, nees_where_uncertain, pose_errors
from slamlab.evaluation.run import Run
from slamlab.logs import Log

__all__ = ["Trial", "changed", "trial"]


@dataclass(frozen=True, eq=False)
class Trial:
    """Errors and NEES of a filter on S sets of M drives with T steps each.

    The criterion: the mean NEES of all S M drives at one step lies in the 99 % band of that many
    independent drives. Steps of one drive are correlated, so that a mean over steps has no such
    band; choose the step before the result is seen.

    Attributes
    ----------
    rmse : ndarray, shape (S,)
        Position error of each set (m), root mean square over its drives and steps but the first.
    nees : ndarray, shape (S, T)
        Mean NEES of the pose over the drives of each set; NaN where a covariance is singular.
    n_runs : int
        M, drives in a set.
    """

    rmse: Array
    nees: Array
    n_runs: int
    columns: ClassVar[tuple[str, ...]] = (
        "filter",
        "position RMSE (cm)",
        "NEES of a set",
        "NEES of all",
        "in the band",
    )

    def __repr__(self) -> str:
        """Say the size and the result at the last step."""
        sets, text = len(self.rmse), _limited(self.mean_nees(), 1, 1000)
        return f"Trial({sets} sets of {self.n_runs} drives, NEES {text} at the end)"

    def band(self, probability: float = 0.99) -> tuple[float, float]:
        """Band of the mean NEES of all drives at one step; 3 is expected."""
        return chi2_band(3, len(self.rmse) * self.n_runs, probability)

    def mean_nees(self, step: int = -1) -> float:
        """Mean NEES of all drives at one step."""
        return float(self.nees[:, step].mean())

    def consistent(self, step: int = -1, probability: float = 0.99) -> bool:
        """Say whether the mean NEES of all drives at one step lies in its band."""
        low, high = self.band(probability)
        return bool(low <= self.mean_nees(step) <= high)

    def row(self, name: str, step: int = -1) -> tuple[str, str, str, str, str]:
        """One row of a table with the heads `columns`: least to largest of the sets, and all.

        A filter that diverges shows digits that differ from machine to machine, so that an error
        of a metre and more is "over 100" (cm), a NEES of a thousand and more "over 1000".
        """
        scores = self.nees[:, step]
        return (
            name,
            _spread(100 * self.rmse, 100),
            _spread(scores, 1000),
            _limited(self.mean_nees(step), 1, 1000),
            "yes" if self.consistent(step) else "no",
        )


def _limited(value: float, digits: int, limit: float) -> str:
    return f"{value:.{digits}f}" if value < limit else f"over {limit:.0f}"


def _spread(values: Array, limit: float) -> str:
    low, high = (_limited(float(value), 1, limit) for value in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def trial(
    estimate: Callable[[Log], Run | tuple[ArrayLike, ArrayLike]],
    sets: Log | Sequence[Log],
    *,
    one_by_one: bool = False,
) -> Trial:
    """Run a filter on sets of drives; measure its position errors and the NEES of its pose.

    Parameters
    ----------
    estimate : callable
        ``estimate(log)`` returns a `Run`, or poses (..., 3) and their covariances (..., 3, 3) at
        every step of the log: your own filter needs no class.
    sets : Log or sequence of S Log
        Simulated drives with truth, each log a batch of M runs, all of the same shape.
    one_by_one : bool, default False
        Whether `estimate` takes one drive (``log.single(i)``) and not the batch.

    Returns
    -------
    Trial

    Examples
    --------
    >>> from slamlab.localization import DeadReckoning
    >>> from slamlab.robots import YOUBOT
    >>> from slamlab.simulation import room_drives
    >>> from slamlab.evaluation import run
    >>> drives = room_drives(20, np.random.default_rng(0), n_steps=20)
    >>> trial(lambda log: run(DeadReckoning(YOUBOT, log.truth[0]), log), drives).consistent()
    True
    """
    if not callable(estimate):
        raise ValueError(f"estimate: expected a function of a log, got {estimate!r:.80}")
    logs = (sets,) if isinstance(sets, Log) else as_tuple("sets", sets)
    if not logs:
        raise ValueError("sets: expected at least one log, got none")
    errors, scores = [], []
    for log in logs:
        as_instance("sets", log, Log)
        if log.truth is None or log.truth.ndim != 3:
            raise ValueError(f"sets: expected batches of drives with truth, got {log!r}")
        if one_by_one:
            singles = [log.single(i) for i in range(log.truth.shape[1])]
            parts = [_poses_and_covs(estimate(one), (len(log), 3)) for one in singles]
            poses, covs = (np.stack(each, 1) for each in zip(*parts, strict=True))
        else:
            poses, covs = _poses_and_covs(estimate(log), log.truth.shape)
        e = pose_errors(poses, log.truth)
        errors.append(np.sqrt((e[1:, :, :2] ** 2).sum(-1).mean()))
        scores.append(nees_where_uncertain(e, covs).mean(1))
    if len({score.shape for score in scores}) > 1 or len({log.truth.shape for log in logs}) > 1:
        raise ValueError("sets: expected logs of one shape, got several")
    return Trial(np.array(errors), np.array(scores), logs[0].truth.shape[1])


def _poses_and_covs(result: Any, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Return what a filter gave as poses of this shape and their covariances."""
    if isinstance(result, Run):
        result = result.poses, result.covs
    if not isinstance(result, tuple) or len(result) != 2:
        raise ValueError("estimate: expected a Run, or a pair of poses and covariances")
    return as_array("estimate: poses", result[0], shape), as_array(
        "estimate: covs", result[1], (*shape, 3)
    )


def changed(
    functions: Sequence[Callable[..., Any]], old: str, new: str, count: int = 1
) -> Callable[..., Any]:
    """Return the last of some functions, after one piece of their common text was replaced.

    A mistake shown as a replacement shows the reader what exactly was changed. The functions
    call each other in their changed form; everything else keeps its meaning.

    Parameters
    ----------
    functions : sequence of functions
        Written in Python, in a file or a notebook's cell, at the top level; each name once.
    old, new : str
        The piece of text and what comes in its place.
    count : int, default 1
        How often `old` must occur in the text.

    Returns
    -------
    callable
        The changed form of ``functions[-1]``; the given functions stay as they are.

    Raises
    ------
    ValueError
        If `old` does not occur `count` times, the text of a function is not to be had, or what
        comes out is not Python.

    Examples
    --------
    >>> from slamlab.geometry import wrap_angle
    >>> from slamlab.evaluation import trials
    >>> trials._limited(2.0, 1, 10), changed([trials._limited], "over", "at least")(20, 1, 10)
    ('2.0', 'at least 10')
    """
    functions = as_tuple("functions", functions)
    if not functions or not all(inspect.isfunction(each) for each in functions):
        raise ValueError(f"functions: expected functions written in Python, got {functions!r:.80}")
    names = [each.__name__ for each in functions]
    try:
        text = "\n".join(textwrap.dedent(inspect.getsource(each)) for each in functions)
    except (OSError, TypeError) as error:
        raise ValueError(f"functions: expected functions with a text, {error}") from error
    if not isinstance(old, str) or not isinstance(new, str) or not old:
        raise ValueError("old, new: expected two pieces of text, the first not empty")
    found, count = text.count(old), as_count("count", count, 1)
    if found != count:
        wanted = f"a piece that occurs {count} time(s) in {', '.join(names)}"
        raise ValueError(f"old: expected {wanted}, got {found} of {old!r}")
    scope = dict(functions[-1].__globals__)
    try:
        exec(compile("from __future__ import annotations\n" + text.replace(old, new),
                     "<changed>", "exec"), scope)  # fmt: skip
    except SyntaxError as error:
        raise ValueError(f"new: expected what leaves Python, got {new!r} ({error.msg})") from error
    result: Callable[..., Any] = scope[names[-1]]
    return result
