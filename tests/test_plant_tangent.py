"""The tangent along a trajectory: its nominal is a rollout, its matrices are derivatives."""

import numpy as np
import pytest

from plant.prediction import HelicopterModel, ModelParameters
from plant.rotorcraft import ROTOR
from plant.terrain import Terrain, TerrainParameters

H = 12
STILL = np.zeros(3)
FORMS = [("attitude", "thrust"), ("actuator", "thrust"), ("attitude", "collective")]


def flight(model, seed=0):
    """Return a state off trim and gentle commands."""
    rng = np.random.default_rng(seed)
    state, command, _ = model.trim(30.0)
    size = [0.02, 0.002, 0.002, 0.002]
    return state + 0.01 * rng.standard_normal(17), command + size * rng.standard_normal((H, 4))


@pytest.mark.parametrize(("command", "rotor"), FORMS)
def test_the_nominal_is_a_rollout_to_the_last_bit(command, rotor):
    """The outputs along which the tangent is taken are those that a rollout predicts."""
    model = HelicopterModel(ModelParameters(command=command, rotor=rotor))
    state, commands = flight(model)
    wind, bias = np.array([2.0, -1.0, 0.5]), np.array([0.1, 0.2, -0.1])
    found = model.linearise(state, commands, wind, bias)
    flown = model.rollout(state, commands[None], wind, bias)
    assert found.valid
    assert np.array_equal(found.nominal, flown.outputs[0].T)


@pytest.mark.parametrize(("command", "rotor"), FORMS)
def test_the_matrices_are_derivatives_of_rollouts(command, rotor):
    """Small changes of state and commands change end and outputs by the matrices' products."""
    model = HelicopterModel(ModelParameters(command=command, rotor=rotor))
    state, commands = flight(model)
    rng = np.random.default_rng(1)
    # of the collective rotor, rollouts take the thrust and the tangent the induced velocity
    dx = rng.standard_normal(17) * (rotor == "thrust")
    du = rng.standard_normal((H, 4))
    size = 1e-5
    up = model.rollout(state + size * dx, commands[None] + size * du, STILL, STILL)
    down = model.rollout(state - size * dx, commands[None] - size * du, STILL, STILL)
    found = model.linearise(state, commands, STILL, STILL)
    for k in range(H):
        changed = found.slopes[k] @ np.concatenate([dx, du[k]])
        dx = changed[:17]
        expected = (up.outputs[0, k] - down.outputs[0, k]) / (2 * size)
        np.testing.assert_allclose(changed[17:], expected, rtol=2e-6, atol=2e-6)
    end = (up.last[0] - down.last[0]) / (2 * size)
    if rotor == "collective":  # the same holds for the end
        dx[ROTOR] = end[ROTOR]
    np.testing.assert_allclose(dx, end, rtol=2e-6, atol=2e-6)


def test_moving_the_start_moves_the_flight():
    """Without ground effect the derivative by position is one for position and nothing else."""
    model = HelicopterModel(ModelParameters())
    slopes = model.linearise(*flight(model), STILL, STILL).slopes
    expected = np.zeros((31, 3))
    expected[:3] = np.eye(3)
    expected[17:20] = np.diag([1.0, 1.0, -1.0])
    np.testing.assert_allclose(slopes[:, :, :3], np.tile(expected, (H, 1, 1)), atol=1e-9)


def test_ground_effect_is_part_of_it():
    """Over a terrain the thrust, and so the climb, depends on the height."""
    terrain = Terrain(TerrainParameters(shape="flat"))
    model = HelicopterModel(ModelParameters(), terrain=terrain)
    state, command, _ = model.trim(5.0)
    state[2] = -1.0
    slopes = model.linearise(state, np.tile(command, (H, 1)), STILL, STILL).slopes
    assert (slopes[:, 5, 2] < -1e-4).all()  # lower, so more lift: w, down, falls


def test_a_departed_nominal_is_not_valid():
    """Where the nominal trajectory departs, the tangent says so."""
    model = HelicopterModel(ModelParameters(command="actuator"))
    state, command, _ = model.trim(30.0)
    commands = np.tile(command, (200, 1))
    commands[:, 1] = model.command_max[1]
    assert not model.linearise(state, commands, STILL, STILL).valid
