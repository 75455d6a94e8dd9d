"""What a student's function returns, as plain data: compared, told apart and shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

__all__ = [
    "agree", "difference", "is_stub", "overlap", "pairs", "places", "plain", "right_in_part",
    "same", "show",
]  # fmt: skip


def is_stub(function: Any) -> bool:
    """Say whether a function has no body yet: nothing but `...` or its docstring."""
    code = getattr(function, "__code__", None)
    return code is not None and not code.co_names and len(code.co_code) <= 8


def plain(value: Any) -> Any:
    """Copy a result into numbers, arrays, tuples and lists; of anything else its repr."""
    if hasattr(value, "mean") and hasattr(value, "cov") and not isinstance(value, np.ndarray):
        return (np.array(value.mean, dtype=float), np.array(value.cov, dtype=float))
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        return np.array(value) if value.dtype.kind in "biufc" else repr(value)
    if isinstance(value, (tuple, list, range)):
        return (tuple if isinstance(value, tuple) else list)(plain(entry) for entry in value)
    return repr(value)


def leaves(value: Any) -> Iterator[np.ndarray]:
    """Go through the arrays of a result, nested ones and those of a Gaussian too."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, (tuple, list)):
        for entry in value:
            yield from leaves(entry)
    elif hasattr(value, "mean") and hasattr(value, "cov"):
        yield from leaves((value.mean, value.cov))


def overlap(result: Any, argument: Any) -> bool:
    """Say whether a result is an argument itself, all of it and not a view of a part."""
    return any(
        x.size == y.size > 0 and np.may_share_memory(x, y)
        for x in leaves(result)
        for y in leaves(argument)
    )


def places(result: Any) -> set[tuple[int, int]]:
    """Return where the arrays of a result begin in memory, and how many entries each has."""
    if isinstance(result, np.ndarray):
        return {(result.__array_interface__["data"][0], result.size)} if result.size else set()
    parts = result if isinstance(result, list | tuple) else ()
    return set().union(*map(places, parts))


def same(a: Any, b: Any) -> bool:
    """Say whether two results have equal arrays, digit by digit; NaN equals NaN."""
    ours, theirs = list(leaves(a)), list(leaves(b))
    return len(ours) == len(theirs) and all(
        x.shape == y.shape
        and (_identical(x, y) or np.array_equal(x, y, equal_nan=x.dtype.kind == "f"))
        for x, y in zip(ours, theirs, strict=True)
    )


def right_in_part(
    came: Sequence[Any], due: Sequence[Any], arguments: Sequence[Any], tolerance: float
) -> float:
    """Share of the numbers of a result that are right on every input; 0 where they are not alike.

    Only those numbers count that differ between inputs, and that no argument already holds.
    """
    ours, theirs = [_numbers(one) for one in came], [_numbers(one) for one in due]
    shapes = {shape for shape, _ in ours + theirs}
    if len(shapes) != 1 or None in shapes:
        return 0.0
    a, b = np.array([x for _, x in ours]), np.array([x for _, x in theirs])
    given = [_numbers(one) for one in arguments]
    known = len({shape for shape, _ in given}) == 1 and given[0][0] is not None
    held = np.array([x for _, x in given]) if known else np.zeros((len(b), 0))
    with np.errstate(invalid="ignore"):
        counted = ~np.isclose(b, b[:1], equal_nan=True).all(0)
        counted &= ~np.isclose(b[:, :, None], held[:, None], equal_nan=True).all(0).any(1)
        right = np.isclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True).all(0)
    return float((right & counted).sum() / counted.sum()) if counted.sum() > 1 else 0.0


def _numbers(value: Any) -> tuple[Any, np.ndarray]:
    """Return the nested shape of plain data and its numbers; None for a shape that has others."""
    if isinstance(value, (tuple, list)):
        parts = [_numbers(entry) for entry in value]
        shapes = tuple(shape for shape, _ in parts)
        numbers = [x for _, x in parts]
        return None if None in shapes else shapes, np.concatenate([np.zeros(0), *numbers])
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        return None, np.zeros(0)
    return array.shape, array.ravel().astype(float)


def agree(came: Any, due: Any, tolerance: float) -> bool:
    """Say whether a result is the expected one, up to a tolerance, absolute and relative."""
    if due is None or came is None:
        return due is None and came is None
    if isinstance(due, str):
        return isinstance(came, str) and came == due
    both = pairs(came, due)
    return not isinstance(both, str) and all(
        a.shape == b.shape
        and (
            _identical(a, b)
            or bool(np.isclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True).all())
        )
        for a, b in both
    )


def _identical(a: np.ndarray, b: np.ndarray) -> bool:
    """Say whether two arrays have the same bytes: the usual case, and soon known."""
    return a.dtype == b.dtype and a.tobytes() == b.tobytes()


