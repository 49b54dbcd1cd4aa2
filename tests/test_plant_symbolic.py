"""The dynamics under CasADi: the same numbers as compiled, exact derivatives, no casadi unasked."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant import dynamics, kernels
from plant.dynamics import NO_GROUND
from plant.prediction import HelicopterModel, ModelParameters
from plant.r50 import constants
from plant.rotorcraft import AirframeParameters, rotorcraft
from plant.symbolic import casadi_derivative, sample_map
from plant.trim import trim, with_stabiliser

STILL = (0.0, 0.0, 0.0)
P = with_stabiliser(constants(), 30.0)
TRACED = {
    "derivative_thrust": casadi_derivative(P),
    "derivative_collective": casadi_derivative(P, collective=True),
}
bounded = st.floats(-1.0, 1.0)
states = st.tuples(
    *[st.floats(-100, 100)] * 3, st.floats(-35, 35), *[st.floats(-10, 10)] * 2,
    *[bounded] * 2, st.floats(-4, 4), *[st.floats(-2, 2)] * 3, *[st.floats(-0.6, 0.6)] * 2,
    st.floats(-1, 9), *[st.floats(-0.4, 0.4)] * 2,
)  # fmt: skip
commands = st.tuples(st.floats(-1, 4), *[st.floats(-1, 1)] * 2, st.floats(-9, 9))
winds = st.tuples(*[st.floats(-10, 10)] * 3)


@given(states, commands, winds)
@pytest.mark.parametrize("name", TRACED)
def test_traced_equals_compiled(name, x, u, wind):
    """CasADi's trace and numba's kernel agree to 1e-12 of each derivative's scale."""
    bias = (0.1, -0.2, 0.3)
    compiled = np.array(getattr(kernels, name)(x, u, wind, -20.0, bias, P))
    traced = TRACED[name](x, u, wind, -20.0, bias).full().ravel()
    scale = 1.0 + np.abs(compiled) + 40 * (np.max(np.abs(x)) + 1)
    assert np.max(np.abs(traced - compiled) / scale) < 1e-12


def test_jacobian_is_the_derivative():
    """At trim CasADi's Jacobian by the state is what central differences approach."""
    state, u = trim(25.0, P)
    x = np.array(state)
    jacobian = TRACED["derivative_thrust"].jacobian()
    exact = jacobian(x, u, STILL, NO_GROUND, STILL, np.zeros(17))[0].full()

    def f(z):
        return np.array(dynamics.derivative(tuple(z.tolist()), u, STILL, NO_GROUND, STILL, P))

    columns = [(f(x + e) - f(x - e)) / 2e-6 for e in 1e-6 * np.eye(17)]
    assert np.allclose(exact, np.array(columns).T, rtol=1e-6, atol=1e-6)


def test_casadi_is_asked_for_only_when_needed():
    """Without CasADi everything is importable; tracing is a ValueError that names the extra."""
    program = (
        "import sys; sys.modules['casadi'] = None\n"
        "import plant.helicopter as h\n"
        "try: h.Helicopter(h.HelicopterParameters()).c_source()\n"
        "except ValueError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stderr == ""
    assert done.stdout.endswith("got none, expected `pip install casadi`\n")


@pytest.mark.parametrize("form", ["attitude", "actuator"])
def test_sample_map_is_the_rollout(form):
    """One traced sample equals the kernel's to 1e-12, and 10 s of them to 1e-9."""
    model = HelicopterModel(ModelParameters(command=form))
    advance, outputs = model.symbolic()
    state, trimmed, _ = model.trim(30.0)
    shake = {"attitude": 0.02, "actuator": 0.002}[form]
    u = trimmed + np.random.default_rng(1).normal(0.0, shake, (200, 4))
    wind, bias = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.0, -0.2])
    flown = model.rollout(state, u[None], wind, bias)
    assert flown.valid.all()
    X = advance.mapaccum(200)(state, u.T, wind, bias).full()
    begin = np.column_stack([state, X[:, :-1]])
    error = np.abs(outputs.map(200)(begin, u.T, X).full() - flown.outputs[0].T)
    assert error[:, 0].max() < 1e-12
    assert error.max() < 1e-9
    assert np.abs(X[:, -1] - flown.last[0]).max() < 1e-9


def test_sample_map_of_the_collective_rotor():
    """The map of a collective rotor advances the induced velocity as its kernel does."""
    craft = rotorcraft(AirframeParameters(rotor="collective"))
    level = craft.trim(30.0)
    u, own = craft.trim_command(level), craft.own_state(np.array(level.state))
    last = craft.roll(own[None], np.tile(u, (1, 40, 1)), np.zeros(3), np.zeros(3)).last[0]
    x = sample_map(craft).advance.mapaccum(40)(own, u, STILL, STILL).full()[:, -1]
    assert np.abs(x - last).max() < 1e-9


def test_collective_model_has_no_symbolic_form():
    """A collective rotor's own state is not the common one, so its model is refused by name."""
    model = HelicopterModel(ModelParameters(rotor="collective"))
    with pytest.raises(ValueError, match="got rotor 'collective', expected 'thrust'"):
        model.symbolic()
