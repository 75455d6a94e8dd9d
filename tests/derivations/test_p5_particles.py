"""P5 (14), (15) and P2 (1)-(5), (13)-(18) on a world small enough to enumerate every history.

A robot on a ring of five cells carries one unknown bit of map (is there a door in cell 3?). Every
trajectory and both maps can be listed, so each recursion has an exact answer beside it.
"""

import itertools

import numpy as np
import pytest

from slamlab.filters.particle import ParticleFilter

CELLS, STEPS = 5, 4
MAPS = np.array([[1, 0, 1, 0, 0], [1, 0, 1, 1, 0]])  # doors; the bit is cell 3
CONTROLS = [1, 1, 0, 1]
MEASURED = [0, 1, 1, 1]  # 1: "door"


def motion(u):
    """P(x_k | x_{k-1}, u): (from, to); it slips, stays or overshoots."""
    P = np.zeros((CELLS, CELLS))
    for x in range(CELLS):
        for extra, p in ((-1, 0.15), (0, 0.7), (1, 0.15)):
            P[x, (x + u + extra) % CELLS] += p
    return P


def seen(z):
    """P(z | x, m): (map, cell)."""
    p_door = np.where(MAPS == 1, 0.8, 0.25)
    return p_door if z else 1 - p_door


START = np.array([0.4, 0.3, 0.1, 0.1, 0.1])
PRIOR_MAP = np.array([0.5, 0.5])


def joint_by_enumeration(controls, measured, unmeasured=False):
    """P(x_k, m | Z, U), (1), from the full list of histories; optionally the last z left out."""
    joint = np.zeros((2, CELLS))
    steps = len(controls)
    for m in range(2):
        for path in itertools.product(range(CELLS), repeat=steps + 1):
            p = PRIOR_MAP[m] * START[path[0]]
            for k in range(steps):
                p *= motion(controls[k])[path[k], path[k + 1]]
                if not (unmeasured and k == steps - 1):
                    p *= seen(measured[k])[m, path[k + 1]]
            joint[m, path[-1]] += p
    return joint / joint.sum()


def recursion(controls, measured, predict=True, divide=True):
    """P2 (4) and (5), on the joint of map and cell."""
    joint = PRIOR_MAP[:, None] * START
    for u, z in zip(controls, measured, strict=True):
        joint = joint @ motion(u) if predict else joint
        joint = seen(z) * joint
        joint = joint / joint.sum() if divide else joint
    return joint


def test_p2_1_4_5_the_recursion_equals_the_enumeration():
    due = joint_by_enumeration(CONTROLS, MEASURED)
    np.testing.assert_allclose(recursion(CONTROLS, MEASURED), due, atol=1e-15)
    # Wrong forms: no time update; no division by P(z | Z), so that nothing sums to one.
    assert np.abs(recursion(CONTROLS, MEASURED, predict=False) - due).max() > 0.05
    assert abs(recursion(CONTROLS, MEASURED, divide=False).sum() - 1) > 0.5


def test_p2_4_the_time_update_alone():
    before = joint_by_enumeration(CONTROLS[:2], MEASURED[:2])
    due = joint_by_enumeration(CONTROLS[:3], MEASURED[:3], unmeasured=True)
    np.testing.assert_allclose(before @ motion(CONTROLS[2]), due, atol=1e-15)
    assert np.abs(before @ motion(1).T - due).max() > 0.02


def test_p2_5_the_divisor_is_the_predicted_probability_of_the_measurement():
    predicted = recursion(CONTROLS[:3], MEASURED[:3]) @ motion(CONTROLS[3])
    due = recursion(CONTROLS, MEASURED)
    np.testing.assert_allclose(
        seen(MEASURED[3]) * predicted / (seen(MEASURED[3]) * predicted).sum(), due, atol=1e-15
    )


def test_p2_2_measurements_are_independent_given_pose_and_map_only():
    # Two looks at once: given (x, m) their joint factors; after summing (x, m) out it does not.
    belief = recursion(CONTROLS, MEASURED)
    both = np.array([[(belief * seen(a) * seen(b)).sum() for b in (0, 1)] for a in (0, 1)])
    alone = np.array([(belief * seen(a)).sum() for a in (0, 1)])
    np.testing.assert_allclose(both.sum(0), alone, atol=1e-15)
    assert np.abs(both - np.outer(alone, alone)).max() > 0.01


