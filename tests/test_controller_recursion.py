"""Identification by recursion: the same S as by rollouts, from another computation."""

import numpy as np
import pytest
from linear_model import LinearModel

from controller.mpc import BasisMpc
from controller.parameters import MpcParameters, design
from controller.prediction import identify
from controller.recursion import propagate
from plant.prediction import HelicopterModel, ModelParameters

CALM = np.zeros(3)


def test_a_recursion_is_the_sum_of_its_paths():
    """S_k is D_k Phi_k plus, over all earlier samples j, C_k A_{k-1} .. A_{j+1} B_j Phi_j."""
    rng = np.random.default_rng(0)
    n, p, H, m = 5, 3, 6, 4
    slopes = rng.standard_normal((H, n + p, n + 4))
    Phi = rng.standard_normal((4, H, m))
    A, B, C, D = slopes[:, :n, :n], slopes[:, :n, n:], slopes[:, n:, :n], slopes[:, n:, n:]
    rows = np.array([2, 0])
    S = propagate(slopes, Phi, rows)
    for k in range(H):
        expected = D[k] @ Phi[:, k]
        for j in range(k):
            path = np.linalg.multi_dot([np.eye(n), *A[k - 1 : j : -1], np.eye(n)])
            expected = expected + C[k] @ path @ B[j] @ Phi[:, j]
        np.testing.assert_allclose(S[:, k], expected[rows], rtol=1e-10)


@pytest.mark.parametrize(
    ("form", "error"), [("attitude", 5e-4), ("actuator", 1e-2)], ids=["attitude", "actuator"]
)
@pytest.mark.parametrize(("family", "count"), [("laguerre", 5), ("tent", 10)])
def test_recursion_and_rollouts_agree(form, error, family, count):
    """Both are the same S, but for the one-sided differences' error, which falls with their size."""
    model = HelicopterModel(ModelParameters(command=form))
    shape = design(MpcParameters(basis=family, bases_per_channel=count), model, 200)
    state, command, _ = model.trim(30.0)
    u0 = np.tile(command, (200, 1))
    u0[:, 0] += 0.05 * np.sin(np.arange(200) / 15)
    exact = identify(model, state, u0, shape.Phi, shape.amplitude, CALM, CALM, by="recursion")
    assert exact.valid
    size = np.abs(exact.S).max(axis=(1, 2), keepdims=True)
    off = []
    for factor in (1.0, 0.1):
        by_rollouts = identify(model, state, u0, shape.Phi, factor * shape.amplitude, CALM, CALM)
        assert np.array_equal(by_rollouts.nominal, exact.nominal)
        off.append(np.abs((by_rollouts.S - exact.S) / size)[:10].max())
    assert off[0] < error
    assert off[1] < 0.2 * off[0]


def test_a_column_on_several_channels_is_perturbed_along_itself():
    """A coupled column's response is the sum of those of its parts, whatever the amplitudes."""
    model = HelicopterModel(ModelParameters())
    shape = design(MpcParameters(bases_per_channel=2), model, 40)
    state, command, _ = model.trim(30.0)
    u0 = np.tile(command, (40, 1))
    mix = np.array([[1.0], [0.5], [0.0], [0.7], [-0.3], [0.2], [1.0], [0.4]])
    apart = identify(model, state, u0, shape.Phi, shape.amplitude, CALM, CALM)
    coupled = identify(model, state, u0, shape.Phi @ mix, shape.amplitude, CALM, CALM)
    size = np.abs(apart.S).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(coupled.S / size, apart.S @ mix / size, atol=1e-4)


def test_a_model_without_a_tangent_is_refused():
    """A recursion that the model cannot give is an error at construction, and says what would do."""
    with pytest.raises(ValueError, match="LinearModel without `linearise`, expected .*'rollouts'"):
        BasisMpc(MpcParameters(identification="recursion"), prediction_model=LinearModel())


def test_a_departed_nominal_has_no_valid_response():
    """Where the nominal departs the response is not valid."""
    model = HelicopterModel(ModelParameters(command="actuator"))
    shape = design(MpcParameters(), model, 200)
    state, command, _ = model.trim(30.0)
    u0 = np.tile(command, (200, 1))
    u0[:, 1] = model.command_max[1]
    found = identify(model, state, u0, shape.Phi, shape.amplitude, CALM, CALM, by="recursion")
    assert not found.valid
