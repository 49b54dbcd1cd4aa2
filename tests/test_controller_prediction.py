"""Identification of the response S, on a model where it is known and on the helicopter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_model import FEEDBACK, LAG, G, LinearModel, T, aim_at

from controller import bases
from controller.bases import orthonormalise, span_basis
from controller.course import Path
from controller.optimise import ACTUATORS, TRACKED, quadratic_programme
from controller.parameters import MpcParameters, design
from controller.prediction import Response, identify, stack_bases
from controller.qp import predicted_cost
from controller.solvers import Status, solve
from controller.terrain_map import empty_map
from controller.tracking import targets
from plant.helicopter import HelicopterModel, ModelParameters

H = 200
CALM = np.zeros(3)
SEEDS = st.integers(0, 2**32 - 1).map(np.random.default_rng)
COUNTS = (3, 2, 4, 1)  # functions on thrust, pitch, roll, heading
LINEAR = LinearModel()


def basis(count, family="tent"):
    return span_basis(family, H, count, sample_period=T)[0]


PHI = stack_bases([basis(n) for n in COUNTS])


def responses(model, state, u0, Phi=PHI, amplitude=1e-4):
    """Return S by output name."""
    found = identify(model, state, u0, Phi, np.broadcast_to(amplitude, 4), CALM, CALM)
    assert found.valid
    return dict(zip(model.outputs, found.S, strict=True)), found


def nominal(model, rng=None, size=0.0):
    """Return level flight at 30 m/s, and its command with smooth disturbances of ``size`` on it."""
    state, command, _ = model.trim(30.0)
    u0 = np.tile(command, (H, 1))
    if rng is not None:
        u0 = u0 + size * basis(8) @ rng.uniform(-1.0, 1.0, (8, 4))
    return state, u0


def lag_of(x):
    """Return the response of tilt += (1 - a) (x - tilt)."""
    out, tilt = np.empty_like(x), np.zeros_like(x[0])
    for k, now in enumerate(x):
        tilt = tilt + (1 - LAG) * (now - tilt)
        out[k] = tilt
    return out


def test_columns_are_ordered_by_channel():
    """Phi lets every channel answer its own coefficients only, thrust first."""
    owner = np.repeat(range(4), COUNTS)
    assert PHI.shape == (4, H, sum(COUNTS))
    for channel, B in enumerate(map(basis, COUNTS)):
        np.testing.assert_array_equal(PHI[channel][:, owner == channel], B)
        assert not PHI[channel][:, owner != channel].any()
    S, _ = responses(LINEAR, *nominal(LINEAR))
    moved_by = {"altitude": 0, "north": 1, "pitch": 1, "east": 2, "roll": 2, "heading": 3}
    for name, channel in moved_by.items():
        moved = S[name].any(axis=0)
        np.testing.assert_array_equal(moved, owner == channel, err_msg=name)


@pytest.mark.parametrize("amplitude", [1e-4, 1.0])
def test_response_of_a_linear_model_is_exact(amplitude):
    """S is the double integral, the lag and the feed-through that the model is made of."""
    thrust, pitch, roll, heading = PHI
    tilt = {"pitch": lag_of(pitch), "roll": lag_of(roll), "heading": lag_of(heading)}
    fall = np.cumsum(np.cumsum(G * T**2 * thrust, axis=0), axis=0)
    before = {name: np.concatenate([0 * x[:1], x[:-1]]) for name, x in tilt.items()}
    expected = tilt | {
        "altitude": fall,
        "speed": -np.cumsum(G * T * tilt["pitch"], axis=0),
        "north": -np.cumsum(np.cumsum(G * T**2 * tilt["pitch"], axis=0), axis=0),
        "east": np.cumsum(np.cumsum(G * T**2 * tilt["roll"], axis=0), axis=0),
        "actuator_thrust": thrust,
        "actuator_pitch": pitch - FEEDBACK * before["pitch"],
        "actuator_tail": heading - FEEDBACK * before["heading"],
    }
    S, _ = responses(LINEAR, *nominal(LINEAR), amplitude=amplitude)
    rounding = 1e-13 * 300.0 / amplitude  # of positions of 300 m, divided by the amplitude
    for name, exact in expected.items():
        np.testing.assert_allclose(S[name], exact, rtol=1e-12, atol=rounding, err_msg=name)


@settings(deadline=None, max_examples=15)
@given(rng=SEEDS, amplitude=st.floats(0.01, 10.0))
def test_responses_of_a_linear_model_superpose(rng, amplitude):
    """Whatever alpha is, the model flies y0 + S alpha and u0 + Phi alpha."""
    state, u0 = nominal(LINEAR, rng, 0.1)
    _, found = responses(LINEAR, state, u0, amplitude=amplitude)
    alpha = rng.normal(size=PHI.shape[2])
    u = u0 + (found.Phi @ alpha).T
    flown = LINEAR.rollout(state, u[None], CALM, CALM).outputs[0].T
    np.testing.assert_allclose(found.nominal + found.S @ alpha, flown, rtol=1e-9, atol=1e-8)


def test_a_response_can_be_of_some_outputs_only():
    """Rows choose the outputs of S, in their order; the nominal always has all."""
    state, u0 = nominal(LINEAR)
    _, all_of_them = responses(LINEAR, state, u0)
    rows = np.array([4, 0])
    some = identify(LINEAR, state, u0, PHI, np.full(4, 1e-4), CALM, CALM, rows)
    np.testing.assert_array_equal(some.S, all_of_them.S[rows])
    np.testing.assert_array_equal(some.nominal, all_of_them.nominal)


@pytest.mark.parametrize("command", ["attitude", "actuator"])
def test_wind_and_bias_are_part_of_the_nominal(command):
    """The nominal is the rollout under the wind and the bias that are known."""
    model = HelicopterModel(ModelParameters(command=command))
    state, u0 = nominal(model)
    wind, bias = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.0, -0.2])
    found = identify(model, state, u0, PHI, np.full(4, 1e-4), wind, bias)
    alone = model.rollout(state, u0[None], wind, bias)
    np.testing.assert_array_equal(found.nominal, alone.outputs[0].T)


@pytest.mark.parametrize("preset", ["r50", "r50_bare"])
@pytest.mark.parametrize(("family", "count"), [("laguerre", 5), ("tent", 10)])
def test_both_signs_and_other_sizes_give_the_same_response(preset, family, count):
    """On the helicopter S from +d, -d and 3 d agrees to 1e-3 of its size, output by output."""
    model = HelicopterModel(ModelParameters(preset=preset))
    shape = design(MpcParameters(basis=family, bases_per_channel=count), model, H)
    state, u0 = nominal(model, np.random.default_rng(1), 0.02)
    S = {
        factor: responses(model, state, u0, shape.Phi, factor * shape.amplitude)[0]
        for factor in (1.0, -1.0, 3.0)
    }
    for name in (*TRACKED, *ACTUATORS):
        size = np.linalg.norm(S[1.0][name])
        for factor in (-1.0, 3.0):
            apart = np.linalg.norm(S[factor][name] - S[1.0][name])
            assert apart < 1e-3 * size, (name, factor, apart / size)


def test_a_departed_nominal_is_not_valid():
    """Full pitch for ten seconds departs in actuator form, and the response says so."""
    model = HelicopterModel(ModelParameters(command="actuator"))
    state, u0 = nominal(model)
    u0[:, 1] = model.command_max[1]
    assert not identify(model, state, u0, PHI, np.full(4, 1e-5), CALM, CALM).valid


# -- the span decides, not its columns ---------------------------------------------------------


def wavy_path():
    """Return a reference over ground that rises and falls by 12 m."""
    s = np.arange(-100.0, 600.0)
    z = 106.0 - 6.0 * np.cos(s / 40.0)
    slope = 6.0 / 40.0 * np.sin(s / 40.0)
    return Path(-100.0, 1.0, s, 8 * np.sin(s / 90), z, 8 / 90 * np.cos(s / 90), 30 + 0 * s, slope)


def programme(model, response, u0, rows):
    """Return the QP of a flight along the wavy path, from the response of the outputs in rows."""
    aim = aim_at(wavy_path(), empty_map(10.0), model, H)
    target = targets(aim.path, *response.nominal[rows[:2]], aim.near, T, aim.heading)
    return quadratic_programme(response, rows, u0, aim, target, model)


@pytest.mark.parametrize("count", range(1, 10))
def test_laguerre_and_legendre_reach_the_same_optimum(count):
    """Equally many Laguerre polynomials (in seconds) and Legendre ones cost the same to 1e-8.

    S is identified along Legendre polynomials and mapped to Laguerre polynomials, which are made
    orthonormal among themselves: another basis of the same span.
    """
    model = HelicopterModel(ModelParameters())
    state, u0 = nominal(model)
    state[2] = -100.0
    legendre = orthonormalise(bases.legendre(H, count))[0]
    laguerre = orthonormalise(bases.laguerre(H, count, sample_period=T))[0]
    rows = np.array([model.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])
    Phi, amplitude = stack_bases([legendre] * 4), np.full(4, 1e-4)
    found = identify(model, state, u0, Phi, amplitude, CALM, CALM, rows)
    to_legendre = np.kron(np.eye(4), legendre.T @ laguerre / H)
    mapped = Response(found.nominal, found.S @ to_legendre, stack_bases([laguerre] * 4), True)
    np.testing.assert_allclose(mapped.Phi, found.Phi @ to_legendre, atol=1e-6)
    cost = {}
    for name, response in (("legendre", found), ("laguerre", mapped)):
        data = programme(model, response, u0, rows)
        solution = solve(data)
        assert solution.status is Status.OPTIMAL
        cost[name] = predicted_cost(data, solution.alpha)
    assert cost["laguerre"] == pytest.approx(cost["legendre"], rel=1e-8)
    assert cost["legendre"] < 0.9 * programme(model, found, u0, rows).constant


@pytest.mark.parametrize("count", [1, 5, 9])
@pytest.mark.parametrize("time", ["seconds", "normalised"])
def test_designs_of_equal_span_are_the_same_design(count, time):
    """The design identifies on one basis of the span: the choice of polynomial changes no bit."""
    model = HelicopterModel(ModelParameters())
    chosen = {
        family: design(
            MpcParameters(basis=family, bases_per_channel=count, laguerre_time=time), model, H
        ).Phi
        for family in ("laguerre", "legendre", "chebyshev")
    }
    np.testing.assert_array_equal(chosen["laguerre"], chosen["legendre"])
    np.testing.assert_array_equal(chosen["laguerre"], chosen["chebyshev"])
