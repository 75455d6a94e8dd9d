"""The API pages list every public module of the library, and no module that is gone."""

import importlib.util
import inspect
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = "\n".join(path.read_text() for path in sorted((ROOT / "book" / "api").glob("*.md")))
LISTED = set(re.findall(r"automodule:: (\S+)", PAGE))
CLASSES = set(re.findall(r"autoclass:: (\S+)", PAGE))


def public_modules():
    """Names without a leading underscore; checks have their chapter, kernels their plain twins."""
    for path in sorted((ROOT / "slamlab").rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        if path.stem[0] != "_" and path.parent.name not in ("exercises", "kernels"):
            yield name


def covered(name):
    """Whether the page has the module, or every class that it is for."""
    if name in LISTED:
        return True
    room = name.rpartition(".")[0]
    public = {f"{room}.{each}" for each in getattr(importlib.import_module(name), "__all__", ())}
    return bool(public) and public <= CLASSES


def test_every_public_module_is_on_the_api_page():
    assert [name for name in public_modules() if not covered(name)] == []
    assert not covered("slamlab.commands")


def test_every_module_on_the_api_page_exists():
    assert [name for name in LISTED if importlib.util.find_spec(name) is None] == []


# Records that a function returns, and protocols (their examples: book/bring_your_own.md).
ANSWERS = {
    "Ellipse", "Step", "FilterResult", "SmootherResult", "SteadyState", "Match",
    "PointsWithNormals", "Walls", "Certificate", "Closure", "Scans",
    "Location", "Loop", "ManhattanGraph", "Relations",
    "AssociationScores", "Run", "Trial", "Verdict", "WallScores", "Situation", "View",
}  # fmt: skip
PROTOCOLS = {
    "Estimator", "LandmarkSensor", "MotionModel", "Pilot", "ScanSensor", "Smoother", "Strategy",
    "Odometer", "Surface", "PoseParticles",
}  # fmt: skip
# They need a file of an extra, change the style of all figures, or are parts of what has one.
PARTS = {
    "read_rosbag", "use_style", "rollback", "SearchLimitWarning", "JointSearch",
    "joint_search", "unchecked_log_density",
}  # fmt: skip
ROOMS = (
    "geometry gaussian logs grids worlds robots sensors filters.kalman filters.extended "
    "filters.unscented filters.particle filters.histogram filters.pages matching mapping slam "
    "localization navigation simulation datasets evaluation plots widgets"
).split()
# Modules with names that are imported from them, not from their subpackage.
MODULES = (
    "datasets.killian datasets.relations datasets.rosbag datasets.synthetic datasets.tum "
    "datasets.victoria_park evaluation.association_scores evaluation.run evaluation.trajectory "
    "evaluation.wall_maps localization.global_localization localization.signature "
    "mapping.variance mapping.walls matching.match navigation.spline navigation.strategies "
    "robots.encoders simulation.record slam.association slam.certificate slam.g2o "
    "slam.pose_graph slam.scan_graph"
).split()


EXCUSED = ANSWERS | PROTOCOLS | PARTS


def is_shown(thing):
    """Whether the page has an entry for it."""
    return inspect.isroutine(thing) or inspect.isclass(thing)


def shows_itself(thing):
    """Whether a docstring ends with an example, which doctest runs."""
    return ">>>" in (inspect.getdoc(thing) or "")


@pytest.mark.parametrize("room", ROOMS + MODULES)
def test_every_public_class_and_function_has_an_example(room):
    module = importlib.import_module(f"slamlab.{room}")
    public = {name: getattr(module, name) for name in module.__all__}
    shown = {name: thing for name, thing in public.items() if is_shown(thing)}
    assert {name for name, thing in shown.items() if not shows_itself(thing)} - EXCUSED == set()


def test_a_function_without_an_example_is_found():
    assert is_shown(covered)
    assert not shows_itself(covered)
