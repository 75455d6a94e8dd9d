"""P2 (12)-(18) in their Gaussian form: FastSLAM beside a Kalman filter and beside quadrature.

The world is linear, so that every integral has an exact answer; beside each right form stand the
ones that students and peers write.
"""

import numpy as np
import pytest

from slamlab.filters import kalman
from slamlab.filters.particle import lineage, systematic_resample
from slamlab.gaussian import Gaussian
from slamlab.models import LandmarkSensor, MotionModel
from slamlab.slam import FastSlam


class Shift(MotionModel):
    """x_k = x_{k-1} + B u dt for position and heading alike: a linear robot."""

    B = np.array([[1.0, 0.2], [-0.1, 0.8], [0.0, 0.0]])

    def step(self, pose, u, dt):
        return np.asarray(pose) + dt * np.asarray(u) @ self.B.T

    def jacobians(self, pose, u, dt):
        lead = np.broadcast_shapes(np.shape(pose)[:-1], np.shape(u)[:-1])
        return (
            np.broadcast_to(np.eye(3), (*lead, 3, 3)),
            np.broadcast_to(dt * self.B, (*lead, 3, 2)),
        )


class Offset(LandmarkSensor):
    """z = C (m - position) + noise: a linear sensor."""

    C = np.array([[1.1, 0.3], [-0.2, 0.9]])
    cov = np.array([[0.05, 0.01], [0.01, 0.08]])

    def observe(self, pose, landmark):
        return (np.asarray(landmark) - np.asarray(pose)[..., :2]) @ self.C.T

    def jacobians(self, pose, landmark):
        lead = np.broadcast_shapes(np.shape(pose)[:-1], np.shape(landmark)[:-1])
        H = np.broadcast_to(self.C, (*lead, 2, 2))
        return np.concatenate([-H, np.zeros((*lead, 2, 1))], -1), H

    def locate(self, pose, z):
        return np.asarray(pose)[..., :2] + np.asarray(z) @ np.linalg.inv(self.C).T

    def locate_jacobians(self, pose, z):
        lead = np.broadcast_shapes(np.shape(pose)[:-1], np.shape(z)[:-1])
        G = np.broadcast_to(np.linalg.inv(self.C), (*lead, 2, 2))
        eye = np.broadcast_to(np.eye(3)[:2], (*lead, 2, 3))
        return eye, G


class Scripted(np.random.Generator):
    """A generator whose normal draws are given: the test decides what is drawn."""

    def __init__(self, draws):
        super().__init__(np.random.PCG64(1))
        self.draws = list(draws)

    def standard_normal(self, size=None, dtype=np.float64, out=None):
        return np.broadcast_to(self.draws.pop(0), size).astype(float)


MOTION, SENSOR = Shift(), Offset()
U, DT, V = np.array([0.4, -0.3]), 0.5, np.array([[0.5, 0.1], [0.1, 0.3]])
Q = DT**2 * Shift.B[:2] @ V @ Shift.B[:2].T
C, R = Offset.C, Offset.cov
LANDMARKS = np.array([[1.0, 2.0], [-1.5, 0.5]])


def normal(x, mean, cov):
    d = np.asarray(x) - mean
    quadratic = np.einsum("...i,ij,...j->...", d, np.linalg.inv(cov), d)
    return np.exp(-0.5 * quadratic) / (2 * np.pi * np.sqrt(np.linalg.det(cov)))


