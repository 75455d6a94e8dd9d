"""The check framework: it accepts right answers in any shape and names known mistakes."""

import numpy as np
import pytest

from slamlab.exercises import Mistake, Property, run_checks
from slamlab.gaussian import Gaussian

PROPERTIES = [
    Property("the sum of two vectors", (np.array([1.0, 2.0]), np.array([3.0, 5.0])), [4.0, 7.0]),
    Property("zero changes nothing", (np.array([1.0, 2.0]), np.zeros(2)), [1.0, 2.0]),
]
MISTAKES = [Mistake("this is the difference", lambda a, b: a - b)]


def check(student):
    return run_checks("add", student, PROPERTIES, MISTAKES)


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
    assert "2 of 2 properties hold. Well done" in capsys.readouterr().out


def test_a_known_mistake_is_named(capsys):
    report = check(lambda a, b: a - b)
    assert not report.passed
    assert report.messages == ("this is the difference",)
    out = capsys.readouterr().out
    assert "ok   zero changes nothing" in out
    assert "came  [-2.0, -3.0]" in out
    assert "due   [4.0, 7.0]" in out


@pytest.mark.parametrize("nothing", [lambda a, b: None, lambda a, b: ...])
def test_a_stub_gets_one_friendly_line(nothing, capsys):
    report = check(nothing)
    assert not report.passed
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert "nothing returned yet" in report.text


def test_an_exception_is_shown_with_its_input_and_not_raised(capsys):
    report = check(lambda a, b: a @ np.zeros((3, 3)))
    assert not report.passed
    assert "your function raised ValueError" in report.text
    assert "tried [1.0, 2.0], [3.0, 5.0]" in report.text


def test_a_wrong_shape_and_not_a_number_are_said():
    assert "shape (3,), due is (2,)" in check(lambda a, b: np.zeros(3)).text
    assert "NaN" in check(lambda a, b: a * np.nan).text
    assert "not made of numbers" in check(lambda a, b: "four").text


def test_arguments_are_copies_so_that_a_student_cannot_break_the_next_property():
    def spoils(a, b):
        a += b
        return a

    assert check(spoils).passed
    assert PROPERTIES[0].arguments[0].tolist() == [1.0, 2.0]


def test_beliefs_and_tuples_agree():
    due = Gaussian([1.0], [[2.0]])
    properties = [Property("a belief", (), due)]
    assert run_checks("belief", lambda: ([1.0], [[2.0]]), properties).passed
    assert run_checks("belief", lambda: due, properties).passed
    assert not run_checks("belief", lambda: ([1.0], [[3.0]]), properties).passed
