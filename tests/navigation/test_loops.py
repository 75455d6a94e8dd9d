"""Loops: closed form and tree of boxes against brute force; ends, lengths, overlaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from slamlab.kernels import numba_serves
from slamlab.navigation.cubic import Cubic, bounding_box
from slamlab.navigation.path_memory import VARIANTS, PathMemory
from slamlab.navigation.spline import Spline
from tests.derivations.p3_search import search_as_printed

PER_SEGMENT = 24


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def chord_crossings(P, Q):
    """Pairs of chords of two polygons (n, 2) that cross."""
    p, d = P[:-1, None], np.diff(P, axis=0)[:, None]
    q, e = Q[None, :-1], np.diff(Q, axis=0)[None]
    with np.errstate(all="ignore"):
        det, r = cross(d, e), q - p
        u, v = cross(r, e) / det, cross(r, d) / det
        return np.argwhere((u >= 0) & (u <= 1) & (v >= 0) & (v <= 1))


def crossings_left(memory):
    """Brute force: all pairs of chords, each suspect looked at again 200 times finer."""
    curves = memory.segments
    if not curves:
        return []
    tau = np.linspace(0, 1, PER_SEGMENT + 1)
    polygon = np.concatenate([curve(tau[(k > 0) :]) for k, curve in enumerate(curves)])
    pairs = chord_crossings(polygon, polygon)

    def finer(k):
        piece = np.linspace(0, 1, 201) + k % PER_SEGMENT
        return curves[k // PER_SEGMENT](piece / PER_SEGMENT)

    return [
        (i, j)
        for i, j in pairs[pairs[:, 1] > pairs[:, 0] + 1]
        if len(chord_crossings(finer(i), finer(j)))
    ]


def both(points, tolerance=0.05, variant="two-points", accuracy=1e-4):
    """Memories of the same points without and with their loops."""
    memories = []
    for loop_accuracy in (accuracy, None):
        memory = PathMemory(tolerance, variant, loop_accuracy=loop_accuracy, max_step=5.0)
        for point in points:
            memory.add(point)
        memory.close()
        memories.append(memory)
    return memories


def wander(rng, n):
    heading = np.cumsum(rng.normal(0, rng.uniform(0.02, 0.5), n))
    return np.cumsum(0.07 * np.stack([np.cos(heading), np.sin(heading)], 1), 0)


def lattice(rng, n):
    """Exactly straight legs and right angles, often on top of earlier ones."""
    directions = np.array([[1, 0], [0, 1], [-1, 0], [0, -1.0]])[rng.integers(0, 4, n // 10)]
    return np.concatenate([[[0, 0]], np.cumsum(np.repeat(directions, 10, 0) * 0.05, 0)])


def noisy_lattice(rng, n):
    points = lattice(rng, n)
    return points + rng.normal(0, 0.003, points.shape)


def out_and_back(rng, n):
    points = wander(rng, n // 2)
    offset = rng.choice([0, 5e-5, 1e-4, 1.5e-4, 1e-3]) * rng.standard_normal(2)
    return np.concatenate([points, points[::-1] + offset])


def jitter(rng, n):
    return np.cumsum(rng.normal(0, rng.uniform(0.002, 0.05), (n, 2)), 0)


def lissajous(rng, n):
    t = np.linspace(0, rng.uniform(1, 5), n) * 2 * np.pi
    x, y = np.sin(t * rng.integers(1, 4)), np.sin(t * rng.integers(1, 5) + rng.uniform(0, 1))
    return rng.uniform(0.05, 1) * np.stack([x, y], 1)


KINDS = [wander, lattice, noisy_lattice, out_and_back, jitter, lissajous]


# On plain code twenty paths take 15 s.
@settings(derandomize=True, deadline=None, max_examples=200 if numba_serves() else 20)
@given(
    st.integers(0, 2**31),
    st.sampled_from(KINDS),
    st.sampled_from(VARIANTS),
    st.sampled_from([0.02, 0.05, 0.2]),
)
def test_random_paths_lose_their_loops_and_keep_their_ends(seed, kind, variant, tolerance):
    rng = np.random.default_rng(seed)
    points = kind(rng, int(rng.integers(30, 200)))
    clean, whole = both(points, tolerance, variant)
    assert crossings_left(clean) == []
    assert_allclose(clean.point_at(0.0), points[0], atol=1e-9)
    assert_allclose(clean.point_at(clean.length), whole.point_at(whole.length), atol=1e-9)
    cut = sum(loop.length for loop in clean.loops)
    assert clean.length == pytest.approx(whole.length - cut, abs=1e-9 * (1 + whole.length))
    pieces = np.array([curve.coefficients for curve in clean.segments]).reshape(-1, 4, 2)
    assert_allclose(pieces[:-1].sum(1), pieces[1:, 0], atol=1e-9)


def test_brute_force_sees_the_loops_that_are_left_in():
    _, whole = both(lissajous(np.random.default_rng(0), 200))
    assert crossings_left(whole)


# Inside one cubic.


def from_handles(rng, spread=0.5):
    """A random cubic whose handles cross, so that it often crosses itself, and steeply."""
    handles = np.array([[0, 0], [3, 2], [-2, 2], [1, 0.0]]) + rng.normal(0, spread, (4, 2))
    to_powers = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1.0]])
    return Cubic(to_powers @ handles)


def looping(rng):
    while True:
        curve = from_handles(rng)
        if curve.self_crossing():
            return curve


def test_closed_form_finds_the_same_place_twice():
    rng = np.random.default_rng(1)
    for _ in range(50):
        curve = looping(rng)
        first, second = curve.self_crossing()
        assert 0 <= first < second <= 1
        assert_allclose(curve(first), curve(second), atol=1e-9)


def test_closed_form_agrees_with_brute_force_on_random_cubics():
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(300):
        curve = from_handles(rng, spread=1.5)
        polygon = curve(np.linspace(0, 1, 150))
        pairs = chord_crossings(polygon, polygon)
        seen = bool((pairs[:, 1] > pairs[:, 0] + 1).any())
        assert seen == (curve.self_crossing() is not None)
        found += seen
    assert 50 < found < 250


def test_wrong_closed_forms_do_not_meet():
    """sigma = t_a + t_b, w = sigma^2 - t_a t_b; the discriminant is 4 w - 3 sigma^2."""
    curve = looping(np.random.default_rng(3))
    (a1, b1), (a2, b2), (a3, b3) = curve.coefficients[1:]
    sigma, w = np.linalg.solve([[a2, a3], [b2, b3]], [-a1, -b1])
    right = np.sqrt(4 * w - 3 * sigma**2)
    assert_allclose((sigma + right) / 2, curve.self_crossing()[1], atol=1e-9)
    for wrong in (np.sqrt(abs(sigma**2 - 4 * w)), np.sqrt(abs(w - sigma**2)), 2 * right):
        places = curve((sigma + np.array([-1, 1]) * wrong) / 2)
        assert np.abs(places[0] - places[1]).max() > 1e-3


def test_closed_form_and_tree_agree():
    rng = np.random.default_rng(4)
    for _ in range(30):
        curve = looping(rng)
        first, second = curve.self_crossing()
        middle = 0.5 * (first + second)
        halves = [
            np.stack([curve(a), *_derivatives(curve, a, b)]) for a, b in ((0, middle), (middle, 1))
        ]
        spline = Spline()
        spline.append(halves[0])
        found = spline.meeting(halves[1], 1e-4)
        assert found is not None
        t, _, tau = found
        assert_allclose(middle + t * (1 - middle), second, atol=1e-9)
        assert_allclose(tau * middle, first, atol=1e-9)


def _derivatives(curve, a, b):
    """Coefficients 1 to 3 of the piece from a to b."""
    c, h = curve.coefficients, b - a
    return (
        h * (c[1] + 2 * a * c[2] + 3 * a * a * c[3]),
        h * h * (c[2] + 3 * a * c[3]),
        h**3 * c[3],
    )


# Known cases.


def line(*corners, step=0.05):
    pieces = [np.asarray(corners[:1], dtype=float)]
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        n = max(int(np.ceil(np.hypot(b[0] - a[0], b[1] - a[1]) / step)), 1)
        pieces.append(np.linspace(a, b, n + 1)[1:])
    return np.concatenate(pieces)


def test_a_square_that_crosses_its_first_side_loses_the_loop():
    clean, whole = both(line((0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, -0.5)), tolerance=0.01)
    assert len(clean.loops) == 1
    assert_allclose(clean.loops[0].place, [0.5, 0], atol=0.01)
    assert clean.length == pytest.approx(1.0, abs=0.02)
    assert whole.length == pytest.approx(4.0, abs=0.02)


@pytest.mark.parametrize("accuracy", [1e-4, 1e-3])
def test_the_accuracy_of_a_crossing_is_far_better_than_asked(accuracy):
    clean, _ = both(line((0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, -0.5)), 0.01, accuracy=accuracy)
    s, distance = clean.nearest(clean.loops[0].place)
    assert distance < 1e-12
    assert 0 < s < clean.length


def test_out_and_back_on_the_same_line_leaves_what_was_not_gone_twice():
    clean, _ = both(line((0, 0), (2, 0), (0.5, 0)))
    assert clean.length == pytest.approx(0.5, abs=2e-3)
    assert_allclose(clean.point_at(clean.length), [0.5, 0], atol=1e-9)


def test_back_to_the_very_start_leaves_nothing():
    clean, _ = both(line((0, 0), (2, 0), (0, 0)))
    assert clean.length < 1e-3
    assert_allclose(clean.point_at(clean.length), [0, 0], atol=1e-9)


def test_a_return_beside_the_way_out_is_kept_when_it_is_far_enough():
    wide, _ = both(line((0, 0), (2, 0), (2, 0.002), (0, 0.002)), accuracy=1e-4)
    close, _ = both(line((0, 0), (2, 0), (2, 0.00005), (0, 0.00005)), accuracy=1e-4)
    assert wide.length == pytest.approx(4, abs=0.05)
    assert close.length < 1e-2


@pytest.mark.parametrize("offset", [0.0, 5e-5, 9e-5, 1.1e-4, 1e-3])
def test_overlaps_do_not_blow_up(offset):
    n = 400
    t = np.linspace(0, 8, n)
    out = np.stack([t, 0.3 * np.sin(2 * t)], 1)
    clean, whole = both(np.concatenate([out, out[::-1] + [0, offset]]))
    assert clean.box_tests < 400 * whole.n_segments
    assert len(clean.loops) <= whole.n_segments


def test_a_cubic_that_folds_onto_itself_is_straightened():
    spline = Spline()
    # x runs 0 -> 0.3 -> 0.2 on one straight line: no crossing in closed form, yet an overlap.
    fold = np.array([[0, 0], [0.9, 0], [-0.9, 0], [0.2, 0.0]])
    assert Cubic(fold).self_crossing() is None
    assert Cubic(fold).length > 0.2 + 1e-3
    loops = spline.append_without_loops(fold, 1e-4)
    assert len(loops) == 1
    assert spline.length == pytest.approx(0.2, abs=1e-3)


def test_a_crossing_within_an_accuracy_of_the_joint_is_found_too():
    """Near the joint the coarse search must not look; a finer one does."""
    accuracy = 1e-4
    old = np.array([[0, 0], [0.01, 0], [0, 0], [0, 0.0]])
    # Leaves the joint upwards and backwards, and crosses the old piece 18 micrometres before it.
    new = np.array([[0.01, 0], [-2e-4, 1.2e-4], [0, -4.8e-4], [0, -1e-2]])
    spline = Spline()
    spline.append(old)
    assert spline.meeting(new, accuracy) is None
    (loop,) = spline.append_without_loops(new, accuracy)
    assert 0 < loop.length < accuracy
    assert loop.place[0] == pytest.approx(0.01 - 1.76e-5, abs=1e-7)
    first, last = (Cubic(c)(np.linspace(0, 1, 3000)) for c in spline.coefficients[: spline.n])
    assert len(chord_crossings(first[:-1], last[1:])) == 0
    assert len(chord_crossings(Cubic(old)(np.linspace(0, 1, 3000))[:-1],
                               Cubic(new)(np.linspace(0, 1, 3000))[1:])) > 0  # fmt: skip


# The boxes.


def test_cutting_makes_the_boxes_forget():
    rng = np.random.default_rng(5)
    spline = Spline()
    for k in range(40):
        c = np.zeros((4, 2))
        c[0], c[1] = [k, 0], [1, 0]
        spline.append(c)
    spline.cut(20, 0.5)
    assert spline.boxes[1].tolist() == [0, 0, 20.5, 0]
    for _ in range(30):
        c = rng.normal(size=(4, 2))
        spline.append(c)
        if rng.random() < 0.3:
            spline.cut(int(rng.integers(1, spline.n)), float(rng.random()))
        boxes = np.array([bounding_box(c) for c in spline.coefficients[: spline.n]])
        assert_allclose(spline.boxes[1], [*boxes[:, :2].min(0), *boxes[:, 2:].max(0)])


def box_tests(n, accuracy=1e-4):
    """Boxes that P3's search compares on a return just beside the way out, n accuracies long."""
    long = n * accuracy
    out = np.array([[0, 0], [long, 0], [0, 0.25 * long], [0, -0.1 * long]])
    back = np.stack(
        [out.sum(0), -(out[1] + 2 * out[2] + 3 * out[3]), out[2] + 3 * out[3], -out[3]]
    )
    back[0, 1] += 1.5 * accuracy
    spline = Spline()
    spline.append(out)
    return search_as_printed(back, spline, accuracy)[0]


