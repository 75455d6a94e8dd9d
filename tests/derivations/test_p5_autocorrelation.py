"""P5's second (14), its program `acf`, and what section 3.2.6 says about them.

Items 30 and 31 of the list of properties: what an autocorrelation keeps, and what a turn does.
"""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from slamlab.geometry import between
from slamlab.localization import SignatureMap, autocorrelation, spectrum, three_numbers
from slamlab.navigation import Explorer, Quadrants
from slamlab.printed.p5 import acf_as_printed, turn_as_printed
from slamlab.robots import SquareRobot, Unicycle
from slamlab.sensors import Lidar, turn_between
from slamlab.simulation import PerfectEstimator, record
from slamlab.worlds import rooms

PIXELS = st.lists(st.integers(0, 566), min_size=2, max_size=60)  # 566: diagonal of 400 x 400


def by_definition(d):
    """R[tau] = sum_j d[j] d[(j - tau) mod N] in whole numbers of any size."""
    N = len(d)
    return [sum(d[j] * d[(j - tau) % N] for j in range(N)) for tau in range(N)]


def exact(d):
    """Autocorrelation by the library, brought back to whole numbers."""
    R = autocorrelation(d)
    np.testing.assert_allclose(R, np.rint(R), atol=1e-6)
    return np.rint(R).astype(int).tolist()


# Item 30: what holds for every scan.


@settings(derandomize=True, deadline=None)
@given(PIXELS)
def test_the_fft_gives_the_sum_of_products_exactly(d):
    assert exact(d) == by_definition(d)


@settings(derandomize=True, deadline=None)
@given(PIXELS)
def test_the_largest_value_stands_at_shift_zero_and_the_rest_is_symmetric(d):
    R = exact(d)
    assert R[0] == sum(x * x for x in d) == max(R)
    assert R[1:] == R[:0:-1]
    assert sum(R) == sum(d) ** 2


@settings(derandomize=True, deadline=None)
@given(PIXELS, st.integers(0, 100))
def test_a_turn_by_whole_beams_and_a_mirror_change_nothing(d, beams):
    assert exact(np.roll(d, beams)) == exact(d) == exact(d[::-1])


def linear(d):
    """Wrong: the integral (14) over a line, the scan zero outside, as `np.correlate` has it."""
    return np.correlate(d, d, "full")[len(d) - 1 :]


def convolution(d):
    """Wrong: f(tau - t) for f(t - tau)."""
    return np.rint(np.fft.irfft(np.fft.rfft(d) ** 2, len(d))).astype(int)


def ends_only(d):
    """Wrong: the index runs past the end and is clipped instead of wrapped."""
    N = len(d)
    return np.array([sum(d[j] * d[max(j - tau, 0)] for j in range(N)) for tau in range(N)])


@pytest.mark.parametrize("wrong", [linear, convolution, ends_only])
def test_p5_14_must_be_circular_and_a_correlation(wrong):
    # (14) as printed integrates over all t: right for one pulse, not for a ring of beams.
    d = np.array([5, 1, 4, 2, 8, 3])
    turned = np.roll(d, 1)
    assert (wrong(d) != wrong(turned)).any()
    assert wrong(d).tolist() != by_definition(d.tolist())


def test_p5_14_the_ring_of_beams_is_a_sum_over_the_circle():
    # Psi(tau) = integral over one turn; the sum over N beams times the beam's width tends to it.
    def f(t):
        return 2 + np.cos(t) + 0.5 * np.sin(3 * t)

    N = 120
    t = 2 * np.pi * np.arange(N) / N
    tau = t
    due = 2 * np.pi * (4 + 0.5 * np.cos(tau) + 0.125 * np.cos(3 * tau))
    np.testing.assert_allclose(autocorrelation(f(t)) * 2 * np.pi / N, due, atol=1e-12)


# The program `acf`.


