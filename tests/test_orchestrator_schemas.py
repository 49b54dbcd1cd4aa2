"""Schemas: names, units and types of variables as protobuf sees them, and the wire encoders."""

import re

import numpy as np
import pytest
from fake_system import port
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.recording.descriptors import identifier, message_class
from orchestrator.recording.rows import messages
from orchestrator.recording.schemas import channel, channels, variable_name
from orchestrator.recording.streams import Stream
from orchestrator.recording.topics import signals
from orchestrator.recording.wire import timestamp, varint

NAMES = st.lists(
    st.text(st.sampled_from("ab_.[]()1Z é"), min_size=1, max_size=6), min_size=1, unique=True
)


def decoded(each, values):
    """Return the message that the official protobuf library reads from our bytes."""
    told, refusals = Stream({1: signals(each, {})}).records([(0, values)])
    for refusal in refusals:
        raise refusal
    ((_, _, data),) = messages(told)
    return message_class(each.message, each.descriptors).FromString(data)


def only(*ports):
    (each,) = channels("vehicle", ports)
    return each


def test_groups_become_topics():
    """One channel per top-level group, one for what has no group, one for the parameters."""
    names = ["state.theta", "clearance", "state.u", "scan.cell.north", "valid"]
    ports = [port("vehicle", name) for name in names]
    ports += [port("vehicle", "mass_kg", "kg", causality="parameter")]
    ports += [port("vehicle", "wind.north", causality="input")]
    made = {c.topic: (c.message, c.fields) for c in channels("vehicle", ports)}
    assert made == {
        "/vehicle/state": ("hedgehop.vehicle.State", ("theta", "u")),
        "/vehicle/outputs": ("hedgehop.vehicle.Outputs", ("clearance", "valid")),
        "/vehicle/scan": ("hedgehop.vehicle.Scan", ("cell_north",)),
        "/vehicle/parameters": ("hedgehop.vehicle.Parameters", ("mass_kg",)),
    }


def test_metadata_holds_what_the_schema_cannot():
    """Unit, bounds, shape, items and every changed name are in the channel's metadata."""
    each = only(
        port("vehicle", "a.der(x)", "m/s", min=-1.5, max=2.0),
        port("vehicle", "a.mode", kind="Enumeration", items={1: "old tail", 4: "trim"}),
        port("vehicle", "a.plan", "rad", shape=(2, 3)),
    )
    assert each.metadata == {
        "component": "vehicle",
        "kind": "outputs",
        "name.der_x": "a.der(x)",
        "unit.der_x": "m/s",
        "min.der_x": "-1.5",
        "max.der_x": "2.0",
        "unit.mode": "1",
        "items.mode": '{"1": "old tail", "4": "trim"}',
        "unit.plan": "rad",
        "shape.plan": "[2, 3]",
    }


def test_units_and_original_names_are_comments_in_the_schema():
    """Whoever reads the schema sees name, unit and meaning above every field."""
    each = only(port("vehicle", "der(x)", "m/s", description="speed", max=2.0))
    (location,) = FileDescriptorSet.FromString(each.descriptors).file[1].source_code_info.location
    assert location.leading_comments == " der(x) [m/s, ..2.0] speed\n"
    assert list(location.path) == [4, 0, 2, 1]


@given(NAMES)
@settings(deadline=None)
def test_any_names_give_distinct_legal_fields(names):
    """Whatever variables are called, fields are legal, distinct, and lead back to the names."""
    for each in channels("vehicle", [port("vehicle", name) for name in names]):
        assert all(re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", field) for field in each.fields)
        assert len({field.replace("_", "").lower() for field in each.fields}) == len(each.fields)
        back = [variable_name(each.topic, field, each.metadata) for field in each.fields]
        assert back == [p.name for p in each.ports]
        message_class(each.message, each.descriptors)


def test_a_variable_called_timestamp_gives_way():
    """Field 1 is the time stamp; a variable of that name is renamed, not lost."""
    each = only(port("vehicle", "timestamp", "s"))
    assert each.fields == ("timestamp_2",)
    assert decoded(each, {"timestamp": 3.0}).timestamp_2 == 3.0


def test_groups_named_like_fixed_topics_stay_apart():
    """`outputs.x` and a bare `x` are two topics."""
    made = channels("vehicle", [port("vehicle", "x"), port("vehicle", "outputs.x")])
    assert [each.topic for each in made] == ["/vehicle/outputs", "/vehicle/outputs_"]


def test_enumerations_share_a_message_without_clashing():
    """Two enumerations with equal items, one without a zero, are legal in one message."""
    each = only(
        port("vehicle", "a", kind="Enumeration", items={0: "plan", 1: "trim"}),
        port("vehicle", "b", kind="Enumeration", items={1: "plan", 2: "trim", -3: "±"}),
        port("vehicle", "plan"),
    )
    message = decoded(each, {"a": 1, "b": -3, "plan": 0.0})
    assert (message.a, message.b) == (1, -3)
    items = {v.name: v.number for v in message.DESCRIPTOR.fields_by_name["a"].enum_type.values}
    assert items == {"PLAN": 0, "TRIM": 1}
    other = message.DESCRIPTOR.fields_by_name["b"].enum_type.values
    assert [(v.name, v.number) for v in other][:2] == [("B_UNSET", 0), ("_", -3)]


def test_two_components_may_declare_the_same_message():
    """Every schema lives in its own pool: the same name twice is no conflict."""
    for name in ("x", "y"):
        each = only(port("vehicle", name))
        assert getattr(decoded(each, {name: 1.0}), name) == 1.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [("der(x)", "der_x"), ("a.b[1]", "a_b_1"), ("2nd", "_2nd"), ("", "_"), ("é", "_")],
)
def test_identifier(text, expected):
    """Illegal characters become underscores, none at the end; digits do not lead."""
    assert identifier(text) == expected


