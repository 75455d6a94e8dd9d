"""Precision and recall: what is counted, and that a perfect association scores one."""

import numpy as np
import pytest

from slamlab.evaluation import association_scores, run
from slamlab.localization import DeadReckoning
from slamlab.robots import Unicycle
from slamlab.simulation import ORCHARD_SENSOR, orchard_loop
from slamlab.slam import EKFSlam, FastSlam
from slamlab.slam.association import IGNORED, NEW, nearest_neighbour

TOLD = 51


def scored(log, associate):
    slam = EKFSlam(Unicycle(), ORCHARD_SENSOR, log.truth[0], associate=associate)
    result = run(slam, log, known_ids=TOLD)
    return result, association_scores(result, TOLD)


def oracle(log):
    """An association that is told the truth; the filter's names are the true rows so far."""
    names = iter(log.ids[TOLD:])

    def associate(slam, z):
        row_of = {name: row for row, name in enumerate(slam.ids)}
        return np.array([row_of.get(t, IGNORED) for t in next(names).tolist()], dtype=int)

    return associate


def test_the_truth_scores_one_and_comes_home():
    log = orchard_loop(np.random.default_rng(1), clutter_rate=2.0)
    result, scores = scored(log, oracle(log))
    assert (scores.precision, scores.recall) == (1.0, 1.0)
    assert scores.named == scores.right == scores.possible > 50
    assert np.hypot(*(result.poses[-1] - log.truth[-1])[:2]) < 0.3


def test_naming_everything_wrong_scores_nothing():
    log = orchard_loop(np.random.default_rng(1), clutter_rate=0.0)
    truth = oracle(log)

    def shifted(slam, z):
        rows = truth(slam, z)
        return np.where(rows >= 0, (rows + 1) % slam.n_landmarks, rows)

    _, wrong = scored(log, shifted)
    assert wrong.right == 0
    assert wrong.precision == wrong.recall == 0.0
    _, silent = scored(log, lambda slam, z: np.full(len(z), IGNORED))
    assert (silent.precision, silent.recall, silent.named) == (1.0, 0.0, 0)


def test_clutter_that_starts_landmarks_is_counted_as_clutter():
    log = orchard_loop(np.random.default_rng(2), clutter_rate=3.0)
    result, scores = scored(log, lambda slam, z: np.full(len(z), NEW))
    origins = np.array([scores.origins[name] for name in result.system.ids])
    assert (origins == -1).sum() > 20


def test_bad_input_is_named():
    log = orchard_loop(np.random.default_rng(1), laps=0.1)
    result, _ = scored(log, lambda slam, z: np.full(len(z), NEW))
    with pytest.raises(ValueError, match="known_ids"):
        association_scores(result, -1)
    with pytest.raises(ValueError, match="reports with the ids given"):
        association_scores(run(DeadReckoning(Unicycle(), log.truth[0]), log))


KEEP = ("associations", "is_new", "ancestors")


def particles(log, n=20, known_ids=False, **options):
    slam = FastSlam(
        Unicycle(), ORCHARD_SENSOR, log.truth[0], n, 2, rng=np.random.default_rng(1), **options
    )
    return run(slam, log, known_ids=known_ids, record=KEEP)


def test_particles_that_are_told_score_one_and_are_all_counted():
    log = orchard_loop(np.random.default_rng(1), clutter_rate=0.0)
    scores = association_scores(particles(log, known_ids=True))
    assert (scores.precision, scores.recall, scores.origins) == (1.0, 1.0, {})
    assert scores.named == scores.possible == 20 * (scores.named // 20) > 20 * 50
    one = association_scores(particles(log, 1, known_ids=True))
    assert one.named * 20 == scores.named
    later = association_scores(particles(log, known_ids=True), since=51)
    assert 0 < later.named < scores.named


def test_particles_that_decide_are_counted_against_what_started_their_own_columns():
    log = orchard_loop(np.random.default_rng(1), drift=0.1, clutter_rate=0.0)
    decided = association_scores(particles(log))
    assert decided.precision > 0.99
    assert decided.recall > 0.9

    def exchanged(particle, z):
        rows = nearest_neighbour(particle, z)
        rows[rows >= 0] = np.roll(rows[rows >= 0], 1)
        return rows

    wrong = association_scores(particles(log, 3, associate=exchanged))
    assert wrong.named > 0
    assert wrong.precision < 0.3
    # Without the particles' own record nothing can be counted.
    with pytest.raises(ValueError, match="expected reports with the ids given"):
        association_scores(run(particles(log).system, log[:1]))


def test_steps_before_since_start_landmarks_and_count_for_nothing():
    log = orchard_loop(np.random.default_rng(1), drift=0.1, clutter_rate=1.0)
    slam = EKFSlam(Unicycle(), ORCHARD_SENSOR, log.truth[0])
    result = run(slam, log, known_ids=False)
    everything, later = association_scores(result), association_scores(result, since=51)
    assert 0 < later.named < everything.named
    assert later.origins == everything.origins
