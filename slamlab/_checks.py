"""Checks at the door: the few helpers by which public functions refuse bad input.

Every message names the argument, what was expected and what came, shortly: what came may be huge.
Everything may import this; it imports nothing of ours.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Hashable, Sequence
from functools import cache, lru_cache
from math import isfinite
from operator import ne
from reprlib import Repr
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Shape = Sequence[int | str | None]
_DOUBLE = np.dtype(np.float64)
_SMALL = 36  # numbers of a covariance that is remembered
_SHORT = Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 3, 60, 80


def shown(value: object) -> str:
    """Return what came, for a message: at most about a line of it, whatever it is."""
    try:
        text = " ".join(_SHORT.repr(value).split())
    except Exception:  # a repr may fail in any way, and the message still has to come
        text = f"something of type {type(value).__name__}"
    return text if len(text) <= 200 else f"{text[:197]}..."


def cut(text: object, most: int = 100) -> str:
    """Return the words of another error, for a message; those of a damaged file have no end."""
    words = str(text)
    return words if len(words) <= most else f"{words[: most - 3]}..."


def as_array(name: str, value: ArrayLike, shape: Shape | None = None) -> Array:
    """Return `value` as a finite array of floats of the given trailing shape.

    Float32 stays float32, everything else becomes float64, both in this machine's byte order.

    Parameters
    ----------
    name : str
        The argument's name, for the message.
    value : array_like
        What the caller gave.
    shape : sequence of int, str or None, optional
        Expected shape. An int is an exact length, a str or None stands for any length. If the
        first entry is ``"..."``, any leading axes may come before the rest.

    Raises
    ------
    ValueError
        If `value` is no numeric array, has another shape, or holds NaN or infinity.
    """
    array = as_shaped(name, value, shape)
    if not all_finite(array):
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"{name}: expected finite numbers, got {array[where]} at index {where}")
    return array


def as_shaped(name: str, value: ArrayLike, shape: Shape | None = None) -> Array:
    """Like `as_array`, but NaN and infinity may pass (a missing measurement, a lost beam)."""
    floats = type(value) is np.ndarray and value.dtype == _DOUBLE  # of this machine's byte order
    array: Array = value if floats else _as_floats(name, value)  # type: ignore[assignment]
    if shape is not None and not _shape_fits(array.shape, tuple(shape)):
        wanted = ", ".join("any" if s is None else str(s) for s in shape)
        raise ValueError(f"{name}: expected shape ({wanted}), got {array.shape}")
    return array


def as_finite_or_nan(name: str, value: ArrayLike, shape: Shape | None = None) -> Array:
    """Like `as_shaped`, but of a missing number alone: NaN may pass; ValueError at infinity."""
    array = as_shaped(name, value, shape)
    if np.isinf(array).any():
        raise ValueError(f"{name}: expected finite numbers or NaN, got infinity")
    return array


def as_distances(name: str, value: ArrayLike, shape: Shape | None = None) -> Array:
    """Like `as_shaped`, and no number is negative; ValueError otherwise."""
    array = as_shaped(name, value, shape)
    if (array < 0).any():
        raise ValueError(f"{name}: expected distances, got {np.nanmin(array):g}")
    return array


def _as_floats(name: str, value: ArrayLike) -> Array:
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiubO" or np.ma.is_masked(value):
            raise TypeError
        # NumPy reads None as NaN and words as numbers.
        if array.dtype.kind == "O" and any(isinstance(x, str | bytes | None) for x in array.flat):
            raise TypeError
        single = array.dtype.newbyteorder("=") == np.float32
        return array.astype(np.float32 if single else np.float64, copy=False)
    except (TypeError, ValueError, OverflowError) as error:
        if np.ma.is_masked(value):
            raise ValueError(f"{name}: expected no masked entries, got some") from error
        raise ValueError(f"{name}: expected an array of numbers, got {shown(value)}") from error


def all_finite(array: Array) -> bool:
    """Tell whether no number is NaN or infinite."""
    # For few numbers the sum of squares is the quickest answer, unless it overflows.
    if array.size <= 1000 and isfinite(np.vdot(array, array)):
        return True
    return bool(np.isfinite(array).all())


def as_batch(name: str, lead: Sequence[int], other: Sequence[int]) -> tuple[int, ...]:
    """Return the leading axes that two arguments have together, by broadcasting.

    Raises
    ------
    ValueError
        If those of argument `name` do not fit the others.
    """
    if lead == other:
        return tuple(lead)
    try:
        return np.broadcast_shapes(tuple(lead), tuple(other))
    except ValueError as error:
        wanted = f"leading axes that fit {tuple(other)}"
        raise ValueError(f"{name}: expected {wanted}, got {tuple(lead)}") from error


# Every step of a filter asks the same few questions.
@lru_cache(maxsize=1024)
def _shape_fits(shape: tuple[int, ...], wanted: tuple[int | str | None, ...]) -> bool:
    if wanted and wanted[0] == "...":
        wanted = wanted[1:]
        shape = shape[max(len(shape) - len(wanted), 0) :]
    if len(shape) != len(wanted):
        return False
    pairs = zip(shape, wanted, strict=True)
    return all(w is None or isinstance(w, str) or w == s for s, w in pairs)


def as_covariance(name: str, value: ArrayLike, dim: int | None = None) -> Array:
    """Return `value` as a symmetric positive semi-definite matrix (..., dim, dim).

    Asymmetry and negative eigenvalues within rounding (1e-9 of the largest entry) pass, and the
    returned matrix is exactly symmetric.

    Raises
    ------
    ValueError
        If the matrix is not square of size `dim`, not finite, not symmetric or has a negative
        eigenvalue; the message gives the offending figure.
    """
    size: int | str = "n" if dim is None else dim
    cov = as_array(name, value, ("...", size, size))
    if cov.shape[-1] != cov.shape[-2]:
        raise ValueError(f"{name}: expected a square matrix, got shape {cov.shape}")
    if cov.size <= _SMALL:
        return _remembered(name, cov.tobytes(), cov.shape, cov.dtype.char).copy()
    return _symmetric(name, cov)


def as_one_covariance(name: str, value: ArrayLike, dim: int) -> Array:
    """Like `as_covariance`, of a single matrix (dim, dim): no batch may come in."""
    return as_covariance(name, as_array(name, value, (dim, dim)), dim)


# Logs tell the same noise at every step, or the same few thousand to every filter.
@lru_cache(maxsize=8192)
def _remembered(name: str, numbers: bytes, shape: tuple[int, ...], kind: str) -> Array:
    return _symmetric(name, np.frombuffer(numbers, kind).reshape(shape))


def _symmetric(name: str, cov: Array) -> Array:
    """`cov` (..., n, n), exactly symmetric; ValueError if it is no covariance."""
    even = cov.mT
    if (cov == even).all():
        cov = cov.copy()
    else:
        uneven = np.abs(cov - even).max((-2, -1))
        if (uneven > 1e-9 * np.abs(cov).max((-2, -1))).any():
            wanted = f"a symmetric matrix, asymmetry is {uneven.max():.3g}"
            raise ValueError(f"{name}: expected {wanted}")
        cov = 0.5 * cov + 0.5 * even
    if cov.size:
        smallest = np.linalg.eigvalsh(cov)[..., 0]
        if (smallest < 0).any() and (smallest < -1e-9 * np.abs(cov).max((-2, -1))).any():
            found = f"smallest eigenvalue is {smallest.min():.3g}"
            raise ValueError(f"{name}: expected a positive semi-definite matrix, {found}")
    return cov


def as_scalar(name: str, value: Any, low: float = -np.inf, high: float = np.inf) -> float:
    """Return `value` as a float in the closed interval [low, high] (infinite only if a bound is).

    Raises
    ------
    ValueError
        If it is no number, is NaN, or lies outside.
    """
    try:
        if type(value) is not float and _is_no_number(value):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name}: expected a number, got {shown(value)}") from error
    if not low <= number <= high:
        raise ValueError(f"{name}: expected {_interval(low, high)}, got {number:g}")
    return number


def _is_no_number(value: Any) -> bool:
    return isinstance(value, str | bytes) or bool(np.ndim(value)) or np.ma.is_masked(value)


def as_positive(name: str, value: Any, high: float = np.inf) -> float:
    """Return `value` as a float above zero, at most `high`; ValueError as of `as_scalar`."""
    return as_scalar(name, value, float(np.finfo(float).tiny), high)


def _interval(low: float, high: float) -> str:
    """Words for [low, high], where the smallest and the largest floats stand for no bound."""
    huge, tiny = 1e290, 1e-290
    above = "a positive number" if 0 < low < tiny else f"a number of at least {low:g}"
    if high > huge:
        return "a finite number" if low < -huge else above
    if 0 < low < tiny:
        return f"{above} of at most {high:g}"
    end = "1)" if 1 - 1e-9 < high < 1 else f"{high:g}]"
    return f"a number in [{low:g}, {end}"


def as_count(name: str, value: Any, low: int = 0, high: int = 2**63 - 1) -> int:
    """Return `value` as an int of at least `low` and at most `high`.

    Raises
    ------
    ValueError
        If it is no whole number, too small or too large.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ValueError(f"{name}: expected a whole number, got {shown(value)}")
    if value < low:
        raise ValueError(f"{name}: expected at least {low}, got {shown(value)}")
    if value > high:
        raise ValueError(f"{name}: expected at most {high}, got {shown(value)}")
    return int(value)


