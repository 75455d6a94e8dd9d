"""The benchmark's metric on relations measured by hand, and the file that holds them."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from slamlab.datasets import killian
from slamlab.datasets.relations import read_relations
from slamlab.evaluation import relation_error
from slamlab.geometry import between, compose

RNG = np.random.default_rng(0)
TIMES = np.arange(50) * 0.5
POSES = np.column_stack([RNG.normal(size=(50, 2)) * 5, RNG.uniform(-3, 3, 50)])
PAIRS = np.array([RNG.choice(50, 2, replace=False) for _ in range(80)])
RELATIONS = (TIMES[PAIRS], between(POSES[PAIRS[:, 0]], POSES[PAIRS[:, 1]]))


def test_the_true_path_in_any_frame_has_no_error():
    for path in (POSES, compose([5.0, -3.0, 2.0], POSES)):
        error = relation_error(TIMES, path, RELATIONS)
        assert len(error.translation) == 80
        assert error.max < 1e-12
        assert error.rotation_rmse < 1e-12


def test_the_error_is_the_relation_undone():
    path = POSES + 0.1 * RNG.normal(size=POSES.shape)
    error = relation_error(TIMES, path, RELATIONS)
    for k, (i, j) in enumerate(PAIRS[:10]):
        e = between(RELATIONS[1][k], between(path[i], path[j]))
        assert error.translation[k] == pytest.approx(np.hypot(e[0], e[1]))
        assert error.rotation[k] == pytest.approx(abs(e[2]))


def test_the_order_of_poses_does_not_matter_and_missing_moments_are_left_out():
    order = RNG.permutation(50)
    path = POSES + 0.1 * RNG.normal(size=POSES.shape)
    right = relation_error(TIMES, path, RELATIONS)
    shuffled = relation_error(TIMES[order], path[order], RELATIONS)
    assert np.array_equal(right.translation, shuffled.translation)
    few = relation_error(TIMES[:25], path[:25], RELATIONS)
    assert np.allclose(few.translation, right.translation[(PAIRS < 25).all(1)])
    assert relation_error(TIMES + 0.01, path, RELATIONS, tolerance=0.02).max == right.max
    with pytest.raises(ValueError, match="none of 80 is"):
        relation_error(TIMES + 0.01, path, RELATIONS)
    with pytest.raises(ValueError, match="none of 80 is"):
        relation_error([], np.zeros((0, 3)), RELATIONS)
    with pytest.raises(ValueError, match="poses: expected shape"):
        relation_error(TIMES, path[1:], RELATIONS)


def test_a_slid_stretch_costs_next_to_nothing():
    """Relations between neighbours see one seam, whatever lies beyond it."""
    line = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    slid = line + np.where(np.arange(100) > 50, 3.0, 0.0)[:, None] * [1, 0, 0]
    pairs = np.column_stack([np.arange(99), np.arange(1, 100)])
    near = (pairs.astype(float), np.tile([1.0, 0, 0], (99, 1)))
    assert relation_error(np.arange(100.0), slid, near).mean == pytest.approx(3.0 / 99)


def test_the_file_is_read_plain_and_packed(tmp_path):
    text = "# t t x y z r p y\n1.5 2.5 0.1 0.2 9 8 7 0.3\n\n3 4 1 2 0 0 0 -0.5\n"
    (tmp_path / "a.relations").write_text(text)
    (tmp_path / "a.relations.gz").write_bytes(gzip.compress(text.encode()))
    for name in ("a.relations", "a.relations.gz"):
        times, measurements = read_relations(tmp_path / name)
        assert times.tolist() == [[1.5, 2.5], [3, 4]]
        assert measurements.tolist() == [[0.1, 0.2, 0.3], [1, 2, -0.5]]
    (tmp_path / "a.relations.gz").write_bytes(gzip.compress(text.encode())[:-12])
    with pytest.raises(ValueError, match="cannot unpack"):
        read_relations(tmp_path / "a.relations.gz")
    (tmp_path / "b.relations").write_text(text.replace(" -0.5", ""))
    with pytest.raises(ValueError, match="b.relations: line 4: expected 8 numbers, got 7"):
        read_relations(tmp_path / "b.relations")


def test_killian_keeps_the_relations_measured_in_it():
    folder = os.environ.get("SLAMLAB_DATA")
    if not folder:
        pytest.skip("mit-killian.relations is not ours to ship: set SLAMLAB_DATA to its folder")
    relations = read_relations(Path(folder) / "mit-killian.relations.gz")
    court = killian()
    assert len(relations.times) == 4677
    best = relation_error(court.timestamps, court.graph.optimize().poses, relations)
    assert len(best.translation) == 658
    assert best.mean == pytest.approx(0.0390, abs=5e-5)
    assert np.rad2deg(best.rotation.mean()) == pytest.approx(0.400, abs=5e-4)
    drifted = relation_error(court.timestamps, court.dead_reckoned(), relations)
    assert drifted.mean == pytest.approx(0.934, abs=5e-4)
    assert len(killian(small=True).timestamps) == 0