def pairs(came: Any, due: Any) -> list[tuple[np.ndarray, np.ndarray]] | str:
    """Pair a result with the expected one, axes of length one dropped; a str says why it fails.

    Lists count as arrays, and a tuple of rows counts as the array of these rows and back.
    """
    whole = _whole_pairs(came, due)
    if isinstance(whole, str):
        return whole
    return [_squeezed(a, b) for a, b in whole]


def _squeezed(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop axes of length one; two empty arrays are alike whatever their shapes."""
    a, b = np.squeeze(a), np.squeeze(b)
    return (b, b) if a.size == b.size == 0 else (a, b)


def _whole_pairs(came: Any, due: Any) -> list[tuple[np.ndarray, np.ndarray]] | str:
    """Pair them as `pairs` does, with all their axes."""
    ours, theirs = _parts(due), _parts(came)
    if ours is None or theirs is None:
        return "expected numbers: the result is not made of numbers"
    if len(theirs) != len(ours):
        try:
            whole = [came] if len(ours) == 1 else came
            theirs = [np.asarray(part, float) for part in whole]
        except (TypeError, ValueError):
            pass
    if len(theirs) != len(ours):
        return f"expected {len(ours)} results, got {len(theirs)}"
    return list(zip(theirs, ours, strict=True))


def _parts(value: Any) -> list[np.ndarray] | None:
    """Flatten a result into arrays; None if it is not made of numbers."""
    if not isinstance(value, tuple):
        try:
            return [np.asarray(value, dtype=float)]
        except (TypeError, ValueError):
            if not isinstance(value, list):
                return None
    parts = [_parts(entry) for entry in value]
    if any(part is None for part in parts):
        return None
    return [array for part in parts if part is not None for array in part]


def difference(came: Any, due: Any, tolerance: float, names: Sequence[str]) -> list[str]:
    """Say what was expected and what was returned: of an array the first entry that differs."""
    if due is None:
        return [f"expected None, got {show(came)}"]
    whole = _whole_pairs(came, due)
    if isinstance(whole, str):
        return [whole]
    lines = []
    for k, (a_whole, b_whole) in enumerate(whole):
        name = names[k] if len(names) == len(whole) else names[0]
        a, b = _squeezed(a_whole, b_whole)
        if a.shape != b.shape:
            # An axis of length one that is expected, or stands for a longer one, is told.
            if a_whole.ndim == b_whole.ndim or 1 in b_whole.shape:
                a, b = a_whole, b_whole
            lines.append(f"{name}: expected shape {b.shape}, got {a.shape}")
            continue
        wrong = ~np.isclose(a, b, rtol=tolerance, atol=tolerance, equal_nan=True)
        if not wrong.any():
            lines += [f"{name} is right"] if len(whole) > 1 else []
            continue
        place = tuple(int(i) for i in np.argwhere(wrong)[0])
        x, y = _apart(float(a[place]), float(b[place]))
        where = f"{name}{list(place) if place else ''}"
        rest = f" ({int(wrong.sum())} of {wrong.size} entries differ" if wrong.size > 1 else ""
        rest += f"{_far_worse(a, b, place, name)})" if rest else ""
        lines.append(f"{where}: expected {y}, got {x}{rest}")
        if np.isnan(a[place]):
            lines[-1] += ": not a number"
    return lines


def _far_worse(a: np.ndarray, b: np.ndarray, place: tuple[int, ...], name: str) -> str:
    """Name the entry that differs most, if in a long result it is far from the first one."""
    with np.errstate(invalid="ignore"):
        gaps = np.nan_to_num(np.abs(a - b), nan=0.0, posinf=0.0)
    most = tuple(int(i) for i in np.unravel_index(int(gaps.argmax()), gaps.shape))
    if a.size <= 250 or not gaps[most] > 100 * gaps[place] > 0:
        return ""
    return f", {name}{list(most)} by {gaps[most]:.3g}"


def _apart(a: float, b: float) -> tuple[str, str]:
    """Write two numbers with as many digits as it needs to tell them apart."""
    for digits in range(4, 17):
        x, y = f"{a:.{digits}g}", f"{b:.{digits}g}"
        if x != y:
            break
    return x, y


def show(value: Any) -> str:
    """Write a value in one line: five digits, of a large array its shape."""
    try:
        array = np.asarray(value)
    except ValueError:
        return f"{type(value).__name__} of {len(value)}"
    if array.dtype.kind not in "biuf":
        return repr(value)
    if array.size > 9:
        return f"array of shape {array.shape}"
    if array.dtype.kind in "biu":
        return str(array.tolist())
    if array.ndim == 0 and float(f"{array:.5g}").is_integer():  # 1 - 1e-16 is not shown as one
        return repr(float(array))
    shown = np.array([float(f"{x:.5g}") for x in array.ravel().tolist()]).reshape(array.shape)
    return str(shown.tolist()).replace("-0.0,", "0.0,").replace("-0.0]", "0.0]")
