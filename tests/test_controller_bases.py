"""The control basis functions of sections II.B-C and the orthonormal columns of their spans."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import subspace_angles

from controller import bases
from controller.bases import BASES, orthonormalise, span_basis

H, TS = 200, 0.05
OPTIONS = {
    "laguerre": {"sample_period": TS},
    "laguerre_function": {"sample_period": TS, "pole_per_s": 0.5},
}
REDUCED = sorted(set(BASES) - {"full"})


def raw(family, count, horizon=H):
    return BASES[family](horizon, count, **OPTIONS.get(family, {}))


@pytest.mark.parametrize(
    ("time", "t"), [("seconds", np.arange(H) * TS), ("normalised", np.arange(H) / (H - 1))]
)
def test_laguerre_polynomials_are_the_five_printed_in_the_paper(time, t):
    """b_0 .. b_4 are the series expansions printed below eq. 2.4, in seconds or on [0, 1]."""
    printed = [
        np.ones(H),
        1 - t,
        1 - 2 * t + 0.5 * t**2,
        1 - 3 * t + 1.5 * t**2 - t**3 / 6,
        1 - 4 * t + 3 * t**2 - 2 / 3 * t**3 + t**4 / 24,
    ]
    B = bases.laguerre(H, 5, sample_period=TS, time=time)
    np.testing.assert_allclose(B, np.stack(printed, axis=1), rtol=0, atol=1e-12)


def test_legendre_polynomials_follow_rodrigues_formula():
    """Column n is the n-th derivative of (x^2 - 1)^n over 2^n n! (section II.C)."""
    x = np.linspace(-1, 1, H)
    B = bases.legendre(H, 7)
    for n in range(7):
        derivative = (np.poly1d([1, 0, -1]) ** n).deriv(n)
        expected = derivative(x) / (2.0**n * np.prod(np.arange(1, n + 1)))
        np.testing.assert_allclose(B[:, n], expected, rtol=0, atol=1e-12)


def test_laguerre_functions_are_orthonormal_on_the_half_line():
    """The integral of l_i l_j over [0, inf) is 1 if i = j, else 0."""
    step = 0.002
    L = bases.laguerre_function(40_000, 5, sample_period=step, pole_per_s=0.5)
    trapezoid = np.full(len(L), step)
    trapezoid[0] = step / 2
    np.testing.assert_allclose(L.T @ (L * trapezoid[:, None]), np.eye(5), rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    ("family", "count"),
    [("tent", 1), ("tent", 2), ("tent", 10), ("box", 7), ("bspline", 4), ("bspline", 10)],
)
def test_local_functions_sum_to_one_and_are_not_negative(family, count):
    """Tents, boxes and B-splines are partitions of unity."""
    B = raw(family, count)
    assert B.min() >= 0
    np.testing.assert_allclose(B.sum(axis=1), 1.0, rtol=0, atol=1e-14)


def test_each_tent_is_one_at_its_own_centre():
    """Tent i is 1 at i/(n-1), where all others are 0."""
    centres = np.arange(0, 181, 20)
    np.testing.assert_allclose(bases.tent(181, 10)[centres], np.eye(10), rtol=0, atol=1e-14)


def test_boxes_hold_blocks_of_equal_length():
    """Box i is 1 on its own tenth of the samples and 0 elsewhere."""
    np.testing.assert_array_equal(bases.box(H, 10), np.kron(np.eye(10), np.ones((20, 1))))


def test_ramps_rise_on_their_own_interval_only():
    """Ramp i grows at n per horizon on interval i, from less than one sample's rise."""
    R = bases.ramp(H, 10)
    np.testing.assert_array_equal(R == 0, (bases.box(H, 10) == 0) | (R == 0))
    own = R.T.reshape(10, 10, 20)[np.arange(10), np.arange(10)]
    np.testing.assert_allclose(np.diff(own), 10 / (H - 1), rtol=1e-9)
    assert np.all((own[:, 0] >= 0) & (own[:, 0] < 10 / (H - 1)))
    assert R[-1, -1] == 1.0


