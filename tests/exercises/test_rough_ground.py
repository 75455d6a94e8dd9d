"""What page 15b counts: intervals of lines whose answer is known, and worlds that are drawn."""

import numpy as np
import pytest

from slamlab.exercises.rough_ground import (
    BUMP,
    COARSE,
    FINE,
    PATCH,
    RIG,
    by_particles,
    cells_met,
    country,
    difference,
    drawn,
    held,
    interval,
    off,
    smooth,
)
from slamlab.geometry import transform
from slamlab.mapping.variance import log_density

PICTURE = 71


def normal(middle, sigma=0.01):
    return -0.5 * ((FINE - middle) / sigma) ** 2


def test_the_interval_of_a_normal_curve_is_two_standard_deviations_to_each_side():
    low, high = interval(normal(0.0)[None])
    assert (low, high) == (pytest.approx(-0.0196, abs=0.001), pytest.approx(0.0196, abs=0.001))


def test_intervals_that_leave_out_the_truth_are_not_counted():
    assert held(np.array([normal(0.0), normal(0.015), normal(0.025), normal(-0.025)])) == 2


def test_a_thousand_places_hold_what_the_curve_holds_and_few_under_a_narrow_peak_do_not():
    wide, narrow = np.tile(normal(0.0), (50, 1)), np.tile(normal(0.0, 0.0002), (50, 1))
    assert by_particles(wide, 1000, 1) == 50
    assert by_particles(narrow, 60, 1) < 25


def test_smoothing_leaves_a_straight_line_away_from_the_ends():
    line = np.arange(201.0)[None]
    assert np.allclose(smooth(line)[:, 20:-20], line[:, 20:-20])


def test_the_error_of_the_best_place_has_no_sign():
    lines = -np.abs(COARSE - np.array([[0.06], [-0.12]]))
    assert off(lines) == pytest.approx(0.09)


@pytest.fixture(scope="module")
def log():
    return country(1)


def heights_and_patches(log, camera, pictures):
    """Heights of some pictures, and the patch and the bump of each."""
    z, at = [], []
    for k in pictures:
        points = RIG.points(log.ranges[k])
        met = np.isfinite(points[:, 0])
        z.append(camera.heights(log.ranges[k])[met])
        at.append(transform(log.truth[k], points[met]))
    at = np.concatenate(at)
    return np.concatenate(z), (at // PATCH).astype(int), (at // BUMP).astype(int)


def test_drawn_heights_scatter_by_one_number_in_a_patch_and_bumps_share_one_height(log):
    for shared in (False, True):
        z, patch, bump = heights_and_patches(log, drawn(log, 1, shared=shared), range(60, 64))
        number = bump @ [1, 1000]
        same = [np.ptp(z[number == n]) for n in np.unique(number)[:200]]
        assert bool(np.max(same) < 1e-12) is shared
        scatters = [z[(patch == p).all(1)].std() for p in np.unique(patch, axis=0)]
        assert max(scatters) > 3 * min(scatters)


def test_a_lean_adds_a_plane_to_drawn_heights(log):
    k, (up, pitch, roll) = PICTURE, log.notes["sway"][PICTURE]
    added = drawn(log, 1, lean=True).heights(log.ranges[k]) - drawn(log, 1).heights(log.ranges[k])
    points = RIG.points(log.ranges[k])
    plane = up - pitch * points[:, 0] + roll * points[:, 1]
    met = np.isfinite(plane)
    assert np.allclose(added[met], plane[met])


def test_the_difference_of_the_densities_is_that_of_the_formulas_in_any_map(log):
    camera, here = drawn(log, 1), len(FINE) // 2
    z, _, _ = heights_and_patches(log, camera, [PICTURE])
    points = RIG.points(log.ranges[PICTURE])
    at = transform(log.truth[PICTURE], points[np.isfinite(points[:, 0])])
    cell = (at // 0.25).astype(int) @ [1, 100]
    total = 0.0
    for n in np.unique(cell):
        of = z[cell == n]
        if len(of) > 1:
            given = of.var(ddof=1), len(of) - 1, 2.5, 0.01
            total += float(log_density(*given, "variances") - log_density(*given, "heights"))
    assert difference(log, camera, PICTURE)[here] == pytest.approx(total)
    assert cells_met(log, PICTURE)[here] == len(np.unique(cell))
