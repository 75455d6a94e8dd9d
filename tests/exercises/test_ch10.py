"""Exercises of chapter 10: right answers pass, wrong ones are named, the stub is friendly."""

import numpy as np
import pytest

from slamlab.exercises import ch10_convergence_consistency_and_cost as ch

EXERCISES = {
    "difference_cov": (ch.check_difference_cov, ch.difference_cov, ch.MISTAKES_DIFFERENCE_COV),
    "predict_cov": (ch.check_predict_cov, ch.predict_cov, ch.MISTAKES_PREDICT_COV),
    "accounts": (ch.check_accounts, ch.accounts, ch.MISTAKES_ACCOUNTS),
}
WRONG = [
    pytest.param(check, wrong, message, id=f"{name}-{number}")
    for name, (check, _, mistakes) in EXERCISES.items()
    for number, (message, wrong) in enumerate(mistakes.items())
]


def by_a_matrix(P):
    """Another right answer: m1 - m2 is a linear map of the state."""
    A = np.zeros((2, 7))
    A[:, 3:5], A[:, 5:7] = np.eye(2), -np.eye(2)
    return (A @ P @ A.T).tolist()


def block_by_block(P, F, Q):
    """Another right answer: the blocks of P1 (11), in place."""
    P[:3, 3:] = F @ P[:3, 3:]
    P[3:, :3] = P[:3, 3:].T
    P[:3, :3] = F @ P[:3, :3] @ F.T + Q
    return P


def by_square_roots(Phi, Psi, theta, H, S, v, K):
    """Another right answer: whiten the measurement first."""
    root = np.linalg.cholesky(S)
    A, w = np.linalg.solve(root, H @ Phi), np.linalg.solve(root, v)
    return [(np.eye(len(Phi)) - K @ H) @ Phi, Psi + A.T @ A, theta + A.T @ w]


@pytest.mark.parametrize("name", EXERCISES)
def test_at_least_five_wrong_answers_are_known(name):
    assert len(EXERCISES[name][2]) >= 5


@pytest.mark.parametrize("name", EXERCISES)
def test_the_solution_passes(name):
    check, solution, _ = EXERCISES[name]
    assert check(solution).passed


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch.check_difference_cov, by_a_matrix),
        (ch.check_predict_cov, block_by_block),
        (ch.check_accounts, by_square_roots),
    ],
)
def test_another_right_answer_passes(check, answer):
    assert check(answer).passed


@pytest.mark.parametrize("name", EXERCISES)
def test_the_stub_gets_the_friendly_line_and_nothing_else(name):
    report = EXERCISES[name][0](lambda *arguments: ...)
    assert len(report.text.splitlines()) == 2
    assert "nothing returned yet" in report.text


@pytest.mark.parametrize(("check", "wrong", "message"), WRONG)
def test_each_wrong_answer_is_caught_with_its_own_message(check, wrong, message):
    report = check(wrong)
    assert not report.passed
    assert report.messages == (message,)
