"""The arithmetic below EKF-SLAM equals the plain formulas, at sizes around its borders."""

import numpy as np
import pytest

from slamlab.slam import _covariance
from slamlab.slam._covariance import Covariance, block_diagonal, downdate, mirror, times

rng = np.random.default_rng(8)


@pytest.mark.parametrize(
    ("N", "k"), [(3, 2), (103, 20), (150, 20), (403, 6), (1503, 4), (5, 0), (0, 3), (90, 101)]
)
def test_downdate_takes_the_square_off_the_lower_triangle(N, k):
    P, B = rng.standard_normal((N, N)), rng.standard_normal((k, N))
    due = P - B.T @ B
    before = P.copy()
    downdate(P, B)
    np.testing.assert_allclose(np.tril(P), np.tril(due), atol=1e-12)
    # Far above the diagonal nothing is touched: it would be work for nothing.
    assert N <= _covariance.SMALL or P[0, -1] == before[0, -1]


def test_downdate_works_in_place_on_a_piece_of_a_larger_memory():
    flat = rng.standard_normal(50 * 50)
    tail = flat[20 * 20 :].copy()
    P, B = flat[: 20 * 20].reshape(20, 20), rng.standard_normal((4, 20))
    due = P - B.T @ B
    downdate(P, B)
    np.testing.assert_allclose(np.tril(flat[:400].reshape(20, 20)), np.tril(due), atol=1e-13)
    np.testing.assert_array_equal(flat[400:], tail)


@pytest.mark.parametrize("N", [1, 127, 128, 129, 300])
def test_mirror_copies_the_lower_triangle_up(N):
    P = rng.standard_normal((N, N))
    due = np.tril(P) + np.tril(P, -1).T
    mirror(P)
    np.testing.assert_array_equal(P, due)


@pytest.mark.parametrize("shape", [(20, 20, 50), (20, 20, 5000), (600, 600, 3), (0, 0, 9)])
def test_times_is_the_product(shape):
    A, B = rng.standard_normal(shape[:2]), rng.standard_normal(shape[1:])
    np.testing.assert_allclose(times(A, B), A @ B, atol=1e-11)
    assert shape[0] * shape[1] > _covariance.PIECE or times(A, B).flags.c_contiguous


def test_block_diagonal_has_its_blocks_and_nothing_else():
    blocks = rng.standard_normal((3, 2, 2))
    matrix = block_diagonal(blocks)
    for k in range(3):
        np.testing.assert_array_equal(matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], blocks[k])
    assert np.count_nonzero(matrix) == 12
    assert block_diagonal(np.empty((0, 2, 2))).shape == (0, 0)


@pytest.mark.parametrize("N", [7, 243, 255, 257, 403])
def test_a_covariance_does_what_dense_matrices_do(N):
    """Every change, in a random order, around the size where only one triangle is kept."""
    root = rng.standard_normal((N, N))
    due = root @ root.T / N
    P = Covariance(due)
    F, Q, G = rng.standard_normal((3, 3)), np.eye(3), rng.standard_normal((4, 3))
    a = 0.1 * rng.standard_normal(N)
    a[2] = 0.0
    for change in ("correct", "move", "shear", "correct", "append", "move", "keep", "correct"):
        n = len(P)
        A = np.eye(n)
        if change == "correct":
            B = 0.1 * rng.standard_normal((6, n))
            P.correct(B)
            due = due - B.T @ B
        elif change == "move":
            P.move(F, Q)
            A[:3, :3] = F
            due = A @ due @ A.T
            due[:3, :3] += Q
        elif change == "shear":
            P.shear(a)
            A[:, 2] += a
            due = A @ due @ A.T
        elif change == "append":
            P.append(G, np.eye(4))
            A = np.vstack([A, np.hstack([G, np.zeros((4, n - 3))])])
            due = A @ due @ A.T
            due[n:, n:] += np.eye(4)
        else:
            entries = np.r_[0:3, 5 : n - 2]
            P.keep(entries)
            due = due[np.ix_(entries, entries)]
        i = np.array([0, 1, 2, len(P) - 2, len(P) - 1])
        np.testing.assert_allclose(P.rows(i), due[i], atol=1e-9)
        np.testing.assert_allclose(P.block(i), due[np.ix_(i, i)], atol=1e-9)
        np.testing.assert_allclose(P.pose, due[:3, :3], atol=1e-9)
    np.testing.assert_allclose(P.matrix, due, atol=1e-9)
    np.testing.assert_array_equal(P.matrix, P.matrix.T)


def test_memory_that_nobody_wrote_is_never_reckoned_with(monkeypatch):
    rng = np.random.default_rng(0)
    empty = np.empty

    def garbage(*args, **kwargs):
        """What malloc may return: signalling NaN, which warn as soon as one adds to them."""
        array = empty(*args, **kwargs)
        array.view(np.uint64)[...] = 0x7FF0_0000_0000_0001
        return array

    monkeypatch.setattr(np, "empty", garbage)
    for n in (_covariance.SMALL // 2, _covariance.SMALL):
        P = Covariance(np.eye(3))
        with np.errstate(all="raise"):
            P.append(np.ones((2 * n, 3)), np.eye(2 * n))
            P.correct(0.01 * rng.normal(size=(2, 3 + 2 * n)))
            P.append(np.ones((2, 3)), np.eye(2))
            P.correct(0.01 * rng.normal(size=(2, 5 + 2 * n)))
        assert np.isfinite(P.matrix).all()
