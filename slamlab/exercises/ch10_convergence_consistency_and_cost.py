"""Exercises, chapter 10: a difference, P2 (9), the accounts of a region, a filter made consistent.

P2's springs between landmarks, its time update (9) with the cross block, the recursions of the
compressed EKF, and first-estimates Jacobians (Huang, Mourikis and Roumeliotis, 2008).
"""

# mypy: disable-error-code="var-annotated"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn, in_the_room
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import wrap_angle

__all__ = [
    "check_accounts",
    "check_difference_cov",
    "check_leaked",
    "check_predict_cov",
    "check_slam",
    "check_update",
]


# %% [markdown] tags=["chapter"]
# # Exercises 10: convergence, consistency and cost
#
# Six exercises: three pieces of the arithmetic of maps, what a filter learns that nobody measured,
# an update with two bugs, and a filter that does not learn where north is. The chapter is
# [Convergence, consistency and cost](../10_convergence_consistency_and_cost.ipynb); exercises 2
# and 3 belong to [its page on the cost of a step](../10d_convergence_consistency_and_cost.ipynb).
# Replace each `...` and run the check below it as often as you like.

# %% [markdown] tags=["solution"]
# # Solutions 10: convergence, consistency and cost
#
# The exercises are in [Exercises 10](../exercises/10_convergence_consistency_and_cost.ipynb).

# %% active="ipynb" tags=["imports"]
# import numpy as np
#
# from slamlab.geometry import wrap_angle

# %% active="ipynb" tags=["imports", "solution"]
# import numpy as np
#
# from slamlab.evaluation import chi2_band
# from slamlab.geometry import wrap_angle

# %% [markdown] tags=["statement"]
# ## Exercise 1: the spring between two landmarks
#
# A robot knows its own place to 20 cm only, and it has observed two door posts a hundred times. It
# will not find either post on the building's plan, but it will fit through the door. How well is
# the *difference* of the two landmarks known? The state is $(x, y, \theta, m_1, m_2)$, each
# landmark two numbers.


# %% tags=["exercise"]
def difference_cov(P: Array) -> Array:
    """Covariance of m1 - m2.

    Parameters
    ----------
    P : ndarray, shape (7, 7)
        Covariance of pose and two landmarks (m, rad).

    Returns
    -------
    ndarray, shape (2, 2)
        In square metres.
    """
    one, two, cross = P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7]
    return one + two - cross - cross.T


# %% active="ipynb" tags=["try"]
# difference_cov(np.eye(7))

# %% [markdown] tags=["hint"]
# If the two landmarks were independent, their variances would add.

# %% [markdown] tags=["hint"]
# $m_1 - m_2$ is a linear map of the state, $A = [\,0\ \ I\ -I\,]$. What becomes of a covariance
# under a linear map?

# %% [markdown] tags=["hint"]
# `P[3:5, 3:5] + P[5:7, 5:7]`, less two cross blocks, one the transpose of the other.

# %% tags=["cases"]
_RIGID = np.zeros((7, 7))


_RIGID[3:, 3:] = np.tile(0.04 * np.eye(2), (2, 2))


def _difference_cov_drawn(ax: Any, function: Any) -> None:
    """Draw the difference of two landmarks with its ellipse, after 1, 10 and 100 observations."""
    from slamlab import plots

    for K in (1, 10, 100):
        P = np.eye(7)
        P[3:, 3:] = np.kron(0.04 * np.ones((2, 2)) + 0.09 / K * np.eye(2), np.eye(2))
        plots.ellipse(ax, [2.0, 1.0], np.asarray(function(P), float))
    ax.plot(2.0, 1.0, "+", color=plots.COLOURS["estimate"], markersize=9)
    ax.set_aspect("equal")
    ax.set(xlabel="x of m1 - m2 (m)", ylabel="y of m1 - m2 (m)")


check_difference_cov = Check(
    difference_cov,
    "cov",
    {
        "two landmarks without any cross-covariance": (
            np.diag([0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.07]),
        ),
        "a rigid pair, known only together": (_RIGID,),
        "a general map": lambda rng: (a_covariance(rng, 7),),
    },
    picture=_difference_cov_drawn,
)


# %% tags=["mistakes"]
def _interleaved(P: Array) -> Array:
    one, two, cross = P[3::2, 3::2], P[4::2, 4::2], P[3::2, 4::2]
    return one + two - cross - cross.T


