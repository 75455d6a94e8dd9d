"""Checks of chapter 10: a difference, the whole of P2 (9), the accounts of a region.

P2's springs between landmarks, its time update (9) with the cross block, and the recursions of
the compressed EKF.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance
from slamlab.exercises._report import Array, Check

__all__ = ["check_accounts", "check_difference_cov", "check_predict_cov"]


# Exercise 1: the spring between two landmarks.


def _difference_cov(P: Array) -> Array:
    """Covariance (2, 2) of m1 - m2 from that of (pose, m1, m2), (7, 7)."""
    one, two, cross = P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7]
    return one + two - cross - cross.T


def _interleaved(P: Array) -> Array:
    one, two, cross = P[3::2, 3::2], P[4::2, 4::2], P[3::2, 4::2]
    return one + two - cross - cross.T


_RIGID = np.zeros((7, 7))
_RIGID[3:, 3:] = np.tile(0.04 * np.eye(2), (2, 2))

check_difference_cov = Check(
    _difference_cov,
    "cov",
    {
        "two landmarks without any cross-covariance": (
            np.diag([0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.07]),
        ),
        "a rigid pair, known only together": (_RIGID,),
        "a general map": lambda rng: (a_covariance(rng, 7),),
    },
    {
        "the cross-covariances are missing: they are the spring": (" - cross - cross.T", ""),
        "this is the covariance of m1 + m2: the cross blocks come off": (
            "- cross - cross.T",
            "+ cross + cross.T",
        ),
        "one cross block is not enough: both come off, one of them transposed": (" - cross.T", ""),
        "the second cross block is the transpose of the first: P_21 = P_12^T": (
            "- cross - cross.T",
            "- 2 * cross",
        ),
        "variances of a difference add, they do not subtract": ("one + two", "one - two"),
        "the state starts with three numbers of the pose: m1 stands at 3 and 4": (
            "P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7]",
            "P[2:4, 2:4], P[4:6, 4:6], P[2:4, 4:6]",
        ),
        "x and y of a landmark stand side by side: (x, y, theta, x1, y1, x2, y2)": _interleaved,
        "this is the covariance of pose and first landmark": lambda P: P[:2, :2] + P[3:5, 3:5],
        "only the first landmark's covariance came": lambda P: P[3:5, 3:5].copy(),
    },
)


# Exercise 2: the time update of the whole covariance.


def _predict_cov(P: Array, F: Array, Q: Array) -> Array:
    """Covariance (N, N) after a prediction of the pose by F (3, 3) with noise Q (3, 3)."""
    predicted = P.copy()
    strip = F @ P[:3, 3:]
    predicted[:3, 3:] = strip
    predicted[3:, :3] = strip.T
    predicted[:3, :3] = F @ P[:3, :3] @ F.T + Q
    return predicted


def _drive(landmarks: int, noise: float = 1.0) -> Any:
    def draw(rng: np.random.Generator) -> Any:
        F = np.eye(3) + np.round(rng.normal(0, 0.5, (3, 3)), 2)
        return a_covariance(rng, 3 + 2 * landmarks), F, noise * a_covariance(rng, 3, 0.3)

    return draw


check_predict_cov = Check(
    _predict_cov,
    "P",
    {
        "a pose without landmarks": _drive(0),
        "one landmark": _drive(1),
        "three landmarks, no motion noise": _drive(3, 0.0),
        "four landmarks": _drive(4),
        "a robot that stands still gets its noise all the same": lambda rng: (
            a_covariance(rng, 7),
            np.eye(3),
            a_covariance(rng, 3),
        ),
    },
    {
        "P_xm stayed as it was: it turns with the robot, F P_xm": ("F @ P[:3, 3:]", "P[:3, 3:]"),
        "P_xm turned in the rows only: a covariance is symmetric, P_mx = P_xm^T": (
            "predicted[3:, :3] = strip.T",
            "pass",
        ),
        "P_mx turned in the columns only: a covariance is symmetric, P_mx = P_xm^T": (
            "predicted[:3, 3:] = strip",
            "pass",
        ),
        "P_xm turned twice: one F from the side of the pose is due": (
            "F @ P[:3, 3:]",
            "F @ F @ P[:3, 3:]",
        ),
        "P_xm turned by the transposed F": ("F @ P[:3, 3:]", "F.T @ P[:3, 3:]"),
        "the motion noise Q is missing": (" + Q", ""),
        "the motion noise went through F too: it is added after the motion": (
            "F @ P[:3, :3] @ F.T + Q",
            "F @ (P[:3, :3] + Q) @ F.T",
        ),
        "Q was added to the landmarks as well: they do not move": (
            lambda P, F, Q: _predict_cov(P, F, Q) + _noisy_map(P, Q)
        ),
        "this is F^T P F: F P F^T is due": (
            "F @ P[:3, 3:]",
            "F.T @ P[:3, 3:]",
            "F @ P[:3, :3] @ F.T",
            "F.T @ P[:3, :3] @ F",
        ),
        "the pose block is F^T P F: F P F^T is due": (
            "F @ P[:3, :3] @ F.T",
            "F.T @ P[:3, :3] @ F",
        ),
        "the pose block needs F from both sides: F P_xx F^T": (
            "F @ P[:3, :3] @ F.T",
            "F @ P[:3, :3]",
        ),
        "the second F of the pose block is not transposed: F P_xx F^T": ("@ F.T", "@ F"),
        "P_xm became zero: pose and map stay correlated": ("strip = F", "strip = 0 * F"),
        "only the block of the pose came: the whole covariance is due": (
            "return predicted",
            "return predicted[:3, :3]",
        ),
    },
)


def _noisy_map(P: Array, Q: Array) -> Array:
    noise = np.zeros_like(P)
    noise[3:, 3:] = Q[0, 0] * np.eye(len(P) - 3)
    return noise


# Exercise 3: what the rest of the map is owed.


def _accounts(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> tuple[Array, Array, Array]:
    """Phi, Psi (a, a) and theta (a,) after an update within the region."""
    G = H @ Phi
    W = np.linalg.inv(S)
    return Phi - K @ G, Psi + G.T @ W @ G, theta + G.T @ W @ v


def _region(fresh: bool) -> Any:
    def draw(rng: np.random.Generator) -> Any:
        a, m = int(rng.integers(2, 8)), int(rng.integers(1, 4))
        P, H = a_covariance(rng, a), rng.standard_normal((m, a))
        S = H @ P @ H.T + 0.5 * np.eye(m)
        start = np.eye(a), np.zeros((a, a)), np.zeros(a)
        if not fresh:
            start = rng.standard_normal((a, a)), a_covariance(rng, a), rng.standard_normal(a)
        return (*start, H, S, rng.standard_normal(m), P @ H.T @ np.linalg.inv(S))

    return draw


check_accounts = Check(
    _accounts,
    "Phi, Psi, theta",
    {
        "the first update after entering": _region(fresh=True),
        "an update later on": _region(fresh=False),
    },
    {
        "Phi was changed before Psi and theta used it: they need the Phi from before": (
            "G = H @ Phi",
            "G = H @ (Phi - K @ H @ Phi)",
            "K @ G",
            "K @ H @ Phi",
        ),
        "Phi is missing: H speaks of the region now, the accounts of the region as entered": (
            "G = H @ Phi",
            "G = H",
            "K @ G",
            "K @ H @ Phi",
        ),
        "Phi is multiplied from the left: (I - K H) Phi": ("Phi - K @ G", "Phi - Phi @ K @ H"),
        "Phi lost its past: (I - K H) multiplies the old Phi": (
            "Phi - K @ G",
            "np.eye(len(Phi)) - K @ H",
        ),
        "Phi has the wrong sign: (I - K H) Phi": ("Phi - K @ G", "Phi + K @ G"),
        "S must be inverted": ("np.linalg.inv(S)", "S"),
        "S is missing: its inverse weighs the measurement": (
            "np.linalg.inv(S)",
            "np.eye(len(S))",
        ),
        "Psi is a sum over all updates: the old Psi is missing": ("Psi + G", "G"),
        "Psi has the wrong sign: information adds up": ("Psi + G", "Psi - G"),
        "theta is a sum over all updates: the old theta is missing": ("theta + G", "G"),
        "theta has the wrong sign: v is measured minus predicted and adds": (
            "theta + G",
            "theta - G",
        ),
        "theta took the state's correction K v: it gathers Phi^T H^T S^-1 v": (
            "theta + G.T @ W @ v",
            "theta + K @ v",
        ),
        "Psi and theta are exchanged": (
            lambda *given: (_accounts(*given)[0], *_accounts(*given)[:0:-1])
        ),
    },
    tolerance=1e-8,
)
