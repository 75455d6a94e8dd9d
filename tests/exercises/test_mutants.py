"""Every check refuses every mutant of its own solution, but for the ones that change no answer.

`python tools/mutate.py` prints the table.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("mutate", ROOT / "tools" / "mutate.py")
mutate = importlib.util.module_from_spec(SPEC)
sys.modules["mutate"] = mutate
SPEC.loader.exec_module(mutate)

SOLUTIONS = {solution.name: solution for solution in mutate.solutions()}
EQUIVALENT = mutate.equivalent()


@pytest.mark.parametrize("name", SOLUTIONS)
def test_every_mutant_that_changes_an_answer_is_refused(name):
    total, passed = mutate.try_all(SOLUTIONS[name], EQUIVALENT)
    assert total > 3
    assert passed == []


@pytest.mark.parametrize("name", SOLUTIONS)
def test_every_mutant_that_is_listed_is_one_and_changes_no_answer(name):
    """Else the list would hide a mutant, or keep one that a better input refuses."""
    solution = SOLUTIONS[name]
    listed = {key.partition(" | ")[2] for key in EQUIVALENT if key.partition(" | ")[0] == name}
    same = {
        text
        for text, wrong in mutate.mutants(solution)
        if text in listed and solution.check.passes(wrong)
    }
    assert same == listed


def test_equivalent_mutants_have_a_reason_and_exist():
    assert all(reason for reason in EQUIVALENT.values())
    assert {key.partition(" | ")[0] for key in EQUIVALENT} <= set(SOLUTIONS)


def test_a_check_that_tests_nothing_lets_mutants_pass():
    """The tool itself can fail: a check with one input cannot refuse all mutants."""
    solution = SOLUTIONS["02.update"]
    check = solution.check
    properties = {"one number": check.inputs[0][1]}
    weak = type(check)(check.reference, "mean, cov", properties, check.mistakes)
    weak_solution = type(solution)("02", weak, solution.before, solution.tree)
    assert len(mutate.try_all(weak_solution)[1]) > 20


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps a limit of memory")
def test_a_mutant_that_asks_for_more_memory_than_it_gets_is_refused():
    """Else one that tiles by the wrong shape takes the machine down with it."""
    check = SOLUTIONS["02.update"].check

    def hungry(*given):
        np.zeros(2 * mutate.MEMORY, dtype=np.uint8)
        return check.reference(*given)

    assert check.passes(hungry)
    assert mutate.refused(check, hungry)
    assert check.passes(hungry)  # the limit is gone again
