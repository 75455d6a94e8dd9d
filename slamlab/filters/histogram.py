"""Bayes filter on a grid of places: the recursion itself, with nothing approximated.

P2 (4) and (5), discretised: predict spreads the belief, update sharpens it. Chapter 01.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slamlab._checks import Array, as_array

__all__ = ["entropy", "predict", "update"]


def predict(
    belief: ArrayLike, kernel: ArrayLike, offsets: ArrayLike, circular: bool = True
) -> Array:
    """Move a belief: sum over the old places of P(new | old) times belief(old), P2 (4).

    Parameters
    ----------
    belief : array_like, shape (..., n)
        Probability of each of n places in a row; sums to 1.
    kernel : array_like, shape (k,)
        Probability of each possible displacement; sums to 1.
    offsets : array_like of int, shape (k,)
        The displacements, in places; positive is to the right.
    circular : bool, default True
        Whether the corridor closes on itself. If not, whoever would leave it stops at the end.

    Returns
    -------
    ndarray, shape (..., n)

    Examples
    --------
    >>> predict([0.0, 1.0, 0.0, 0.0], kernel=[0.2, 0.8], offsets=[0, 1]).tolist()
    [0.0, 0.2, 0.8, 0.0]
    """
    belief = _distribution("belief", belief)
    kernel = _distribution("kernel", kernel)
    steps = np.asarray(offsets)
    if steps.shape != kernel.shape or not np.issubdtype(steps.dtype, np.integer):
        raise ValueError(f"offsets: expected {len(kernel)} whole numbers, got {offsets!r}")
    n = belief.shape[-1]
    moved = np.zeros_like(belief)
    for probability, step in zip(kernel, steps, strict=True):
        arrival = np.arange(n) + step
        arrival = arrival % n if circular else np.clip(arrival, 0, n - 1)
        np.add.at(moved.T, arrival, probability * belief.T)
    return moved


def update(belief: ArrayLike, likelihood: ArrayLike) -> tuple[Array, Array]:
    """Weigh a belief by a measurement and normalise, P2 (5).

    Parameters
    ----------
    belief : array_like, shape (..., n)
        Probability of each place; sums to 1.
    likelihood : array_like, shape (..., n)
        P(z | place) of the measurement that came, not negative; need not sum to anything.

    Returns
    -------
    posterior : ndarray, shape (..., n)
    evidence : ndarray, shape (...)
        P(z), the denominator of P2 (5).

    Raises
    ------
    ValueError
        If the measurement is impossible everywhere.

    Examples
    --------
    >>> posterior, evidence = update([0.5, 0.5], [0.9, 0.3])
    >>> posterior.round(3).tolist(), round(float(evidence), 3)
    ([0.75, 0.25], 0.6)
    """
    belief = _distribution("belief", belief)
    likelihood = as_array("likelihood", likelihood, ("...", belief.shape[-1]))
    if (likelihood < 0).any():
        raise ValueError(f"likelihood: expected no negative entry, got {likelihood.min():g}")
    product = belief * likelihood
    evidence = product.sum(-1)
    if not (evidence > 0).all():
        raise ValueError("likelihood: the measurement is impossible at every place believed in")
    return product / evidence[..., None], evidence


def entropy(belief: ArrayLike) -> Array:
    """Entropy (bits) of beliefs (..., n): 0 for a sure one, log2 n for a uniform one.

    Examples
    --------
    >>> entropy([[0.25, 0.25, 0.25, 0.25], [0.0, 1.0, 0.0, 0.0]]).tolist()
    [2.0, 0.0]
    """
    belief = _distribution("belief", belief)
    safe = np.where(belief > 0, belief, 1.0)
    return np.asarray(np.abs(belief * np.log2(safe)).sum(-1))


def _distribution(name: str, value: ArrayLike) -> Array:
    array = as_array(name, value, ("...", "n"))
    if (array < 0).any():
        raise ValueError(f"{name}: expected no negative probability, got {array.min():g}")
    total = array.sum(-1)
    if not np.allclose(total, 1.0, rtol=0, atol=1e-9):
        worst = np.ravel(total)[np.argmax(np.abs(np.ravel(total) - 1))]
        raise ValueError(f"{name}: expected probabilities that sum to 1, got {worst:g}")
    return array
