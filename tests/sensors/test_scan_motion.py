"""Motion from two scans: the printed forms on their lattice, the mended ones off it too.

The room is a rectangle with two boxes, cast here by the cross product: no world of the library.
"""

import numpy as np
import pytest

from slamlab.geometry import compose, wrap_angle
from slamlab.logs import ScanGeometry
from slamlab.matching import match_icp
from slamlab.printed.p5 import displacement_as_printed, turn_as_printed
from slamlab.sensors import turn_between

N_BEAMS = 120
LIDAR = ScanGeometry(np.arange(N_BEAMS) * 2 * np.pi / N_BEAMS)
BOXES = np.array([[0, 0, 4, 3.6], [0.8, 2.2, 1.6, 2.8], [2.3, 0.7, 2.8, 1.9]])


def segments():
    x0, y0, x1, y1 = BOXES.T
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]).transpose(2, 0, 1)
    return np.stack([corners, np.roll(corners, -1, 1)], 2).reshape(-1, 2, 2)


def scan(poses):
    """Ranges (..., 120) in the room."""
    poses = np.asarray(poses, dtype=float)
    angle = poses[..., 2, None] + LIDAR.beam_angles
    d = np.stack([np.cos(angle), np.sin(angle)], -1)[..., None, :]
    start, end = segments().transpose(1, 0, 2)
    edge, w = end - start, start - poses[..., None, None, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = d[..., 0] * edge[:, 1] - d[..., 1] * edge[:, 0]
        t = (w[..., 0] * edge[:, 1] - w[..., 1] * edge[:, 0]) / cross
        s = (w[..., 0] * d[..., 1] - w[..., 1] * d[..., 0]) / cross
    return np.where((t > 0) & (s >= 0) & (s <= 1), t, np.inf).min(-1)


def places(n, seed, margin=0.25):
    rng = np.random.default_rng(seed)
    spots = rng.uniform([margin, margin], [4 - margin, 3.6 - margin], (8 * n, 2))
    x0, y0, x1, y1 = BOXES[1:].T
    x, y = spots[:, :1], spots[:, 1:]
    inside = (x > x0 - margin) & (x < x1 + margin) & (y > y0 - margin) & (y < y1 + margin)
    spots = spots[~inside.any(1)][:n]
    return np.column_stack([spots, rng.uniform(-np.pi, np.pi, len(spots))])


POSES = places(300, seed=1)
SCANS = scan(POSES)


def turned(degrees):
    return scan(POSES + [0, 0, np.deg2rad(degrees)])


def off_by(angles, degrees):
    return np.abs(np.rad2deg(wrap_angle(np.asarray(angles) - np.deg2rad(degrees))))


@pytest.mark.parametrize("degrees", [3, -27, 90, 177])
def test_on_the_lattice_both_find_the_turn(degrees):
    after = np.roll(SCANS, -degrees // 3, axis=1)
    np.testing.assert_allclose(turned(degrees), after, atol=1e-9)
    places_moved = turn_as_printed(SCANS, after)
    np.testing.assert_array_equal(places_moved, degrees // 3)
    assert off_by(turn_between(SCANS, after), degrees).max() < 1e-9


def test_the_printed_turn_is_an_index_and_not_an_angle():
    np.testing.assert_array_equal(turn_as_printed(SCANS, np.roll(SCANS, -10, axis=1)), 10)


def test_the_printed_half_turn_has_either_sign():
    moved = turn_as_printed(SCANS, np.roll(SCANS, 60, axis=1))
    assert set(moved.tolist()) == {-60, 60}
    assert turn_as_printed([9, 1, 2, 3], [2, 3, 9, 1]) == 2
    assert turn_as_printed([2, 3, 9, 1], [9, 1, 2, 3]) == -2


def test_the_printed_wrap_is_one_off_for_an_odd_number_of_beams():
    # A turn by two of five beams is less than half a turn, and comes back as three the other way.
    assert turn_as_printed([0, 0, 9, 0, 0], [9, 0, 0, 0, 0]) == -3


def test_off_the_lattice_the_printed_turn_fails_and_the_mended_one_holds():
    after = turned(25)
    printed = off_by(np.deg2rad(3 * turn_as_printed(SCANS, after)), 25)
    mended = off_by(turn_between(SCANS, after), 25)
    assert (printed > 3).mean() > 0.01
    assert printed.max() > 20
    assert mended.max() < 0.5
    whole_beams = off_by(np.deg2rad(24.0), 25)
    assert np.median(mended) < 0.2 * whole_beams, "the refinement below one beam is used"


def test_noise_and_missing_returns_do_little_harm():
    rng = np.random.default_rng(5)
    before, after = (s + rng.normal(0, 0.01, s.shape) for s in (SCANS, turned(-41.3)))
    before[rng.random(before.shape) < 0.05] = np.nan
    after[rng.random(after.shape) < 0.05] = np.inf
    assert np.quantile(off_by(turn_between(before, after), -41.3), 0.95) < 1.0


def test_missing_returns_taken_as_zero_would_do_harm():
    rng = np.random.default_rng(5)
    after = turned(-41.3)
    after[rng.random(after.shape) < 0.4] = np.nan
    mended = off_by(turn_between(SCANS, after), -41.3)
    zeros = off_by(turn_between(SCANS, np.nan_to_num(after)), -41.3)
    assert np.mean(mended > 3) < 0.5 * np.mean(zeros > 3)


def test_whatmove_fails_after_a_slip_and_match_icp_does_not():
    slips = np.full((len(POSES), 3), [0.2, 0.03, np.deg2rad(2)])
    after = scan(compose(POSES, slips))
    off = np.abs(displacement_as_printed(SCANS, after)[:, 1] - 0.2)
    assert off.max() > 0.5, "an edge came between"
    assert np.mean(off > 0.05) > 0.02
    points = zip(LIDAR.points(SCANS[:80]), LIDAR.points(after[:80]), strict=True)
    found = [match_icp(*both, guess=[0.2, 0, 0]).pose for both in points]
    errors = np.abs(np.array(found) - slips[:80])
    assert np.quantile(errors[:, :2], 0.95) < 0.002
    assert np.quantile(errors[:, 2], 0.95) < np.deg2rad(0.2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: turn_between([], []), "before: expected at least one beam"),
        (lambda: turn_between([1.0, 2.0], [1.0]), "after"),
        (lambda: turn_between([np.nan, np.inf], [1.0, 1.0]), "before.*return"),
        (lambda: turn_as_printed([1.0], [1.0, 2.0]), "after"),
        (lambda: displacement_as_printed([], []), "before"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
