"""P3 (1) and the four constrained fits: printed eliminations, exact rationals, our fit.

The oracle minimises the sum of squares under the constraints by Lagrange multipliers, in exact
rational arithmetic, in powers of t as P3 writes the curve.
"""

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from slamlab.navigation.cubic import fit_cubic

T, X0, X1, D0 = sp.symbols("t0 x0 x1 d0")
T1, TI, XI = sp.symbols("t1 t_i x_i")
A0, A1, A2, A3 = sp.symbols("a0:4")


def curve(t):
    return A0 + A1 * t + A2 * t**2 + A3 * t**3


def slope(t):
    return sp.diff(curve(TI), TI).subs(TI, t)


def left_over(constraints, unknowns):
    """Residual x_i - x(t_i) with the constraints solved for some coefficients."""
    solved = sp.solve(constraints, unknowns, dict=True)[0]
    return sp.expand(XI - curve(TI).subs(solved))


POINT = sp.Eq(curve(T), X0)
END = sp.Eq(curve(T1), X1)
SLOPE = sp.Eq(slope(T), D0)


def two_points(t_last, x_last):
    """P3's two-point elimination as printed, with the last point called t_last, x_last."""
    left = XI * (T - T1) + TI * (x_last - X0) + (X0 * T1 - x_last * T)
    right = A3 * (TI**3 * (T - t_last) + TI * (T1**3 - T**3) + (T**3 * T1 - T1**3 * T))
    right += A2 * (TI**2 * (T - T1) + TI * (T1**2 - T**2) + (T**2 * T1 - T1**2 * T))
    return sp.expand(left - right)


def two_points_and_slope():
    m1 = TI**2 - T1**2 - 2 * T * (TI - T1)
    m0 = TI**2 - T**2 - 2 * T * (TI - T)
    left = (XI - X0 - D0 * (TI - T)) * m1 - (XI - X1 - D0 * (TI - T1)) * m0
    right = (TI**3 - T**3 - 3 * T**2 * (TI - T)) * m1 - (TI**3 - T1**3 - 3 * T**2 * (TI - T1)) * m0
    return sp.expand(left - A3 * right)


def test_point_elimination_is_the_residual():
    printed = (XI - X0) - A3 * (TI**3 - T**3) - A2 * (TI**2 - T**2) - A1 * (TI - T)
    assert sp.expand(printed - left_over([POINT], [A0])) == 0
    forgot = printed + A1 * T
    assert sp.expand(forgot - left_over([POINT], [A0])) != 0


def test_point_and_derivative_elimination_is_the_residual():
    printed = XI - (D0 * TI + X0 - D0 * T)
    printed -= (TI**3 - 3 * TI * T**2 + 2 * T**3) * A3 + (TI - T) ** 2 * A2
    assert sp.expand(printed - left_over([POINT, SLOPE], [A0, A1])) == 0
    factored = (TI - T) ** 2 * (TI + 2 * T)
    assert sp.expand(factored - (TI**3 - 3 * TI * T**2 + 2 * T**3)) == 0
    wrong_sign = printed + 4 * T**3 * A3
    assert sp.expand(wrong_sign - left_over([POINT, SLOPE], [A0, A1])) != 0


def test_two_point_elimination_is_the_residual_times_a_constant():
    residual = left_over([POINT, END], [A0, A1])
    assert sp.simplify(two_points(T1, X1) - (T - T1) * residual) == 0


def test_two_point_elimination_with_the_printed_index_is_not():
    """P3 writes t_n and x_n where t_1 and x_1 stand in the same formula."""
    residual = left_over([POINT, END], [A0, A1])
    t_n, x_n = sp.symbols("t_n x_n")
    for mixed in (two_points(t_n, X1), two_points(T1, x_n)):
        assert sp.simplify(mixed - (T - T1) * residual) != 0
        assert sp.simplify(mixed.subs({t_n: T1, x_n: X1}) - (T - T1) * residual) == 0


def test_two_points_and_derivative_elimination_is_the_residual_times_a_constant():
    residual = left_over([POINT, SLOPE, END], [A0, A1, A2])
    assert sp.simplify(two_points_and_slope() + (T - T1) ** 2 * residual) == 0
    m1 = TI**2 - T1**2 - 2 * T * (TI - T1)
    assert sp.expand(m1 - (TI - T) ** 2 + (T - T1) ** 2) == 0


