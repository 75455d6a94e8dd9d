"""Wall sensor: the line model that P1 leaves out; both names of a line are one wall."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamlab.geometry import compose, wrap_angle
from slamlab.sensors import RangeBearing, Wall

rng = np.random.default_rng(7)
SENSOR = Wall(0.05, 0.02, offset=0.3)
POSES = np.column_stack([rng.uniform(-5, 5, (80, 2)), rng.uniform(-np.pi, np.pi, 80)])
# Bearings in all four quadrants, at 0.2 to 12 m: the origin lies on either side of the wall.
Z = np.column_stack([rng.uniform(0.2, 12, 80), np.linspace(-np.pi, np.pi, 80, endpoint=False)])
WALLS = SENSOR.locate(POSES, Z)


def numerical(f, x, wrapped, step=1e-6):
    """Central differences of f at x (n,), one column a coordinate."""
    columns = []
    for d in np.eye(len(x)) * step:
        difference = f(x + d) - f(x - d)
        difference[wrapped] = wrap_angle(difference[wrapped])
        columns.append(difference / (2 * step))
    return np.stack(columns, -1)


def moved(motion, walls):
    """The same walls after a rigid motion of the world, written anew as (r, alpha)."""
    alpha = walls[..., 1] + motion[2]
    r = walls[..., 0] + motion[0] * np.cos(alpha) + motion[1] * np.sin(alpha)
    return np.stack([r, alpha], -1)


def test_the_foot_of_the_perpendicular_is_what_a_point_sensor_would_see():
    foot = np.stack([np.cos(WALLS[:, 1]), np.sin(WALLS[:, 1])], -1)
    x = POSES[:, :2] + 0.3 * np.stack([np.cos(POSES[:, 2]), np.sin(POSES[:, 2])], -1)
    foot = x + foot * (WALLS[:, :1] - (x * foot).sum(-1, keepdims=True))
    due = RangeBearing(0.05, 0.02, offset=0.3).observe(POSES, foot)
    np.testing.assert_allclose(SENSOR.observe(POSES, WALLS), due, atol=1e-12)
    # But it is no landmark: it slides along the wall as the robot moves.
    ahead = RangeBearing(0.05, 0.02, offset=0.3).observe(POSES + [0.5, 0.5, 0], foot)
    assert np.abs(ahead[:, 0] - SENSOR.observe(POSES + [0.5, 0.5, 0], WALLS)[:, 0]).max() > 0.1


@pytest.mark.parametrize("offset", [0.0, 0.3, -0.2, 1.5])
def test_observing_undoes_locating_in_all_quadrants(offset):
    sensor = Wall(0.05, 0.02, offset=offset)
    walls = sensor.locate(POSES, Z)
    np.testing.assert_allclose(sensor.residual(sensor.observe(POSES, walls), Z), 0, atol=1e-12)
    again = sensor.locate(POSES, sensor.observe(POSES, walls))
    np.testing.assert_allclose(again[:, 0], walls[:, 0], atol=1e-12)
    np.testing.assert_allclose(wrap_angle(again[:, 1] - walls[:, 1]), 0, atol=1e-12)
    assert (walls[:, 0] >= 0).all()
    assert (np.abs(walls[:, 1]) <= np.pi).all()


def test_without_the_change_of_sign_a_wall_between_origin_and_robot_is_lost():
    # The wrong form: r - n . s, with its sign, for a wall that stands behind the robot.
    pose, wall = np.array([3.0, 0, 0]), np.array([1.0, 0.0])
    sensor = Wall(0.05, 0.02)
    np.testing.assert_allclose(sensor.observe(pose, wall), [2.0, np.pi])
    naive = np.array([wall[0] - pose[0], wall[1] - pose[2]])
    assert naive.tolist() == [-2.0, 0.0]
    # Subtracting it blindly errs by metres; the residual knows that both are one wall.
    assert np.abs(naive - sensor.observe(pose, wall)).max() > 3
    np.testing.assert_allclose(sensor.residual(naive, sensor.observe(pose, wall)), 0, atol=1e-12)


def test_jacobians_equal_finite_differences_and_the_point_model_does_not():
    H_pose, H_wall = SENSOR.jacobians(POSES, WALLS)
    signs = set()
    for pose, wall, Hp, Hw in zip(POSES, WALLS, H_pose, H_wall, strict=True):
        due = numerical(lambda x, w=wall: SENSOR.observe(x, w), pose, 1)
        np.testing.assert_allclose(Hp, due, atol=1e-7)
        assert np.abs(due[1] - [0, 0, -1]).max() < 1e-7
        due = numerical(lambda w, x=pose: SENSOR.observe(x, w), wall, 1)
        np.testing.assert_allclose(Hw, due, rtol=1e-7, atol=1e-7)
        signs.add(float(Hw[0, 0]))
    assert signs == {1.0, -1.0}
    # P1's point Jacobian says that driving along a wall turns its bearing; it does not.
    point = RangeBearing(0.05, 0.02, offset=0.3).jacobians([0, 0, 0], [2.3, 0.0])[0]
    assert abs(point[1, 1]) > 0.4
    assert SENSOR.jacobians([0, 0, 0], [2.3, 0.0])[0][1, 1] == 0


def test_locate_jacobians_equal_finite_differences():
    G_pose, G_z = SENSOR.locate_jacobians(POSES, Z)
    without_lever = np.zeros(len(POSES))
    for i, (pose, z) in enumerate(zip(POSES, Z, strict=True)):
        due = numerical(lambda x, z=z: SENSOR.locate(x, z), pose, 1)
        np.testing.assert_allclose(G_pose[i], due, atol=1e-7)
        due = numerical(lambda z, x=pose: SENSOR.locate(x, z), z, 1)
        np.testing.assert_allclose(G_z[i], due, atol=1e-7)
        without_lever[i] = np.abs(Wall(1, 1).locate_jacobians(pose, z)[1] - due).max()
    assert without_lever.max() > 0.2


def test_inverse_jacobians_multiply_to_one():
    H_pose, H_wall = SENSOR.jacobians(POSES, WALLS)
    G_pose, G_z = SENSOR.locate_jacobians(POSES, SENSOR.observe(POSES, WALLS))
    np.testing.assert_allclose(G_z @ H_wall, np.tile(np.eye(2), (80, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(G_pose, -G_z @ H_pose, atol=1e-12)


def test_moving_robot_and_wall_together_is_invisible_to_the_jacobians():
    # Gauge of lines: a translation t moves r by t . n, a rotation about the origin moves alpha.
    H_pose, H_wall = SENSOR.jacobians(POSES, WALLS)
    normal = np.stack([np.cos(WALLS[:, 1]), np.sin(WALLS[:, 1])], -1)
    for axis in range(2):
        seen = H_pose[..., axis] + H_wall[..., 0] * normal[:, axis, None]
        np.testing.assert_allclose(seen, 0, atol=1e-12)
    turn = np.stack([-POSES[:, 1], POSES[:, 0], np.ones(80)], -1)
    seen = np.einsum("nij,nj->ni", H_pose, turn) + H_wall[..., 1]
    np.testing.assert_allclose(seen, 0, atol=1e-12)
    # The point model's gauge, (-y, x) for the landmark, is not this one.
    wrong = np.einsum("nij,nj->ni", H_pose, turn)
    wrong += np.einsum("nij,nj->ni", H_wall, np.stack([-WALLS[:, 1], WALLS[:, 0]], -1))
    assert np.abs(wrong).max() > 1


coordinate = st.floats(-50, 50)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(coordinate, coordinate, st.floats(-10, 10))
def test_a_rigid_motion_of_the_world_changes_no_measurement(x, y, turn):
    motion = np.array([x, y, turn])
    z = SENSOR.observe(POSES, WALLS)
    moved_z = SENSOR.observe(compose(motion, POSES), moved(motion, WALLS))
    np.testing.assert_allclose(SENSOR.residual(moved_z, z), 0, atol=1e-10)


def test_both_names_of_a_wall_and_a_full_turn_change_nothing():
    other = np.column_stack([-WALLS[:, 0], WALLS[:, 1] + np.pi])
    z = SENSOR.observe(POSES, WALLS)
    np.testing.assert_allclose(SENSOR.residual(SENSOR.observe(POSES, other), z), 0, atol=1e-12)
    other = np.column_stack([-z[:, 0], z[:, 1] + 3 * np.pi])
    np.testing.assert_allclose(SENSOR.residual(other, z), 0, atol=1e-12)
    np.testing.assert_allclose(SENSOR.residual(z, other), 0, atol=1e-12)
    again = SENSOR.observe(POSES + [0, 0, 2 * np.pi], WALLS + [0, -2 * np.pi])
    np.testing.assert_allclose(SENSOR.residual(again, z), 0, atol=1e-12)
    # The two walls of a corridor are two walls, one opposite the other.
    np.testing.assert_allclose(SENSOR.residual([2, 0], [2, np.pi]), [-4, 0], atol=1e-12)


def test_batches_equal_single_calls():
    grid = SENSOR.observe(POSES[:5, None], WALLS[None, :7])
    H_pose, H_wall = SENSOR.jacobians(POSES[:5, None], WALLS[None, :7])
    assert grid.shape == (5, 7, 2)
    assert H_pose.shape == (5, 7, 2, 3)
    assert H_wall.shape == (5, 7, 2, 2)
    np.testing.assert_array_equal(grid[2, 3], SENSOR.observe(POSES[2], WALLS[3]))
    np.testing.assert_array_equal(H_wall[2, 3], SENSOR.jacobians(POSES[2], WALLS[3])[1])
    G_pose, G_z = SENSOR.locate_jacobians(POSES[:5, None], grid)
    assert G_pose.shape == (5, 7, 2, 3)
    assert G_z.shape == (5, 7, 2, 2)
    np.testing.assert_allclose(
        SENSOR.residual(
            SENSOR.observe(POSES[:5, None], SENSOR.locate(POSES[:5, None], grid)), grid
        ),
        0,
        atol=1e-12,
    )


def test_a_wall_is_visible_if_a_beam_reaches_it():
    sensor = Wall(0.01, 0.01, max_range=4.0, field_of_view=np.pi)
    # Ahead; too far; beside (a beam 60 deg off meets it at 4 m); behind; beside at the rim.
    walls = np.array([[2.0, 0], [4.1, 0], [1.9, 2.5], [1.0, np.pi], [3.9, np.pi / 2]])
    assert sensor.visible([0, 0, 0], walls).tolist() == [True, False, True, False, True]
    narrow = Wall(0.01, 0.01, max_range=4.0, field_of_view=0.2)
    angles = np.linspace(-0.1, 0.1, 401)
    for wall in Wall(1, 1).locate(
        [0, 0, 0], np.column_stack([np.tile([1, 2.5, 3.9], 10), Z[:30, 1]])
    ):
        with np.errstate(divide="ignore"):
            reach = wall[0] / np.cos(angles - wall[1])
        assert narrow.visible([0, 0, 0], wall) == ((reach > 0) & (reach <= 4.0)).any()


@pytest.mark.parametrize("kind", [Wall, RangeBearing])
def test_the_noise_of_measure_has_the_stated_covariance(kind):
    sensor = kind(0.1, 0.05)
    landmarks = sensor.locate([0, 0, 0], np.tile([3.0, np.pi], (40_000, 1)))
    z, ids = sensor.measure([0, 0, 0], landmarks, np.random.default_rng(2))
    error = sensor.residual(z, sensor.observe([0, 0, 0], landmarks))
    np.testing.assert_allclose(np.cov(error.T), sensor.cov, atol=3e-4)
    assert (np.abs(z[:, 1]) <= np.pi).all()
    assert ids.tolist() == list(range(40_000))


@pytest.mark.parametrize("kind", [Wall, RangeBearing])
def test_misses_and_clutter_come_at_the_stated_rates(kind):
    sensor = kind(0.02, 0.01, max_range=8.0, field_of_view=np.pi)
    landmarks = sensor.locate(
        [0, 0, 0], np.column_stack([np.full(50, 3.0), np.linspace(-1, 1, 50)])
    )
    random = np.random.default_rng(3)
    observations = [
        sensor.measure([0, 0, 0], landmarks, random, p_detect=0.8, clutter_rate=5)
        for _ in range(400)
    ]
    seen = np.concatenate([ids[ids >= 0] for _, ids in observations])
    assert np.bincount(seen, minlength=50).min() > 280
    assert len(seen) / 20_000 == pytest.approx(0.8, abs=0.01)
    false = np.concatenate([z[ids == -1] for z, ids in observations])
    numbers = [np.sum(ids == -1) for _, ids in observations]
    assert np.mean(numbers) == pytest.approx(5, abs=0.35)
    assert np.var(numbers) == pytest.approx(5, abs=1.2)
    # Uniform over the view: means and variances of both coordinates.
    np.testing.assert_allclose(false.mean(0), [4, 0], atol=0.2)
    np.testing.assert_allclose(false.var(0), [64 / 12, np.pi**2 / 12], rtol=0.08)
    for z, ids in observations[:20]:
        real = ids >= 0
        assert (np.diff(ids[real]) > 0).all()
        due = sensor.observe([0, 0, 0], landmarks[ids[real]])
        assert np.abs(sensor.residual(z[real], due)).max() < 0.12


@pytest.mark.parametrize("kind", [Wall, RangeBearing])
def test_a_blind_sensor_sees_clutter_only_and_a_perfect_one_draws_no_more(kind):
    sensor = kind(0.02, 0.01, max_range=8.0)
    landmarks = np.column_stack([np.full(9, 3.0), np.linspace(-1, 1, 9)])
    z, ids = sensor.measure([0, 0, 0], landmarks, np.random.default_rng(4), p_detect=0.0)
    assert z.shape == (0, 2)
    assert ids.shape == (0,)
    _, ids = sensor.measure(
        [0, 0, 0], landmarks, np.random.default_rng(4), p_detect=0.0, clutter_rate=20
    )
    assert (ids == -1).all()
    assert ids.dtype.kind == "i"
    # The defaults leave the stream of random numbers as it was.
    one = sensor.measure([0, 0, 0], landmarks, np.random.default_rng(5))[0]
    two = sensor.measure(
        [0, 0, 0], landmarks, np.random.default_rng(5), p_detect=1.0, clutter_rate=3
    )[0]
    np.testing.assert_array_equal(one, two[: len(one)])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sigma_range": 0.0}, "sigma_range"),
        ({"sigma_bearing": -1.0}, "sigma_bearing"),
        ({"offset": np.nan}, "offset"),
        ({"max_range": 0.0}, "max_range"),
        ({"field_of_view": 7.0}, "field_of_view"),
    ],
)
def test_bad_parameters_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Wall(**{"sigma_range": 0.1, "sigma_bearing": 0.1, **arguments})


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match=r"pose: expected shape"):
        SENSOR.observe([0, 0], [1, 1])
    with pytest.raises(ValueError, match=r"landmark: expected finite"):
        SENSOR.jacobians([0, 0, 0], [np.nan, 1])
    with pytest.raises(ValueError, match=r"z: expected shape"):
        SENSOR.locate([0, 0, 0], [1.0])
    with pytest.raises(ValueError, match="rng"):
        SENSOR.measure([0, 0, 0], WALLS, 5)
    with pytest.raises(ValueError, match="p_detect"):
        SENSOR.measure([0, 0, 0], WALLS, rng, p_detect=1.1)
    with pytest.raises(ValueError, match="clutter_rate: expected a number"):
        SENSOR.measure([0, 0, 0], WALLS, rng, clutter_rate=-1)
    with pytest.raises(ValueError, match="clutter_rate: expected 0"):
        SENSOR.measure([0, 0, 0], WALLS, rng, clutter_rate=1)
    with pytest.raises(ValueError, match="read-only"):
        SENSOR.cov[0, 0] = 1.0