@given(
    st.lists(st.floats(), min_size=20, max_size=20),
    st.integers(-(2**63), 2**63 - 1),
    st.integers(0, 2**64 - 1),
    st.integers(-(2**31), 2**31 - 1),
    st.booleans(),
    st.text(),
)
@settings(deadline=None, max_examples=50)
def test_protobuf_reads_our_bytes(floats, integer, unsigned, item, boolean, text):
    """The official library decodes every value bit for bit, in messages of any number of fields."""
    values = {f"x{k}": value for k, value in enumerate(floats)}
    ports = [port("vehicle", name) for name in values]
    ports += [
        port("vehicle", name, kind=kind)
        for name, kind in zip(
            "iuebs", ("Int64", "UInt64", "Enumeration", "Boolean", "String"), strict=True
        )
    ]
    values |= {"i": integer, "u": unsigned, "e": item, "b": boolean, "s": text}
    message = decoded(only(*ports), values)
    read = [getattr(message, name) for name in values]
    assert read[20:] == [integer, unsigned, item, boolean, text]
    assert np.array(read[:20]).tobytes() == np.array(floats).tobytes()


@given(st.lists(st.floats(), min_size=6, max_size=6), st.lists(st.booleans(), min_size=3))
@settings(deadline=None, max_examples=30)
def test_protobuf_reads_our_arrays(floats, flags):
    """Arrays are packed row by row: doubles, integers, booleans, enumerations and text."""
    n = (len(flags),)
    each = only(
        port("vehicle", "x", shape=(2, 3)),
        port("vehicle", "i", kind="Int64", shape=n),
        port("vehicle", "b", kind="Boolean", shape=n),
        port("vehicle", "e", kind="Enumeration", shape=n, items={0: "a", 1: "b"}),
        port("vehicle", "s", kind="String", shape=n),
    )
    b = np.array(flags)
    x = np.array(floats).reshape(2, 3)
    message = decoded(each, {"x": x, "i": -b.astype(int), "b": b, "e": b * 300, "s": b.astype(str)})
    assert np.array(message.x).tobytes() == x.tobytes()
    assert list(message.i) == [-int(flag) for flag in flags]
    assert list(message.b) == flags
    assert list(message.e) == [300 * flag for flag in flags]
    assert list(message.s) == [str(flag) for flag in flags]


def test_an_array_of_another_shape_is_refused():
    """A message is never written with a length that its data does not have."""
    each = only(port("vehicle", "x", shape=(3,)))
    with pytest.raises(ValueError, match=r"x: shape, got \(2,\), expected \(3,\)"):
        decoded(each, {"x": np.zeros(2)})


def test_inputs_have_presence():
    """A message of inputs holds the given ones only, and says so."""
    ports = [port("vehicle", name, causality="input") for name in ("a", "b")]
    each = channel("vehicle", "inputs", "inputs", ports)
    message = decoded(each, {"b": 0.0})
    assert not message.HasField("a")
    assert message.HasField("b")


@given(st.integers(0, 2**63 - 1))
@settings(deadline=None)
def test_timestamps_are_exact(time_ns):
    """The time stamp is the integer time."""
    each = only(port("vehicle", "x"))
    message = message_class(each.message, each.descriptors).FromString(timestamp(time_ns))
    assert message.timestamp.ToNanoseconds() == time_ns


def test_varints_follow_the_standard_examples():
    """1, 150 and -1 are encoded as protobuf's documentation says."""
    assert varint(1) == b"\x01"
    assert varint(150) == b"\x96\x01"
    assert varint(-1) == b"\xff" * 9 + b"\x01"
