"""Ranks of S'QS."""

import numpy as np

from controller.bases import legendre
from paper.bases import LEGENDRE, PAPERS, UNIT
from paper.rank_scan import (
    Reading,
    distance,
    nearest,
    rank,
    scan,
    sensitivities,
    spectrum,
)


def test_exact_rank():
    """The rank of a product of known rank is that rank, at any scale."""
    generator = np.random.default_rng(1)
    S = generator.normal(size=(50, 4)) @ generator.normal(size=(4, 9))
    for scale in (1e-6, 1.0, 1e6):
        for scaled in (False, True):
            assert rank(spectrum(scale * S, scaled=scaled), 1e-12) == 4


def test_invalid_flight_has_no_rank():
    """A response that is not finite has no spectrum."""
    assert np.isnan(spectrum(np.full((5, 3), np.nan), scaled=True)).all()


def test_same_space():
    """S of Laguerre polynomials is that of Legendre polynomials times an invertible matrix."""
    B, P = PAPERS[UNIT](60, 4), legendre(60, 4)
    M = np.kron(np.eye(4), np.linalg.lstsq(P, B)[0])
    S, of_legendre = (sensitivities("attitude", each, np.ones(4), 0.0) for each in (B, P))
    for name in ("north", "east", "heading", "yaw rate"):
        np.testing.assert_allclose(S[name], of_legendre[name] @ M, rtol=0, atol=1e-7)


def test_small_perturbations_reach_the_limit():
    """Rollouts of small perturbations give the S of the recursion to their finite difference."""
    B = legendre(60, 3)
    exact, flown = (
        sensitivities("actuator", B, np.ones(4), size)["velocity_north"] for size in (0.0, 1e-5)
    )
    np.testing.assert_allclose(flown, exact, rtol=0, atol=1e-3 * np.abs(exact).max())


def test_distance():
    """The paper's own ranks are at distance zero, and each rank counts."""
    assert distance((9, 13, 6, 9, 9, 4)) == 0
    assert distance((10, 13, 6, 9, 9, 1)) == 4


def test_scan():
    """A scan has a row per reading, Laguerre's argument and tolerance, and the nearest come first."""
    reading = Reading("attitude", "speeds", "G and rad", 0.0, scaled=False)
    found = scan([reading], np.array([1e-12, 1e-6, 1e-2]), lambda _: None)
    assert len(found["distance"]) == 6
    for family in ("laguerre", LEGENDRE.lower()):
        ranks = found[f"{family}_forward"]
        assert ranks[0] >= ranks[1] >= ranks[2]
    best = nearest(found, 2)
    assert best["distance"] == sorted(best["distance"])
    assert best["distance"][0] == min(found["distance"])
