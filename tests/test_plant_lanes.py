"""Rollouts in lanes: golden flight, order of convergence, independence of the lanes."""

import numpy as np
import pytest

from plant import kernels, lanes
from plant.r50 import constants
from plant.terrain import Terrain, TerrainParameters
from plant.trim import trim

P = constants()
STILL = np.zeros(3)
SEA = Terrain(TerrainParameters(shape="flat")).grid


def golden_commands():
    """Return 10 s of commands about the 30 m/s trim, one column per channel."""
    _, u = trim(30.0, P, ground=-100.0)
    t = 0.05 * np.arange(200)
    waves = [0.05 * np.sin(t), np.radians(0.5) * np.sin(1.3 * t), np.radians(0.5) * np.sin(0.9 * t),
             0.01 * np.sin(0.7 * t)]  # fmt: skip
    return np.array(u) + np.stack(waves, axis=1)


def roll(state, commands, substeps, *, ground=False, roll=kernels.roll_thrust, p=P):
    """Roll out N states, padded to whole blocks by the caller."""
    N, H, _ = commands.shape
    out, last = np.empty((len(lanes.OUTPUTS), H, N)), np.empty((N, 17))
    valid = np.empty(N, dtype=bool)
    roll(
        state, commands, STILL, STILL, np.array(p), 0.05 / substeps, substeps, ground, SEA,
        out, last, valid,
    )  # fmt: skip
    return out, last, valid


def start(altitude=100.0, speed=30.0):
    state = np.array(trim(speed, P, ground=-altitude)[0])
    state[2] = -altitude
    return state


GOLDEN = [
    295.595666538, 15.945435498, -104.839305152, 28.749877876, -0.432482277, -7.689258977,
    0.108557836, -0.238689591, 0.06459848, 0.008324936, 0.019806401, 0.051671665, -0.024460622,
    0.006928673, 1.104745524, -0.037236813, 0.01179092,
]  # fmt: skip


def block(commands):
    return np.tile(commands, (lanes.LANES, 1, 1)), np.tile(start(), (lanes.LANES, 1))


def test_golden_rollout():
    """Ten seconds of gentle manoeuvres end where the prototype ended, to 1e-6 of each magnitude."""
    commands, x0 = block(golden_commands())
    _, last, valid = roll(x0, commands, 64, ground=True)
    assert valid.all()
    assert np.allclose(last[0], GOLDEN, rtol=1e-6, atol=1e-6)


def test_fourth_order():
    """Halving the step divides the error by sixteen: classical Runge-Kutta."""
    commands, x0 = block(golden_commands()[:60])
    exact = roll(x0, commands, 64)[1][0]
    errors = [np.max(np.abs(roll(x0, commands, n)[1][0] - exact)) for n in (2, 4, 8)]
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((order > 3.7) & (order < 4.4))


def test_a_lane_does_not_see_its_neighbours():
    """Each trajectory of a batch is bit for bit the one it is alone, whatever its lane."""
    rng = np.random.default_rng(3)
    commands = golden_commands()[None, :50] + 0.01 * rng.standard_normal((16, 50, 4))
    x0 = start() + 0.01 * rng.standard_normal((16, 17))
    out, last, _ = roll(x0, commands, 2)
    for n in (0, 5, 11):
        alone = roll(np.tile(x0[n], (8, 1)), np.tile(commands[n], (8, 1, 1)), 2)
        assert np.array_equal(alone[0][:, :, 0], out[:, :, n])
        assert np.array_equal(alone[1][0], last[n])


@pytest.mark.parametrize("kernel", [kernels.roll_thrust, kernels.roll_collective])
def test_sample_by_sample_is_the_same_flight(kernel):
    """Rolling H samples at once equals rolling them one by one, bit for bit."""
    commands, x0 = block(golden_commands())
    if kernel is kernels.roll_collective:
        x0[:, 14] = 3.0  # induced velocity, m/s
    state = x0
    for k in range(40):
        state = roll(state, commands[:, k : k + 1], 2, roll=kernel)[1]
    assert np.array_equal(state, roll(x0, commands[:, :40], 2, roll=kernel)[1])


@pytest.mark.parametrize("kernel", [kernels.roll_thrust, kernels.roll_collective])
def test_outputs_are_those_of_the_state(kernel):
    """The last sample's outputs are the final state's position, attitude, speed and velocity."""
    commands, x0 = block(golden_commands()[:20])
    if kernel is kernels.roll_collective:
        x0[:, 14] = 3.0  # induced velocity, m/s
    out, last, _ = roll(x0, commands, 2, roll=kernel)
    x, y = last[0], dict(zip(lanes.OUTPUTS, out[:, -1, 0], strict=True))
    assert (y["north"], y["east"], y["altitude"], y["heading"]) == (x[0], x[1], -x[2], x[8])
    velocity = [y[f"velocity_{axis}"] for axis in ("north", "east", "down")]
    assert np.linalg.norm(velocity) == pytest.approx(y["speed"], rel=1e-14)
    assert y["speed"] == pytest.approx(np.linalg.norm(x[3:6]), rel=1e-14)


def test_full_deflection_is_marked_invalid():
    """A flight that tumbles past 80 degrees is invalid, and its flapping stays at its stops."""
    commands, x0 = block(golden_commands())
    commands[:, :, 1] = P.tilt_max
    _, last, valid = roll(x0, commands, 2)
    assert not valid.any()
    assert np.all(np.abs(last[:, 12:14]) <= 0.4363323129985824)
