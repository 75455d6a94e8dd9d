"""What is tried: three values of each argument, both signs, both ends of a turn; new arrays."""

import sys

import numpy as np
import pytest
from test_checks import CHECKS

import slamlab.geometry
from slamlab.exercises import Check

# Arguments that take fewer values, each with the number; the list may only become shorter.
FEWER = {
    ("ch01.check_update", "sees_door"): 2,  # a door or a wall: there is no third
}


# What has one sign by its nature, in every exercise: names of arguments and of results.
LENGTHS = """
dt r lever half half_length half_width side width metres distance range ranges max_range reach
nearest furthest step stride resolution cell threshold tolerance margin separation driven home
budget gate gates gains limits v scan scans before after size cost field_of_view spread x y
points stretch echo echoes expected sonar radius area times speed lookahead k_v k_omega damping
stored marks sizes near other
"""  # (x, y and points: on a grid, whose corner is the origin)
SHARES = """
belief beliefs prior goal hints reports p p_hit p_right p_slip p_stay p_step chance share
occupied cells bound weights u tau reserve frontier hit p_door p_wall shares eye nearest
furthest step stride resolution cell threshold tolerance margin separation driven away home
budget gate gates gains limits v scan scans before after size cost field_of_view x y points
inside spread height radius stay memory field
"""
VARIANCES = """
sigma variance variances cov covs q w weight R alpha beta chi2 bits misfits measurements
density wanted information alphas betas S
"""
COUNTS = """
edges closures doors sees_door steps indices n n_beams n_cells n_seen fewest pairs parents
chosen counts ended sent node nodes i index particles left right entries entry hits successes
runs state way turn best second back degrees beams per_cell lost regions alive rows k leaves
"""
ONE_SIGN = set((LENGTHS + SHARES + VARIANCES + COUNTS).split())
# Names that are signed in one exercise and not in another.
SIGNED = {
    ("ch04.check_localize", "beacons"), ("ch04.check_localize", "x"),
    ("ch04.check_best_place", "x"), ("ch04.check_resample", "x"),
    ("ch11.check_together", "R"), ("ch12.check_weight", "log weight"),
    ("ch13.check_line", "positions"),
}  # fmt: skip
ALWAYS_NEGATIVE = {"miss"}  # the evidence of a beam that went through


