"""Try every check with mutants of its own solution: each must be refused, or be equivalent.

    python tools/mutate.py            the table of all exercises
    python tools/mutate.py 02 09      of these chapters, with the mutants that pass

A mutant is the solution of `notebooks/solutions/` with one thing changed: an operator, a
comparison or its boundary, a constant, an index, a transpose, a sign, a wrap (taken out, or to one
side only), an absolute value put in or taken out, a remainder that keeps its sign, a term, the
order of arguments or results, a statement; or a solution that writes into its arguments or
returns them. Mutants that change no answer are listed in `equivalent_mutants.txt`, each with a
reason.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import importlib
import inspect
import itertools
import signal
import sys
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat
import numpy as np

from slamlab.exercises import Check

ROOT = Path(__file__).resolve().parents[1]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.txt")
# A mutant never ends whose `while` loops turn more often in all inputs together (no solution's
# turn 500 times), or that runs longer, in seconds of the processor. It gets this much memory, in
# bytes, on top of what is in use: a shape that is changed can ask for more than a machine has.
TURNS, SECONDS, MEMORY = 5000, 1.0, 2 << 30
OPERATORS: dict[type, tuple[type, ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Div,),
    ast.Mod: (ast.FloorDiv,),
    ast.Pow: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
NAMES = [
    ("sin", "cos"),
    ("min", "max"),
    ("argmin", "argmax"),
    ("any", "all"),
    ("sum", "mean"),
    ("zeros", "ones"),
    ("floor", "ceil"),
    ("vstack", "hstack"),
    ("exp", "log"),
    ("sqrt", "square"),
    ("hypot", "add"),
]
OTHER = {**dict(NAMES), **{b: a for a, b in NAMES}}


@dataclass(frozen=True)
class Solution:
    """A check, the cells before its solution, and the solution as a syntax tree."""

    chapter: str
    check: Check
    before: str
    tree: ast.Module

    @property
    def name(self) -> str:
        """Chapter and exercise."""
        return f"{self.chapter}.{self.check.name}"


def solutions(chapters: list[str] | None = None) -> Iterator[Solution]:
    """Find the solution of every check in the notebooks of solutions."""
    for path in sorted((ROOT / "notebooks" / "solutions").glob("*.ipynb")):
        chapter = path.name[:2]
        if chapters and chapter not in chapters:
            continue
        module = importlib.import_module(f"slamlab.exercises.ch{path.stem}")
        checks = {name: value for name, value in vars(module).items() if isinstance(value, Check)}
        before = ""
        for cell in nbformat.read(path, as_version=4).cells:
            if cell.cell_type != "code":
                continue
            tree = ast.parse(cell.source)
            for called, given in _calls(tree):
                if called not in checks:
                    continue
                if isinstance(given, ast.Lambda):
                    name = checks[called].name
                    tree.body.insert(0, ast.Assign([ast.Name(name)], given, lineno=1))
                elif given.id == checks[called].name:
                    name = given.id
                else:
                    continue
                part = ast.parse(ast.unparse(ast.fix_missing_locations(_defined(tree))))
                yield Solution(chapter, checks.pop(called), before, part)
            before += ast.unparse(_defined(tree)) + "\n"
        if checks:
            raise LookupError(f"{path.name}: no solution for {', '.join(checks)}")


def _calls(tree: ast.Module) -> Iterator[tuple[str, Any]]:
    """Yield name and first argument of the calls at the top of a cell."""
    for node in tree.body:
        call = node.value if isinstance(node, ast.Expr) else None
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.args:
            if isinstance(call.args[0], (ast.Name, ast.Lambda)):
                yield call.func.id, call.args[0]


def _defined(tree: ast.Module) -> ast.Module:
    """Leave out the cells' last lines, which call checks and show things."""
    kinds = (ast.FunctionDef, ast.ClassDef, ast.Import, ast.ImportFrom, ast.Assign)
    return ast.Module([node for node in tree.body if isinstance(node, kinds)], [])


