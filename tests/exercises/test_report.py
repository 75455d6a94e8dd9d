"""The frame of the checks: right answers pass in any shape, wrong ones are told what is wrong."""

import warnings

import numpy as np
import pytest

from slamlab.exercises import Check
from slamlab.exercises._report import Array, Ints
from slamlab.exercises._values import difference
from slamlab.gaussian import Gaussian


def _add(a: Array, b: Array) -> Array:
    return a + b


check = Check(
    _add,
    "total",
    {
        "the sum of two vectors": ([1.0, 2.0], [3.0, 5.0]),
        "zero changes nothing": ([1.0, 2.0], [0.0, 0.0]),
        "vectors of any length": lambda rng: rng.normal(size=(2, rng.integers(1, 6))),
    },
    {"this is the difference": "a + b => a - b"},
)


@pytest.mark.parametrize(
    "student",
    [
        lambda a, b: a + b,
        lambda a, b: (a + b).tolist(),
        lambda a, b: tuple(a + b),
        lambda a, b: (a + b)[:, None],
    ],
)
def test_a_right_answer_passes_in_any_shape(student, capsys):
    report = check(student)
    assert report.passed
    assert (report.held, report.total) == (4, 4)
    assert "4 of 4 properties hold. Well done" in capsys.readouterr().out


def test_a_known_mistake_is_named():
    report = check(lambda a, b: a - b)
    assert report.messages == ("this is the difference",)
    assert (report.held, report.total) == (2, 4)
    assert "ok   zero changes nothing" in report.text
    assert "tried a = [1.0, 2.0], b = [3.0, 5.0]" in report.text
    assert "total[0]: expected 4, got -2 (2 of 2 entries differ)" in report.text


def test_inputs_that_are_the_checks_own_are_named_as_those():
    def judged(function, start, seed, noise):
        return function(start + seed + noise, 0.0)

    def broken(a, b):
        raise TypeError("no")

    line = Check(_add, "total", {"a drive": (1.0, 2, 0.5)}, use=judged)(broken).rows[0].lines[0]
    assert line == "the check's own inputs: start = 1.0, seed = 2, noise = 0.5"


def test_of_a_long_path_the_largest_difference_is_told_as_well():
    path = np.zeros((100, 3))
    came = path + 0.002
    came[99, 0] = -15.5
    (line,) = difference(came, path, 1e-6, ("poses",))
    assert line.startswith("poses[0, 0]: expected 0, got 0.002 (300 of 300 entries differ, ")
    assert line.endswith("poses[99, 0] by 15.5)")
    (line,) = difference(path + 0.002, path, 1e-6, ("poses",))
    assert line.endswith("(300 of 300 entries differ)")
    (line,) = difference(came[:9, 0] * [*8 * [1.0], 1e4], path[:9, 0], 1e-6, ("x",))
    assert line.endswith("(9 of 9 entries differ)")


def test_a_mistake_that_does_not_explain_everything_is_not_named():
    report = check(lambda a, b: a - b if len(a) == 2 else a - 2 * b)
    assert report.messages == ()


@pytest.mark.parametrize(
    ("student", "message"),
    [
        (lambda a, b: -a - b, "the sign of `total` is reversed"),
        (lambda a, b: a, "`a` was returned unchanged"),
        (lambda a, b: b / 1.0, "`b` was returned unchanged"),
        (lambda a, b: 2 * a + b, "`a` counts twice"),
        (lambda a, b: a + b + 2 * np.pi, "an angle is off by a full turn"),
        (lambda a, b: (a + b) * (1 + 1e-5), "almost right"),
    ],
)
def test_mistakes_that_can_occur_anywhere_are_named(student, message):
    assert check(student).messages[0].startswith(message)


@pytest.mark.parametrize("nothing", [lambda a, b: None, lambda a, b: ...])
def test_a_stub_gets_one_friendly_line(nothing):
    report = check(nothing)
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


def test_a_forgotten_return_is_told_from_a_stub():
    def forgets(a, b):
        total = a + b  # noqa: F841

    assert check(forgets).messages == ("your function returns nothing: a `return` is missing",)


def test_none_in_one_branch_counts_where_it_came():
    report = check(lambda a, b: a + b if len(a) == 2 else None)
    assert report.held == 3
    assert "a `return` is missing in one branch" in report.text


def test_an_exception_is_shown_with_its_input_and_not_raised():
    report = check(lambda a, b: a @ np.zeros((3, 3)))
    assert "your function raised ValueError" in report.text
    assert "tried a = [1.0, 2.0], b = [3.0, 5.0]" in report.text


def test_a_wrong_shape_and_not_a_number_are_said():
    assert "expected shape (2,), got (7,)" in check(lambda a, b: np.zeros(7)).text
    assert "not a number" in check(lambda a, b: a * np.nan).text
    assert "not made of numbers" in check(lambda a, b: "four").text


