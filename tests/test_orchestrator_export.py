"""Exported FMUs say what their component says, and do what it does."""

import pickle
import zipfile

import fmpy
import numpy as np
import pytest
from exported import EVERYTHING, VERSIONS, Master, exported
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from small_exports import ANSWERS, WRONG, Everything, EverythingParameters

from orchestrator.command.app import status
from orchestrator.export.export import choose, export

U = np.arange(6.0).reshape(2, 3)


@pytest.fixture(scope="module", params=VERSIONS)
def master(request):
    """Return an instance of the small component; each test resets it."""
    made = Master(exported(EVERYTHING, request.param))
    made.initialize()
    yield made
    made.free()


def native(**values):
    """Return a native component, initialized with these values."""
    component = Everything(EverythingParameters())
    component.set(values)
    component.initialize(start_time=0.0, stop_time=None, seed=0)
    return component


@pytest.mark.parametrize("fmi", VERSIONS)
def test_an_exported_fmu_is_valid(fmi):
    """FMPy finds nothing wrong with names, structure, units, schema or archive."""
    assert validate_fmu(str(exported(EVERYTHING, fmi))) == []


@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_description_is_the_components(fmi):
    """Names, units, starts, limits, enumerations, texts and capabilities arrive in the XML."""
    described = fmpy.read_model_description(str(exported(EVERYTHING, fmi)))
    known = {v.name: v for v in described.modelVariables}
    assert described.description == "one of <each> & more"
    assert known["text"].description == 'what to do: "raise", ...'
    assert (known["total"].unit, known["total"].min, known["total"].max) == (
        "m",
        "-1000.0",
        "1000.0",
    )
    assert [item.name for item in known["mode"].declaredType.items] == ["off", "on", "stuck"]
    assert (known["bias"].variability, known["bias"].start) == ("tunable", "0.5")
    assert known["label"].start in ("said", ["said"])
    assert known["noise"].initial == "calculated"
    assert described.coSimulation.canHandleVariableCommunicationStepSize
    assert described.coSimulation.canGetAndSetFMUstate
    assert described.coSimulation.canSerializeFMUstate
    assert float(described.defaultExperiment.stepSize) == 0.1
    if fmi == 2:
        assert {"u[1,1]", "u[2,3]", "y[2,3]", "counts[2]", "corners_m[2,2]"} <= set(known)
    else:
        assert known["u"].shape == (2, 3)
        assert known["corners_m"].start == "0.0 1.0 2.0 3.5"


@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_structure_is_complete(fmi):
    """Every output is listed with its feed-through, and every calculated one as initial unknown."""
    described = fmpy.read_model_description(str(exported(EVERYTHING, fmi)))
    outputs = {u.variable.name: u.dependencies for u in described.outputs}
    assert set(outputs) == {v.name for v in described.modelVariables if v.causality == "output"}
    assert {u.variable.name for u in described.initialUnknowns} == set(outputs)
    inputs = [v for v in described.modelVariables if v.name.startswith("u")]
    assert all(d == inputs for name, d in outputs.items() if name.startswith("y"))
    assert all(d == [] for name, d in outputs.items() if not name.startswith("y"))


def test_every_type_passes_through(master):
    """Arrays, integers, flags, texts and enumerations arrive as the contract's Python types."""
    master.again(u=U, n=-3, flag=True, text="hé", mode=2)
    assert master.get("y") == (2.0 * U + 0.5).ravel().tolist()
    assert master.get("counts") == [-3, -6]
    assert (master.get("is_flag"), master.get("state.mode")) == (True, 2)
    echo = master.get("echo")
    assert (echo if isinstance(echo, str) else echo.decode()) == "said hé"


def test_steps_are_the_native_steps(master):
    """Under the same inputs every output is the native one, bit for bit."""
    component = native(u=U, v=0.25)
    master.again(u=U, v=0.25)
    for k in range(10):
        values = {"v": 0.1 * k, "bias": 0.01 * k, "n": k}
        component.set(values)
        master.set(values)
        component.step(k * 0.1, 0.1)
        master.step(k * 0.1, 0.1)
        for name in ("y", "total", "noise", "counts"):
            expected = component.get([name])[name]
            assert master.get(name) == np.ravel(expected).tolist() or master.get(name) == expected


