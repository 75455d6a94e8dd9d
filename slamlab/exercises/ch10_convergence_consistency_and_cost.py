"""Checks of chapter 10: a difference, the ties of P2 (9), the accounts of a region.

P2's springs between landmarks, its time update (9) with the cross block, and the recursions of
the compressed EKF.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from slamlab._checks import Array
from slamlab.exercises._cases import Report, run_cases

__all__ = [
    "MISTAKES_ACCOUNTS",
    "MISTAKES_DIFFERENCE_COV",
    "MISTAKES_PREDICT_COV",
    "accounts",
    "check_accounts",
    "check_difference_cov",
    "check_predict_cov",
    "difference_cov",
    "predict_cov",
]

Function = Callable[..., Any]
Accounts = tuple[Array, Array, Array]


def _covariance(n: int, seed: int) -> Array:
    root = np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T / n + 0.1 * np.eye(n)


# Exercise 1: the spring between two landmarks.


def difference_cov(P: Array) -> Array:
    """Covariance (2, 2) of m1 - m2 from that of (pose, m1, m2), (7, 7)."""
    one, two, cross = P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7]
    return one + two - cross - cross.T


def _blocks(P: Array) -> Accounts:
    return P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7]


def _from_blocks(rule: Function) -> Function:
    return lambda P: rule(*_blocks(P))


MISTAKES_DIFFERENCE_COV: dict[str, Function] = {
    "the ties between the landmarks are missing: they are the spring": _from_blocks(
        lambda a, b, c: a + b
    ),
    "this is the covariance of m1 + m2: the cross blocks come off": _from_blocks(
        lambda a, b, c: a + b + c + c.T
    ),
    "one cross block is not enough: both come off, one of them transposed": _from_blocks(
        lambda a, b, c: a + b - c
    ),
    "the second cross block is the transpose of the first: P_21 = P_12^T": _from_blocks(
        lambda a, b, c: a + b - 2 * c
    ),
    "variances of a difference add, they do not subtract": _from_blocks(
        lambda a, b, c: a - b - c - c.T
    ),
    "the state starts with three numbers of the pose: m1 stands at 3 and 4": lambda P: (
        P[2:4, 2:4] + P[4:6, 4:6] - P[2:4, 4:6] - P[2:4, 4:6].T
    ),
}


def check_difference_cov(student: Function) -> Report:
    """Check ``student(P (7, 7)) -> cov (2, 2)``, state (x, y, theta, m1, m2).

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    rigid = np.zeros((7, 7))
    rigid[3:, 3:] = np.tile(0.04 * np.eye(2), (2, 2))
    free = np.diag([0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.07])
    cases = [
        ("two landmarks without any tie", free),
        ("a rigid pair, tied completely", rigid),
        ("a general map", _covariance(7, 1)),
    ]
    return run_cases("difference_cov", student, difference_cov, cases, MISTAKES_DIFFERENCE_COV)


# Exercise 2: the time update of the whole covariance.


def predict_cov(P: Array, F: Array, Q: Array) -> Array:
    """Covariance (N, N) after a prediction of the pose by F (3, 3) with noise Q (3, 3)."""
    whole = np.eye(len(P))
    whole[:3, :3] = F
    predicted = whole @ P @ whole.T
    predicted[:3, :3] += Q
    return predicted


def _with_ties(rule: Function) -> Function:
    """Predict rightly, then give the ties P_xm of `rule(F, P_xm)` to the rows, or to both."""

    def wrong(P: Array, F: Array, Q: Array) -> Array:
        predicted = predict_cov(P, F, Q)
        predicted[:3, 3:] = rule(F, P[:3, 3:])
        predicted[3:, :3] = predicted[:3, 3:].T
        return predicted

    return wrong


def _one_side(P: Array, F: Array, Q: Array) -> Array:
    predicted = predict_cov(P, F, Q)
    predicted[3:, :3] = P[3:, :3]
    return predicted


MISTAKES_PREDICT_COV: dict[str, Function] = {
    "P_xm stayed as it was: the ties to the map turn with the robot, F P_xm": _with_ties(
        lambda F, ties: ties
    ),
    "the ties turned in the rows only: a covariance is symmetric, P_mx = P_xm^T": _one_side,
    "the ties turned twice: one F from the side of the pose is due": _with_ties(
        lambda F, ties: F @ F @ ties
    ),
    "the ties turned by the transposed F": _with_ties(lambda F, ties: F.T @ ties),
    "the motion noise Q is missing": lambda P, F, Q: predict_cov(P, F, 0 * Q),
    "the pose block needs F from both sides: F P_xx F^T": lambda P, F, Q: (
        predict_cov(P, F, Q) + np.pad(F @ P[:3, :3] - F @ P[:3, :3] @ F.T, (0, len(P) - 3))
    ),
    "the landmarks lost their ties: P_xm became zero": _with_ties(lambda F, ties: 0 * ties),
}


