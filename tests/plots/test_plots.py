"""Figures: the encoding of the course, tables that show what they are given."""

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")
import matplotlib.pyplot as plt

from slamlab import plots


@pytest.fixture
def ax():
    plots.use_style()
    figure, ax = plt.subplots()
    yield ax
    plt.close(figure)


@pytest.mark.parametrize(
    ("kind", "colour", "style"),
    [
        ("truth", "#000000", "-"),
        ("dead_reckoning", "#D55E00", "--"),
        ("estimate", "#0072B2", "-"),
        ("wrong", "#CC79A7", "-."),
    ],
)
def test_a_path_has_its_colour_and_a_line_style_beside_it(ax, kind, colour, style):
    line = plots.path(ax, np.zeros((3, 3)), kind, label="robot")
    assert (line.get_color(), line.get_linestyle()) == (colour, style)


def test_an_unknown_kind_is_named(ax):
    with pytest.raises(ValueError, match="kind: expected one of 'truth'"):
        plots.path(ax, np.zeros((3, 3)), "guess")


def test_an_ellipse_stays_inside_the_view_and_takes_poses(ax):
    patch = plots.ellipse(ax, [10.0, 5.0, 0.3], np.diag([4.0, 1.0, 0.1]))
    ax.autoscale_view()
    assert ax.get_xlim()[0] < 10 - 4.8
    assert patch.get_facecolor()[3] == pytest.approx(0.2)


def test_every_helper_draws(ax):
    plots.landmarks(ax, [[0, 0], [1, 1]])
    plots.landmarks(ax, [[np.nan, 0], [1, 1]], estimated=True)
    plots.particles(ax, np.zeros((4, 3)))
    plots.lidar_points(ax, np.full((2, 3, 2), np.nan))
    plots.walls(ax, [[[0, 0], [1, 0]]])
    plots.error_band(ax, [0, 1], [0.1, 0.2], [0.2, 0.2], "x")
    image = plots.occupancy(ax, np.array([[0.0, 1.0], [0.5, 0.5]]), (0, 2, 0, 2))
    assert image.origin == "lower"
    assert ax.get_xlabel() == "x (m)"
    ax.figure.canvas.draw()


def test_a_table_shows_the_same_numbers_as_text_and_as_markdown():
    table = plots.Table(("what", "value"), [("pi", np.pi), ("fine", True)], caption="Numbers")
    assert "3.142" in repr(table)
    assert "| pi | 3.142 |" in table._repr_markdown_()
    assert "yes" in repr(table)
    with pytest.raises(ValueError, match="rows: expected 2 entries in row 0, got 1"):
        plots.Table(("a", "b"), [(1,)])


def verdicts(*rows):
    table = plots.claims([("a claim", "none given", *row) for row in rows])
    return [row[-1] for row in table.rows]


def test_a_verdict_follows_from_number_and_criterion():
    held = [(0.5, "<= 0.5 m"), (0, "== 0"), (3.0, "in [2.18, 3.97]"), (5, "outside [2, 4]")]
    held += [([1, 2], "> 0.5"), (True, "== 1"), (1e-12, "< 1e-9"), (-2, "!= 2"), (np.inf, "> 9")]
    assert verdicts(*held) == ["confirmed"] * len(held)
    failed = [(0.51, "<= 0.5 m"), (1, "== 0"), (4.0, "in [2, 3.97]"), (3, "outside [2, 4]")]
    failed += [([1, 0.2], "> 0.5"), (np.nan, "> 0.5"), (np.nan, "outside [1, 2]")]
    assert verdicts(*failed) == ["refuted"] * len(failed)
    assert verdicts((None, "no data"), (1, "== 1")) == ["unsupported", "confirmed"]


def test_no_verdict_can_be_typed():
    with pytest.raises(ValueError, match="criterion: expected such as .*got 'confirmed'"):
        plots.claims([("a", "b", 1.0, "confirmed")])
    with pytest.raises(ValueError, match="expected 4 entries in row 0, got 3"):
        plots.claims([("a", "b", 1.0)])


def test_a_claim_shows_no_digit_that_differs_between_machines():
    ours = [3.1e-13, [1.0, np.inf], 123456.7, [0.12345, 2], 7]
    table = plots.claims([("a claim", "none given", one, "> 0") for one in ours])
    assert [row[2] for row in table.rows] == [
        "below 1e-8",
        "diverged",
        "1.2e+05",
        "0.123 ... 2",
        "7",
    ]


def test_a_figure_of_few_points_is_a_drawing_and_others_are_pixels():
    from slamlab.plots import _style

    figure, ax = plt.subplots()
    plots.path(ax, np.zeros((50, 2)), "truth")
    text = _style._drawing(figure)
    assert text.lstrip().startswith("<?xml")
    assert "<svg" in text
    assert text == _style._drawing(figure)
    plots.particles(ax, np.random.default_rng(0).normal(size=(_style.MOST_POINTS + 1, 2)))
    assert _style._drawing(figure) is None
    figure, ax = plt.subplots()
    plots.occupancy(ax, [[0.5]], [0, 1, 0, 1])
    assert _style._drawing(figure) is None


def test_the_environment_says_how_a_notebook_draws(monkeypatch):
    from IPython.core.interactiveshell import InteractiveShell

    def kinds(figure, **environment):
        for name in ("SLAMLAB_VECTOR", "SLAMLAB_TEXT_ONLY"):
            monkeypatch.delenv(name, raising=False)
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        plots.use_style()
        return set(shell.display_formatter.format(figure)[0])

    shell = InteractiveShell.instance()
    shell.display_formatter.active_types = ["text/plain", "image/png", "image/svg+xml"]
    few, ax = plt.subplots()
    plots.path(ax, np.zeros((50, 2)), "truth")
    many, ax = plt.subplots()
    plots.occupancy(ax, [[0.5]], [0, 1, 0, 1])
    assert kinds(few) == {"text/plain", "image/png"}
    assert kinds(few, SLAMLAB_TEXT_ONLY="1") == {"text/plain"}
    assert kinds(few, SLAMLAB_VECTOR="1") == {"text/plain", "image/svg+xml"}
    assert kinds(many, SLAMLAB_VECTOR="1") == {"text/plain", "image/png"}
    InteractiveShell.clear_instance()