def grid(mean, cov, n=241, sigmas=9.0):
    """Points (n, n, 2) around a Gaussian, and the area that each stands for."""
    half = sigmas * np.sqrt(np.diag(cov))
    axes = [np.linspace(m - h, m + h, n) for m, h in zip(mean, half, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    return points, (axes[0][1] - axes[0][0]) * (axes[1][1] - axes[1][0])


# (15): the landmark integrated out.

MU, SIGMA = np.array([0.7, 1.4]), np.array([[0.3, 0.1], [0.1, 0.2]])
X, Z = np.array([0.2, -0.1, 0.0]), np.array([0.9, 1.6])


def test_15_the_landmark_integrated_out_is_a_normal_density():
    points, area = grid(MU, SIGMA)
    due = (normal(Z, SENSOR.observe(X, points), R) * normal(points, MU, SIGMA)).sum() * area
    expected = SENSOR.observe(X, MU)
    assert normal(Z, expected, C @ SIGMA @ C.T + R) == pytest.approx(due, abs=1e-10)
    # Wrong: the landmark taken as known; its covariance not turned by H; R forgotten.
    assert abs(normal(Z, expected, R) - due) > 0.01
    assert abs(normal(Z, expected, SIGMA + R) - due) > 0.01
    assert abs(normal(Z, expected, C @ SIGMA @ C.T) - due) > 0.01


# (18): proposal and weight of version 2.0, one particle, two landmarks.


def prepared(version, draws, n_particles=1):
    """A filter that has seen both landmarks once, then moved; and what it measures next."""
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], n_particles, version, rng=Scripted(draws))
    slam.update(SENSOR.observe(np.zeros(3), LANDMARKS) + [[0.1, -0.2], [0.2, 0.1]], ids=[0, 1])
    slam.predict(U, DT, V)
    return slam, SENSOR.observe(np.array([0.45, 0.05, 0.0]), LANDMARKS)


def by_quadrature():
    """Mean, covariance and mass C of P(z | x) P(x | x_0, u), summed over a fine grid of poses."""
    before = FastSlam(MOTION, SENSOR, [0, 0, 0], 1, rng=np.random.default_rng(1))
    before.update(SENSOR.observe(np.zeros(3), LANDMARKS) + [[0.1, -0.2], [0.2, 0.1]], ids=[0, 1])
    means, covs = before.particle(0).landmarks, before.particle(0).landmark_covs
    z = SENSOR.observe(np.array([0.45, 0.05, 0.0]), LANDMARKS)
    expected = MOTION.step(np.zeros(3), U, DT)[:2]
    points, area = grid(expected, Q)
    density = normal(points, expected, Q)
    for one, mean, cov in zip(z, means, covs, strict=True):
        poses = np.concatenate([points, np.zeros((*points.shape[:2], 1))], -1)
        density = density * normal(one, SENSOR.observe(poses, mean), C @ cov @ C.T + R)
    mass = density.sum() * area
    mean = np.tensordot(density, points, 2) * area / mass
    d = points - mean
    return mean, np.einsum("ij,ija,ijb->ab", density, d, d) * area / mass, mass


def drawn(white, version=2):
    """Pose and evidence of the one particle if it draws this white noise."""
    slam, z = prepared(version, [np.zeros(2), np.asarray(white, float)])
    evidence = slam.update(z, ids=[0, 1])
    return slam.poses[0, :2], evidence


def test_18_the_proposal_is_the_normalised_product():
    mean, cov, _ = by_quadrature()
    centre, _ = drawn([0, 0])
    root = np.stack([drawn([1, 0])[0] - centre, drawn([0, 1])[0] - centre], 1)
    np.testing.assert_allclose(centre, mean, atol=1e-8)
    np.testing.assert_allclose(root @ root.T, cov, atol=1e-8)
    # Wrong: proposing from the motion alone, which is neither.
    assert np.abs(MOTION.step(np.zeros(3), U, DT)[:2] - mean).max() > 0.05
    assert np.abs(Q - cov).max() > 0.01


@pytest.mark.parametrize("white", [[0, 0], [1.3, -0.4], [-2.5, 3.0]])
def test_18_the_weight_is_the_mass_C_whatever_was_drawn(white):
    _, _, mass = by_quadrature()
    _, evidence = drawn(white)
    assert np.exp(evidence) == pytest.approx(mass, abs=1e-8)


def test_18_other_weights_are_not_C():
    _, _, mass = by_quadrature()
    slam, z = prepared(1, [np.zeros(2)])
    # Wrong: (17), the likelihood at the predicted pose, as the weight of 2.0.
    assert abs(np.exp(slam.update(z, ids=[0, 1])) - mass) > 0.01
    # Wrong: C of each landmark alone, multiplied: the pose is common to both.
    slam, z = prepared(2, [np.zeros(2), np.zeros(2), np.zeros(2)])
    particle = slam.particle(0)
    predicted = SENSOR.observe(np.append(MOTION.step(np.zeros(3), U, DT)[:2], 0), LANDMARKS)
    covs = C @ particle.landmark_covs @ C.T + R
    moved = predicted + SENSOR.observe(np.zeros(3), particle.landmarks - LANDMARKS)
    alone = [normal(*each, cov + C @ Q @ C.T) for *each, cov in zip(z, moved, covs, strict=True)]
    assert abs(np.prod(alone) / mass - 1) > 0.05
    # Right: the joint innovation, H Q H^T + H S H^T + R over both at once.
    tall = np.concatenate([-C, -C])
    joint = tall @ Q @ tall.T
    joint[:2, :2] += covs[0]
    joint[2:, 2:] += covs[1]
    y = (z - moved).ravel()
    peak = 1 / ((2 * np.pi) ** 2 * np.sqrt(np.linalg.det(joint)))
    together = peak * np.exp(-0.5 * y @ np.linalg.solve(joint, y))
    assert together == pytest.approx(mass, abs=1e-8)


