"""Answers that readers might give: no wrong one passes or is named wrongly, no right one fails.

The mistakes that the checks list are wrong answers too: `test_checks` tries each of them.
"""

import numpy as np
import pytest
from test_checks import CHECKS

from slamlab.exercises._general import NEARLY
from slamlab.exercises._values import pairs

HALF = np.pi / 2


def answer(check, *edits):
    """The reference with pieces of its source replaced."""
    return CHECKS[check].mistaken(edits)


def forward_jacobian(pose, masts, boom, h=1e-7):
    reference = CHECKS["ch03.check_readings"].reference
    columns = [
        (reference(pose + h * axis, masts, boom) - reference(pose, masts, boom)) / h
        for axis in np.eye(3)
    ]
    return np.array(columns).T


def by_tangent(z, predicted):
    return np.arctan(np.tan(z - predicted))


def by_matrices(known, k, odometry):
    def matrix(x, y, turn):
        c, s = np.cos(turn), np.sin(turn)
        return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])

    T, poses = matrix(*known), []
    for motion in odometry[:k][::-1]:
        T = np.linalg.solve(matrix(*motion).T, T.T).T
    for motion in [np.zeros(3), *odometry]:
        T = T @ matrix(*motion)
        poses.append([T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])])
    return poses


def walk(weights, u, n):
    chosen, total, i, M = [], weights[0], 0, len(weights)
    for tooth in range(n):
        while total <= (tooth + u) / n and i < M - 1:
            i += 1
            total += weights[i]
        chosen.append(i)
    return chosen


def in_ten_parts(mean, cov, u, dt, sigma):
    """The motion in ten parts with the same push and the same noise, and its derivatives."""
    x, J = np.append(mean, u), np.eye(4)
    part = np.eye(4)
    h = dt / 10
    part[0, 1:] = h, -(h**2) / 2, h**2 / 2
    part[1, 2:] = -h, h
    for _ in range(10):
        x, J = part @ x, part @ J
    P = np.zeros((4, 4))
    P[:3, :3], P[3, 3] = cov, sigma**2
    return x[:3], (J @ P @ J.T)[:3, :3]


def all_at_once(mean, cov, z, H, variances):
    there = ~np.isnan(z)
    H, R = H[there], np.diag(variances[there])
    K = np.linalg.solve(H @ cov @ H.T + R, H @ cov).T
    return mean + K @ (z[there] - H @ mean), cov - K @ H @ cov


