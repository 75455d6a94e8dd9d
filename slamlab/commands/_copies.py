"""Which submissions have the same code? Names, comments and layout aside."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

__all__ = ["fingerprints", "same_code"]

_LEAST = 120  # nodes of a syntax tree; shorter functions are alike by chance


def fingerprints(cells: Iterable[str], names: Iterable[str]) -> dict[str, str]:
    """Return the normalised syntax tree of each of these functions that the cells define.

    Arguments and local names are numbered as they come, docstrings and types fall. A function of
    fewer than 120 nodes has no fingerprint.

    Parameters
    ----------
    cells : iterable of str
        Code; what is none is passed over.
    names : iterable of str
        Functions.
    """
    found = {}
    for cell in cells:
        try:
            tree = ast.parse(cell)
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            continue
        for node in tree.body:
            if isinstance(node, ast.FunctionDef) and node.name in set(names):
                found[node.name] = _normalised(node)
    return {name: text for name, text in found.items() if text}


def _normalised(function: ast.FunctionDef) -> str:
    own = {node.arg for node in ast.walk(function) if isinstance(node, ast.arg)}
    own |= {
        node.id
        for node in ast.walk(function)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    numbers: dict[str, str] = {}
    for node in ast.walk(function):
        if isinstance(node, ast.arg):
            node.arg, node.annotation = numbers.setdefault(node.arg, f"v{len(numbers)}"), None
        elif isinstance(node, ast.Name) and node.id in own:
            node.id = numbers.setdefault(node.id, f"v{len(numbers)}")
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    if sum(1 for one in body for _ in ast.walk(one)) < _LEAST:
        return ""
    return "\n".join(ast.dump(one) for one in body)


def same_code(
    prints: Mapping[str, Mapping[str, str]], references: Sequence[str] = ()
) -> dict[str, list[str]]:
    """Return a sentence for each student whose functions others have handed in as well.

    Parameters
    ----------
    prints : mapping
        From a student to `fingerprints`.
    references : sequence of str
        Normalised trees of the published solutions: who has one of them has it from there.

    Returns
    -------
    dict
        From a student to sentences; a student without copies is not in it.
    """
    owners: dict[tuple[str, str], list[str]] = defaultdict(list)
    for student, functions in prints.items():
        for name, text in functions.items():
            if text not in references:
                owners[name, text].append(student)
    alike: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for (name, _), students in owners.items():
        alike[tuple(students)].append(name)
    said: dict[str, list[str]] = defaultdict(list)
    for group, names in alike.items():
        for student in group if len(group) > 1 else ():
            others = [other for other in group if other != student]
            more = f" and {len(others) - 3} more" if len(others) > 4 else ""
            shown = ", ".join(others[:3] if more else others)
            said[student].append(f"same code as {shown}{more}: {', '.join(names)}")
    return dict(said)
