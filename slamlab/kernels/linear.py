"""Small linear algebra for compiled loops."""

import numpy as np

from slamlab.kernels.compiling import njit

__all__ = ["solve3"]


@njit(cache=True)
def solve3(H, g, step):  # type: ignore[no-untyped-def]
    """Solve H step = g of three unknowns by Cholesky; False if H is singular.

    Where numba compiles it, `numpy.linalg.solve` takes five seconds longer.
    """
    if H[0, 0] <= 0.0:
        return False
    l00 = np.sqrt(H[0, 0])
    l10, l20 = H[1, 0] / l00, H[2, 0] / l00
    d1 = H[1, 1] - l10 * l10
    if d1 <= 1e-12 * H[1, 1]:
        return False
    l11 = np.sqrt(d1)
    l21 = (H[2, 1] - l20 * l10) / l11
    d2 = H[2, 2] - l20 * l20 - l21 * l21
    if d2 <= 1e-12 * H[2, 2]:
        return False
    l22 = np.sqrt(d2)
    a = g[0] / l00
    b = (g[1] - l10 * a) / l11
    step[2] = (g[2] - l20 * a - l21 * b) / l22 / l22
    step[1] = (b - l21 * step[2]) / l11
    step[0] = (a - l10 * step[1] - l20 * step[2]) / l00
    return True
