"""Exercise checks that try many inputs and name the mistake.

An exercise stands once, in cells that jupytext and most editors know; ``make exercises`` writes
both notebooks of it (`tools/exercises.py` says which cells there are). Its check, in ten lines::

    # %% tags=["exercise"]
    def update(mean: Array, cov: Array, z: Array, H: Array, R: Array) -> Belief:
        '''What the student reads; the body is the solution and the reference.'''

    # %% tags=["cases"]
    check_update = Check(
        update,                                    # its annotations are the types of arguments
        "mean, cov",                               # names of the results
        {"one number": ([0.0], [[1.0]], ...),      # a property: one input, or ...
         "more states than readings": draw},       # ... draw(rng) -> input, for six seeded ones
    )

    # %% tags=["mistakes"]
    check_update.mistakes = {
        "R is missing in S": "+ R => ",            # how the solution's code differs,
        "the innovation has the wrong sign": f,    # or a wrong function
    }

Annotations `float`, `int`, `bool`, `Array`, `Ints` and `Mask` say as what an argument arrives;
anything else arrives as a copy. ``use=`` changes what is compared (see `Check`). Mistakes that
can occur anywhere (a transpose, an exchange, a full turn, degrees, an argument without effect)
are recognised in every exercise and need not be listed.
"""

from __future__ import annotations

import ast
import builtins
import copy
import inspect
import re
import textwrap
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamlab._checks import as_count
from slamlab.exercises._general import NEARLY, general_mistakes
from slamlab.exercises._pictures import Picture, side_by_side
from slamlab.exercises._values import (
    agree,
    difference,
    is_stub,
    overlap,
    places,
    plain,
    right_in_part,
    same,
    show,
)

__all__ = ["Array", "Check", "Function", "Ints", "Mask", "Observation", "Report"]

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]
Function = Callable[..., Any]
Mistake = Function | str | tuple[str, ...]

NOTHING_YET = "nothing returned yet: replace the `...` by your own lines and run the cell again"
NO_RETURN = "your function returns nothing: a `return` is missing"
HUNT = "a bug hunt: the report does not name the bug. Begin with the first NO"
OWN = "arguments stay as they were, results are new"
_TYPES: dict[Any, Callable[[Any], Any]] = {
    float: float,
    int: int,
    bool: bool,
    Array: lambda value: np.array(value, dtype=float),
    Ints: lambda value: np.array(value, dtype=int),
    Mask: lambda value: np.array(value, dtype=bool),
}


@dataclass(frozen=True)
class Row:
    """One property of a report: its name, whether it holds, and what to read if not."""

    name: str
    ok: bool
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """Outcome of a check.

    Attributes
    ----------
    title : str
        Name of the exercise.
    rows : tuple of Row
        One a property.
    messages : tuple of str
        The mistakes that were recognised.
    right : float
        Share of the numbers of the result that are right on every input.
    hunt : bool
        Say not which mistake was recognised: to find it is the exercise.
    """

    title: str
    rows: tuple[Row, ...]
    messages: tuple[str, ...] = ()
    right: float = 0.0
    hunt: bool = False

    @property
    def held(self) -> int:
        """Number of properties that hold."""
        return sum(row.ok for row in self.rows)

    @property
    def total(self) -> int:
        """Number of properties."""
        return len(self.rows)

    @property
    def share(self) -> float:
        """What the exercise is worth, 0 to 1: the share of its properties that hold.

        Where not all numbers of a result are wrong, a property that fails counts as well: half of
        the share that is right on every input.
        """
        failed = sum(not row.ok for row in self.rows if row.name != OWN)
        return (self.held + 0.5 * self.right * failed) / self.total

    @property
    def passed(self) -> bool:
        """Say whether every property holds."""
        return self.held == self.total

    @property
    def text(self) -> str:
        """The report as lines of text."""
        lines = [self._head()]
        for row in self._shown():
            lines += [f"  {'ok ' if row.ok else 'NO '}  {row.name}"]
            lines += [f"       {line}" for line in row.lines]
        return "\n".join(lines + [f"  -> {message}" for message in self._said()])

    def _shown(self) -> tuple[Row, ...]:
        """Return the rows that tell something: none as long as nothing comes."""
        return () if self.messages in ((NOTHING_YET,), (NO_RETURN,)) else self.rows

    def _said(self) -> tuple[str, ...]:
        """Return the messages that are shown: in a hunt none that names the bug."""
        return (HUNT,) if self.hunt and self._shown() and not self.passed else self.messages

    def _head(self) -> str:
        done = ". Well done" if self.passed else ""
        return f"{self.title}: {self.held} of {self.total} properties hold{done}"

    def __repr__(self) -> str:
        """Return the text of the report."""
        return self.text

    def _repr_html_(self) -> str:
        """Return a small table, one row a property."""
        style = "style='text-align:left; vertical-align:top; padding:0.15em 0.6em'"
        rows = "".join(
            f"<tr><td {style}>{'ok' if row.ok else '<b>NO</b>'}</td><td {style}>"
            + "<br>".join(_in_html(line) for line in (row.name, *row.lines))
            + "</td></tr>"
            for row in self._shown()
        )
        table = f"<table style='margin-left:0'>{rows}</table>" if rows else ""
        said = "".join(f"<p><b>{_in_html(message)}</b></p>" for message in self._said())
        return f"<p>{_in_html(self._head())}</p>{table}{said}"


