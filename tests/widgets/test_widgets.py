"""Interactive figures, the Python side: what goes into the page, and what is refused."""

import base64
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from slamlab.evaluation import run
from slamlab.localization import DeadReckoning
from slamlab.logs import Log
from slamlab.robots import Unicycle
from slamlab.sensors import Lidar
from slamlab.widgets import (
    Bars,
    Curves,
    Image,
    Landmarks,
    LidarPoints,
    Occupancy,
    Particles,
    Paths,
    Replay,
    Scatter,
    Sweep,
    WallSegments,
    _pack,
)
from slamlab.widgets.layers import ARGUMENTS

STEPS = 12


def line(steps=STEPS):
    return np.stack([np.arange(steps), np.zeros(steps), np.zeros(steps)], axis=1) * 0.5


def big_replay():
    rng = np.random.default_rng(3)
    truth = rng.normal(size=(500, 3)).cumsum(axis=0)
    return Replay(
        Paths(truth, truth + 0.1, truth + 0.3, covs=np.tile(np.eye(3), (500, 1, 1))),
        Landmarks(
            rng.normal(size=(20, 2)),
            rng.normal(size=(500, 20, 2)),
            np.tile(np.eye(2), (500, 20, 1, 1)),
        ),
        Particles(truth[:, None] + rng.normal(size=(500, 100, 3))),
        times=np.arange(500) * 0.1,
        captions=[f"caption of step {k}" for k in range(500)],
    )


def in_page(widget):
    """What the static page holds of a widget: its whole state as JSON."""
    return json.dumps(widget.get_state(), default=str, allow_nan=False)


def numbers(packed):
    codes = np.frombuffer(base64.b64decode(packed["data"]), dtype="<i2").astype(float)
    columns = codes.reshape(-1, len(packed["scale"]))
    values = np.where(columns == -32768, np.nan, packed["middle"] + columns * packed["scale"])
    return values.reshape(packed["shape"])


def test_a_long_replay_stays_under_one_megabyte_in_the_page():
    assert len(in_page(big_replay())) < 1_000_000


def test_raw_numbers_would_not():
    assert len(json.dumps(np.random.default_rng(3).normal(size=(500, 100, 3)).tolist())) > 1e6


def test_packed_numbers_keep_positions_to_a_part_in_sixty_thousand():
    values = np.random.default_rng(1).uniform(-150, 150, (40, 7, 3))
    values[3, 2] = np.nan
    back = numbers(_pack.pack_numbers(values))
    np.testing.assert_allclose(back, values, atol=300 / 65534 * 0.51)
    assert np.isnan(back[3, 2]).all()


def test_packed_runs_give_the_image_back():
    image = np.zeros((40, 50))
    image[10:12, :] = 1.0
    image[20, 5] = 0.5
    packed = _pack.pack_image(image, 0.0, 1.0)
    pairs = np.frombuffer(base64.b64decode(packed["data"]), dtype=np.uint8).reshape(-1, 2)
    back = np.repeat(pairs[:, 1], pairs[:, 0]).reshape(packed["shape"])
    np.testing.assert_allclose(back / 252, image, atol=1 / 63)
    assert len(packed["data"]) < 200


def test_ellipse_covers_95_percent_and_not_less():
    cov = np.array([[0.5, 0.2], [0.2, 0.3]])
    long_axis, short_axis, angle = _pack.ellipses("covs", cov[None], (1,))[0]
    draws = np.random.default_rng(2).multivariate_normal([0, 0], cov, size=40000)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    inside = ((draws @ turn.T / [long_axis, short_axis]) ** 2).sum(axis=1) < 1
    swapped = ((draws @ turn.T / [short_axis, long_axis]) ** 2).sum(axis=1) < 1
    assert inside.mean() == pytest.approx(0.95, abs=0.005)
    assert swapped.mean() < 0.9


def test_interval_of_a_one_dimensional_world_is_1_96_sigma_not_2_45():
    axes = _pack.ellipses("covs", np.full((1, 1, 1), 4.0), (1,))[0]
    np.testing.assert_allclose(axes, [2 * 1.959964, 0, 0], atol=1e-5)
    plane = _pack.ellipses("covs", np.diag([4.0, 0.0])[None], (1,))[0]
    assert plane[0] == pytest.approx(2 * 2.447747)


