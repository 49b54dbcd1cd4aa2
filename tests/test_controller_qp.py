"""Assembly of the quadratic program of eq. 7."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.qp import (
    Rows,
    Term,
    assemble,
    bounds,
    clearance,
    penalty,
    predicted_cost,
    slack,
)

H, M = 12, 6
SEEDS = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def random_terms(rng, number=3):
    return [Term(rng.normal(size=(H, M)), rng.normal(size=H), w) for w in rng.uniform(0, 5, number)]


@settings(deadline=None, max_examples=30)
@given(rng=SEEDS)
def test_predicted_cost_is_the_weighted_sum_of_squares(rng):
    """J0 + alpha' H alpha + 2 f' alpha is eq. 7 written out sample by sample."""
    terms = random_terms(rng, 9)
    data = assemble(terms, [], regularisation=0.0)
    alpha = rng.normal(size=M)
    expected = sum(w * (e[k] + S[k] @ alpha) ** 2 for S, e, w in terms for k in range(H))
    assert predicted_cost(data, alpha) == pytest.approx(expected, rel=1e-12)


def test_hessian_and_gradient_are_those_of_half_the_cost():
    """H = sum of w S' S is symmetric, f = sum of w S' e."""
    terms = random_terms(np.random.default_rng(1))
    data = assemble(terms, [], regularisation=0.0)
    np.testing.assert_allclose(data.H, sum(w * S.T @ S for S, _, w in terms), rtol=1e-12)
    np.testing.assert_allclose(data.f, sum(w * S.T @ e for S, e, w in terms), rtol=1e-12)
    np.testing.assert_array_equal(data.H, data.H.T)


def test_an_output_without_weight_costs_nothing():
    """An output of weight zero is left out, even if it is not finite."""
    terms = random_terms(np.random.default_rng(3))
    nothing = Term(np.full((H, M), np.nan), np.full(H, np.inf), 0.0)
    data, kept = assemble([terms[0], nothing, *terms[1:]], []), assemble(terms, [])
    np.testing.assert_array_equal(data.H, kept.H)
    np.testing.assert_array_equal(data.f, kept.f)


def test_regularisation_is_relative_to_the_mean_of_the_diagonal():
    """A coefficient without any effect still has a positive diagonal."""
    S = np.random.default_rng(4).normal(size=(H, M))
    S[:, 2] = 0.0
    data = assemble([Term(S, np.ones(H), 1.0)], [])
    assert data.H[2, 2] == pytest.approx(1e-12 * np.sum(S**2) / M)


@settings(deadline=None, max_examples=30)
@given(rng=SEEDS, every=st.integers(1, 5))
def test_bounds_hold_exactly_when_the_outputs_are_within_their_limits(rng, every):
    """A row reads the change of one output at one sample; the last sample always has a row."""
    S, nominal = rng.normal(size=(2, H, M)), rng.uniform(-1, 1, (2, H))
    minimum, maximum = np.array([-2.0, -3.0]), np.array([2.5, np.inf])
    rows = bounds(S, nominal, minimum, maximum, every)
    y = nominal + S @ (alpha := rng.normal(size=M))
    chosen = np.arange(H - 1, -1, -every)[::-1]
    expected = (y >= minimum[:, None]) & (y <= maximum[:, None])
    change = rows.A @ alpha
    np.testing.assert_array_equal(
        (change >= rows.lower) & (change <= rows.upper), expected[:, chosen].ravel()
    )


def test_attitude_rows_of_every_fourth_sample_are_a_hundred():
    """Two outputs over 200 samples, every fourth, with scalar limits."""
    rows = bounds(np.zeros((2, 200, M)), np.zeros((2, 200)), -0.9, 0.9, every=4)
    assert rows.A.shape == (100, M)
    assert set(rows.lower) == {-0.9}
    assert set(rows.upper) == {0.9}


@settings(deadline=None, max_examples=30)
@given(rng=SEEDS)
def test_clearance_rows_are_exact_over_a_plane(rng):
    """Over h = a N + b E the linear clearance is the clearance, so the rows miss no coordinate."""
    S, path = rng.normal(size=(3, H, M)), rng.normal(size=(3, H))
    a, b, minimum = rng.normal(size=3)
    alpha = rng.normal(size=M)

    def above_plane(north, east, altitude):
        return altitude - (a * north + b * east)

    rows = clearance(S, above_plane(*path), np.full(H, a), np.full(H, b), minimum)
    moved = above_plane(*(path + S @ alpha))
    np.testing.assert_allclose(rows.A @ alpha - rows.lower, moved - minimum, rtol=0, atol=1e-12)
    assert np.all(np.isposinf(rows.upper))


@settings(deadline=None, max_examples=30)
@given(rng=SEEDS)
def test_no_correction_is_always_allowed(rng):
    """Hard rows admit alpha = 0 even where the nominal path is beyond its limits."""
    nominal = rng.normal(size=(4, H)) * 3
    rows = bounds(rng.normal(size=(4, H, M)), nominal, -1.0, 1.0)
    data = assemble(random_terms(rng), [rows])
    assert np.all(data.lower <= 0)
    assert np.all(data.upper >= 0)
    inside = (np.abs(nominal) <= 1).ravel()
    np.testing.assert_array_equal(data.lower[inside], rows.lower[inside])
    np.testing.assert_array_equal(data.upper[inside], rows.upper[inside])


def test_slack_is_the_worst_shortfall_of_the_soft_rows():
    """One slack is the largest violation of all rows, never negative; its price is in J's units."""
    rng = np.random.default_rng(5)
    soft = Rows(np.eye(M), np.full(M, 2.0), np.full(M, np.inf))
    data = assemble(random_terms(rng), [], soft, rho1=10.0, rho2=4.0)
    alpha = np.array([3.0, 1.0, 2.0, 0.5, 9.0, 2.0])
    assert slack(data, alpha) == 1.5
    assert slack(data, np.full(M, 7.0)) == 0.0
    assert penalty(1.5, 10.0, 4.0) == 2 * (10 * 1.5 + 0.5 * 4 * 1.5**2)
    free = assemble(random_terms(np.random.default_rng(5)), [])
    price = predicted_cost(data, alpha) - predicted_cost(free, alpha)
    assert price == pytest.approx(penalty(1.5, 10.0, 4.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"e": np.ones(11)}, r"term: e has the wrong shape, got \(11,\), expected \(12,\)"),
        ({"w": -2.0}, "term: negative weight, got -2.0, expected >= 0"),
    ],
)
def test_a_term_of_wrong_shape_or_sign_is_refused(change, message):
    """The error names what was found and what is expected."""
    first, *others = random_terms(np.random.default_rng(7))
    with pytest.raises(ValueError, match=message):
        assemble([first._replace(**change), *others], [])


def test_a_slack_that_costs_nothing_is_refused():
    """Both weights of the slack are positive, or the problem is not strictly convex."""
    with pytest.raises(ValueError, match="slack: weights must be positive"):
        assemble(random_terms(np.random.default_rng(8)), [], rho2=0.0)
