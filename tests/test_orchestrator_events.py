"""Timed changes of inputs and parameters."""

import numpy as np
import pytest
from scripted import Row, Scripted, clock, gain, integrator, system

from orchestrator.assembly.description import Port
from orchestrator.assembly.settable import accepted, parsed
from orchestrator.errors import ScenarioError
from orchestrator.figures.trace import Trace
from orchestrator.run.simulate import simulate
from orchestrator.scenario.records import EventSpec

ROWS = [
    Row("u", "input"),
    Row("mode", "input", 0, items=("slow", "fast")),
    Row("curve", "input", shape=(2,)),
    Row("k", "parameter", 1.0, variability="tunable"),
    Row("far", "parameter", 1.0, "km", variability="tunable"),
    Row("mass", "parameter", 1.0),
    Row("y", "output"),
]


def scripted():
    """Return a 2 Hz component with y = k u."""

    def behave(values, time, step_size):
        values["y"] = values["k"] * values["u"]

    return Scripted("sampled", 2.0, list(ROWS), behave)


def test_an_input_changes_at_its_instant():
    """The value holds from the event's instant on, before anything else happens there."""
    trace = Trace()
    made = system({"plant": integrator()}, events=[EventSpec(0.5, "plant.u", 2)])
    simulate(made, [trace])
    np.testing.assert_allclose(trace["plant.y"][1][[0, 10, 11, 20]], [0.0, 0.0, 0.1, 1.0])
    assert trace.events[0] == (0.5, "set", "plant", "plant.u = 2.0")


def test_a_tunable_parameter_changes():
    """Parameters are told to listeners with their new value; ties keep the scenario's order."""
    told, trace = [], Trace()
    trace.parameters = lambda *what: told.append(what)
    events = [EventSpec(0.5, "c.k", 3.0), EventSpec(0.5, "c.u", 1.0), EventSpec(0.5, "c.u", 2.0)]
    simulate(system({"c": scripted()}, events=events), [trace])
    assert trace["c.y"][1].tolist() == [0.0, 6.0]
    assert told[1:] == [(500_000_000, "c", {"k": 3.0})]


def test_an_event_between_a_components_instants():
    """The component has the value at its own next instant."""
    trace = Trace()
    made = system({"c": scripted(), "tick": clock(20.0)}, events=[EventSpec(0.25, "c.u", 5.0)])
    simulate(made, [trace])
    assert trace["c.y"][1].tolist() == [0.0, 5.0]
    assert trace.events[0].time_s == 0.25


def test_an_event_where_nothing_happens_waits():
    """Between instants the next one counts: 20 and 8 Hz meet no instant at 0.025 s."""
    trace = Trace()
    made = system({"a": integrator(20.0), "b": clock(8.0)}, events=[EventSpec(0.025, "a.u", 1.0)])
    simulate(made, [trace])
    assert trace.events[0].time_s == 0.05


def test_a_feed_through_output_shows_the_change_at_once():
    """A continuous output that passes an unconnected input on follows it at the same instant."""
    trace = Trace()
    made = system({"g": gain(2.0, kind="continuous")}, events=[EventSpec(0.5, "g.u", 1.0)])
    simulate(made, [trace])
    assert trace["g.z"][1].tolist() == [0.0] * 10 + [2.0] * 11


@pytest.mark.parametrize(
    ("event", "key", "message"),
    [
        (EventSpec(0.5, "c.kk", 1.0), "set", "'c' has no variable or group 'kk', did you mean 'k'"),
        (EventSpec(0.5, "d.k", 1.0), "set", "no component 'd'"),
        (EventSpec(0.5, "c.y", 1.0), "set", "got output, expected input or tunable parameter"),
        (
            EventSpec(0.5, "c.mass", 1.0),
            "set",
            "parameter cannot change, got fixed, expected tunable",
        ),
        (
            EventSpec(0.5, "g.u", 1.0),
            "set",
            "input is connected to c.y, expected an unconnected one",
        ),
        (EventSpec(0.5, "c.k", "high"), "value", "wrong type, got 'high', expected a number"),
        (EventSpec(0.5, "c.far", True), "value", "wrong type, got true, expected a number in km"),
        (
            EventSpec(0.5, "c.curve", ["a", 1]),
            "value",
            "wrong type, got 'a', expected a number",
        ),
        (
            EventSpec(0.5, "c.curve", "high"),
            "value",
            "wrong type, got 'high', expected a list of shape 2, each a number",
        ),
        (EventSpec(0.5, "c.mode", "fats"), "value", "no such item, got 'fats', expected one of"),
        (EventSpec(0.5, "c.k", float("nan")), "value", "not a number, got nan, expected a number"),
        (EventSpec(0.26, "c.k", 1.0), "at_s", "got 0.26 s, expected 0.25 s or 0.3 s"),
        (EventSpec(-0.05, "c.k", 1.0), "at_s", "negative, got -0.05 s, expected 0 s or more"),
    ],
)
def test_events_are_checked_when_coupling(event, key, message):
    """Name, causality, value and time: each is a problem of its event."""
    with pytest.raises(ScenarioError) as caught:
        system({"c": scripted(), "g": gain()}, ["c.y -> g.u"], events=[event])
    (problem,) = caught.value.problems
    assert message in problem.message
    assert problem.message.startswith(f"event {event.set}: ")
    assert problem.path == ("events", 0, key)