def as_index(name: str, value: Any, size: int, what: str) -> int:
    """Return `value` as an index of one of `size` things; a negative one counts from the end.

    Raises
    ------
    ValueError
        If it is no whole number or there is none of them there.
    """
    try:
        place = operator.index(value)
    except TypeError:
        place = size
    if not -size <= place < size:
        raise ValueError(f"{name}: expected one of {size} {what}, got {shown(value)}")
    return place


def as_choice(name: str, value: Any, choices: Sequence[str]) -> str:
    """Return `value` if it is one of `choices`.

    Raises
    ------
    ValueError
        If it is not; the message lists the choices.
    """
    if not isinstance(value, str) or value not in choices:
        wanted = ", ".join(map(repr, choices))
        raise ValueError(f"{name}: expected one of {wanted}, got {shown(value)}")
    return value


def as_function(name: str, value: Any) -> Callable[..., Any]:
    """Return `value` if it can be called.

    Raises
    ------
    ValueError
        If it cannot.
    """
    if not callable(value):
        raise ValueError(f"{name}: expected a function, got {shown(value)}")
    return value


def as_tuple(name: str, value: Any) -> tuple[Any, ...]:
    """Return a sequence (of names, of indices, of things) as a tuple.

    Raises
    ------
    ValueError
        If it cannot be run through, or is a string.
    """
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        return tuple(value.tolist() if isinstance(value, np.ndarray) else value)
    except TypeError as error:
        raise ValueError(f"{name}: expected a sequence, got {shown(value)}") from error


