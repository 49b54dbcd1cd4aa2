"""An FMU as the prediction model: the native model's twin, black boxes, shadows; and in flight."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import yaml
from hand_flight import HandFlight, flat
from linear_model import LinearModel

from controller.optimise import ACTUATORS, TRACKED
from controller.parameters import MpcParameters, design
from controller.prediction import identify
from orchestrator.errors import ScenarioError
from orchestrator.export.export import choose, export
from orchestrator.flight import fly
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.prediction import FmuModel, FmuModelParameters
from orchestrator.fmu.roles import Source
from plant.helicopter import HelicopterModel, ModelParameters
from plant.terrain import Terrain, TerrainParameters

USE = "orchestrator.fmu.prediction:FmuModel"
H = 120
CALM = np.zeros(3)
WIND, BIAS = np.array([2.0, -3.0, 0.5]), np.array([0.1, 0.2, -0.3])
DRONE = {
    **{f"command.{n}": v for n, v in zip(("thrust", "pitch", "roll", "heading"),
                                         ("lift", "nose", "bank", "course"), strict=True)},
    "state.down": {"variable": "height", "factor": -1.0},
    **{f"velocity.{axis}": f"v_{axis[0]}" for axis in ("north", "east", "down")},
    **{f"actuator.{n}": f"servo_{n}" for n in ("thrust", "pitch", "roll", "tail")},
}  # fmt: skip
RIGID = ("north", "east", "down", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")


@pytest.fixture(scope="module")
def vehicle(scenarios, tmp_path_factory):
    """Return the vehicle of jacksboro.yaml as C, FMI 3: over its terrain."""
    file = tmp_path_factory.mktemp("prediction") / "vehicle.fmu"
    export(choose("vehicle", scenarios / "jacksboro.yaml"), file, fmi=3, language="c")
    return file


@pytest.fixture(scope="module")
def helicopter(tmp_path_factory):
    """Return the helicopter over no terrain as C, FMI 2."""
    file = tmp_path_factory.mktemp("prediction") / "helicopter.fmu"
    export(choose("plant.helicopter:Helicopter"), file, fmi=2, language="c")
    return file


@pytest.fixture(scope="module")
def scenarios():
    return Path(__file__).parents[1] / "scenarios"


@pytest.fixture(scope="module")
def model(helicopter):
    return FmuModel(FmuModelParameters(file=helicopter))


@pytest.fixture(scope="module")
def native():
    return HelicopterModel(ModelParameters())


def disturbed(native, N, seed=0, size=0.02):
    """Return level flight 300 m up, and N commands that wave about its own."""
    state, command, _ = native.trim(30.0)
    state[:3] = 5.0, -7.0, -300.0
    waves = np.cumsum(np.random.default_rng(seed).standard_normal((N, H, 4)), axis=1)
    return state, command + size / np.sqrt(H) * waves


def farthest(a, b):
    return max(np.abs(a.outputs - b.outputs).max(), np.abs(a.last - b.last).max())


def written(folder, scenarios, **keys):
    """Return the file of jacksboro.yaml with changes."""
    file = folder / "flight.yaml"
    keys = {"extends": str(scenarios / "jacksboro.yaml"), "recording": {"wall_clock": False}} | keys
    file.write_text(yaml.safe_dump(keys))
    return file


def predicted_by(**parameters):
    """Return the scenario's resources with an FMU as the model."""
    gone = {"preset": None, "command": None}
    return {"model": {"use": USE, "parameters": gone | parameters}}


# -- the C vehicle, beside the native model ------------------------------------------------------


def test_it_presents_itself_as_the_native_model(model, native):
    """Names, limits and sample period of our own vehicle follow from the file alone."""
    for name in ("states", "commands", "outputs", "sample_period"):
        assert getattr(model, name) == getattr(native, name)
    for name in ("command_min", "command_max", "actuator_min", "actuator_max"):
        np.testing.assert_array_equal(getattr(model, name), getattr(native, name))


@pytest.mark.parametrize("speed", [0.0, 7.0, 15.0, 30.0, 35.0])
def test_level_flight_is_found_by_stepping(speed, model, native):
    """State, commands and actuators are those of the native trim to 1e-11."""
    for mine, exact in zip(model.trim(speed), native.trim(speed), strict=True):
        np.testing.assert_allclose(mine, exact, rtol=0, atol=1e-11)


