"""Model descriptions become ports."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import Row, describe

from orchestrator.assembly.description import members, mismatch, plain, ports
from orchestrator.errors import CouplingError

ROWS = [
    Row("command.thrust", "input", 1.5),
    Row("command.pitch", "input", unit="rad"),
    Row("plan", "input", 0.25, shape=(2, 3)),
    Row("is_on", "input", True),
    Row("label", "input", "north"),
    Row("count", "output", 0),
    Row("mode", "output", 0, items=("idle", "busy")),
    Row("y", "output", unit="m", through=("command.thrust",)),
    Row("weight", "parameter", 2.0, variability="tunable"),
]


def read(rows=ROWS, **more):
    """Return the ports of a component ``c``."""
    return ports("c", describe("c", rows, **more))


def test_start_values_have_type_and_shape():
    """Start values are parsed; one number fills an array."""
    own = read()
    assert own["command.thrust"].start == 1.5
    assert own["is_on"].start is True
    assert own["label"].start == "north"
    assert own["weight"].start == 2.0
    assert own["y"].start is None
    np.testing.assert_array_equal(own["plan"].start, np.full((2, 3), 0.25))


def test_start_arrays_are_read_only():
    """Nobody can change a start value."""
    with pytest.raises(ValueError, match="read-only"):
        read()["plan"].start[0, 0] = 1.0


def test_start_array_element_by_element():
    """As many start values as elements fill an array row by row; any other number is an error."""
    row = Row("plan", "input", shape=(2, 2))
    description = describe("c", [row])
    description.modelVariables[1].start = "1 2 3 4"
    np.testing.assert_array_equal(ports("c", description)["plan"].start, [[1, 2], [3, 4]])
    description.modelVariables[1].start = "1 2 3"
    with pytest.raises(CouplingError, match="wrong number of start values, got 3, expected 1 or 4"):
        ports("c", description)


def test_shape_from_a_structural_parameter():
    """A dimension may be the start value of another variable."""
    description = describe("c", [Row("n", "parameter", 3), Row("x", "input", shape=(3,))])
    description.modelVariables[1].causality = "structuralParameter"
    dimension = description.modelVariables[2].dimensions[0]
    dimension.start, dimension.variable = None, description.modelVariables[1]
    assert ports("c", description)["x"].shape == (3,)


def test_enumerations_have_items():
    """Items are texts by value."""
    port = read()["mode"]
    assert dict(port.items) == {0: "idle", 1: "busy"}
    assert port.kind == "enumeration"


@pytest.mark.parametrize(
    ("through", "expected"),
    [(None, {"u", "v"}), ((), set()), (("u",), {"u"})],
    ids=["not said", "none", "one"],
)
def test_direct_feed_through(through, expected):
    """No list of dependencies means all inputs, an empty one none."""
    rows = [Row("u", "input"), Row("v", "input"), Row("y", "output", through=through)]
    assert read(rows)["y"].depends_on == expected


def test_members_of_a_group():
    """A group's members go by what follows the group's name."""
    own = read()
    assert list(members(own, "command")) == ["thrust", "pitch"]
    assert members(own, "comm") == {}


def test_all_problems_of_a_description_are_listed():
    """A description that FMPy refuses is an error that says everything FMPy found."""
    description = describe("c", [Row("u", "input"), Row("y", "output")])
    description.modelVariables[1].unit = "parsec"
    description.modelVariables[2].causality = "ouput"
    with pytest.raises(CouplingError) as caught:
        ports("c", description)
    message = str(caught.value)
    assert message.startswith("component 'c': model description is not valid: ")
    assert 'unit "parsec" of variable "u" is not defined' in message
    assert 'causality="ouput"' in message


def test_types_that_cannot_be_coupled():
    """Clocks are left out."""
    description = describe("c", [Row("y", "output", 0), Row("z", "output")])
    description.modelVariables[1].type = "Clock"
    assert list(ports("c", description)) == ["time", "z"]


def test_outputs_missing_from_the_structure():
    """An output about which the model structure says nothing may depend on every input."""
    description = describe("c", [Row("u", "input"), Row("y", "output")])
    description.outputs.clear()
    assert ports("c", description)["y"].depends_on == {"u"}


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("y", 1.0, None),
        ("y", np.float64(1.0), None),
        ("y", 1, "got int, expected float"),
        ("y", "1", "got str, expected float"),
        ("count", 3, None),
        ("count", 3.0, "got float, expected int"),
        ("count", True, "got bool, expected int"),
        ("mode", 1, None),
        ("mode", 2, "got 2, expected 0 or 1"),
        ("is_on", False, None),
        ("plan", np.zeros((2, 3)), None),
        ("plan", np.zeros((3, 2)), "got (3, 2), expected (2, 3)"),
        ("plan", np.zeros((2, 3), int), "got int64, expected float64"),
        ("plan", 0.0, "not an array, got float, expected shape (2, 3)"),
        ("label", "south", None),
    ],
)
def test_values_match_their_port(name, value, fault):
    """A value has the port's type and shape, or what is wrong is said."""
    found = mismatch(read()[name], value)
    if fault is None:
        assert found is None
    else:
        assert found is not None
        assert fault in found


def test_a_name_described_twice_is_refused():
    """Among the variables, and in the list of outputs."""
    described = describe("c", ROWS)
    described.outputs.append(described.outputs[0])
    with pytest.raises(CouplingError, match="'c': .*: output 'count' is listed twice"):
        ports("c", described)
    described = describe("c", ROWS)
    described.modelVariables.append(described.modelVariables[1])
    with pytest.raises(CouplingError, match='"command.thrust" is not unique'):
        ports("c", described)


def test_a_dependency_on_no_variable_is_refused():
    """It would be left out, and with it a direct feed-through."""
    described = describe("c", ROWS)
    other = describe("d", [Row("command.thrst", "input")])
    described.outputs[2].dependencies = [other.modelVariables[1]]
    told = "output 'y' depends on 'command.thrst', no variable, did you mean 'command.thrust'"
    with pytest.raises(CouplingError, match=told):
        ports("c", described)


def test_a_description_that_lacks_the_plainest_things_is_refused():
    """Not even FMPy can read it."""
    described = describe("c", ROWS)
    described.fmiVersion = None
    with pytest.raises(CouplingError, match="'c': .* not valid: it cannot be read, AttributeError"):
        ports("c", described)


@given(st.one_of(st.floats(), st.integers(), st.booleans(), st.floats(width=32).map(np.float32)))
def test_a_plain_number_is_equal_to_what_it_was(value):
    """Nothing is lost: what would lose anything stays what it is, and so does every bool."""
    for name in ("y", "count", "is_on"):
        made = plain(read()[name], value)
        assert made is value or (made == value) or np.isnan(value)
        assert isinstance(made, bool) == isinstance(value, bool)
        assert made is value or mismatch(read()[name], made) is None