def numeric(value):
    """Shape and digits of an argument, entry by entry of a list; None where it has no numbers."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        if isinstance(value, list | tuple):
            parts = [numeric(entry) for entry in value]
            return None if None in parts else tuple(parts)
        return None
    return array.shape, array.tobytes()


def numbers(value):
    """All numbers in an argument or a result that are finite."""
    try:
        array = np.asarray(value, dtype=float).ravel()
    except (TypeError, ValueError):
        if not isinstance(value, list | tuple):
            return np.zeros(0)
        array = np.concatenate([np.zeros(0), *map(numbers, value)])
    return array[np.isfinite(array)]


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


def one_sided(check):
    """Names of arguments and results that never are negative, or never positive."""
    named = {
        name: np.concatenate([numbers(arguments[k]) for _, arguments in check.inputs])
        for k, name in enumerate(check._names(check.inputs[0][1]))
    }
    found = {name for name, x in named.items() if x.size and not (min(x) < 0 < max(x))}
    if not isinstance(check.due[0], str):
        several = len(check.returns) > 1
        for k, name in enumerate(check.returns):
            dues = [d for d in check.due if not isinstance(d, str)]
            x = np.concatenate([numbers(due[k] if several else due) for due in dues])
            if x.size and not (min(x) < 0 < max(x)):
                found.add(name)
    return found


@pytest.mark.parametrize("name", CHECKS)
def test_what_has_a_sign_comes_with_both(name):
    if len(CHECKS[name].inputs[0][1]) != len(CHECKS[name].parameters):
        return  # the answer is a set of numbers that is judged by a run
    found = {(name, one) for one in one_sided(CHECKS[name])}
    assert not found & SIGNED
    assert {one for _, one in found} <= ONE_SIGN | ALWAYS_NEGATIVE | OF_A_RUN.get(name, set())


# Results of a run that the check makes, and what the run is of.
OF_A_RUN = {
    "ch00.check_slam": {"omega_closure"},
    "ch13.check_line": {"s", "s_c", "a", "b"},
    "ch13.check_one_width": {"towns", "widths", "believed", "k"},
    "ch13.check_map": {"believed"},
    # On a map, whose corner is the origin; alpha, beta and a power are positive.
    "ch15.check_localize": {"track", "clouds", "maps", "march", "power"},
}


def test_a_lost_sign_passes_where_all_are_positive():
    """The guard can fail: an absolute value is not noticed where nothing is negative."""

    def doubled(z: float) -> float:
        return 2.0 * z

    cases = {"one": (1.0,), "two": (2.0,), "three": (3.0,)}
    check = Check(doubled, "double", cases)
    assert one_sided(check) == {"z", "double"}
    assert check.passes(lambda z: 2.0 * abs(z))
    check = Check(doubled, "double", cases | {"back": (-1.0,)})
    assert one_sided(check) == set()
    assert not check.passes(lambda z: 2.0 * abs(z))


@pytest.mark.parametrize("name", CHECKS)
def test_a_number_in_place_of_an_argument_is_refused(name):
    """Whichever of its own values is written into the function: dt = 0.5, a gate of 9.21."""
    check = CHECKS[name]
    if check._use is not None or len(check.inputs[0][1]) != len(check.parameters):
        return
    for k, (first, argument) in enumerate(zip(check.inputs[0][1], check.parameters, strict=True)):
        if not isinstance(first, int | float):
            continue
        for value in {arguments[k] for _, arguments in check.inputs}:

            def fixed(*given, k=k, value=value):
                return check.reference(*given[:k], value, *given[k + 1 :])

            assert not check.passes(fixed), (argument.name, value)


@pytest.mark.parametrize("name", CHECKS)
def test_an_array_in_place_of_an_argument_is_refused(name):
    """Written into the function, one for each shape: beams all round, a covariance."""
    check = CHECKS[name]
    if check._use is not None:
        return
    for k, first in enumerate(check.inputs[0][1]):
        if not isinstance(first, np.ndarray):
            continue
        known = {}

        def fixed(*given, k=k, known=known):
            kept = known.setdefault(given[k].shape, given[k].copy())
            return check.reference(*given[:k], kept.copy(), *given[k + 1 :])

        assert not check.passes(fixed), check._names(check.inputs[0][1])[k]


def symmetric(value):
    return (
        isinstance(value, np.ndarray)
        and value.ndim == 2
        and value.shape[0] == value.shape[1] > 1
        and np.allclose(value, value.T)
    )


@pytest.mark.parametrize("name", CHECKS)
def test_a_covariance_without_its_correlations_is_refused(name):
    check = CHECKS[name]
    if len(check.inputs[0][1]) != len(check.parameters):
        return
    for k, argument in enumerate(check.parameters):
        if argument.name in {"state", "omega"}:  # cells of a map; a stack of them
            continue
        if all(symmetric(arguments[k]) for _, arguments in check.inputs):

            def diagonal(*given, k=k):
                return check.reference(*given[:k], np.diag(np.diag(given[k])), *given[k + 1 :])

            assert not check.passes(diagonal), argument.name


@pytest.mark.parametrize("name", CHECKS)
def test_one_array_for_all_calls_is_refused(name):
    """A result that is written into the same memory in every call of a shape."""
    check, kept = CHECKS[name], {}

    def into_one(*given):
        came = check.reference(*given)
        parts = list(came) if isinstance(came, tuple) else [came]
        for k, part in enumerate(parts):
            if isinstance(part, np.ndarray) and part.size:
                place = kept.setdefault((k, part.shape, part.dtype), np.empty_like(part))
                place[...], parts[k] = part, place
        return tuple(parts) if isinstance(came, tuple) else parts[0]

    if check._use is None:
        assert not check.passes(into_one) or not kept  # (numbers have no memory)


# Angles: every place where a reference wraps sees them beyond both ends.


def places_of_wraps(check, monkeypatch):
    """Lines of references that wrap, and the smallest and largest angle that came there."""
    seen, wrap, inputs = {}, slamlab.geometry.wrap_angle, check.inputs

    def spy(angle):
        frame = sys._getframe(1)
        while frame and "/exercises/ch" not in frame.f_code.co_filename.replace("\\", "/"):
            frame = frame.f_back
        x = numbers(angle)
        if frame and x.size:
            low, high = seen.get((frame.f_code.co_name, frame.f_lineno), (np.inf, -np.inf))
            place = frame.f_code.co_name, frame.f_lineno
            seen[place] = min(low, x.min()), max(high, x.max())
        return wrap(angle)

    with monkeypatch.context() as patch:
        for module in list(sys.modules.values()):
            if getattr(module, "wrap_angle", None) is wrap:
                patch.setattr(module, "wrap_angle", spy)
        for _, arguments in inputs:
            check._look(check.reference, arguments)
    return seen


# Functions of other exercises that these call, tried at both ends there; poses whose headings are
# only turned by, with a sine and a cosine.
ELSEWHERE = {
    "ch00.check_slam": {"path_through", "edge_error", "relax"},
    "ch09.check_slam": {"update"},
    "ch10.check_slam": {"update"},
    "ch12.check_fast_slam": {"drive", "observe_landmark"},
    "ch13.check_reverse": {"reverse"},  # of a pose that is wrapped
    "ch16.check_fly": {"leave", "range_update"},
    "ch20.check_relaid": {"relaid"},
}


@pytest.mark.parametrize("name", CHECKS)
def test_angles_are_wrapped_at_both_ends(name, monkeypatch):
    check = CHECKS[name]
    if check._use is not None:
        return
    for (function, line), (low, high) in places_of_wraps(check, monkeypatch).items():
        if function not in ELSEWHERE.get(name, ()):
            assert low < -np.pi - 1e-9, (function, line)
            assert high > np.pi + 1e-9, (function, line)


def test_the_exercises_in_which_angles_are_wrapped_are_seen(monkeypatch):
    found = {name for name in CHECKS if CHECKS[name]._use is None}
    found = {name for name in found if places_of_wraps(CHECKS[name], monkeypatch)}
    assert len(found) >= 15
    assert {"ch03.check_innovation", "ch09.check_update", "ch17.check_steer"} <= found
