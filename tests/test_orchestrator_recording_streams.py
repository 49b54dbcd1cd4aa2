"""Streams: many messages at a time, side by side with those of other topics."""

import numpy as np
import pytest
from fake_system import TICK_NS, helicopter, port
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Message

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.rows import assemble, messages
from orchestrator.recording.schemas import channel, channels
from orchestrator.recording.streams import Stream
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
    return [(EPOCH_NS + k * TICK_NS, values) for k, values in enumerate(told)]


def topic(ports, kind="outputs", group="g"):
    return signals(channel("c", kind, group, ports), {})


def stream(ports, kind="outputs"):
    return Stream({7: topic(ports, kind)})


def record(channel, sequence, time_ns, data):
    """Return a Message record as the library writes it."""
    builder = RecordBuilder()
    Message(channel, time_ns, data, time_ns, sequence).write(builder)
    return builder.end()


def written(told):
    """Return rows as the library writes their messages, each channel's counted from 1."""
    counts, records = {}, b""
    for number, time, data in messages(told):
        counts[number] = counts.get(number, 0) + 1
        records += record(number, counts[number], time, data)
    return records


def one_by_one(each, given_rows):
    """Return the rows of a stream that is given one row after the other."""
    return [row for given_row in given_rows for row in each.records([given_row])[0]]


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
    told, refusals = stream(ports).records(given_rows)
    assert refusals == []
    assert [time for time, *_ in told] == [time for time, _ in given_rows]
    assert assemble(told)[0] == written(told) == written(one_by_one(stream(ports), given_rows))


def test_every_topic_is_packed_as_it_is_encoded_alone():
    """That holds for what viewers draw too, and for events, text and measured times."""
    system = helicopter(cells=3, capacity=4, posts=2, wall_clock=True)
    rng = np.random.default_rng(0)
    for each in topics(system, wall_clock=True):
        if each.call == "scene":  # of several components: test_orchestrator_recording_scene.py
            continue
        ports = system.ports.get(each.component, {})
        told = [
            {
                name: rng.normal(size=p.shape).astype(p.type.lower()) if p.shape else k
                for name, p in ports.items()
            }
            for k in range(3)
        ]
        if not each.component:
            words = {"level": 2, "name": "mpc", "kind": "set", "component": "mpc"}
            told = [words | dict.fromkeys(system.ports, 0.1) | {"message": "é" * k} for k in (0, 3)]
        packed, refusals = Stream({7: each}).records(rows(*told))
        assert refusals == []
        assert assemble(packed)[0] == written(one_by_one(Stream({7: each}), rows(*told)))


def test_topics_side_by_side_hold_what_each_holds_alone():
    """A row is the records of its topics, one behind the other; the index says where each is."""
    scalars = [topic([port("c", f"g.{k}{n}") for n in range(k)]) for k in (1, 2)]
    arrays = topic([port("c", "g.x"), port("c", "g.y", shape=(3,)), port("c", "g.z", shape=(2,))])
    side_by_side = {1: scalars[0], 2: arrays, 3: scalars[1]}
    values = {"g.10": 1.0, "g.20": 2.0, "g.21": 3.0, "g.x": 4.0}
    given_rows = rows(*(values | {"g.y": np.full(3, k), "g.z": np.full(2, -k)} for k in (0.5, 0.6)))
    told, _ = Stream(side_by_side).records(given_rows)
    data, index = assemble(told)
    assert data == written(told)
    for number, each in side_by_side.items():
        alone, _ = Stream({number: each}).records(given_rows)
        mine = [message for message in messages(told) if message[0] == number]
        assert mine == list(messages(alone))
        for count, (time, start) in enumerate(
            zip(index[number][::2], index[number][1::2], strict=True), 1
        ):
            expected = record(number, count, time, mine[count - 1][2])
            assert data[start : start + len(expected)] == expected


def test_messages_that_hold_different_variables_are_told_apart():
    """Inputs are laid out by the names there are; the numbers count on, the index is in order."""
    each = stream([port("c", name, causality="input") for name in "ab"], "inputs")
    given_rows = rows({"a": 1.0}, {"a": 2.0}, {"b": 3.0}, {"a": 4.0, "b": 5.0})
    told, _ = each.records(given_rows)
    data, index = assemble(told)
    assert data == written(told)
    assert index[7][::2] == [time for time, _ in given_rows]


