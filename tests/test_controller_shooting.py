"""Multiple shooting: its trajectory is the kernels', its optimum is one, its limits are kept."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from controller.shooting import shooter
from paper.problem import altitude_step, costs, goal_of
from plant.prediction import HelicopterModel, ModelParameters

H = 30
STEP = altitude_step(horizon=H, at_s=0.75, height_m=3.0)


@pytest.fixture(scope="module")
def shoot():
    return shooter(STEP.model, H)


@pytest.fixture(scope="module")
def shot(shoot):
    return shoot(STEP.state, STEP.u0, goal_of(STEP))


def test_trajectory_is_the_kernels(shot):
    """The states that IPOPT found are those of a compiled rollout of its commands, to 1e-9."""
    assert shot.status == "Solve_Succeeded"
    flown = STEP.model.rollout(STEP.state, shot.u[None], STEP.wind, STEP.bias)
    assert flown.valid.all()
    np.testing.assert_allclose(shot.X[-1], flown.last[0], rtol=1e-9, atol=1e-9)
    of_states = [shot.X[1:, 0], shot.X[1:, 1], -shot.X[1:, 2], shot.X[1:, 8]]
    np.testing.assert_allclose(np.array(of_states).T, flown.outputs[0, :, :4], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(shot.J, costs(STEP, shot.u[None])[0], rtol=1e-9)


def test_nothing_near_is_better(shot):
    """No small change of the commands lowers the true cost: it is a minimum, and well below trim."""
    rng = np.random.default_rng(0)
    near = shot.u + 1e-3 * rng.normal(size=(64, H, 4))
    assert costs(STEP, near).min() > shot.J
    assert costs(STEP, STEP.u0[None])[0] > 1.6 * shot.J


def test_optimum_is_a_fixed_point(shoot, shot):
    """Shooting from the optimum finds the same optimum, and twice the same bits."""
    again, twice = (shoot(STEP.state, shot.u, goal_of(STEP)) for _ in range(2))
    np.testing.assert_allclose(again.u, shot.u, atol=1e-4)
    np.testing.assert_allclose(again.J, shot.J, rtol=1e-8)
    assert np.array_equal(again.u, twice.u)


def test_fatrop_finds_the_same(shot):
    """The Riccati recursion of fatrop and IPOPT's sparse factors lead to one optimum."""
    other = shooter(STEP.model, H, solver="fatrop")(STEP.state, STEP.u0, goal_of(STEP))
    np.testing.assert_allclose(other.J, shot.J, rtol=1e-6)
    np.testing.assert_allclose(other.u, shot.u, atol=1e-3)


def test_gauss_newton_gains_at_every_cap(shot):
    """Without the dynamics' curvature a capped search is short of the optimum, yet below trim."""
    few = shooter(STEP.model, H, hessian="gauss_newton", iterations=8)
    found = few(STEP.state, STEP.u0, goal_of(STEP))
    assert found.iterations == 8
    assert shot.J < costs(STEP, found.u[None])[0] < costs(STEP, STEP.u0[None])[0]


def test_limits_bind(shoot, shot):
    """A tighter attitude and a shorter reach of the commands are kept, each at a price."""
    pitch = np.abs(shot.X[:, 7]).max()
    level = shoot(STEP.state, STEP.u0, goal_of(STEP)._replace(attitude_limit=0.8 * pitch))
    assert np.abs(level.X[:, 6:8]).max() == pytest.approx(0.8 * pitch, abs=1e-6)
    reach = np.array([0.5, np.inf, np.inf, np.inf])
    weak = shoot(STEP.state, STEP.u0, goal_of(STEP)._replace(reach=reach))
    assert np.abs(weak.u[:, 0] - STEP.commands[0]).max() == pytest.approx(0.5, abs=1e-6)
    assert min(level.J, weak.J) > shot.J


def test_start_beyond_a_limit_is_not_infeasible(shoot):
    """Off course by more than the heading's limit, no sample is further off than under trim."""
    state = STEP.state.copy()
    state[8] = 0.4
    trimmed = STEP.model.rollout(state, STEP.u0[None], STEP.wind, STEP.bias).outputs[0, :, 3]
    turned = shoot(state, STEP.u0, goal_of(STEP)._replace(heading_limit=0.1))
    assert turned.status == "Solve_Succeeded"
    assert (np.abs(turned.X[1:, 8]) <= np.maximum(0.1, trimmed) + 1e-8).all()


def test_wind_and_bias_are_the_rollouts(shoot):
    """Steady wind and an acceleration bias enter as they enter a rollout."""
    windy = replace(STEP, wind=np.array([2.0, 1.0, 0.0]), bias=np.array([0.1, 0.0, -0.3]))
    found = shoot(windy.state, windy.u0, goal_of(windy), wind=windy.wind, bias=windy.bias)
    np.testing.assert_allclose(found.J, costs(windy, found.u[None])[0], rtol=1e-9)


def test_actuator_form():
    """Where the commands are the actuators, their bounds are the only limits, and are kept."""
    problem = altitude_step(form="actuator", horizon=10, at_s=0.25, height_m=3.0)
    found = shooter(problem.model, 10, hessian="gauss_newton")(
        problem.state, problem.u0, goal_of(problem)
    )
    np.testing.assert_allclose(found.J, costs(problem, found.u[None])[0], rtol=1e-9)
    assert found.u[:, 0].max() == pytest.approx(problem.model.command_max[0], abs=1e-6)
    assert (found.u >= problem.model.command_min).all()
    assert (found.u <= problem.model.command_max).all()


def test_needs_a_symbolic_model_and_casadi(monkeypatch):
    """A black box, a collective rotor and a missing CasADi are refused by name."""

    class Box:
        symbolic = None

    with pytest.raises(ValueError, match="no symbolic form, got 'Box', expected"):
        shooter(Box(), H)
    with pytest.raises(ValueError, match="got rotor 'collective'"):
        shooter(HelicopterModel(ModelParameters(rotor="collective")), H)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ValueError, match=r"expected `pip install casadi`"):
        shooter(STEP.model, H)