def test_bspline_knots_are_graded():
    """The first of n B-splines ends at the first inner knot, T_H / (n-3)^2."""
    s = np.arange(H) / (H - 1)
    first = bases.bspline(H, 8)[:, 0]
    np.testing.assert_array_equal(first > 0, s < 1 / 25)


@pytest.mark.parametrize("family", REDUCED)
@pytest.mark.parametrize("count", [4, 5, 9, 12])
def test_span_basis_is_orthonormal_and_maps_back(family, count):
    """Phi' Phi = H I, and B to_raw = Phi: the paper's coefficients make the same correction."""
    Phi, to_raw = span_basis(family, H, count, sample_period=TS)
    np.testing.assert_allclose(Phi.T @ Phi, H * np.eye(count), rtol=0, atol=1e-11 * H)
    np.testing.assert_allclose(raw(family, count) @ to_raw, Phi, rtol=0, atol=1e-8)


def test_full_order_is_a_scaled_identity():
    """With one function per sample, nothing is reduced."""
    Phi, to_raw = span_basis("full", 30, 30, sample_period=TS)
    np.testing.assert_allclose(Phi, np.sqrt(30) * np.eye(30), rtol=0, atol=1e-14)
    np.testing.assert_allclose(to_raw, np.sqrt(30) * np.eye(30), rtol=0, atol=1e-14)


@settings(deadline=None, max_examples=40)
@given(
    family=st.sampled_from(REDUCED),
    count=st.integers(4, 12),
    horizon=st.integers(60, 240),
)
def test_every_family_has_full_column_rank(family, count, horizon):
    """No function of a family is a combination of the others."""
    assert np.linalg.matrix_rank(raw(family, count, horizon), tol=1e-9) == count


@pytest.mark.parametrize("count", range(1, 8))
def test_polynomials_of_equal_degree_span_the_same_space(count):
    """Laguerre (both normalisations), Chebyshev and Legendre enclose no principal angle."""
    legendre = bases.legendre(H, count)
    for other in (
        bases.laguerre(H, count, sample_period=TS),
        bases.laguerre(H, count, sample_period=TS, time="normalised"),
        bases.chebyshev(H, count),
    ):
        assert subspace_angles(legendre, orthonormalise(other)[0]).max() < 1e-6


def test_laguerre_functions_span_another_space():
    """Times the exponential, the polynomials are no longer polynomials."""
    functions, _ = span_basis("laguerre_function", H, 5, sample_period=TS)
    assert subspace_angles(functions, bases.legendre(H, 5)).max() > 0.1
    assert subspace_angles(functions, raw("laguerre_function", 5)).max() < 1e-7


def test_orthonormal_columns_keep_the_order_and_sense_of_the_raw_ones():
    """Column j is in the span of the first j raw columns and points along raw column j."""
    B = bases.tent(H, 6)
    Phi, to_raw = orthonormalise(B)
    np.testing.assert_array_equal(to_raw, np.triu(to_raw))
    assert np.all(np.diag(to_raw) > 0)
    assert np.all(np.sum(Phi * B, axis=0) > 0)


@pytest.mark.parametrize(
    ("family", "count", "message"),
    [
        ("legendre", 0, "basis legendre: wrong number of functions, got 0, expected 1 to 200"),
        ("tent", 201, "basis tent: wrong number of functions, got 201, expected 1 to 200"),
        ("bspline", 3, "basis bspline: too few functions, got 3, expected at least 4"),
        ("full", 5, "basis full: wrong number of functions, got 5, expected one per sample, 200"),
        ("ramp", 200, "basis: columns are linearly dependent, got rank 199, expected 200"),
    ],
)
def test_an_impossible_count_is_refused(family, count, message):
    """A count that the family cannot have is an error that names both."""
    with pytest.raises(ValueError, match=f"^{message}$"):
        span_basis(family, H, count, sample_period=TS)


def test_an_unknown_family_is_refused_with_the_nearest_name():
    """A misspelt name is answered with the nearest one."""
    with pytest.raises(KeyError, match="got 'lagerre', expected one such as 'laguerre'"):
        span_basis("lagerre", H, 5, sample_period=TS)