check_difference_cov.mistakes = {
    "the cross-covariances are missing: they are the spring": " - cross - cross.T => ",
    "this is the covariance of m1 + m2: the cross blocks come off": (
        "- cross - cross.T => + cross + cross.T"
    ),
    "one cross block is not enough: both come off, one of them transposed": " - cross.T => ",
    "the second cross block is the transpose of the first: P_21 = P_12^T": (
        "- cross - cross.T => - 2 * cross"
    ),
    "variances of a difference add, they do not subtract": "one + two => one - two",
    "the state starts with three numbers of the pose: m1 stands at 3 and 4": (
        "P[3:5, 3:5], P[5:7, 5:7], P[3:5, 5:7] => P[2:4, 2:4], P[4:6, 4:6], P[2:4, 4:6]"
    ),
    "x and y of a landmark stand side by side: (x, y, theta, x1, y1, x2, y2)": _interleaved,
    "this is the covariance of pose and first landmark": lambda P: P[:2, :2] + P[3:5, 3:5],
    "only the first landmark's covariance was returned": lambda P: P[3:5, 3:5].copy(),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: the spring between two landmarks
#
# The difference is a linear map of the state, so its covariance is the map from both sides.
# Written out, that is two variances less the two cross blocks: what two landmarks have in common,
# the uncertainty of the robot that saw both, does not count.

# %% [markdown] tags=["solution"]
# Leave the cross blocks out and the rigid pair of the check, whose difference is known exactly,
# seems to have a σ of 28 cm:

# %% active="ipynb" tags=["solution"]
# def without_ties(P):
#     return P[3:5, 3:5] + P[5:7, 5:7]
#
# check_difference_cov(without_ties)

# %% [markdown] tags=["statement"]
# ## Exercise 2: the time update that P2 (9) does not finish
#
# P2 prints what a motion does to the covariance of the *pose*, $F P_{xx} F^\top + Q$, and stops
# there. A program that stops there as well moves the pose, and not what the pose shares with the
# map; what is left need not even be a covariance. The pose moves by $F$ with noise $Q$; landmarks
# do not. Predict the *whole* covariance, and do it without a product of two matrices as large as
# the map: the robot has 1000 landmarks.


# %% tags=["exercise"]
def predict_cov(P: Array, F: Array, Q: Array) -> Array:
    """Covariance of pose and map after a prediction.

    Parameters
    ----------
    P : ndarray, shape (3 + 2n, 3 + 2n)
        Before.
    F : ndarray, shape (3, 3)
        Derivative of the new pose by the old one.
    Q : ndarray, shape (3, 3)
        Covariance of the motion noise.

    Returns
    -------
    ndarray, shape (3 + 2n, 3 + 2n)
    """
    predicted = P.copy()
    predicted[:3, 3:] = F @ P[:3, 3:]
    predicted[3:, :3] = predicted[:3, 3:].T
    predicted[:3, :3] = F @ P[:3, :3] @ F.T + Q
    return predicted


# %% active="ipynb" tags=["try"]
# predict_cov(np.eye(5), np.eye(3), 0.1 * np.eye(3))

# %% [markdown] tags=["hint"]
# Which blocks of $P$ speak of the pose? There are three.

# %% [markdown] tags=["hint"]
# The derivative of the whole state is $F$ in the corner of an identity matrix.

# %% [markdown] tags=["hint"]
# The block of the pose has the pose on both sides, a strip on one side only. How many times is
# each turned, and from where? Make a copy first: whoever called you may still need the old $P$.


# %% tags=["cases"]
@drawn
def _drive(rng: np.random.Generator, landmarks: int, noise: float = 1.0) -> Any:
    F = np.eye(3) + np.round(rng.normal(0, 0.5, (3, 3)), 2)
    return a_covariance(rng, 3 + 2 * landmarks), F, noise * a_covariance(rng, 3, 0.3)


def _predict_cov_drawn(ax: Any, function: Any) -> None:
    """Draw the correlations of pose and three landmarks after twenty steps on a curve."""
    places = np.array([[2.0, 1.0], [1.0, -2.0], [-1.0, 2.0]])
    across = np.column_stack([-places[:, 1], places[:, 0]])
    turn = np.concatenate([[0.0, 0.0, 1.0], across.ravel()])
    shift = np.tile(np.eye(2), (4, 1))
    shared = np.column_stack([np.insert(shift, 2, 0.0, axis=0), 0.3 * turn])
    P = 0.04 * shared @ shared.T + 0.004 * np.eye(9)
    F, Q = np.array([[1, 0, -0.1], [0, 1, 0.3], [0, 0, 1]]), np.diag([0.0005, 0.0005, 0.0002])
    for _ in range(20):
        P = np.asarray(function(P, F, Q), float)
    sigma = np.sqrt(np.abs(np.diag(P))) + 1e-12
    ax.imshow(np.abs(P / np.outer(sigma, sigma)), cmap="Blues", vmin=0, vmax=1)
    ax.grid(visible=False)
    ax.set(xlabel="x, y, heading, landmarks", xticks=[], yticks=[])


check_predict_cov = Check(
    predict_cov,
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
    picture=_predict_cov_drawn,
)

# %% tags=["mistakes"]
check_predict_cov.mistakes = {
    "P_xm stayed as it was: it turns with the robot, F P_xm": "F @ P[:3, 3:] => P[:3, 3:]",
    "P_xm turned in the rows only: a covariance is symmetric, P_mx = P_xm^T": (
        "predicted[3:, :3] = predicted[:3, 3:].T => pass"
    ),
    "P_mx turned in the columns only: a covariance is symmetric, P_mx = P_xm^T": (
        "predicted[:3, 3:] = F @ P[:3, 3:]\n    predicted[3:, :3] = predicted[:3, 3:].T"
        " => predicted[3:, :3] = (F @ P[:3, 3:]).T"
    ),
    "P_xm turned twice: expected one F from the side of the pose": (
        "F @ P[:3, 3:] => F @ F @ P[:3, 3:]"
    ),
    "P_xm turned by the transposed F": "F @ P[:3, 3:] => F.T @ P[:3, 3:]",
    "the motion noise Q is missing": " + Q => ",
    "the motion noise went through F too: it is added after the motion": (
        "F @ P[:3, :3] @ F.T + Q => F @ (P[:3, :3] + Q) @ F.T"
    ),
    "Q was added to the landmarks as well: they do not move": (
        lambda P, F, Q: predict_cov(P, F, Q) + _noisy_map(P, Q)
    ),
    "this is F^T P F: expected F P F^T": (
        "F @ P[:3, 3:] => F.T @ P[:3, 3:]",
        "F @ P[:3, :3] @ F.T => F.T @ P[:3, :3] @ F",
    ),
    "the pose block is F^T P F: expected F P F^T": ("F @ P[:3, :3] @ F.T => F.T @ P[:3, :3] @ F"),
    "the pose block needs F from both sides: F P_xx F^T": ("F @ P[:3, :3] @ F.T => F @ P[:3, :3]"),
    "the second F of the pose block is not transposed: F P_xx F^T": "@ F.T => @ F",
    "P_xm became zero: pose and map stay correlated": (
        "predicted[:3, 3:] = F => predicted[:3, 3:] = 0 * F"
    ),
    "only the block of the pose was returned: expected the whole covariance": (
        "return predicted => return predicted[:3, :3]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: the time update that P2 (9) does not finish
#
# Three blocks speak of the pose. The corner is turned from both sides and gets the noise; the two
# strips are turned from the side of the pose. The rest stays.

# %% [markdown] tags=["solution"]
# No matrix of the size of the map is multiplied: but for the copy the work is O(n). (9) read
# alone touches the corner only:

# %% active="ipynb" tags=["solution"]
# def corner_only(P, F, Q):
#     predicted = P.copy()
#     predicted[:3, :3] = F @ P[:3, :3] @ F.T + Q
#     return predicted
#
# check_predict_cov(corner_only)

# %% [markdown] tags=["statement"]
# ## Exercise 3: the accounts of a region
#
# The compressed EKF ([page 10d](../10d_convergence_consistency_and_cost.ipynb)) works in a region
# with the state $a$ and leaves the rest of the map alone. What the rest will need later, it
# keeps in three accounts. $\Phi$ leads from the region as it was entered to the region now: its
# covariance with a landmark outside was $P_{ab}^0$ and is $\Phi P_{ab}^0$. $\Psi$ and $\vartheta$
# gather what the observations tell about the region *as entered*. At the entry they are $\Phi =
# I$, $\Psi = 0$, $\vartheta = 0$. Each update, with $H$, gain $K$, innovation $\nu$ and its
# covariance $S$, is booked:
#
# $$
# \Psi \leftarrow \Psi + \Phi^\top H^\top S^{-1} H \Phi, \quad
# \vartheta \leftarrow \vartheta + \Phi^\top H^\top S^{-1} \nu, \quad
# \Phi \leftarrow (I - K H)\,\Phi .
# $$
#
# On the right is everywhere the $\Phi$ from *before* the update. **Write down** why $\Psi$ and
# $\vartheta$ need that one, although the update is over when it is booked.
#
# The picture leaves a region after thirty updates and lets your accounts correct a landmark
# outside that was never observed: from grey to blue, crosses the estimates, with the truth inside.


# %% tags=["exercise"]
def accounts(
    Phi: Array, Psi: Array, theta: Array, H: Array, S: Array, v: Array, K: Array
) -> tuple[Array, Array, Array]:
    """Accounts of the compressed EKF after one update within the region.

    Parameters
    ----------
    Phi, Psi : ndarray, shape (a, a)
    theta : ndarray, shape (a,)
    H : ndarray, shape (m, a)
        Derivative of the measurement by the state of the region.
    S : ndarray, shape (m, m)
        Covariance of the innovation.
    v : ndarray, shape (m,)
        Innovation, measured minus predicted.
    K : ndarray, shape (a, m)
        Gain.

    Returns
    -------
    Phi, Psi : ndarray, shape (a, a)
    theta : ndarray, shape (a,)
    """
    G = H @ Phi
    W = np.linalg.inv(S)
    return Phi - K @ G, Psi + G.T @ W @ G, theta + G.T @ W @ v


# %% active="ipynb" tags=["try"]
# I = np.eye(2)
# accounts(I, np.zeros((2, 2)), np.zeros(2), I, 2 * I, np.ones(2), 0.5 * I)

# %% [markdown] tags=["hint"]
# What does $\Phi$ stand for? An observation *now*, with $H$, is an observation of the region *as
# it was entered*, with which matrix?

# %% [markdown] tags=["hint"]
# $\nu$ is measured minus predicted. Predicted from which state: the one before the update, or the
# one after it? And which $\Phi$ leads there from the entry?

# %% [markdown] tags=["hint"]
# $H\Phi$ appears in all of them: compute it once.


# %% tags=["cases"]
@drawn
def _region(rng: np.random.Generator, fresh: bool) -> Any:
    a, m = int(rng.integers(2, 8)), int(rng.integers(1, 4))
    P, H = a_covariance(rng, a), rng.standard_normal((m, a))
    S = H @ P @ H.T + 0.5 * np.eye(m)
    start = np.eye(a), np.zeros((a, a)), np.zeros(a)
    if not fresh:
        start = rng.standard_normal((a, a)), a_covariance(rng, a), rng.standard_normal(a)
    return (*start, H, S, rng.standard_normal(m), P @ H.T @ np.linalg.inv(S))


def _accounts_drawn(ax: Any, function: Any) -> None:
    """Draw a landmark outside the region before (grey) and after thirty updates inside it."""
    from slamlab import plots

    rng, a = np.random.default_rng(6), 5
    P, truth = a_covariance(rng, a + 2, 0.5), np.array([4.0, 3.0])
    error = np.linalg.cholesky(P) @ rng.standard_normal(a + 2)
    P_a, x = P[:a, :a].copy(), np.zeros(a)
    Phi, Psi, theta = np.eye(a), np.zeros((a, a)), np.zeros(a)
    for _ in range(30):
        H = rng.standard_normal((2, a))
        v = H @ (error[:a] - x) + rng.normal(0, 0.3, 2)
        S = H @ P_a @ H.T + 0.09 * np.eye(2)
        K = P_a @ H.T @ np.linalg.inv(S)
        Phi, Psi, theta = (np.asarray(one, float) for one in function(Phi, Psi, theta, H, S, v, K))
        x, P_a = x + K @ v, P_a - K @ S @ K.T
    place = truth - error[a:]
    plots.landmarks(ax, truth[None])
    plots.ellipse(ax, place, P[a:, a:], "wall")
    ax.plot(*place, "x", color=plots.COLOURS["wall"])
    P_ba = P[a:, :a]
    after = place + P_ba @ theta
    plots.ellipse(ax, after, P[a:, a:] - P_ba @ Psi @ P_ba.T)
    ax.plot(*after, "x", color=plots.COLOURS["estimate"])
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)")


check_accounts = Check(
    accounts,
    "Phi, Psi, theta",
    {
        "the first update after entering": _region(fresh=True),
        "an update later on": _region(fresh=False),
    },
    tolerance=1e-8,
    picture=_accounts_drawn,
)


# %% tags=["mistakes"]
def _noisy_map(P: Array, Q: Array) -> Array:
    noise = np.zeros_like(P)
    noise[3:, 3:] = Q[0, 0] * np.eye(len(P) - 3)
    return noise


check_accounts.mistakes = {
    "Phi was changed before Psi and theta used it: they need the Phi from before": (
        "G = H @ Phi => G = H @ (Phi - K @ H @ Phi)",
        "K @ G => K @ H @ Phi",
    ),
    "Phi is missing: H speaks of the region now, the accounts of the region as entered": (
        "G = H @ Phi => G = H",
        "K @ G => K @ H @ Phi",
    ),
    "Phi is multiplied from the left: (I - K H) Phi": "Phi - K @ G => Phi - Phi @ K @ H",
    "Phi lost its past: (I - K H) multiplies the old Phi": (
        "Phi - K @ G => np.eye(len(Phi)) - K @ H"
    ),
    "Phi has the wrong sign: (I - K H) Phi": "Phi - K @ G => Phi + K @ G",
    "S must be inverted": "np.linalg.inv(S) => S",
    "S is missing: its inverse weighs the measurement": "np.linalg.inv(S) => np.eye(len(S))",
    "Psi lacks Phi: H Phi speaks of the region as entered": (
        "Psi + G.T @ W @ G => Psi + H.T @ W @ H"
    ),
    "Psi is a sum over all updates: the old Psi is missing": "Psi + G => G",
    "Psi has the wrong sign: information adds up": "Psi + G => Psi - G",
    "theta is a sum over all updates: the old theta is missing": "theta + G => G",
    "theta has the wrong sign: v is measured minus predicted and adds": ("theta + G => theta - G"),
    "theta took the state's correction K v: it gathers Phi^T H^T S^-1 v": (
        "theta + G.T @ W @ v => theta + K @ v"
    ),
    "Psi and theta are exchanged": (
        lambda *given: (accounts(*given)[0], *accounts(*given)[:0:-1])
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the accounts of a region
#
# $\Phi$ carries the state of the region as it was when the region was entered to now. An
# observation now, with $H$, is therefore an observation with $H\Phi$ of the region as entered, and
# only through that do the landmarks outside share an error with it. What they need later is the
# information of that observation, $\Phi^\top H^\top S^{-1} H \Phi$, and its correction,
# $\Phi^\top H^\top S^{-1} v$.

# %% [markdown] tags=["solution"]
# And why from *before*? The innovation is about the state that predicted it, the one before the
# update, and $\Phi$ from before leads to it from the entry. $(I - K H)\,\Phi$ leads to the state
# after it, in which the observation has been used already:

# %% active="ipynb" tags=["solution"]
# def phi_first(Phi, Psi, theta, H, S, v, K):
#     Phi = Phi - K @ H @ Phi
#     weighted = np.linalg.solve(S, H @ Phi).T
#     return Phi, Psi + weighted @ H @ Phi, theta + weighted @ v
#
# check_accounts(phi_first)

# %% [markdown] tags=["statement"]
# ## Exercise 4: what nobody measured, with a pencil
#
# A robot without a compass stands still and its filter reports a heading that it cannot know.
# Where does the knowledge come from? Let the whole world turn about the origin by a small angle,
# the pose $p$ and every landmark $m$ with it. A filter whose covariance remembers this turn at the
# *first* estimates $p_0, m_0$ moves them by $J p_0$ and $J m_0$ per radian, and the heading by 1,
# with $J = \begin{bmatrix} 0 & -1 \\ 1 & 0 \end{bmatrix}$. No range and no bearing changes, in
# truth.
#
# Now it observes the landmark, range and bearing from the centre of the robot, and takes the
# Jacobian $H$ at its *newest* estimates $p, m$. How much does it believe the measurement to change
# per radian? Work out the two numbers $H t$ on paper: they contain nothing but $d = m - p$ and $D
# = m_0 - p_0$. Then add up the information about the turn, $(H t)^\top R^{-1} (H t)$, over all
# observations.


# %% tags=["exercise"]
def leaked(d: Array, D: Array, R: Array) -> float:
    """Information about a turn of the whole world that a filter believes to have.

    Parameters
    ----------
    d : ndarray, shape (T, 2)
        Newest estimate of landmark minus robot, at every observation (m).
    D : ndarray, shape (T, 2)
        First estimate of landmark minus robot, of the same pair (m).
    R : ndarray, shape (2, 2)
        Covariance of range (m) and bearing (rad).

    Returns
    -------
    float
        The sum over all observations (1/rad^2): 1 / sigma^2 of what it believes.
    """
    rho = np.hypot(d[:, 0], d[:, 1])
    in_range = (d[:, 1] * D[:, 0] - d[:, 0] * D[:, 1]) / rho
    in_bearing = (d * D).sum(axis=1) / rho**2 - 1
    Ht = np.stack([in_range, in_bearing])
    return float(np.sum(Ht * np.linalg.solve(R, Ht)))


# %% active="ipynb" tags=["try"]
# leaked(np.array([[4.0, 0.1]]), np.array([[4.0, 0.0]]), np.diag([0.0025, 0.0003]))

# %% [markdown] tags=["hint"]
# The range is $\rho = |d|$, and its derivative by the landmark is $d^\top / \rho$, by the robot's
# place $-d^\top / \rho$. Multiply by what the turn does to both: only $J D$ is left.

# %% [markdown] tags=["hint"]
# The derivative of the bearing by the landmark is $(-d_y,\ d_x) / \rho^2$, by the heading $-1$.
# What must come out if $d = D$?

# %% [markdown] tags=["hint"]
# A test of your two numbers: the lesson's landmark, 4 m ahead and moved sideways by 0.1 m, must
# give about 0.1 m per radian in the range.


# %% tags=["cases"]
@drawn
def _observed(rng: np.random.Generator, T: int, moved: float) -> Any:
    D = np.round(rng.uniform(1, 6, (T, 2)) * rng.choice([-1, 1], (T, 2)), 2)
    return np.round(D + rng.normal(0, moved, (T, 2)), 2), D, a_covariance(rng, 2, 0.05)


def _standing_robot() -> tuple[Array, Array, Array]:
    """Return the estimates of an EKF-SLAM on 10 s of a robot that stands among three stones."""
    rng, R = np.random.default_rng(4), np.diag([0.05, 0.03]) ** 2
    stones = np.array([[3.0, 1.0], [4.0, -2.0], [-2.0, 1.0]])
    mean, P, newest, first = np.zeros(9), np.zeros((9, 9)), [], []
    P[:3, :3] = np.diag([1e-6, 1e-6, np.deg2rad(10) ** 2])
    for k in range(100):
        z = np.array([np.hypot(*stones[k % 3]), np.arctan2(*stones[k % 3, ::-1])])
        z, at = z + rng.normal(0, [0.05, 0.03]), 3 + 2 * (k % 3)
        if k < 3:
            mean[at : at + 2] = mean[:2] + z[0] * np.array(
                [np.cos(mean[2] + z[1]), np.sin(mean[2] + z[1])]
            )
            first.append(mean[at : at + 2] - mean[:2])
            c, s = np.cos(mean[2] + z[1]), np.sin(mean[2] + z[1])
            turned = np.array([[1.0, 0.0, -z[0] * s], [0.0, 1.0, z[0] * c]])
            G_z = np.array([[c, -z[0] * s], [s, z[0] * c]])
            P[at : at + 2] = turned @ P[:3]
            P[:, at : at + 2] = P[at : at + 2].T
            P[at : at + 2, at : at + 2] = turned @ P[:3, :3] @ turned.T + G_z @ R @ G_z.T
            newest.append(first[-1])
        else:
            newest.append(mean[at : at + 2] - mean[:2])
            mean, P = update(mean, P, mean, z, k % 3, R)
    return np.array(newest), np.tile(np.array(first), (34, 1))[:100], R


def _leaked_drawn(ax: Any, function: Any) -> None:
    """Draw how the heading's sigma falls by what leaks in, for a robot that stands still."""
    from slamlab import plots

    d, D, R = _standing_robot()
    start = np.deg2rad(10)
    steps = np.arange(3, 101)
    known = np.array([float(function(d[:k], D[:k], R)) for k in steps])
    sigma = np.rad2deg(1 / np.sqrt(1 / start**2 + known))
    ax.plot(steps, sigma, **plots.line_style("estimate"))
    ax.axhline(10, **plots.line_style("truth"))
    ax.set(xlabel="observation", ylabel="σ of the heading (°)", ylim=(0, 11))
    ax.set_title(f"10° before, {sigma[-1]:.1f}° believed")


check_leaked = Check(
    leaked,
    "information",
    {
        "estimates that have not moved: nothing leaks in": (
            [[4.0, 1.0], [-2.0, 3.0], [0.5, -1.0]],
            [[4.0, 1.0], [-2.0, 3.0], [0.5, -1.0]],
            np.diag([0.0025, 0.0003]),
        ),
        "moved sideways: the range": ([[4.0, 0.1]], [[4.0, 0.0]], np.diag([0.0025, 1e4])),
        "moved outward: the bearing": ([[4.1, 0.0]], [[4.0, 0.0]], np.diag([1e4, 0.0003])),
        "turned by a right angle": ([[0.0, 2.0]], [[2.0, 0.0]], np.diag([0.01, 0.04])),
        "many observations": _observed(12, 0.3),
        "estimates that moved far": _observed(5, 2.0),
    },
    picture=_leaked_drawn,
)

# %% tags=["mistakes"]
_BEARING, _QUADRATIC = "(d * D).sum(axis=1) / rho**2 - 1", "Ht * np.linalg.solve(R, Ht)"


check_leaked.mistakes = {
    "the heading turns too: its -1 belongs to the bearing": f"{_BEARING} => {_BEARING[:-4]}",
    "the turn of the heading has the wrong sign: a bearing is measured from the heading": (
        f"{_BEARING} => {_BEARING[:-1]}-1"
    ),
    "the robot turns with the world: D = m_0 - p_0 in both, not d": (
        "* D[:, 0] => * d[:, 0]",
        "* D[:, 1] => * d[:, 1]",
        "(d * D) => (d * d)",
    ),
    "J turns by a quarter: this is the range along the way, d^T D": (
        "(d[:, 1] * D[:, 0] - d[:, 0] * D[:, 1]) => (d * D).sum(axis=1)"
    ),
    "the derivative of a range is a unit vector: divide by rho": ") / rho\n => )\n",
    "the derivative of a bearing falls with the distance: divide by rho squared": (
        "/ rho**2 - 1 => / rho - 1"
    ),
    "rho is the distance of the newest estimate, where H is taken": (
        "np.hypot(d[:, 0], d[:, 1]) => np.hypot(D[:, 0], D[:, 1])"
    ),
    "R must be inverted: a precise sensor leaks more": f"{_QUADRATIC} => Ht * (R @ Ht)",
    "R is missing": f"{_QUADRATIC} => Ht * Ht",
    "only the last observation was counted: information adds up": (
        f"np.sum({_QUADRATIC}) => np.sum(({_QUADRATIC})[:, -1])"
    ),
    "this is the mean of the observations: information adds up": (
        f"np.sum({_QUADRATIC}) => np.mean(np.sum({_QUADRATIC}, axis=0))"
    ),
    "this is the standard deviation: the information was asked for": (
        lambda *given: 1 / np.sqrt(leaked(*given))
    ),
    "the range was left out": "Ht = np.stack([in_range => Ht = np.stack([0 * in_range",
    "the bearing was left out": "in_bearing]) => 0 * in_bearing])",
}

# %% [markdown] tags=["solution"]
# ## Solution 4: what nobody measured
#
# The turn moves the landmark by $J m_0$ and the robot by $J p_0$. The range sees the difference $J
# D$ along $d/\rho$: $d^\top J D / \rho$. The bearing sees it across, and the heading's own turn
# comes off. Where $d = D$ both are zero: the measurement tells nothing about the turn, as it must.
# A landmark moved *sideways* leaks into the range, one moved *outward* into the bearing.

# %% [markdown] tags=["solution"]
# A mean over the observations would say that a filter gets no worse by observing more. The sum
# says what happens: nothing leaks out again.

# %% active="ipynb" tags=["solution"]
# R = np.diag([0.05, np.deg2rad(1)]) ** 2
# D = np.tile([4.0, 0.0], (300, 1))
# for name, d in (("sideways", D + [0.0, 0.1]), ("outward", D + [0.1, 0.0])):
#     known = 1 / np.deg2rad(10) ** 2 + leaked(d, D, R)
#     print(f"{name:8s}: 10 deg before, {np.rad2deg(known**-0.5):.1f} deg after 300")

# %% [markdown] tags=["statement"]
# ## Exercise 5: a bug to find
#
# The heading of exercise 4 leaked in through Jacobians at estimates that had moved.
# *First-estimates Jacobians* keep a second state beside `mean`. In `first` stands each landmark as
# it was placed, and the pose as predicted in this step. Corrections move `mean` alone. So the
# landmarks of the two differ after a while; the poses differ when a second landmark is seen in the
# same step, for the first one has moved `mean` already.
#
# A trial on a bench, with estimates that had not moved yet, went well. In the hall a robot that
# stands still and has no compass gets sure of its heading, as in exercise 4: the picture shows it.
# And a robot that comes back to a part of its map, a metre off, and sees four posts in one step is
# further off after that than before, where about ten centimetres are expected: the title has the
# mean of twenty. There are two bugs.


# %% tags=["exercise"]
def update(mean: Array, P: Array, first: Array, z: Array, i: int, R: Array) -> tuple[Array, Array]:
    """State and covariance after landmark number i was seen.

    Parameters
    ----------
    mean : ndarray, shape (3 + 2 n,)
        Latest estimate: pose (m, m, rad), then n landmarks (m).
    P : ndarray, shape (3 + 2 n, 3 + 2 n)
    first : ndarray, shape (3 + 2 n,)
        The pose as predicted in this step, the landmarks as first placed.
    z : ndarray, shape (2,)
        Range (m) and bearing (rad), the sensor at the centre of the robot.
    i : int
        Which landmark, from 0.
    R : ndarray, shape (2, 2)

    Returns
    -------
    mean, P : ndarray
        The heading in (-pi, pi].
    """
    k = 3 + 2 * i
    dx, dy = first[k : k + 2] - first[:2]
    squared = dx**2 + dy**2
    rho = np.sqrt(squared)
    H = np.zeros((2, len(mean)))
    H[:, :3] = [[-dx / rho, -dy / rho, 0], [dy / squared, -dx / squared, -1]]
    H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / squared, dx / squared]]
    east, north = mean[k : k + 2] - mean[:2]
    v = z - np.array([np.hypot(east, north), np.arctan2(north, east) - mean[2]])
    v[1] = wrap_angle(v[1])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    new = mean + K @ v
    new[2] = wrap_angle(new[2])
    return new, (np.eye(len(mean)) - K @ H) @ P


# %% active="ipynb" tags=["stub"]
#     k = 3 + 2 * i
#     dx, dy = mean[k : k + 2] - first[:2]
#     squared = dx**2 + dy**2
#     rho = np.sqrt(squared)
#     H = np.zeros((2, len(mean)))
#     H[:, :3] = [[-dx / rho, -dy / rho, 0], [dy / squared, -dx / squared, -1]]
#     H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / squared, dx / squared]]
#     v = z - np.array([rho, np.arctan2(dy, dx) - first[2]])
#     v[1] = wrap_angle(v[1])
#     K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
#     new = mean + K @ v
#     new[2] = wrap_angle(new[2])
#     return new, (np.eye(len(mean)) - K @ H) @ P

# %% active="ipynb" tags=["try"]
# state, z = np.array([0, 0, 0, 3.0, 1.0]), np.array([3.2, 0.4])
# update(state, 0.1 * np.eye(5), state, z, 0, 0.01 * np.eye(2))[0].round(3)

# %% [markdown] tags=["hint"]
# Which of the two states does each line use? Write it beside the line, and beside that which one
# it should use.

# %% [markdown] tags=["hint"]
# The same $dx, dy$ serve two purposes here. Can they?

# %% [markdown] tags=["hint"]
# A landmark that was corrected ten times: where was it when its first Jacobian was taken? And
# where does the filter expect it now? Ask the same of the pose, when the first of four posts has
# corrected it and the second comes.


# %% tags=["cases"]
@drawn
def _in_a_map(
    rng: np.random.Generator, landmarks: int, i: int, moved: float = 0.3, past: bool = False
) -> Any:
    mean = np.append(a_pose(rng), np.round(rng.uniform(5, 9, 2 * landmarks), 2))
    if past:
        mean[:3], mean[3 + 2 * i : 5 + 2 * i] = [0, 0, 3.0], [-5.0, -0.4]
    d = mean[3 + 2 * i : 5 + 2 * i] - mean[:2]
    z = np.array([np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - mean[2])])
    z += rng.normal(0, 0.1, 2)
    if past:
        z[1] = wrap_angle(np.arctan2(d[1], d[0]) - mean[2]) - 0.2
    first = mean + np.round(moved * rng.uniform(-1, 1, len(mean)), 2)
    return mean, a_covariance(rng, len(mean), 0.05), first, z, i, a_covariance(rng, 2, 0.02)


def _four_posts(function: Any) -> float:
    """Let twenty robots, a metre off (sigma), see four posts of a map in one step: metres off."""
    posts, off = np.array([[4, 1], [2, -3], [-3, -1], [-1, 4.0]]), []
    R = np.diag([0.05, 0.02]) ** 2
    for seed in range(20):
        rng = np.random.default_rng(seed)
        mean = np.append(np.zeros(3), posts.ravel())
        P, true, first = np.diag([1.0, 1.0, 1e-3] + [1e-4] * 8), rng.standard_normal(2), mean
        for i, d in enumerate(posts - true):
            z = np.array([np.hypot(*d), np.arctan2(d[1], d[0])])
            z = z + rng.normal(0, [0.05, 0.02])
            mean, P = (np.asarray(one, float) for one in function(mean, P, first, z, i, R))
        off.append(np.hypot(*(mean[:2] - true)))
    return float(np.mean(off))


def _update_drawn(ax: Any, function: Any) -> None:
    """Draw the reported sigma of the heading of a robot that stands still: 10 degrees remain."""
    from slamlab import plots

    rng, stones = np.random.default_rng(3), np.array([[3.0, 1.0], [4.0, -2.0], [-2.0, 1.5]])
    sigma, R = np.deg2rad(10), np.diag([0.05, 0.02]) ** 2
    seen = stones @ np.array([[np.cos(0.2), np.sin(0.2)], [-np.sin(0.2), np.cos(0.2)]])
    seen += rng.normal(0, 0.1, (3, 2))
    mean = np.concatenate([[0, 0, 0.2], seen.ravel()])
    t = np.concatenate([[0, 0, 1.0], np.column_stack([-seen[:, 1], seen[:, 0]]).ravel()])
    P = sigma**2 * np.outer(t, t) + np.diag([0.0] * 3 + [0.01] * 6)
    first, reported = mean.copy(), [10.0]
    for k in range(90):
        x, y = stones[k % 3]
        z = np.array([np.hypot(x, y), np.arctan2(y, x)]) + rng.standard_normal(2) * [0.05, 0.02]
        first[:3] = mean[:3]
        mean, P = (np.asarray(one, float) for one in function(mean, P, first, z, k % 3, R))
        reported.append(float(np.rad2deg(np.sqrt(max(P[2, 2], 0.0)))))
    ax.plot(reported, color=plots.COLOURS["estimate"])
    ax.axhline(10, color=plots.COLOURS["dead_reckoning"], linestyle="--", linewidth=1)
    ax.set(xlabel="observation", ylabel="σ of the heading (°)", ylim=(0, 12))
    ax.set_title(f"four posts at once: {_four_posts(function):.2f} m off")


check_update = Check(
    update,
    "mean, P",
    {
        "estimates that have not moved since the first": _in_a_map(2, 1, 0.0),
        "one landmark that has moved": _in_a_map(1, 0),
        "the second of three landmarks": _in_a_map(3, 1),
        "the last of four": _in_a_map(4, 3),
        "a landmark ahead, across half a turn": _in_a_map(2, 1, past=True),
        "a heading that is corrected past half a turn": (
            [0.0, 0.0, 3.1, -4.0, 0.3],
            np.diag([0.01, 0.01, 0.3, 0.01, 0.01]),
            [0.1, 0.0, 3.0, -4.2, 0.4],
            [4.0, -0.4],
            0,
            0.01 * np.eye(2),
        ),
        "a heading that is corrected past half a turn to the right": (
            [0.0, 0.0, -3.1, -4.0, -0.3],
            np.diag([0.01, 0.01, 0.3, 0.01, 0.01]),
            [0.1, 0.0, -3.0, -4.2, -0.4],
            [4.0, 0.4],
            0,
            0.01 * np.eye(2),
        ),
        "an innovation across half a turn, both bearings in (-pi, pi]": (
            [0.0, 0.0, 0.0, -5.0, 0.2],
            np.diag([0.01, 0.01, 0.01, 0.05, 0.05]),
            [0.1, 0.0, 0.05, -5.1, 0.3],
            [5.1, -3.1],
            0,
            0.01 * np.eye(2),
        ),
        "a range that is off by more than pi": (
            [0.0, 0.0, 0.0, 9.0, 1.0],
            np.diag([1.0, 1.0, 0.01, 4.0, 4.0]),
            [0.1, 0.1, 0.05, 8.8, 1.1],
            [5.2, 0.2],
            0,
            0.01 * np.eye(2),
        ),
    },
    tolerance=1e-6,
    picture=_update_drawn,
    hunt=True,
)

# %% tags=["mistakes"]
check_update.mistakes = {
    "the expected bearing was wrapped, the innovation was not: wrap their difference": (
        "wrap_angle(v[1]) => z[1] - wrap_angle(z[1] - v[1])"
    ),
    "the range was wrapped too: it is no angle": "v[1] = wrap_angle(v[1]) => v = wrap_angle(v)",
    "H takes the landmark at its latest estimate: expected its first one, for ever": (
        "first[k : k + 2] - first[:2] => mean[k : k + 2] - first[:2]"
    ),
    "H takes the pose at its latest estimate: expected the predicted one in `first`": (
        "first[k : k + 2] - first[:2] => first[k : k + 2] - mean[:2]"
    ),
    "H is taken at the latest estimates: this is the usual EKF, which learns where north is": (
        "first[k : k + 2] - first[:2] => mean[k : k + 2] - mean[:2]"
    ),
    "the innovation was taken at the first estimates: predict it from the latest ones": (
        "mean[k : k + 2] - mean[:2] => first[k : k + 2] - first[:2]",
        "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]",
    ),
    "the innovation takes the pose from `first`: predict it from the latest estimate": (
        "mean[k : k + 2] - mean[:2] => mean[k : k + 2] - first[:2]",
        "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]",
    ),
    "the innovation takes the landmark from `first`: predict it from the latest estimate": (
        "mean[k : k + 2] - mean[:2] => first[k : k + 2] - mean[:2]"
    ),
    "the innovation takes the heading from `first`: predict it from the latest estimate": (
        "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]"
    ),
    "the correction was added to the first estimates: they stay, the mean moves": (
        "mean + K @ v => first + K @ v"
    ),
    "landmark i begins at 3 + 2 i: each takes two rows": "3 + 2 * i => 3 + i",
    "the innovation is not wrapped": "wrap_angle(v[1]) => v[1]",
    "the heading is not wrapped after the correction": ("wrap_angle(new[2]) => new[2]"),
    "R is missing in S": "H @ P @ H.T + R => H @ P @ H.T",
    "R was added twice in S": "H @ P @ H.T + R => H @ P @ H.T + 2 * R",
    "the covariance did not shrink: expected (I - K H) P": (
        "(np.eye(len(mean)) - K @ H) @ P => P.copy()"
    ),
    "the innovation has the wrong sign: measured minus predicted": (
        "mean + K @ v => mean - K @ v"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 5: a bug to find
#
# One pair $dx, dy$ cannot serve two purposes. The first bug: in `H` it took the landmark where it
# is believed to be now; that is the leak through which the filter learns its heading. The second:
# in the innovation it took the pose where it was predicted; the filter compares a measurement
# with what it no longer expects, and each of four posts makes a correction again that the first
# has made.

# %% [markdown] tags=["solution"]
# Who takes *everything* at the first estimates has a filter whose Jacobians agree and whose
# measurements say the same thing again and again: the innovation does not shrink when the
# estimate of the landmark moves, and its correction is made once more with every measurement.

# %% active="ipynb" tags=["solution"]
# def everything_first(mean, P, first, z, i, R):
#     moved, smaller = update(first, P, first, z, i, R)
#     new = mean + moved - first
#     new[2] = wrap_angle(new[2])
#     return new, smaller
#
# check_update(everything_first)

# %% [markdown] tags=["statement"]
# ## Exercise 6: a filter that does not learn where north is
#
# Assemble it. As in [Exercises 09](09_ekf_slam.ipynb) a unicycle moves by $v\,dt$ along the
# heading it had before, then turns by $\omega\,dt$. After each step it may see several landmarks
# this time, with names. Those that are new come in first, all from the predicted pose; then the
# known ones correct, one after the other in the order given. And the start is uncertain: the state
# begins at zero with the covariance $P_0$.
#
# In the motion, $F$ is the identity but for its third column, where a turn of the heading swings
# the way: $(-\Delta y, \Delta x)$. The usual EKF takes the way from the corrected pose to the new
# prediction. First-estimates Jacobians take it from the pose *as it was predicted a step ago*,
# which is what `first` holds. Then the new prediction goes into `first`, and a landmark that
# comes in stands there for ever. Use your `predict_cov` and `update`.
#
# Then draw: forty robots, each with a heading that is uncertain by 10° (σ) and no compass, drive
# in a circle among four stones and see two in each step. Nothing that they observe depends on
# north, so 10° must remain, and the NEES of the heading should be near 1. The usual EKF, on the
# same drives, is in grey. **Guess first**: how sure of north is it after 20 s?


# %% tags=["exercise"]
def slam(
    P0: Array, u: Array, dt: float, V: Array, z: Array, ids: Ints, R: Array
) -> tuple[Array, Array]:
    """EKF-SLAM with first-estimates Jacobians.

    Parameters
    ----------
    P0 : ndarray, shape (3, 3)
        Covariance of the first pose, which is zero.
    u : ndarray, shape (T, 2)
        Speed (m/s) and turn rate (rad/s) of every step.
    dt : float
        Duration of a step (s).
    V : ndarray, shape (2, 2)
        Covariance of speed and turn rate.
    z : ndarray, shape (T, m, 2)
        Up to m ranges (m) and bearings (rad) after every step; NaN where nothing was
        seen.
    ids : ndarray of int, shape (T, m)
        Names of these landmarks, each at most once in a step; -1 where nothing was.
    R : ndarray, shape (2, 2)

    Returns
    -------
    mean : ndarray, shape (3 + 2 n,)
        Pose, heading in (-pi, pi], and n landmarks in the order in which they
        were first seen.
    P : ndarray, shape (3 + 2 n, 3 + 2 n)
    """
    mean, P, first, known = np.zeros(3), P0, np.zeros(3), []
    for (v, omega), seen, names in zip(u, z, ids):
        c, s = np.cos(mean[2]), np.sin(mean[2])
        G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])
        mean[:2] += v * dt * np.array([c, s])
        mean[2] = wrap_angle(mean[2] + omega * dt)
        F = np.eye(3)
        F[:2, 2] = first[1] - mean[1], mean[0] - first[0]
        P = predict_cov(P, F, G @ V @ G.T)
        first[:3] = mean[:3]
        old = list(known)
        for (r, phi), name in zip(seen, names):
            if name < 0 or name in old:
                continue
            c, s = np.cos(mean[2] + phi), np.sin(mean[2] + phi)
            G_pose = np.array([[1.0, 0.0, -r * s], [0.0, 1.0, r * c]])
            G_z = np.array([[c, -r * s], [s, r * c]])
            point = mean[:2] + r * np.array([c, s])
            mean, first = np.append(mean, point), np.append(first, point)
            cross = G_pose @ P[:3]
            own = cross[:, :3] @ G_pose.T + G_z @ R @ G_z.T
            P = np.block([[P, cross.T], [cross, own]])
            known.append(name)
        for one, name in zip(seen, names):
            if name in old:
                mean, P = update(mean, P, first, one, known.index(name), R)
    return mean, P


# %% active="ipynb" tags=["try"]
# V = R = 0.01 * np.eye(2)
# slam(0.1 * np.eye(3), np.array([[1.0, 0.2]]), 0.5, V, np.array([[[2.0, 0.3]]]),
#      np.array([[7]]), R)

# %% [markdown] tags=["hint"]
# Begin with your filter of exercise 09.5 and a second state, `first`, three zeros long. What
# changes in the prediction, what in the update, what when a landmark comes in?

# %% [markdown] tags=["hint"]
# The way in F leads from `first[:2]` to the new `mean[:2]`. Use it before `first` is moved on.
# The noise of the motion, $G V G^\top$, is that of exercise 09.5.

# %% [markdown] tags=["hint"]
# A new landmark's cross-covariances are $G_x$ times the first three rows of `P`, its own block
# $G_x P_{xx} G_x^\top + G_z R G_z^\top$. So that it comes in from the predicted pose, go through
# the names of a step twice: which were known before the step?


# %% tags=["cases"]
@drawn
def _in_the_room(
    rng: np.random.Generator,
    n: int,
    names: int,
    at_once: int = 1,
    unseen: float = 0.0,
    *,
    dt: float = 0.4,
    still: bool = False,
) -> Any:
    """Draw P0, u, dt, V, z, ids, R of n steps in which up to `at_once` landmarks are seen."""
    P0, u, dt, V, _, _, R = in_the_room(n, names, dt=dt, doubt=0.02, still=still)(rng)
    room = np.round(rng.uniform(3, 6, (names, 2)) * rng.choice([-1, 1], (names, 2)), 2)
    pose = rng.multivariate_normal(np.zeros(3), P0)
    z, ids = np.full((n, at_once, 2), np.nan), np.full((n, at_once), -1)
    for k, (v, omega) in enumerate(u):
        pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
        for j, name in enumerate(rng.permutation(names)[:at_once]):
            if rng.random() >= unseen:
                d = room[name] - pose[:2]
                seen = np.array([np.hypot(*d), np.arctan2(d[1], d[0]) - pose[2]])
                seen = seen + rng.normal(0, 0.05, 2)
                z[k, j], ids[k, j] = np.round([seen[0], wrap_angle(seen[1])], 3), 10 * name
    return P0, u, dt, V, z, ids, R


@cache
def _forty_drives() -> list[tuple[Any, ...]]:
    """Drive forty robots in a circle among four stones: what `slam` is given, last heading."""
    stones = np.array([[4.0, 2.0], [3.0, -4.0], [-4.0, 3.0], [-3.0, -3.0]])
    P0, R = np.diag([1e-6, 1e-6, np.deg2rad(10) ** 2]), np.diag([0.05, 0.03]) ** 2
    V, u = 0.03**2 * np.eye(2), np.tile([0.5, 0.4], (40, 1))
    ids, found = (np.arange(40)[:, None] + [0, 1]) % 4, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        pose, z = np.array([0.0, 0.0, np.deg2rad(10) * rng.standard_normal()]), []
        for names, (v, omega) in zip(ids, u + rng.normal(0, 0.03, u.shape), strict=True):
            pose = pose + 0.5 * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
            d = stones[names] - pose[:2]
            bearing = wrap_angle(np.arctan2(d[:, 1], d[:, 0]) - pose[2])
            z.append(np.column_stack([np.hypot(*d.T), bearing]))
        z = z + rng.normal(0, [0.05, 0.03], (40, 2, 2))
        found.append(((P0, u, 0.5, V, z, ids, R), pose[2]))
    return found


def _headings(function: Any) -> tuple[Array, Array]:
    """Errors of the last heading on the forty drives and the sigmas that are reported, degrees."""
    error, sigma = [], []
    for given, heading in _forty_drives():
        mean, P = function(*given)
        error.append(wrap_angle(float(np.asarray(mean)[2]) - heading))
        sigma.append(np.sqrt(max(float(np.asarray(P)[2, 2]), 1e-12)))
    return np.rad2deg(error), np.rad2deg(sigma)


@cache
def _usual_headings() -> tuple[Array, Array]:
    return _headings(check_slam.mistaken(_USUAL))


def _slam_drawn(ax: Any, function: Any) -> None:
    """Draw heading errors of forty robots, two sigmas as reported, and the usual EKF's in grey."""
    from slamlab import plots

    said = []
    for k, (error, sigma) in enumerate([_headings(function), _usual_headings()]):
        at = np.arange(1, 41) + 0.4 * k
        colour = "0.5" if k else plots.COLOURS["estimate"]
        ax.errorbar(at, 0 * at, 2 * sigma, fmt="none", color=colour, lw=2.5, alpha=0.5)
        ax.plot(at, error, "o", color="0.5" if k else plots.COLOURS["truth"], markersize=3)
        nees = np.mean((error / sigma) ** 2)
        said.append(f"σ {sigma.mean():.1f}°, NEES {nees:.1f}")
    ax.set(xlabel="robot", ylabel="heading error and ±2σ (°)", ylim=(-35, 35))
    ax.set_title(f"{said[0]}\ngrey: {said[1]}")


_USUAL = (
    "first[1] - mean[1], mean[0] - first[0] => -v * dt * s, v * dt * c",
    "update(mean, P, first,  => update(mean, P, mean, ",
)

check_slam = Check(
    slam,
    "mean, P",
    {
        "a drive on which nothing is seen": _in_the_room(4, 1, unseen=1.0),
        "one landmark, first seen after a step": _in_the_room(1, 1, dt=0.8),
        "a robot that stands still after its first step": _in_the_room(12, 3, still=True),
        "two new landmarks in one step": _in_the_room(1, 2, 2),
        "one landmark, seen again and again": _in_the_room(8, 1),
        "five landmarks": _in_the_room(20, 5),
        "a drive with steps that see nothing": _in_the_room(20, 4, unseen=0.4),
        "two landmarks in each step": _in_the_room(10, 2, 2),
        "up to three of five landmarks in a step": _in_the_room(14, 5, 3, 0.3),
        "a heading past half a turn to the right": (
            0.01 * np.eye(3),
            [[0.5, -2.5]] * 3,
            0.5,
            0.01 * np.eye(2),
            [[[np.nan, np.nan]]] * 3,
            [[-1], [-1], [-1]],
            0.01 * np.eye(2),
        ),
        "a heading past half a turn": (
            0.01 * np.eye(3),
            [[0.5, 2.5]] * 3,
            0.5,
            0.01 * np.eye(2),
            [[[np.nan, np.nan]]] * 3,
            [[-1], [-1], [-1]],
            0.01 * np.eye(2),
        ),
    },
    tolerance=1e-6,
    picture=_slam_drawn,
)


# %% tags=["mistakes"]
def _sorted(*given: Any) -> Any:
    mean, P = slam(*given)
    names = list(dict.fromkeys(int(i) for i in np.ravel(given[5]) if i >= 0))
    order = [3 + 2 * k + d for k in np.argsort(names) for d in (0, 1)]
    return mean[[0, 1, 2, *order]], P[np.ix_([0, 1, 2, *order], [0, 1, 2, *order])]


_LEAK = "first[k : k + 2] - first[:2] => mean[k : k + 2] - first[:2]"
_OLD_POSE = (
    "mean[k : k + 2] - mean[:2] => mean[k : k + 2] - first[:2]",
    "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]",
)
_with_leak = check_update.mistaken(_LEAK)
_with_old_pose = check_update.mistaken(_OLD_POSE)
_with_both = check_update.mistaken((_LEAK, *_OLD_POSE))


check_slam.mistakes = {
    "the sensor's noise is missing in a new landmark": " + G_z @ R @ G_z.T => ",
    "a new landmark is tied to the pose only: the rest of the map is, too": (
        "cross = G_pose @ P[:3]"
        " => cross = np.hstack([G_pose @ P[:3, :3], np.zeros((2, len(P) - 3))])"
    ),
    "the landmarks were sorted by name: expected in the order of first sight": _sorted,
    "V acts on a velocity for dt: G V G^T has dt squared in it, not dt": (
        "G @ V @ G.T => G @ V @ G.T / dt"
    ),
    "this is the usual EKF: F and H are taken at the latest estimates": _USUAL,
    "only the first landmark of a step was used": "zip(seen, names) => zip(seen[:1], names[:1])",
    "new landmarks come in first, from the predicted pose; then the known ones correct": (
        "name in old:\n                continue => name in old:\n                if name in old:\n"
        "                    mean, P = update(mean, P, first, (r, phi), known.index(name), R)\n"
        "                continue",
        "        for one, name in zip(seen, names):\n            if name in old:\n"
        "                mean, P = update(mean, P, first, one, known.index(name), R)\n => ",
    ),
    "a correction moved the pose in `first`: it is the predicted one until the next prediction": (
        "known.index(name), R) => known.index(name), R)\n                first[:3] = mean[:3]"
    ),
    "your `update` still has a bug of exercise 5, the one in H": (
        "update(mean, P, first,  => _with_leak(mean, P, first, "
    ),
    "your `update` still has a bug of exercise 5, the one in the innovation": (
        "update(mean, P, first,  => _with_old_pose(mean, P, first, "
    ),
    "your `update` still has the two bugs of exercise 5": (
        "update(mean, P, first,  => _with_both(mean, P, first, "
    ),
    "H is taken at the latest estimates: landmarks in `first` stay where they were placed": (
        "update(mean, P, first,  => update(mean, P, mean, "
    ),
    "F runs from the corrected pose: it runs from the pose as predicted a step ago": (
        "first[1] - mean[1], mean[0] - first[0] => -v * dt * s, v * dt * c"
    ),
    "the pose in `first` stayed at the start: it is the predicted one, step by step": (
        "first[:3] = mean[:3] => pass"
    ),
    "the start is uncertain: P begins as P0": (
        "np.zeros(3), P0, np => np.zeros(3), np.zeros((3, 3)), np"
    ),
    "the noise of the motion is missing: add G V G^T to the block of the pose": (
        "G @ V @ G.T) => np.zeros((3, 3)))"
    ),
    "nothing was predicted: the robot moves before it observes": (
        "mean[:2] += v * dt * np.array([c, s]) => mean[:2] += 0.0"
    ),
    "F is the identity here: uncertainty of the heading becomes one of the position": (
        "F[:2, 2] = first[1] - mean[1], mean[0] - first[0] => pass"
    ),
    "the turn in F goes the wrong way: expected (-y, x) of the way": (
        "first[1] - mean[1], mean[0] - first[0] => mean[1] - first[1], first[0] - mean[0]"
    ),
    "a new landmark has no cross-covariances: it was placed from the pose": (
        "[[P, cross.T], [cross,  => [[P, 0 * cross.T], [0 * cross, "
    ),
    "landmarks known already are not used: update with them": (
        "mean, P = update(mean, P, first, one, known.index(name), R) => pass"
    ),
    "the heading is not wrapped after the motion": (
        "wrap_angle(mean[2] + omega * dt) => mean[2] + omega * dt"
    ),
    "only the pose was returned: expected state and covariance of all landmarks too": (
        "return mean, P => return mean[:3], P[:3, :3]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 6: a filter that does not learn where north is
#
# What to notice: it is the filter of chapter 09 with one more vector, and that vector is written
# in two places only, after a prediction and when a landmark comes in. A correction changes nothing
# that stands in it.

# %% [markdown] tags=["solution"]
# The usual EKF beside it: the way in $F$ from the corrected pose, and `update` at the latest
# estimates.

# %% active="ipynb" tags=["solution"]
# def with_a_landmark(mean, P, z, R):
#     r, angle = z[0], mean[2] + z[1]
#     c, s = np.cos(angle), np.sin(angle)
#     G_pose = np.array([[1.0, 0.0, -r * s], [0.0, 1.0, r * c]])
#     G_z = np.array([[c, -r * s], [s, r * c]])
#     cross = G_pose @ P[:3]
#     own = cross[:, :3] @ G_pose.T + G_z @ R @ G_z.T
#     point = mean[:2] + r * np.array([c, s])
#     return np.append(mean, point), np.block([[P, cross.T], [cross, own]])

# %% active="ipynb" tags=["solution"]
# def usual(P0, u, dt, V, z, ids, R):
#     mean, P, known = np.zeros(3), P0, []
#     for (v, omega), seen, names in zip(u, z, ids):
#         c, s = dt * np.cos(mean[2]), dt * np.sin(mean[2])
#         F = np.array([[1.0, 0.0, -v * s], [0.0, 1.0, v * c], [0.0, 0.0, 1.0]])
#         G = np.array([[c, 0.0], [s, 0.0], [0.0, dt]])
#         mean[:3] += G @ [v, omega]
#         mean[2] = wrap_angle(mean[2])
#         P, old = predict_cov(P, F, G @ V @ G.T), list(known)
#         for one, name in zip(seen, names):
#             if name >= 0 and name not in old:
#                 mean, P = with_a_landmark(mean, P, one, R)
#                 known.append(name)
#         for one, name in zip(seen, names):
#             if name in old:
#                 mean, P = update(mean, P, mean, one, known.index(name), R)
#     return mean, P
#
# check_slam(usual)

# %% [markdown] tags=["solution"]
# Which of the two is consistent? Sixty robots, each with 10° (σ) of heading and no compass,
# observe four stones, two in each step: once they stand still, once they drive in a circle.
# Nothing that they observe depends on north, so 10° should remain at the end. The squared error of
# the heading in units of the variance that the filter reports has the mean 1; the band says how
# far the mean of sixty may be from it.

# %% active="ipynb" tags=["solution"]
# def drive(rng, u):
#     stones = np.array([[4.0, 2.0], [3.0, -4.0], [-4.0, 3.0], [-3.0, -3.0]])
#     P0, R = np.diag([1e-6, 1e-6, np.deg2rad(10) ** 2]), np.diag([0.05, 0.03]) ** 2
#     V = np.diag([0.03, 0.03]) ** 2 * (u != 0).any()
#     pose = np.array([0.0, 0.0, np.deg2rad(10) * rng.standard_normal()])
#     z, ids = [], (np.arange(len(u))[:, None] + [0, 1]) % 4
#     for k, (v, omega) in enumerate(rng.multivariate_normal([0, 0], V, len(u)) + u):
#         pose = pose + 0.5 * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
#         x, y = (stones[ids[k]] - pose[:2]).T
#         true = np.column_stack([np.hypot(x, y), wrap_angle(np.arctan2(y, x) - pose[2])])
#         z.append(true + rng.multivariate_normal([0, 0], R, 2))
#     return (P0, u, 0.5, V, np.array(z), ids, R), pose

# %% active="ipynb" tags=["solution"]
# def heading(filter_, u):
#     claimed, squared = [], []
#     for seed in range(60):
#         given, pose = drive(np.random.default_rng(seed), u)
#         mean, P = filter_(*given)
#         claimed.append(np.rad2deg(np.sqrt(P[2, 2])))
#         squared.append(wrap_angle(mean[2] - pose[2]) ** 2 / P[2, 2])
#     return np.mean(claimed), np.mean(squared)
#
# low, high = chi2_band(1, 60)
# print(f"mean NEES of the heading expected between {low:.2f} and {high:.2f}")
# speeds = {"standing": np.zeros((60, 2)), "driving": np.tile([0.5, 0.4], (60, 1))}
# for name, u in speeds.items():
#     for filter_ in (usual, slam):
#         claimed, squared = heading(filter_, u)
#         print(f"{name:9s} {filter_.__name__:6s} reports {claimed:4.1f} deg, "
#               f"NEES {squared:5.2f}")

# %% [markdown] tags=["solution"]
# The usual EKF reports less than a third of the uncertainty, and errs by more than three times
# what it reports. It has learned a heading that nothing measured, from the differences between
# its own Jacobians. With one vector that stays where it was put, the 10° remain, and the band
# holds the error.

# %% [markdown] tags=["statement"]
# **What you have now**: a prediction without a product as large as the map, the accounts of the
# compressed EKF, a number for what a filter believes without a measurement, and an EKF-SLAM that
# does not learn where north is. The solutions are in
# [Solutions 10](../solutions/10_convergence_consistency_and_cost.ipynb).