def test_feedthrough_acts_without_a_step(master):
    """An output follows its inputs at once, as the model structure says."""
    master.again(u=U)
    master.set({"u": U + 1.0})
    assert master.get("y") == (2.0 * (U + 1.0) + 0.5).ravel().tolist()
    assert master.get("total") == 0.0


def test_outputs_hold_already_in_initialization_mode(master):
    """Outputs read in initialization mode are those of the inputs set so far, each time anew."""
    fmu = master.fmu
    fmu.reset()
    if master.fmi == 2:
        fmu.setupExperiment(startTime=2.0)
        fmu.enterInitializationMode()
    else:
        fmu.enterInitializationMode(startTime=2.0)
    master.set({"u": U})
    assert master.get("y") == (2.0 * U + 0.5).ravel().tolist()
    master.set({"u": -U})
    assert master.get("y") == (-2.0 * U + 0.5).ravel().tolist()
    assert master.get("corner") == 6.5 + 2.0  # the component knows when it starts
    fmu.exitInitializationMode()
    assert master.get("noise") == native().get(["noise"])["noise"]  # drawn once


def test_parameters_of_the_constructor_can_be_set(master):
    """Numbers, texts and arrays of the parameter dataclass, latency and seed reach the component."""
    corners = [[1.0, 1.0], [2.0, 2.0]]
    seed = "7" if master.fmi == 2 else 7
    master.again(gain=3.0, label="heard", corners_m=corners, latency_s=0.5, seed=seed, u=U)
    assert master.get("y") == (3.0 * U + 0.5).ravel().tolist()
    assert master.get("corner") == 6.5
    other = Everything(EverythingParameters())
    other.initialize(start_time=0.0, stop_time=None, seed=7)
    assert master.get("noise") == other.get(["noise"])["noise"]
    assert master.again().get("corner") == 6.5  # reset: the start values again
    assert master.get("noise") == native().get(["noise"])["noise"]


def test_a_structural_parameter_cannot_change(master):
    """A parameter that changes shapes is refused by name at initialization."""
    master.fmu.reset()
    master.messages.clear()
    with pytest.raises(FMICallException, match="status 3"):
        master.initialize(channels=4)
    assert "u: other shape with these parameters, got (2, 4)" in master.messages[-1][1]


def test_state_holds_everything(master):
    """A saved state repeats the future bit for bit, also the random one and the inputs."""
    master.again(u=U)
    master.step(0.0, 0.1)
    state = master.fmu.getFMUState()
    master.set({"u": -U, "v": 5.0})

    def future():
        seen = []
        for k in range(1, 4):
            master.step(0.1 * k, 0.1)
            seen.append((master.get("total"), master.get("noise"), master.get("y")))
        return seen

    first = future()
    master.fmu.setFMUState(state)
    assert master.get("y") == (2.0 * U + 0.5).ravel().tolist()
    master.set({"u": -U, "v": 5.0})
    assert future() == first
    master.fmu.freeFMUState(state)


def test_state_passes_to_another_instance(master):
    """Serialised, it continues in an instance of another process that was never initialized."""
    master.again(u=U, gain=4.0)
    master.step(0.0, 0.1)
    state = master.fmu.getFMUState()
    content = master.fmu.serializeFMUState(state)
    master.step(0.1, 0.1)
    other = Master(exported(EVERYTHING, master.fmi), debug_logging=True)
    try:
        restored = other.fmu.deserializeFMUState(content)
        other.fmu.setFMUState(restored)
        other.step(0.1, 0.1)
        for name in ("y", "total", "noise"):
            assert other.get(name) == master.get(name)
        for broken in (content[:-1], content[:100], b"", b"x" * len(content), content + b"0"):
            with pytest.raises(FMICallException, match="status 3"):
                other.fmu.deserializeFMUState(broken)
        assert "not a state of this FMU" in other.messages[-1][1]
    finally:
        other.free()