def test_p2_unnumbered_pose_and_map_do_not_separate():
    joint = recursion(CONTROLS, MEASURED)
    product = joint.sum(1, keepdims=True) * joint.sum(0, keepdims=True)
    assert np.abs(joint - product).max() > 0.005


def map_given_path(path, measured, upto):
    """P(m | X_{0:k}, Z_{0:k}) of one trajectory: the map is a Bayes update on known poses."""
    p = PRIOR_MAP.copy()
    for k in range(upto):
        p = p * seen(measured[k])[:, path[k + 1]]
    return p / p.sum()


def test_p2_12_the_joint_factors_exactly_into_map_given_path_and_path():
    total, due = np.zeros((2, CELLS)), joint_by_enumeration(CONTROLS, MEASURED)
    for path in itertools.product(range(CELLS), repeat=STEPS + 1):
        weight = path_weight(path)
        total[:, path[-1]] += map_given_path(path, MEASURED, STEPS) * weight
    np.testing.assert_allclose(total / total.sum(), due, atol=1e-15)


def path_weight(path):
    """P(X, Z | U) of one trajectory by (15) and (17): product of motion and (15)."""
    p = START[path[0]]
    for k in range(STEPS):
        p *= motion(CONTROLS[k])[path[k], path[k + 1]] * likelihood_15(path, k)
    return p


def likelihood_15(path, k):
    """P2 (15): the measurement given the trajectory, the map summed out."""
    return float(seen(MEASURED[k])[:, path[k + 1]] @ map_given_path(path, MEASURED, k))


def test_p2_15_summing_the_map_out_needs_the_map_of_this_path():
    # Wrong: the prior map in (15). The product is then no longer P(Z | X).
    path = (0, 3, 3, 3, 3)
    right = np.prod([likelihood_15(path, k) for k in range(STEPS)])
    due = sum(
        PRIOR_MAP[m] * np.prod([seen(MEASURED[k])[m, path[k + 1]] for k in range(STEPS)])
        for m in range(2)
    )
    wrong = np.prod([seen(MEASURED[k])[:, path[k + 1]] @ PRIOR_MAP for k in range(STEPS)])
    assert right == pytest.approx(due, abs=1e-16)
    assert abs(wrong - due) > 0.01


# A proposal that is neither the motion nor the optimum.
PROPOSAL = np.full((CELLS, CELLS), 0.12) + 0.4 * np.eye(CELLS)


def weighted_paths(weight_step):
    """Expected weighted particles: every path with its proposal probability times its weight."""
    belief = np.zeros(CELLS)
    for path in itertools.product(range(CELLS), repeat=STEPS + 1):
        drawn, weight = START[path[0]], 1.0
        for k in range(STEPS):
            pi = PROPOSAL[path[k], path[k + 1]]
            drawn *= pi
            p = motion(CONTROLS[k])[path[k], path[k + 1]]
            weight = weight_step(weight, likelihood_15(path, k), p, pi)
        belief[path[-1]] += drawn * weight
    return belief / belief.sum()


def test_p2_13_14_importance_weights_repair_any_proposal():
    due = joint_by_enumeration(CONTROLS, MEASURED).sum(0)
    np.testing.assert_allclose(
        weighted_paths(lambda w, like, p, pi: w * like * p / pi), due, atol=1e-15
    )


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(lambda w, like, p, pi: w * like * p, id="division by the proposal forgotten"),
        pytest.param(lambda w, like, p, pi: like * p / pi, id="old weight forgotten"),
        pytest.param(lambda w, like, p, pi: w * like / pi, id="motion model forgotten"),
        pytest.param(lambda w, like, p, pi: w * p / pi, id="likelihood forgotten"),
    ],
)
def test_p2_14_each_forgotten_factor_gives_another_belief(wrong):
    due = joint_by_enumeration(CONTROLS, MEASURED).sum(0)
    assert np.abs(weighted_paths(wrong) - due).max() > 0.01


