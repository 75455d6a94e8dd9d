"""The teacher's guide's cell for otter-grader and nbgrader: it passes or raises, and says why."""

import re
from pathlib import Path

import pytest

GUIDE = Path(__file__).resolve().parents[2] / "book" / "teachers_guide.md"
SECTION = GUIDE.read_text().split("### otter-grader and nbgrader")[1].split("\n### ")[0]
(RECIPE,) = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)


def test_the_recipe_passes_a_right_answer():
    exec(RECIPE, {})


def test_the_recipe_raises_with_our_own_sentence_for_a_wrong_one():
    wrong = RECIPE.replace("carried.argmax()", "weights.argmax()")
    assert wrong != RECIPE
    with pytest.raises(AssertionError, match="best_place: . of"):
        exec(wrong, {})
