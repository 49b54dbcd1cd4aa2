"""The shapes of figures 1 and 4, and their spans."""

import numpy as np
import pytest

from paper.bases import LEGENDRE, SECONDS, UNIT, shapes, spans, study, within_lines


def test_papers_polynomials():
    """The drawn Laguerre functions are the paper's printed b_0 to b_4, in seconds."""
    drawn = shapes((SECONDS,))
    t = np.array(drawn["time_s"])
    printed = (
        np.ones_like(t),
        1 - t,
        1 - 2 * t + 0.5 * t**2,
        1 - 3 * t + 1.5 * t**2 - t**3 / 6,
        1 - 4 * t + 3 * t**2 - 2 / 3 * t**3 + t**4 / 24,
    )
    for n, b in enumerate(printed):
        np.testing.assert_allclose(drawn[f"{SECONDS}, n = {n}"], b, rtol=0, atol=1e-12)


def test_one_space():
    """Polynomials of one degree span one space to rounding; Laguerre functions and tents another."""
    found = spans(5)
    sine = dict(zip(found["family"], found["sine_to_legendre"], strict=True))
    for family in (UNIT, SECONDS, LEGENDRE, "Chebyshev", "orthonormal"):
        assert sine[family] < 1e-10
    assert min(sine["tents"], sine["Laguerre functions, 0.5 /s"]) > 0.1


def test_straight_lines():
    """A straight line is all line, and a parabola without mean and slope has none."""
    t = np.linspace(-1, 1, 101)
    parabola = t**2 - np.mean(t**2)
    np.testing.assert_allclose(
        within_lines(np.stack([2 + 3 * t, parabola], axis=1)), [1, 0], atol=1e-12
    )


def test_study():
    """The study has figures 1 and 4, and a verdict on the claim that the families differ."""
    found = study(quick=True, progress=lambda _: None)
    assert [figure.name for figure in found.figures] == ["fig1_laguerre", "fig4_legendre"]
    assert found.claims[1].verdict == "does not hold"
    assert found.figures[0].table["unit_time"][-1] == pytest.approx(1.0)