# Dossier 18: the mixture of particles is the Kalman posterior, correlations included.


def measurements(steps=4, seed=3):
    """Controls are exact in the mean; both landmarks are seen at every step."""
    rng = np.random.default_rng(seed)
    pose, zs = np.zeros(3), []
    for k in range(steps):
        if k:
            noise = np.linalg.cholesky(V) @ rng.standard_normal(2)
            pose = MOTION.step(pose, U + noise, DT)
        noise = rng.standard_normal((2, 2)) @ np.linalg.cholesky(R).T
        zs.append(SENSOR.observe(pose, LANDMARKS) + noise)
    return zs


def kalman_slam(zs):
    """Exact joint posterior of position and both landmarks, (x, y, m1, m2)."""
    G = np.linalg.inv(C)
    mean = np.concatenate([np.zeros(2), (zs[0] @ G.T).ravel()])
    cov = np.zeros((6, 6))
    cov[2:4, 2:4] = cov[4:6, 4:6] = G @ R @ G.T
    belief = Gaussian(mean, cov)
    noise, B = np.zeros((6, 6)), np.zeros((6, 2))
    noise[:2, :2], B[:2] = Q, DT * Shift.B[:2]
    H = np.zeros((4, 6))
    H[:2, :2] = H[2:, :2] = -C
    H[:2, 2:4] = H[2:, 4:6] = C
    both = np.zeros((4, 4))
    both[:2, :2] = both[2:, 2:] = R
    for z in zs[1:]:
        belief = kalman.predict(belief, np.eye(6), noise, B, U)
        belief, _ = kalman.update(belief, z.ravel(), H, both)
    return belief


def fast_slam(zs, version, n_particles, seed=5):
    slam = FastSlam(
        MOTION, SENSOR, [0, 0, 0], n_particles, version, rng=np.random.default_rng(seed)
    )
    slam.update(zs[0], ids=["one", "two"])
    for z in zs[1:]:
        slam.predict(U, DT, V)
        slam.update(z, ids=["one", "two"])
    return slam


PLACE = [0, 1, 3, 4, 5, 6]
# Covariances within the position, and within each landmark.
SAME_PLACE = np.kron(np.eye(3), np.ones((2, 2))) > 0


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("n_particles", [300, 3000, 20_000])
def test_dossier_18_the_mixture_converges_to_the_kalman_posterior(version, n_particles):
    # Four runs together: one alone is a draw from a wide distribution, over 3 now and then.
    zs = measurements()
    due = kalman_slam(zs)
    right, uncorrelated = [], []
    for seed in range(4):
        slam = fast_slam(zs, version, n_particles, seed)
        mean, cov = slam.mean[PLACE], slam.cov[np.ix_(PLACE, PLACE)]
        right.append(deviation(mean, cov, due))
        # Wrong: P5, correlations are ignored.
        uncorrelated.append(deviation(mean, np.where(SAME_PLACE, cov, 0), due))
    assert np.sqrt(np.mean(np.square(right))) < 3 / np.sqrt(n_particles)
    assert np.sqrt(np.mean(np.square(uncorrelated))) > 4 / np.sqrt(n_particles)


