"""The scripts of the figures: they parse, use what they define, and have the plots' colours."""

import re
import shutil
import subprocess

import pytest

from slamlab.plots import COLOURS
from slamlab.widgets._pack import script

FIGURES = ["replay.js", "sweep.js", "simulator.js", "sighting.js", "scan_drag.js"]
DRAGGED = FIGURES[-2:]
SHARED = script("shared.js")


def palette(name):
    """A table of colours in shared.js."""
    body = re.search(rf"const {name} = \{{(.*?)\}};", SHARED, re.DOTALL)[1]
    return dict(re.findall(r'(\w+): "(#\w{6})"', body))


def defined(text):
    return set(re.findall(r"(?m)^(?:function|class|const) (\w+)", text))


def unused(text, others=""):
    return {name for name in defined(text) if len(re.findall(rf"\b{name}\b", text + others)) < 2}


def test_figures_have_the_colours_of_the_plots():
    assert COLOURS.items() <= palette("LIGHT").items()
    assert palette("DARK").keys() == palette("LIGHT").keys()


def test_everything_that_is_defined_is_used():
    assert unused(SHARED, script("drag.js", *FIGURES)) == set()
    assert unused(script("drag.js"), script(*DRAGGED)) == set()
    for name in FIGURES:
        assert unused(script(name)) == set(), name
    assert unused("function nobody() {}\n") == {"nobody"}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_defines_nothing_that_is_shared(name):
    front = script("shared.js", "drag.js") if name in DRAGGED else SHARED
    assert defined(script(name)) & defined(front) == set()


@pytest.mark.parametrize("name", FIGURES)
def test_no_loose_ends(name):
    text = SHARED + script(name)
    assert not re.findall(r"\bvar |console\.log|debugger|[^=!<>]==[^=]", text)
    assert max(map(len, text.splitlines())) <= 200


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.parametrize("name", FIGURES)
def test_a_script_parses_as_a_module(name, tmp_path):
    module = tmp_path / "figure.mjs"
    front = ["shared.js", "drag.js"] if name in DRAGGED else ["shared.js"]
    module.write_text(script(*front, name))
    subprocess.run(["node", "--check", module], check=True, capture_output=True)
    module.write_text("const a = ;")
    assert subprocess.run(["node", "--check", module], capture_output=True).returncode
