"""Interactive figures, the Python side: what goes into the page, and what is refused."""

import base64
import json
import re
import subprocess
import sys

import numpy as np
import pytest

from slamlab.widgets import Bars, Curves, Image, Replay, Scatter, Sweep, _pack

STEPS = 12


def line(steps=STEPS):
    return np.stack([np.arange(steps), np.zeros(steps), np.zeros(steps)], axis=1) * 0.5


def big_replay():
    rng = np.random.default_rng(3)
    truth = rng.normal(size=(500, 3)).cumsum(axis=0)
    return Replay(
        times=np.arange(500) * 0.1,
        truth=truth,
        estimate=truth + 0.1,
        dead_reckoning=truth + 0.3,
        covs=np.tile(np.eye(3), (500, 1, 1)),
        landmarks=rng.normal(size=(20, 2)),
        landmark_estimates=rng.normal(size=(500, 20, 2)),
        landmark_covs=np.tile(np.eye(2), (500, 20, 1, 1)),
        particles=truth[:, None] + rng.normal(size=(500, 100, 3)),
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
    first, second = Replay(truth=line()), Replay(truth=line())
    assert repr(first) == repr(second) == "Replay(12 steps of truth)"
    sweep = Sweep({"n": [1, 2]}, [Curves("c", [0, 1], {"a": [0, 1]}, "x", "y")])
    assert repr(sweep) == "Sweep(n: 2; 1 panels)"


def test_two_figures_share_nothing():
    first, second = Replay(truth=line(), title="one"), Replay(truth=line(), title="two")
    first.step = 5
    first.payload["arrays"].clear()
    assert second.step == 0
    assert second.payload["arrays"]
    assert second.payload["title"] == "two"


def test_start_counts_from_the_end_when_negative():
    assert Replay(truth=line(), start=-1).step == STEPS - 1


def test_step_outside_the_run_is_refused():
    with pytest.raises(ValueError, match="step"):
        Replay(truth=line()).step = STEPS


def test_one_dimensional_world_lies_at_y_zero():
    replay = Replay(truth=np.arange(5.0), particles=np.zeros((5, 8)), landmarks=[1.0, 2.0])
    assert replay.payload["arrays"]["truth"]["shape"] == [5, 2]
    assert (numbers(replay.payload["arrays"]["truth"])[:, 1] == 0).all()
    assert replay.payload["arrays"]["particles"]["shape"] == [5, 8, 2]


def test_bounds_hold_all_that_is_drawn():
    low_x, high_x, low_y, high_y = Replay(truth=line(), landmarks=[[30, -4]]).payload["bounds"]
    assert low_x < 0
    assert high_x > 30
    assert low_y < -4
    assert high_y > 0


COVS = np.tile(np.eye(2), (STEPS, 1, 1))
REFUSED_REPLAYS = {
    "nothing given": ({}, "truth"),
    "lengths differ": ({"truth": line(), "estimate": line(11)}, "estimate: expected 12 steps"),
    "NaN pose": ({"truth": line() * np.nan}, "truth"),
    "infinite scan": ({"truth": line(), "scans": np.full((STEPS, 3, 2), np.inf)}, "scans"),
    "four columns": ({"truth": np.zeros((STEPS, 4))}, "truth"),
    "text": ({"truth": ["a"] * STEPS}, "truth"),
    "scalar": ({"truth": 3.0}, "truth"),
    "no steps": ({"truth": np.zeros((0, 3))}, "truth"),
    "time runs back": ({"truth": line(), "times": -np.arange(STEPS)}, "times"),
    "ellipse of nobody": ({"truth": line(), "covs": COVS}, "estimate"),
    "indefinite": ({"estimate": line(), "covs": -COVS}, "covs"),
    "covs too short": ({"estimate": line(), "covs": COVS[:5]}, "covs"),
    "covs of landmarks nobody saw": (
        {"truth": line(), "landmark_covs": np.zeros((STEPS, 2, 2, 2))},
        "landmark_estimates",
    ),
    "captions too few": ({"truth": line(), "captions": ["a"]}, "captions"),
    "caption is a number": ({"truth": line(), "captions": [1] * STEPS}, "captions"),
    "walls are points": ({"truth": line(), "walls": np.zeros((3, 2))}, "walls"),
    "map without place": ({"truth": line(), "occupancy": np.zeros((3, 3))}, "occupancy_extent"),
    "map beyond one": (
        {"truth": line(), "occupancy": np.full((3, 3), 2.0), "occupancy_extent": (0, 1, 0, 1)},
        "occupancy",
    ),
    "map after the end": (
        {
            "truth": line(),
            "occupancy": np.zeros((2, 3, 3)),
            "occupancy_extent": (0, 1, 0, 1),
            "occupancy_steps": [0, STEPS],
        },
        "occupancy_steps",
    ),
    "bounds turned over": ({"truth": line(), "bounds": (1, 0, 0, 1)}, "bounds"),
    "start beyond": ({"truth": line(), "start": STEPS}, "start"),
    "start is a half": ({"truth": line(), "start": 0.5}, "start"),
    "no height": ({"truth": line(), "height": 0}, "height"),
    "standing still": ({"truth": line(), "fps": 0}, "fps"),
    "negative robot": ({"truth": line(), "robot_radius": -1}, "robot_radius"),
    "title is a number": ({"truth": line(), "title": 3}, "title"),
}


@pytest.mark.parametrize("case", REFUSED_REPLAYS)
def test_replay_refuses_and_names_the_argument(case):
    arguments, name = REFUSED_REPLAYS[case]
    with pytest.raises(ValueError, match=f"^{name}"):
        Replay(**arguments)


def test_every_argument_of_a_replay_is_accepted_at_once():
    replay = Replay(
        times=np.arange(STEPS),
        truth=line(),
        estimate=line(),
        dead_reckoning=line(),
        wrong=line(),
        covs=COVS,
        landmarks=[[0, 0]],
        landmark_estimates=np.full((STEPS, 1, 2), np.nan),
        landmark_covs=np.full((STEPS, 1, 2, 2), np.nan),
        particles=np.zeros((STEPS, 4, 3)),
        scans=np.full((STEPS, 6, 2), np.nan),
        accumulate_scans=True,
        beams=True,
        walls=[[[0, 0], [1, 1]]],
        occupancy=np.full((2, 3, 3), 0.5),
        occupancy_extent=(0, 1, 0, 1),
        occupancy_steps=[0, 5],
        bounds=(-1, 7, -1, 1),
        captions=["x"] * STEPS,
        title="t",
        question="q",
        height=300,
        robot_radius=0.1,
        fps=10,
        start=3,
    )
    assert json.dumps(replay.payload, allow_nan=False)
    assert replay.payload["maps"]["steps"] == [0, 5]


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
    figure = Replay(estimate=np.zeros((3, 3)), title="a </script> & b")
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