def test_dossier_18_what_p5_says_and_what_peers_do_is_not_the_kalman_posterior():
    zs, N = measurements(), 30_000
    due, slam = kalman_slam(zs), fast_slam(zs, 2, N)
    one, two = slice(2, 4), slice(4, 6)
    correlated = due.cov[one, two]
    allowed = 3 / np.sqrt(N) * np.outer(due.sigma[one], due.sigma[two])
    # P5: correlations are ignored. They are there, far above the noise of sampling.
    assert (np.abs(np.diag(correlated)) > 5 * np.diag(allowed)).all()
    # Wrong: the mean of the particles' covariances, without their spread.
    _, covs = slam.landmark_estimates
    average = np.tensordot(slam.weights, covs, 1)
    assert (average[0][[0, 1], [0, 1]] < 0.8 * np.diag(due.cov[one, one])).all()
    # Wrong: the map of the heaviest particle alone.
    assert np.abs(slam.particle(0).landmark_covs[0] - due.cov[one, one]).max() > allowed.max()


def hand_written(zs, n, seed, draw=True, share=False, update_weights=True):
    """FastSLAM 2.0 for this linear world in its shortest form; the flags are peers' mistakes."""
    rng = np.random.default_rng(seed)
    G, W = np.linalg.inv(C), np.linalg.inv
    x, log_w = np.zeros((n, 2)), np.zeros(n)
    m, S = np.tile(zs[0] @ G.T, (n, 1, 1)), np.tile(G @ R @ G.T, (n, 2, 1, 1))
    for z in zs[1:]:
        x = x + DT * U @ Shift.B[:2].T
        Zc = C @ S @ C.T + R
        precision = W(Q) + (C.T @ W(Zc) @ C).sum(1)
        y = z - (m - x[:, None]) @ C.T
        pull = -(C.T @ W(Zc) @ y[..., None]).sum(1)
        mean, cov = x + (W(precision) @ pull)[..., 0], W(precision)
        tall = np.concatenate([C, C])
        joint = np.tile(tall @ Q @ tall.T, (n, 1, 1))
        joint[:, :2, :2] += Zc[:, 0]
        joint[:, 2:, 2:] += Zc[:, 1]
        flat = y.reshape(n, 4, 1)
        fit = (np.swapaxes(flat, 1, 2) @ W(joint) @ flat)[:, 0, 0]
        if update_weights:
            log_w = log_w - 0.5 * fit - 0.5 * np.linalg.slogdet(joint)[1]
        noise = rng.standard_normal((n, 2, 1)) if draw else np.zeros((n, 2, 1))
        x = mean + (np.linalg.cholesky(cov) @ noise)[..., 0]
        y = z - (m - x[:, None]) @ C.T
        K = S @ C.T @ W(Zc)
        m, S = m + (K @ y[..., None])[..., 0], S - K @ C @ S
        w = np.exp(log_w - log_w.max())
        w /= w.sum()
        if 1 / (w @ w) < n / 2:
            keep = systematic_resample(w, rng)
            x, log_w = x[keep], np.zeros(n)
            # A peer's copies point at one array: the map of the last copy is everybody's.
            m, S = (m[keep], S[keep]) if not share else (m, S)
    w = np.exp(log_w - log_w.max())
    w /= w.sum()
    state = np.concatenate([x, m.reshape(n, 4)], 1)
    mean = w @ state
    cov = ((state - mean) * w[:, None]).T @ (state - mean)
    cov[2:4, 2:4] += np.tensordot(w, S[:, 0], 1)
    cov[4:6, 4:6] += np.tensordot(w, S[:, 1], 1)
    return mean, cov


def deviation(mean, cov, due):
    """Root mean square over the 6 means and 21 covariances, in units of the sigmas."""
    off_mean = (mean - due.mean) / due.sigma
    off_cov = (cov - due.cov) / np.outer(due.sigma, due.sigma)
    return np.sqrt(np.mean(np.concatenate([off_mean, off_cov[np.triu_indices(6)]]) ** 2))


@pytest.mark.parametrize(
    "mistake",
    [
        pytest.param({}, id="none"),
        pytest.param({"draw": False}, id="a 2.0 that draws no sample"),
        pytest.param({"share": True}, id="copies keep the maps of the dead"),
        pytest.param({"update_weights": False}, id="weights forgotten"),
    ],
)
def test_peers_mistakes_leave_the_kalman_posterior(mistake):
    zs, n = measurements(steps=12), 10_000
    due = kalman_slam(zs)
    away = np.mean([deviation(*hand_written(zs, n, seed, **mistake), due) for seed in range(3)])
    # Longer runs need more than 3/sqrt(N): resampling has thrown its dice more often by then.
    assert (away < 5 / np.sqrt(n)) == (not mistake), away
    assert (away > 6 / np.sqrt(n)) == bool(mistake), away