def test_rollouts_are_the_native_ones(model, native):
    """In wind and under a bias all outputs agree to 1e-9, whatever was flown before."""
    state, commands = disturbed(native, 5)
    expected = native.rollout(state, commands, WIND, BIAS)
    for _ in range(2):
        found = model.rollout(state, commands, WIND, BIAS)
        assert farthest(found, expected) < 1e-9
        assert found.valid.all()
        assert found.outputs.transpose(2, 1, 0).flags.c_contiguous
        model.rollout(state + 0.01, commands[:2, :50], CALM, CALM)
    each = model.rollout(np.stack([state, state + 0.01]), commands[:2], WIND, BIAS)
    assert farthest(each, native.rollout(state + 0.01 * np.array([[0], [1]]), commands[:2], WIND,
                                         BIAS)) < 1e-9  # fmt: skip


def test_over_terrain_too_below_the_ground_and_beyond_the_edge(vehicle, scenarios):
    """A prediction goes on below the ground, and is invalid beyond the terrain or upside down."""
    model = FmuModel(FmuModelParameters(file=vehicle))
    terrain = Terrain(TerrainParameters(file=scenarios / "terrain" / "jacksboro.npz"))
    native = HelicopterModel(ModelParameters(), terrain=terrain)
    state, commands = disturbed(native, 3)
    state[2] = -float(terrain.elevation(5.0, -7.0)) - 5.0
    commands[0] = (0.4, *native.trim(30.0)[1][1:])
    expected, found = (m.rollout(state, commands, WIND, CALM) for m in (native, model))
    north, east, altitude = expected.outputs[0, -1, :3]
    assert altitude < terrain.elevation(north, east)
    assert expected.valid.all()
    assert found.valid.all()
    assert farthest(found, expected) < 1e-8
    beyond, rolling = state.copy(), state.copy()
    beyond[0] = 1e5
    rolling[6], rolling[9] = 1.38, 3.0
    for start in (beyond, rolling):
        for one in (native, model):
            assert not one.rollout(start, commands, CALM, CALM).valid.any()


def test_trajectories_that_begin_alike_are_flown_once(model, native):
    """Tents share their beginning with the nominal: the same bits as each flown alone."""
    state, commands = disturbed(native, 1)
    commands = np.repeat(commands, 6, axis=0)
    for n, begin in enumerate([0, 30, 8, 30, 3, H - 1]):
        commands[n, begin:, 0] += 0.01 * n
    together = model.rollout(state, commands, WIND, BIAS)
    for n in range(6):
        alone = model.rollout(state, commands[n : n + 1], WIND, BIAS)
        np.testing.assert_array_equal(together.outputs[n], alone.outputs[0])
        np.testing.assert_array_equal(together.last[n], alone.last[0])


def test_processes_change_no_bit(helicopter, model, native):
    """Two processes share the trajectories, and answer as one."""
    state, commands = disturbed(native, 7)
    shared = FmuModel(FmuModelParameters(file=helicopter, processes=2))
    a, b = (m.rollout(state, commands, WIND, BIAS) for m in (model, shared))
    np.testing.assert_array_equal(a.outputs, b.outputs)
    np.testing.assert_array_equal(a.last, b.last)


@pytest.mark.parametrize("family", ["laguerre", "tent"])
def test_directional_derivatives_give_the_response(family, helicopter, native):
    """S is what central differences of rollouts approach, to 1e-6 of each output's size."""
    exact = FmuModel(FmuModelParameters(file=helicopter, derivatives=True))
    Phi = design(MpcParameters(basis=family), native, H).Phi
    state, commands = disturbed(native, 1)
    found = identify(exact, state, commands[0], Phi, np.ones(4), WIND, BIAS)
    assert found.valid
    np.testing.assert_array_equal(
        found.nominal, exact.rollout(state, commands, WIND, BIAS).outputs[0].T
    )
    delta = 1e-5 * Phi.transpose(2, 1, 0)
    up, down = (exact.rollout(state, commands + sign * delta, WIND, BIAS) for sign in (1, -1))
    S = ((up.outputs - down.outputs) / 2e-5).transpose(2, 1, 0)
    for row, name in enumerate(exact.outputs):
        size = np.abs(S[row]).max()
        assert np.abs(found.S[row] - S[row]).max() < 1e-6 * size + 1e-9, name
    rows = np.array([exact.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])
    some = identify(exact, state, commands[0], Phi, np.ones(4), WIND, BIAS, rows)
    np.testing.assert_array_equal(some.S, found.S[rows])