@settings(derandomize=True, deadline=None)
@given(PIXELS)
def test_acf_as_printed_returns_one_value_too_many(d):
    printed = acf_as_printed(d)
    # Right up to the last value, which repeats the first: the loop runs to i <= Count.
    assert printed[:-1] == by_definition(d)
    assert len(printed) == len(d) + 1
    assert printed[-1] == printed[0]


def test_acf_as_printed_spoils_what_is_taken_from_its_end():
    # The symmetric partner of tau is N - tau; counted from the printed length it is one off.
    d = [5, 1, 4, 2, 8, 3]
    printed, R = acf_as_printed(d), by_definition(d)
    assert all(R[tau] == R[len(R) - tau] for tau in range(1, len(R)))
    assert any(printed[tau] != printed[len(printed) - tau] for tau in range(1, len(R)))


@pytest.mark.parametrize(("n_beams", "largest"), [(360, 2442), (120, 4230)])
def test_acf_as_printed_overflows_in_large_bitmaps(n_beams, largest):
    # sum d^2 > 2^31 - 1 for a root mean square above `largest` pixels.
    assert n_beams * largest**2 <= 2**31 - 1 < n_beams * (largest + 1) ** 2
    safe, large = [largest] * n_beams, [largest + 1] * n_beams
    assert acf_as_printed(safe)[0] == by_definition(safe)[0]
    assert acf_as_printed(large)[0] < 0
    assert acf_as_printed(large, bits=64)[0] == by_definition(large)[0] == exact(large)[0]


def test_acf_as_printed_is_safe_in_the_room_of_400_pixels():
    assert 360 * 566**2 <= 2**31 - 1


# "The readings will be the same however the robot is turned."


@pytest.fixture(scope="module")
def scans():
    """Scans of one place: heading 0, a multiple of 3 degrees, and half a beam further."""
    room, lidar, step = rooms.thesis_room(), Lidar(120), 2 * np.pi / 120
    headings = np.array([0, 25, 25.5]) * step
    return lidar.scan(room, np.column_stack([np.full((3, 2), [1.937, 2.113]), headings]))


def test_the_autocorrelation_survives_a_turn_by_whole_beams(scans):
    zero, lattice, _ = (autocorrelation(scan) for scan in scans)
    assert np.abs(lattice - zero).max() < 1e-9 * zero[0]


def test_the_autocorrelation_does_not_survive_a_turn_between_two_beams(scans):
    zero, _, between = (autocorrelation(scan) for scan in scans)
    assert np.abs(between - zero).max() > 1e-3 * zero[0]


def test_low_harmonics_survive_a_turn_between_two_beams_better_than_high_ones(scans):
    zero, _, between = (spectrum(scan) for scan in scans)
    low, high = slice(0, 16), slice(16, None)
    change = [np.linalg.norm((between - zero)[k]) / np.linalg.norm(zero[k]) for k in (low, high)]
    assert change[0] < 0.1 * change[1]


def smooth(n_beams, heading):
    """Scan of a round hall, seen from beside its centre: no corner, no jump."""
    angle = 2 * np.pi * np.arange(n_beams) / n_beams + heading
    return -0.5 * np.cos(angle) + np.sqrt(4 - (0.5 * np.sin(angle)) ** 2)


def test_where_nothing_jumps_few_beams_suffice_for_any_heading():
    for n_beams, bound in ((8, 1e-3), (24, 1e-9)):
        changed = autocorrelation(smooth(n_beams, 0.1)) - autocorrelation(smooth(n_beams, 0))
        assert np.abs(changed).max() < bound * n_beams


# The three numbers.

SCAN = np.array([40, 90, 35, 60, 75, 50])


def test_the_printed_index_difference_changes_when_the_zero_passes_between():
    printed = [three_numbers(np.roll(SCAN, k), "printed").tolist() for k in range(6)]
    assert {tuple(p[:2]) for p in printed} == {(90.0, 35.0)}
    assert {p[2] for p in printed} == {-1.0, 5.0}


