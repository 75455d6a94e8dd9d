"""The scripts of the figures: they parse, use what they define, and have the plots' colours."""

import re
import shutil
import subprocess

import pytest

from slamlab.plots import COLOURS
from slamlab.widgets._pack import script

# What a figure has in front of it, and what is its own.
FIGURES = {
    "replay": ([], ["replay.js"]),
    "sweep": ([], ["sweep.js"]),
    "simulator": ([], ["simulator_world.js", "simulator.js"]),
    "sighting": (["drag.js"], ["sighting.js"]),
    "scan_drag": (["drag.js"], ["scan_drag.js"]),
    "wall_drag": (["drag.js"], ["wall_drag.js"]),
}
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
    own = {name: script(*files) for name, (_, files) in FIGURES.items()}
    dragged = "".join(own[name] for name, (front, _) in FIGURES.items() if front)
    assert unused(SHARED, script("drag.js") + "".join(own.values())) == set()
    assert unused(script("drag.js"), dragged) == set()
    for name, text in own.items():
        assert unused(text) == set(), name
    assert unused("function nobody() {}\n") == {"nobody"}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_defines_nothing_that_is_shared(name):
    front, files = FIGURES[name]
    assert defined(script(*files)) & defined(script("shared.js", *front)) == set()


@pytest.mark.parametrize("name", FIGURES)
def test_no_loose_ends(name):
    text = SHARED + script(*FIGURES[name][1])
    assert not re.findall(r"\bvar |console\.log|debugger|[^=!<>]==[^=]", text)
    assert max(map(len, text.splitlines())) <= 200


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.parametrize("name", FIGURES)
def test_a_script_parses_as_a_module(name, tmp_path):
    module = tmp_path / "figure.mjs"
    front, files = FIGURES[name]
    module.write_text(script("shared.js", *front, *files))
    subprocess.run(["node", "--check", module], check=True, capture_output=True)
    module.write_text("const a = ;")
    assert subprocess.run(["node", "--check", module], capture_output=True).returncode
