"""The door: what is refused, with which sentence, and that what passes passes unchanged."""

import datetime
from decimal import Decimal

import numpy as np
import pytest

from slamlab._checks import (
    as_array,
    as_batch,
    as_choice,
    as_count,
    as_covariance,
    as_finite_or_nan,
    as_rng,
    as_scalar,
    as_shaped,
    shown,
)
from slamlab.gaussian import Gaussian, cached_sqrt

HIDDEN = np.ma.array([1.0, 2.0], mask=[False, True])
NO_NUMBERS = [
    "90",
    ["1", "2"],
    b"1",
    1j,
    [1.0, 2 + 0j],
    None,
    [None],
    np.datetime64("2024-01-01"),
    [datetime.timedelta(1)],
    10**400,
    [10**400, 1],
    [[1, 2], [3]],
    {"a": 1},
    object(),
    HIDDEN,
    np.zeros(2, dtype=[("x", float)]),
]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda v: type(v).__name__)
def test_what_holds_no_numbers_is_refused_by_name(value):
    for check in (as_array, as_shaped, as_covariance):
        with pytest.raises(ValueError, match="^z: expected .*, got ") as caught:
            check("z", value)
        assert len(str(caught.value)) < 300
    for check in (as_scalar, as_count):
        with pytest.raises(ValueError, match="^z: expected .*, got "):
            check("z", value)


@pytest.mark.parametrize(
    "value", [[1, 2], (1.0, 2), np.array([1, 2], "i2"), [Decimal(1), 2], np.ma.array([1.0, 2.0])]
)
def test_numbers_of_any_kind_become_floats(value):
    array = as_array("z", value, (2,))
    assert array.dtype == np.float64
    assert type(array) is np.ndarray
    np.testing.assert_array_equal(array, [1.0, 2.0])


def test_single_precision_stays_and_floats_are_not_copied():
    assert as_array("z", np.ones(2, "f4")).dtype == np.float32
    given = np.ones(2)
    assert as_array("z", given) is given


@pytest.mark.parametrize(
    ("shape", "wanted", "fits"),
    [
        ((2, 3), (2, 3), True),
        ((2, 3), ("n", 3), True),
        ((2, 3), (None, 3), True),
        ((2, 3), ("...", 3), True),
        ((3,), ("...", 3), True),
        ((4, 2, 3), ("...", "n", 3), True),
        ((0, 3), ("n", 3), True),
        ((), (), True),
        ((), ("...",), True),
        ((), ("...", "n"), False),
        ((), ("...", 3), False),
        ((3,), ("...", "n", 3), False),
        ((2, 3), (3,), False),
        ((3, 2), ("...", 3), False),
        ((3,), (), False),
    ],
)
def test_shapes(shape, wanted, fits):
    if fits:
        assert as_array("z", np.ones(shape), wanted).shape == shape
    else:
        with pytest.raises(ValueError, match=r"^z: expected shape \(.*\), got \("):
            as_array("z", np.ones(shape), wanted)


def test_leading_axes_that_do_not_fit_are_named():
    assert as_batch("u", (5, 1), (4,)) == (5, 4)
    with pytest.raises(ValueError, match=r"u: expected leading axes that fit \(4,\), got \(3,\)"):
        as_batch("u", (3,), (4,))


def test_the_first_number_that_is_not_finite_is_shown():
    with pytest.raises(ValueError, match=r"z: expected finite numbers, got nan at index \(1, 0\)"):
        as_array("z", [[1, 2], [np.nan, np.inf]])
    assert np.isnan(as_shaped("z", [1, np.nan])[1])
    assert np.isnan(as_finite_or_nan("z", [1, np.nan])[1])
    with pytest.raises(ValueError, match="z: expected finite numbers or NaN, got infinity"):
        as_finite_or_nan("z", [1, -np.inf])


# Covariances.


def test_a_covariance_is_returned_symmetric_to_the_last_bit():
    cov = np.array([[2.0, 0.3], [0.3 + 1e-12, 1.0]])
    checked = as_covariance("R", cov)
    np.testing.assert_array_equal(checked, checked.T)
    assert checked is not cov