def test_events_after_the_end_are_a_note():
    """A flight can be shortened: they are left out, and how many they are is said."""
    late = [EventSpec(at, "c.k", 1.0) for at in (1.0, 1.05, 7.0)]
    made = system({"c": scripted(), "tick": clock(20.0)}, events=late)
    assert made.notes[-1] == "2 events after the end at 1 s never happen"
    assert set(made.notes) <= set(made.log)
    one = system({"c": scripted()}, events=[EventSpec(4.0, "c.k", 1.0)], duration_s=2.0)
    assert one.notes == ("1 event after the end at 2 s never happens",)
    trace = Trace()
    simulate(one, [trace])
    assert [event.kind for event in trace.events] == ["end"]


def port(**more):
    """Return an input."""
    return Port("c", "u", "input", "continuous", **more)


def test_values_of_a_scenario_become_values_of_a_port():
    """Integers do for floats, item texts for enumerations, lists for arrays."""
    assert type(parsed(port(type="Float64"), 5)) is float
    assert parsed(port(type="Enumeration", items={0: "slow", 4: "fast"}), "fast") == 4
    curve = parsed(port(type="Float64", shape=(2,)), [1, 2])
    assert curve.dtype == np.float64
    assert parsed(port(type="Int64", shape=(2,)), [1, 2]).dtype == np.int64
    kinds = {"type": "Enumeration", "items": {0: "slow", 4: "fast"}}
    assert parsed(port(**kinds, shape=(2,)), ["fast", 0]).tolist() == [4, 0]
    assert parsed(port(type="Binary", shape=(2,)), ["00", "ff01"]).tolist() == [b"\0", b"\xff\1"]
    with pytest.raises(ValueError, match=r"wrong shape, got \(3,\), expected \(2,\)"):
        parsed(port(type="Float64", shape=(2,)), [1, 2, 3])


@pytest.mark.parametrize(
    "kind",
    ["Integer", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))],
)
def test_integers_are_within_their_type(kind):
    """The least and the greatest value of a type are values of it, one beyond is out of range."""
    bits = 32 if kind == "Integer" else int(kind.removeprefix("U").removeprefix("Int"))
    low, high = (0, 2**bits - 1) if kind[0] == "U" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for value in (low, high):
        assert accepted(port(type=kind), value, {}) == value
    for value in (low - 1, high + 1, 10**30):
        told = f"input 'u' is out of range, got {value}, expected at least "
        with pytest.raises(ValueError, match=told):
            accepted(port(type=kind), value, {})
        with pytest.raises(ValueError, match=told):
            accepted(port(type=kind, shape=(2,)), [1, value], {})


@pytest.mark.parametrize("shape", [(), (2,)])
@pytest.mark.parametrize(
    ("kind", "raw", "told"),
    [
        ("Float64", 10**400, "out of range, got 1000.* expected a number of at most 1.8e\\+308"),
        ("Float64", True, "wrong type, got true, expected a number"),
        ("Float64", "1", "wrong type, got '1', expected a number"),
        ("Float64", None, "wrong type, got null, expected a number"),
        ("Int64", False, "wrong type, got false, expected a whole number"),
        ("Int64", 1.0, "wrong type, got 1.0, expected a whole number"),
        ("Boolean", 1, "wrong type, got 1, expected true or false"),
        ("String", 1, "wrong type, got 1, expected text"),
        ("Enumeration", 5, "not an item, got 5, expected 0 or 1"),
        ("Enumeration", "c", "no such item, got 'c', expected one of"),
    ],
)
def test_every_element_is_of_the_type(kind, shape, raw, told):
    """In a list nothing does that would not do alone."""
    one = port(type=kind, shape=shape, items={0: "a", 1: "b"} if kind == "Enumeration" else {})
    with pytest.raises(ValueError, match=f"^{told}"):
        accepted(one, [raw, raw] if shape else raw, {})