# -- in flight -----------------------------------------------------------------------------------


DECISIONS = ("step_length", "ladder", "solver_status", "iterations", "horizon")


def test_as_plant_and_as_model_it_flies_the_native_flight(vehicle, scenarios, tmp_path):
    """Jacksboro, 10 s: all states within 1e-6 of the native flight, and the same decisions.

    The native model predicts over the terrain here, as the FMU does.
    """
    ground = {"model": {"parameters": {"terrain": "${terrain}"}}}
    mine = {"vehicle": {"use": str(vehicle)}}
    resources = predicted_by(file=str(vehicle))
    native = fly(written(tmp_path, scenarios, duration_s=10, resources=ground)).trace
    twin = fly(
        written(tmp_path, scenarios, duration_s=10, resources=resources, components=mine)
    ).trace
    for name in DECISIONS:
        np.testing.assert_array_equal(twin[f"mpc.{name}"][1], native[f"mpc.{name}"][1], name)
    flown = [n for n in native.names if n.startswith(("vehicle.state", "vehicle.actuator"))]
    assert len(flown) == 21
    far = {n: np.abs(twin[n][1] - native[n][1]).max() for n in flown}
    assert max(far.values()) < 1e-6, far


def test_by_derivatives_it_flies_as_well(helicopter, scenarios, tmp_path):
    """Jacksboro, 5 s, identified by derivatives: within 1 cm of the native flight."""
    resources = predicted_by(file=str(helicopter), derivatives=True)
    native = fly(written(tmp_path, scenarios, duration_s=5)).trace
    twin = fly(written(tmp_path, scenarios, duration_s=5, resources=resources)).trace
    for name in ("north", "east", "down"):
        a, b = (trace[f"vehicle.state.{name}"][1] for trace in (native, twin))
        assert 0.0 < np.abs(a - b).max() < 0.01


@pytest.mark.parametrize("latency", [0, 0.5])
def test_a_shadow_of_the_vehicle_itself_flies_the_same(latency, vehicle, scenarios, tmp_path):
    """Driven by the applied commands alone it is where the vehicle is: the same flight to 1e-6."""
    ground = {"model": {"parameters": {"terrain": "${terrain}"}}}
    resources = predicted_by(file=str(vehicle), settable="")
    keys = {"duration_s": 5, "components": {"mpc": {"latency_s": latency}}}
    native = fly(written(tmp_path, scenarios, resources=ground, **keys)).trace
    twin = fly(written(tmp_path, scenarios, resources=resources, **keys)).trace
    for name in ("north", "east", "down", "theta"):
        a, b = (trace[f"vehicle.state.{name}"][1] for trace in (native, twin))
        assert np.abs(a - b).max() < 1e-6, name


@pytest.mark.parametrize("latency", [0, 0.5])
def test_a_shadow_flies_too(latency, helicopter, scenarios, tmp_path):
    """Begun elsewhere than the vehicle, and without ground effect, it flies, if not as closely."""
    start = {"height_agl_m": 3000.0, "heading_deg": 8.53}
    resources = predicted_by(file=str(helicopter), settable="", start=start)
    components = {"mpc": {"latency_s": latency}}
    flight = fly(
        written(tmp_path, scenarios, duration_s=10, resources=resources, components=components)
    )
    assert flight.result.outcome == "flown"
    assert flight.metrics["height_rms_m"] < 2.0
    assert flight.metrics["cross_track_rms_m"] < 5.0


def test_a_model_in_another_process_is_the_same(helicopter, scenarios, tmp_path):
    """The parameters can be pickled: an isolated controller makes the model anew, and flies alike."""
    resources = predicted_by(file=str(helicopter))
    parameters = FmuModelParameters(file=helicopter)
    assert pickle.loads(pickle.dumps(parameters)) == parameters
    traces = [
        fly(written(tmp_path, scenarios, duration_s=1, resources=resources,
                    components={"mpc": {"isolation": isolation}})).trace
        for isolation in ("none", "process")
    ]  # fmt: skip
    for name in ("mpc.plan.thrust", "vehicle.state.down"):
        np.testing.assert_array_equal(traces[0][name][1], traces[1][name][1])


# -- a shadow ------------------------------------------------------------------------------------