@pytest.mark.parametrize(
    ("cov", "message"),
    [
        (np.ones((2, 3)), "R: expected a square matrix, got shape"),
        (
            np.array([[1.0, 1e-6], [0.0, 1.0]]),
            "R: expected a symmetric matrix, asymmetry is 1e-06",
        ),
        (np.diag([1.0, -1e-6]), "R: expected a positive semi-definite matrix, smallest .* -1e-06"),
        (np.diag([1e308, -1e308]), "R: expected a positive semi-definite matrix"),
        (np.diag([1.0, np.inf]), "R: expected finite"),
    ],
)
def test_what_is_no_covariance(cov, message):
    with pytest.raises(ValueError, match=message):
        as_covariance("R", cov)


def test_rounding_and_batches_of_covariances_pass():
    as_covariance("R", np.diag([1e6, -1e-6]))
    as_covariance("R", np.zeros((3, 2, 2)), 2)
    as_covariance("R", np.zeros((0, 0)))


# Numbers, counts, choices, generators.

tiny = float(np.finfo(float).tiny)


@pytest.mark.parametrize(
    ("low", "high", "value", "words"),
    [
        (tiny, 1e300, 0.0, "a positive number, got 0"),
        (tiny, np.inf, -1, "a positive number, got -1"),
        (tiny, 10.0, 11, "a positive number of at most 10, got 11"),
        (0.0, 1e300, -1, "a number of at least 0, got -1"),
        (-1e300, 1e300, np.inf, "a finite number, got inf"),
        (-1e300, 1e300, np.nan, "a finite number, got nan"),
        (0.0, np.nextafter(1.0, 0.0), 1.0, r"a number in \[0, 1\), got 1"),
        (0.0, 1.0, 1.5, r"a number in \[0, 1\], got 1.5"),
    ],
)
def test_an_interval_is_said_in_words(low, high, value, words):
    with pytest.raises(ValueError, match=f"^s: expected {words}$"):
        as_scalar("s", value, low, high)


def test_scalars_that_pass():
    for value in (2, 2.0, np.float32(2), np.array(2), Decimal(2), True + 1):
        assert as_scalar("s", value) == 2.0
    with pytest.raises(ValueError, match="s: expected a number, got"):
        as_scalar("s", [2.0])


def test_counts():
    assert as_count("n", np.int64(3)) == 3
    assert type(as_count("n", np.uint8(3))) is int
    for value, words in [
        (2.0, "a whole number, got 2.0"),
        (True, "a whole number, got True"),
        (-1, "at least 0, got -1"),
        (2**63, "at most"),
    ]:
        with pytest.raises(ValueError, match=f"n: expected {words}"):
            as_count("n", value)


def test_choices():
    assert as_choice("method", "a", ("a", "b")) == "a"
    for value in ("c", None, 1, np.array(["a", "b"]), ["a"]):
        with pytest.raises(ValueError, match="method: expected one of 'a', 'b', got"):
            as_choice("method", value, ("a", "b"))


@pytest.mark.parametrize("value", [None, 1, np.random, np.random.RandomState(1)])
def test_a_seed_is_no_generator(value):
    with pytest.raises(ValueError, match="rng: expected a numpy.random.Generator"):
        as_rng("rng", value)


# Messages.


class Unprintable:
    def __repr__(self):
        raise RuntimeError


def test_what_came_is_shown_shortly_whatever_it_is():
    bomb = ["x"]
    for _ in range(40):
        bomb = [bomb, bomb]
    for value in ("y" * 10**6, list(range(10**5)), bomb, np.zeros(10**5), Unprintable(), 10**5000):
        assert len(shown(value)) <= 200
    assert shown([1, "a"]) == "[1, 'a']"


@pytest.mark.parametrize("kind", [">f8", "<f8", ">f4", "<f4", ">i4"])
def test_the_byte_order_of_an_array_changes_no_number(kind):
    """Arrays of FITS, HDF5 and .mat files often have the other byte order."""
    cov = np.array([[4, 1], [1, 9]]).astype(kind)
    for found in (as_array("P", cov), as_covariance("P", cov), Gaussian([0, 0], cov).cov):
        assert found.dtype.isnative
        assert found.tolist() == [[4, 1], [1, 9]]
    assert as_array("P", cov).dtype.itemsize == (4 if kind.endswith("f4") else 8)
    np.testing.assert_allclose(
        cached_sqrt("P", cov, 2) @ cached_sqrt("P", cov, 2).T, cov, rtol=1e-6
    )
    with pytest.raises(ValueError, match="smallest eigenvalue is -9"):
        as_covariance("P", (-cov).astype(kind))
