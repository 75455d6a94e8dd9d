"""Least squares on a pose graph: Gauss-Newton, Levenberg-Marquardt and robust kernels.

Grisetti et al. 2010, algorithm 1; Huber 1964; dynamic covariance scaling, Agarwal et al. 2013.
`PoseGraph.optimize` of `slamlab.slam.graph` is the door to it; chapter 13 derives it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamlab._checks import Array
from slamlab.geometry import wrap_angle
from slamlab.slam._edges import Edges
from slamlab.slam._sparse import BlockSystem, SingularError, Solve

# 95 % of honest errors (three degrees of freedom) lie within this Mahalanobis distance.
KERNEL_WIDTH = 2.7955
# Gauss-Newton keeps its factors after a step that changed the cost by less than this part.
_NEAR = 0.15
# Levenberg-Marquardt gives up beyond this multiple of the diagonal.
_LARGEST_DAMPING = 1e12

Kernel = Callable[[Array, float], tuple[Array, Array]]


# Robust kernels: cost and weight of an edge as functions of its x = e^T Omega e.


def _huber(x: Array, width: float) -> tuple[Array, Array]:
    # rho = x within the width k, 2 k sqrt(x) - k^2 beyond; weight = d rho / d x
    distance = np.sqrt(x)
    beyond = distance > width
    weight = np.where(beyond, width / np.where(beyond, distance, 1.0), 1.0)
    return np.where(beyond, 2 * width * distance - width**2, x), weight


def _dcs(x: Array, width: float) -> tuple[Array, Array]:
    # Agarwal et al. 2013: weight = s^2 with s = min(1, 2 Phi / (Phi + x)); rho is its integral.
    phi = width**2
    weight = np.minimum(1.0, 2 * phi / (phi + x)) ** 2
    return np.where(x > phi, phi * (3 * x - phi) / (phi + x), x), weight


def _max_mixture(x: Array, width: float) -> tuple[Array, Array]:
    # Olson and Agarwal 2013: the likelier of "true" and "false", whose information is 1e-6 of it
    scale = 1e-6
    false = x > width**2
    rho = np.where(false, scale * x + (1 - scale) * width**2, x)
    return rho, np.where(false, scale, 1.0)


KERNELS: dict[str, Kernel] = {
    "huber": _huber,
    "dcs": _dcs,
    "max-mixture": _max_mixture,
}


@dataclass(eq=False)
class NormalEquations:
    """H step = -gradient of the free poses, at the poses where `edges` were last linearised.

    Parameters
    ----------
    edges : Edges
    system : BlockSystem
    names : callable
        Turns rows of poses into words, for the message about a singular graph.
    weights : ndarray, shape (m,), optional
        Of the edges.
    """

    edges: Edges
    system: BlockSystem
    names: Callable[[np.ndarray], str]
    weights: Array | None = None

    def gradient(self) -> Array:
        """J^T Omega e of the free poses, shape (n_free, 3)."""
        return self.edges.gradient(self.weights)[self.system.free]

    def factorise(self, damping: float = 0.0, check: bool = True) -> Solve:
        """Return the function that solves (H + damping diag H) x = b."""
        H = self.system.matrix(self.edges.blocks(self.weights), damping)
        if not np.isfinite(H.data).all():
            raise ValueError("poses: expected a graph of moderate size, the equations overflow")
        try:
            return self.system.factorise(H, check)
        except SingularError as error:
            raise ValueError(
                "information: the measurements do not determine the graph, "
                f"free to move: {self.names(error.rows)}"
            ) from error

    def inverse_blocks(self, places: np.ndarray) -> Array:
        """Diagonal blocks (k, 3, 3) of the inverse of H, for places (k,) among the free poses."""
        solve = self.factorise()
        blocks = np.empty((len(places), 3, 3))
        for start in range(0, len(places), 32):  # a few columns at a time keep memory linear
            part = places[start : start + 32]
            k = np.arange(len(part))
            unit = np.zeros((self.system.n, 3, len(part), 3))
            unit[part, :, k, :] = np.eye(3)
            columns = solve(unit.reshape(self.system.n, 3, -1)).reshape(unit.shape)
            blocks[start : start + 32] = columns[part, :, k, :]
        return 0.5 * (blocks + blocks.mT)


@dataclass(eq=False)
class Optimization:
    """One run of `PoseGraph.optimize`: its state, and the two algorithms that move it."""

    poses: Array
    equations: NormalEquations
    kernel: Kernel | None
    kernel_width: float
    groups: list[np.ndarray]
    max_iterations: int
    tolerance: float

    def __post_init__(self) -> None:
        self.converged = False
        if self.groups:
            self.log_information = self.equations.edges.log_information()
        # What is left of the cost when all measurements agree and only rounding is seen.
        ulp = 4 * np.finfo(float).eps * max(1.0, np.abs(self.poses).max())
        self.rounding = self.equations.edges.trace() * ulp**2
        self.history = [self.move_to(self.poses)]
        self.solve: Solve | None = None
        self.gain = np.inf

    def move_to(self, poses: Array) -> float:
        """Linearise at `poses`; return the cost there."""
        squared = self.equations.edges.linearise(poses)
        self.poses = poses
        self.chi2 = float(squared.sum())
        rho, self.weights = squared, np.ones(len(squared))
        if self.kernel is not None:
            rho, self.weights = self.kernel(squared, self.kernel_width)
        for group in self.groups:
            others = np.delete(group, np.argmin(squared[group] - self.log_information[group]))
            self.weights[others] = rho[others] = 0.0
        if self.kernel is not None or self.groups:
            self.equations.weights = self.weights
        return float(rho.sum())

    def minimise(self, method: str) -> str:
        """Run to the end; return why it ended. `converged` and `poses` hold the rest."""
        if self.equations.system.n == 0:
            self.converged, message = True, "every pose is fixed"
        elif method == "gauss-newton":
            self.converged, message = self.gauss_newton()
        else:
            self.converged, message = self.levenberg_marquardt()
        return message

    def move_by(self, step: Array) -> float:
        """Move the free poses by `step`; return the cost there, inf where that overflows."""
        poses = self.poses.copy()
        with np.errstate(over="ignore"):
            poses[self.equations.system.free] += step
        if not np.isfinite(poses).all():
            return np.inf
        poses[:, 2] = wrap_angle(poses[:, 2])
        return self.move_to(poses)

    def settled(self, before: float, after: float) -> bool:
        return abs(before - after) <= self.tolerance * before + self.rounding

    def gauss_newton(self) -> tuple[bool, str]:
        """Solve H step = -gradient and move, until neither the cost nor its model changes."""
        for _ in range(self.max_iterations):
            before, here = self.history[-1], self.poses
            cost = self.move_by(self.gauss_newton_step())
            if not np.isfinite(cost):
                self.move_to(here)
                return False, "diverged: the next step has no finite cost"
            self.history.append(cost)
            if self.settled(before, cost) and self.settled(before, before - self.gain):
                return True, "converged"
        return False, f"stopped after {self.max_iterations} iterations"

    def gauss_newton_step(self) -> Array:
        """H^-1 (-gradient), with old factors of H where they still serve.

        Near the end H hardly changes. Its factors stay as long as each step with them promises
        less than a tenth of the gain of the step before.
        """
        gradient = self.equations.gradient()
        if self.solve is not None and self.near_the_end():
            step = self.solve(-gradient)
            gain = -float(np.vdot(gradient, step))
            if gain <= 0.1 * self.gain:
                self.gain = gain
                return step
        first, self.solve = self.solve is None, None  # old factors make room for the new ones
        self.solve = self.equations.factorise(check=first)
        step = self.solve(-gradient)
        # The model of the cost falls by -gradient . step = gradient^T H^-1 gradient.
        self.gain = -float(np.vdot(gradient, step))
        return step

    def near_the_end(self) -> bool:
        before, here = self.history[-2:]
        return abs(before - here) < _NEAR * before

    def levenberg_marquardt(self) -> tuple[bool, str]:
        """Gauss-Newton with a damped diagonal; only steps that do not raise the cost are taken.

        The damping follows how well the model foretold the step (Marquardt 1963, More 1978).
        """
        damping = 1e-6
        self.equations.factorise()  # damping would hide a singular graph
        for _ in range(self.max_iterations):
            before = self.history[-1]
            cost, damping, kept = self.damped_step(damping)
            if damping > _LARGEST_DAMPING:
                return False, "no step lowers the cost"
            self.history.append(cost)
            if self.settled(before, cost) and damping < 1e-2:
                return True, "converged"
            damping *= 0.1 if kept > 0.25 else 1.0
            damping = max(damping, 1e-12)
        return False, f"stopped after {self.max_iterations} iterations"

    def damped_step(self, damping: float) -> tuple[float, float, float]:
        """Raise the damping until a step does not raise the cost; take that step.

        Returns the cost after it, the damping, and the part of the promised gain that it kept.
        """
        before, here = self.history[-1], self.poses
        gradient = self.equations.gradient()
        while damping <= _LARGEST_DAMPING:
            solve = self.equations.factorise(damping, check=False)
            diagonal = self.equations.system.diagonal() * damping / (1 + damping)
            step = solve(-gradient)
            # model: -2 g.s - s.H s with (H + damping D) s = -g
            promised = float(np.vdot(step, diagonal * step) - np.vdot(gradient, step))
            cost = self.move_by(step)
            if cost <= before * (1 + 1e-12) + self.rounding:
                return cost, damping, (before - cost) / max(promised, self.rounding)
            self.move_to(here)
            damping *= 10
        return before, damping, 0.0
