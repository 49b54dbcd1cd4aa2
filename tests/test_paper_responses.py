"""Responses to single basis functions."""

import numpy as np

from controller.bases import legendre
from paper.responses import PITCH, SIZES, TAIL, largest, responses, study


def test_linear():
    """The response to a sum is the sum of the responses, and half the perturbation changes little."""
    B = legendre(60, 3)
    y = responses(PITCH, B)
    both = responses(PITCH, B @ np.array([[1.0], [0.5], [-0.25]]))
    size = np.abs(y).max()
    np.testing.assert_allclose(both[:, 0], y @ [1.0, 0.5, -0.25], rtol=0, atol=1e-4 * size)
    half = responses(PITCH, B, size=SIZES["pitch"] / 2)
    np.testing.assert_allclose(half, y, rtol=0, atol=1e-4 * size)


def test_causal():
    """An output does not answer before its control is moved."""
    B = np.zeros((60, 1))
    B[30:] = 1.0
    for channel in (PITCH, TAIL):
        y = responses(channel, B)
        assert (y[:30] == 0).all()
        assert y[-1] != 0


def test_signs():
    """Aft tilt slows the helicopter down, and tail thrust to the right turns the nose right."""
    B = np.ones((40, 1))
    assert responses(PITCH, B)[-1] < 0
    assert responses(TAIL, B)[-1] > 0


def test_relative():
    """Gains are relative to the constant's."""
    np.testing.assert_array_equal(largest(np.array([[1.0, -4.0], [-2.0, 1.0]])), [1.0, 2.0])


def test_study():
    """The study draws figures 2, 3 and 5 and judges the claim on small gains."""
    found = study(quick=True, progress=lambda _: None)
    names = [figure.name[:4] for figure in found.figures]
    assert {"fig2", "fig3", "fig5"} <= set(names)
    assert found.claims[0].verdict == "holds"