def _in_html(line: str) -> str:
    """Escape what HTML would read; code stands in its own letters."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(line))


@dataclass(frozen=True)
class Observation:
    """What a function did on one input: what it returned, or what it raised.

    `came` is plain data (numbers, arrays, lists, tuples, None), so that it can be sent from one
    process to another; `changed` and `shared` name arguments, `reused` says that an array of the
    result was one of an earlier call.
    """

    came: Any = None
    raised: str = ""
    stub: bool = False
    changed: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()
    reused: bool = False


class Check:
    """Check of one exercise: call it with the student's function.

    Parameters
    ----------
    reference : callable
        The right answer; its annotations type the arguments.
    returns : str
        Names of the results, separated by commas.
    properties : mapping
        From a sentence to a tuple of arguments, or to ``draw(rng) -> arguments``; a function of
        nothing gives one tuple, which takes a while to compute, when it is asked for.
    mistakes : mapping
        From what to tell the student to a wrong function, or to an edit ``"old => new"`` of the
        reference's source (every old piece gives way to the new one), or to a tuple of edits.
    tolerance : float, default 1e-9
        Largest difference, absolute and relative. 1e-6 admits finite differences.
    draws : int, default 6
        Number of seeded inputs of each drawn property.
    use : callable, optional
        ``use(function, *arguments)`` gives what is compared, if not ``function(*arguments)``;
        it ends where the function returns nothing.
        It may give a sentence: an empty one where all is well, else what the student reads.
    edges : sequence of str
        Properties on the edge of what is asked: to raise there is said, and not counted.
    picture : callable, optional
        ``picture(ax, function)`` draws the truth and what a function gives (see `draw`).
    hunt : bool, default False
        A program with a bug is handed out: which mistake it is, the report recognises, and does
        not show.
    """

    def __init__(
        self,
        reference: Function,
        returns: str,
        properties: Mapping[str, Any],
        mistakes: Mapping[str, Mistake] = {},
        *,
        tolerance: float = 1e-9,
        draws: int = 6,
        use: Function | None = None,
        edges: Sequence[str] = (),
        picture: Picture | None = None,
        hunt: bool = False,
    ) -> None:
        self.reference, self.mistakes, self.tolerance = reference, mistakes, tolerance
        self.returns = tuple(part.strip() for part in returns.split(","))
        self._use, self._properties = use, properties
        self._seeds: list[tuple[int, ...]] = [(k,) for k in range(draws)]  # of drawn inputs
        self._edges = frozenset(edges)
        self._picture, self._hunt = picture, hunt
        # What a mistake gives on an input: asked of many wrong answers, worked out once.
        self._told: dict[tuple[int, int], Observation] = {}
        names = ", ".join(p.name for p in self.parameters)
        self.__doc__ = f"Check ``{self.name}({names}) -> {returns}``; returns a `Report`."

    def __repr__(self) -> str:
        """Return the call that is checked."""
        return f"<Check {self.__doc__.split('``')[1] if self.__doc__ else self.name}>"

    def __call__(self, student: Function) -> Report:
        """Try a function on every input, print a line for each property, return the report."""
        report = self.judge(self.observe(student))
        if not hasattr(builtins, "get_ipython"):  # a notebook shows the table instead
            print(report)
        return report

    def draw(self, student: Function) -> Any:
        """Draw what a function gives beside what is expected; a failure is shown as well.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it.

        Raises
        ------
        ValueError
            If the exercise has no picture.
        """
        if self._picture is None:
            raise ValueError(f"draw: expected an exercise with a picture, got {self!r}")
        return side_by_side(self._picture, student, self.reference)

    def of_variant(self, year: int) -> Check:
        """Return the same check with more drawn inputs, those of a year.

        Parameters
        ----------
        year : int
            Any number from 0.
        """
        other = copy.copy(self)
        for known in ("inputs", "due", "_suspects"):
            other.__dict__.pop(known, None)
        own, year = dict.fromkeys(seed[:1] for seed in self._seeds), as_count("year", year)
        other._seeds, other._told = [*own, *((*seed, year) for seed in own)], {}
        return other

    @property
    def has_picture(self) -> bool:
        """Say whether `draw` can draw something."""
        return self._picture is not None

    @property
    def name(self) -> str:
        """Name of the function that is checked."""
        return self.reference.__name__.lstrip("_")

    @property
    def is_hunt(self) -> bool:
        """Say whether a program with a bug is handed out."""
        return self._hunt

    @cached_property
    def parameters(self) -> list[inspect.Parameter]:
        """Parameters of the function that is checked."""
        return list(inspect.signature(self.reference, eval_str=True).parameters.values())

    @cached_property
    def inputs(self) -> list[tuple[str, tuple[Any, ...]]]:
        """Pairs of a property's name and typed arguments."""
        pairs = []
        for name, given in self._properties.items():
            own = zlib.crc32(name.encode())
            rngs = [np.random.default_rng((own, *seed)) for seed in self._seeds]
            if not callable(given):
                each = [given]
            elif not inspect.signature(given).parameters:
                each = [given()]
            else:
                each = [given(rng) for rng in rngs]
            pairs += [(name, self._typed(arguments)) for arguments in each]
        return pairs

    @cached_property
    def due(self) -> list[Any]:
        """What the reference gives on every input, plain."""
        return [self._look(self.reference, arguments).came for _, arguments in self.inputs]

    def passes(self, student: Function) -> bool:
        """Say whether a function passes, edges too, stopping at the first failure."""
        kept: dict[Any, Any] = {}
        for (_, arguments), due in zip(self.inputs, self.due, strict=True):
            seen = self._look(student, arguments, kept)
            if not _holds(seen, due, self.tolerance) or seen.changed or seen.shared or seen.reused:
                return False
        return True

    def observe(self, student: Function) -> list[Observation]:
        """Try a function on every input; what it raises is noted, never raised on."""
        # As they came: an array that is gone lends its place in memory to the next.
        kept: dict[Any, Any] = {}
        return [self._look(student, arguments, kept) for _, arguments in self.inputs]

    def judge(self, observations: Sequence[Observation]) -> Report:
        """Compare what was observed with what is expected, and name the mistake."""
        names = dict.fromkeys(name for name, _ in self.inputs)
        pairs = zip(self.inputs, observations, self.due, strict=True)
        held = [
            _holds(seen, due, self.tolerance) or bool(seen.raised and name in self._edges)
            for (name, _), seen, due in pairs
        ]
        rows = []
        for name in names:
            mine = [k for k, (of, _) in enumerate(self.inputs) if of == name]
            bad = next((k for k in mine if not held[k]), None)
            edge = next((k for k in mine if observations[k].raised), None)  # only told
            worst = edge if bad is None else bad
            lines = () if worst is None else self._lines(worst, observations[worst])
            rows.append(Row(name, bad is None, lines))
        nothing = all(s.came is None and not s.raised for s in observations)
        own = tuple(_own_lines(observations))
        if not any(held):
            own = (*own, "counted as soon as something else holds")
        rows.append(Row(OWN, not own, own))
        if nothing and not any(held):
            stub = any(s.stub for s in observations)
            return Report(self.name, tuple(rows), (NOTHING_YET if stub else NO_RETURN,))
        right = 0.0
        if not all(held) and self._use is None:
            came, given = [s.came for s in observations], [list(a) for _, a in self.inputs]
            right = right_in_part(came, self.due, given, self.tolerance)
        return Report(self.name, tuple(rows), self._named(observations, held), right, self._hunt)

    def _typed(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(self.parameters) != len(arguments):
            return tuple(arguments)
        pairs = zip(self.parameters, arguments, strict=True)
        return tuple(_TYPES.get(p.annotation, lambda v: v)(value) for p, value in pairs)

    def _names(self, arguments: tuple[Any, ...]) -> list[str]:
        if len(arguments) == len(self.parameters):
            return [p.name for p in self.parameters]
        own = list(inspect.signature(self._use).parameters)[1:] if self._use else []
        if len(own) == len(arguments):
            return own
        return [f"argument {k + 1}" for k in range(len(arguments))]

    def _look(
        self, function: Function, arguments: tuple[Any, ...], kept: dict[Any, Any] | None = None
    ) -> Observation:
        given, names = copy.deepcopy(arguments), self._names(arguments)
        stub = is_stub(function)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                came = self._use(_answered(function), *given) if self._use else function(*given)
            except _NothingCameError:
                came = None
            except NotImplementedError:
                return Observation(stub=True)
            except Exception as error:  # a student's exception is shown, not raised
                return Observation(raised=f"{type(error).__name__}: {error}")
        changed = [n for n, a, b in zip(names, given, arguments, strict=True) if not same(a, b)]
        shared = [n for n, a in zip(names, given, strict=True) if overlap(came, a)]
        if shared and function is not self.reference and not self._use:
            ours = copy.deepcopy(arguments)
            with np.errstate(all="ignore"):
                lent = self.reference(*ours)
            pairs = zip(names, ours, strict=True)
            shared = [n for n, a in pairs if n in shared and not overlap(lent, a)]
        reused = False
        if kept is not None and not self._use:
            arrays = places(came)
            reused = not arrays.isdisjoint(kept)
            kept.update(dict.fromkeys(arrays, came))
        came = None if came is Ellipsis else plain(came)
        return Observation(came, "", stub, tuple(changed), tuple(shared), reused)

    def _lines(self, k: int, seen: Observation) -> tuple[str, ...]:
        arguments = self.inputs[k][1]
        pairs = zip(self._names(arguments), arguments, strict=True)
        tried = "tried " if len(arguments) == len(self.parameters) else "the check's own inputs: "
        tried += ", ".join(f"{n} = {show(a)}" for n, a in pairs) or "no argument"
        if seen.raised:
            return (tried, f"your function raised {seen.raised}")
        if isinstance(self.due[k], str) and isinstance(seen.came, str):
            return (seen.came,)
        if seen.came is None:
            return (
                tried,
                "your function returned None here: is a `return` missing in one branch?",
            )
        return (tried, *difference(seen.came, self.due[k], self.tolerance, self.returns))

    def _named(self, seen: Sequence[Observation], held: list[bool]) -> tuple[str, ...]:
        """Name the mistake that explains all results; a mistake that explains less is none."""
        if all(held):
            return ()
        if any(
            not ok and not s.raised and s.came is None for s, ok in zip(seen, held, strict=True)
        ):
            return ("in some cases nothing was returned: a `return` is missing in one branch",)
        if not any(not ok and not s.raised for s, ok in zip(seen, held, strict=True)):
            return ()
        for number, (message, *_) in enumerate(self._suspects):
            if self._explains(number, seen, held):
                return (message,)
        due = [(s.came, d) for s, d, ok in zip(seen, self.due, held, strict=True) if not ok]
        for message, alike in NEARLY.items():
            if all(alike(came, right) for came, right in due):
                return (message,)
        return ()

    @cached_property
    def _suspects(self) -> list[tuple[str, Function, bool]]:
        mistakes = self.mistakes.items()
        found = [(message, self.mistaken(wrong), False) for message, wrong in mistakes]
        if self._use is None:
            names = self._names(self.inputs[0][1])
            found += general_mistakes(self.reference, names, self.returns)
            found += self._constants(names)
        return found

    def _constants(self, names: Sequence[str]) -> Iterator[tuple[str, Function, bool]]:
        """Yield the answers into which a number of an input was written for an argument."""
        for k, name in enumerate(names):
            given = [arguments[k] for _, arguments in self.inputs]
            if type(given[0]) in (int, float):
                for value, _ in Counter(given).most_common(3):
                    message = f"`{name}` has no effect, as if it were always {value:g}"
                    yield message, _with_constant(self.reference, k, value), False

    def mistaken(self, wrong: Mistake) -> Function:
        """Return the function of a mistake, be it given as one or as edits of the reference."""
        if callable(wrong):
            return wrong
        return _edited(self.reference, (wrong,) if isinstance(wrong, str) else wrong)

    def _explains(self, number: int, seen: Sequence[Observation], held: list[bool]) -> bool:
        # What is known already first, then failures: most are ruled out by the first look.
        order = sorted(range(len(seen)), key=lambda k: ((number, k) not in self._told, held[k]))
        return all(self._alike(self._of_suspect(number, k), seen[k]) for k in order)

    def _of_suspect(self, number: int, k: int) -> Observation:
        if (number, k) not in self._told:
            _, wrong, of_due = self._suspects[number]
            tried = _spoilt(wrong, self.due[k]) if of_due else self._look(wrong, self.inputs[k][1])
            self._told[number, k] = tried
        return self._told[number, k]

    def _alike(self, theirs: Observation, seen: Observation) -> bool:
        if seen.raised or theirs.raised:
            return bool(seen.raised and theirs.raised)
        return agree(seen.came, theirs.came, max(self.tolerance, 1e-9))


def _spoilt(wrong: Function, due: Any) -> Observation:
    """Return what a mistake makes of a right answer."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return Observation(plain(wrong(due)))
        except Exception as error:
            return Observation(raised=f"{type(error).__name__}: {error}")


class _NothingCameError(Exception):
    """The student's function returned nothing that a `use` could look at."""


def _answered(function: Function) -> Function:
    """Return a function that never returns nothing."""

    def ask(*arguments: Any) -> Any:
        came = function(*arguments)
        if came is None or came is Ellipsis:
            raise _NothingCameError
        return came

    return ask


def _own_lines(observations: Sequence[Observation]) -> Iterator[str]:
    changed = dict.fromkeys(name for s in observations for name in s.changed)
    shared = dict.fromkeys(name for s in observations for name in s.shared)
    for name in changed:
        yield f"your function changes its argument `{name}`: work on a copy"
    for name in shared:
        yield f"the result shares its memory with `{name}`: who changes one changes the other"
    if any(s.reused for s in observations):
        yield "one array serves two calls: make a new one in each, the second changes the first"


def _with_constant(reference: Function, k: int, value: float) -> Function:
    return lambda *given: reference(*given[:k], value, *given[k + 1 :])


def _edited(reference: Function, edits: tuple[str, ...]) -> Function:
    """Return the reference with pieces of its source replaced."""
    source = _without_docstring(textwrap.dedent(inspect.getsource(reference)))
    for edit in edits:
        old, new = edit.split(" => ")
        if old not in source:
            raise LookupError(f"{reference.__name__}: {old!r} is not in its source")
        source = source.replace(old, new)
    scope = dict(inspect.unwrap(reference).__globals__)
    exec(compile(source, f"<{reference.__name__}>", "exec"), scope)
    wrong: Function = scope[reference.__name__]
    return wrong


def _without_docstring(source: str) -> str:
    """Return a function's source as an edit sees it: what is said there is no code."""
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    if ast.get_docstring(function) is None:
        return source
    lines, text = source.splitlines(keepends=True), function.body[0]
    return "".join(lines[: text.lineno - 1] + lines[text.end_lineno :])


def _holds(seen: Observation, due: Any, tolerance: float) -> bool:
    return not seen.raised and agree(seen.came, due, tolerance)
