"""Does a filter believe itself rightly? NEES, NIS, their band, and Monte Carlo runs.

Bar-Shalom's consistency tests as used by Bailey (2006) for EKF-SLAM; every chapter from 02 on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array, as_count, as_scalar, as_tuple
from slamlab._optional import needed, with_bar
from slamlab.evaluation.run import Run
from slamlab.gaussian import chi2_quantile, mahalanobis_squared
from slamlab.geometry import rotation, wrap_angle

__all__ = ["chi2_band", "invariant_nees", "monte_carlo", "nees", "nis"]

Result = TypeVar("Result")


def nees(
    errors: ArrayLike | tuple[ArrayLike, ArrayLike] | Run,
    covs: ArrayLike | None = None,
    angles: Sequence[int] = (),
) -> Array:
    """Normalised estimation error squared, e^T P^-1 e.

    Its mean is the dimension of the state if the covariance tells the truth; larger means
    overconfident, smaller means too timid. The truth must be known, so this is for simulations.

    Parameters
    ----------
    errors : array_like, shape (..., n), or tuple (estimates, truths) of two such arrays, or Run
        Errors, or the two things to subtract. A tuple of two arrays is always read as the pair.
        Of a run: its poses and their truth, NaN where it claims to know a pose exactly.
    covs : array_like, shape (..., n, n)
        Covariances that the filter claimed; positive definite. Not with a run.
    angles : sequence of int, default ()
        Components that are angles (rad), for example ``(2,)`` for a pose: their error is wrapped.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    A heading of -179 degrees estimated as 179 degrees is off by 2 degrees only:

    >>> estimate, truth = np.radians([179.0]), np.radians([-179.0])
    >>> float(nees((estimate, truth), [[np.radians(2.0) ** 2]], angles=(0,)).round(9))
    1.0
    """
    if isinstance(errors, Run):
        return nees_where_uncertain(pose_errors(errors.poses, errors.truth), errors.covs)
    error = _errors(errors)
    n = error.shape[-1]
    for i in as_tuple("angles", angles):
        if not 0 <= as_count("angles", i) < n:
            raise ValueError(f"angles: expected indices below {n}, got {i}")
        error[..., i] = wrap_angle(error[..., i])
    return mahalanobis_squared(error, as_array("covs", cast(ArrayLike, covs), ("...", n, n)))


def _errors(errors: ArrayLike | tuple[ArrayLike, ArrayLike]) -> Array:
    """Return the errors as a new array, subtracting if a pair came."""
    if isinstance(errors, tuple) and len(errors) == 2 and np.ndim(errors[0]) > 0:
        estimates = as_array("errors[0] (estimates)", errors[0], ("...", "n"))
        truths = as_array("errors[1] (truths)", errors[1], ("...", estimates.shape[-1]))
        if estimates.shape != truths.shape:
            got = f"{estimates.shape} and {truths.shape}"
            raise ValueError(f"errors: expected estimates and truths of one shape, got {got}")
        return estimates - truths
    return as_array("errors", cast(ArrayLike, errors), ("...", "n")).copy()


def pose_errors(poses: Array, truth: Array) -> Array:
    """Return poses less the true ones, the heading wrapped."""
    error = np.asarray(poses, float) - truth
    error[..., 2] = wrap_angle(error[..., 2])
    return error


def nees_where_uncertain(errors: Array, covs: Array) -> Array:
    """NEES, NaN where a covariance is singular."""
    values = np.linalg.eigvalsh(covs)
    uncertain = values[..., 0] > 1e-12 * values[..., -1]
    scores = np.full(uncertain.shape, np.nan)
    scores[uncertain] = mahalanobis_squared(errors[uncertain], covs[uncertain])
    return scores


def invariant_nees(
    poses: tuple[ArrayLike, ArrayLike] | Run, covs: ArrayLike | None = None
) -> Array:
    """NEES of poses in the coordinates of a right-invariant error; 3 is expected.

    The error is the motion of the whole world that takes the estimate to the truth: it turns by
    dtheta, and shifts. A robot that is sure of everything but its heading lies on an arc, which no
    ellipse in x and y can hold; in these coordinates its belief is a Gaussian (Barrau and
    Bonnabel 2015).

    Parameters
    ----------
    poses : tuple (estimates, truths) of array_like, shape (..., 3), or Run
    covs : array_like, shape (..., 3, 3), optional
        Covariances that the filter claimed for its poses; positive definite. Not with a run.

    Returns
    -------
    ndarray, shape (...)
        Of a run: NaN where it claims to know a pose exactly.

    Examples
    --------
    >>> invariant_nees(([[0.1, 0, 0]], [[0.0, 0, 0]]), [0.01 * np.eye(3)]).round(6).tolist()
    [1.0]
    """
    if isinstance(poses, Run):
        error, P = _invariant(poses.poses, poses.truth, poses.covs)
        return nees_where_uncertain(error, P)
    both = as_tuple("poses", poses)
    if len(both) != 2:
        raise ValueError(f"poses: expected a pair, estimated and true, got {len(both)} things")
    estimate, truth = (as_array("poses", part, ("...", 3)) for part in both)
    P = as_array("covs", cast(ArrayLike, covs), (*estimate.shape, 3))
    return mahalanobis_squared(*_invariant(estimate, truth, P))


def _invariant(estimate: Array, truth: Array, covs: Array) -> tuple[Array, Array]:
    """Right-invariant errors (..., 3), position first, and their covariances (..., 3, 3)."""
    J, p = np.array([[0.0, -1.0], [1.0, 0.0]]), estimate[..., :2, None]
    turn = wrap_angle(truth[..., 2] - estimate[..., 2])
    # p' = R(turn) p + V(turn) xi, V the mean of R from 0 to turn.
    along, across = np.sinc(turn / np.pi), 0.5 * turn * np.sinc(0.5 * turn / np.pi) ** 2
    V = along[..., None, None] * np.eye(2) + across[..., None, None] * J
    xi = np.linalg.solve(V, truth[..., :2, None] - rotation(turn) @ p)[..., 0]
    # The covariance in these coordinates: xi = dp - J p dtheta.
    T = np.tile(np.eye(3), (*turn.shape, 1, 1))
    T[..., :2, 2:] = -J @ p
    return np.concatenate([xi, turn[..., None]], -1), T @ covs @ np.swapaxes(T, -1, -2)


def nis(residuals: ArrayLike | Run, covs: ArrayLike | None = None) -> Array:
    """Normalised innovation squared, v^T S^-1 v: the test that needs no truth.

    Parameters
    ----------
    residuals : array_like, shape (..., m), or Run
        Innovations, angles already wrapped (P1 (19), P5 (5)). Of a run: what the `nis` of its
        reports says in each step of its log, NaN where nothing known was measured.
    covs : array_like, shape (..., m, m)
        Innovation covariances S (P5 (6)); positive definite. Not with a run.

    Returns
    -------
    ndarray, shape (...)
        Mean m if the filter is consistent.

    Examples
    --------
    >>> nis([[0.2, 0.0]], [[[0.04, 0.0], [0.0, 0.01]]]).round(6).tolist()
    [1.0]
    """
    if isinstance(residuals, Run):
        return np.array([_nis_of(report) for report in residuals.reports])
    residuals = as_array("residuals", residuals, ("...", "m"))
    m = residuals.shape[-1]
    return mahalanobis_squared(residuals, as_array("covs", cast(ArrayLike, covs), ("...", m, m)))


def _nis_of(report: Any) -> float:
    """Return what a report says of its innovation; an innovation of nothing says nothing."""
    nothing = np.size(getattr(report, "innovation", 0.0)) == 0
    return np.nan if nothing else float(getattr(report, "nis", np.nan))


def chi2_band(dim: int, n_runs: int, probability: float = 0.99) -> tuple[float, float]:
    """Band in which the mean NEES (or NIS) of independent runs should lie.

    The sum of n_runs values is chi-square with dim * n_runs degrees of freedom; the band holds it
    with `probability`, half of the rest on each side, divided by n_runs.

    Parameters
    ----------
    dim : int
        Degrees of freedom of one value, at least 1: the dimension of the error or of the
        innovation.
    n_runs : int
        Number of *independent* values in the mean, at least 1. Successive NEES of one run are
        correlated: take the mean over runs at one time, not over time.
    probability : float, default 0.99
        In [0, 1).

    Returns
    -------
    low, high : float

    Examples
    --------
    >>> [round(edge, 3) for edge in chi2_band(3, 50)]
    [2.183, 3.967]
    """
    dim, n_runs = as_count("dim", dim, 1), as_count("n_runs", n_runs, 1)
    tail = 0.5 * (1 - as_scalar("probability", probability, 0.0, np.nextafter(1.0, 0.0)))
    low, high = chi2_quantile([tail, 1 - tail], dim * n_runs) / n_runs
    return float(low), float(high)


def monte_carlo(
    run: Callable[[np.random.Generator], Result],
    n_runs: int,
    seed: int,
    n_jobs: int | None = 1,
    progress: bool = False,
) -> list[Result]:
    """Repeat a random experiment with independent, reproducible streams of random numbers.

    Run i always gets the i-th stream spawned from `seed`, so the results do not depend on
    `n_jobs`, on the backend, or on how many runs follow.

    Parameters
    ----------
    run : callable
        ``run(rng) -> anything``; takes all its randomness from `rng`.
    n_runs : int
        How many times, at least 1.
    seed : int
        Not negative.
    n_jobs : int or None, default 1
        1 runs here, in a plain loop. Anything else goes to joblib: -1 is all cores, None is what
        the enclosing ``joblib.parallel_config`` says, so that a Dask or Ray cluster can serve:
        ``with joblib.parallel_config(backend="dask"): monte_carlo(run, 1000, 1, n_jobs=-1)``.
    progress : bool, default False
        Show a tqdm progress bar.

    Returns
    -------
    list
        The n_runs results, in order.

    Raises
    ------
    ImportError
        If joblib (for `n_jobs` other than 1) or tqdm (for `progress`) is not installed.

    Examples
    --------
    >>> monte_carlo(lambda rng: round(float(rng.normal()), 3), n_runs=3, seed=1)
    [-0.64, 2.486, 1.442]
    """
    if not callable(run):
        raise ValueError(f"run: expected a function of a random generator, got {run!r}")
    n_runs, seed = as_count("n_runs", n_runs, 1), as_count("seed", seed)
    if n_jobs is not None and (n_jobs == 0 or as_count("n_jobs", n_jobs, low=-1024) == 0):
        raise ValueError("n_jobs: expected a number of processes, -1 or None, got 0")
    streams = np.random.SeedSequence(seed).spawn(n_runs)
    results: Iterable[Result]
    if n_jobs == 1:
        results = (_one_run(run, stream) for stream in streams)
    else:
        joblib = needed("joblib", "runs in parallel (n_jobs other than 1)")
        tasks = (joblib.delayed(_one_run)(run, stream) for stream in streams)
        results = joblib.Parallel(n_jobs=n_jobs, return_as="generator")(tasks)
    return list(with_bar(results, progress, n_runs, "run"))


def _one_run(
    run: Callable[[np.random.Generator], Result], stream: np.random.SeedSequence
) -> Result:
    return run(np.random.default_rng(stream))