def as_instance(name: str, value: Any, kind: Any, wanted: str = "") -> Any:
    """Return `value` if it is of a class, or has what a protocol asks for.

    Raises
    ------
    ValueError
        If it is not, or is the class itself; of a protocol, the message names what is missing.
    """
    if type(value) is kind:
        return value
    wanted = wanted or f"a {kind.__name__}"
    if isinstance(value, type):
        raise ValueError(f"{name}: expected {wanted}, got the class {value.__name__} itself")
    if not getattr(kind, "_is_protocol", False):
        if isinstance(value, kind):
            return value
        raise ValueError(f"{name}: expected {wanted}, got {type(value).__name__}")
    missing = [member for member in _members(kind) if not hasattr(value, member)]
    if missing:
        got = f"{type(value).__name__}, which has no {', '.join(missing)}"
        raise ValueError(f"{name}: expected {wanted}, got {got}")
    return value


@cache
def _members(kind: Any) -> tuple[str, ...]:
    """Return the names of what a protocol asks for, in its order."""
    members = [m for m in vars(kind) if not m.startswith("_")]
    return tuple(dict.fromkeys([*members, *vars(kind).get("__annotations__", ())]))


def as_rng(name: str, value: Any) -> np.random.Generator:
    """Return `value` if it is a NumPy random generator (randomness is always passed in).

    Raises
    ------
    ValueError
        If it is anything else, a bare seed included.
    """
    if not isinstance(value, np.random.Generator):
        wanted = "a numpy.random.Generator such as np.random.default_rng(1)"
        raise ValueError(f"{name}: expected {wanted}, got {shown(value)}")
    return value