@pytest.mark.parametrize("widget", [Replay, Sweep])
def test_script_is_one_text_that_names_no_address(widget):
    assert isinstance(widget._esm, str)
    assert "export default" in widget._esm
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(|\bfetch\b", widget._esm + widget._css)


def test_repr_is_the_same_for_the_same_figure_and_has_no_address():
    first, second = Replay(Paths(truth=line())), Replay(Paths(truth=line()))
    assert repr(first) == repr(second) == "Replay(12 steps of truth)"
    sweep = Sweep({"n": [1, 2]}, [Curves("c", [0, 1], {"a": [0, 1]}, "x", "y")])
    assert repr(sweep) == "Sweep(n: 2; 1 panels)"


def test_two_figures_share_nothing():
    first, second = (Replay(Paths(truth=line()), title=name) for name in ("one", "two"))
    first.step = 5
    first.payload["arrays"].clear()
    assert second.step == 0
    assert second.payload["arrays"]
    assert second.payload["title"] == "two"


@pytest.mark.parametrize(
    "dress", [np.ndarray.tolist, np.asfortranarray, lambda a: a.astype(">f8")]
)
def test_the_same_numbers_in_other_clothes_are_drawn_alike(dress):
    cloud, unlike = np.random.default_rng(0).normal(size=(2, STEPS, 4, 2))
    layers = LidarPoints(dress(cloud)), Particles(dress(cloud)), Paths(dress(cloud[:, 0]))
    plain = Replay(LidarPoints(cloud), Particles(cloud), Paths(cloud[:, 0])).payload
    assert Replay(*layers).payload == plain
    assert Replay(*layers, Particles(dress(unlike))).payload != plain


def test_start_counts_from_the_end_when_negative():
    assert Replay(Paths(truth=line()), start=-1).step == STEPS - 1


def test_step_outside_the_run_is_refused():
    with pytest.raises(ValueError, match="step"):
        Replay(Paths(truth=line())).step = STEPS


def test_one_dimensional_world_lies_at_y_zero():
    replay = Replay(Paths(np.arange(5.0)), Particles(np.zeros((5, 8))), Landmarks([1.0, 2.0]))
    assert replay.payload["arrays"]["truth"]["shape"] == [5, 2]
    assert (numbers(replay.payload["arrays"]["truth"])[:, 1] == 0).all()
    assert replay.payload["arrays"]["particles"]["shape"] == [5, 8, 2]


def test_bounds_hold_all_that_is_drawn():
    low_x, high_x, low_y, high_y = Replay(Paths(truth=line()), Landmarks([[30, -4]])).payload[
        "bounds"
    ]
    assert low_x < 0
    assert high_x > 30
    assert low_y < -4
    assert high_y > 0


COVS = np.tile(np.eye(2), (STEPS, 1, 1))
TRUTH = Paths(truth=line())
PLACE = (0, 1, 0, 1)
REFUSED_LAYERS = {
    "NaN pose": (lambda: Paths(truth=line() * np.nan), "Paths.truth"),
    "four columns": (lambda: Paths(wrong=np.zeros((STEPS, 4))), "Paths.wrong"),
    "text": (lambda: Paths(truth=["a"] * STEPS), "Paths.truth"),
    "scalar": (lambda: Paths(truth=3.0), "Paths.truth"),
    "lengths differ": (lambda: Paths(line(), line(11)), r"Paths.estimate: expected shape \(12, "),
    "ellipse of nobody": (lambda: Paths(truth=line(), covs=COVS), "Paths.estimate"),
    "indefinite": (lambda: Paths(estimate=line(), covs=-COVS), "Paths.covs"),
    "covs too short": (lambda: Paths(estimate=line(), covs=COVS[:5]), "Paths.covs"),
    "NaN landmark": (lambda: Landmarks([[0.0, np.nan]]), "Landmarks.true"),
    "covs of landmarks nobody saw": (
        lambda: Landmarks([[0, 0]], covs=np.zeros((STEPS, 2, 2, 2))),
        "Landmarks.estimates",
    ),
    "covs of too few landmarks": (
        lambda: Landmarks(None, np.zeros((STEPS, 3, 2)), np.zeros((STEPS, 2, 2, 2))),
        "Landmarks.covs",
    ),
    "one cloud": (lambda: Particles([1.0, 2.0]), "Particles.poses"),
    "NaN particle": (lambda: Particles(np.full((STEPS, 5, 3), np.nan)), "Particles.poses"),
    "infinite scan": (lambda: LidarPoints(np.full((STEPS, 3, 2), np.inf)), "LidarPoints.points"),
    "walls are points": (lambda: WallSegments(np.zeros((3, 2))), "WallSegments.segments"),
    "map beyond one": (lambda: Occupancy(np.full((3, 3), 2.0), PLACE), "Occupancy.probability"),
    "no cells": (lambda: Occupancy(np.zeros((0, 3)), PLACE), "Occupancy.probability"),
    "map without area": (lambda: Occupancy(np.zeros((3, 3)), (0, 0, 0, 1)), "Occupancy.extent"),
    "maps in disorder": (
        lambda: Occupancy(np.zeros((2, 3, 3)), PLACE, [5, 0]),
        "Occupancy.steps",
    ),
    "a map too many": (lambda: Occupancy(np.zeros((2, 3, 3)), PLACE, [5]), "Occupancy.steps"),
}
REFUSED_REPLAYS = {
    "an array": ((line(),), {}, r"run: expected a Run or a layer such as Paths\(estimate=poses\)"),
    "an array as well": ((TRUTH, line()), {}, "layers: expected a layer such as Paths"),
    "nothing moves": ((Landmarks([[0, 0]]),), {}, "layers: expected at least one that varies"),
    "lengths differ": (
        (TRUTH, Particles(np.zeros((11, 4, 3)))),
        {},
        "Particles.poses: expected 12 steps as in Paths.truth, got 11",
    ),
    "no steps": ((Paths(truth=np.zeros((0, 3))),), {}, "Paths.truth: expected at least one step"),
    "time runs back": ((TRUTH,), {"times": -np.arange(STEPS)}, "times"),
    "time too short": ((TRUTH,), {"times": np.arange(11)}, "times: expected 12 steps"),
    "captions too few": ((TRUTH,), {"captions": ["a"]}, "captions"),
    "caption is a number": ((TRUTH,), {"captions": [1] * STEPS}, "captions"),
    "map after the end": (
        (TRUTH, Occupancy(np.zeros((2, 3, 3)), PLACE, [0, STEPS])),
        {},
        "Occupancy.steps",
    ),
    "bounds turned over": ((TRUTH,), {"bounds": (1, 0, 0, 1)}, "bounds"),
    "start beyond": ((TRUTH,), {"start": STEPS}, "start"),
    "start is a half": ((TRUTH,), {"start": 0.5}, "start"),
    "no height": ((TRUTH,), {"height": 0}, "height"),
    "standing still": ((TRUTH,), {"fps": 0}, "fps"),
    "negative robot": ((TRUTH,), {"robot_radius": -1}, "robot_radius"),
    "title is a number": ((TRUTH,), {"title": 3}, "title"),
}


@pytest.mark.parametrize("case", REFUSED_LAYERS)
def test_layer_refuses_and_names_the_argument(case):
    make, name = REFUSED_LAYERS[case]
    with pytest.raises(ValueError, match=f"^{name}"):
        make()


@pytest.mark.parametrize("case", REFUSED_REPLAYS)
def test_replay_refuses_and_names_the_argument(case):
    layers, options, name = REFUSED_REPLAYS[case]
    with pytest.raises(ValueError, match=f"^{name}"):
        Replay(*layers, **options)


def test_every_argument_of_a_replay_is_accepted_at_once():
    unseen = np.full((STEPS, 1, 2), np.nan)
    replay = Replay(
        Paths(line(), line(), line(), line(), covs=COVS),
        Landmarks([[0, 0]], estimates=unseen, covs=np.full((STEPS, 1, 2, 2), np.nan)),
        Particles(np.zeros((STEPS, 4, 3))),
        LidarPoints(np.full((STEPS, 6, 2), np.nan), beams=True, accumulate=True),
        WallSegments([[[0, 0], [1, 1]]]),
        Occupancy(np.full((2, 3, 3), 0.5), extent=PLACE, steps=[0, 5]),
        times=np.arange(STEPS),
        captions=["x"] * STEPS,
        bounds=(-1, 7, -1, 1),
        title="t",
        question="q",
        height=300,
        robot_radius=0.1,
        fps=10,
        start=3,
    )
    assert json.dumps(replay.payload, allow_nan=False)
    assert replay.payload["maps"]["steps"] == [0, 5]
    assert replay.payload["beams"]
    assert replay.payload["accumulate"]
    assert set(replay.payload["arrays"]) == set(ARGUMENTS)


def a_run():
    """Dead reckoning along x with two landmarks and a lidar in the log."""
    log = Log(
        np.arange(STEPS),
        np.tile([0.5, 0.0], (STEPS, 1)),
        np.minimum(np.arange(STEPS), 1),
        np.eye(2) * 0.01,
        ranges=np.full((STEPS, 3), 2.0),
        scan=Lidar(3, 1.0, 10.0),
        truth=line(),
        landmarks=[[1.0, 1.0], [2.0, -1.0]],
    )
    return run(DeadReckoning(Unicycle(), [0, 0, 0]), log)


def test_a_run_shows_what_its_log_knows():
    replay = Replay(a_run())
    assert repr(replay) == f"Replay({STEPS} steps of ellipses, estimate, landmarks, scans, truth)"
    np.testing.assert_allclose(numbers(replay.payload["arrays"]["estimate"]), line(), atol=1e-4)
    assert replay.payload["times"] is not None


def test_a_run_shows_what_was_recorded():
    maps = [np.ones((min(k, 2), 2)) for k in range(STEPS)]
    covs = [np.tile(np.eye(2), (len(one), 1, 1)) for one in maps]
    clouds = [np.full((4, 3), float(k)) for k in range(STEPS)]
    kept = {"landmarks": maps, "landmark_covs": covs, "poses": clouds}
    arrays = Replay(replace(a_run(), recorded=kept)).payload["arrays"]
    seen = np.isfinite(numbers(arrays["landmark_estimates"])[..., 0])
    np.testing.assert_array_equal(seen.sum(axis=1), [len(one) for one in maps])
    np.testing.assert_array_equal(np.isfinite(numbers(arrays["landmark_ellipses"])[..., 0]), seen)
    np.testing.assert_allclose(numbers(arrays["particles"]), clouds, atol=1e-3)


def test_a_layer_takes_the_place_of_the_same_from_the_run_and_of_nothing_else():
    alone = Replay(a_run()).payload["arrays"]
    beside = Replay(a_run(), Paths(dead_reckoning=line() + 1)).payload["arrays"]
    assert beside == alone | {"dead_reckoning": beside["dead_reckoning"]}
    moved = Replay(a_run(), Paths(truth=line() + 1)).payload["arrays"]
    assert moved["truth"] == beside["dead_reckoning"] != alone["truth"]
    assert moved["ellipses"] == alone["ellipses"]


def test_another_estimate_does_not_keep_the_ellipses_of_the_run():
    assert "ellipses" not in Replay(a_run(), Paths(estimate=line())).payload["arrays"]
    both = Paths(estimate=line(), covs=COVS), Paths(truth=line())
    assert "ellipses" in Replay(*both).payload["arrays"]
    found = Landmarks(None, np.zeros((STEPS, 2, 2)), np.tile(np.eye(2), (STEPS, 2, 1, 1)))
    assert "landmark_ellipses" in Replay(found).payload["arrays"]
    again = Landmarks(estimates=np.ones((STEPS, 2, 2)))
    assert "landmark_ellipses" not in Replay(found, again).payload["arrays"]


X = np.linspace(0.0, 1.0, 5)


def panel(values):
    return Curves("Error", X, {"EKF": values}, "t (s)", "error (m)")


def test_sweep_takes_all_panels_on_a_grid_of_two_sliders():
    sweep = Sweep(
        {"noise (m)": [0.1, 0.2, 0.3], "n": [1, 2]},
        [
            panel(np.zeros((3, 2, 5))),
            Curves("Log", X + 1, {"a": np.ones((3, 2, 5))}, "x", "y", y_log=True, x_log=True),
            Scatter("Ends", {"a": np.zeros((3, 2, 7, 2))}, lines=True),
            Bars("Belief", X, {"b": np.zeros(5)}, "x", "p"),
            Image("Map", np.zeros((3, 2, 4, 4)), (0, 1, 0, 1)),
        ],
        numbers={"RMSE (m)": np.array([[1.0, 2.0], [3.0, np.nan], [5.0, 6.0]])},
        start=(0, -1),
    )
    assert sweep.indices == [0, 1]
    assert sweep.payload["numbers"][0]["values"] == [1.0, 2.0, 3.0, None, 5.0, 6.0]
    assert json.dumps(sweep.payload, allow_nan=False)


def test_sweep_starts_in_the_middle_and_follows_indices():
    sweep = Sweep({"a": np.arange(5)}, [panel(np.zeros((5, 5)))])
    assert sweep.indices == [2]
    with pytest.raises(ValueError, match="indices"):
        sweep.indices = [5]


def test_logarithmic_curves_travel_as_logarithms():
    curve = Curves("c", X, {"a": [0.0, 1.0, 10.0, 100.0, 1000.0]}, "x", "y", y_log=True)
    packed = Sweep({"s": [1]}, [curve]).payload["panels"][0]["series"]["a"]
    np.testing.assert_allclose(numbers(packed), [np.nan, 0, 1, 2, 3], atol=1e-3)


GOOD = {"a": [1, 2, 3]}
REFUSED_SWEEPS = {
    "no slider": (lambda: Sweep({}, [panel(X)]), "sliders"),
    "three sliders": (lambda: Sweep({"a": [1], "b": [1], "c": [1]}, [panel(X)]), "sliders"),
    "empty slider": (lambda: Sweep({"a": []}, [panel(X)]), r"sliders\['a'\]"),
    "no panel": (lambda: Sweep(GOOD, []), "panels"),
    "panel is an array": (lambda: Sweep(GOOD, [X]), "panels"),
    "off the grid": (lambda: Sweep(GOOD, [panel(np.zeros((2, 5)))]), "Error: EKF"),
    "series is no mapping": (lambda: Sweep(GOOD, [Curves("Error", X, X, "", "")]), "Error"),
    "start beyond": (lambda: Sweep(GOOD, [panel(X)], start=[3]), "start"),
    "numbers off the grid": (lambda: Sweep(GOOD, [panel(X)], {"n": [1, 2]}), r"numbers\['n'\]"),
    "unknown kind": (
        lambda: Sweep(GOOD, [Curves("Error", X, {"a": X}, "", "", kinds={"a": "pink"})]),
        "Error: kinds",
    ),
    "kind of nobody": (
        lambda: Sweep(GOOD, [Curves("Error", X, {"a": X}, "", "", kinds={"b": "truth"})]),
        "Error: kinds",
    ),
    "log of nothing positive": (
        lambda: Sweep(GOOD, [Curves("Error", X, {"a": -X}, "", "", y_log=True)]),
        "Error: a",
    ),
    "bars in disorder": (
        lambda: Sweep(GOOD, [Bars("Belief", -X, {"a": X}, "", "")]),
        "Belief: x",
    ),
    "scatter of rows": (lambda: Sweep(GOOD, [Scatter("Ends", {"a": X})]), "Ends: a"),
    "image with NaN": (
        lambda: Sweep(GOOD, [Image("Map", np.full((2, 2), np.nan), (0, 1, 0, 1))]),
        "Map: image",
    ),
    "image without range": (
        lambda: Sweep(GOOD, [Image("Map", np.zeros((2, 2)), (0, 1, 0, 1), 1, 1)]),
        "Map: low",
    ),
}


@pytest.mark.parametrize("case", REFUSED_SWEEPS)
def test_sweep_refuses_and_names_the_argument(case):
    make, name = REFUSED_SWEEPS[case]
    with pytest.raises(ValueError, match=f"^{name}"):
        make()


def test_a_figure_is_saved_as_one_page_that_asks_for_nothing(tmp_path):
    figure = Replay(Paths(estimate=np.zeros((3, 3))), title="a </script> & b")
    path = figure.save(tmp_path / "drive.html")
    page = path.read_text(encoding="utf-8")
    assert path == tmp_path / "drive.html"
    assert "<title>a &lt;/script&gt; &amp; b</title>" in page
    assert page.count("</script>") == 1
    assert "http" not in page.replace("http://www.w3.org", "")


def test_importing_the_library_loads_no_widgets():
    code = "import sys, slamlab; print('anywidget' in sys.modules or 'ipywidgets' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
