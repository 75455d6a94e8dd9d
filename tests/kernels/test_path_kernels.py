"""Path memory: compiled searches and lengths are the plain ones, on the paths of chapter 17.

Their factors, and the seconds that they save there: "Kernels and their plain twins" in
book/performance_tables.md. The table of lengths and its inverse hold P3's Table 1, too: a search
to a millimetre within 0.05 ms.
"""

import numpy as np
import pytest

from slamlab.kernels import TWINS
from slamlab.kernels.cubic import arc_length as compiled_length
from slamlab.navigation import PathMemory, boxes, cubic, spline
from tests.kernels.test_cubic_kernel import eight

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")


def odometer_path(n=300):
    """Six legs with right angles and a loop, as an odometer of 8 mm and 5 mrad adds them up."""
    rng = np.random.default_rng(1)
    turn = (
        np.repeat([0.0, 0.0, -1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 0.0], n // 9) * np.pi / 2 / (n // 9)
    )
    heading = np.cumsum(turn + rng.normal(0, 0.005, len(turn)))
    step = 0.03 * np.stack([np.cos(heading), np.sin(heading)], 1)
    return np.cumsum(step + rng.normal(0, 0.004, step.shape), 0)


def calls_of(module, name, path, monkeypatch, variant="two-points"):
    """What a path memory gives to a function of its files while it stores a path."""
    calls, function = [], getattr(module, name)

    def noted(*args):
        calls.append([np.array(a) if isinstance(a, np.ndarray) else a for a in args])
        return function(*args)

    with monkeypatch.context() as patch:
        patch.setattr(module, name, noted)
        memory = PathMemory(0.05, variant)
        for point in path:
            memory.add(point)
            memory.meeting()
    return calls


@pytest.mark.parametrize("path", [eight, odometer_path])
def test_the_search_finds_the_same_places_with_the_same_boxes(path, monkeypatch):
    assert TWINS["boxes.search"] is boxes.search.plain
    calls = calls_of(spline, "search", path(), monkeypatch)
    assert len(calls) > 200
    met = 0
    for args in calls:
        one, other = boxes.search(*args), boxes.search.plain(*args)
        np.testing.assert_allclose(one[0], other[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(one[1], other[1], rtol=1e-7, atol=1e-9)
        assert one[2] == other[2]
        met += one[1][0] >= 0
    assert met > 5
    # A path elsewhere is not met.
    args[3] = args[3] + [[100.0, 0.0], [0, 0], [0, 0], [0, 0]]
    assert boxes.search.plain(*args)[0] == boxes.NOWHERE


def test_lengths_and_parameters_are_the_same(monkeypatch):
    for (c,) in calls_of(spline, "arc_length_table", eight(), monkeypatch)[::20]:
        table = spline.arc_length_table(c)
        np.testing.assert_allclose(table, cubic.arc_length_table.plain(c), rtol=1e-12)
        for s in table[-1] * np.array([-0.1, 0.0, 1e-6, 0.3, 0.77, 1.0, 1.1]):
            t = cubic.parameter_at(c, table, s)
            assert cubic.parameter_at.plain(c, table, s) == pytest.approx(t, abs=1e-12)
            length = cubic.arc_length(c, 0.0, t)
            assert compiled_length(c, 0.0, t) == pytest.approx(length, rel=1e-12)
        # The length of the chord is another one.
        assert table[-1] > np.hypot(*c[1:].sum(0)) * (1 + 1e-9)


def test_a_fold_has_the_length_of_its_trace_for_both():
    fold = np.array([[0, 0], [0.9, 0], [-0.9, 0], [0.2, 0.0]])
    t = np.linspace(0.0, 1.0, 200_001)[:, None]
    trace = np.hypot(*np.diff(cubic.point(fold, t), axis=0).T).sum()
    assert trace > 0.2 + 1e-3
    for length in (compiled_length, cubic.arc_length):
        assert length(fold, 0.0, 1.0) == pytest.approx(trace, abs=1e-9)


def test_lengths_near_a_cusp_are_the_same():
    """Ten nodes a piece do not do there: without halving a length is off by 4e-7 of it."""
    nearly = np.array([[0, 0], [0.9, 0.003], [-1.0, 0], [0.34, 0.0]])
    table = spline.arc_length_table(nearly)
    np.testing.assert_allclose(table, cubic.arc_length_table.plain(nearly), rtol=1e-12)


def test_points_and_nearest_points_are_the_same():
    memory = PathMemory.from_points(eight(), 0.02, loop_accuracy=None)
    path = memory._spline
    n, half = path.n, len(path.boxes) // 2
    assert n > 5
    arrays = path.coefficients[:n], path.tables[:n], path.starts[:n]
    s = np.linspace(0.0, path.length, 40)
    for derivative in (False, True):
        one = spline.points_at(*arrays, s, derivative)
        other = spline.points_at.plain(*arrays, s, derivative)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    rng = np.random.default_rng(0)
    places = rng.uniform(-2.5, 2.5, (60, 2))
    low, high = np.sort(rng.uniform(0.0, path.length, (2, 60)), 0)
    window = path.boxes[half : half + n], places, low, high
    one = spline.nearest(*arrays, *window)
    other = spline.nearest.plain(*arrays, *window)
    np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8)
    whole = spline.nearest(*arrays, *window[:2], np.zeros(60), np.full(60, path.length))
    assert (whole[1] < one[1] - 0.01).any()


def test_without_numba_the_same_loops_are_cut_out(monkeypatch):
    one = PathMemory.from_points(odometer_path(), 0.05)
    monkeypatch.setattr("slamlab.kernels.numba_serves", lambda: False)
    monkeypatch.setattr("slamlab.kernels._SAID", ["said"])
    other = PathMemory.from_points(odometer_path(), 0.05)
    assert len(one.loops) == len(other.loops) > 0
    np.testing.assert_allclose(other.knots, one.knots, rtol=1e-9, atol=1e-9)
    assert other.box_tests == one.box_tests
