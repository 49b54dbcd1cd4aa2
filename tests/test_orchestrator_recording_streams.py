"""Streams: many messages at a time, the same bytes as one by one."""

import numpy as np
import pytest
from fake_system import TICK_NS, helicopter, port
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Message

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.schemas import channel, channels
from orchestrator.recording.streams import Stream, instant
from orchestrator.recording.topics import signals, topics

KINDS = ("Float64", "Int64", "Boolean", "Enumeration", "String")
VALUES = st.tuples(
    st.floats(),
    st.integers(-(2**63), 2**63 - 1),
    st.booleans(),
    st.integers(-(2**31), 2**31 - 1),
    st.text(),
)


def rows(*told):
    """Return rows of values, told tick by tick."""
    times = [EPOCH_NS + k * TICK_NS for k in range(len(told))]
    return [(time, instant(time), values) for time, values in zip(times, told, strict=True)]


def stream(ports, kind="outputs"):
    return Stream(7, signals(channel("c", kind, "g", ports), {}))


def record(sequence, time_ns, data):
    """Return a Message record as the library writes it."""
    builder = RecordBuilder()
    Message(7, time_ns, data, time_ns, sequence).write(builder)
    return builder.end()


@given(st.lists(VALUES, min_size=1, max_size=5), st.sets(st.sampled_from(KINDS), min_size=1))
@settings(deadline=None, max_examples=40)
def test_many_at_a_time_are_the_bytes_of_one_by_one(told, kinds):
    """Records packed together are the library's records of the messages encoded alone."""
    ports = [port("c", "g.always")]
    ports += [port("c", f"g.{kind}", kind=kind) for kind in KINDS if kind in kinds]
    ports += [port("c", f"g.{kind}s", kind=kind, shape=(2, 1)) for kind in KINDS if kind in kinds]
    given_rows = rows(
        *(
            {"g.always": float(k)}
            | {f"g.{kind}": value for kind, value in zip(KINDS, row, strict=True)}
            | {
                f"g.{kind}s": np.full((2, 1), value, object if kind == "String" else None)
                for kind, value in zip(KINDS, row, strict=True)
            }
            for k, row in enumerate(told)
        )
    )
    each = stream(ports)
    times, records, refusal = each.records(given_rows)
    assert refusal is None
    assert times == [time for time, _, _ in given_rows]
    assert records == [
        record(sequence, time, each.message(time, values))
        for sequence, (time, _, values) in enumerate(given_rows, start=1)
    ]


def test_every_topic_is_packed_as_it_is_encoded_alone():
    """That holds for what viewers draw too, and for events, text and measured times."""
    system = helicopter(cells=3, capacity=4, posts=2, wall_clock=True)
    rng = np.random.default_rng(0)
    for topic in topics(system, wall_clock=True):
        if topic.call == "scene":  # of several components: test_orchestrator_recording_scene.py
            continue
        ports = system.ports.get(topic.component, {})
        told = [
            {name: rng.normal(size=p.shape) if p.shape else k for name, p in ports.items()}
            for k in range(3)
        ]
        if not topic.component:
            words = {"level": 2, "name": "mpc", "kind": "set", "component": "mpc"}
            told = [words | dict.fromkeys(system.ports, 0.1) | {"message": "é" * k} for k in (0, 3)]
        each = Stream(7, topic)
        _, records, refusal = each.records(rows(*told))
        assert refusal is None
        alone = [each.message(time, values) for time, _, values in rows(*told)]
        assert [packed[31:] for packed in records] == alone


def test_messages_that_hold_different_variables_are_told_apart():
    """Inputs are packed in runs of equal names; the numbers count on."""
    each = stream([port("c", name, causality="input") for name in "ab"], "inputs")
    told = rows({"a": 1.0}, {"a": 2.0}, {"b": 3.0}, {"a": 4.0, "b": 5.0})
    _, records, _ = each.records(told)
    assert records == [
        record(n, time, each.message(time, values)) for n, (time, _, values) in enumerate(told, 1)
    ]


def test_numbers_and_what_was_last_written_outlive_a_flush():
    """Batch by batch or all at once: the same records, with what has not changed left out."""
    held = {"kind": "Int64"}
    values = [0, 0, 1, 1, 1, 0, 2000, 2000, int("2000")]
    told = rows(*({"g.n": value} for value in values))
    whole, parts = (stream([port("c", "g.n", **held)]) for _ in range(2))
    _, records, _ = whole.records(told)
    assert len(records) == 4
    assert [r for k in range(len(told)) for r in parts.records(told[k : k + 1])[1]] == records


def test_equal_arrays_are_no_change_whether_or_not_they_are_the_same():
    """Identity is a short cut only: a copy is compared by its bytes, a NaN too; -0.0 differs."""
    x = np.array([np.nan, 0.0])
    each = stream([port("c", "g.x", shape=(2,), variability="discrete")])
    told = rows(*({"g.x": value} for value in (x, x, x.copy(), np.array([np.nan, -0.0]))))
    times, _, _ = each.records(told)
    assert times == [told[0][0], told[3][0]]


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        ({"g.x": np.zeros(3)}, r"g\.n: missing"),
        ({"g.x": np.zeros((3, 1)), "g.n": 1}, r"g\.x: shape, got \(3, 1\), expected \(3,\)"),
        ({"g.x": np.zeros(3), "g.n": 2**63}, ""),
    ],
)
def test_what_cannot_be_written_is_named_and_the_rest_kept(wrong, what):
    """A refusal says topic, time and variable; the other rows are numbered without a gap."""
    right = {"g.x": np.zeros(3), "g.n": 1}
    each = stream([port("c", "g.x", shape=(3,)), port("c", "g.n", kind="Int64")])
    told = rows(right, wrong, right)
    times, records, refusal = each.records(told)
    with pytest.raises(ValueError, match=rf"^/c/g at t = 0\.050 s: cannot be recorded, {what}"):
        raise refusal
    assert times == [told[0][0], told[2][0]]
    alone = each.message(*told[0][::2]), each.message(*told[2][::2])
    assert records == [record(n, t, m) for n, t, m in zip((1, 2), times, alone, strict=True)]


def test_arrays_need_not_lie_in_order_nor_be_of_the_type():
    """A transposed array, or integers for numbers, are written row by row as the schema says."""
    (each,) = channels("c", [port("c", "g.x", shape=(2, 3))])
    one = Stream(1, signals(each, {}))
    plain = one.message(0, {"g.x": np.arange(6.0).reshape(2, 3)})
    assert one.message(0, {"g.x": np.asfortranarray(np.arange(6.0).reshape(2, 3))}) == plain
    assert one.message(0, {"g.x": np.arange(6).reshape(2, 3)}) == plain