def test_a_wrong_shape_is_said_with_its_axes_of_length_one():
    def _rows(a: Array) -> Array:
        return a[None, :] + 1.0

    text = Check(_rows, "rows", {"one row": ([1, 2, 3],)})(lambda a: np.vstack([a, a + 1])).text
    assert "rows: expected shape (1, 3), got (2, 3)" in text
    assert "expected shape (2,), got (1,)" in check(lambda a, b: np.zeros(1)).text
    assert "expected shape (2,), got (3,)" in check(lambda a, b: np.zeros((1, 3))).text


def test_as_many_digits_are_shown_as_tell_the_numbers_apart():
    text = check(lambda a, b: (a + b) * (1 + 1e-7)).text
    assert "expected 4, got 4.0000004" in text
    assert "expected 1, got 1.0000001" in text


def test_a_changed_argument_is_told():
    def spoils(a, b):
        a += b
        return a.copy()

    report = check(spoils)
    assert not report.passed
    assert "your function changes its argument `a`" in report.text


def test_a_result_that_is_an_argument_is_told():
    report = check(lambda a, b: np.add(a, b) if b.any() else a)
    assert not report.passed
    assert "the result shares its memory with `a`" in report.text


def _kinds(x: float, n: int, rows: Ints, many: Array) -> float:
    return x + n + rows.sum() + many.sum()


def test_arguments_arrive_as_the_types_that_are_documented():
    def student(x, n, rows, many):
        assert type(x) is float
        assert type(n) is int
        assert rows.dtype == int
        assert many.dtype == float
        return x + n + rows.sum() + many.sum()

    assert Check(_kinds, "sum", {"types": (1, 2.0, [3.0], [4])})(student).passed


def _none(a: float) -> float | None:
    return None if a < 0 else a


def test_none_may_be_expected():
    maybe = Check(_none, "a", {"none": (-1,), "some": (2,)})
    assert maybe(lambda a: a if a >= 0 else None).passed
    assert not maybe(lambda a: a).passed


def _belief(a: float) -> Gaussian:
    return Gaussian([a], [[2.0]])


def test_beliefs_and_tuples_agree_and_exchanged_results_are_named():
    belief = Check(_belief, "mean, cov", {"a belief": (1,)})
    assert belief(lambda a: ([1.0], [[2.0]])).passed
    assert not belief(lambda a: ([1.0], [[3.0]])).passed
    message = "the results `mean` and `cov` are exchanged"
    assert belief(lambda a: ([[2.0]], [1.0])).messages == (message,)


def test_the_table_says_what_the_text_says():
    table = check(lambda a, b: a - b)._repr_html_()
    assert table.count("<tr>") == 4
    assert "this is the difference" in table
    nothing = check(lambda a, b: None)
    assert "<tr>" not in nothing._repr_html_()
    assert "nothing returned yet: replace the <code>...</code> by" in nothing._repr_html_()


def _reach(a: float) -> float:
    return np.inf if a < 0 else a


def test_an_infinite_answer_brings_no_warning():
    reach = Check(_reach, "range", {"nothing there": (-1,), "something": (2,)})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not reach(lambda a: 3.0 * a).passed
        assert not reach(lambda a: -np.inf).passed


def test_one_array_for_all_calls_is_told():
    buffer = np.zeros(2)

    def into_one(a, b):
        if len(a) != 2:
            return a + b
        buffer[:] = a + b
        return buffer

    report = check(into_one)
    assert report.held == report.total - 1
    assert "one array serves two calls" in report.text
    assert not check.passes(into_one)
    assert check.passes(lambda a, b: a + b)


def test_an_empty_array_or_a_number_may_serve_two_calls():
    nothing = np.zeros(0)
    empty = Check(lambda x: nothing, "none", {"one": (1.0,), "two": (2.0,)})
    assert empty(lambda x: nothing).passed
    zero = Check(lambda x: 0.0, "none", {"one": (1.0,), "two": (2.0,)})
    assert zero(lambda x: 0.0).passed


def _turned(heading: float, rate: float, dt: float) -> float:
    return heading + rate * dt


def test_a_number_in_place_of_an_argument_is_named():
    turned = Check(
        _turned,
        "heading",
        {"half": (0.3, 1.5, 0.5), "a tenth": (0.2, -1.0, 0.1), "a quarter": (1.0, 2.0, 0.25)},
    )
    report = turned(lambda heading, rate, dt: heading + 0.25 * rate)
    assert report.messages == ("`dt` has no effect, as if it were always 0.25",)
    assert turned(lambda heading, rate, dt: heading + 0.3 * rate).messages == ()


def test_a_number_just_below_one_is_not_shown_as_one():
    below = Check(_turned, "heading", {"just below": (1 - 1e-12, 0.0, 1.0)})
    assert "tried heading = 0.999999999999, rate = 0.0, dt = 1.0" in below(lambda *_: 5.0).text


def test_a_function_of_nothing_gives_one_input_when_it_is_asked_for():
    asked = []

    def slow():
        asked.append(1)
        return [1.0, 2.0], [3.0, 5.0]

    late = Check(_add, "total", {"slow": slow, "any": lambda rng: rng.normal(size=(2, 3))})
    assert asked == []
    assert late(lambda a, b: a + b).passed
    assert asked == [1]
    assert [name for name, _ in late.inputs] == ["slow"] + 6 * ["any"]
