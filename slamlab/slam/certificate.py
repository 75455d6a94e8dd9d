"""A pose graph as a quadratic form in complex numbers: a first guess, and a bound from below.

A heading is the complex number u = exp(i theta), a position p = x + i y. With weights tau, kappa
an edge costs tau ``|p_j - p_i - u_i t|^2`` + kappa ``|u_j - u_i w|^2``, where t and w =
exp(i theta_z) are its measurement: quadratic, if only ``|u| = 1`` is forgotten. Rosen et al. 2019
(SE-Sync), in the plane Carlone and Calafiore 2018; initial guess Carlone et al. 2015. Chapter 13
derives both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from slamlab._checks import Array
from slamlab.geometry import rotation
from slamlab.slam.least_squares import SYMMETRIC

__all__ = ["Certificate"]

TOLERANCE = 0.01  # part of chi2 by which the bound may stay below it


@dataclass(frozen=True)
class Certificate:
    """How far at most the cost of some poses lies above the least cost of all poses.

    Attributes
    ----------
    certified : bool
        True if no poses whatever have a cost lower than `chi2` by more than `tolerance` of it.
    chi2 : float
        Cost of the poses in question.
    bound : float
        No poses have a lower cost than this (to rounding).
    eigenvalue : float
        Least eigenvalue of the certificate matrix, zero or a little less at the optimum.
    tolerance : float
        Part of `chi2` by which `bound` may stay below it.
    """

    certified: bool
    chi2: float
    bound: float
    eigenvalue: float
    tolerance: float


class Relaxation:
    """The quadratic form x^H M x of a graph, x = (p of all vertices, u of all poses).

    Parameters
    ----------
    edges : ndarray of int, shape (m, 2)
        Rows of the vertices; landmarks stand behind the poses.
    measurements : ndarray, shape (m, 3)
    tau, kappa : ndarray, shape (m,)
        Weight of the position (1/m^2) and of the heading of each edge; kappa is 0 where the edge
        leads to a landmark.
    n_poses, n_points : int
        Number of poses and of landmarks.
    """

    def __init__(
        self,
        edges: np.ndarray,
        measurements: Array,
        tau: Array,
        kappa: Array,
        n_poses: int,
        n_points: int,
    ) -> None:
        self.n, self.n_vertices = n_poses, n_poses + n_points
        (i, j), row = edges.T, np.arange(len(edges))
        t, w = to_complex(measurements[:, :2]), np.exp(1j * measurements[:, 2])
        turn = np.flatnonzero(kappa > 0)
        a, b = np.sqrt(tau), np.sqrt(kappa[turn])
        # One row sqrt(tau) (p_j - p_i - u_i t) an edge, then sqrt(kappa) (u_j - u_i w).
        below, u = len(edges) + np.arange(len(turn)), self.n_vertices
        rows = [row, row, row, below, below]
        columns = [j, i, u + i, u + j[turn], u + i[turn]]
        values = [a + 0j, -a + 0j, -a * t, b + 0j, -b * w[turn]]
        shape = (len(edges) + len(turn), u + n_poses)
        A = coo_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape
        ).tocsc()
        self.M = (A.conj().T @ A).tocsc()

    def guess(self, start: Array, first: int) -> Array:
        """Least squares without |u| = 1, then u / |u|, then the positions for these headings.

        Parameters
        ----------
        start : ndarray, shape (n_poses + n_points, 3)
            Only its row `first` counts: this pose stays.
        first : int

        Returns
        -------
        ndarray, shape (n_poses + n_points, 3)
            Of landmarks with heading 0.
        """
        N = self.n_vertices
        known = np.zeros(N + self.n, dtype=bool)
        known[[first, N + first]] = True
        x = np.zeros(N + self.n, dtype=complex)
        x[first], x[N + first] = to_complex(start[first, :2]), np.exp(1j * start[first, 2])
        x = self.solved(x, known)
        x[N:] = np.exp(1j * np.angle(x[N:]))
        known[N:] = True
        x = self.solved(x, known)
        headings = np.pad(np.angle(x[N:]), (0, N - self.n))
        return np.column_stack([x[:N].real, x[:N].imag, headings])

    def solved(self, x: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Least x^H M x over the entries that are not known."""
        free = ~known
        if not free.any():
            return x
        x = x.copy()
        M = self.M[free]
        x[free] = hermitian_factor(M[:, free]).solve(-(M[:, known] @ x[known]))
        return x


def hermitian_factor(H: csc_matrix) -> Any:
    """Factors of a Hermitian matrix; ValueError where there are none."""
    if not np.isfinite(H.data).all():
        raise ValueError("poses: expected a graph of moderate size, the equations overflow")
    try:
        return splu(H.tocsc(), "MMD_AT_PLUS_A", **SYMMETRIC)
    except RuntimeError as error:
        raise ValueError("information: the measurements do not determine the graph") from error


def to_complex(v: Array) -> np.ndarray:
    """Vectors (..., 2) as complex numbers."""
    return v[..., 0] + 1j * v[..., 1]


def isotropic(information: Array) -> tuple[Array, Array]:
    """Weights tau, kappa (m,) in place of information (m, 3, 3): the means of the diagonal.

    Of a landmark (no information on the heading) kappa is 0.
    """
    return 0.5 * (information[:, 0, 0] + information[:, 1, 1]), information[:, 2, 2]


