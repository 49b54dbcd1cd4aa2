"""Comparing recordings: equal where the simulation is, and the first difference named where not."""

import json

import numpy as np
import pytest
from fake_system import TICK_NS, flight, helicopter, make_system, port, tell

from orchestrator.listener import Result
from orchestrator.recording.diff import Difference, diff, info
from orchestrator.recording.recorder import Recorder

SYSTEM = helicopter(cells=5, capacity=4, posts=3, wall_clock=True)


@pytest.fixture
def record(tmp_path):
    def record(name, calls, result=None, system=SYSTEM):
        path = tmp_path / f"{name}.mcap"
        tell(Recorder(path), system, calls, result)
        return path

    return record


def changed(calls, number, name, value):
    """Return the calls with one output of the n-th publishing of its component changed."""
    component, _, variable = name.partition(".")
    at = [k for k, (c, a) in enumerate(calls) if c == "outputs" and a[1] == component][number]
    call, (time_ns, _, values) = calls[at]
    return [*calls[:at], (call, (time_ns, component, values | {variable: value})), *calls[at + 1 :]]


def test_measured_times_are_no_difference(record):
    """Wall clock, CPU time and missed deadlines differ from run to run and do not count."""
    calls = flight(SYSTEM, 1.0)
    slow = [(c, (*a[:2], 9.0) if c == "wall_clock" else a) for c, a in calls]
    slow.append(("event", (10**9, "overrun", "mpc", "step took 9 s")))
    results = [Result("flown", "", 10**9, {"overruns.mpc": k}, k, k) for k in range(2)]
    assert diff(record("a", calls, results[0]), record("b", slow, results[1])) == []


@pytest.mark.parametrize(
    ("name", "a", "b", "texts"),
    [
        ("vehicle.state.u", 0.1 + 0.2, 0.3, ("0.30000000000000004", "0.3")),
        ("vehicle.state.u", 0.0, -0.0, ("0.0", "-0.0")),
        ("vehicle.valid", True, False, ("True", "False")),
        ("vehicle.outcome", 0, 2, ("0", "2")),
    ],
)
def test_the_first_differing_value_is_named(record, name, a, b, texts):
    """Signal, time and both values are told, to the last bit, once per signal."""
    calls = flight(SYSTEM, 1.0)
    one, two = (changed(changed(calls, 7, name, v), 9, name, v) for v in (a, b))
    found = diff(record("a", one), record("b", two))
    assert found == [Difference(name, "value", 7 * TICK_NS / 1e9, *texts)]
    assert str(found[0]) == f"{name}: value differs at t = 0.350 s, got {texts[0]} and {texts[1]}"


def test_a_nan_equals_itself(record):
    """The same bits are the same value, even where they are no number."""
    calls = changed(flight(SYSTEM, 1.0), 3, "vehicle.state.u", float("nan"))
    other = changed(calls, 5, "vehicle.state.v", 0.5)
    assert [d.name for d in diff(record("a", calls), record("b", other))] == ["vehicle.state.v"]


def test_the_element_of_an_array_is_named(record):
    """Of arrays the first element that differs is told with its index."""
    system = make_system([port("mpc", "s", shape=(2, 3))])
    values = np.zeros((2, 2, 3))
    values[1, 1, 2] = 7.0
    paths = [record(k, [("outputs", (0, "mpc", {"s": values[k]}))], system=system) for k in (0, 1)]
    assert diff(*paths) == [Difference("mpc.s", "value", 0.0, "[1, 2] 0.0", "[1, 2] 7.0")]


def test_missing_signals_counts_and_times_are_told(record):
    """A signal that is only in one, one with fewer samples, one published at another time."""
    x, y = port("a", "x"), port("b", "y")
    at = [("outputs", (k * TICK_NS, "a", {"x": 0.0})) for k in range(3)]
    both = make_system([x, y])
    short = record("short", at[:2], system=make_system([x]))
    whole = record("whole", at, system=both)
    end = Difference("end_ns", "ending", None, str(TICK_NS), str(2 * TICK_NS))
    assert diff(short, whole) == [
        Difference("a.x", "samples", 2 * TICK_NS / 1e9, "2", "3"),
        Difference("b.y", "missing", None, "missing", "there"),
        end,
    ]
    late = record("late", [at[0], at[2]], system=make_system([x]))
    assert diff(short, late)[0] == Difference("a.x", "time", 0.05, "50000000 ns", "100000000 ns")


def test_other_units_shapes_and_types_are_told(record):
    """A variable of the same name that is another thing is a difference of its own."""
    thing = ("outputs", (0, "a", {"x": 0}))
    ports = [
        port("a", "x", "m"),
        port("a", "x", "rad"),
        port("a", "x", "1", kind="Int64"),
        port("a", "x", kind="Enumeration", items={0: "zero"}),
    ]
    paths = [record(k, [thing], system=make_system([p])) for k, p in enumerate(ports)]
    whats = [diff(paths[k], paths[m])[0].what for k, m in ((0, 1), (1, 2), (2, 3))]
    assert whats == ["unit", "unit", "items"]
    one = make_system([port("a", "x", "1")])
    assert diff(record("float", [thing], system=one), paths[2])[0].what == "type"


def test_events_and_ending_are_compared(record):
    """The first event that differs and another outcome are differences."""
    calls = flight(SYSTEM, 0.5)
    more = [*calls, ("event", (5 * 10**8, "set", "mpc", "speed"))]
    hit = Result("collision", "vehicle hit the ground", 5 * 10**8)
    found = diff(record("a", calls), record("b", more, hit))
    assert [(d.name, d.what, d.a) for d in found] == [
        ("/events", "event", "none"),
        ("outcome", "ending", "flown"),
        ("reason", "ending", ""),
    ]


def test_info_counts_what_is_there(record):
    """Topics with message type, count, rate and units; title, outcome and duration."""
    path = record("a", flight(SYSTEM, 2.0))
    found = info(path)
    json.dumps(found)
    topics = {topic["topic"]: topic for topic in found["topics"]}
    assert (found["title"], found["outcome"], found["duration_s"]) == (
        "a made-up flight",
        "flown",
        2.0,
    )
    assert found["bytes"] == path.stat().st_size
    state = topics["/vehicle/state"]
    assert (state["message"], state["count"], state["rate_hz"]) == (
        "hedgehop.vehicle.State",
        41,
        20.0,
    )
    assert topics["/mpc/cost"]["rate_hz"] == 2.0
    assert topics["/vehicle/velocity"]["units"] == {
        f"vehicle.velocity.{name}": "m/s" for name in ("north", "east", "down")
    }
    assert topics["/log"]["rate_hz"] is None


def test_unreadable_files_are_named(record, tmp_path):
    """Comparing with a file that is cut short is a ValueError that names it."""
    path = record("a", flight(SYSTEM, 0.5))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"cut\.mcap"):
        diff(path, cut)