def test_numbers_and_what_was_last_written_outlive_a_flush():
    """Batch by batch or all at once: the same records, with what has not changed left out."""
    held = {"kind": "Int64"}
    values = [0, 0, 1, 1, 1, 0, 2000, 2000, int("2000")]
    given_rows = rows(*({"g.n": value} for value in values))
    whole, parts = (stream([port("c", "g.n", **held)]) for _ in range(2))
    told, _ = whole.records(given_rows)
    assert len(told) == 4
    assert assemble(told)[0] == assemble(one_by_one(parts, given_rows))[0] == written(told)


def test_equal_arrays_are_no_change_whether_or_not_they_are_the_same():
    """Identity is a short cut only: a copy is compared by its bytes, a NaN too; -0.0 differs."""
    x = np.array([np.nan, 0.0])
    each = stream([port("c", "g.x", shape=(2,), variability="discrete")])
    given_rows = rows(*({"g.x": value} for value in (x, x, x.copy(), np.array([np.nan, -0.0]))))
    told, _ = each.records(given_rows)
    assert [time for time, *_ in told] == [given_rows[0][0], given_rows[3][0]]


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
    given_rows = rows(right, wrong, right)
    told, (refusal,) = each.records(given_rows)
    with pytest.raises(ValueError, match=rf"^/c/g at t = 0\.050 s: cannot be recorded, {what}"):
        raise refusal
    assert [time for time, *_ in told] == [given_rows[0][0], given_rows[2][0]]
    assert assemble(told)[0] == written(told)


def test_a_topic_that_cannot_be_written_leaves_those_beside_it_alone():
    """Theirs go on, from this batch on too; a change is told once, whatever was refused."""
    each = Stream({1: topic([port("c", "g.x")]), 2: topic([port("c", "h.y")], group="h")})
    given_rows = rows(*({"g.x": 0.0, "h.y": y} for y in (1.0, "two", 3.0, 4.0)))
    told = [row for part in (given_rows[:3], given_rows[3:]) for row in each.records(part)[0]]
    assert sorted(channel for channel, _, _ in messages(told)) == [1, 1, 1, 1, 2, 2, 2]
    assert assemble(told)[0] == written(told)
    later = rows(*({"g.x": 0.0, "h.y": y} for y in (1.0, 2.0, "three", 4.0)))
    each = Stream({1: topic([port("c", "g.x")]), 2: topic([port("c", "h.y")], group="h")})
    told = [row for part in (later[:2], later[2:]) for row in each.records(part)[0]]
    assert assemble(told)[0] == written(told)
    held = stream([port("c", "g.n", kind="Int64")])
    given_rows = rows(*({"g.n": n} for n in (5, 5, "x", 5, 6)))
    told, refusals = held.records(given_rows)
    assert ([time for time, *_ in told], len(refusals)) == ([given_rows[0][0], given_rows[4][0]], 1)


def test_numbers_that_would_lose_something_are_refused():
    """An array of fractions is no array of integers; one of integers is one of numbers."""
    whole = stream([port("c", "g.n", kind="Int64", shape=(2,))])
    told, (refusal,) = whole.records(rows({"g.n": np.array([0.7, 1.0])}))
    assert told == []
    assert "g at t = 0.000 s: cannot be recorded" in str(refusal)
    _, refusals = stream([port("c", "g.x", shape=(2,))]).records(rows({"g.x": np.array([1, 2])}))
    assert refusals == []


def test_arrays_need_not_lie_in_order_nor_be_of_the_type():
    """A transposed array, or integers for numbers, are written row by row as the schema says."""
    (each,) = channels("c", [port("c", "g.x", shape=(2, 3))])
    plain, *others = (
        written(Stream({1: signals(each, {})}).records(rows({"g.x": x}))[0])
        for x in (
            np.arange(6.0).reshape(2, 3),
            np.asfortranarray(np.arange(6.0).reshape(2, 3)),
            np.arange(6).reshape(2, 3),
        )
    )
    assert others == [plain, plain]
