"""Angles and poses of the plane: every identity holds for any pose, at ties and in batches."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slamlab.geometry import (
    between,
    compose,
    inverse,
    inverse_transform,
    rotation,
    tilt,
    transform,
    wrap_angle,
)

metres = st.floats(-1e3, 1e3)
radians = st.floats(-50.0, 50.0)
pose = st.tuples(metres, metres, radians).map(np.array)
points = arrays(float, (4, 2), elements=metres)
quick = settings(max_examples=60, deadline=None)


def matrix(p):
    """The rigid motion of a pose as a matrix: another way to do the same arithmetic."""
    c, s = np.cos(p[2]), np.sin(p[2])
    return np.array([[c, -s, p[0]], [s, c, p[1]], [0, 0, 1]])


def assert_same_pose(a, b, atol=1e-9):
    np.testing.assert_allclose(matrix(a), matrix(b), atol=atol)


@quick
@given(pose, pose)
def test_compose_is_the_product_of_matrices(a, b):
    np.testing.assert_allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=1e-9)


@quick
@given(pose)
def test_inverse_undoes_a_pose_from_both_sides(a):
    np.testing.assert_allclose(matrix(inverse(a)), np.linalg.inv(matrix(a)), atol=1e-9)
    assert_same_pose(compose(a, inverse(a)), np.zeros(3))
    assert_same_pose(compose(inverse(a), a), np.zeros(3))


def test_inverse_is_not_the_pose_with_its_signs_changed():
    assert not np.allclose(inverse([1.0, 2.0, 0.5]), [-1.0, -2.0, -0.5])


@quick
@given(pose, pose)
def test_between_is_what_must_be_composed(a, b):
    assert_same_pose(compose(a, between(a, b)), b)
    assert_same_pose(between(a, b), compose(inverse(a), b))


@quick
@given(pose, pose, pose)
def test_compose_is_associative(a, b, c):
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)), atol=1e-8)


def test_compose_does_not_commute():
    a, b = [1.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2]
    assert not np.allclose(compose(a, b), compose(b, a))


@quick
@given(pose, points)
def test_transform_multiplies_by_the_matrix_and_inverse_transform_undoes_it(a, given):
    there = transform(a, given)
    np.testing.assert_allclose(there, given @ rotation(a[2]).T + a[:2], atol=1e-9)
    np.testing.assert_allclose(inverse_transform(a, there), given, atol=1e-8)
    np.testing.assert_allclose(there, inverse_transform(inverse(a), given), atol=1e-8)


@quick
@given(pose, pose, points)
def test_points_go_through_a_chain_of_frames(a, b, given):
    chained = transform(a, transform(b, given))
    np.testing.assert_allclose(transform(compose(a, b), given), chained, atol=1e-8)


@quick
@given(pose, points)
def test_distances_survive_a_motion(a, given):
    apart = np.linalg.norm(given[:, None] - given, axis=-1)
    there = transform(a, given)
    np.testing.assert_allclose(np.linalg.norm(there[:, None] - there, axis=-1), apart, atol=1e-9)


def test_a_rotation_turns_left():
    np.testing.assert_allclose(rotation(np.pi / 2) @ [1, 0], [0, 1], atol=1e-15)
    np.testing.assert_allclose(transform([0, 0, np.pi / 2], [1.0, 0.0]), [0, 1], atol=1e-15)


# Angles.


@quick
@given(st.floats(-1e6, 1e6))
def test_a_wrapped_angle_points_the_same_way_from_minus_pi_to_pi(a):
    wrapped = wrap_angle(a)
    assert -np.pi < wrapped <= np.pi
    assert abs(np.exp(1j * wrapped) - np.exp(1j * a)) < 1e-9


@pytest.mark.parametrize("turns", [-7, -3, -1, 1, 3, 7])
def test_half_a_turn_is_plus_pi_from_either_side(turns):
    assert wrap_angle(turns * np.pi) == pytest.approx(np.pi)


def test_an_angle_inside_keeps_its_last_bit():
    inside = np.array([np.pi, np.nextafter(-np.pi, 0), -1e-300, 0.1, 3.0])
    np.testing.assert_array_equal(wrap_angle(inside), inside)


@pytest.mark.parametrize("heading", [np.pi, -np.pi, 3 * np.pi])
def test_poses_that_look_back_have_heading_plus_pi(heading):
    back = [0.0, 0.0, heading]
    assert compose(back, np.zeros(3))[2] == pytest.approx(np.pi)
    assert inverse(back)[2] == pytest.approx(np.pi)
    assert between(np.zeros(3), back)[2] == pytest.approx(np.pi)


# Batches.


@pytest.mark.parametrize("function", [compose, between])
def test_leading_axes_broadcast(function):
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(5, 1, 3)), rng.normal(size=(4, 3))
    both = function(a, b)
    assert both.shape == (5, 4, 3)
    np.testing.assert_array_equal(both[2, 3], function(a[2, 0], b[3]))


@pytest.mark.parametrize("function", [transform, inverse_transform])
def test_each_pose_of_a_batch_takes_its_own_points(function):
    rng = np.random.default_rng(2)
    poses, given = rng.normal(size=(5, 3)), rng.normal(size=(5, 7, 2))
    np.testing.assert_array_equal(function(poses, given)[3], function(poses[3], given[3]))
    assert function(poses, given[0]).shape == (5, 7, 2)
    assert function(poses[0], given[0, 0]).shape == (2,)


def test_arguments_stay_as_they_were():
    a, b, given = np.array([1.0, 2, 9]), np.array([3.0, 4, -9]), np.ones((2, 2))
    for function, arguments in [(compose, (a, b)), (between, (a, b)), (transform, (a, given))]:
        before = [x.copy() for x in arguments]
        result = function(*arguments)
        result += 1
        np.testing.assert_array_equal(
            np.concatenate(before, None), np.concatenate(arguments, None)
        )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: compose([1, 2], [1, 2, 3]), r"a: expected shape \(\.\.\., 3\), got \(2,\)"),
        (lambda: compose([1, 2, 3], 1.0), r"b: expected shape \(\.\.\., 3\), got \(\)"),
        (lambda: inverse([1, 2, np.nan]), "a: expected finite numbers, got nan at index"),
        (lambda: between([1, 2, 3], [1, np.inf, 3]), "b: expected finite"),
        (lambda: transform([0, 0, 0], [1, 2, 3]), r"points: expected shape \(\.\.\., 2\)"),
        (lambda: inverse_transform([0, 0], [1, 2]), "pose: expected shape"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_tilt_is_pitch_after_roll():
    roll, pitch = 0.3, -0.2
    c, s, C, S = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    R_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    R_y = np.array([[C, 0, S], [0, 1, 0], [-S, 0, C]])
    R = tilt(roll, pitch)
    np.testing.assert_allclose(R, R_y @ R_x, atol=1e-15)
    assert np.abs(R - R_x @ R_y).max() > 0.05  # the other order is another attitude
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    both = tilt([0.1, roll], pitch)
    np.testing.assert_allclose(both[1], R)
    with pytest.raises(ValueError, match="pitch"):
        tilt([0.1, 0.2], [0.1, 0.2, 0.3])