@pytest.mark.parametrize("form", ["modular", "autocorrelation"])
def test_the_repaired_three_numbers_survive_every_turn_by_whole_beams(form):
    due = three_numbers(SCAN, form)
    for k in range(6):
        np.testing.assert_allclose(three_numbers(np.roll(SCAN, k), form), due, atol=1e-9)


@settings(derandomize=True, deadline=None)
@given(PIXELS)
def test_of_an_autocorrelation_the_index_difference_is_the_place_of_the_smallest(d):
    # P5 asks for the difference of the indices of largest and smallest: the first of them is 0.
    R = by_definition(d)
    largest, smallest, index = three_numbers(d, "autocorrelation")
    assert (round(largest), round(smallest)) == (R[0], min(R))
    assert abs(R[int(index)] - min(R)) < 1e-6
    assert R[-int(index) % len(R)] == R[int(index)]  # the twin


def test_the_three_numbers_forget_most_of_the_scan():
    other = SCAN.copy()
    other[[3, 4, 5]] = [50, 60, 80]
    for form in ("printed", "modular"):
        assert three_numbers(other, form).tolist() == three_numbers(SCAN, form).tolist()
    assert not np.allclose(autocorrelation(other), autocorrelation(SCAN))


# What is lost: the phase.


def congruent(a, b):
    """Whether b is a turned or mirrored."""
    turns = [np.roll(a, k) for k in range(len(a))]
    return any((b == t).all() or (b == t[::-1]).all() for t in turns)


def homometric_pairs(N, occupied):
    """Pairs of two-level scans with one autocorrelation that are no turn or mirror of another."""
    seen: dict[tuple, list] = {}
    for ones in itertools.combinations(range(N), occupied):
        d = np.zeros(N, int)
        d[list(ones)] = 1
        seen.setdefault(tuple(by_definition(d.tolist())), []).append(d)
    return [
        (group[0], other)
        for group in seen.values()
        for other in group
        if not congruent(group[0], other)
    ]


def test_homometric_scans_have_three_beams_or_eight_if_there_are_two_ranges():
    a, b = np.array([1, 5, 6]), np.array([2, 3, 7])
    assert by_definition(a.tolist()) == by_definition(b.tolist()) == [62, 41, 41]
    assert not congruent(a, b)
    assert not any(homometric_pairs(N, k) for N in range(2, 8) for k in range(1, N))
    pairs = homometric_pairs(8, 4)
    assert pairs
    a, b = pairs[0]
    assert exact(a) == exact(b)
    assert not congruent(a, b)
    # The cross-correlation, which keeps the phase, tells them apart.
    assert max(np.rint(np.fft.irfft(np.conj(np.fft.rfft(a)) * np.fft.rfft(b), 8))) < a.sum()


def test_a_mirrored_room_gives_the_same_autocorrelation():
    room, mirrored = rooms.mirrored_pair()
    lidar = Lidar(120)
    width = room.bounds[2]
    here = lidar.scan(room, [1.731, 2.113, 0.4])
    there = lidar.scan(mirrored, [width - 1.731, 2.113, np.pi - 0.4])
    np.testing.assert_allclose(autocorrelation(there), autocorrelation(here), rtol=1e-9)
    assert np.abs(there - here).max() > 0.5


@settings(derandomize=True, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 40))
def test_two_spectra_are_never_farther_apart_than_the_scans_at_their_best(seed, n_beams):
    a, b = np.random.default_rng(seed).uniform(0, 5, (2, n_beams))
    best = min(np.linalg.norm(a - np.roll(b, k)) for k in range(n_beams))
    assert np.linalg.norm(spectrum(a) - spectrum(b)) <= best + 1e-12