def test_worst_case_of_the_papers_search_is_linear_not_logarithmic_squared():
    """P3: at worst O(log2(n M)^2). A return beside the way out needs more."""
    n = 2 ** np.arange(8, 14)
    counts = np.array([box_tests(k) for k in n])
    assert (counts[1:] / counts[:-1] > 1.8).all()
    law = np.log2(n) ** 2
    assert (law[1:] / law[:-1] < 1.3).all()


def test_a_plain_crossing_costs_the_search_a_logarithm():
    spline, counts = Spline(), []
    spline.append(np.array([[0, 0], [1, 1.0], [0, 0], [0, 0]]))
    heights = np.random.default_rng(6).uniform(0.2, 0.9, 100)
    for n in 2 ** np.arange(8, 14):
        tests = []
        for y in heights:
            across = np.array([[0, y], [1, -0.9 * y], [0, 0], [0, 0]])
            boxes, met = search_as_printed(across, spline, 1.0 / n)
            assert met > 0
            tests.append(boxes)
        counts.append(np.mean(tests))
    growth = np.diff(counts)
    assert growth.max() < 20
    assert growth[-1] < 1.5 * growth[0]


def test_meeting_tells_where_the_open_segment_crosses_and_changes_nothing():
    out = [(x, 0.0) for x in np.arange(0, 1.01, 0.05)]
    back = [(1.0, 0.3), (0.9, 0.5), (0.7, 0.5), (0.5, 0.3)]
    memory = PathMemory(0.02)
    for point in out + back:
        memory.add(point)
    memory.close()
    memory.add((0.5, 0.1))
    assert memory.meeting() is None
    before = memory.length
    memory.add((0.5, -0.1))
    s = memory.meeting()
    assert s == pytest.approx(0.5, abs=0.02)
    assert_allclose(memory.point_at(s), [0.5, 0.0], atol=0.02)
    assert memory.meeting() == s
    assert memory.length == pytest.approx(before + 0.2, abs=0.02)
    assert memory.loops == ()


def test_meeting_needs_an_accuracy():
    memory = PathMemory(0.02, loop_accuracy=None)
    memory.add((0, 0))
    with pytest.raises(ValueError, match="loop_accuracy"):
        memory.meeting()
    assert PathMemory(0.02).meeting() is None
