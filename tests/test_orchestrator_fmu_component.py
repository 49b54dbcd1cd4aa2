"""An FMU as a component: every type, events, clocks, early returns, start values and states."""

import logging
import pickle
import zipfile

import numpy as np
import pytest

from orchestrator.assembly.description import mismatch, ports
from orchestrator.fmu.component import FmuComponent, FmuParameters
from orchestrator.fmu.errors import FmuError

BOTH = pytest.mark.parametrize("fmi", [2, 3])

SCALARS = {
    "Float64": -0.1,
    "Int32": -(2**31),
    "Boolean": True,
    "String": "hôver 100 %",
    "Enumeration": 2,
}
SCALARS3 = {
    "Float32": 0.5,
    "Int8": -128,
    "UInt8": 255,
    "Int16": -32768,
    "UInt16": 65535,
    "UInt32": 2**32 - 1,
    "Int64": -(2**63),
    "UInt64": 2**64 - 1,
    "Binary": b"\x00\xffzero at the end\x00",
}
ARRAYS = {"vector": np.array([1.0, -2.0, 0.25]), "matrix": np.array([[1.0, 2.0], [3.0, 4.0]])}
ARRAYS3 = {
    "integers": np.array([-3, 7]),
    "flags": np.array([True, False]),
    "words": np.array(["roll", "pitch é"]),
}


@pytest.fixture
def started():
    """Return a function that makes and initializes a component; all are terminated."""
    made = []

    def start(file, inputs=None, seed=1, **parameters):
        component = FmuComponent(FmuParameters(file, **parameters), instance_name="a")
        made.append(component)
        if inputs:
            component.set(inputs)
        component.initialize(start_time=0.0, stop_time=None, seed=seed)
        return component

    yield start
    for component in made:
        component.terminate()


def run(component, first, count, step=0.1, name="y"):
    """Return an output after each of some steps."""
    values = []
    for k in range(first, first + count):
        assert component.step(k * step, step) == 0
        values.append(component.get([name])[name])
    return values


@BOTH
@pytest.mark.parametrize("is_early", [True, False])
def test_every_type_passes_through_unchanged(fmu, fmi, is_early, started):
    """What is set comes out equal and of the port's type, set before initialize or after it."""
    given = SCALARS | ARRAYS | (SCALARS3 | ARRAYS3 if fmi == 3 else {})
    inputs = {name + "_in": value for name, value in given.items()}
    component = started(fmu("feedthrough", fmi=fmi), inputs if is_early else None, arrays=True)
    if not is_early:
        component.set(inputs)
    found = component.get([name + "_out" for name in given])
    own = ports("a", component.describe())
    for name, value in given.items():
        out = found[name + "_out"]
        assert np.array_equal(out, value), name
        assert mismatch(own[name + "_out"], out) is None, name


@BOTH
def test_names_in_any_mixture_and_order_are_served(fmu, fmi, started):
    """Calls are grouped by type, answers are by name."""
    component = started(fmu("feedthrough", fmi=fmi), arrays=True)
    names = ["String_out", "vector_out", "Float64_out", "Int32_out", "Boolean_out"]
    component.set({"Float64_in": 2.0, "String_in": "x", "vector_in": np.ones(3)})
    first, second = component.get(names), component.get(names[::-1])
    assert set(first) == set(names)
    assert first["String_out"] == second["String_out"] == "x"
    assert first["vector_out"] is not second["vector_out"]
    assert component.get([]) == {}
    component.set({})


def test_scalars_stay_scalars_unless_asked_for(fmu, started):
    """FMI 2 arrays are gathered on request alone, and 1-based elements lie row by row."""
    file = fmu("feedthrough", fmi=2)
    names = [v.name for v in started(file).describe().modelVariables]
    assert {"matrix_in[1,2]", "vector_in[3]"} <= set(names)
    own = ports("a", started(file, arrays=True).describe())
    assert own["matrix_in"].shape == (2, 2)
    assert own["vector_out"].depends_on == {"vector_in"}
    assert "matrix_in[1,2]" not in own


