"""A run in one figure: the map, the path, and each error in the tube that the filter reports."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_instance, as_shaped
from slamlab.evaluation.run import Run
from slamlab.geometry import wrap_angle
from slamlab.logs import Log
from slamlab.plots._draw import ellipse, error_band, floor, landmarks, path

NAMES = {"truth": "truth", "dead_reckoning": "wheels", "estimate": "estimate"}


def show(
    result: Run | ArrayLike,
    covs: ArrayLike | None = None,
    log: Log | None = None,
    *,
    map_mean: ArrayLike | None = None,
    map_cov: ArrayLike | None = None,
    wheels: Run | ArrayLike | None = None,
    title: str = "",
) -> Figure:
    """Draw a run: map and path on the left, the errors of x, y and heading on the right.

    Each error stands in its tube of two reported standard deviations. Your own filter needs no
    class: give its arrays.

    Parameters
    ----------
    result : Run, or array_like, shape (T, 3)
        A run of one robot, or poses (m, m, rad) at every step of `log`.
    covs : array_like, shape (T, 3, 3)
        Covariances of the poses. Needed with poses, not with a run.
    log : Log
        Where the poses come from; its truth and its landmarks are drawn. Needed with poses, not
        with a run.
    map_mean : array_like, shape (n, 2), optional
        Estimated landmarks (m). Of a run: those of its system, if it has some.
    map_cov : array_like, shape (n, 2, 2), optional
        Their covariances, drawn as 95 % ellipses.
    wheels : Run, or array_like, shape (k, 3), optional
        A second path, dashed: what the wheels alone give.
    title : str, default ""
        What the map shows, as a sentence.

    Returns
    -------
    Figure
        A notebook shows it where it ends a cell. Its axes are labelled
        "map", "x", "y" and "heading". Without truth there is the map only.

    Examples
    --------
    >>> import numpy as np
    >>> from slamlab.evaluation import run
    >>> from slamlab.simulation import ROOM_SENSOR, room_drives
    >>> from slamlab.slam import EKFSlam
    >>> from slamlab.robots import YOUBOT
    >>> log = room_drives(1, np.random.default_rng(0), n_steps=20).single(0)
    >>> figure = show(run(EKFSlam(YOUBOT, ROOM_SENSOR, log.truth[0]), log), title="Two seconds")
    >>> [axes.get_label() for axes in figure.axes]
    ['map', 'x', 'y', 'heading']
    """
    if isinstance(result, Run):
        if covs is not None or log is not None:
            raise ValueError("covs, log: expected none beside a run, which has its own")
        poses, rows, log = result.poses, result.rows, result.log
        covs = as_shaped("covs", result.covs, ("n", 3, 3))
        poses = as_array("result: poses of one robot", poses, ("n", 3))
        map_mean, map_cov = _map_of(result.system, map_mean, map_cov)
    else:
        log = as_instance("log", log, Log)
        poses, rows = as_array("result", result, (len(log), 3)), np.arange(len(log))
        covs = as_array("covs", [] if covs is None else covs, (len(log), 3, 3))
    mean = np.empty((0, 2)) if map_mean is None else as_shaped("map_mean", map_mean, ("n", 2))
    if map_cov is not None:
        map_cov = as_shaped("map_cov", map_cov, (len(mean), 2, 2))
    other = wheels.poses if isinstance(wheels, Run) else wheels
    if other is not None:
        other = as_array("wheels", other, ("n", 3))
    if log.truth is not None and log.truth.ndim != 2:
        raise ValueError(f"log: expected a drive of one robot, got {log!r}")
    layout = "axxx;ayyy;attt" if log.truth is not None else "a"
    ratios = [2.6, 1, 1, 1] if log.truth is not None else [1]
    figure = Figure(figsize=(7, 3.9), layout="constrained")  # unknown to pyplot: shown once
    axes = figure.subplot_mosaic(layout, width_ratios=ratios)
    for name, ax in zip(("map", "x", "y", "heading"), axes.values(), strict=False):
        ax.set_label(name)
    _draw_map(axes["a"], log, poses, other, mean, map_cov)
    axes["a"].set_title(title or "Map and path")
    if log.truth is not None:
        _draw_tubes([axes[key] for key in "xyt"], log.times[rows], poses - log.truth[rows], covs)
    return figure


def _map_of(system: Any, mean: Any, cov: Any) -> tuple[Any, Any]:
    """Landmarks of a system and their covariances, if it has points; those given come first."""
    own = getattr(system, "landmarks", None)
    if mean is None and isinstance(own, np.ndarray) and own.ndim == 2 and own.shape[1] == 2:
        mean = own
        covs = getattr(system, "landmark_covs", None)
        fits = isinstance(covs, np.ndarray) and covs.shape == (len(own), 2, 2)
        cov = covs if cov is None and fits else cov
    return mean, cov


def _draw_map(
    ax: Axes, log: Log, poses: Array, wheels: Array | None, mean: Array, cov: Array | None
) -> None:
    if log.landmarks is not None and log.landmarks.ndim == 2:
        landmarks(ax, log.landmarks)
    if cov is not None:
        for one, P in zip(mean, cov, strict=True):
            if np.isfinite(one).all():
                ellipse(ax, one, P)
    landmarks(ax, mean, estimated=True)
    for kind, drawn in (("dead_reckoning", wheels), ("estimate", poses), ("truth", log.truth)):
        if drawn is not None:
            path(ax, drawn, kind, label=NAMES[kind])
    floor(ax)
    ax.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, frameon=False, fontsize=9,
        handlelength=1.6, columnspacing=1.0,
    )  # fmt: skip


def _draw_tubes(axes: list[Axes], times: Array, error: Array, covs: Array) -> None:
    error = np.column_stack([error[:, :2], np.degrees(wrap_angle(error[:, 2]))])
    sigma = np.sqrt(np.diagonal(covs, axis1=1, axis2=2).clip(0)) * [1, 1, np.degrees(1)]
    for j, (ax, name) in enumerate(zip(axes, ("x (m)", "y (m)", "heading (°)"), strict=True)):
        error_band(ax, times, error[:, j], sigma[:, j], name)
        ax.set_ylabel(name)
        ax.tick_params(labelbottom=j == 2)
    axes[0].set_title("Errors and the reported ±2σ", fontsize=11)
    axes[2].set_xlabel("time (s)")