def test_a2_of_the_fourth_variant_as_printed():
    solved = sp.solve([POINT, SLOPE, END], [A0, A1, A2], dict=True)[0][A2]
    printed = (X0 - X1 - D0 * (T - T1) - A3 * (T**3 - T1**3 - 3 * T**2 * (T - T1))) / -(
        (T - T1) ** 2
    )
    assert sp.simplify(solved - printed) == 0
    assert sp.simplify(solved + printed) != 0


# Numbers: the oracle in exact rationals.

TIMES = [Fraction(n, 8) for n in (24, 25, 27, 30, 31, 33, 36, 40)]
XS = [Fraction(n, 16) for n in (0, 5, -3, 9, 20, 13, 17, 30)]
YS = [Fraction(n, 16) for n in (4, 4, 11, 2, -7, -9, 3, 1)]
VARIANTS = {
    "point": (False, False),
    "point-derivative": (False, True),
    "two-points": (True, False),
    "two-points-derivative": (True, True),
}


def constrained_normal_equations(times, values, end, derivative):
    """Exact coefficients a_0..a_3 of the constrained least squares, by Lagrange multipliers."""
    rows = sp.Matrix([[t**m for m in range(4)] for t in times])
    constraints = [[times[0] ** m for m in range(4)]]
    due = [values[0]]
    if end:
        constraints.append([times[-1] ** m for m in range(4)])
        due.append(values[-1])
    if derivative is not None:
        constraints.append([m * times[0] ** (m - 1) if m else 0 for m in range(4)])
        due.append(derivative)
    C = sp.Matrix(constraints)
    k = C.rows
    left = sp.BlockMatrix([[rows.T * rows, C.T], [C, sp.zeros(k, k)]]).as_explicit()
    right = sp.Matrix([*(rows.T * sp.Matrix(values)), *due])
    return left.applyfunc(sp.nsimplify).LUsolve(right.applyfunc(sp.nsimplify))[:4, 0]


def exact(name):
    end, derivative = VARIANTS[name]
    slopes = (sp.Rational(1, 2), sp.Rational(-3, 4)) if derivative else (None, None)
    times = [sp.Rational(t.numerator, t.denominator) for t in TIMES]
    columns = []
    for values, d in zip((XS, YS), slopes, strict=True):
        values = [sp.Rational(v.numerator, v.denominator) for v in values]
        columns.append(constrained_normal_equations(times, values, end, d))
    return np.array([[float(v) for v in column] for column in columns]).T, slopes


def ours(name, **changed):
    end, derivative = VARIANTS[name]
    t = np.array([float(v) for v in TIMES])
    points = np.array([[float(x), float(y)] for x, y in zip(XS, YS, strict=True)])
    call = {
        "start": points[0],
        "end": points[-1] if end else None,
        "start_derivative": [0.5, -0.75] if derivative else None,
    }
    return fit_cubic(t, points, **(call | changed))


