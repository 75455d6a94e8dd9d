"""Exercises, chapter 10: a door, many steps at once, the accounts of a day, a consistent filter.

What landmarks share, P2's time update (9) with the cross block, the accounts of the compressed
EKF joined, and first-estimates Jacobians (Huang, Mourikis and Roumeliotis, 2008).
"""

# mypy: disable-error-code="var-annotated"
# A solution is written as a student writes it, without types inside.

from __future__ import annotations

from functools import cache
from math import erfc
from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn, in_the_room
from slamlab.exercises._report import Array, Check, Ints
from slamlab.geometry import wrap_angle

__all__ = [
    "check_door_width",
    "check_joined",
    "check_leaked",
    "check_predict_cov",
    "check_slam",
    "check_update",
]


# %% [markdown] tags=["chapter"]
# # Exercises 10: convergence, consistency and cost
#
# Six exercises. The first three are about what a map shares: a door whose width is known better
# than its posts, twenty steps of the wheels for one of the map, and landmarks that are corrected
# without being seen. The other three are one story: how a heading leaks into a filter that never
# measured it, a repair with two bugs, and forty robots that do not learn where north is. The
# chapter is
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
# ## Exercise 1: does the robot fit through the door?
#
# A robot without a compass has observed the two posts of a door a hundred times. Its own place was
# known to 20 cm at the start and its heading to 10° (σ), so neither post can be found on the
# building's plan: each is uncertain by more than half a metre. Even their *difference* $m_1 - m_2$
# is uncertain by 17 cm, because with a wrong heading the door is turned. But all that the robot
# has to know is whether it fits through.
#
# The state is $(x, y, \theta, m_1, m_2)$, each landmark two numbers. Write the width of the door,
# $w = \|m_1 - m_2\|$, and its variance, to first order: the derivative of $w$ with respect to the
# seven numbers is the whole task.
#
# **On paper first.** The lesson finds $\mathrm{Var}(m_1 - m_2) = 2r/N$ along one axis, after $N$
# observations of both (its $K$). Here the noise is $r = 0.3^2$ m² on *both* axes, so any direction
# of the door has it. Which σ has the *width* then, after 10 observations and after 100? The map
# says 0.94 m, the robot is 0.80 m wide. **Decide**: may it drive after 10 observations, and after
# 100? And why does the uncertain heading not count?
#
# Grey in the picture are the widths in 2000 maps that the robot may have, each with its own turn
# and its own readings; the curves are the widths as you report them. The title has, by your σ, how
# probable it is that the robot sticks.


# %% tags=["exercise", "predict"]
def door_width(mean: Array, P: Array) -> tuple[float, float]:
    """Distance of two landmarks, and its variance.

    Parameters
    ----------
    mean : ndarray, shape (7,)
        Pose (m, m, rad) and two landmarks (m), which are not in the same place.
    P : ndarray, shape (7, 7)
        Its covariance.

    Returns
    -------
    width : float
        In metres.
    variance : float
        In square metres, to first order.
    """
    d = mean[3:5] - mean[5:7]
    width = np.hypot(d[0], d[1])
    g = np.concatenate([np.zeros(3), d / width, -d / width])
    return float(width), float(g @ P @ g)


# %% active="ipynb" tags=["try"]
# door_width(np.array([0, 0, 0, 3.0, 1.0, 3.0, 0.0]), 0.01 * np.eye(7))

# %% [markdown] tags=["hint"]
# Move the first post by 1 cm along the door. How does the width change? Move it by 1 cm across
# the door. And the second post?

# %% [markdown] tags=["hint"]
# So the derivative by $m_1$ is a vector of length one. In which direction? The one by $m_2$ is the
# same with the other sign, and the three numbers of the pose do not occur.

# %% [markdown] tags=["hint"]
# With the derivative $g$, seven numbers, the variance of $w$ is that of a linear map of the state.
# It has the cross-covariances of the posts in it: what they have in common must come off.


# %% tags=["cases"]
@drawn
def _posts(rng: np.random.Generator) -> Any:
    d = rng.uniform(0.5, 3, 2) * rng.choice([-1, 1], 2)
    mean = np.concatenate([a_pose(rng), np.round(rng.uniform(-5, 5, 2), 2)])
    return np.append(mean, np.round(mean[3:] + d, 2)), a_covariance(rng, 7)


def _rigid(mean: Any, shift: float, turn: float) -> tuple[Any, Array]:
    """Return a state of which only the shift and the turn of the whole map are uncertain."""
    T = np.zeros((7, 3))
    T[[0, 3, 5], 0] = T[[1, 4, 6], 1] = T[2, 2] = 1.0
    T[3:, 2] = [-mean[4], mean[3], -mean[6], mean[5]]
    return mean, T @ np.diag([shift, shift, turn]) ** 2 @ T.T


_DOOR = [0.0, 0.0, 0.0, 3.0, 1.0, 3.5, 0.2]