def test_an_exception_is_an_error_and_the_state_comes_back(master):
    """What a step raises is one line of the log and fmi2Error; a saved state makes it whole."""
    master.again(u=U)
    state = master.fmu.getFMUState()
    master.set({"text": "raise"})
    with pytest.raises(FMICallException, match="status 3"):
        master.step(0.0, 0.1)
    assert master.messages == [(3, "RuntimeError: told to fail")]
    with pytest.raises(FMICallException, match="status 3"):
        master.step(0.0, 0.1)
    assert "not permitted in state error" in master.messages[-1][1]
    master.fmu.setFMUState(state)
    master.step(0.0, 0.1)
    assert master.get("total") == pytest.approx(0.1 * U.sum())


def test_discard_leaves_time_where_it_was(master):
    """A refused step advances nothing and can be tried again."""
    master.again(text="discard", u=U)
    with pytest.raises(FMICallException, match="status 2"):
        master.step(0.0, 0.1)
    if master.fmi == 2:
        assert master.fmu.getRealStatus(2) == 0.0
    master.set({"text": ""})
    master.step(0.0, 0.05)
    assert master.get("total") == 0.05 * U.sum()


def test_a_warning_is_logged_and_goes_on(master):
    """What a component logs is in the FMI log, with its status."""
    master.again(text="warn")
    master.step(0.0, 0.1)
    assert master.messages == [(1, "a warning")]
    assert master.get("echo") in ("said warn", b"said warn")


@pytest.mark.parametrize("fmi", VERSIONS)
def test_what_a_component_prints_does_no_harm(fmi, capfd):
    """Standard output of the component is the host's standard error, and no message of ours."""
    made = Master(exported(EVERYTHING, fmi))
    made.initialize(text="print", v=1.0)
    made.step(0.0, 0.1)
    assert made.get("total") == 0.1
    made.free()
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.split("\n")[:2] == ["on standard output", "and on its descriptor"]


def test_a_refused_start_is_an_error(master):
    """What initialize refuses is told; after a reset the instance is as new."""
    master.fmu.reset()
    master.messages.clear()
    with pytest.raises(FMICallException, match="status 3"):
        master.initialize(text="refuse")
    assert master.messages == [(3, "ValueError: text: refused at the start")]
    master.again(u=U)
    assert master.get("total") == 0.0


def test_a_wrong_shape_is_an_error(master):
    """A component whose value is not what it described is found out."""
    master.fmu.reset()
    master.messages.clear()
    with pytest.raises(FMICallException, match="status 3"):
        master.initialize(text="shape")
    assert "y: wrong shape, got (5,), expected (2, 3)" in master.messages[-1][1]


@pytest.mark.parametrize("text", WRONG)
def test_a_value_of_another_type_is_an_error(master, text):
    """What would not be the same value in its variable is refused, as it is natively."""
    master.fmu.reset()
    master.messages.clear()
    with pytest.raises(FMICallException, match="status 3"):
        master.initialize(text=text)
    ((name, value),) = WRONG[text].items()
    told = f"{name}: wrong type, got {value!r}, expected "
    assert master.messages[-1][1].startswith(f"ValueError: {told}")


def test_nan_and_numbers_of_numpy_are_values():
    """A value that is the same in its variable is taken: NaN, an int for a float, numpy's scalars."""
    from orchestrator.export.worker.instance import Variable

    buffers = {
        "reals": np.zeros(2),
        "integers": np.zeros(1, int),
        "strings": np.full(2, "", object),
    }
    real = Variable("x", "get", "reals", 1, (), boolean=False)
    for value in (float("nan"), 3, np.float32(0.1), np.int16(-4)):
        real.write(buffers, value)
        np.testing.assert_equal(real.read(buffers), float(value))
    flag = Variable("b", "get", "integers", 0, (), boolean=True)
    flag.write(buffers, np.True_)
    assert flag.read(buffers) is True
    texts = Variable("t", "get", "strings", 0, (2,), boolean=False)
    texts.write(buffers, np.array(["a", "bc"]))
    texts.write(buffers, texts.read(buffers))  # what a component takes it may return
    assert texts.read(buffers).tolist() == ["a", "bc"]