@pytest.mark.parametrize("name", VARIANTS)
def test_our_fit_solves_the_constrained_normal_equations(name):
    solution, _ = exact(name)
    t = np.linspace(float(TIMES[0]), float(TIMES[-1]), 50)
    powers = np.stack([t**m for m in range(4)], 1)
    np.testing.assert_allclose(ours(name)(t), powers @ solution, atol=1e-9)
    np.testing.assert_allclose(ours(name).powers_of_t(), solution, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", VARIANTS)
def test_a_fit_under_other_constraints_is_another_curve(name):
    solution, _ = exact(name)
    for other in set(VARIANTS) - {name}:
        assert np.abs(ours(other).powers_of_t() - solution).max() > 1e-3


def printed_solution(name, typo=False):
    """P3's eliminations, put into numbers and solved by least squares in powers of t."""
    t = np.array([float(v) for v in TIMES])
    points = np.array([[float(x), float(y)] for x, y in zip(XS, YS, strict=True)])
    d = np.array([0.5, -0.75])
    t0, t1, (x0, x1) = t[0], t[-1], (points[0], points[-1])
    t_i, x_i = t[:, None], points
    if name == "point":
        left = np.hstack([t_i**3 - t0**3, t_i**2 - t0**2, t_i - t0])
        a3, a2, a1 = np.linalg.lstsq(left, x_i - x0, rcond=None)[0]
        return np.stack([x0 - a3 * t0**3 - a2 * t0**2 - a1 * t0, a1, a2, a3])
    if name == "point-derivative":
        left = np.hstack([t_i**3 - 3 * t_i * t0**2 + 2 * t0**3, (t_i - t0) ** 2])
        a3, a2 = np.linalg.lstsq(left, x_i - (d * t_i + x0 - d * t0), rcond=None)[0]
        a1 = d - 3 * a3 * t0**2 - 2 * a2 * t0
        return np.stack([x0 - a3 * t0**3 - a2 * t0**2 - a1 * t0, a1, a2, a3])
    if name == "two-points":
        # The typo: t_n is read as the newest point's parameter but one, t_(N-1).
        t_n = t[-2] if typo else t1
        cubic = t_i**3 * (t0 - t_n) + t_i * (t1**3 - t0**3) + (t0**3 * t1 - t1**3 * t0)
        square = t_i**2 * (t0 - t1) + t_i * (t1**2 - t0**2) + (t0**2 * t1 - t1**2 * t0)
        due = x_i * (t0 - t1) + t_i * (x1 - x0) + (x0 * t1 - x1 * t0)
        a3, a2 = np.linalg.lstsq(np.hstack([cubic, square]), due, rcond=None)[0]
        a1 = (x0 - x1 - a3 * (t0**3 - t1**3) - a2 * (t0**2 - t1**2)) / (t0 - t1)
        return np.stack([x0 - a3 * t0**3 - a2 * t0**2 - a1 * t0, a1, a2, a3])
    m1, m0 = t_i**2 - t1**2 - 2 * t0 * (t_i - t1), t_i**2 - t0**2 - 2 * t0 * (t_i - t0)
    due = (x_i - x0 - d * (t_i - t0)) * m1 - (x_i - x1 - d * (t_i - t1)) * m0
    first, second = t_i**3 - t0**3 - 3 * t0**2 * (t_i - t0), t_i**3 - t1**3
    left = first * m1 - (second - 3 * t0**2 * (t_i - t1)) * m0
    # "without inverting a matrix": one unknown
    a3 = (left * due).sum(0) / (left**2).sum()
    a2 = (x0 - x1 - d * (t0 - t1) - a3 * (t0**3 - t1**3 - 3 * t0**2 * (t0 - t1))) / -(
        (t0 - t1) ** 2
    )
    a1 = d - 3 * a3 * t0**2 - 2 * a2 * t0
    return np.stack([x0 - a3 * t0**3 - a2 * t0**2 - a1 * t0, a1, a2, a3])


@pytest.mark.parametrize("name", VARIANTS)
def test_the_printed_eliminations_agree_with_our_fit(name):
    t = np.linspace(float(TIMES[0]), float(TIMES[-1]), 50)
    powers = np.stack([t**m for m in range(4)], 1)
    np.testing.assert_allclose(powers @ printed_solution(name), ours(name)(t), atol=1e-7)


def test_the_printed_index_mix_gives_another_curve():
    t = np.linspace(float(TIMES[0]), float(TIMES[-1]), 50)
    powers = np.stack([t**m for m in range(4)], 1)
    wrong = powers @ printed_solution("two-points", typo=True)
    assert np.abs(wrong - ours("two-points")(t)).max() > 0.01


def design(t, columns):
    return np.stack([t**m for m in columns], 1)


def test_ill_conditioning_does_arise_with_a_global_parameter():
    """P3: "no case of bad conditioning arises". For a segment of 400 mm, in millimetres:"""
    local, far = np.linspace(0, 400, 57)[1:], 3000 + np.linspace(0, 400, 57)[1:]
    far_design = np.stack([far**m - 3000.0**m for m in (1, 2, 3)], 1)
    assert 5e5 < np.linalg.cond(design(local, (1, 2, 3))) < 5e6
    assert 5e10 < np.linalg.cond(far_design) < 5e11
    assert np.linalg.cond(far_design.T @ far_design) > 1e15, (
        "normal equations: no digit of the coefficients"
    )
    assert np.linalg.cond(design(local / 400, (1, 2, 3))) < 100
    # What counts is the curve: nothing is lost to 30 m, at 300 m it is millimetres off.
    rng, along = np.random.default_rng(3), np.linspace(0, 400, 57)
    exact = design(along[1:] / 400, (1, 2, 3))
    for start, low, high in ((3e3, 0, 1e-3), (3e4, 0, 0.1), (3e5, 0.5, np.inf)):
        t, off = start + along, []
        A = np.stack([t**m - t[0] ** m for m in (1, 2, 3)], 1)[1:]
        for x in np.cumsum(rng.normal(7, 4, (50, 56)), 1):
            normal = A @ np.linalg.solve(A.T @ A, A.T @ x)
            off.append(np.abs(normal - exact @ np.linalg.lstsq(exact, x, rcond=None)[0]).max())
        assert low <= max(off) < high
    # With two points held it lasts ten times as long, and written as products all the way.
    exact = np.stack([(1 - along / 400) * along / 400, (1 - along / 400) * (along / 400) ** 2], 1)
    for start, low, high in ((3e5, 0, 0.1), (3e6, 0.5, np.inf)):
        t, off, products = start + along, [], []
        t0, t1, product = t[0], t[-1], (t - t[0]) * (t - t[-1]) * (t[0] - t[-1])
        A = np.stack(
            [
                t**3 * (t0 - t1) + t * (t1**3 - t0**3) + t0**3 * t1 - t1**3 * t0,
                t**2 * (t0 - t1) + t * (t1**2 - t0**2) + t0**2 * t1 - t1**2 * t0,
            ],
            1,
        )
        for _ in range(50):
            x = np.r_[0, np.cumsum(rng.normal(7, 4, 56))]
            left = x * (t0 - t1) + t * (x[-1] - x[0]) + x[0] * t1 - x[-1] * t0
            free = x - x[-1] * along / 400
            best = exact @ np.linalg.lstsq(exact, free, rcond=None)[0]
            for M, kept in (
                (A, off),
                (product[:, None] * np.stack([t + t0 + t1, 1 + 0 * t], 1), products),
            ):
                found = M @ np.linalg.solve(M.T @ M, M.T @ left) / (t0 - t1)
                kept.append(np.abs(found - best).max())
        assert low <= max(off) < high
        assert max(products) < 0.01


def test_the_fourth_variant_needs_a_point_in_between():
    """P3 gives (t0 - t1)^2 >> 0 alone; without an interior point its equation reads 0 = 0."""
    t0, t1 = 1.0, 2.0
    for t_i in (t0, t1):
        weight = sp.lambdify((TI, T, T1), -sp.Poly(two_points_and_slope(), A3).coeff_monomial(A3))
        assert weight(t_i, t0, t1) == 0
    curve = fit_cubic([t0, t1], [[0, 0], [1, 1]], [0, 0], [1, 1], [1.0, 0.0])
    np.testing.assert_allclose(curve.powers_of_t()[3], 0, atol=1e-12)


def test_no_polynomial_curve_but_a_line_has_speed_one():
    """P3 section 4 writes x(s), y(s) as cubics in the arc length s: x'^2 + y'^2 = 1 forbids it."""
    s = sp.symbols("s")
    a, b = sp.symbols("a1:4", real=True), sp.symbols("b1:4", real=True)
    speed = sum(
        sp.diff(sum(c * s ** (m + 1) for m, c in enumerate(axis)), s) ** 2 for axis in (a, b)
    )
    coefficients = sp.Poly(sp.expand(speed - 1), s).all_coeffs()
    # Highest first: 9 (a3^2 + b3^2), so both vanish; then 4 (a2^2 + b2^2), so these do.
    assert sp.simplify(coefficients[0] - 9 * (a[2] ** 2 + b[2] ** 2)) == 0
    rest = [c.subs({a[2]: 0, b[2]: 0}) for c in coefficients]
    assert sp.simplify(rest[2] - 4 * (a[1] ** 2 + b[1] ** 2)) == 0
    left = {sp.simplify(c.subs({a[1]: 0, b[1]: 0})) for c in rest}
    assert left == {0, a[0] ** 2 + b[0] ** 2 - 1}
