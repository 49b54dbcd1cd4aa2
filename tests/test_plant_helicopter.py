"""The helicopter as a component, and its agreement with the model that predicts it."""

import math

import numpy as np
import pytest
from fmpy.validation import validate_model_description

from plant import kernels
from plant.helicopter import (
    Helicopter,
    HelicopterModel,
    HelicopterParameters,
    ModelParameters,
    Perturbation,
)
from plant.helicopter_variables import OUTCOMES
from plant.rotorcraft import STATES
from plant.terrain import Terrain, TerrainParameters

STATE = [f"state.{name}" for name in STATES]


def state_of(vehicle):
    return np.array(list(vehicle.get(STATE).values()))


@pytest.fixture(scope="module")
def hills():
    return Terrain(TerrainParameters(shape="fractal", seed=4))


@pytest.mark.parametrize("command", ["attitude", "actuator"])
@pytest.mark.parametrize("preset", ["r50", "r50_no_bar", "r50_no_tail", "r50_bare"])
@pytest.mark.parametrize("speed", [0.0, 10.0, 30.0])
def test_trim_holds(command, preset, speed):
    """From its trim, under its trim command, every preset flies on level for a second."""
    shape = {"preset": preset, "command": command}
    vehicle = Helicopter(HelicopterParameters(**shape, speed_mps=speed, height_agl_m=100.0))
    model = HelicopterModel(ModelParameters(**shape))
    _, command_values, _ = model.trim(speed)
    vehicle.initialize(start_time=0.0)
    vehicle.set({f"command.{n}": v for n, v in zip(model.commands, command_values, strict=True)})
    before = state_of(vehicle)
    for k in range(20):
        assert vehicle.step(k * 0.05, 0.05) == 0
    drift = state_of(vehicle) - before
    assert abs(drift[0] - speed) < 1e-6
    assert np.max(np.abs(drift[1:])) < 1e-6
    assert vehicle.get(["load_factor"])["load_factor"] == pytest.approx(
        math.cos(before[6]) * math.cos(before[7]), abs=1e-6
    )


@pytest.mark.parametrize("command", ["attitude", "actuator"])
@pytest.mark.parametrize("over", ["nothing", "hills"])
def test_prediction_equals_flight(command, over, hills):
    """With equal model, wind and bias a prediction is the flight to come, to the last bit."""
    terrain = hills if over == "hills" else None
    craft = {"command": command}
    vehicle = Helicopter(HelicopterParameters(**craft, height_agl_m=30.0), terrain=terrain)
    model = HelicopterModel(ModelParameters(**craft), terrain=terrain)
    vehicle.initialize(start_time=0.0)
    wind = {"wind.north": -3.0, "wind.east": 5.0, "wind.down": 0.5}
    vehicle.set(wind)
    trimmed = model.trim(30.0)[1]
    commands = trimmed + 0.01 * np.random.default_rng(1).standard_normal((30, 4))
    start = state_of(vehicle)
    predicted = model.rollout(start, commands[None], np.array(list(wind.values())), np.zeros(3))
    for k, command_values in enumerate(commands):
        vehicle.set(
            {f"command.{n}": v for n, v in zip(model.commands, command_values, strict=True)}
        )
        vehicle.step(k * 0.05, 0.05)
        flown = state_of(vehicle)
        assert (flown[0], flown[1], -flown[2], flown[8]) == tuple(predicted.outputs[0, k, :4])
    assert np.array_equal(flown, predicted.last[0])


def test_one_machine_code_flies_and_predicts():
    """A prediction runs what the vehicle's step runs: it compiles no second kernel of other types."""
    Helicopter(HelicopterParameters()).step(0.0, 0.05)
    flown = list(kernels.roll_thrust.signatures)
    model = HelicopterModel(ModelParameters())
    state, command, _ = model.trim(30.0)
    for N in (8, 3):
        model.rollout(state, np.tile(command, (N, 5, 1)), np.zeros(3), np.zeros(3))
    assert kernels.roll_thrust.signatures == flown


def test_a_rollout_of_either_plant_ends_in_a_common_state():
    """Level flight ends as it began, with the rotor given by its thrust; another can go on there."""
    for rotor in ("thrust", "collective"):
        model = HelicopterModel(ModelParameters(rotor=rotor))
        start, command, _ = model.trim(30.0)
        still = np.zeros(3)
        last = model.rollout(start, np.tile(command, (2, 10, 1)), still, still).last[0]
        np.testing.assert_allclose(last[1:], start[1:], rtol=0, atol=1e-9)
        assert last[0] == pytest.approx(15.0, abs=1e-9)