def isotropic_below(information: Array) -> tuple[Array, Array]:
    """Weights tau, kappa (m,) such that diag(tau, tau, kappa) is nowhere above information."""
    tau, kappa = np.linalg.eigvalsh(information[:, :2, :2])[:, 0], information[:, 2, 2]
    root = np.sqrt(np.stack([tau, tau, kappa], 1).clip(0.0))
    root[root == 0] = np.inf
    with np.errstate(over="ignore"):
        scaled = information / root[:, :, None] / root[:, None, :]
    scaled[~np.isfinite(scaled).all((1, 2))] = 0.0  # too far apart for numbers: 0 is below all
    scaled[np.isinf(root)[:, :, None] & np.eye(3, dtype=bool)] = 1.0
    # Least eigenvalue: how far both must shrink where position and heading are correlated.
    shrunk = np.linalg.eigvalsh(scaled)[:, 0].clip(0.0, 1.0)
    return shrunk * tau.clip(0.0), shrunk * kappa


def tangent_quadratic(e: Array, z: Array, information: Array) -> tuple[Array, Array, Array, float]:
    """Edges of the form of `Relaxation` that cost no more, and at errors e (m, 3) as much.

    For any c, g(e) = tau ``|e_p - c_p|^2`` + 2 kappa (1 - cos(e_a - c_a)) bends less than
    f(e) = e^T Omega e if diag(tau, tau, kappa) lies below Omega. So if c makes g as steep as f at
    one e, f - g is least there, and g, raised to touch f, is nowhere above it.

    Returns
    -------
    z : ndarray, shape (m, 3)
        Measurements, moved by c.
    tau, kappa : ndarray, shape (m,)
    offset : float
        To be added to the form.
    """
    tau, kappa = isotropic_below(information)
    force = np.einsum("nij,nj->ni", information, e)
    with np.errstate(divide="ignore", invalid="ignore"):
        # tau (e_p - c_p) = force_p and kappa sin(e_a - c_a) = force_a
        off = force[:, :2] / tau[:, None]
        sine = np.where(kappa > 0, force[:, 2] / kappa, 0.0)
    steep = ~((np.abs(sine) < 1) & np.isfinite(off).all(1))  # no such c: g(e) of c = 0 instead
    turn = np.arcsin(np.where(steep, 0.0, sine))
    offset = np.einsum("ni,ni->n", e, force) - tau * (off**2).sum(1)
    offset -= 2 * kappa * (1 - np.cos(turn))
    c = np.column_stack([e[:, :2] - off, np.where(kappa > 0, e[:, 2] - turn, 0.0)])
    c[steep] = offset[steep] = 0.0
    # e_p stands in the frame of the measurement, t_z in that of the first pose
    t = z[:, :2] + np.einsum("nij,nj->ni", rotation(z[:, 2]), c[:, :2])
    return np.column_stack([t, z[:, 2] + c[:, 2]]), tau, kappa, float(offset.sum())


def certify(relaxation: Relaxation, poses: Array, chi2: float, offset: float) -> Certificate:
    """Bound form + offset from below for all poses; at `poses` (n or more, 3) it is stationary.

    For any real L_i: x^H M x = x^H (M - diag(0, L)) x + sum L_i |u_i|^2, so where all |u_i| = 1
    the cost is at least sum L_i + n min(0, least eigenvalue of S), S the first matrix with the
    positions eliminated. With L_i = Re(conj(u_i) (M x)_i) of the optimum both agree there.
    """
    n, N = relaxation.n, relaxation.n_vertices
    known = np.zeros(N + n, dtype=bool)
    known[N:] = known[0] = True
    x = np.zeros(N + n, dtype=complex)
    x[N:] = np.exp(1j * poses[:n, 2])
    x = relaxation.solved(x, known)
    L = np.real(np.conj(x[N:]) * (relaxation.M @ x)[N:])
    on_u = diags(np.r_[np.zeros(N - 1), np.ones(n)])
    C = relaxation.M[1:, 1:] - diags(np.r_[np.zeros(N - 1), L])
    largest = float(np.abs(C.diagonal()).max(initial=0.0))
    shift = max(0.1 * TOLERANCE * chi2 / n, 1e-11 * largest, 1e-12)
    factor = hermitian_factor(C + shift * on_u)
    # There are as many negative pivots as negative eigenvalues.
    while (factor.U.diagonal().real <= 0).any() and np.isfinite(shift):
        shift *= 8.0
        factor = hermitian_factor(C + shift * on_u)
    eigenvalue = least_eigenvalue(factor, N - 1, n, shift)
    bound = offset + float(L.sum()) + n * min(0.0, eigenvalue)
    bound = max(bound, 0.0)  # no sum of squares is less
    rounding = 1e-9 * float(np.abs(L).sum()) + 1e-9
    return Certificate(
        bool(chi2 - bound <= TOLERANCE * chi2 + rounding), chi2, bound, eigenvalue, TOLERANCE
    )


def least_eigenvalue(factor: Any, n_before: int, n: int, shift: float) -> float:
    """Least eigenvalue of S, from factors of the matrix whose Schur complement is S + shift."""

    def inverse(v: np.ndarray) -> np.ndarray:
        return factor.solve(np.r_[np.zeros(n_before), v.ravel()].astype(complex))[n_before:]

    operator = LinearOperator((n, n), matvec=inverse, dtype=complex)
    if n < 4:
        dense = np.linalg.inv(np.column_stack([inverse(e) for e in np.eye(n)]))
        return float(np.linalg.eigvalsh(dense)[0] - shift)
    start = np.cos(np.arange(n)) + 0j
    largest = eigsh(operator, k=1, which="LM", v0=start, return_eigenvectors=False, tol=1e-6)[0]
    return float(1.0 / largest - shift)
