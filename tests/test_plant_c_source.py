"""The vehicle as C: the native one to rounding, in FMI 2 and 3, with states to set and Jacobians."""

import ctypes
import subprocess
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

import plant.source
from orchestrator.assembly.description import ports
from orchestrator.assembly.plans import Plan
from orchestrator.export.export import Chosen, export
from orchestrator.fmu.component import FmuComponent, FmuParameters
from plant.helicopter import (
    Helicopter,
    HelicopterModel,
    HelicopterParameters,
    ModelParameters,
    Perturbation,
)
from plant.helicopter_variables import OUTCOMES, OUTPUTS
from plant.rotorcraft import COMMANDS, STATES
from plant.source.sources import terrain_bytes
from plant.terrain import Terrain, TerrainParameters, height_and_slope

STATE = [f"state.{name}" for name in STATES]
MEASURED = [f"measured.{name}" for name in STATES]
AIR = [f"{group}.{axis}" for group in ("wind", "bias") for axis in ("north", "east", "down")]
PARAMETERS = {
    "thrust": HelicopterParameters(heading_deg=40.0, height_agl_m=30.0),
    "collective": HelicopterParameters(
        preset="r50_bare", command="actuator", rotor="collective", height_agl_m=60.0
    ),
}
CASES = [("thrust", 3), ("collective", 2)]


@pytest.fixture(scope="module")
def hills():
    return Terrain(TerrainParameters(shape="fractal", seed=4))


@pytest.fixture(scope="module")
def built(hills, tmp_path_factory):
    """Build an FMU of each case: thrust over hills in FMI 3, collective over none in FMI 2."""
    folder = tmp_path_factory.mktemp("vehicle")
    for name, fmi in CASES:
        made = Helicopter(PARAMETERS[name], terrain=over(name, hills))
        plan = Plan(("components", "vehicle"), lambda made=made: made, {}, {})
        export(Chosen(plan, [], 0, "test"), folder / f"{name}.fmu", fmi=fmi, language="c")
    return folder


@pytest.fixture
def flown(built):
    """Return an initialized component of a case's FMU; terminated after the test."""
    made = []

    def make(name, inputs=(), **start):
        start = {key.replace("__", "."): value for key, value in start.items()}
        fmu = FmuComponent(FmuParameters(file=built / f"{name}.fmu", start=start))
        made.append(fmu)
        fmu.set(dict(inputs))
        fmu.initialize(start_time=0.0, stop_time=None, seed=0)
        return fmu

    yield make
    for fmu in made:
        fmu.terminate()


def over(name, hills):
    return hills if name == "thrust" else None


def native(name, hills, parameters=None):
    vehicle = Helicopter(parameters or PARAMETERS[name], terrain=over(name, hills))
    vehicle.initialize(start_time=0.0)
    return vehicle


def commands(name):
    return [f"command.{one}" for one in COMMANDS[PARAMETERS[name].command]]


def values(component, names):
    return np.array(list(component.get(names).values()), dtype=float)


def fly(pair, name, steps, seed=1):
    """Fly both under a command that steps after a second, in wind; return the worst difference."""
    names = [*commands(name), *AIR[:3]]
    trim = [v.start for v in pair[0].describe().modelVariables if v.name in names[:4]]
    moved = 0.02 * np.random.default_rng(seed).standard_normal(4)
    worst = 0.0
    for k in range(steps):
        now = np.array(trim, float) + (moved if k >= 20 else 0.0)
        for one in pair:
            one.set(dict(zip(names, [*now.tolist(), 3.0, -4.0, 0.5], strict=True)))
            assert one.step(k * 0.05, 0.05) == 0
        both = [values(one, OUTPUTS) for one in pair]
        worst = max(worst, np.max(np.abs(both[0] - both[1])))
    return worst


