"""Every check of every chapter: its reference passes, each listed mistake is named rightly."""

import importlib
import pkgutil
import re

import numpy as np
import pytest

import slamlab.exercises
from slamlab.exercises import Check
from slamlab.exercises._general import general_mistakes

MODULES = [
    importlib.import_module(f"slamlab.exercises.{info.name}")
    for info in pkgutil.iter_modules(slamlab.exercises.__path__)
    if info.name.startswith("ch")
]
CHECKS = {
    f"{module.__name__.rpartition('.')[2][:4]}.{name}": getattr(module, name)
    for module in MODULES
    for name in module.__all__
    if isinstance(getattr(module, name), Check)
}


@pytest.mark.parametrize("name", CHECKS)
def test_the_reference_passes(name):
    assert CHECKS[name](CHECKS[name].reference).passed


@pytest.mark.parametrize("name", CHECKS)
def test_the_stub_gets_the_friendly_line_and_nothing_else(name):
    report = CHECKS[name](lambda *arguments: ...)
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


@pytest.mark.parametrize("name", CHECKS)
def test_each_listed_mistake_is_refused_with_its_own_message(name):
    check = CHECKS[name]
    says = isinstance(check.due[0], str)  # it tells what is wrong in a sentence of its own
    assert says or len(check.mistakes) >= 5
    for message, wrong in check.mistakes.items():
        report = check.judge(check.observe(check.mistaken(wrong)))
        assert not report.passed
        assert report.messages == (message,)


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__[-20:])
def test_no_reference_can_be_imported_by_name(module):
    if any(isinstance(getattr(module, name), Check) for name in module.__all__):
        assert all(name.startswith("check_") for name in module.__all__)


def test_messages_are_plain_english():
    """What is expected and what was returned; the uncertainty, and no other word for it."""
    words = re.compile(r"\b(due(?! to)|came|doubts?|rivals?|surer|dearest|told(?! apart))\b")
    said = [message for check in CHECKS.values() for message in check.mistakes]
    said += [message for message, *_ in general_mistakes(abs, ["x", "y"], ["p", "q"])]
    assert [message for message in said if words.search(message)] == []
    assert words.search("-2 came, 4 is due")


@pytest.mark.parametrize("name", CHECKS)
def test_the_reference_passes_in_a_variant_too(name):
    variant = CHECKS[name].of_variant(2027)
    assert variant.passes(variant.reference)


def test_an_answer_fitted_to_the_inputs_of_a_notebook_fails_in_a_variant():
    check = CHECKS["ch09.check_jacobian"]
    pairs = zip(check.inputs, check.due, strict=True)
    known = {str(arguments): due for (_, arguments), due in pairs}

    def fitted(*arguments):
        return np.array(known.get(str(arguments), np.zeros((2, 7))))

    assert check.passes(fitted)
    variant = check.of_variant(2027)
    assert not variant.passes(fitted)
    assert len(variant.inputs) > len(check.inputs)
    assert check.passes(fitted), "the check itself stays as it was"
    with pytest.raises(ValueError, match="year: "):
        check.of_variant(-1)
