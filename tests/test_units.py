"""Another unit of length gives the same decisions: metres and centimetres, side by side."""

import numpy as np
import pytest

from slamlab.datasets import manhattan_graph
from slamlab.gaussian import mahalanobis_squared
from slamlab.robots import Unicycle
from slamlab.sensors import RangeBearing
from slamlab.slam import EKFSlam, PoseGraph
from slamlab.slam.association import (
    joint_compatibility,
    maximum_likelihood,
    nearest_euclidean,
    nearest_neighbour,
)

CM = 100.0


def scene(seed, unit=1.0, n=8):
    """A filter over n landmarks and one scan of them, in units of 1 / `unit` metres."""
    rng = np.random.default_rng(seed)
    scale = np.array([unit, unit, 1.0, *np.full(2 * n, unit)])
    points = rng.uniform(-1, 1, (n, 2))
    mean = np.concatenate([[0.1, -0.2, 0.3], points.ravel()])
    root = np.diag([0.3, 0.3, 0.1, *np.full(2 * n, 0.05)]) @ rng.standard_normal((3 + 2 * n,) * 2)
    cov = 0.3 * root @ root.T + 1e-4 * np.eye(3 + 2 * n)
    pose = mean[:3] + [0.3, 0.1, 0.05] * rng.standard_normal(3)
    z = RangeBearing(0.1, 0.03).observe(pose, points) + [0.1, 0.03] * rng.standard_normal((n, 2))
    z[:, 0] = np.abs(z[:, 0])
    sensor = RangeBearing(0.1 * unit, 0.03)
    slam = EKFSlam(Unicycle(), sensor, scale * mean, scale[:, None] * cov * scale, ids=[*range(n)])
    return slam, z * [unit, 1.0]


@pytest.mark.parametrize("associate", [nearest_neighbour, maximum_likelihood, joint_compatibility])
def test_an_association_answers_alike_in_metres_and_in_centimetres(associate):
    answers = [[associate(*scene(seed, unit)) for seed in range(30)] for unit in (1.0, CM)]
    np.testing.assert_array_equal(*answers)
    assert len({tuple(one) for one in answers[0]}) > 1


def test_a_gate_in_metres_has_a_unit_and_must_be_moved_with_it():
    in_metres, blind, moved = (
        [nearest_euclidean(*scene(seed, unit), gate=gate) for seed in range(30)]
        for unit, gate in ((1.0, 1.0), (CM, 1.0), (CM, CM))
    )
    np.testing.assert_array_equal(in_metres, moved)
    assert not np.array_equal(in_metres, blind)


def test_an_update_its_nis_and_its_nees_are_the_same_in_any_unit():
    for seed in range(5):
        found = []
        for unit in (1.0, CM):
            slam, z = scene(seed, unit)
            report = slam.update(z, range(len(z)))
            truth = np.array([0.2 * unit, -0.1 * unit, 0.3])
            nees = mahalanobis_squared(slam.pose - truth, slam.pose_cov)
            found.append((slam.pose / [unit, unit, 1], report.nis, nees))
        for here, there in zip(*found, strict=True):
            np.testing.assert_allclose(here, there, rtol=1e-6, atol=1e-9)


def test_a_graph_has_the_same_cost_and_the_same_map_in_any_unit():
    town = manhattan_graph(120, 150, np.random.default_rng(1), sigma_heading=0.05).graph
    best = town.chordal_initialisation().optimize()
    length = np.array([CM, CM, 1.0])
    other = PoseGraph(
        town.poses * length,
        town.edges,
        town.measurements * length,
        town.information / (length[:, None] * length),
    )
    again = other.chordal_initialisation().optimize()
    assert again.chi2 == pytest.approx(best.chi2, rel=1e-6)
    np.testing.assert_allclose(again.poses / length, best.poses, atol=1e-6)
    # Information that stays in its old unit weighs positions ten thousand times too much.
    wrong = PoseGraph(other.poses, town.edges, other.measurements, town.information)
    assert wrong.chordal_initialisation().optimize().chi2 > 2 * best.chi2