@BOTH
@pytest.mark.parametrize(
    ("values", "error", "says"),
    [
        ({"Int32_inn": 1}, KeyError, "did you mean 'Int32_in'"),
        ({"Int32_in": 2**31}, ValueError, "Int32_in: not a value of Int"),
        ({"Int32_in": 0.5}, ValueError, "Int32_in: not a value of Int"),
        ({"vector_in": np.zeros(2)}, ValueError, r"wrong shape, got \(2,\), expected \(3,\)"),
        ({"String_in": "a\0b"}, ValueError, "null character"),
        ({"Float64_out": 1.0}, ValueError, "'Float64_out' cannot be set, got continuous output"),
        ({"gear_ratio": 1.0}, ValueError, "'gear_ratio' cannot be set, got fixed parameter"),
    ],
)
def test_what_cannot_be_set_is_refused(fmu, fmi, values, error, says, started):
    """Nothing is cut, rounded or broadcast silently."""
    with pytest.raises(error, match=says):
        started(fmu("feedthrough", fmi=fmi), arrays=True).set(values)


@BOTH
def test_start_values_have_units(fmu, fmi, started):
    """A value is in the variable's unit, or in any of its dimension that the FMU defines."""
    file = fmu("feedthrough", fmi=fmi)
    component = started(file, start={"gear_ratio": 3, "angle": {"value": 45, "unit": "deg"}})
    assert component.get(["gear_ratio", "angle"]) == {"gear_ratio": 3.0, "angle": 45.0}
    assert started(file, start={"label": "tail"}).get(["label"]) == {"label": "tail"}
    wrong = {
        "label": "start: label: wrong type, got 1, expected text",
        "gear_ration": "did you mean 'gear_ratio'",
        "Float64_out": "start: Float64_out: takes no start value",
    }
    for name, says in wrong.items():
        with pytest.raises(ValueError, match=says):
            FmuComponent(FmuParameters(file, {name: 1}))
    with pytest.raises(ValueError, match="expected 'value' and 'unit'"):
        FmuComponent(FmuParameters(file, {"angle": {"value": 1.0}}))
    for unit, says in {"degree": "unknown unit", "s": "another dimension"}.items():
        with pytest.raises(ValueError, match=says):
            FmuComponent(FmuParameters(file, {"angle": {"value": 1.0, "unit": unit}}))


@BOTH
def test_tunable_parameters_change_between_steps(fmu, fmi, started):
    """A decay whose rate becomes 0 stands still."""
    component = started(fmu("decay", fmi=fmi))
    run(component, 0, 3)
    component.set({"k": 0.0})
    values = run(component, 3, 3)
    assert values[0] == values[2] == pytest.approx(0.99**30)


@pytest.mark.parametrize("event_mode", [True, False])
def test_events_are_handled_where_they_are(fmu, event_mode, started):
    """Steps that end early are finished: the staircase has its height after any step size."""
    for step, count in ((1.0, 2), (0.4, 5), (0.25, 8), (0.1, 20)):
        component = started(fmu("staircase", fmi=3), event_mode=event_mode)
        assert run(component, 0, count, step)[-1] == 8.0


def test_clocks_tick_at_their_own_times(fmu, started):
    """An input clock of 0.5 s samples what was set for the step that its tick falls into."""
    component = started(fmu("clocked", fmi=3))
    assert component.execution.rate_hz == 2.0
    counts = []
    for k in range(11):
        component.set({"u": float(k)})
        assert component.step(k * 0.2, 0.2) == 0
        values = component.get(["y", "count"])
        counts.append(values["count"])
        # ticks at 0, 0.5, 1, 1.5, 2 s lie in these steps
        assert values["y"] == max(n for n in (0, 2, 5, 7, 10) if n <= k)
    assert counts == [1, 1, 2, 2, 2, 3, 3, 4, 4, 4, 5]


def test_scheduled_execution_is_sampled(fmu, started):
    """A partition is activated at every tick of its clock, also several in one step."""
    file = fmu("clocked", fmi=3, SCHEDULED=1)
    component = started(file)
    assert (component.execution.kind, component.execution.rate_hz) == ("sampled", 2.0)
    component.set({"u": 3.0})
    assert run(component, 0, 3, 0.5, "count") == [1, 2, 3]
    assert component.get(["y"]) == {"y": 3.0}
    assert run(started(file), 0, 3, 1.0, "count") == [2, 4, 6]