def mutants(solution: Solution) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield what was changed, and the changed function."""
    name, seen = solution.check.name, {ast.unparse(solution.tree)}
    scope: dict[str, Any] = {}
    exec(compile(solution.before, "<before>", "exec"), scope)
    for text, tree in _edits(solution.tree):
        source = ast.unparse(tree)
        if source in seen:
            continue
        seen.add(source)
        mine = dict(scope, _turn=_counter())
        try:
            exec(compile(_counted(source), "<mutant>", "exec"), mine)
        except Exception:  # it cannot even be defined
            continue
        if name in mine:
            yield text, mine[name]
    mine = dict(scope)
    exec(compile(ast.unparse(solution.tree), "<solution>", "exec"), mine)
    yield from _careless(solution.check, mine[name])


def _counter() -> Callable[[], None]:
    """Return what every turn of a `while` calls; from one turn on it raises."""
    left = itertools.repeat(None, TURNS)

    def turn() -> None:
        for _ in left:
            return
        raise TimeoutError("it did not end")

    return turn


def _counted(source: str) -> str | ast.Module:
    """Write a call of the counter into every `while`."""
    if "while" not in source:
        return source
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.While):
            node.body.insert(0, ast.parse("_turn()").body[0])
    return ast.fix_missing_locations(tree)


def _careless(check: Check, function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Write into an argument after the work is done; hand the argument back as the result."""
    for k, name in enumerate(inspect.signature(function).parameters):
        arrays = [given[k] for _, given in check.inputs if k < len(given)]
        if not any(isinstance(a, np.ndarray) and a.size for a in arrays):
            continue

        def writes(*given: Any, k: int = k) -> Any:
            came = copy.deepcopy(function(*given))
            if given[k].size:
                given[k].flat[0] = 1 - given[k].flat[0]
            return came

        yield f"writes into {name}", writes
        for part in range(len(check.returns)):
            whole = len(check.returns) == 1
            dues = [due if whole or isinstance(due, str) else due[part] for due in check.due]
            if not any(
                np.shape(a) == np.shape(b) != () for a, b in zip(arrays, dues, strict=True)
            ):
                continue

            def lends(*given: Any, k: int = k, part: int = part) -> Any:
                came = function(*given)
                parts = list(came) if len(check.returns) > 1 else [came]
                if np.shape(parts[part]) == np.shape(given[k]):
                    given[k][...] = parts[part]
                    parts[part] = given[k]
                return parts if len(parts) > 1 else parts[0]

            yield f"works in {name} and returns it as {check.returns[part]}", lends


def _edits(tree: ast.Module) -> Iterator[tuple[str, ast.Module]]:
    """Yield what is changed and the tree with this change, which is undone before the next."""
    holders = {part: node for node in ast.walk(tree) for part in ast.iter_child_nodes(node)}
    sizes = set(_sizes(tree))
    for node in list(ast.walk(tree)):
        if isinstance(node, (ast.expr_context, ast.operator, ast.alias)):
            continue
        before = ast.unparse(node)
        for change in _changes(node, node not in sizes):
            kept = dict(vars(node))
            new = change(node)
            if new is not node:
                _replace(holders[node], node, new)
            yield _line(before, "nothing" if isinstance(new, ast.Pass) else ast.unparse(new)), tree
            if new is not node:
                _replace(holders[node], new, node)
            vars(node).update(kept)


def _line(before: str, after: str) -> str:
    return " ".join(f"{before}  ->  {after}".split("\n"))


def _replace(holder: ast.AST, old: ast.AST, new: ast.AST) -> None:
    for field, value in ast.iter_fields(holder):
        if value is old:
            setattr(holder, field, new)
        elif isinstance(value, list):
            setattr(holder, field, [new if entry is old else entry for entry in value])


