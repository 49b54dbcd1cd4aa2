"""Reading recordings back: bit for bit what was told, or one line that says what is wrong."""

import numpy as np
import pytest
from fake_system import ANGLES, POSITION, TICK_NS, flight, helicopter, make_system, port, tell
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from orchestrator.figures.trace import Trace
from orchestrator.listener import Result
from orchestrator.recording.reader import Event, Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.scenario.load import load
from orchestrator.scenario.records import EventSpec

SYSTEM = helicopter(cells=20, capacity=8, posts=5, wall_clock=True)
CALLS = flight(SYSTEM, 2.0)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    tell(Recorder(path), SYSTEM, CALLS)
    return path


def test_a_recording_holds_what_a_trace_holds(file):
    """Names, times and values are those of the in-memory trace, to the last bit."""
    trace = Trace()
    tell(trace, SYSTEM, CALLS)
    recording = Recording.open(file)
    assert set(trace.names) <= set(recording.names)
    for name in trace.names:
        (times, values), (told_times, told) = recording[name], trace[name]
        if len(times) < len(told_times):  # a discrete group: the values hold in between
            newest = np.searchsorted(times, told_times, side="right") - 1
            values = values[newest]
        else:
            assert times.tobytes() == told_times.tobytes()
        assert values.dtype == told.dtype
        assert values.tobytes() == told.tobytes()
    assert [tuple(event) for event in trace.events] == [
        (e.time_s, e.kind, e.component, e.message) for e in recording.events
    ]


VALUES = st.tuples(
    st.floats(),
    st.integers(-(2**63), 2**63 - 1),
    st.booleans(),
    st.text(),
    st.sampled_from([1, 5]),
    st.binary(),
)


@given(st.lists(VALUES, min_size=1, max_size=4), st.integers(0, 3), st.integers(1, 3))
@settings(deadline=None, max_examples=40)
def test_every_value_comes_back(tmp_path_factory, rows, n, m):
    """Numbers, booleans, text, enumerations, bytes and arrays of any of them come back exactly."""
    kinds = ("Float64", "Int64", "Boolean", "String", "Enumeration", "Binary")
    items = {"items": {1: "one", 5: "five"}}
    ports = [
        port("c", f"{group}.{kind}", kind=kind, shape=shape, **(items if kind[0] == "E" else {}))
        for group, shape in (("one", ()), ("many", (m, n)))
        for kind in kinds
        if 0 not in shape
    ]
    system = make_system(ports)
    calls = []
    for k, row in enumerate(rows):
        values = {f"one.{kind}": value for kind, value in zip(kinds, row, strict=True)}
        if n:
            values |= {
                f"many.{kind}": np.full(
                    (m, n), value, object if kind in ("String", "Binary") else None
                )
                for kind, value in zip(kinds, row, strict=True)
            }
        calls.append(("outputs", (k * TICK_NS, "c", values)))
    path = tmp_path_factory.mktemp("values") / "a.mcap"
    tell(Recorder(path), system, calls)
    recording = Recording.open(path)
    assert set(recording.names) == {str(each) for each in ports}
    for each in ports:
        times, values = recording[str(each)]
        told = [arguments[2][each.name] for _, arguments in calls]
        assert times.tolist() == [k * TICK_NS / 1e9 for k in range(len(rows))]
        assert values.shape == (len(rows), *each.shape)
        if each.kind == "float":
            assert values.tobytes() == np.array(told).tobytes()
        else:
            assert values.tolist() == [v.tolist() if each.shape else v for v in told]


def test_inputs_and_parameters_have_their_own_times(tmp_path):
    """A sample is there only where the variable was told; parameters are told all together."""
    ports = [port("mpc", name, causality="parameter") for name in ("speed", "height")]
    ports += [port("mpc", name, causality="input") for name in ("a", "b")]
    events = tuple(EventSpec(0.0, f"mpc.{name}", 1.0) for name in ("a", "b"))
    calls = [
        ("parameters", (0, "mpc", {"speed": 30.0, "height": 10.0})),
        ("inputs", (0, "mpc", {"a": 1.0})),
        ("inputs", (TICK_NS, "mpc", {"b": 2.0})),
        ("parameters", (TICK_NS, "mpc", {"height": 5.0})),
    ]
    path = tmp_path / "a.mcap"
    tell(Recorder(path), make_system(ports, events=events), calls)
    recording = Recording.open(path)
    samples = {name: [each.tolist() for each in recording[name]] for name in recording.names}
    assert samples == {
        "mpc.speed": [[0.0, 0.05], [30.0, 30.0]],
        "mpc.height": [[0.0, 0.05], [10.0, 5.0]],
        "mpc.a": [[0.0], [1.0]],
        "mpc.b": [[0.05], [2.0]],
    }