@pytest.mark.parametrize("text", ANSWERS)
def test_a_step_answers_a_status(master, text):
    """What is no status is an error, as it is natively, and never a number that it could be."""
    master.again(text=text)
    with pytest.raises(FMICallException, match="status 3"):
        master.step(0.0, 0.1)
    told = f"ValueError: step answered {ANSWERS[text]!r}, expected a status 0 to 4"
    assert master.messages == [(3, told)]


@pytest.mark.parametrize("fmi", VERSIONS)
def test_equal_input_gives_equal_bytes(fmi, tmp_path):
    """An export is a function of the component: no times, no random names, no temporary paths."""
    again = tmp_path / "elsewhere" / "again.fmu"
    again.parent.mkdir()
    export(choose(EVERYTHING), again, fmi=fmi)
    assert again.read_bytes() == exported(EVERYTHING, fmi).read_bytes()


def test_an_fmu_carries_its_sources():
    """The component's module, what it imports of its own project, and the C text are inside."""
    with zipfile.ZipFile(exported(EVERYTHING, 3)) as archive:
        names = archive.namelist()
    assert {
        "resources/python/small_exports.py", "resources/python/plant/variables.py",
        "resources/component.json", "resources/hedgehop_worker/__main__.py", "sources/fmi3.c",
        "sources/model.h", "sources/buildDescription.xml",
    } <= set(names)  # fmt: skip
    assert not [name for name in names if "numpy" in name or "__pycache__" in name]


def test_the_command_names_what_is_wrong(tmp_path, monkeypatch, capsys):
    """Wrong names, places and compilers end with exit code 2 and one line, and leave no file."""
    out = tmp_path / "x.fmu"
    for arguments, expected in (
        (["nope"], "no component of this name"),
        (["basis_mpcc"], "did you mean 'basis_mpc'"),
        ([EVERYTHING, "--set", "a=1"], "expected --scenario"),
        ([EVERYTHING, "--c"], "has no method 'c_source'"),
        ([EVERYTHING, "--fmi", "1"], "--fmi"),
        ([EVERYTHING, "--scenario", "level_flight.yaml"], "has no component"),
    ):
        assert status(["export", *arguments, "-o", str(out)]) == 2
        error = capsys.readouterr().err
        assert expected in error
        assert len(error.strip().splitlines()) == 1
    assert status(["export", EVERYTHING, "-o", str(tmp_path / "no" / "x.fmu")]) == 2
    monkeypatch.setenv("CC", "a-compiler-that-nobody-has")
    assert status(["export", EVERYTHING, "-o", str(out)]) == 2
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    capsys.readouterr()
    assert status(["export", EVERYTHING, "-o", str(out)]) == 2
    assert "no C compiler, expected cc, gcc or clang" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_worker_reads_what_the_recipe_writes():
    """Parameters survive as JSON: types, tuples, nested records and files."""
    from json import dumps, loads
    from pathlib import Path

    from small_components import GliderParameters, GroundParameters, Wing

    from orchestrator.export.recipe import Recipe
    from orchestrator.export.worker.instance import decode

    here = Path(__file__)
    for value in (
        GliderParameters(wing=Wing(3.0), waypoints_m=((1.0, 2.0),), trim_deg=None),
        EverythingParameters(gain=float("inf")),
    ):
        plain = loads(dumps(Recipe().encode(value, "parameters")))
        assert decode(plain, here.parent) == value
        assert pickle.dumps(decode(plain, here.parent)) == pickle.dumps(value)
    recipe = Recipe()
    plain = recipe.encode(GroundParameters(here), "parameters")
    assert decode(plain, Path("resources")).file == Path("resources/files/0") / here.name
    assert recipe.files == {f"files/0/{here.name}": here.read_bytes()}
    with pytest.raises(ValueError, match="x: cannot be exported, got object"):
        recipe.encode(object(), "x")