def test_terrain_in_c_is_the_kernel(hills, tmp_path):
    """The C spline equals the numba kernel to 1e-12 at posts, edges, holes and anywhere, slopes too."""
    posts = TerrainParameters(shape="fractal", seed=4, extent_m=200.0)
    grid = Terrain(posts).grid
    grid.coefficients[8, 9] = np.nan
    (tmp_path / "terrain.bin").write_bytes(terrain_bytes(grid))
    (tmp_path / "at.c").write_text(
        f'#include "{Path(plant.source.__file__).parent / "terrain.h"}"\n'
        "int open_it(Terrain *g, const char *path) { return terrain_read(g, path) != NULL; }\n"
        "double at(Terrain *g, double n, double e, double *s)"
        " { return terrain_height(g, n, e, s); }\n"
    )
    command = ["cc", "-O2", "-fPIC", "-shared", "at.c", "-o", "at.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "at.so"))
    library.at.restype = ctypes.c_double
    spline = (ctypes.c_double * 7)()
    assert library.open_it(spline, str(tmp_path / "terrain.bin").encode()) == 0
    rng = np.random.default_rng(0)
    points = [*rng.uniform(-105, 105, (400, 2)), (100.0, 100.0), (-100.0, 0.0), (100.0 + 2e-9, 0.0)]
    slope = (ctypes.c_double * 2)()
    missing = 0
    for north, east in points:
        h = library.at(spline, ctypes.c_double(north), ctypes.c_double(east), slope)
        expected = height_and_slope(grid, float(north), float(east))
        missing += np.isnan(h)
        assert np.allclose([h, *slope], expected, rtol=1e-12, atol=1e-12, equal_nan=True)
    assert 0 < missing < 200


@pytest.mark.parametrize("cut", [b"", b"\0" * 48, None])
def test_a_broken_terrain_file_is_refused(cut, built, tmp_path):
    """Where terrain.bin is empty, of zeros or cut short, the FMU cannot be instantiated."""
    folder = Path(fmpy.extract(built / "thrust.fmu", tmp_path))
    file = folder / "resources" / "terrain.bin"
    file.write_bytes(file.read_bytes()[:-8] if cut is None else cut)
    with pytest.raises(ValueError, match="instantiate"):
        FmuComponent(FmuParameters(file=folder))


@pytest.mark.parametrize(("name", "fmi"), CASES)
def test_it_is_valid_and_has_the_native_variables(name, fmi, built, hills):
    """The FMU is valid; every native variable is in it: type, unit, limits, start, role, meaning."""
    assert validate_fmu(str(built / f"{name}.fmu")) == []
    fmu = FmuComponent(FmuParameters(file=built / f"{name}.fmu"))
    try:
        mine = ports("vehicle", fmu.describe())
    finally:
        fmu.terminate()
    for one in ports("vehicle", native(name, hills).describe()).values():
        if one.causality == "independent":
            continue
        twin = mine[one.name]
        if one.name in commands(name):  # the native description has those of 30 m/s to the north
            twin = replace(twin, start=one.start)
        assert vars(replace(twin, type=one.type)) == vars(one)
        assert twin.kind == one.kind


@pytest.mark.parametrize(("name", "fmi"), CASES)
def test_it_flies_as_the_native_one(name, fmi, flown, hills):
    """Ten seconds in wind, with a step of the command: no output differs by more than 1e-9."""
    pair = (flown(name), native(name, hills))
    start = [values(one, [*STATE, "clearance"]) for one in pair]
    assert np.max(np.abs(start[0] - start[1])) < 1e-12
    assert fly(pair, name, 200) < 1e-9


def test_parameters_start_it_elsewhere(flown, hills):
    """Numbers are parameters: mass, speed, place and perturbation act as in the native one."""
    given = {
        "mass_kg": 75.0, "speed_mps": 12.0, "stabiliser_speed_mps": 20.0, "substeps": 3,
        "torque_feedforward": True, "north_m": 300.0, "east_m": -200.0, "heading_deg": -100.0,
        "height_agl_m": 45.0, "slope_matched": False,
    }  # fmt: skip
    moved = {"up_m": 5.0, "forward_mps": 1.0, "right_mps": -2.0, "up_mps": 0.5, "roll_deg": 4.0,
             "pitch_deg": -3.0, "heading_deg": 7.0, "north_m": 10.0, "east_m": 20.0}  # fmt: skip
    perturbed = HelicopterParameters(**given, perturbation=Perturbation(**moved))
    fmu = flown("thrust", **given, **{f"perturbation__{key}": v for key, v in moved.items()})
    assert fly((fmu, native("thrust", hills, perturbed)), "thrust", 40) < 1e-9


@pytest.mark.parametrize("speed", [0.0, 5.0, 20.0, 35.0])
@pytest.mark.parametrize(("name", "fmi"), CASES)
def test_it_trims_at_any_speed(name, fmi, speed, flown):
    """At any speed the trim found in C is the one that scipy finds, to 1e-12."""
    fmu = flown(name, speed_mps=speed, slope_matched=False, heading_deg=0.0)
    shape = {key: getattr(PARAMETERS[name], key) for key in ("preset", "command", "rotor")}
    state, _, _ = HelicopterModel(ModelParameters(**shape)).trim(speed)
    ours = [i for i in range(3, 17) if STATES[i] != "thrust"]  # of blades it is a reading
    assert np.allclose(values(fmu, STATE)[ours], state[ours], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("start", "what"),
    [
        ({"height_agl_m": -1.0}, "start below ground, got height -1 m"),
        ({"north_m": 1e7}, "point outside or without data, got north 1e\\+07 m"),
        ({"preset": "r50_bare"}, "preset: built into this FMU, got 'r50_bare', expected 'r50'"),
        ({"speed_mps": 300.0}, "no level flight found, got speed 300 m/s"),
        ({"substeps": 0}, "substeps: got 0, expected 1 or more"),
    ],
)
def test_an_impossible_start_is_refused(start, what, flown, caplog):
    """What cannot start is an error in initialization, and the log says why."""
    with pytest.raises(ValueError, match=r"[Ii]nitializ"):
        flown("thrust", **start)
    assert any(np.char.find(line, what.replace("\\", "")) >= 0 for line in caplog.messages)


@pytest.mark.parametrize(("name", "fmi"), CASES)
def test_a_step_starts_from_any_state(name, fmi, flown, hills):
    """With restart, a step starts from ``measured``, in wind and with a bias, as the model predicts."""
    fmu = flown(name)
    rng = np.random.default_rng(3)
    keys = ("preset", "command", "rotor")
    shape = {key: getattr(PARAMETERS[name], key) for key in keys}
    model = HelicopterModel(ModelParameters(**shape), terrain=over(name, hills))
    state, command, _ = model.trim(22.0)
    for k in range(3):
        state = state + 0.02 * rng.standard_normal(17)
        state[2] = -200.0
        air = rng.standard_normal(6)
        predicted = model.rollout(state, np.tile(command, (1, 2, 1)), air[:3], air[3:])
        fmu.set({"restart": True})
        fmu.set(
            dict(zip([*MEASURED, *commands(name), *AIR], [*state, *command, *air], strict=True))
        )
        assert fmu.step(0.1 * k, 0.05) == 0
        fmu.set({"restart": False})
        assert fmu.step(0.1 * k + 0.05, 0.05) == 0
        last = predicted.last[0]
        compared = [i for i in range(17) if STATES[i] != "thrust" or name == "thrust"]
        assert np.max(np.abs(values(fmu, STATE) - last)[compared]) < 1e-11


def test_a_flight_may_begin_at_a_measured_state(flown, hills):
    """With restart set before initialization the flight begins at ``measured``."""
    state = dict(zip(MEASURED, [*HelicopterModel(ModelParameters()).trim(10.0)[0]], strict=True))
    state["measured.down"] = -300.0
    fmu = flown("thrust", {**state, "restart": True})
    assert values(fmu, STATE).tolist() == list(state.values())


def test_a_finished_flight_stays_put_until_restart(flown):
    """After the end nothing moves; a restart begins a new flight."""
    fmu = flown("thrust", {"command.thrust": 0.0})
    before = values(fmu, MEASURED)
    for k in range(200):
        fmu.step(k * 0.05, 0.05)
    assert OUTCOMES[fmu.get(["outcome"])["outcome"]] == "collision"
    rest = values(fmu, OUTPUTS)
    fmu.step(10.0, 0.05)
    assert np.array_equal(values(fmu, OUTPUTS), rest)
    fmu.set({"restart": True, **dict(zip(MEASURED, before, strict=True))})
    fmu.step(10.05, 0.05)
    assert OUTCOMES[fmu.get(["outcome"])["outcome"]] == "flying"
    fmu.set({"measured.north": 3.99e3, "measured.u": 300.0, "measured.down": -900.0})
    fmu.step(10.1, 0.05)
    assert OUTCOMES[fmu.get(["outcome"])["outcome"]] == "left_terrain"
    fmu.set({"measured.phi": 2.0})
    fmu.step(10.15, 0.05)
    assert fmu.get(["outcome", "valid"]) == {"outcome": OUTCOMES.index("departed"), "valid": False}


@pytest.mark.parametrize(("name", "fmi"), CASES)
def test_state_of_one_instance_goes_on_in_another(name, fmi, flown):
    """A saved flight goes on in another instance to the last bit; instances share nothing."""
    one, other = flown(name), flown(name)
    inputs = dict(zip(AIR, [1.0, 2.0, -0.5, 0.1, 0.2, -0.3], strict=True))
    one.set(inputs)
    untouched = values(other, OUTPUTS)
    for k in range(5):
        one.step(k * 0.05, 0.05)
    assert np.array_equal(values(other, OUTPUTS), untouched)
    other.set_state(one.get_state())
    for k in range(5, 30):
        for vehicle in (one, other):
            vehicle.step(k * 0.05, 0.05)
    assert np.array_equal(values(one, OUTPUTS), values(other, OUTPUTS))


def test_a_step_of_another_size_is_refused(flown):
    """Only steps of 50 ms are taken, like the native vehicle's."""
    assert flown("thrust").step(0.0, 0.1) >= 3


class Instance:
    """An FMU through FMPy's own classes, with values by name."""

    def __init__(self, file, folder):
        description = fmpy.read_model_description(file)
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        folder = fmpy.extract(file, folder)
        self.is_old = description.fmiVersion == "2.0"
        make = FMU2Slave if self.is_old else FMU3Slave
        self.fmu = make(
            guid=description.guid, unzipDirectory=folder, instanceName="vehicle",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        self.fmu.instantiate()
        if self.is_old:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()

    def of(self, names):
        """Return value references."""
        return [self.references[name] for name in names]

    def set(self, names, numbers):
        """Set floats."""
        setter = self.fmu.setReal if self.is_old else self.fmu.setFloat64
        setter(self.of(names), list(numbers))

    def get(self, names):
        """Return floats."""
        getter = self.fmu.getReal if self.is_old else self.fmu.getFloat64
        return np.array(getter(self.of(names)))

    def derivative(self, unknown, known, seed):
        """Return the directional derivative."""
        call = self.fmu.getDirectionalDerivative
        return np.array(call(self.of(unknown), self.of(known), list(seed)))


@pytest.mark.parametrize(("name", "fmi"), CASES)
def test_directional_derivatives_are_those_of_the_step(name, fmi, built, tmp_path):
    """They are what central differences over a step approach: outputs by inputs and measured state."""
    vehicle = Instance(built / f"{name}.fmu", tmp_path)
    known = [*MEASURED, *commands(name), *AIR]
    unknown = [one for one in OUTPUTS if one not in ("outcome", "valid")]
    flag = vehicle.of(["restart"])
    vehicle.fmu.setBoolean(flag, [True])
    rng = np.random.default_rng(5)
    start = vehicle.get(known)
    time = 0.0

    def outputs(at):
        nonlocal time
        vehicle.set(known, at)
        vehicle.fmu.doStep(time, 0.05)
        time += 0.05
        return vehicle.get(unknown)

    for _ in range(5):
        at = start + 0.01 * rng.standard_normal(len(start))
        seed = rng.standard_normal(len(start))
        differences = (outputs(at + 1e-6 * seed) - outputs(at - 1e-6 * seed)) / 2e-6
        outputs(at)
        exact = vehicle.derivative(unknown, known, seed)
        assert np.max(np.abs(exact - differences) / (1.0 + np.abs(exact))) < 1e-6
    vehicle.fmu.terminate()
    vehicle.fmu.freeInstance()


def test_after_initialization_the_last_step_is_the_empty_one(built, tmp_path):
    """Before the first step the state moves with ``measured`` and only with it."""
    vehicle = Instance(built / "thrust.fmu", tmp_path)
    seed = np.arange(1.0, 18.0)
    assert vehicle.derivative(STATE, MEASURED, seed).tolist() == seed.tolist()
    assert not np.any(vehicle.derivative(STATE, AIR, np.ones(6)))
    assert vehicle.derivative(["clearance"], ["measured.down"], [1.0]).tolist() == [-1.0]
    vehicle.fmu.terminate()
    vehicle.fmu.freeInstance()
