"""The stereo odometer really estimates; its covariance and the light model are honest."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamlab.geometry import between, compose
from slamlab.sensors.visual_odometer import (
    StereoOdometer,
    VisualOdometer,
    fit_noise,
    rigid_motion,
    room_points,
)

ROOM = room_points(np.random.default_rng(0), 600)
CLEAN = StereoOdometer(sigma_pixel=1e-9, outliers=0.0)


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_step(rng):
    before = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)])
    step = np.array([rng.uniform(0, 0.1), rng.uniform(-0.03, 0.03), rng.uniform(-0.15, 0.15)])
    return before, step, compose(before, step)


def measure(odometer, before, after, rng):
    seen = odometer.observe(before, ROOM, rng), odometer.observe(after, ROOM, rng)
    return odometer.estimate(*odometer.match(*seen, rng), rng)


@pytest.mark.parametrize("n", [3, 4, 50])
def test_align_finds_the_motion(n):
    rng = np.random.default_rng(n)
    p, R, t = rng.normal(size=(5, n, 3)), rotation(rng), rng.normal(size=3)
    found_R, found_t = rigid_motion(p, p @ R.T + t)
    assert_allclose(found_R, np.broadcast_to(R, (5, 3, 3)), atol=1e-9)
    assert_allclose(found_t, np.broadcast_to(t, (5, 3)), atol=1e-9)
    assert np.abs(found_R - R.T).max() > 0.1, "the inverse is another motion"


def test_align_gives_no_mirror():
    """Three points of a plane fit a mirror image as well; noise may even favour it."""
    rng = np.random.default_rng(2)
    p = rng.normal(size=(200, 4, 3)) * [1, 1, 0.01]
    q = p + rng.normal(0, 0.05, p.shape)
    R, _ = rigid_motion(p, q)
    assert_allclose(np.linalg.det(R), 1, atol=1e-9)
    mean = p.mean(1, keepdims=True), q.mean(1, keepdims=True)
    U, _, Vt = np.linalg.svd(np.swapaxes(q - mean[1], 1, 2) @ (p - mean[0]))
    assert np.linalg.det(U @ Vt).min() < 0, "without the correction mirrors do occur"


def test_triangulation_undoes_projection():
    pose = np.array([0.3, -0.2, 0.7])
    seen = CLEAN.project(pose, ROOM)
    visible = np.isfinite(seen).all(1)
    assert 20 < visible.sum() < len(ROOM)
    body = CLEAN.triangulate(seen[visible])
    c, s = np.cos(0.7), np.sin(0.7)
    x = pose[0] + c * body[:, 0] - s * body[:, 1]
    y = pose[1] + s * body[:, 0] + c * body[:, 1]
    assert_allclose(np.stack([x, y, body[:, 2] + 0.5], 1), ROOM[visible], atol=1e-9)
    assert (body[:, 0] > 0).all()


def test_pictures_without_noise_give_the_motion():
    rng = np.random.default_rng(3)
    for _ in range(5):
        before, step, after = random_step(rng)
        assert_allclose(measure(CLEAN, before, after, rng).increment, step, atol=1e-6)


def test_outliers_are_found_and_ruin_the_plain_alignment():
    rng = np.random.default_rng(4)
    odometer = StereoOdometer(outliers=0.4, sigma_pixel=0.3)
    robust, plain = [], []
    for _ in range(20):
        before, step, after = random_step(rng)
        pair = odometer.match(
            odometer.observe(before, ROOM, rng), odometer.observe(after, ROOM, rng), rng
        )
        motion = odometer.estimate(*pair, rng)
        assert 0.4 < motion.inliers.mean() < 0.8
        robust.append(motion.increment - step)
        R, _ = rigid_motion(odometer.triangulate(pair[0]), odometer.triangulate(pair[1]))
        plain.append(np.arctan2(R[0, 1] - R[1, 0], R[0, 0] + R[1, 1]) - step[2])
    assert np.abs(np.array(robust)[:, 2]).max() < 0.02
    assert np.abs(plain).max() > 0.1


def test_the_covariance_is_honest():
    rng, scores = np.random.default_rng(5), []
    for _ in range(250):
        before, step, after = random_step(rng)
        motion = measure(StereoOdometer(), before, after, rng)
        error = between(step, motion.increment)
        scores.append(error @ np.linalg.solve(motion.cov, error))
    # 3 is due; the band of 250 runs is 2.6 to 3.4, and the model is linearised.
    assert 2.4 < np.mean(scores) < 4.0
    forgetful = np.mean(scores) / 0.5
    assert not 2.4 < forgetful < 4.0, "the first picture's noise left out would be seen"


def test_more_noise_makes_larger_covariances():
    rng = np.random.default_rng(6)
    before, _, after = random_step(rng)
    sizes = [
        np.median([np.trace(measure(StereoOdometer(sigma_pixel=s), before, after, rng).cov)
                   for _ in range(5)])
        for s in (0.1, 0.4)
    ]  # fmt: skip
    assert 8 < sizes[1] / sizes[0] < 32, "variance goes with the square: 16"


def test_too_few_matches_are_named():
    rng = np.random.default_rng(7)
    with pytest.raises(ValueError, match="before: expected at least three matches, got 2"):
        StereoOdometer().estimate(np.ones((2, 3)), np.ones((2, 3)), rng)
    nonsense = rng.normal(0, 100, (2, 20, 3))
    with pytest.raises(ValueError, match="after: expected three matches that agree"):
        StereoOdometer(sigma_pixel=1e-3).estimate(*nonsense, rng)


def drives(odometer, rng, runs, n):
    """True and measured increments (runs, n, 3) of drives in circles."""
    true_steps, measured = [], []
    for _ in range(runs):
        step = np.array([rng.uniform(0.02, 0.1), 0.0, rng.uniform(-0.1, 0.1)])
        poses = [np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3)])]
        for _ in range(n):
            poses.append(compose(poses[-1], step))
        if isinstance(odometer, StereoOdometer):
            measured.append([m.increment for m in odometer.run(poses, ROOM, rng)])
        else:
            measured.append(odometer.measure(poses[:-1], poses[1:], rng))
        true_steps.append([step] * n)
    return np.array(true_steps), np.array(measured)


def flat(*arrays):
    return [array.reshape(-1, 3) for array in arrays]


def test_the_light_model_is_recovered_from_its_own_drives():
    truth = VisualOdometer.simple(0.002, 0.004, distance_error=0.1, turn_error=0.08)
    fitted = fit_noise(*flat(*drives(truth, np.random.default_rng(8), 400, 20)))
    for increment in ([0.03, 0, 0.02], [0.08, 0, 0], [0.05, 0, 0.08]):
        due, got = truth.cov(increment), fitted.cov(increment)
        assert_allclose(got.diagonal(), due.diagonal(), rtol=0.15)


def test_the_light_model_drifts_like_the_stereo_odometer():
    rng = np.random.default_rng(9)
    odometer = StereoOdometer(sigma_pixel=1.0, max_matches=25)
    true_steps, measured = drives(odometer, rng, 40, 20)
    light = fit_noise(*flat(true_steps, measured))
    poses = np.zeros((40, 21, 3))
    stereo = np.zeros((40, 21, 3))
    for k in range(20):
        poses[:, k + 1] = compose(poses[:, k], true_steps[:, k])
        stereo[:, k + 1] = compose(stereo[:, k], measured[:, k])
    drift = between(poses[:, -1], stereo[:, -1])
    many = np.repeat(poses, 20, 0)
    again = between(many[:, -1], light.run(many, rng)[:, -1])
    ratio = again.std(0) / drift.std(0)
    assert ((ratio > 0.6) & (ratio < 1.6)).all()
    # Errors of successive steps are as good as independent, which is what the model assumes.
    error = between(true_steps, measured)
    error -= error.mean((0, 1))
    correlation = (error[:, 1:] * error[:, :-1]).mean((0, 1)) / error.var((0, 1))
    assert np.abs(correlation).max() < 0.15


def test_heading_is_a_random_walk():
    rng = np.random.default_rng(10)
    odometer = VisualOdometer.simple(0.0, 0.01)
    track = odometer.run(np.zeros((4000, 101, 3)), rng)
    spread = track[:, :, 2].std(0)
    assert_allclose(spread[[25, 100]], [0.05, 0.1], rtol=0.06)


def test_noise_is_drawn_for_every_step_and_run():
    rng = np.random.default_rng(11)
    poses = np.zeros((3, 4, 3))
    steps = VisualOdometer.simple(0.01, 0.01).measure(poses, poses, rng)
    assert len(np.unique(steps)) == steps.size


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: StereoOdometer(focal=0), "focal"),
        (lambda: StereoOdometer(outliers=1.0), "outliers"),
        (lambda: StereoOdometer(max_matches=2), "max_matches"),
        (lambda: StereoOdometer(n_trials=0), "n_trials"),
        (lambda: StereoOdometer(camera_height=np.nan), "camera_height"),
        (lambda: room_points(3), "rng: expected a numpy"),
        (lambda: room_points(np.random.default_rng(0), 0), "n: expected at least 1"),
        (lambda: rigid_motion(np.zeros((3, 3)), np.zeros((4, 3))), "q: expected the shape of p"),
        (lambda: VisualOdometer(-np.eye(3), np.eye(3), np.eye(3)), "cov_step"),
        (lambda: VisualOdometer.simple(-1, 0), "sigma_position"),
        (lambda: fit_noise(np.zeros((9, 3)), np.zeros((9, 3))), "at least ten steps"),
        (lambda: fit_noise(np.zeros((9, 3)), np.zeros((8, 3))), "measured_steps: expected"),
        (lambda: CLEAN.project([0, 0], ROOM), "pose: expected shape"),
        (lambda: CLEAN.observe([0, 0, 0], ROOM, 1), "rng: expected a numpy"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_the_pixels_have_the_derivatives_of_central_differences():
    camera, rng = StereoOdometer(), np.random.default_rng(7)
    body = rng.uniform([1.0, -1.0, -0.5], [4.0, 1.0, 0.5], (20, 3))

    def differences(function, at, h=1e-5):
        steps = h * np.eye(3)[:, None]
        return np.stack((function(at + steps) - function(at - steps)) / (2 * h), -1)

    J = camera._pixel_jacobians(body)
    assert_allclose(J, differences(camera._pixels, body), rtol=1e-6, atol=1e-5)
    pixels = camera._pixels(body)
    assert_allclose(np.linalg.inv(J), differences(camera.triangulate, pixels), atol=1e-7)
    wrong = J.copy()
    wrong[:, 2, 0] *= -1  # a sign
    assert not np.allclose(wrong, differences(camera._pixels, body), rtol=1e-6, atol=1e-5)
