"""Fields of points and the climb of a scan, for `slamlab.matching.field`."""

from __future__ import annotations

import numpy as np

from slamlab.kernels.compiling import njit
from slamlab.kernels.linear import solve3


@njit(cache=True)
def splat(values, cells, sigma):  # type: ignore[no-untyped-def]
    """Raise values to exp(-d^2 / 2 sigma^2) round every point (k, 2: column, row; cells).

    The exponential is a product of one factor a column and one a row; of each of these only the
    middle one, and the step to the next, are not the same for all points.
    """
    rows, columns = values.shape
    reach = int(np.ceil(3.5 * sigma))
    along, across = np.empty(2 * reach + 2), np.empty(2 * reach + 2)
    fixed = np.exp(-0.5 / sigma**2 * np.arange(-reach, reach + 2) ** 2)
    for k in range(len(cells)):
        x, y = cells[k, 0] - 0.5, cells[k, 1] - 0.5
        column, row = int(np.floor(x)), int(np.floor(y))
        _gaussian(x - column, sigma, fixed, along)
        _gaussian(y - row, sigma, fixed, across)
        left, low = column - reach, row - reach
        first, last = max(0, -left), min(2 * reach + 2, columns - left)
        for j in range(max(0, -low), min(2 * reach + 2, rows - low)):
            line, height = values[low + j, left + first : left + last], across[j]
            for i in range(len(line)):
                value, old = np.float32(height * along[first + i]), line[i]
                line[i] = value if value > old else old


@njit(cache=True)
def _gaussian(a, sigma, fixed, out):  # type: ignore[no-untyped-def]
    """exp(-(i - a)^2 / 2 sigma^2) = exp(-a^2 / 2 sigma^2) exp(a / sigma^2)^i fixed[i]."""
    reach = len(out) // 2 - 1
    if reach == 1:  # so sharp a one that the step might overflow
        for i in range(-1, 3):
            out[i + 1] = np.exp(-0.5 * ((i - a) / sigma) ** 2)
        return
    middle, step = np.exp(-0.5 * (a / sigma) ** 2), np.exp(a / sigma**2)
    up = down = middle
    for i in range(reach + 1):
        out[reach - i], out[reach + i] = down * fixed[reach - i], up * fixed[reach + i]
        up, down = up * step, down / step
    out[-1] = up * fixed[-1]


@njit(cache=True)
def _cell(values, row, column, log_odds):  # type: ignore[no-untyped-def]
    """Value of one cell; outside the grid nothing is known, which is 0."""
    inside = 0 <= row < values.shape[0] and 0 <= column < values.shape[1]
    value = float(values[row, column]) if inside else 0.0
    return 1.0 / (1.0 + np.exp(-value)) if log_odds else value


@njit(cache=True)
def look_up(values, x, y, log_odds):  # type: ignore[no-untyped-def]
    """M and its gradient at (x, y), both in cells: Hector (5) and (6)."""
    if not (-1e9 < x < 1e9 and -1e9 < y < 1e9):
        return _cell(values, -1, -1, log_odds), 0.0, 0.0
    x, y = x - 0.5, y - 0.5  # a value belongs to the centre of its cell
    column, row = int(np.floor(x)), int(np.floor(y))
    a, b = x - column, y - row
    m00 = _cell(values, row, column, log_odds)
    m10 = _cell(values, row, column + 1, log_odds)
    m01 = _cell(values, row + 1, column, log_odds)
    m11 = _cell(values, row + 1, column + 1, log_odds)
    value = (1 - b) * ((1 - a) * m00 + a * m10) + b * ((1 - a) * m01 + a * m11)
    gradient_x = (1 - b) * (m10 - m00) + b * (m11 - m01)
    gradient_y = (1 - a) * (m01 - m00) + a * (m11 - m10)
    return value, gradient_x, gradient_y


@njit(cache=True)
def normal_equations(values, frame, log_odds, points, pose, H, g):  # type: ignore[no-untyped-def]
    """H and g of Hector (11), (12); returns sum M and sum (1 - M)^2. frame: resolution, x0, y0."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    H[:], g[:] = 0.0, 0.0
    total, left = 0.0, 0.0
    J = np.empty(3)
    for k in range(len(points)):
        px, py = c * points[k, 0] - s * points[k, 1], s * points[k, 0] + c * points[k, 1]
        x, y = (px + pose[0] - frame[1]) / frame[0], (py + pose[1] - frame[2]) / frame[0]
        value, gx, gy = look_up(values, x, y, log_odds)
        # (9): the gradient, turned by d S / d xi = [I | R'(psi) s]
        J[0], J[1] = gx / frame[0], gy / frame[0]
        J[2] = J[1] * px - J[0] * py
        for i in range(3):
            g[i] += J[i] * (1.0 - value)
            for j in range(3):
                H[i, j] += J[i] * J[j]
        total += value
        left += (1.0 - value) ** 2
    return total, left


@njit(cache=True)
def gauss_newton(values, frame, log_odds, points, pose, prior, n_iterations):  # type: ignore[no-untyped-def]
    """Take steps (12) from `pose`, moved to the best pose met; returns H, sum M, squares.

    `prior` (3, 3) is an information matrix that pulls towards the guess; zeros for none.
    """
    guess, here, step = pose.copy(), pose.copy(), np.zeros(3)
    H, g = np.empty((3, 3)), np.empty(3)
    best_H, best_total, best_left, least = np.zeros((3, 3)), 0.0, 0.0, np.inf
    for n in range(n_iterations + 1):
        total, left = normal_equations(values, frame, log_odds, points, here, H, g)
        off = guess - here
        pull = prior @ off
        cost = left + (off * pull).sum()
        if cost < least:
            least, best_total, best_left = cost, total, left
            best_H = H.copy()
            for k in range(3):  # number by number: a slice takes three seconds to compile
                pose[k] = here[k]
        if n == n_iterations or not solve3(H + prior, g + pull, step):
            break
        step[2] = min(max(step[2], -0.2), 0.2)
        here = here + step
        if abs(step[0]) + abs(step[1]) < 1e-5 and abs(step[2]) < 1e-6:
            break
    return best_H, best_total, best_left