def test_the_thrust_model_predicts_the_collective_plant():
    """Started from the common state, either model predicts the collective plant to 0.2 m in 2 s."""
    vehicle = Helicopter(HelicopterParameters(rotor="collective", height_agl_m=50.0))
    vehicle.initialize(start_time=0.0)
    models = [HelicopterModel(ModelParameters(rotor=rotor)) for rotor in ("thrust", "collective")]
    start, command = state_of(vehicle), models[0].trim(30.0)[1] + [0.05, 0.02, 0.02, 0.0]
    vehicle.set({f"command.{n}": v for n, v in zip(models[0].commands, command, strict=True)})
    for k in range(40):
        vehicle.step(k * 0.05, 0.05)
    for model in models:
        commands = np.tile(command, (1, 40, 1))
        predicted = model.rollout(start, commands, np.zeros(3), np.zeros(3)).outputs[0, -1]
        flown = state_of(vehicle)
        assert np.allclose(predicted[:3], [flown[0], flown[1], -flown[2]], atol=0.2)


def test_description_is_valid_and_complete():
    """The description passes FMPy's validation; every variable has a unit or a type, and a meaning."""
    md = Helicopter(HelicopterParameters()).describe()
    assert validate_model_description(md, True, True) == []
    for variable in md.modelVariables:
        assert variable.unit or variable.type != "Float64", variable.name
        assert variable.description, variable.name


def test_state_round_trip_is_bit_exact():
    """A saved flight goes on as if it had not been interrupted."""
    vehicle, other = (Helicopter(HelicopterParameters()) for _ in range(2))
    for one in (vehicle, other):
        one.initialize(start_time=0.0)
    vehicle.set({"command.pitch": 0.05, "wind.east": 3.0})
    vehicle.step(0.0, 0.05)
    other.set_state(vehicle.get_state())
    for one in (vehicle, other):
        for k in range(1, 30):
            one.step(k * 0.05, 0.05)
    assert np.array_equal(state_of(vehicle), state_of(other))


def test_slope_matched_start(hills):
    """A slope-matched start moves along the ground: clearance has no rate at first."""
    vehicle = Helicopter(HelicopterParameters(heading_deg=40.0), terrain=hills)
    vehicle.initialize(start_time=0.0)
    assert vehicle.get(["clearance"])["clearance"] == pytest.approx(10.0, abs=1e-9)
    v = vehicle.get(["velocity.north", "velocity.east", "velocity.down"])
    h_n, h_e = hills.slope(0.0, 0.0)
    rate = -v["velocity.down"] - h_n * v["velocity.north"] - h_e * v["velocity.east"]
    assert abs(rate) < 1e-9
    assert np.hypot(
        np.hypot(v["velocity.north"], v["velocity.east"]), v["velocity.down"]
    ) == pytest.approx(30.0)


def test_perturbed_start():
    """A perturbation moves the start by what it says."""
    delta = Perturbation(
        north_m=1.0, east_m=-2.0, up_m=3.0, roll_deg=5.0, heading_deg=10.0, right_mps=2.0
    )
    plain = Helicopter(HelicopterParameters(height_agl_m=50.0))
    moved = Helicopter(HelicopterParameters(height_agl_m=50.0, perturbation=delta))
    difference = state_of(moved) - state_of(plain)
    assert np.allclose(difference[:3], [1.0, -2.0, -3.0])
    assert np.allclose(np.degrees(difference[[6, 8]]), [5.0, 10.0])
    v = moved.get(["velocity.north", "velocity.east"])
    assert np.allclose([*v.values()], [30.0, 2.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"height_agl_m": -1.0}, "start below ground, got height -1 m"),
        ({"north_m": 1e7}, "1e\\+07|outside"),
    ],
)
def test_impossible_starts_are_refused(change, message, hills):
    """A start below ground or outside the terrain is a ValueError that says so."""
    with pytest.raises(ValueError, match=message):
        Helicopter(HelicopterParameters(**change), terrain=hills)


@pytest.mark.parametrize(
    ("command", "outcome"),
    [
        ({"command.thrust": 0.0}, "collision"),
        ({"command.pitch": -1.5, "command.roll": 3.0}, "departed"),
    ],
)
def test_a_flight_ends(command, outcome):
    """Without thrust it hits the ground; with absurd set-points it departs; then it stays put."""
    flat = Terrain(TerrainParameters(shape="flat"))
    height = 10.0 if outcome == "collision" else 500.0
    vehicle = Helicopter(HelicopterParameters(height_agl_m=height), terrain=flat)
    vehicle.initialize(start_time=0.0)
    vehicle.set(command)
    for k in range(200):
        vehicle.step(k * 0.05, 0.05)
    assert OUTCOMES[vehicle.get(["outcome"])["outcome"]] == outcome
    before = state_of(vehicle)
    vehicle.step(10.0, 0.05)
    assert np.array_equal(before, state_of(vehicle), equal_nan=True)


def test_unknown_names_are_refused():
    """An unknown variable is a KeyError with the nearest name."""
    vehicle = Helicopter(HelicopterParameters())
    with pytest.raises(KeyError, match="did you mean 'command.pitch'"):
        vehicle.set({"command.pich": 0.0})
    with pytest.raises(KeyError, match="did you mean 'state.theta'"):
        vehicle.get(["state.teta"])
