"""The helicopter's dynamics: identities, symmetries, golden values, and the compiled twins."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant import dynamics, kernels
from plant.dynamics import NO_GROUND
from plant.elementary import COMPILED
from plant.r50 import constants
from plant.trim import trim

STILL = (0.0, 0.0, 0.0)
P = constants()

bounded = st.floats(-1.0, 1.0)
states = st.tuples(
    *[st.floats(-100, 100)] * 3, st.floats(-35, 35), *[st.floats(-10, 10)] * 2,
    *[bounded] * 2, st.floats(-4, 4), *[st.floats(-2, 2)] * 3, *[st.floats(-0.4, 0.4)] * 2,
    st.floats(0, 3), *[st.floats(-0.4, 0.4)] * 2,
)  # fmt: skip
commands = st.tuples(st.floats(0, 3.5), *[st.floats(-0.3, 0.3)] * 2, st.floats(-0.5, 0.5))
winds = st.tuples(*[st.floats(-10, 10)] * 3)


@given(states, commands, winds)
@pytest.mark.parametrize("name", ["derivative", "derivative_collective"])
def test_compiled_equals_plain(name, x, u, wind):
    """The compiled kernel is the plain function to 1e-12 of each derivative's scale."""
    plain = getattr(dynamics, name)(x, u, wind, -50.0, (0.1, -0.2, 0.3), P)
    twin = {"derivative": kernels.derivative_thrust}.get(name, kernels.derivative_collective)
    compiled = twin(x, u, wind, -50.0, (0.1, -0.2, 0.3), P)
    scale = 1.0 + np.abs(plain) + 40 * (np.max(np.abs(x)) + 1)
    assert np.max(np.abs(np.subtract(plain, compiled)) / scale) < 1e-12


def test_sine_and_cosine_are_accurate():
    """The branch-free sine and cosine are within 2e-16 of the library's over +-1000 rad."""
    x = np.concatenate([np.linspace(-1000, 1000, 20001), np.arange(-40, 40) * math.pi / 4])
    twin = COMPILED["sincos"]
    sincos = numba.njit(lambda value: twin(value))  # Python cannot call it
    got = np.array([sincos(value) for value in x])
    assert np.max(np.abs(got[:, 0] - np.sin(x))) < 2.3e-16
    assert np.max(np.abs(got[:, 1] - np.cos(x))) < 2.3e-16


def test_free_fall():
    """Without thrust and air speed the only acceleration is gravity, exactly."""
    x = (0.0,) * 17
    rates = dynamics.derivative(x, (0.0,) * 4, STILL, NO_GROUND, STILL, P)
    assert rates[3:6] == (0.0, 0.0, P.g)


def test_bias_is_an_acceleration():
    """The bias adds to the acceleration in NED axes and to nothing else."""
    state, u = trim(20.0, P)
    bias = (0.3, -0.7, 0.2)
    plain = np.array(dynamics.derivative(state, u, STILL, NO_GROUND, STILL, P))
    pushed = np.array(dynamics.derivative(state, u, STILL, NO_GROUND, bias, P))
    extra = pushed - plain
    assert np.linalg.norm(extra[3:6]) == pytest.approx(np.linalg.norm(bias), rel=1e-12)
    assert not np.any(np.delete(extra, (3, 4, 5)))


def test_hover_inflow():
    """In hover v_i = sqrt(T / (2 rho A))."""
    T = 600.0
    A = math.pi * P.radius**2
    exact = math.sqrt(T / (2 * P.rho * A))
    assert dynamics.inflow(T, 0.0, 0.0, P) == pytest.approx(exact, rel=1e-8)


def test_axial_climb_conserves_power():
    """In axial climb Glauert's inflow satisfies v_i (V_c + v_i) = T / (2 rho A)."""
    A = math.pi * P.radius**2
    for climb in (0.5, 2.0, 6.0):
        v_i = dynamics.inflow(700.0, 0.0, climb, P)
        assert v_i * (climb + v_i) == pytest.approx(700.0 / (2 * P.rho * A), rel=1e-8)


@given(states, commands)
def test_mirror(x, u):
    """Reflection in the plane of symmetry, rotor sense and cross-coupling included, is a symmetry."""
    sign = np.array([1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1, -1, 1, 1, -1.0])
    mirrored = P._replace(ROT=-P.ROT, A_b=-P.A_b, B_a=-P.B_a)
    turn = np.array([1, 1, -1, -1.0])
    here = np.array(dynamics.derivative(x, u, STILL, NO_GROUND, STILL, P))
    there = np.array(
        dynamics.derivative(tuple(sign * x), tuple(turn * u), STILL, NO_GROUND, STILL, mirrored)
    )
    assert np.max(np.abs(sign * here - there) / (1 + np.abs(here))) < 1e-12


TRIM_TABLE = [  # speed m/s; nT G, a_c deg, b_c deg, nt G, phi deg, theta deg, power kW
    (0, 1.0193, 0.05, 0.28, 0.0571, 2.99, 0.00, 6.34),
    (5, 1.0198, -0.13, 0.27, 0.0509, 2.66, -0.61, 5.65),
    (10, 1.0216, -0.31, 0.23, 0.0411, 2.14, -1.74, 4.56),
    (15, 1.0275, -0.53, 0.26, 0.0387, 1.99, -3.66, 4.27),
    (20, 1.0426, -0.84, 0.35, 0.0443, 2.20, -6.28, 4.82),
    (25, 1.0732, -1.31, 0.53, 0.0583, 2.72, -9.47, 6.23),
    (30, 1.1263, -2.01, 0.83, 0.0830, 3.52, -13.09, 8.64),
]


