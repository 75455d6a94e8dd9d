"""Right answers of chapter 19, written in other ways: each passes."""

import math

import numpy as np
import pytest

from slamlab.exercises import ch19_autocorrelation_localization as ch


def beams_by_trying(sigma):
    n = 1
    while 2 * math.pi / n / 12**0.5 > sigma:
        n += 1
    return n


def lost_by_its_square(scan, R):
    return np.sqrt(R[0] - np.nansum(scan**2))


def lost_by_a_loop(scan, R):
    """Another right answer: the last correlation, which is the first read backwards."""
    N = len(scan)
    known = others = 0.0
    for j in range(N):
        pair = scan[j], scan[(j + 1) % N]
        if np.isnan(pair).any():
            others += np.nansum(pair)
        else:
            known += pair[0] * pair[1]
    return (R[-1] - known) / others


def slide_by_loops(stored, scan):
    N, k = len(stored), len(stored) // len(scan)
    misfits = []
    for m in range(N):
        apart = [abs(d - stored[(k * j + m) % N]) for j, d in enumerate(scan) if not math.isnan(d)]
        misfits.append(sum(apart) / len(apart))
    return misfits


def slide_by_rolling(stored, scan):
    k = len(stored) // len(scan)
    return [np.nanmean(np.abs(np.roll(stored, -m)[::k] - scan)) for m in range(len(stored))]


def tip_of_two_lines(misfits):
    """Another right answer: the steeper neighbour gives the slope of both sides."""
    N, m = len(misfits), int(np.argmin(misfits))
    left, least, right = (misfits[(m + k) % N] for k in (-1, 0, 1))
    if left > right:
        tip = (left - right) / (2 * (left - least))
    else:
        tip = -(right - left) / (2 * (right - least))
    return math.remainder((m + tip) * 2 * math.pi / N, 2 * math.pi)


def best_again_and_again(places, misfits, separation, margin):
    """Another right answer: take the least, set its neighbours to infinity, begin again."""
    left, rows = misfits.copy(), []
    while left.min() - misfits.min() < margin:
        rows.append(int(left.argmin()))
        left[np.hypot(*(places - places[rows[-1]]).T) <= separation] = np.inf
    return rows


def locate_by_loops(places, stored, marks, scan, nearest, separation, margin):
    M, n = len(scan), marks.shape[1]
    closed = scan.copy()
    for j in np.flatnonzero(np.isnan(scan)):
        back = next(b for b in range(1, M) if not math.isnan(scan[j - b]))
        ahead = next(a for a in range(1, M) if not math.isnan(scan[(j + a) % M]))
        part = back / (back + ahead)
        closed[j] = (1 - part) * scan[j - back] + part * scan[(j + ahead) % M]
    mark = np.abs(np.fft.fft(closed))[:n] / M * np.where(np.arange(n) > 0, 2**0.5, 1)
    rank = sorted(range(len(places)), key=lambda row: math.dist(marks[row], mark))[:nearest]
    rings = [slide_by_rolling(stored[row], scan) for row in rank]
    rows = best_again_and_again(
        places[rank], np.array([min(ring) for ring in rings]), separation, margin
    )
    return [[*places[rank[k]], tip_of_two_lines(rings[k])] for k in rows]


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_beams, beams_by_trying),
        (ch.check_lost_beam, lost_by_its_square),
        (ch.check_lost_beam, lost_by_a_loop),
        (ch.check_slide, slide_by_loops),
        (ch.check_slide, slide_by_rolling),
        (ch.check_between_beams, tip_of_two_lines),
        (ch.check_hypotheses, best_again_and_again),
        (ch.check_locate, locate_by_loops),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


def test_robots_are_found_with_other_seeds_too():
    for seed in range(10):
        *known, scans, truth = ch.thesis_room(seed=seed)
        found = np.array([ch.locate(*known, scan, 30, 0.5, 0.02)[0] for scan in scans])
        off, _ = ch._errors_of(found, truth)
        assert np.sum(off > 0.2) <= 4, seed


def test_the_square_hall_looks_the_same_after_a_quarter_turn():
    occupied = ch._square_world().occupied
    assert (occupied == np.rot90(occupied)).all()