def _door_width_drawn(ax: Any, function: Any) -> None:
    """Draw the width of a door in 2000 maps (grey) and as it is reported, twice."""
    from slamlab import plots

    rng, widths, robot = np.random.default_rng(1), np.linspace(0.4, 1.5, 400), 0.80
    turn, said = np.deg2rad(10) * rng.standard_normal(2000), []
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    P = _rigid(_DOOR, 0.2, np.deg2rad(10))[1]
    for n, style in ((10, "--"), (100, "-")):
        noisy = P + np.diag([0.0] * 3 + [0.09 / n] * 4)
        width, variance = (float(one) for one in function(np.array(_DOOR), noisy))
        sigma = np.sqrt(max(variance, 1e-8))
        sticks = 50 * erfc((width - robot) / sigma / np.sqrt(2))
        said.append(f"σ {100 * sigma:.1f} cm, sticks {sticks:{'.0f' if sticks > 1 else '.2f'}} %")
        posts = np.array(_DOOR[3:]).reshape(2, 2) + rng.normal(0, 0.3 / np.sqrt(n), (2000, 2, 2))
        x, y = posts[..., 0], posts[..., 1]
        x, y = c * x - s * y, s * x + c * y
        true = np.hypot(x[:, 0] - x[:, 1], y[:, 0] - y[:, 1])
        ax.hist(true, 40, density=True, color="0.5", alpha=0.4)
        curve = np.exp(-0.5 * ((widths - width) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
        ax.plot(widths, curve, style, color=plots.COLOURS["estimate"], label=f"{n} observations")
    ax.axvline(robot, color=plots.COLOURS["truth"], lw=1.2, label="robot, 0.80 m")
    ax.set(xlabel="width of the door (m)", ylabel="how often", yticks=[], ylim=(0, 12))
    ax.legend(loc="upper right", fontsize=7)
    ax.set_title(f"10: {said[0]};\n100: {said[1]}")


check_door_width = Check(
    door_width,
    "width, variance",
    {
        "two landmarks without any cross-covariance": (
            _DOOR,
            np.diag([0.1, 0.2, 0.3, 0.04, 0.05, 0.06, 0.07]),
        ),
        "a door that only its shift makes uncertain": _rigid(_DOOR, 0.2, 0.0),
        "a door that only its turn makes uncertain": _rigid(_DOOR, 0.0, np.deg2rad(10)),
        "a general map": _posts(),
    },
    picture=_door_width_drawn,
)


# %% tags=["mistakes"]
def _by_blocks(mean: Array, P: Array, cross: float = 1.0) -> tuple[float, float]:
    u = (mean[3:5] - mean[5:7]) / np.linalg.norm(mean[3:5] - mean[5:7])
    own, both = P[3:5, 3:5] + P[5:7, 5:7], P[3:5, 5:7] + P[5:7, 3:5]
    return door_width(mean, P)[0], float(u @ (own - cross * both) @ u)


def _spread(mean: Array, P: Array) -> float:
    return float(np.trace(P[3:5, 3:5] + P[5:7, 5:7] - P[3:5, 5:7] - P[5:7, 3:5]))


check_door_width.mistakes = {
    "the cross-covariances are missing: what both posts share comes off": (
        lambda mean, P: _by_blocks(mean, P, 0.0)
    ),
    "one cross block is not enough: both come off": lambda mean, P: _by_blocks(mean, P, 0.5),
    "this is the variance of a sum: the derivative by m2 has the other sign": (
        "-d / width]) => d / width])"
    ),
    "the derivative of a length is a unit vector: divide d by the width": (
        "d / width, -d / width => d, -d"
    ),
    "d was divided by its square: the derivative of a length is a unit vector": (
        "d / width, -d / width => d / width**2, -d / width**2"
    ),
    "this is the uncertainty across the door, where the turn counts: the width changes along d": (
        "d = mean[3:5] - mean[5:7] => d = (mean[3:5] - mean[5:7])[::-1] * [-1, 1]"
    ),
    "the variances of both axes were added: the width changes along the door only": (
        lambda mean, P: (door_width(mean, P)[0], _spread(mean, P))
    ),
    "this is the standard deviation: the variance was asked for": (
        lambda mean, P: (door_width(mean, P)[0], max(door_width(mean, P)[1], 0.0) ** 0.5)
    ),
    "the state starts with three numbers of the pose: m1 stands at 3 and 4": (
        "mean[3:5] - mean[5:7] => mean[2:4] - mean[4:6]",
        "[np.zeros(3), d / width, -d / width] => [np.zeros(2), d / width, -d / width, [0.0]]",
    ),
    "x and y of a landmark stand side by side: (x, y, theta, x1, y1, x2, y2)": (
        "mean[3:5] - mean[5:7] => mean[3::2] - mean[4::2]",
        "[np.zeros(3), d / width, -d / width]"
        " => [np.zeros(3), np.column_stack([d / width, -d / width]).ravel()]",
    ),
    "only the first post moves in your derivative: the second is uncertain too": (
        "-d / width]) => 0 * d])"
    ),
    "this is the distance of a post from the robot": (
        "mean[3:5] - mean[5:7] => mean[3:5] - mean[:2]",
    ),
    "the width is the length of the difference, not the difference of the lengths": (
        "width = np.hypot(d[0], d[1])"
        " => width = np.linalg.norm(mean[3:5]) - np.linalg.norm(mean[5:7])"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 1: does the robot fit through the door?
#
# A post that moves along the door changes the width by as much; across the door it changes
# nothing, to first order. So the derivative is the unit vector of the door, once with each sign. A
# turn of the map moves the far end of the door *across* it, and a shift moves both ends alike:
# neither is in the width. The noise of the readings along the door remains, of both posts:
# $\sqrt{2 \cdot 0.09 / 10}$ is 13.4 cm, and with 100 observations 4.2 cm. No observation made the
# posts themselves better than the start.
#
# Does it fit? The door is 14 cm wider than the robot, on the map. After 10 observations that is
# little more than one σ, and by this σ, which is of first order, one robot in seven sticks. After
# 100 it is more than three, and fewer than one in 2000 stick: drive.

# %% [markdown] tags=["solution"]
# With the variances of both axes added, the turn counts: a door that is known exactly, but for its
# turn, seems to be uncertain. And without the cross-covariances no number of observations helps:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: the widths of a door in 2000 maps; in the left one both reported curves are flat, with a standard deviation of more than 80 cm, in the right one they cover the widths."}}
# def without_ties(mean, P):
#     width, _ = door_width(mean, P)
#     u = (mean[3:5] - mean[5:7]) / width
#     return width, u @ (P[3:5, 3:5] + P[5:7, 5:7]) @ u
#
# check_door_width.draw(without_ties)

# %% [markdown] tags=["statement"]
# ## Exercise 2: twenty steps of the wheels, one of the map
#
# The wheels report a hundred times per second, the scanner five times. Between two scans the pose
# moves in $T = 20$ small steps; step $k$ has the derivative $F_k$ and the noise $Q_k$, and the
# landmarks do not move. One step at a time, [P2](../../book/bibliography.md#p2complexity) prints
# in its formula (9) what becomes of the covariance of the *pose*, $P_{xx} \leftarrow F P_{xx}
# F^\top + Q$, and no more. A program that stops there moves the pose, and not what the pose
# shares with the map.
#
# Predict the *whole* covariance over all $T$ steps. The lesson multiplies matrices as large as the
# map in each step: $203 \times 203$ with 100 landmarks, two products per step. That is slow, and
# here it fails: some landmarks of the map are not seen yet, with the variance `inf` on both axes
# and covariances of zero. They must come out as they are, and $0 \cdot \infty$ is not a number.
# How few multiplications can it be, if nothing is left out? **Guess** how many thousand, for 100
# landmarks.
#
# The picture has the correlations of a pose and three landmarks after twenty steps on a curve.
# Above it are two numbers: the smallest eigenvalue of that covariance, and how many
# multiplications your products took with 100 landmarks (`@` is counted, `einsum` cannot be); the
# check does not count them. Then draw (9) alone as well, with the other blocks left as they were:
# what is wrong with its eigenvalue?


# %% tags=["exercise", "predict"]
def predict_cov(P: Array, F: Array, Q: Array) -> Array:
    """Covariance of pose and map after T steps without an observation.

    Parameters
    ----------
    P : ndarray, shape (3 + 2n, 3 + 2n)
        Before the first step; a landmark not yet seen has `inf` on the diagonal.
    F : ndarray, shape (T, 3, 3)
        Of each step, the first one first: derivative of the new pose by the old one.
    Q : ndarray, shape (T, 3, 3)
        Of each step: covariance of the motion noise that it adds. T may be 0.

    Returns
    -------
    ndarray, shape (3 + 2n, 3 + 2n)
    """
    predicted, Phi = P.copy(), np.eye(3)
    for A, N in zip(F, Q):
        predicted[:3, :3] = A @ predicted[:3, :3] @ A.T + N
        Phi = A @ Phi
    predicted[:3, 3:] = Phi @ P[:3, 3:]
    predicted[3:, :3] = predicted[:3, 3:].T
    return predicted


# %% active="ipynb" tags=["try"]
# predict_cov(np.eye(5), np.array([np.eye(3)] * 2), 0.1 * np.array([np.eye(3)] * 2))

# %% [markdown] tags=["hint"]
# Which blocks of $P$ speak of the pose? Which of them does the noise of a step enter?

# %% [markdown] tags=["hint"]
# $P_{xm}$ has the pose on one side only. What do two steps make of it, and which matrix of three
# rows does the same at once? Which of the two $F$ is on the left?

# %% [markdown] tags=["hint"]
# The block of the pose goes through all steps one by one: a noise that came early is moved by the
# later steps. $P_{xm}$ waits, while a product of the $F_k$ is built up, and is touched once. Make
# a copy first: the old $P$ may still be needed.


# %% tags=["cases"]
@drawn
def _drive(rng: np.random.Generator, T: int, landmarks: int, noise: float = 1.0) -> Any:
    F = np.eye(3) + np.round(rng.normal(0, 0.5, (T, 3, 3)), 2)
    Q = [noise * a_covariance(rng, 3, 0.3) for _ in range(T)]
    return a_covariance(rng, 3 + 2 * landmarks), F, np.reshape(Q, (T, 3, 3))


@drawn
def _one_unseen(rng: np.random.Generator, T: int, landmarks: int) -> Any:
    P, F, Q = _drive(T, landmarks)(rng)
    k = 3 + 2 * int(rng.integers(landmarks))
    P[k : k + 2] = P[:, k : k + 2] = 0.0
    P[k, k] = P[k + 1, k + 1] = np.inf
    return P, F, Q


class _Counted(np.ndarray):
    """An array whose matrix products count their multiplications."""

    total = 0

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **more: Any
    ) -> Any:
        plain = [np.asarray(x) if isinstance(x, _Counted) else x for x in inputs]
        given = {} if out is None else {"out": tuple(np.asarray(x) for x in out)}
        result = getattr(ufunc, method)(*plain, **given, **more)
        if ufunc is np.matmul:
            _Counted.total += np.size(result) * np.shape(plain[0])[-1]
        return result.view(_Counted) if isinstance(result, np.ndarray) else result

    def dot(self, other: Any, out: Any = None) -> Any:
        """Count `a.dot(b)` as `a @ b`."""
        return self @ other

    def __array_function__(self, function: Any, types: Any, given: Any, more: Any) -> Any:
        if function is np.dot:
            return given[0] @ given[1]
        return super().__array_function__(function, types, given, more)


def _multiplications(function: Any) -> int:
    """Count the multiplications of twenty steps with 100 landmarks."""
    rng = np.random.default_rng(0)
    _Counted.total = 0
    given = np.eye(203), np.eye(3) + 0.1 * rng.standard_normal((20, 3, 3)), np.ones((20, 3, 3))
    function(*(one.view(_Counted) for one in given))
    return _Counted.total


def _predict_cov_drawn(ax: Any, function: Any) -> None:
    """Draw the correlations of pose and three landmarks after twenty steps on a curve."""
    places = np.array([[2.0, 1.0], [1.0, -2.0], [-1.0, 2.0]])
    across = np.column_stack([-places[:, 1], places[:, 0]])
    turn = np.concatenate([[0.0, 0.0, 1.0], across.ravel()])
    shift = np.tile(np.eye(2), (4, 1))
    shared = np.column_stack([np.insert(shift, 2, 0.0, axis=0), 0.3 * turn])
    P = 0.04 * shared @ shared.T + 0.004 * np.eye(9)
    F = np.array([[1, 0, -0.1], [0, 1, 0.3], [0, 0, 1]])
    Q = np.diag([0.0005, 0.0005, 0.0002])
    P = np.asarray(function(P, np.tile(F, (20, 1, 1)), np.tile(Q, (20, 1, 1))), float)
    sigma = np.sqrt(np.abs(np.diag(P))) + 1e-12
    low, count = np.linalg.eigvalsh((P + P.T) / 2)[0], _multiplications(function)
    ax.imshow(np.abs(P / np.outer(sigma, sigma)), cmap="Blues", vmin=0, vmax=1)
    ax.grid(visible=False)
    ax.set(xlabel="x, y, heading, landmarks", xticks=[], yticks=[])
    work = (
        f"{count / 1000:,.0f} thousand multiplications" if count else "products cannot be counted"
    )
    ax.set_title(f"smallest eigenvalue {low:+.4f}\n{work}")


check_predict_cov = Check(
    predict_cov,
    "P",
    {
        "a pose without landmarks": _drive(4, 0),
        "one step, one landmark": _drive(1, 1),
        "two steps, three landmarks, no motion noise": _drive(2, 3, 0.0),
        "three steps, four landmarks": _drive(3, 4),
        "no step at all": _drive(0, 2),
        "a robot that stands still gets its noise all the same": lambda rng: (
            a_covariance(rng, 7),
            np.tile(np.eye(3), (5, 1, 1)),
            [a_covariance(rng, 3) for _ in range(5)],
        ),
        "a landmark that is not seen yet: its variance stays infinite": _one_unseen(3, 3),
    },
    picture=_predict_cov_drawn,
)


# %% tags=["mistakes"]
def _noisy_map(P: Array, F: Array, Q: Array) -> Array:
    P = predict_cov(P, F, Q)
    P[3:, 3:] += sum(N[0, 0] for N in Q) * np.eye(len(P) - 3)
    return P


def _noise_at_the_end(P: Array, F: Array, Q: Array) -> Array:
    P = predict_cov(P, F, 0 * Q)
    P[:3, :3] += Q.sum(axis=0)
    return P


def _whole_products(P: Array, F: Array, Q: Array) -> Array:
    for A, N in zip(F, Q, strict=True):
        whole = np.eye(len(P))
        whole[:3, :3] = A
        P = whole @ P @ whole.T
        P[:3, :3] += N
    return P.copy()


def _three_whole_rows(P: Array, F: Array, Q: Array) -> Array:
    predicted, rows = predict_cov(P, F, Q), np.eye(3, len(P))
    for A in F:
        rows = A @ rows
    predicted[:3, 3:] = (rows @ P)[:, 3:]
    predicted[3:, :3] = predicted[:3, 3:].T
    return predicted


check_predict_cov.mistakes = {
    "your products are as large as the map, and 0 times inf is not a number: what the motion does "
    "not change must stay out of them": _whole_products,
    "P_xm was taken from a product with all of P, and 0 times inf is not a number: what the motion "
    "does not change must stay out of it": _three_whole_rows,
    "P_xm stayed as it was: it moves with the pose": "Phi @ P[:3, 3:] => P[:3, 3:]",
    "P_xm was changed in the rows only: a covariance is symmetric, P_mx = P_xm^T": (
        "predicted[3:, :3] = predicted[:3, 3:].T => pass"
    ),
    "P_mx was changed in the columns only: a covariance is symmetric, P_mx = P_xm^T": (
        "predicted[:3, 3:] = Phi @ P[:3, 3:]\n    predicted[3:, :3] = predicted[:3, 3:].T"
        " => predicted[3:, :3] = (Phi @ P[:3, 3:]).T"
    ),
    "the order of the steps is reversed in P_xm: the first F comes first, next to P_xm": (
        "Phi = A @ Phi => Phi = Phi @ A"
    ),
    "P_xm has the last F only: all steps move it": "Phi = A @ Phi => Phi = A",
    "P_xm has the first F only: all steps move it": (
        "Phi @ P[:3, 3:] => (F[0] if len(F) else Phi) @ P[:3, 3:]"
    ),
    "P_xm was multiplied by the transposed product": "Phi @ P[:3, 3:] => Phi.T @ P[:3, 3:]",
    "the motion noise Q is missing": " + N => ",
    "the noises were added at the end: an early one is moved by the steps after it": (
        _noise_at_the_end
    ),
    "the motion noise went through its own F too: it is added after the motion": (
        "A @ predicted[:3, :3] @ A.T + N => A @ (predicted[:3, :3] + N) @ A.T"
    ),
    "Q was added to the landmarks as well: they do not move": _noisy_map,
    "this is F^T P F: expected F P F^T": (
        "A @ predicted[:3, :3] @ A.T => A.T @ predicted[:3, :3] @ A",
        "Phi = A @ Phi => Phi = A.T @ Phi",
    ),
    "the pose block is F^T P F: expected F P F^T": (
        "A @ predicted[:3, :3] @ A.T => A.T @ predicted[:3, :3] @ A"
    ),
    "the pose block needs F from both sides: F P_xx F^T": (
        "A @ predicted[:3, :3] @ A.T => A @ predicted[:3, :3]"
    ),
    "the second F of the pose block is not transposed: F P_xx F^T": "@ A.T => @ A",
    "P_xm became zero: pose and map stay correlated": "= Phi @ P[:3, 3:] => = 0 * P[:3, 3:]",
    "only the first step was made": "zip(F, Q) => zip(F[:1], Q[:1])",
    "only the last step was made": "zip(F, Q) => zip(F[-1:], Q[-1:])",
    "only the block of the pose was returned: expected the whole covariance": (
        "return predicted => return predicted[:3, :3]"
    ),
}

# %% [markdown] tags=["solution"]
# ## Solution 2: twenty steps of the wheels, one of the map
#
# Three blocks speak of the pose. Its own block goes through all steps, for each adds its noise.
# $P_{xm}$ has the pose on one side only, and no noise enters it: twenty steps multiply it by
# $F_{20} \cdots F_2 F_1$, a matrix of three rows. With 100 landmarks that takes about 3 thousand
# multiplications. A strip per step takes ten times as many and gives the same numbers. The
# lesson's form takes 335 million, and gives them as long as no variance is infinite. Exercise 3
# uses the same product, there called $\Phi$.

# %% [markdown] tags=["solution"]
# (9) read alone touches the corner only. Each variance is right and each diagonal block is a
# covariance, but the smallest eigenvalue of the whole is below zero: there is a direction, of pose
# and map together, whose variance is negative. The lesson's row B is a filter with that.

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: the correlations of a pose and three landmarks; the smallest eigenvalue is negative on the left and positive on the right."}}
# def corner_only(P, F, Q):
#     predicted = P.copy()
#     for A, N in zip(F, Q):
#         predicted[:3, :3] = A @ predicted[:3, :3] @ A.T + N
#     return predicted
#
# check_predict_cov.draw(corner_only)

# %% [markdown] tags=["statement"]
# ## Exercise 3: the accounts of a day
#
# A robot works in one corner of a building site, without radio; the map of the whole site is on a
# server. The robot's compressed EKF ([page 10d](../10d_convergence_consistency_and_cost.ipynb))
# estimates its region only, the state $a$: pose and near landmarks. For the rest, $b$, it keeps
# **accounts**: three running totals, no larger than $a$, from which follows what the whole filter
# would have made of $b$. When the robot comes home, the server brings $b$ up to date with them
# (index 0: as the robot left):
#
# $$
# P_{ab} = \Phi P_{ab}^0, \quad
# P_{bb} = P_{bb}^0 - P_{ba}^0 \Psi P_{ab}^0, \quad
# \hat x_b = \hat x_b^0 + P_{ba}^0 \vartheta .
# $$
#
# The accounts of one prediction are $F,\ 0,\ 0$. Those of one update, with $H$, gain $K$,
# innovation $\nu$ and its covariance $S$, are $I - K H,\ H^\top S^{-1} H,\ H^\top S^{-1} \nu$.
# A day is many of these, joined one after the other.
#
# At noon the robot writes its accounts to a file and begins new ones, at $I,\ 0,\ 0$. In the
# evening the server has two files, and $P_{ab}^0$, $P_{bb}^0$, $\hat x_b^0$ from before the
# morning. Write the accounts of the whole day. **On paper**: bring $b$ up to date at noon, then
# again in the evening, with the $P_{ab}$ that noon has left. What multiplies $P_{ab}^0$ in the
# end? With a pencil, one number each: $\Phi = 5/6$, $\Psi = 1/6$ in the morning, $6/7$ and $6/35$
# in the afternoon.
#
# In the picture your function joins the accounts of every prediction and every update of a drive
# between two landmarks and two surveyed beacons. At the end they correct eight landmarks far off,
# which the robot has never seen, from grey to blue. Before twenty such drives (the picture shows
# one) these are 1.25 m from their stars on average. **Guess**, then open it: how far after them?
# And in how many of the twenty are they nearer than before?


# %% tags=["exercise", "predict"]
def joined(
    Phi1: Array, Psi1: Array, theta1: Array, Phi2: Array, Psi2: Array, theta2: Array
) -> tuple[Array, Array, Array]:
    """Accounts of the compressed EKF over two stretches, one after the other.

    Parameters
    ----------
    Phi1, Psi1 : ndarray, shape (a, a)
        Of the first stretch.
    theta1 : ndarray, shape (a,)
        The third account: what b is corrected by.
    Phi2, Psi2 : ndarray, shape (a, a)
        Of the second stretch, begun at I and 0.
    theta2 : ndarray, shape (a,)

    Returns
    -------
    Phi, Psi : ndarray, shape (a, a)
        Of both together.
    theta : ndarray, shape (a,)
    """
    return Phi2 @ Phi1, Psi1 + Phi1.T @ Psi2 @ Phi1, theta1 + Phi1.T @ theta2


# %% active="ipynb" tags=["try"]
# one = np.eye(1)
# joined(5 / 6 * one, one / 6, np.zeros(1), 6 / 7 * one, 6 / 35 * one, np.zeros(1))

# %% [markdown] tags=["hint"]
# What is $P_{ab}$ at noon? For the afternoon this is $P_{ab}^0$: put it in.

# %% [markdown] tags=["hint"]
# In the evening $P_{bb}$ is that of noon less $P_{ba} \Psi_2 P_{ab}$, with $P_{ab} = \Phi_1
# P_{ab}^0$. And what is $P_{ba}$, its transpose? Take $P_{ba}^0$ out on the left and $P_{ab}^0$ on
# the right of both terms.

# %% [markdown] tags=["hint"]
# The same with $\hat x_b$. The afternoon speaks of the region as it was at *noon*. Which matrix
# leads from the morning to noon: $\Phi_1$, or the $\Phi$ of the whole day?


# %% tags=["cases"]
@drawn
def _two_stretches(rng: np.random.Generator, a: int) -> Any:
    stretch = [
        (rng.standard_normal((a, a)), a_covariance(rng, a), rng.standard_normal(a))
        for _ in range(2)
    ]
    return (*stretch[0], *stretch[1])


@drawn
def _stretch_and_update(rng: np.random.Generator, first: bool) -> Any:
    a, m = int(rng.integers(2, 8)), int(rng.integers(1, 4))
    P, H = a_covariance(rng, a), rng.standard_normal((m, a))
    S = H @ P @ H.T + 0.5 * np.eye(m)
    W = np.linalg.solve(S, H).T
    update = np.eye(a) - P @ W @ H, W @ H, W @ rng.standard_normal(m)
    F = np.eye(a) + rng.normal(0, 0.3, (a, a)), np.zeros((a, a)), np.zeros(a)
    return (*F, *update) if first else (*update, *F)


_NEAR = np.array([[3.0, 1.0], [1.0, -2.0]])
_FAR = np.array(
    [[9.0, 4.0], [12.0, -2.0], [7.0, -6.0], [14.0, 3.0], [11.0, 7.0], [16.0, -5.0], [6.0, 7.0],
     [18.0, 1.0]]
)  # fmt: skip
_BEACONS = np.array([[0.0, 4.0], [-4.0, -1.0]])


def _site() -> Array:
    """Covariance of pose, two landmarks and eight far ones: shift, turn, and their own errors."""
    points = np.vstack([_NEAR, _FAR])
    T = np.zeros((23, 3))
    T[0, 0] = T[1, 1] = T[2, 2] = 1.0
    T[3::2, 0] = T[4::2, 1] = 1.0
    T[3::2, 2], T[4::2, 2] = -points[:, 1], points[:, 0]
    own = np.diag([0.01, 0.01, 0.001] + [0.01] * 20)
    P: Array = T @ np.diag([0.6, 0.6, 0.08]) ** 2 @ T.T + own
    return P


def _day(function: Any, seed: int) -> tuple[Array, Array, Array, Array]:
    """Drive between two landmarks: P at the start, errors of the far ones, correction, its cov."""
    rng, P, a, J = np.random.default_rng(seed), _site(), 7, np.array([[0.0, -1.0], [1.0, 0.0]])
    error = np.linalg.cholesky(P) @ rng.standard_normal(23)
    e, P_a, x, place, heading = error[:a].copy(), P[:a, :a], np.zeros(a), np.zeros(2), 0.0
    books = np.eye(a), np.zeros((a, a)), np.zeros(a)
    for k in range(30):
        way = 0.2 * np.array([np.cos(heading), np.sin(heading)])
        F, place, heading = np.eye(a), place + way, heading + 0.15
        F[:2, 2], Q = J @ way, np.diag([0.02, 0.02, 0.01, 0, 0, 0, 0]) ** 2
        e, x, P_a = F @ e + rng.normal(0, np.sqrt(np.diag(Q))), F @ x, F @ P_a @ F.T + Q
        books = function(*books, F, np.zeros((a, a)), np.zeros(a))
        seen = [(_NEAR[k % 2], 3 + 2 * (k % 2))] + [(_BEACONS[k // 6 % 2], a)] * (k % 6 == 5)
        c, s = np.cos(heading), np.sin(heading)
        for point, at in seen:
            H = np.zeros((2, a + 2))
            H[:, :2] = -np.array([[c, s], [-s, c]])
            H[:, at : at + 2], H[:, 2] = -H[:, :2], H[:, :2] @ J @ (point - place)
            H = H[:, :a]
            S = H @ P_a @ H.T + 0.01 * np.eye(2)
            W, v = np.linalg.solve(S, H).T, H @ (e - x) + rng.normal(0, 0.1, 2)
            K = P_a @ W
            books = function(*books, np.eye(a) - K @ H, W @ H, W @ v)
            x, P_a = x + K @ v, P_a - K @ S @ K.T
    _, Psi, y = (np.asarray(one, float) for one in books)
    P_ba = P[a:, :a]
    return P[a:, a:], error[a:], P_ba @ y, P[a:, a:] - P_ba @ Psi @ P_ba.T


def _joined_drawn(ax: Any, function: Any) -> None:
    """Draw eight landmarks never seen: grey before one of twenty drives (means above), blue after."""
    from slamlab import plots

    off = []
    for seed in range(20):
        _, error, moved, _ = _day(function, seed)
        ways = [np.hypot(*one.reshape(-1, 2).T).mean() for one in (error, error - moved)]
        off.append(ways)
    before, error, moved, after = _day(function, 12)
    plots.landmarks(ax, _FAR).set_markersize(6)
    for k, point in enumerate(_FAR):
        at = slice(2 * k, 2 * k + 2)
        old, new = point - error[at], point - error[at] + moved[at]
        ax.plot(*np.array([old, new]).T, "-", color="0.6", lw=0.8)
        ax.plot(*old, "x", color="0.5", ms=4)
        ax.plot(*new, "x", color=plots.COLOURS["estimate"], ms=4)
        plots.ellipse(ax, new, after[at, at])
    turn = np.linspace(0, 2 * np.pi, 60)
    ax.plot(4 / 3 * np.sin(turn), 4 / 3 * (1 - np.cos(turn)), **plots.line_style("truth"))
    plots.landmarks(ax, _NEAR).set_markersize(6)
    ax.plot(*_BEACONS.T, "^", color=plots.COLOURS["lidar"], markersize=5)
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(-4, 19), ylim=(-9, 10))
    nearer, (old, new) = sum(new < old for old, new in off), np.mean(off, axis=0)
    ax.set_title(f"{old:.2f} m off, then {new:.2f} m;\nnearer in {nearer} of 20 drives")


check_joined = Check(
    joined,
    "Phi, Psi, theta",
    {
        "one number each": ([[5 / 6]], [[1 / 6]], [0.5], [[6 / 7]], [[6 / 35]], [-0.2]),
        "a prediction, then an update": _stretch_and_update(True),
        "an update, then a prediction": _stretch_and_update(False),
        "a morning and an afternoon": _two_stretches(5),
    },
    tolerance=1e-8,
    picture=_joined_drawn,
)

# %% tags=["mistakes"]
_PSI, _Y = "Phi1.T @ Psi2 @ Phi1", "Phi1.T @ theta2"


check_joined.mistakes = {
    "Psi and theta took the Phi of the whole day: the afternoon speaks of the region at noon": (
        f"{_PSI} => (Phi2 @ Phi1).T @ Psi2 @ Phi2 @ Phi1",
        f"{_Y} => (Phi2 @ Phi1).T @ theta2",
    ),
    "theta took the Phi of the whole day: the afternoon speaks of the region at noon": (
        f"{_Y} => (Phi2 @ Phi1).T @ theta2"
    ),
    "Psi took the Phi of the whole day: the afternoon speaks of the region at noon": (
        f"{_PSI} => (Phi2 @ Phi1).T @ Psi2 @ Phi2 @ Phi1"
    ),
    "Psi and theta were only added: what the afternoon gathers speaks of noon, not of the morning": (
        f"{_PSI} => Psi2",
        f"{_Y} => theta2",
    ),
    "Psi was only added: the second speaks of noon, not of the morning": f"{_PSI} => Psi2",
    "theta was only added: the second speaks of noon, not of the morning": f"{_Y} => theta2",
    "Psi and theta took the second Phi: the first leads from the morning to noon": (
        f"{_PSI} => Phi2.T @ Psi2 @ Phi2",
        f"{_Y} => Phi2.T @ theta2",
    ),
    "Phi has the wrong order: the first stretch comes first, on the right": (
        "Phi2 @ Phi1 => Phi1 @ Phi2"
    ),
    "Psi and theta need the transpose on the left: P_ba is the transpose of P_ab": (
        f"{_PSI} => Phi1 @ Psi2 @ Phi1.T",
        f"{_Y} => Phi1 @ theta2",
    ),
    "Psi needs Phi from both sides": f"{_PSI} => Phi1.T @ Psi2",
    "theta needs the transposed Phi": f"{_Y} => Phi1 @ theta2",
    "Psi is Phi^T Psi Phi, with the transpose on the left": f"{_PSI} => Phi1 @ Psi2 @ Phi1.T",
    "the Psi of the morning is missing: information adds up": f"Psi1 + {_PSI} => {_PSI}",
    "the theta of the morning is missing": f"theta1 + {_Y} => {_Y}",
    "the morning was carried to noon, not the afternoon back: P_ab^0 is that of the morning": (
        f"Psi1 + {_PSI} => Psi2 + Phi2 @ Psi1 @ Phi2.T",
        f"theta1 + {_Y} => theta2 + Phi2 @ theta1",
    ),
    "Phi was added: two linear maps one after the other are a product": (
        "return Phi2 @ Phi1 => return Phi2 + Phi1"
    ),
    "Psi has the wrong sign: information adds up": f"Psi1 + {_PSI} => Psi1 - {_PSI}",
}

# %% [markdown] tags=["solution"]
# ## Solution 3: the accounts of a day
#
# At noon $P_{ab} = \Phi_1 P_{ab}^0$. In the evening it is $\Phi_2 \Phi_1 P_{ab}^0$, and
#
# $$
# P_{bb} = P_{bb}^0 - P_{ba}^0 \Psi_1 P_{ab}^0 - P_{ba}^0 \Phi_1^\top \Psi_2 \Phi_1 P_{ab}^0 .
# $$
#
# So the day has $\Phi_2 \Phi_1$, $\Psi_1 + \Phi_1^\top \Psi_2 \Phi_1$ and, from $\hat x_b$ in the
# same way, $\vartheta_1 + \Phi_1^\top \vartheta_2$. With the pencil's numbers $\Phi = 5/7$ and
# $\Psi = 2/7$: 0.714 and 0.286, what page 10d finds for two observations. Take one update for the
# second stretch, and the recursion of page 10d comes out. It shows why $\Psi$ and $\vartheta$ need
# the $\Phi$ from *before* the update: what a stretch gathers speaks of the region at *its* start.
#
# The guess: the title of the right panel has it, 0.32 m on average, and nearer in 18 of 20 drives.
# The other two began nearer than the filter's covariance after a drive expects. The whole map
# shares one shift and one turn, and from the beacons the robot learns both. Without them all eight
# stay where they are.

# %% [markdown] tags=["solution"]
# Take the $\Phi$ from after the second stretch, and what it has gathered is booked for a region
# that it has corrected already. The price is in the panel's title:

# %% active="ipynb" tags=["solution"] mystnb={"image": {"alt": "Two panels, yours and as it should be: eight landmarks that were never seen; in the left one they stay more than a metre off, in the right one they move to their stars."}}
# def phi_first(Phi1, Psi1, theta1, Phi2, Psi2, theta2):
#     Phi = Phi2 @ Phi1
#     return Phi, Psi1 + Phi.T @ Psi2 @ Phi, theta1 + Phi.T @ theta2
#
# check_joined.draw(phi_first)

# %% [markdown] tags=["statement"]
# ## Exercise 4: what was never measured, with a pencil
#
# A robot without a compass stands still, and its filter reports a heading better and better. Where
# does the knowledge come from? Turn the whole world about the origin by a small angle. Per radian
# the heading changes by 1, the robot's place $p$ by $J p$ and a landmark $m$ by $J m$, with $J =
# \begin{bmatrix} 0 & -1 \\ 1 & 0 \end{bmatrix}$. No range and no bearing changes, in truth.
#
# In $P$ this turn is stored as it was when the landmark was added, at the places $p_0, m_0$ of
# that time,
#
# $$
# t = (J p_0,\ 1,\ J m_0),
# $$
#
# and it stays so: an update adds $H^\top R^{-1} H$ to $P^{-1}$ and leaves what is there already.
# But the Jacobian $H$ of the new observation is taken at the *newest* estimates $p, m$. By this
# $H$ the measurement changes by $H t$ per radian: two numbers, which should be zero.
#
# Work out $H t$ on paper, for range and bearing from the centre of the robot,
#
# $$
# h = \begin{bmatrix} \|m - p\| \\ \operatorname{atan2}(m_y - p_y,\ m_x - p_x) - \theta
# \end{bmatrix}.
# $$
#
# Nothing remains but $d = m - p$ and $D = m_0 - p_0$. Then add up the information about the turn,
# $(H t)^\top R^{-1} (H t)$, over all observations. With the robot at the origin and the heading
# known to $\sigma_0$ at the start, the filter then has $t^\top P^{-1} t = 1 / \sigma_0^2 +
# \text{sum}$ along $t$. A heading can be known no better than that ($t_\theta = 1$; the inequality
# is that of Cauchy and Schwarz):
#
# $$
# \sigma_\theta^2 \ge \frac{t_\theta^2}{t^\top P^{-1} t} = \frac{1}{1/\sigma_0^2 + \text{sum}} .
# $$
#
# So the sum is an *upper* limit of what leaks in, and gives a *lower* limit of the σ that the
# filter can report. The picture has both, for a robot that stands among three landmarks: the σ
# that its EKF really reports, and the limit from your sum. **Guess first**: it begins at 10°. How
# far will the reported σ fall after 100 observations, with nothing to learn?


# %% tags=["exercise", "predict"]
def leaked(d: Array, D: Array, R: Array) -> float:
    """Information about a turn of the whole world that leaks into a filter, at most.

    Parameters
    ----------
    d : ndarray, shape (N, 2)
        Newest estimate of landmark minus robot, at every observation (m).
    D : ndarray, shape (N, 2)
        First estimate of landmark minus robot, of the same pair (m).
    R : ndarray, shape (2, 2)
        Covariance of range (m) and bearing (rad).

    Returns
    -------
    float
        The sum over all observations (1/rad^2).
    """
    rho = np.hypot(d[:, 0], d[:, 1])
    in_range = (d[:, 1] * D[:, 0] - d[:, 0] * D[:, 1]) / rho
    in_bearing = (d * D).sum(axis=1) / rho**2 - 1
    Ht = np.stack([in_range, in_bearing])
    return float(np.sum(Ht * np.linalg.solve(R, Ht)))


# %% active="ipynb" tags=["try"]
# leaked(np.array([[4.0, 0.1]]), np.array([[4.0, 0.0]]), np.diag([0.0025, 0.0003]))

# %% [markdown] tags=["hint"]
# A row of $H$ has three parts: the robot's place, the heading, the landmark. Which part of $t$
# does each of them meet? Two of the three products can be put together.

# %% [markdown] tags=["hint"]
# Range and bearing depend on the places through $m - p$ only, and $t$ moves that by $J D$ per
# radian. How much of it is along $d$, and how much across? What must come out if $d = D$?

# %% [markdown] tags=["hint"]
# Test your two numbers: the lesson's landmark, 4 m ahead and moved to the left by 0.1 m, gives
# about +0.1 m per radian in the range; moved outward by 0.1 m, $-0.0244$ in the bearing. Both
# signs may be flipped, not one: where the errors of range and bearing are correlated, their
# product counts.


# %% tags=["cases"]
@drawn
def _observed(rng: np.random.Generator, T: int, moved: float) -> Any:
    D = np.round(rng.uniform(1, 6, (T, 2)) * rng.choice([-1, 1], (T, 2)), 2)
    return np.round(D + rng.normal(0, moved, (T, 2)), 2), D, a_covariance(rng, 2, 0.05)


@cache
def _standing_robot() -> tuple[Array, Array, Array, Array]:
    """Let an EKF-SLAM observe three stones 100 times, standing: d, D, R, the sigma it reports."""
    rng, R = np.random.default_rng(4), np.diag([0.05, 0.03]) ** 2
    stones = np.array([[3.0, 1.0], [4.0, -2.0], [-2.0, 1.0]])
    mean, P, newest, first, reported = np.zeros(9), np.zeros((9, 9)), [], [], []
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
        reported.append(np.rad2deg(np.sqrt(P[2, 2])))
    return np.array(newest), np.tile(np.array(first), (34, 1))[:100], R, np.array(reported)


def _leaked_drawn(ax: Any, function: Any) -> None:
    """Draw the heading's sigma that a standing robot reports, above the limit from the sum."""
    from slamlab import plots

    d, D, R, reported = _standing_robot()
    steps = np.arange(3, 101)
    known = np.array([float(function(d[:k].copy(), D[:k].copy(), R.copy())) for k in steps])
    least = np.rad2deg(1 / np.sqrt(1 / np.deg2rad(10) ** 2 + known))
    ax.plot(steps, reported[2:], **plots.line_style("estimate"), label="reported")
    ax.plot(steps, least, ":", color=plots.COLOURS["truth"], lw=1.5, label="limit from the sum")
    ax.axhline(10, **plots.line_style("dead_reckoning"))
    ax.set(xlabel="observation", ylabel="σ of the heading (°)", ylim=(0, 11))
    ax.legend(loc="upper right", bbox_to_anchor=(1, 0.8), fontsize=7)
    ax.set_title(f"reported {reported[-1]:.1f}°,\nby the sum at least {least[-1]:.1f}°")


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
    "one of the two has the wrong sign: with a correlated R their product counts": (
        f"{_BEARING} => 1 - {_BEARING[:-4]}"
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
# ## Solution 4: what was never measured
#
# The turn moves the landmark by $J m_0$ and the robot by $J p_0$, so it moves $m - p$ by $J D$.
# The range changes by the part of it along $d$,
#
# $$
# (H t)_1 = \frac{d^\top J D}{\rho} = \frac{d_y D_x - d_x D_y}{\rho}, \qquad
# (H t)_2 = \frac{d^\top D}{\rho^2} - 1,
# $$
#
# the bearing by the part across, divided by $\rho = \|d\|$, and the heading's own turn comes off.
# Where $d = D$ both are zero: the measurement says nothing about the turn, as it must. A landmark
# that has moved *sideways* leaks into the range, one moved *outward* into the bearing.

# %% [markdown] tags=["solution"]
# A mean over the observations would say that a filter gets no worse by observing more. But what
# has leaked in stays. The lesson's landmark, moved by 10 cm and observed 300 times:

# %% active="ipynb" tags=["solution"]
# R = np.diag([0.05, np.deg2rad(1)]) ** 2
# D = np.tile([4.0, 0.0], (300, 1))
# for name, d in (("sideways", D + [0.0, 0.1]), ("outward", D + [0.1, 0.0])):
#     known = 1 / np.deg2rad(10) ** 2 + leaked(d, D, R)
#     print(f"{name:8s}: 10 deg before, then at least {np.rad2deg(known**-0.5):.1f} deg")

# %% [markdown] tags=["solution"]
# The guess: after 100 observations the filter of the picture reports 2.3°, and the sum would allow
# 0.9°. The limit is the inequality of Cauchy and Schwarz. With $e = (0, 0, 1, 0, \dots)$ the
# heading's own entry of $t$ is $1 = e^\top t = (P^{1/2} e)^\top (P^{-1/2} t)$, so
#
# $$
# 1 \le (e^\top P e)\,(t^\top P^{-1} t) = \sigma_\theta^2 \left(1/\sigma_0^2 + \text{sum}\right) .
# $$
#
# It would be reached if $t$ were along $P e$. But the heading may also change along other
# directions of the state, in which the landmarks do not move exactly as in $t$, and along one of
# these less is known.
#
# In the picture a single observation halves σ. The correction before it has turned the map, so the
# landmark that is seen now stands far beside its first place, and that leaks into the range at
# once. With the `H` of this one observation at the first estimates σ stays as it is.

# %% [markdown] tags=["statement"]
# ## Exercise 5: a repair with two bugs
#
# The update below is to be the repair, *first-estimates Jacobians*: beside `mean` it is given a
# second state, `first`. A trial on a bench, with `first` and `mean` still equal, went well. From
# the hall come two complaints. A robot that stands still and has no compass reports a smaller σ
# of its heading all the same: its curve in the picture should stay at 10°. And robots that come
# back to a map which they know well see four posts in one step, and are turned as far from the
# truth after them as before: the title has their heading errors, the mean of twenty. There are two
# bugs. Find and repair them: each repair moves the score and the picture.


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
#     x, y, theta = first[:3]
#     dx, dy = first[k] - x, first[k + 1] - y
#     east, north = mean[k : k + 2] - mean[:2]
#     rho = np.hypot(east, north)
#     H = np.zeros((2, len(mean)))
#     H[:, :3] = [[-dx / rho, -dy / rho, 0], [dy / rho**2, -dx / rho**2, -1]]
#     H[:, k : k + 2] = [[dx / rho, dy / rho], [-dy / rho**2, dx / rho**2]]
#     v = z - np.array([rho, np.arctan2(north, east) - theta])
#     v[1] = wrap_angle(v[1])
#     K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
#     new = mean + K @ v
#     new[2] = wrap_angle(new[2])
#     return new, (np.eye(len(mean)) - K @ H) @ P

# %% active="ipynb" tags=["try"]
# state, z = np.array([0, 0, 0, 3.0, 1.0]), np.array([3.2, 0.4])
# update(state, 0.1 * np.eye(5), state, z, 0, 0.01 * np.eye(2))[0].round(3)

# %% [markdown] tags=["hint"]
# Which of the two states does each *name* come from? Write an F or an M over every name in every
# line. Which lines are about what the filter knows of a *turn*, and which about what it *expects
# to measure now*?

# %% [markdown] tags=["hint"]
# Corrections move `mean` alone. So the landmarks of the two states differ after a while; the poses
# differ when a second landmark is seen in the same step, for the first one has moved `mean`
# already. Which complaint belongs to which difference? Which rows of the report?

# %% [markdown] tags=["hint"]
# Work out $H t$ of exercise 4 with this `H`, for a landmark that has moved outward: which of its
# two entries is not zero? Then the innovation: every number in the prediction of `z` must be of
# one state. Is it?


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


def _along_a_circle(landmark_moves: bool) -> Any:
    """A state of which the landmark alone has moved, or the pose, on a circle round it."""
    first = np.array([0.0, 0.0, 0.2, 3.0, 1.0])
    mean = first.copy()
    if landmark_moves:
        mean[3:] = [3.4, 1.2]
    else:
        mean[:3] = [3 - np.hypot(3, 1) * np.cos(0.5), 1 - np.hypot(3, 1) * np.sin(0.5), 0.4]
    return mean, np.diag([0.1, 0.1, 0.05, 0.1, 0.1]), first, [3.2, 0.1], 0, 0.01 * np.eye(2)


def _four_posts(function: Any) -> float:
    """Let twenty robots see four posts of a map in one step: error of the heading (deg)."""
    posts, off = np.array([[4, 1], [2, -3], [-3, -1], [-1, 4.0]]), []
    R = np.diag([0.05, 0.02]) ** 2
    for seed in range(20):
        rng = np.random.default_rng(seed)
        mean = np.append(np.zeros(3), posts.ravel())
        P, first = np.diag([0.09, 0.09, 0.04] + [1e-4] * 8), mean
        x, y, heading = rng.normal(0, [0.3, 0.3, 0.2])
        for i, d in enumerate(posts - [x, y]):
            z = np.array([np.hypot(*d), wrap_angle(np.arctan2(d[1], d[0]) - heading)])
            z = z + rng.normal(0, [0.05, 0.02])
            mean, P = (np.asarray(one, float) for one in function(mean, P, first, z, i, R))
        off.append(abs(wrap_angle(mean[2] - heading)))
    return float(np.rad2deg(np.mean(off)))


def _update_drawn(ax: Any, function: Any) -> None:
    """Draw the σ of the heading that a standing robot reports; dashed, the 10° of its start."""
    from slamlab import plots

    rng, stones = np.random.default_rng(5), np.array([[3.0, 1.0], [4.0, -2.0], [-2.0, 1.5]])
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
    before = _four_posts(lambda mean, P, *seen: (mean, P))
    after = _four_posts(function)
    ax.set_title(f"four posts: {before:.1f}° off,\nthen {after:.1f}°")


check_update = Check(
    update,
    "mean, P",
    {
        "estimates that have not moved since the first": _in_a_map(2, 1, 0.0),
        "the landmark alone has moved since it was placed": _along_a_circle(True),
        "the pose alone has moved, the distance is as before": _along_a_circle(False),
        "one landmark, all has moved": _in_a_map(1, 0),
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
    "H divides by the latest distance: in H everything is at the first estimates": (
        "rho = np.sqrt(squared)"
        " => squared = np.sum((mean[k : k + 2] - mean[:2]) ** 2)\n    rho = np.sqrt(squared)"
    ),
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
# ## Solution 5: a repair with two bugs
#
# Everything in `H` belongs to the first estimates, everything in the prediction of `z` to the
# latest. In this program two names come from the wrong one. The first is `rho`: right in the
# prediction, but `H` has its directions from `first` and its lengths from `mean`. By exercise 4
# the range stays clean, and the bearing gets $(H t)_2 = \|D\|^2 / \rho^2 - 1$: a landmark that has
# moved outward leaks. The second is `theta`, unpacked on the first line from the pose *as
# predicted*. The first of four posts has turned the robot already; each of the others is compared
# with the heading from before, and makes the same correction again.

# %% [markdown] tags=["solution"]
# With *everything* taken at the first estimates the Jacobians agree, but the measurements say the
# same thing again and again: the innovation does not shrink when the estimate of the landmark
# moves, and its correction is made once more with every measurement.

# %% active="ipynb" tags=["solution"]
# def everything_first(mean, P, first, z, i, R):
#     moved, smaller = update(first, P, first, z, i, R)
#     new = mean + moved - first
#     new[2] = wrap_angle(new[2])
#     return new, smaller
#
# check_update(everything_first)

# %% [markdown] tags=["statement"]
# ## Exercise 6: forty robots that do not learn where north is
#
# Assemble it. As in [Exercises 09](09_ekf_slam.ipynb) a unicycle moves by $v\,dt$ along the
# heading it had before, then turns by $\omega\,dt$. This time it may see several landmarks after
# each step, and the start is uncertain: the state begins at zero with the covariance $P_0$.
#
# **Predict.** With the heading $\theta$ of `mean` before the step, and $(\Delta x, \Delta y)$ the
# way from `first` to the new `mean`,
#
# $$
# F = \begin{bmatrix} 1 & 0 & -\Delta y \\ 0 & 1 & \Delta x \\ 0 & 0 & 1 \end{bmatrix}, \quad
# G = dt \begin{bmatrix} \cos\theta & 0 \\ \sin\theta & 0 \\ 0 & 1 \end{bmatrix}, \quad
# Q = G V G^\top .
# $$
#
# The usual EKF takes the way from the *corrected* pose of the last step. Here `first` still holds
# it *as it was predicted*. After that the new prediction goes into `first`. Your `predict_cov`
# takes `F[None]` and `Q[None]`, one step. **On paper**: $P$ stores the turn $t = (J p,\ 1,\ J m)$
# of exercise 4 at the places in `first`. Why does $F t_{old} = t_{new}$ hold with this $F$, and
# not with the usual one?
#
# **Add, then correct.** New landmarks come in first, all from the predicted pose, and stay in
# `first` as they came; the sensor is at the centre of the robot. Then those that were known
# *before this step* correct by your `update`, in the order given. (The lesson corrects first, and
# must then write $J(m - \mathtt{at})$ into $G_x$. Before the corrections `mean` and `first` have
# the same pose, and $G_x$ is that of chapter 09.)
#
# Then draw: forty robots, each with a heading uncertain by 10° (σ) and no compass, drive in a
# circle among four stones and see two in each step. Each begins its map with the heading zero, so
# the forty maps of the stones (grey) are turned about the start. Blue ellipses are what your
# filter reports, orange ones what the usual EKF reports on the same drives, both for 95 %. The
# title has the σ of the last heading and its NEES, which in 99 of 100 such sets is between 0.52
# and 1.67 if the filter is consistent; in the middle is the σ of forty robots that *stand still*.
# **Guess first**: how certain of north is the usual EKF after 20 s? And must a robot move for this
# to happen: how certain is it if it stands still?


# %% tags=["exercise", "predict"]
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
        P = predict_cov(P, F[None], (G @ V @ G.T)[None])
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
# The way in $F$ leads from `first[:2]` to the new `mean[:2]`: when must `first` be moved on, and
# when must $\theta$ be read? A correction touches `first` at no time.

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
    P0, u, dt, V, _, _, R = in_the_room(n, names, dt=dt, prior=0.02, still=still)(rng)
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


_STONES = np.array([[4.0, 2.0], [3.0, -4.0], [-4.0, 3.0], [-3.0, -3.0]])


@cache
def _forty_drives(speed: float = 0.5) -> list[tuple[Any, ...]]:
    """Drive forty robots in a circle among four stones: what `slam` is given, last heading."""
    P0, R = np.diag([1e-6, 1e-6, np.deg2rad(10) ** 2]), np.diag([0.05, 0.03]) ** 2
    noise = 0.03 if speed else 0.0
    V, u = noise**2 * np.eye(2), np.tile([speed, 0.8 * speed], (40, 1))
    ids, found = (np.arange(40)[:, None] + [0, 1]) % 4, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        pose, z = np.array([0.0, 0.0, np.deg2rad(10) * rng.standard_normal()]), []
        for names, (v, omega) in zip(ids, u + rng.normal(0, noise, u.shape), strict=True):
            pose = pose + 0.5 * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), omega])
            d = _STONES[names] - pose[:2]
            bearing = wrap_angle(np.arctan2(d[:, 1], d[:, 0]) - pose[2])
            z.append(np.column_stack([np.hypot(*d.T), bearing]))
        z = z + rng.normal(0, [0.05, 0.03], (40, 2, 2))
        found.append(((P0, u, 0.5, V, z, ids, R), pose[2]))
    return found


def _forty_maps(function: Any) -> tuple[Array, Array, list[float]]:
    """Maps (40, 4, 2) of the forty robots, mean covariances (4, 2, 2); sigma (deg) and NEES.

    The third number is the sigma of forty robots that stand still.
    """
    maps, covs, nees, sigma = [], [], [], {0.5: [], 0.0: []}
    for speed, reported in sigma.items():
        for given, heading in _forty_drives(speed):
            mean, P = (np.asarray(one, float) for one in function(*given))
            variance = max(P[2, 2], 1e-12)
            reported.append(np.rad2deg(np.sqrt(variance)))
            if speed:
                maps.append(mean[3:11].reshape(4, 2))
                covs.append([P[k : k + 2, k : k + 2] for k in (3, 5, 7, 9)])
                nees.append(wrap_angle(mean[2] - heading) ** 2 / variance)
    numbers = [float(np.mean(one)) for one in (sigma[0.5], nees, sigma[0.0])]
    return np.array(maps), np.mean(covs, 0), numbers


@cache
def _usual_maps() -> tuple[Array, Array, list[float]]:
    return _forty_maps(check_slam.mistaken(_USUAL))


def _slam_drawn(ax: Any, function: Any) -> None:
    """Draw the maps of forty robots (grey), ellipses reported (blue), the usual EKF's (orange)."""
    from slamlab import plots

    maps, covs, mine = _forty_maps(function)
    _, usual, theirs = _usual_maps()
    for one in maps:
        ax.plot(*one[[0, 1, 3, 2, 0]].T, "-", color="0.6", lw=0.3, alpha=0.35)
    ax.plot(*maps.reshape(-1, 2).T, ".", color="0.35", ms=3, alpha=0.6, mew=0)
    for stone, cov, narrow in zip(_STONES, covs, usual, strict=True):
        plots.ellipse(ax, stone, cov).set(facecolor="none", lw=1.3, zorder=6)
        drawn_over = plots.ellipse(ax, stone, narrow, "dead_reckoning")
        drawn_over.set(facecolor="none", lw=1.2, alpha=1, zorder=7)
    turn = np.linspace(0, 2 * np.pi, 60)
    ax.plot(1.25 * np.sin(turn), 1.25 * (1 - np.cos(turn)), **plots.line_style("truth"))
    ax.set_aspect("equal")
    ax.set(xlabel="x (m)", ylabel="y (m)", xlim=(-5, 5), ylim=(-5, 5))
    (sigma, nees, still), (usual_sigma, usual_nees, usual_still) = mine, theirs
    at_rest = f"standing: {still:.1f}°,\nusual EKF: {usual_still:.1f}°"
    ax.text(0, -1.3, at_rest, ha="center", va="center", fontsize=7)
    ax.set_title(
        f"σ {sigma:.1f}°, NEES {nees:.1f};\nusual EKF: {usual_sigma:.1f}°, {usual_nees:.1f}"
    )


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


def _as_in_the_lesson(*more: str) -> tuple[str, ...]:
    """Edit the solution: landmarks known before correct first, then the new ones come in."""
    correct = (
        "        for one, name in zip(seen, names):\n            if name in old:\n"
        "                mean, P = update(mean, P, first, one, known.index(name), R)\n"
    )
    old = "        old = list(known)\n"
    return (f"{correct} => ", f"{old} => {old}{correct}", *more)


_LEAK = (
    "rho = np.sqrt(squared)"
    " => squared = np.sum((mean[k : k + 2] - mean[:2]) ** 2)\n    rho = np.sqrt(squared)"
)
_OLD_POSE = "np.arctan2(north, east) - mean[2] => np.arctan2(north, east) - first[2]"
_with_leak = check_update.mistaken(_LEAK)
_with_old_pose = check_update.mistaken(_OLD_POSE)
_with_both = check_update.mistaken((_LEAK, _OLD_POSE))


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
    "G was taken at the heading in `first`: the robot moves along the one in `mean`": (
        "G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])"
        " => G = dt * np.array([[np.cos(first[2]), 0.0], [np.sin(first[2]), 0.0], [0.0, 1.0]])"
    ),
    "G was taken at the heading after the step: the robot moves first, then turns": (
        "        F = np.eye(3)\n"
        " =>         c, s = np.cos(mean[2]), np.sin(mean[2])\n"
        "        G = dt * np.array([[c, 0.0], [s, 0.0], [0.0, 1.0]])\n"
        "        F = np.eye(3)\n"
    ),
    "a new landmark was corrected by its own reading: those known *before* the step correct": (
        "            if name in old:\n                mean, P ="
        " =>             if name in known:\n                mean, P ="
    ),
    "only the first landmark of a step was used": "zip(seen, names) => zip(seen[:1], names[:1])",
    "each reading placed a landmark and corrected it at once: add first, correct those known before": (
        "name in old:\n                continue => name in old:\n                if name in old:\n"
        "                    mean, P = update(mean, P, first, (r, phi), known.index(name), R)\n"
        "                continue",
        "        for one, name in zip(seen, names):\n            if name in old:\n"
        "                mean, P = update(mean, P, first, one, known.index(name), R)\n => ",
        "known.append(name)\n => known.append(name)\n"
        "            mean, P = update(mean, P, first, (r, phi), known.index(name), R)\n",
    ),
    "new landmarks come in first, from the predicted pose; then the known ones correct": (
        "name in old:\n                continue => name in old:\n                if name in old:\n"
        "                    mean, P = update(mean, P, first, (r, phi), known.index(name), R)\n"
        "                continue",
        "        for one, name in zip(seen, names):\n            if name in old:\n"
        "                mean, P = update(mean, P, first, one, known.index(name), R)\n => ",
    ),
    "the known ones corrected first, as in the lesson, with J (m - at) in G_x: here add first, from "
    "the predicted pose": _as_in_the_lesson(
        "G_pose = np.array([[1.0, 0.0, -r * s], [0.0, 1.0, r * c]])"
        " => way = mean[:2] - first[:2]\n            G_pose = np.array("
        "[[1.0, 0.0, -way[1] - r * s], [0.0, 1.0, way[0] + r * c]])",
    ),
    "the known ones corrected first: the new ones come in before, from the predicted pose": (
        _as_in_the_lesson()
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
        "(G @ V @ G.T)[None] => np.zeros((1, 3, 3))"
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
# ## Solution 6: forty robots that do not learn where north is
#
# What to notice: it is the filter of chapter 09 with one more vector, and that vector is written
# in two places only, after a prediction and when a landmark comes in. A correction changes nothing
# that stands in it.
#
# On paper: let $p$ be the place in `first` before the step and $p'$ the new one. The third column
# of $F$ adds $(-\Delta y, \Delta x) = J (p' - p)$ to the turn's $J p$, and $J p + J (p' - p) = J
# p'$: the turn as it will be stored. With the corrected place $p + c$ the way is $p' - p - c$, and
# $F t_{old}$ misses $t_{new}$ by $J c$, in each step by another correction.

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
#         P, old = predict_cov(P, F[None], (G @ V @ G.T)[None]), list(known)
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
# And the guess? The usual EKF reports 2.7° on the drives of the picture. The forty robots that
# stand still have as many readings per step. With their NEES:

# %% active="ipynb" tags=["solution"]
# def standing(seed):
#     rng, names = np.random.default_rng(seed), (np.arange(40)[:, None] + [0, 1]) % 4
#     stones = np.array([[4.0, 2.0], [3.0, -4.0], [-4.0, 3.0], [-3.0, -3.0]])[names]
#     P0, R = np.diag([1e-6, 1e-6, np.deg2rad(10) ** 2]), np.diag([0.05, 0.03]) ** 2
#     heading = np.deg2rad(10) * rng.standard_normal()
#     bearing = wrap_angle(np.arctan2(stones[..., 1], stones[..., 0]) - heading)
#     z = np.stack([np.hypot(*stones.transpose(2, 0, 1)), bearing], axis=-1)
#     z += rng.normal(0, [0.05, 0.03], z.shape)
#     return (P0, np.zeros((40, 2)), 0.5, np.zeros((2, 2)), z, names, R), heading

# %% active="ipynb" tags=["solution"]
# low, high = chi2_band(1, 40)
# print(f"NEES expected between {low:.2f} and {high:.2f}")
# for filter_ in (usual, slam):
#     sigma, squared = [], []
#     for seed in range(40):
#         given, heading = standing(seed)
#         mean, P = filter_(*given)
#         sigma.append(np.rad2deg(np.sqrt(P[2, 2])))
#         squared.append(wrap_angle(mean[2] - heading) ** 2 / P[2, 2])
#     print(f"{filter_.__name__:5s} reports {np.mean(sigma):4.1f} deg, "
#           f"NEES {np.mean(squared):4.1f}")

# %% [markdown] tags=["solution"]
# Standing or driving, the usual EKF reports a little less than 3°, and its errors are those of the
# start: it needs no motion to leak, only Jacobians that do not agree with each other. With one
# vector that no correction touches, the 10° remain, and the NEES is in its band.

# %% [markdown] tags=["statement"]
# **What you have now**: the width of a door to 4 cm between posts that are not known to half a
# metre, a prediction that touches the map once in twenty steps, accounts that can
# be joined, a limit for what leaks into a filter without a measurement, and an EKF-SLAM that does
# not learn where north is. The solutions are in
# [Solutions 10](../solutions/10_convergence_consistency_and_cost.ipynb).
