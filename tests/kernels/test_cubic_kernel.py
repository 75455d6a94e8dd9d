"""The compiled fit of a cubic is the plain one, on the path of chapter 17.

Its factor, and the seconds that it saves there: "Kernels and their plain twins" in
book/performance_tables.md.
"""

import numpy as np
import pytest

from slamlab.kernels import TWINS
from slamlab.navigation import VARIANTS, PathMemory
from slamlab.navigation import path_memory as memory_file
from slamlab.navigation.cubic import fit

pytestmark = pytest.mark.needs_numba(reason="there is only the plain twin")


def fits_of(path, variant, tolerance, monkeypatch):
    """What `add` gives to `fit` along a path."""
    calls = []

    def noted(*args):
        calls.append([np.array(a) if isinstance(a, np.ndarray) else a for a in args])
        return fit(*args)

    with monkeypatch.context() as patch:
        patch.setattr(memory_file, "fit", noted)
        PathMemory.from_points(path, tolerance, variant)
    return calls


def eight(n=300):
    """An eight of noisy points."""
    t = np.linspace(0.0, 6.3, n)
    points = np.stack([2 * np.cos(t), np.sin(2 * t)], -1)
    return points + np.random.default_rng(17).normal(0.0, 0.002, points.shape)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_kernels_fit_as_the_plain_code(variant, monkeypatch):
    assert TWINS["cubic.fit"] is fit.plain
    calls = fits_of(eight(), variant, 0.02, monkeypatch)
    assert len(calls) > 250
    for args in calls:
        np.testing.assert_allclose(fit(*args), fit.plain(*args), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_shapes_that_few_points_cannot_tell_apart_are_left_out_by_both(variant, n):
    rng = np.random.default_rng(n)
    tau = np.append(0.0, np.sort(rng.uniform(0.1, 1.0, n)))
    tau[-1] = 1.0
    points = rng.normal(0.0, 1.0, (n + 1, 2))
    args = (tau, points, "two" in variant, "derivative" in variant, 0.3, -0.2)
    kernel, plain = fit(*args), fit.plain(*args)
    np.testing.assert_allclose(kernel, plain, rtol=1e-9, atol=1e-9)
    # The least solution over all shapes is another cubic where there are fewer points than shapes.
    if n == 1 and variant == "point":
        assert (plain[2:] == 0.0).all()
        A = np.ones((1, 3))
        assert np.abs(np.linalg.lstsq(A, points[1:] - points[0], rcond=None)[0][1:]).max() > 0.1


def test_without_numba_the_same_segments_are_stored(monkeypatch):
    compiled_one = PathMemory.from_points(eight(), 0.02)
    monkeypatch.setattr("slamlab.kernels.numba_serves", lambda: False)
    monkeypatch.setattr("slamlab.kernels._SAID", ["said"])
    plain_one = PathMemory.from_points(eight(), 0.02)
    np.testing.assert_allclose(plain_one.knots, compiled_one.knots, rtol=1e-9)
    assert len(plain_one.loops) == len(compiled_one.loops)