def test_p2_16_17_proposing_from_the_motion_leaves_the_likelihood():
    belief = np.zeros(CELLS)
    for path in itertools.product(range(CELLS), repeat=STEPS + 1):
        drawn = START[path[0]]
        weight = 1.0
        for k in range(STEPS):
            drawn *= motion(CONTROLS[k])[path[k], path[k + 1]]
            weight *= likelihood_15(path, k)
        belief[path[-1]] += drawn * weight
    due = joint_by_enumeration(CONTROLS, MEASURED).sum(0)
    np.testing.assert_allclose(belief / belief.sum(), due, atol=1e-15)


def test_p2_18_the_optimal_proposal_has_weights_that_do_not_depend_on_the_draw():
    path = (0, 1, 2, 3)  # a trajectory up to step 3; the fourth step is to be drawn
    k = 3
    p_map = map_given_path(path, MEASURED, k)
    step, like = motion(CONTROLS[k])[path[k]], p_map @ seen(MEASURED[k])
    C = (like * step).sum()
    optimal = like * step / C
    allowed = optimal > 0
    weight = like[allowed] * step[allowed] / optimal[allowed]
    np.testing.assert_allclose(weight, C, rtol=1e-14)
    # Proposing from the motion alone, the weight varies with the draw.
    assert np.ptp(like[allowed]) > 0.1


def test_p2_unnumbered_sample_average_needs_the_weights():
    # P(x2) = sum w P(x2 | x1): with unequal weights the plain average is another distribution.
    weights = recursion(CONTROLS, MEASURED).sum(0)
    exact = weights @ motion(1)
    assert np.abs(motion(1).mean(0) - exact).max() > 0.05


# P5 (14), (15): the same, for the particle filter of the library.


def particle_belief(N, seed, threshold=0.5, forget=None):
    """Library filter on (cell, map bit): x_k = f(x_{k-1}, w_k), (14); y_k = h(x_k, v_k), (15)."""
    rng = np.random.default_rng(seed)
    start = np.column_stack([rng.choice(CELLS, N, p=START), rng.integers(0, 2, N)])
    belief = ParticleFilter(start, rng, threshold=threshold)

    def propose(state, rng, u):
        cell, bit = state[:, 0].astype(int), state[:, 1]
        cumulative = PROPOSAL.cumsum(1)[cell]
        drawn = np.minimum((cumulative < rng.random((N, 1))).sum(1), CELLS - 1)
        ratio = np.log(np.maximum(motion(u)[cell, drawn], 1e-300) / PROPOSAL[cell, drawn])
        moved = np.column_stack([drawn, bit])
        return moved if forget == "ratio" else (moved, ratio)

    for u, z in zip(CONTROLS, MEASURED, strict=True):
        if forget == "old weights":
            belief.log_weights = np.full(N, -np.log(N))
        belief.predict(lambda state, rng, u=u: propose(state, rng, u))
        belief.update(lambda s, z=z: np.log(seen(z)[s[:, 1].astype(int), s[:, 0].astype(int)]))
    joint = np.zeros((2, CELLS))
    cells = belief.particles.astype(int)
    np.add.at(joint, (cells[:, 1], cells[:, 0]), belief.weights)
    return joint, (belief.weights**2).sum() ** 0.5


def errors_allowed(N, threshold, forget=None):
    """Largest error of a cell, in standard deviations of a share of that many equal draws."""
    due = joint_by_enumeration(CONTROLS, MEASURED)
    # Four clouds; particles that never resample are worth as many draws as their weights say.
    clouds = [particle_belief(N // 4, seed, threshold, forget) for seed in range(4)]
    sigma = max(np.mean([one[1] for one in clouds]) / 2, N**-0.5)
    return np.abs(np.mean([one[0] for one in clouds], axis=0) - due).max() / sigma


@pytest.mark.parametrize("threshold", [0.0, 0.5, 1.0])
def test_p5_14_15_particles_converge_to_the_enumerated_belief(threshold):
    # Resampling adds noise of its own, which the last weights do not show.
    assert errors_allowed(200_000, threshold) < 6


@pytest.mark.parametrize("forget", ["ratio", "old weights"])
def test_p5_14_15_particles_with_a_forgotten_factor_do_not(forget):
    assert errors_allowed(200_000, 0.0, forget) > 6