@pytest.mark.parametrize("n_beams", [2, 3, 8, 9])
def test_the_spectrum_holds_what_the_autocorrelation_holds(n_beams):
    d = np.random.default_rng(n_beams).uniform(0, 5, n_beams)
    weight = np.full(n_beams // 2 + 1, 2.0)
    weight[0] = 1
    weight[n_beams // 2] = 1 if n_beams % 2 == 0 else 2
    power = spectrum(d) ** 2 * n_beams / weight
    np.testing.assert_allclose(np.fft.irfft(power, n_beams), autocorrelation(d), atol=1e-12)
    assert (spectrum(d) ** 2).sum() == pytest.approx((d**2).sum())


# Item 31: the turn between two scans.


@pytest.mark.parametrize("beams", [0, 1, 25, 59, 60, 61, 119])
def test_a_turn_by_whole_beams_is_found_exactly_and_in_radians(scans, beams):
    step = 2 * np.pi / 120
    turned = np.roll(scans[0], -beams)  # beam 0 now looks where beam `beams` did
    due = (beams * step + np.pi) % (2 * np.pi) - np.pi
    found = turn_between(scans[0], turned)
    assert found == pytest.approx(due, abs=1e-9) or abs(abs(due) - np.pi) < 1e-9
    # Wrong: `Whatangle` returns the number of beams, and calls it degrees.
    printed = turn_as_printed(scans[0], turned)
    assert np.cos(printed * step - due) == pytest.approx(1)
    if beams:
        assert abs(np.rad2deg(found) - printed) > 0.5


def test_a_turn_between_two_beams_is_found_to_a_fraction_of_a_beam():
    room, lidar, rng = rooms.thesis_room(), Lidar(120), np.random.default_rng(3)
    turns = rng.uniform(-np.pi, np.pi, 200)
    poses = np.column_stack([np.full((200, 2), [1.937, 2.113]), turns])
    before = lidar.scan(room, [1.937, 2.113, 0.0])
    error = turn_between(before, lidar.scan(room, poses)) - turns
    error = np.rad2deg(np.abs((error + np.pi) % (2 * np.pi) - np.pi))
    whole = np.rad2deg(np.abs(turns - np.rint(turns * 120 / (2 * np.pi)) * 2 * np.pi / 120))
    assert np.median(error) < 0.2 * np.median(whole)
    assert error.max() < 1.0


# Section 3.3: the whole trial.


@pytest.mark.parametrize(("room", "turned"), [("thesis_room", 0.0), ("thesis_room_two", 25.0)])
def test_an_explorer_finds_its_coordinates_by_the_scan_and_not_by_three_numbers(room, turned):
    """P5, 3.3: "coordinates were determined at every position"; a turned start turns the map."""
    world, lidar, robot = getattr(rooms, room)(), Lidar(120), SquareRobot(0.30)
    rng = np.random.default_rng(0)
    pilot = Explorer(robot, lidar, Quadrants(), rng, bounds=world.bounds, max_path=12)
    log = record(world, Unicycle(), lidar, pilot, PerfectEstimator(), rng, dt=1.0, max_time=600,
                 start=[0.6, 0.6, np.deg2rad(turned)], footprint=robot.footprint)  # fmt: skip
    atlas = SignatureMap.build(world, lidar, stride=2)
    stored, asked = (np.floor(r / 0.01 + 1e-3) for r in (atlas.scans.astype(float), log.ranges))
    nearest = cKDTree(three_numbers(stored)).query(three_numbers(asked))[1]
    for places, low, high in ((atlas.places[nearest], 0.3, 0.8),
                              (atlas.locate(log.ranges).pose[:, :2], 0.0, 0.0)):  # fmt: skip
        wrong = (np.linalg.norm(places - log.truth[:, :2], axis=1) > 0.1).mean()
        assert low <= wrong <= high
    own = lidar.points(log.ranges, between(log.truth[0], log.truth)) @ [1, 1j]
    true = (lidar.points(log.ranges, log.truth) - log.truth[0, :2]) @ [1, 1j]
    assert np.rad2deg(np.angle(np.vdot(own, true))) == pytest.approx(turned, abs=1e-9)