class Followed(HelicopterModel):
    """The native model, which notes what it is told to follow."""

    def follow(self, before, commands, wind, bias):
        """Count the samples flown."""
        self.flown = [] if before is None else self.flown
        assert len(self.flown) == int(before or b"0")
        self.flown += commands.tolist()
        return str(len(self.flown)).encode()


@pytest.mark.parametrize("compensated", [True, False])
@pytest.mark.parametrize("latency", [0.0, 0.3, 0.6])
def test_a_model_is_told_every_command_flown_once(latency, compensated):
    """Whatever the latency, the commands told are those of the sequencer, in order, without a gap."""
    model = Followed(ModelParameters())
    mpc = {"compensate_latency": compensated}
    flight = HandFlight(mpc, ground=flat, latency_s=latency, model=model)
    flown = []
    for _ in range(5):
        flight.measure()
        flight.update()
        assert model.flown == flown
        for _ in range(10):
            flight.play(1)
            flown.append(list(flight.sequencer.get(flight.commands).values()))


def test_a_shadow_in_step_predicts_as_the_flight_goes(helicopter, native):
    """It has flown the same: rollouts from now, and on from a predicted state, are the native ones."""
    start = {"height_agl_m": 300.0}
    shadow = FmuModel(FmuModelParameters(file=helicopter, settable="", start=start))
    state, commands = disturbed(native, 1)
    state[:3] = 0.0, 0.0, -300.0
    saved = None
    for k in range(3):
        part = commands[:, 30 * k : 30 * k + 30]
        saved = shadow.shadow(saved, part[0], CALM, CALM)
        state = native.rollout(state, part, CALM, CALM).last[0]
        expected = native.rollout(state, commands, CALM, CALM)
        first = shadow.rollout(state, commands[:, :10], CALM, CALM)
        rest = shadow.rollout(first.last[0], commands[:, 10:], CALM, CALM)
        outputs = np.concatenate([first.outputs, rest.outputs], axis=1)
        assert np.abs(outputs - expected.outputs).max() < 1e-9


def test_a_shadow_is_moved_to_where_the_aircraft_is(helicopter, native):
    """Off by a place, a heading and a velocity, constantly: its path begins and turns with those."""
    shadow = FmuModel(FmuModelParameters(file=helicopter, settable="", start={"height_agl_m": 300}))
    _, command, _ = native.trim(30.0)
    commands = np.tile(command, (1, H, 1))
    state = shadow.trim(30.0)[0]
    state[:3], state[8] = (100.0, 200.0, -50.0), np.pi / 2
    found = shadow.rollout(state, commands, CALM, CALM).outputs[0]
    time = 0.05 * np.arange(1, H + 1)
    np.testing.assert_allclose(found[:, 0], 100.0, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], 200.0 + 30.0 * time, atol=1e-9)
    np.testing.assert_allclose(found[:, 2], 50.0, atol=1e-9)
    np.testing.assert_allclose(found[:, 7:10], [[0.0, 30.0, 0.0]] * H, atol=1e-12)


# -- black boxes ---------------------------------------------------------------------------------


def drone(fmu, fmi, **defines):
    """Return the linear helicopter of foreign names, whose states are start values."""
    names = {k: Source(**v) if isinstance(v, dict) else v for k, v in DRONE.items()}
    names |= {k.replace("state", "settable"): v for k, v in names.items() if "state" in k}
    names |= {f"{group}.{n}": n for group in ("state", "settable") for n in RIGID if n != "down"}
    return FmuModel(FmuModelParameters(file=fmu("drone", fmi=fmi, **defines), names=names))


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_foreign_fmu_starts_from_start_values(fmi, fmu):
    """Names are mapped, altitude is turned over, and every rollout begins at the measured state."""
    model, exact = drone(fmu, fmi), LinearModel()
    assert model.states == RIGID
    assert model.commands == exact.commands
    rng = np.random.default_rng(2)
    commands = np.array([1.0, 0, 0, 0]) + 0.1 * rng.standard_normal((4, H, 4))
    rows = [i for i, name in enumerate(model.outputs) if name != "speed"]
    columns = [exact.outputs.index(model.outputs[i]) for i in rows]
    for _ in range(2):
        state = rng.standard_normal(12)
        found = model.rollout(state, commands, CALM, CALM)
        expected = exact.rollout(state[:9], commands, CALM, CALM)
        np.testing.assert_allclose(
            found.outputs[:, :, rows], expected.outputs[:, :, columns], atol=1e-11
        )
        np.testing.assert_allclose(found.last[:, :9], expected.last, atol=1e-11)