def _sizes(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield what is squared, or of what the absolute value or the length is taken."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            if ast.unparse(node.right) == "2":
                yield node.left
        if isinstance(node, ast.Call) and _called(node) in ("abs", "hypot", "norm"):
            yield from node.args


def _changes(node: ast.AST, signed: bool) -> Iterator[Callable[[Any], ast.AST]]:
    if isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp)):
        for other in OPERATORS.get(type(node.op), ()):
            yield lambda n, other=other: _set(n, op=other())
    if isinstance(node, ast.BinOp):
        yield lambda n: n.left
        yield lambda n: n.right
        if isinstance(node.op, (ast.Sub, ast.Div, ast.MatMult, ast.Pow, ast.Mod)):
            yield lambda n: _set(n, left=n.right, right=n.left)
        if isinstance(node.op, ast.MatMult):
            yield lambda n: _set(n, left=_transposed(n.left))
            yield lambda n: _set(n, right=_transposed(n.right))
        if signed and isinstance(node.op, ast.Sub):
            yield lambda n: _written(f"np.abs({ast.unparse(n)})")
        if isinstance(node.op, ast.Mod):
            yield lambda n: _written(f"np.fmod({ast.unparse(n.left)}, {ast.unparse(n.right)})")
    if isinstance(node, ast.BoolOp):
        for k in range(len(node.values)):
            yield lambda n, k=k: n.values[k]
    if isinstance(node, ast.AugAssign):
        yield lambda n: ast.Assign([n.target], n.value, lineno=n.lineno)
    if isinstance(node, ast.UnaryOp):
        yield lambda n: n.operand
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for other in OPERATORS.get(type(op), ()):
                yield lambda n, k=k, other=other: _set(
                    n, ops=[*n.ops[:k], other(), *n.ops[k + 1 :]]
                )
            if len(node.ops) > 1:
                yield lambda n, k=k: ast.Compare(
                    n.comparators[k - 1] if k else n.left, [n.ops[k]], [n.comparators[k]]
                )
    if isinstance(node, ast.Constant):
        yield from _constants(node.value)
    if isinstance(node, ast.Attribute) and node.attr == "T":
        yield lambda n: n.value
    if isinstance(node, ast.Attribute) and node.attr in OTHER:
        yield lambda n: _set(n, attr=OTHER[n.attr])
    if isinstance(node, ast.Name) and node.id in OTHER:
        yield lambda n: _set(n, id=OTHER[n.id])
    if isinstance(node, ast.Call):
        if node.args and not isinstance(node.args[0], (ast.List, ast.ListComp)):
            yield lambda n: n.args[0]  # (a list is accepted as an array)
        elif not node.args and isinstance(node.func, ast.Attribute):
            yield lambda n: n.func.value
        for k in range(1, len(node.args)):
            yield lambda n, k=k: _set(
                n, args=[*n.args[: k - 1], n.args[k], n.args[k - 1], *n.args[k + 1 :]]
            )
        for k in range(len(node.keywords)):
            yield lambda n, k=k: _set(n, keywords=n.keywords[:k] + n.keywords[k + 1 :])
    if signed and isinstance(node, ast.Call) and _called(node) in ("wrap_angle", "arctan2"):
        yield lambda n: _written(f"np.abs({ast.unparse(n)})")
    if isinstance(node, ast.Call) and _called(node) == "wrap_angle":
        for side in ("({0} > np.pi)", "({0} <= -np.pi)"):
            turn = "-" if ">" in side else "+"
            line = f"{{0}} {turn} 2 * np.pi * {side}"
            yield lambda n, line=line: _written(line.format(f"({ast.unparse(n.args[0])})"))
    if isinstance(node, ast.Slice):
        for field in ("lower", "upper", "step"):
            if getattr(node, field) is not None:
                yield lambda n, field=field: _set(n, **{field: None})
    if isinstance(node, (ast.Tuple, ast.List)):
        for k in range(1, len(node.elts)):
            yield lambda n, k=k: _set(
                n, elts=[*n.elts[: k - 1], n.elts[k], n.elts[k - 1], *n.elts[k + 1 :]]
            )
    if isinstance(node, (ast.IfExp,)):
        yield lambda n: n.body
        yield lambda n: n.orelse
        yield lambda n: _set(n, body=n.orelse, orelse=n.body)
    if isinstance(node, ast.If):
        yield lambda n: _set(n, test=ast.UnaryOp(ast.Not(), n.test))
        yield lambda n: _set(n, test=ast.Constant(True))
        yield lambda n: _set(n, test=ast.Constant(False))
    if isinstance(node, ast.arguments):
        for k in range(1, len(node.args)):
            yield lambda n, k=k: _set(
                n, args=[*n.args[: k - 1], n.args[k], n.args[k - 1], *n.args[k + 1 :]]
            )
    if isinstance(
        node, (ast.Assign, ast.AugAssign, ast.Return, ast.Expr, ast.Continue, ast.Break)
    ):
        if not _is_docstring(node):
            yield lambda n: ast.Pass()