# Dossier 19: the weights of 2.0 vary less. Dossier 20: systematic counts.


def test_dossier_19_the_weights_of_version_2_vary_less():
    zs = measurements()
    variances = {}
    for version in (1, 2):
        spread = []
        for seed in range(20):
            slam = fast_slam(zs[:2], version, 300, seed)
            slam.predict(U, DT, V)
            slam._cloud.log_weights = np.full(300, -np.log(300))
            slam._cloud._threshold = 0.0
            slam.update(zs[2], ids=["one", "two"])
            spread.append((300 * slam.weights).var())
        variances[version] = np.array(spread)
    assert (variances[2] < 0.5 * variances[1]).all()
    assert (variances[2] > 0).all()


def test_dossier_20_a_particle_is_copied_as_often_as_its_weight_says():
    rng = np.random.default_rng(2)
    n, copies, weights = 50, [], None
    for _ in range(400):
        w = np.random.default_rng(7).exponential(size=n) ** 2
        weights = w / w.sum()
        chosen = systematic_resample(weights, rng)
        copies.append(np.bincount(chosen, minlength=n))
    copies = np.array(copies)
    assert (copies >= np.floor(n * weights)).all()
    assert (copies <= np.ceil(n * weights)).all()
    assert np.abs(copies.mean(0) - n * weights).max() < 0.1
    # Wrong: independent draws leave that band.
    independent = np.bincount(rng.choice(n, n, p=weights), minlength=n)
    assert (np.abs(independent - n * weights) > 1).any()


# (12): the map given the path.


def smoothing_information(steps=3):
    """Information matrix of the positions x_0 .. x_steps and both landmarks, two numbers each."""
    n = steps + 3
    whole = np.zeros((2 * n, 2 * n))

    def add(i, j, weight, A, B):
        rows = np.r_[2 * i : 2 * i + 2, 2 * j : 2 * j + 2]
        J = np.concatenate([A, B], 1)
        whole[np.ix_(rows, rows)] += J.T @ weight @ J

    whole[:2, :2] += 1e6 * np.eye(2)
    for k in range(steps):
        add(k, k + 1, np.linalg.inv(Q), -np.eye(2), np.eye(2))
    for k in range(steps + 1):
        for j in (steps + 1, steps + 2):
            add(k, j, np.linalg.inv(R), -C, C)
    return whole


def test_12_landmarks_are_independent_given_the_path_and_only_then():
    whole = smoothing_information()
    given_path = np.linalg.inv(whole[-4:, -4:])
    assert np.abs(given_path[:2, 2:]).max() == 0.0
    # Wrong: given the last position alone, or given nothing, they are not.
    given_last = np.linalg.inv(np.delete(np.delete(whole, [6, 7], 0), [6, 7], 1))[-4:, -4:]
    given_nothing = np.linalg.inv(whole)[-4:, -4:]
    for cov in (given_last, given_nothing):
        assert np.abs(cov[:2, 2:]).max() > 0.05 * np.abs(cov[:2, :2]).max()


# "Cannot forget": what the set of particles forgets.


def family(zs, threshold):
    """A filter after all measurements, its poses (T, M, 3) and forefathers (T, M)."""
    rng = np.random.default_rng(1)
    slam = FastSlam(MOTION, SENSOR, [0, 0, 0], 100, rng=rng, threshold=threshold)
    poses, ancestors = [], []
    for k, z in enumerate(zs):
        if k:
            slam.predict(U, DT, V)
        slam.update(z, ids=[0, 1])
        poses.append(slam.poses)
        ancestors.append(slam.ancestors)
    return slam, np.array(poses), lineage(ancestors)


def test_p2_text_all_particles_soon_descend_from_one():
    zs = measurements(steps=60)
    _, poses, rows = family(zs, 0.5)
    assert len(np.unique(rows[0])) == 1
    assert len(np.unique(rows[-1])) > 30
    # The first pose of all stories is one pose: its disagreement is 0, the truth's is not.
    assert np.ptp(poses[10][rows[10]], axis=0).max() == 0.0
    # Without resampling nothing dies (and after a while one particle has all the weight).
    kept, _, rows = family(zs, 0.0)
    assert len(np.unique(rows[0])) == 100
    assert kept.ess < 5