@pytest.mark.parametrize("fmi", [2, 3])
def test_without_an_input_for_it_the_bias_is_added_to_the_velocity(fmi, fmu):
    """Velocity gains b t and position b t^2 / 2."""
    model = drone(fmu, fmi)
    state, commands = np.zeros(12), np.tile([1.0, 0, 0, 0], (1, H, 1))
    found = model.rollout(state, commands, CALM, BIAS).outputs[0]
    time = 0.05 * np.arange(1, H + 1)[:, None]
    np.testing.assert_allclose(found[:, 7:10], BIAS * time, atol=1e-12)
    np.testing.assert_allclose(found[:, :3] * [1, 1, -1], BIAS * time**2 / 2, atol=1e-12)
    with pytest.raises(ValueError, match="wind: the FMU has no such input"):
        model.rollout(state, commands, WIND, BIAS)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_refused_step_makes_its_trajectory_invalid(fmi, fmu):
    """A Warning counts as flown, a refusal ends a trajectory, the others go on; Fatal is an error."""
    model = drone(fmu, fmi)
    commands = np.tile([1.0, 0, 0, 0], (4, 30, 1))
    commands[1, 15:, 0], commands[2, 20, 0] = 35.0, 45.0
    found = model.rollout(np.zeros(12), commands, CALM, CALM)
    assert found.valid.tolist() == [True, True, False, True]
    exact = LinearModel().rollout(np.zeros(9), commands, CALM, CALM)
    np.testing.assert_allclose(found.last[[0, 1, 3], :9], exact.last[[0, 1, 3]], atol=1e-11)
    assert np.isnan(found.outputs[2, 20:]).all()
    assert np.isfinite(found.outputs[2, :20]).all()
    commands[0, 10, 0] = 45.0
    assert model.rollout(np.zeros(12), commands, CALM, CALM).valid.tolist() == [
        False, True, False, True,
    ]  # fmt: skip
    commands[3, 5, 0] = 70.0
    for _ in range(2):
        with pytest.raises(FmuError, match="can be used no more"):
            model.rollout(np.zeros(12), commands, CALM, CALM)


@pytest.mark.parametrize(
    ("parameters", "where", "what"),
    [
        ({"file": "helicoptr.fmu"}, "file", "did you mean 'helicopter.fmu'"),
        ({"command": "comand"}, "command", "got 'comand.thrust', did you mean 'command.thrust'"),
        ({"settable": "mesured"}, "settable", "did you mean 'measured.north'"),
        ({"restart": "restrat"}, "restart", "got 'restrat', did you mean 'restart'"),
        ({"names": {"state.dwn": "x"}}, "names", "got 'state.dwn', did you mean 'state.down'"),
        ({"names": {"bias.down": "bias.dwn"}}, "names", "got 'bias.dwn', did you mean 'bias.down'"),
        ({"states": ["north", "down"]}, "states", "expected first north, east, down"),
        ({"commands": ["thrust"]}, "commands", "expected thrust, pitch, roll, tail or"),
        ({"start": {"mass": 70}}, "start", "did you mean 'mass_kg'"),
        ({"wind": "state"}, "wind", "'state.north' cannot be set between steps, got output"),
        ({"valid": "clearance"}, "valid", "got float, expected boolean"),
        ({"settable": "", "derivatives": True}, "derivatives", "expected 'derivatives: false'"),
    ],
)
def test_what_does_not_fit_is_one_line_at_its_key(
    parameters, where, what, helicopter, scenarios, tmp_path
):
    """Wrong and missing names are errors at load, with the nearest one."""
    given = {"file": str(helicopter), **parameters}
    (tmp_path / "helicopter.fmu").touch()
    file = written(tmp_path, scenarios, duration_s=1, resources=predicted_by(**given))
    with pytest.raises(ScenarioError) as error:
        fly(file)
    (problem,) = error.value.problems
    assert f"resources.model.parameters.{where}" in problem.message
    assert what in problem.message
    assert f"{file.name}:" in str(error.value)


def test_a_state_that_cannot_be_saved_is_refused(fmu):
    """Without saved states there is nothing to start a trajectory from."""
    with pytest.raises(ValueError, match=r"file: drone.fmu: its state cannot be saved"):
        drone(fmu, 3, SAVED=False)