@BOTH
@pytest.mark.parametrize("name", ["decay", "staircase", "clocked"])
def test_a_restored_state_continues_to_the_same_bit(fmu, fmi, name, started):
    """By bytes in another instance, by a snapshot in the same one, adapter included."""
    if (name, fmi) == ("clocked", 2):
        return
    first = started(fmu(name, fmi=fmi))
    run(first, 0, 3, 0.3)
    state, snapshot = first.get_state(), first.snapshot()
    expected = run(first, 3, 7, 0.3)
    for _ in range(2):
        first.rewind(snapshot)
        assert run(first, 3, 7, 0.3) == expected
    first.release(snapshot)
    second = started(fmu(name, fmi=fmi))
    second.set_state(state)
    assert run(second, 3, 7, 0.3) == expected
    assert first.describe().coSimulation.canSerializeFMUstate


def test_messages_come_with_the_components_name(fmu, started, caplog):
    """FMI 2's variadic messages are formatted, and levels follow the status."""
    caplog.set_level(logging.DEBUG, logger="hedgehop.component")
    for fmi in (2, 3):
        caplog.clear()
        component = started(fmu("faulty", fmi=fmi, FAULT="LOG", AT=0))
        component.step(0.0, 0.1)
        assert [(r.name, r.levelname, r.getMessage()) for r in caplog.records] == [
            ("hedgehop.component.a", "WARNING", "[logStatusWarning] ice on the wing (at 0 s)"),
            ("hedgehop.component.a", "INFO", "[logAll] 100% sure (at 0 s)"),
        ]


@BOTH
def test_after_fatal_every_call_is_refused(fmu, fmi, started):
    """By the adapter: the FMU is not asked."""
    component = started(fmu("faulty", fmi=fmi, FAULT="DIE", AT=0))
    component.get(["y"])
    assert component.step(0.0, 0.1) == 4
    assert component.step(0.1, 0.1) == 4
    for call in (lambda: component.get(["y"]), lambda: component.set({"u": 1.0})):
        with pytest.raises(FmuError, match="is not called, the FMU can be used no more"):
            call()


@BOTH
def test_a_missed_step_is_made_up_for(fmu, fmi, started):
    """After a refusal the next step begins where the FMU is, in steps of the usual size."""
    component = started(fmu("faulty", fmi=fmi, FAULT="REFUSE", AT=2))
    assert [component.step(k * 0.1, 0.1) for k in range(4)] == [0, 0, 2, 0]
    assert component.get(["y"])["y"] == pytest.approx(0.4)


def test_errors_pickle():
    """They cross a process boundary with their status."""
    error = pickle.loads(pickle.dumps(FmuError("fmi2DoStep is refused", 4)))
    assert (str(error), error.status) == ("fmi2DoStep is refused", 4)


@BOTH
def test_an_unpacked_folder_is_used_in_place(fmu, fmi, tmp_path, started):
    """Nothing is copied, nothing is removed."""
    with zipfile.ZipFile(fmu("relay", fmi=fmi)) as archive:
        archive.extractall(tmp_path / "relay")
    component = started(tmp_path / "relay", {"u": 2.0})
    assert run(component, 0, 1) == [2.0]
    component.terminate()
    assert (tmp_path / "relay" / "modelDescription.xml").exists()


@BOTH
def test_directional_derivatives_and_states_without_a_component(fmu, fmi):
    """What a prediction model needs: instances of one FMU, their state x set, partial derivatives."""
    from orchestrator.fmu.buffers import reader, writer
    from orchestrator.fmu.fmu import Fmu, describe

    described = describe(fmu("decay", fmi=fmi))
    library = Fmu(described)
    names = described.variables
    two = [library.instantiate(name) for name in "ab"]
    for instance, x in zip(two, (1.0, 3.0), strict=True):
        instance.set_up(0.0, None, None)
        instance.enter_initialization_mode()
        instance.exit_initialization_mode()
        writer(instance, [names["x"]])({"x": x})
    found = [reader(instance, [names["y"]])()["y"] for instance in two]
    assert found == [1.0, 3.0]
    unknowns, knowns = names["der(x)"].references, names["u"].references + names["x"].references
    change = two[0].directional(unknowns, knowns, np.array([1.0, 2.0]), 1)
    assert change == pytest.approx([-1.0])  # der(x) = k x + u with k = -1
    for instance in two:
        instance.terminate()
    described.close()
