"""What is tried: every numeric argument takes three different values, results are new arrays."""

import numpy as np
import pytest
from test_checks import CHECKS

# Arguments that take fewer values so far, each with the number; the list may only become shorter.
FEWER = {
    ("ch00.check_slam", "omega_closure"): 1,
    ("ch01.check_update", "sees_door"): 2,  # a door or a wall: there is no third
    ("ch03.check_follow", "dt"): 1,
    ("ch04.check_localize", "sigma"): 2,
    ("ch05.check_odometry", "dt"): 1,
    ("ch05.check_odometry", "r"): 1,
    ("ch05.check_odometry", "lever"): 1,
    ("ch05.check_odometry", "sigma"): 2,
    ("ch05.check_wheels", "half_length"): 2,
    ("ch07.check_walls", "fewest"): 1,
    ("ch08.check_insert", "cell"): 2,
    ("ch08.check_insert", "hit"): 1,
    ("ch08.check_insert", "miss"): 1,
    ("ch09.check_slam", "dt"): 1,
    ("ch10.check_slam", "dt"): 2,
    ("ch11.check_best_first", "gate"): 1,
    ("ch11.check_together", "R"): 2,
    ("ch13.check_map", "sigma"): 2,
    ("ch13.check_widths", "town"): 2,  # a town takes seconds; both are tried
    ("ch14.check_icp", "argument 1"): 1,
    ("ch14.check_icp", "argument 2"): 1,
    ("ch16.check_next_range", "nearest"): 2,
    ("ch16.check_next_range", "furthest"): 2,
    ("ch17.check_steer", "limits"): 2,
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


def test_a_constant_that_is_typed_in_place_of_an_argument_is_seen():
    """The guard can fail: with one value of `dt` nothing tells it from its number."""
    check = CHECKS["ch09.check_slam"]
    assert "dt" in fewer_than_three(check)
    assert check.passes(lambda u, dt, V, z, ids, R: check.reference(u, 0.5, V, z, ids, R))
