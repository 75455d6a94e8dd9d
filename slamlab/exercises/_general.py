"""Mistakes that can occur in any exercise: of the results, of the arguments, a missing wrap."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from slamlab.exercises._values import agree, pairs

__all__ = ["NEARLY", "general_mistakes"]

Function = Callable[..., Any]


def _several(a: np.ndarray) -> np.ndarray:
    """Return an array; a single number has no sum of its own, and no share of one."""
    return a if a.ndim else np.full((), np.nan)


_RESULTS: dict[str, Function] = {
    "`{}` is the transpose of what is expected": lambda a: a.T,
    "the sign of `{}` is reversed": lambda a: -a,
    "`{}` is in degrees: expected radians": np.rad2deg,
    "`{}` is half of what is expected": lambda a: a / 2,
    "`{}` is twice what is expected": lambda a: 2 * a,
    "`{}` is the square root of what is expected": np.sqrt,
    "`{}` is the square of what is expected": np.square,
    "`{}` is the logarithm of what is expected": np.log,
    "`{}` is the exponential of what is expected": np.exp,
    "`{}` is one over what is expected": lambda a: 1 / a,
    "`{}` lost its sign": np.abs,
    "`{}` is one too large": lambda a: a + 1,
    "`{}` is one too small": lambda a: a - 1,
    "`{}` is one minus what is expected": lambda a: 1 - a,
    "`{}` is in reverse order": lambda a: a[::-1],
    "`{}` has its columns in reverse order": lambda a: a[..., ::-1],
    "`{}` is divided by its largest entry": lambda a: a / _several(a).max(),
    "`{}` is divided by its sum": lambda a: a / _several(a).sum(),
    "`{}` is divided by the number of its entries": lambda a: a / _several(a).size,
    "`{}` is summed over all its entries": np.sum,
    "`{}` is averaged over all its entries": np.mean,
    "`{}` is zero": np.zeros_like,
    "`{}` lacks all but its diagonal": lambda a: a * np.eye(len(a)),
    "only the diagonal of `{}` was returned": lambda a: np.diag(a) if a.ndim == 2 else 1 / 0,
    "`{}` lacks its first entry": lambda a: a[1:],
    "`{}` lacks its last entry": lambda a: a[:-1],
    "`{}` is the inverse of what is expected": np.linalg.inv,
}
_ARGUMENTS: dict[str, Function] = {
    "`{}` has no effect, as if it were zero": np.zeros_like,
    "`{}` has no effect, as if it were one": np.ones_like,
    "`{}` counts with the wrong sign": lambda a: -a,
    "`{}` was transposed": lambda a: a.T,
    "`{}` was taken for degrees": np.deg2rad,
    "`{}` was turned into degrees": np.rad2deg,
    "`{}` counts twice": lambda a: 2 * a,
    "`{}` counts half": lambda a: a / 2,
    "`{}` was squared": np.square,
    "the square root of `{}` was taken": np.sqrt,
    "`{}` was inverted": lambda a: np.linalg.inv(a) if np.ndim(a) == 2 else 1 / a,
    "`{}` lost its sign": np.abs,
    "`{}` was read from its end": lambda a: a[::-1],
    "the columns of `{}` were exchanged": lambda a: a[..., ::-1],
    "only the diagonal of `{}` was used": lambda a: a * np.eye(len(a)),
    "the mean of `{}` was used in place of its entries": lambda a: np.full_like(a, np.mean(a)),
    "the mean of `{}` was taken off": lambda a: a - np.mean(a, axis=0),
    "`{}` was divided by its sum": lambda a: a / np.sum(a),
    "`{}` is one too small": lambda a: a - 1,
    "`{}` is one too large": lambda a: a + 1,
    "the complement, 1 - `{}`, was used": lambda a: 1 - a,
    "the first entry of `{}` was left out": lambda a: a[1:],
    "the last entry of `{}` was left out": lambda a: a[:-1],
}


def general_mistakes(
    reference: Function, names: Sequence[str], returns: Sequence[str]
) -> Iterator[tuple[str, Function, bool]]:
    """Yield message and wrong function of every mistake that the signature admits.

    Where the third is True the function makes its answer of the right one, else of the arguments.
    """
    for a in range(len(names)):
        for b in range(a):
            message = f"the arguments `{names[b]}` and `{names[a]}` are exchanged"
            yield message, _exchanged_arguments(reference, a, b), False
    for message, wrong in _RESULTS.items():
        for which, name in enumerate(returns):
            yield message.format(name), _of_result(len(returns), which, wrong), True
        if len(returns) > 1:
            everything = "`, `".join(returns)
            yield message.format(everything), _of_all(len(returns), wrong), True
    for a in range(len(returns)):
        for b in range(a):
            message = f"the results `{returns[b]}` and `{returns[a]}` are exchanged"
            yield message, _exchanged_results(len(returns), a, b), True
        if len(returns) > 1:
            yield f"only `{returns[a]}` was returned", _only(len(returns), a), True
    for k, name in enumerate(names):
        yield f"`{name}` was returned unchanged", _returned(k), False
    for message, wrong in _ARGUMENTS.items():
        for k, name in enumerate(names):
            yield message.format(name), _of_argument(reference, k, wrong), False


def _parts(due: Any, n: int) -> list[Any]:
    return [np.asarray(part, dtype=float) for part in (due if n > 1 else [due])]


def _as_due(parts: list[Any]) -> Any:
    return tuple(parts) if len(parts) > 1 else parts[0]


def _of_result(n: int, which: int, wrong: Function) -> Function:
    def run(due: Any) -> Any:
        parts = _parts(due, n)
        parts[which] = wrong(parts[which])
        return _as_due(parts)

    return run


def _of_all(n: int, wrong: Function) -> Function:
    return lambda due: _as_due([wrong(part) for part in _parts(due, n)])


def _exchanged_results(n: int, a: int, b: int) -> Function:
    return lambda due: _as_due(_exchanged(_parts(due, n), a, b))


def _exchanged_arguments(reference: Function, a: int, b: int) -> Function:
    return lambda *given: reference(*_exchanged(given, a, b))


def _only(n: int, a: int) -> Function:
    return lambda due: _parts(due, n)[a]


def _returned(k: int) -> Function:
    return lambda *given: given[k]


def _exchanged(values: Sequence[Any], a: int, b: int) -> list[Any]:
    new = list(values)
    new[a], new[b] = new[b], new[a]
    return new


def _of_argument(reference: Function, k: int, wrong: Function) -> Function:
    def run(*arguments: Any) -> Any:
        given = list(arguments)
        if isinstance(given[k], bool) or not isinstance(given[k], (int, float, np.ndarray)):
            raise TypeError("no number")
        changed = wrong(given[k])
        given[k] = changed if np.ndim(changed) else type(given[k])(changed)
        return reference(*given)

    return run


def _turns(came: Any, due: Any) -> bool:
    """Say whether all differences are full turns, and one at least is a turn or more."""
    both = pairs(came, due)
    if isinstance(both, str) or any(a.shape != b.shape for a, b in both):
        return False
    with np.errstate(invalid="ignore"):  # inf less inf is no turn
        if not any((np.abs(a - b) > np.pi).any() for a, b in both):
            return False
        turns = [(a - b + np.pi) % (2 * np.pi) for a, b in both]
    return all(np.allclose(turn, np.pi, atol=1e-6) for turn in turns)


NEARLY: dict[str, Callable[[Any, Any], bool]] = {
    "an angle is off by a full turn: wrap it, as the text above the stub says": _turns,
    "almost right: rounded, or a finite difference with too long a step": (
        lambda came, due: agree(came, due, 1e-3)
    ),
}