def test_descriptions_come_back(file):
    """Units, bounds, items and shapes of the signals are those of the ports."""
    recording = Recording.open(file)
    for ports in SYSTEM.ports.values():
        for name, each in ports.items():
            signal = recording.signals[f"{each.component}.{name}"]
            assert signal.unit == (each.unit.name if each.unit else "1")
            assert (signal.min, signal.max, signal.items) == (each.min, each.max, each.items)
            assert signal.shape == each.shape


def test_everything_said_about_the_run_comes_back(file):
    """Ending, events, measured times, roles and versions are there."""
    recording = Recording.open(file)
    assert recording.result == Result("flown", "", 2 * 10**9, {"overruns.mpc": 3}, 1.5, 1.6)
    assert recording.events == [Event(2.0, "end", "", "end of the scenario")]
    assert recording.scene == SYSTEM.scenario.scene
    assert recording.provenance["time_base"] == "simulated"
    told = [a[2] for call, a in CALLS if call == "wall_clock" and a[1] == "mpc"]
    assert recording.wall_clock["mpc"].tolist() == told


def test_without_wall_clock_there_is_none(tmp_path):
    """None, not an empty table: nothing was measured."""
    path = tmp_path / "a.mcap"
    tell(Recorder(path, wall_clock=False), SYSTEM, CALLS[:3])
    recording = Recording.open(path)
    assert recording.wall_clock is None
    assert recording.result.cpu_s == 0.0


def test_an_unknown_signal_names_the_nearest(file):
    """A misspelt name is answered with the right one."""
    with pytest.raises(KeyError, match=r"got 'vehicle.state.nort', .*'vehicle.state.north'"):
        Recording.open(file)["vehicle.state.nort"]


def test_any_cut_is_one_line_that_names_the_file(file, tmp_path):
    """However much is missing at the end, reading is a ValueError of one line."""
    whole = file.read_bytes()
    path = tmp_path / "cut.mcap"
    for size in [*range(0, len(whole) - 1, 1009), *range(len(whole) - 40, len(whole))]:
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"cut\.mcap: is (cut short|no MCAP)") as caught:
            Recording.open(path)
        assert "\n" not in str(caught.value)


def test_damaged_and_foreign_files_are_refused(file, tmp_path):
    """A flipped bit fails a CRC; text is no MCAP file; a missing file says so."""
    damaged = bytearray(file.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match="cut short or damaged"):
        Recording.open(path)
    path.write_text("title: not a recording\n")
    with pytest.raises(ValueError, match="is no MCAP file"):
        Recording.open(path)
    with pytest.raises(OSError, match="cannot be read, No such file"):
        Recording.open(tmp_path / "missing.mcap")


def test_the_attached_scenario_can_be_loaded_again(file, tmp_path):
    """What is attached is a scenario file: its loader makes the same records of it."""
    path = tmp_path / "base.yaml"
    path.write_text(
        "title: a flight\nduration_s: 1\nresources: {hill: {use: 'plant.terrain:Terrain'}}\n"
        "components:\n  a: {use: 'x:Y', rate_hz: 20, parameters: {text: '1e3', list: [1, 2.5]}}\n"
        "  b: {use: 'x:Y', latency_s: 0.5}\n"
        "connections: [a.x -> b.x, {from: b.y, to: a.y, delay_s: 0.1}]\n"
        "events: [{at_s: 0.5, set: b.z, value: 3}]\nscene: {pose: a.pose}\nend_on: [a.outcome]\n"
    )
    scenario = load(path)
    system = make_system([port("a", f"pose.{n}") for n in (*POSITION, *ANGLES)])
    object.__setattr__(system, "scenario", scenario)
    recorded = tmp_path / "a.mcap"
    tell(Recorder(recorded), system, [("log", (0, 20, "a", "b"))])
    again = tmp_path / "again.yaml"
    again.write_bytes(attachment(recorded, "scenario.yaml"))
    fields = set(vars(scenario)) - {"folder", "origins"}
    assert {n: getattr(load(again), n) for n in fields} == {n: getattr(scenario, n) for n in fields}


def attachment(path, name):
    with path.open("rb") as stream:
        return next(a.data for a in make_reader(stream).iter_attachments() if a.name == name)
