"""What is tried: every numeric argument takes three different values, results are new arrays."""

import numpy as np
import pytest
from test_checks import CHECKS

from slamlab.exercises import Check

# Arguments that take fewer values, each with the number; the list may only become shorter.
FEWER = {
    ("ch01.check_update", "sees_door"): 2,  # a door or a wall: there is no third
}


def numeric(value):
    """Shape and digits of an argument; None where it is no number or array of numbers."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None
    return array.shape, array.tobytes()


def fewer_than_three(check):
    """Numeric arguments that take one value or two among all inputs, with how many."""
    found = {}
    names = check._names(check.inputs[0][1])
    for k, name in enumerate(names):
        values = {numeric(arguments[k]) for _, arguments in check.inputs}
        if None not in values and len(values) < 3:
            found[name] = len(values)
    return found


@pytest.mark.parametrize("name", CHECKS)
def test_every_numeric_argument_takes_three_values_or_is_listed(name):
    listed = {argument: n for (check, argument), n in FEWER.items() if check == name}
    assert fewer_than_three(CHECKS[name]) == listed


def test_all_that_are_listed_exist():
    assert {name for name, _ in FEWER} <= set(CHECKS)


@pytest.mark.parametrize("name", CHECKS)
def test_the_results_of_a_right_answer_are_new_arrays(name):
    seen = CHECKS[name].observe(CHECKS[name].reference)
    assert not any(one.reused or one.shared or one.changed for one in seen)


def test_a_constant_in_place_of_an_argument_passes_where_it_takes_one_value():
    """The guard can fail: nothing tells `dt` from its number if it is always the same."""

    def moved(x: float, v: float, dt: float) -> float:
        return x + v * dt

    cases = {"forwards": (1.0, 2.0, 0.5), "back": (3.0, -1.0, 0.5), "at rest": (-2.0, 0.0, 0.5)}
    check = Check(moved, "x", cases)
    assert fewer_than_three(check) == {"dt": 1}
    assert check.passes(lambda x, v, dt: x + v * 0.5)
    check = Check(moved, "x", cases | {"slow": (0.0, 1.0, 0.1), "fast": (0.0, 1.0, 2.0)})
    assert fewer_than_three(check) == {}
    assert not check.passes(lambda x, v, dt: x + v * 0.5)