def check_predict_cov(student: Function) -> Report:
    """Check ``student(P (N, N), F (3, 3), Q (3, 3)) -> cov (N, N)``, N = 3 + 2n.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    F = np.array([[1.0, 0.0, -0.7], [0.0, 1.0, 0.4], [0.0, 0.0, 1.0]])
    Q = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.1]])
    cases = [
        ("a pose without landmarks", _covariance(3, 2), F, Q),
        ("one landmark, tied to the pose", _covariance(5, 3), F, Q),
        ("three landmarks, no motion noise", _covariance(9, 4), F, 0 * Q),
        ("a robot that stands still gets its noise all the same", _covariance(7, 5), np.eye(3), Q),
    ]
    return run_cases("predict_cov", student, predict_cov, cases, MISTAKES_PREDICT_COV)


# Exercise 3: what the rest of the map is owed.


def accounts(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> Accounts:
    """Phi, Psi (a, a) and theta (a,) after an update within the region."""
    H_Phi = H @ Phi
    weight = np.linalg.inv(S)
    return (
        Phi - K @ H_Phi,
        Psi + H_Phi.T @ weight @ H_Phi,
        theta + H_Phi.T @ weight @ v,
    )


def _phi_first(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> Accounts:
    new = Phi - K @ H @ Phi
    _, Psi, theta = accounts(new, Psi, theta, H, S, v, K)
    return new, Psi, theta


def _replacing(part: int, rule: Function) -> Function:
    """Give the right answer, but one of its three parts by `rule` of all arguments."""

    def wrong(*arguments: Array) -> tuple[Array, ...]:
        right = list(accounts(*arguments))
        right[part] = rule(*arguments)
        return tuple(right)

    return wrong


def _without_phi(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> Accounts:
    weight = np.linalg.inv(S)
    return Phi - K @ H @ Phi, Psi + H.T @ weight @ H, theta + H.T @ weight @ v


MISTAKES_ACCOUNTS: dict[str, Function] = {
    "Phi was changed before Psi and theta used it: they need the Phi from before": _phi_first,
    "Phi is missing: H speaks of the region now, the accounts of the region as entered": (
        _without_phi
    ),
    "Phi is multiplied from the left: (I - K H) Phi": _replacing(
        0, lambda Phi, Psi, theta, H, S, v, K: Phi @ (np.eye(len(Phi)) - K @ H)
    ),
    "Phi lost its past: (I - K H) multiplies the old Phi": _replacing(
        0, lambda Phi, Psi, theta, H, S, v, K: np.eye(len(Phi)) - K @ H
    ),
    "S must be inverted in Psi": _replacing(
        1, lambda Phi, Psi, theta, H, S, v, K: Psi + (H @ Phi).T @ S @ (H @ Phi)
    ),
    "Psi is a sum over all updates: the old Psi is missing": _replacing(
        1, lambda Phi, Psi, theta, H, S, v, K: accounts(Phi, 0 * Psi, theta, H, S, v, K)[1]
    ),
    "theta is a sum over all updates: the old theta is missing": _replacing(
        2, lambda Phi, Psi, theta, H, S, v, K: accounts(Phi, Psi, 0 * theta, H, S, v, K)[2]
    ),
    "theta has the wrong sign: v is measured minus predicted and adds": _replacing(
        2, lambda Phi, Psi, theta, H, S, v, K: accounts(Phi, Psi, theta, H, S, -v, K)[2]
    ),
}


def check_accounts(student: Function) -> Report:
    """Check ``student(Phi, Psi (a, a), theta (a,), H (m, a), S (m, m), v (m,), K (a, m))``.

    It returns the new Phi, Psi and theta.

    Parameters
    ----------
    student : callable

    Returns
    -------
    Report
        Printed too, one line a property.
    """
    rng = np.random.default_rng(6)

    def case(a: int, m: int, fresh: bool) -> tuple[Array, ...]:
        P, H = _covariance(a, a), rng.standard_normal((m, a))
        S = H @ P @ H.T + 0.5 * np.eye(m)
        K = P @ H.T @ np.linalg.inv(S)
        if fresh:
            start = np.eye(a), np.zeros((a, a)), np.zeros(a)
        else:
            start = rng.standard_normal((a, a)), _covariance(a, 9), rng.standard_normal(a)
        return (*start, H, S, rng.standard_normal(m), K)

    cases = [
        ("the first update after entering", *case(5, 2, fresh=True)),
        ("an update later on", *case(5, 2, fresh=False)),
        ("two landmarks in one look", *case(7, 4, fresh=False)),
    ]
    return run_cases("accounts", student, accounts, cases, MISTAKES_ACCOUNTS)