def as_names(name: str, ids: Any, length: int | None = None) -> tuple[Hashable | None, ...]:
    """Names as a tuple of plain Python values, none twice; numbers of an array become ints."""
    try:
        listed = ids.tolist() if isinstance(ids, np.ndarray) else ids
        names = tuple(one.item() if isinstance(one, np.generic) else one for one in listed)
        different = len(set(names))
    except TypeError as error:
        raise ValueError(f"{name}: expected a sequence of names, got {ids!r}") from error
    if length is not None and len(names) != length:
        raise ValueError(f"{name}: expected one for each of {length} rows of z, got {len(names)}")
    if any(map(ne, names, names)):
        raise ValueError(f"{name}: expected names, got NaN, which is never the same twice")
    if different < len(names):
        twice = [one for k, one in enumerate(names) if one is not None and one in names[:k]]
        if twice:
            raise ValueError(f"{name}: expected every landmark once, got {twice[0]!r} twice")
    return names


def as_landmarks(z: ArrayLike, covs: ArrayLike | None, own: Array) -> tuple[Array, Array]:
    """Measurements (k, 2) of landmarks and the covariance of each, (k, 2, 2).

    Parameters
    ----------
    z : array_like, shape (k, 2)
    covs : array_like, shape (2, 2) or (k, 2, 2), optional
        Given for this call.
    own : ndarray, shape (2, 2)
        The sensor's, if none are given.

    Raises
    ------
    ValueError
        If a shape does not fit, a number is not finite, or `covs` is no covariance.
    """
    z = as_array("z", z, ("k", 2))
    R = own if covs is None else as_covariance("covs", covs, 2)
    if R.shape not in ((2, 2), (len(z), 2, 2)):
        raise ValueError(f"covs: expected shape (2, 2) or ({len(z)}, 2, 2), got {R.shape}")
    return z, np.broadcast_to(R, (len(z), 2, 2))


def as_rows(name: str, rows: ArrayLike, n: int) -> NDArray[np.intp]:
    """Rows (m,) of a map of n landmarks; ValueError if one is not in it or no whole number."""
    array = np.asarray(rows)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"{name}: expected whole numbers of shape (m,), got {rows!r}")
    if ((array < 0) | (array >= n)).any():
        raise ValueError(f"{name}: expected rows of {n} landmarks, got {rows!r}")
    return array.astype(np.intp)


def as_associations(rows: ArrayLike, k: int, n: int) -> NDArray[np.intp]:
    """Check what `associate` answers: for each of k measurements a row of n landmarks, -1 or -2.

    Raises
    ------
    ValueError
        If it is anything else.
    """
    array = np.asarray(rows)
    if array.shape != (k,) or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"associate: expected {k} rows, whole numbers, got {array!r}")
    if ((array < -2) | (array >= n)).any():
        raise ValueError(f"associate: expected rows of {n} landmarks, -1 or -2, got {array!r}")
    return array.astype(np.intp)