def power(speed):
    state, u = trim(float(speed), P)
    flow = dynamics.hub_flow(state, state[3:6], P)
    T = P.weight * u[0]
    return dynamics.rotor_power(T, dynamics.inflow(T, flow[7], flow[6], P), flow[6], flow[7], P)


@pytest.mark.parametrize("row", TRIM_TABLE, ids=lambda row: f"{row[0]} m/s")
def test_trim_table(row):
    """Trims over the speed range are those of the prototype, to the digits it gives."""
    speed, *expected, kilowatts = row
    state, u = trim(float(speed), P)
    got = [u[0], math.degrees(u[1]), math.degrees(u[2]), u[3], *np.degrees(state[6:8])]
    assert np.allclose(got, expected, atol=6e-3, rtol=5e-5)
    assert power(speed) / 1e3 == pytest.approx(kilowatts, abs=6e-3)


@pytest.mark.parametrize(
    ("speed", "golden"),
    [
        (30.0, [1.126319905, -0.035061357, 0.014423034, 0.083027998, 0.061519955, -0.228506147,
                -0.022230026, 0.006497412]),
        (0.0, [1.01929492, 0.000931925, 0.00493082, 0.057115837, 0.052113409, 0, 0, 0.00493082]),
    ],
)  # fmt: skip
def test_golden_trim(speed, golden):
    """Golden trims at 100 m to 1e-6, and the derivative vanishes there to 1e-10."""
    state, u = trim(speed, P, ground=-100.0)
    assert np.allclose([*u, *state[6:8], *state[12:14]], golden, atol=1e-6)
    rates = dynamics.derivative(state, u, STILL, -100.0, STILL, P)
    assert np.max(np.abs(rates[3:])) < 1e-10


def test_power_bucket():
    """Least power is needed between 12 and 16 m/s, and 8.8 kW last to 28 to 32 m/s."""
    speeds = np.arange(5.0, 33.0, 0.5)
    kilowatts = np.array([power(v) for v in speeds]) / 1e3
    assert 12 <= speeds[np.argmin(kilowatts)] <= 16
    assert 28 <= speeds[kilowatts < 8.8].max() <= 32


def linearised(speed, derivative, rotor=None):
    state, u = trim(speed, P)
    x = np.array(state)
    if rotor is not None:
        x[14] = rotor(state, u)

    def f(z):
        return np.array(derivative(tuple(z.tolist()), u, STILL, NO_GROUND, STILL, P))

    columns = [(f(x + e) - f(x - e)) / 2e-6 for e in 1e-6 * np.eye(17)]
    return np.array(columns).T


def modes(A):
    values = np.linalg.eigvals(A)
    return sorted((abs(v), -v.real / abs(v)) for v in values if v.imag > 0 and abs(v) > 5)


def test_fast_modes_in_hover():
    """Pitch, roll and flapping modes in hover are within 5 % of Mettler's identified R-50."""
    got = modes(linearised(0.0, dynamics.derivative))
    for (omega, zeta), (frequency, damping) in zip(
        got, [(8.36, 0.203), (11.86, 0.224), (20.9, 0.974)], strict=True
    ):
        assert omega == pytest.approx(frequency, rel=0.05)
        assert zeta == pytest.approx(damping, rel=0.05)


def test_cruise_flies_without_instability():
    """At 30 m/s the open loop has no unstable eigenvalue but its position integrators."""
    A = linearised(30.0, dynamics.derivative)[3:, 3:]
    keep = [i for i in range(14) if i != 5]  # heading is an integrator
    assert np.max(np.linalg.eigvals(A[np.ix_(keep, keep)]).real) < 1e-6


@pytest.mark.parametrize(("speed", "Zw"), [(0.0, -0.44), (15.0, -0.94), (30.0, -1.16)])
def test_only_the_collective_plant_answers_gusts(speed, Zw):
    """A vertical gust acts on the collective plant with the heave damping Zw, on the other hardly."""
    state, u = trim(speed, P)
    flow = dynamics.hub_flow(state, state[3:6], P)
    v_i = dynamics.inflow(P.weight * u[0], flow[7], flow[6], P)

    def rates(derivative, rotor, w):
        """Return the rates of heave and of the rotor under a gust."""
        x = (*state[:14], rotor, *state[15:])
        return np.array(derivative(x, u, (0.0, 0.0, w), NO_GROUND, STILL, P))[[5, 14]]

    def by(f, step=0.01):
        return (f(step) - f(-step)) / (2 * step)

    blades = dynamics.derivative_collective
    heave_w, inflow_w = -by(lambda w: rates(blades, v_i, w))
    heave_v, inflow_v = by(lambda v: rates(blades, v_i + v, 0.0))
    assert heave_w - heave_v * inflow_w / inflow_v == pytest.approx(Zw, abs=0.03)  # inflow settled
    assert abs(by(lambda w: rates(dynamics.derivative, u[0], w))[0]) < 0.2


def test_collective_plant_has_the_same_trim():
    """At the trim of the thrust plant the collective plant rests too."""
    for speed in (0.0, 15.0, 30.0):
        state, u = trim(speed, P)
        flow = dynamics.hub_flow(state, state[3:6], P)
        v_i = dynamics.inflow(P.weight * u[0], flow[7], flow[6], P)
        x = (*state[:14], v_i, *state[15:])
        rates = dynamics.derivative_collective(x, u, STILL, NO_GROUND, STILL, P)
        assert np.max(np.abs(rates[3:])) < 1e-6