def _constants(value: Any) -> Iterator[Callable[[Any], ast.AST]]:
    if isinstance(value, bool):
        yield lambda n: ast.Constant(not n.value)
    elif isinstance(value, (int, float)):
        for other in dict.fromkeys((value + 1, value - 1, -value, 0, 2 * value)):
            if other != value:
                yield lambda n, other=other: ast.Constant(other)
    elif value in ("left", "right"):
        yield lambda n: ast.Constant("left" if n.value == "right" else "right")


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _called(node: ast.Call) -> str:
    """Name of the function that is called, without the module it is of."""
    return ast.unparse(node.func).rpartition(".")[2]


def _written(code: str) -> ast.expr:
    """Return the tree of an expression."""
    return ast.parse(code, mode="eval").body


def _transposed(node: ast.expr) -> ast.expr:
    return ast.Attribute(node, "T", ast.Load())


def _set(node: Any, **fields: Any) -> Any:
    for field, value in fields.items():
        setattr(node, field, value)
    return node


def refused(check: Check, function: Callable[..., Any]) -> bool:
    """Say whether a check refuses a function, be it for never ending or for its memory."""

    def ring(*_: Any) -> None:
        raise TimeoutError("it did not end")

    old = signal.signal(signal.SIGVTALRM, ring)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        with _little_memory():
            return not check.passes(function)
    except TimeoutError:
        return True
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, old)


@contextlib.contextmanager
def _little_memory() -> Iterator[None]:
    """Let NumPy raise MemoryError early, where the system keeps such a limit (Linux)."""
    try:
        import resource

        in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except (ImportError, OSError):
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = in_use + MEMORY
    if soft != resource.RLIM_INFINITY:
        limit = min(limit, soft)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def equivalent() -> dict[str, str]:
    """Read the mutants that change no answer: lines ``exercise | mutant | reason``."""
    lines = EQUIVALENT.read_text(encoding="utf-8").splitlines() if EQUIVALENT.exists() else []
    rows = [line.split(" | ") for line in lines if line.strip() and not line.startswith("#")]
    return {f"{name} | {text}": reason for name, text, reason in rows}


def try_all(solution: Solution, known: Container[str] = ()) -> tuple[int, list[str]]:
    """Return how many mutants there are, and what was changed in those that pass.

    Those that are `known` to pass, as `equivalent` names them, are not tried.
    """
    solution.check.due  # noqa: B018 (computed once, outside of the time of a mutant)
    total, passed = 0, []
    for text, wrong in mutants(solution):
        total += 1
        if f"{solution.name} | {text}" not in known and not refused(solution.check, wrong):
            passed.append(text)
    return total, passed


def main(chapters: list[str]) -> int:
    known, bad = equivalent(), 0
    print(f"{'exercise':32s} inputs  mutants  refused  equivalent  passed  score")
    for solution in solutions(chapters):
        total, passed = try_all(solution)
        same = [text for text in passed if f"{solution.name} | {text}" in known]
        left = [text for text in passed if text not in same]
        out = total - len(passed)
        score = 100 * out / max(total - len(same), 1)
        row = f"{total:8d} {out:8d} {len(same):11d} {len(left):7d}  {score:.0f} %"
        print(f"{solution.name:32s} {len(solution.check.inputs):6d} {row}", flush=True)
        for text in left:
            print(f"{solution.name} | {text} | ")
        bad += len(left)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