RIGHT = {
    "ch00.check_path_through": [by_matrices],
    "ch02.check_predict": [in_ten_parts],
    "ch02.check_update": [all_at_once],
    "ch02.check_cov_after_update": [
        lambda P, K, H, R: P - K @ H @ P - P @ H.T @ K.T + K @ (H @ P @ H.T + R) @ K.T
    ],
    "ch03.check_innovation": [by_tangent],
    "ch03.check_jacobian": [forward_jacobian],
    "ch04.check_particles_needed": [
        lambda chance, sizes, r: np.ceil(
            np.log10(1 - chance) / np.log10(1 - np.exp(np.log(2 * r / sizes).sum()))
        )
    ],
    "ch04.check_resample": [
        lambda x, w, cell, per_cell, u: walk(
            w, u, per_cell * len(set((x[walk(w, u, len(w))] // cell).tolist()))
        )
    ],
    "ch19.check_slide": [
        lambda stored, scan: [
            np.nanmean(np.abs(np.roll(stored, -m)[:: len(stored) // len(scan)] - scan))
            for m in range(len(stored))
        ]
    ],
}

# Wrong answers that no check lists as they are, and a piece of what is to be said ("" for
# nothing: the first entry that differs has to do).
WRONG = [
    ("ch00.check_path_through", lambda p, k, o: np.zeros((len(o) + 1, 3)), "is zero"),
    (
        "ch00.check_path_through",
        lambda p, k, o: answer("ch00.check_path_through")(p, 0, o),
        "dead reckoning from the known pose",
    ),
    (
        "ch00.check_edge_error",
        lambda *given: 2 * answer("ch00.check_edge_error")(*given),
        "twice",
    ),
    ("ch01.check_predict", lambda b, *p: b, "`belief` was returned unchanged"),
    ("ch01.check_update", lambda b, *p: print(end=""), "`return` is missing"),
    ("ch02.check_predict", lambda *a: answer("ch02.check_predict")(*a)[::-1], "exchanged"),
    ("ch02.check_predict", lambda *a: answer("ch02.check_predict")(*a)[0], "only `mean`"),
    (
        "ch02.check_predict",
        answer("ch02.check_predict", "F @ cov => F @ (2 * cov)"),
        "`cov` counts twice",
    ),
    ("ch02.check_update", lambda m, P, z, H, r: (m, np.linalg.inv(P)), ""),
    ("ch02.check_update", answer("ch02.check_update", "+ variance => + variance / 2"), "twice"),
    ("ch02.check_cov_after_update", lambda P, K, H, R: np.linalg.inv(P), ""),
    ("ch03.check_readings", lambda p, m, b: [1, 2, 3, 4], "shape"),
    ("ch03.check_innovation", lambda z, p: z + p, ""),
    ("ch03.check_jacobian", lambda p, m, b: forward_jacobian(p, m, b, 1e-3), "almost right"),
    ("ch04.check_particles_needed", lambda *a: 100, ""),
    ("ch04.check_resample", lambda *a: answer("ch04.check_resample")(*a)[::-1], "reverse order"),
    ("ch04.check_sonar", lambda z, e, s, p, r: np.log(p) - 0.5 * ((z - e) / s) ** 2, ""),
    ("ch05.check_wheels", lambda *a: -answer("ch05.check_wheels")(*a), "turn the other way"),
    (
        "ch05.check_noise",
        lambda t, u, dt, V: answer("ch05.check_noise")(np.deg2rad(t), u, dt, V),
        "degrees",
    ),
    ("ch09.check_add_landmark", lambda P, *a: answer("ch09.check_add_landmark")(P, *a)[:-1], ""),
    (
        "ch10.check_predict_cov",
        answer("ch10.check_predict_cov", "A.T + N => A.T - N"),
        "`Q` counts with the wrong sign",
    ),
    ("ch11.check_one_by_one", lambda *a: -answer("ch11.check_one_by_one")(*a), "sign"),
    ("ch12.check_proposal", lambda x, *a: answer("ch12.check_proposal")(x, *a)[::-1], "exchanged"),
    (
        "ch19.check_between_beams",
        lambda misfits: answer("ch19.check_between_beams")(np.roll(misfits, 1)),
        "",
    ),
]


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_answer_written_differently_passes(name):
    for student in RIGHT[name]:
        report = CHECKS[name](student)
        assert report.passed, report


@pytest.mark.parametrize(("name", "wrong", "said"), WRONG, ids=[str(k) for k in range(len(WRONG))])
def test_a_wrong_answer_fails_and_hears_what_is_wrong(name, wrong, said):
    report = CHECKS[name](wrong)
    assert not report.passed
    assert said in "\n".join([report.text, *report.messages])  # a hunt does not show its bug


def test_more_than_three_hundred_wrong_answers_are_known():
    assert sum(len(check.mistakes) for check in CHECKS.values()) > 300


def test_what_is_named_explains_everything_that_was_returned():
    """An answer with two mistakes is not named after one of them."""
    for name, check in CHECKS.items():
        if not check.mistakes or isinstance(check.due[0], str):
            continue
        wrong = [check.mistaken(mistake) for mistake in check.mistakes.values()]

        def mixed(*given, a=wrong[0], b=wrong[-1]):
            """Make the first listed mistake on one half of the inputs, the last on the other."""
            first = np.asarray(given[0], dtype=float).sum() if len(given) else 0.0
            return (a if int(1e6 * first) % 2 else b)(*given)

        observed = check.observe(mixed)
        report = check.judge(observed)
        assert not set(report.messages) & (set(check.mistakes) | set(NEARLY)) or all(
            check._alike(check._look(check.mistaken(check.mistakes[m]), check.inputs[k][1]), seen)
            for m in report.messages
            if m in check.mistakes
            for k, seen in enumerate(observed)
        ), name


def test_references_answer_where_the_text_promises_an_answer():
    none = np.zeros((0, 2)), np.zeros((0, 2, 2)), np.array([6.6, 9.2])
    assert CHECKS["ch11.check_nearest"].reference(*none) == -1
    line = np.array([[0.0, 0.0], [1.0, 2.0], [0.0, 0.0], [0.0, 0.0]])
    kappa, v = CHECKS["ch17.check_bend"].reference(line, np.array([0.5]), np.array([0.4, 1.5]))
    assert (kappa, v) == (0.0, 0.4)
    for check in CHECKS.values():
        assert not any(seen.raised for seen in check.observe(check.reference))


def test_an_edge_that_raises_is_told_and_not_counted():
    def without_guard(y, S, gates):
        met = np.flatnonzero(~np.isnan(y).any(axis=0))
        y, S = y[:, met], S[:, met][:, :, met]
        distance = np.einsum("ni,nij,nj->n", y, np.linalg.inv(S), y)
        row = np.argmin(distance)
        return row if distance[row] < gates[len(met) - 1] and len(met) else -1

    report = CHECKS["ch11.check_nearest"](without_guard)
    assert report.passed
    assert "your function raised ValueError" in report.text


def test_no_expected_angle_hangs_on_a_last_bit():
    """Where pi is expected, right answers may round to -pi: a property must say so."""
    whole_beams = {"ch06.check_beam_angles"}  # pi exactly, however written
    for name, check in CHECKS.items():
        if name not in whole_beams:
            for (said, _), due in zip(check.inputs, check.due, strict=True):
                parts = pairs(due, due)
                if not isinstance(parts, str) and any(
                    (np.abs(np.abs(p) - np.pi) < 1e-6).any() for p, _ in parts
                ):
                    assert "pi, not -pi" in said, (name, said)
