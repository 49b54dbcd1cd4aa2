"""A run in a viewer: what it is sent, what it may ask for, and that it can never get in the way."""

import base64
import json
import socket
import sys
import threading
from dataclasses import replace
from pathlib import Path
from time import sleep

import numpy as np
import pytest
import small_components
from fake_system import TICK_NS, flight, helicopter, tell
from hypothesis import given
from hypothesis import strategies as st
from live_viewer import SUBPROTOCOL, Viewer
from mcap.reader import make_reader
from scripted import Row, Scripted, system

from orchestrator.assembly.build import build
from orchestrator.assembly.description import Port
from orchestrator.assembly.settable import accepted, bounds
from orchestrator.command.app import status
from orchestrator.figures.trace import Trace
from orchestrator.flight import fly, fly_system
from orchestrator.listener import Result
from orchestrator.live.line import Line
from orchestrator.live.live import Live
from orchestrator.live.pace import LATE_S, Pace
from orchestrator.playback.replay import replay
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.run.events import Change, changes, read, written
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load

QUIET = ["recording.wall_clock=false"]


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("glide.yaml").write_text(small_components.SCENARIO)
    Path("ground.txt").write_text(small_components.GROUND)


class Show:
    """A scenario flown live on a thread, paused at its start until a viewer lets it go."""

    def __init__(self, overrides=(), *, out="live.mcap", **options):
        self.system = build(load("glide.yaml", [*QUIET, *overrides]))
        self.live = Live(self.system, port=0, **options)
        self.out = Path(out)
        self.flight = None
        self._thread = threading.Thread(target=self._fly)

    def __enter__(self):
        with Viewer(self.live.address, subscribes=False) as viewer:
            viewer.set(paused=True)
            viewer.wait(lambda: viewer.answers("parameterValues"))
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.live.stop()
        self._thread.join()

    def viewer(self):
        """Return a viewer that has been given something of every topic that holds a state."""
        viewer = Viewer(self.live.address)
        viewer.wait(lambda: viewer.messages.get("/pilot/parameters"))
        while not self.live._joined_at or self.live._joined:
            sleep(0.01)
        return viewer

    def end(self):
        """Wait for the end and return the flight."""
        self._thread.join()
        return self.flight

    def _fly(self):
        self.flight = fly_system(
            self.system, self.out, listeners=[self.live], requests=self.live.requests
        )


def recorded(path):
    """Return schema, metadata, and (log time, bytes) of every message, by topic."""
    with Path(path).open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        topics = {
            channel.topic: (summary.schemas[channel.schema_id], channel.metadata, [])
            for channel in summary.channels.values()
        }
        for _, channel, message in reader.iter_messages():
            topics[channel.topic][2].append((message.log_time, message.data))
    return topics


def test_a_viewer_gets_the_bytes_of_the_recording():
    """Every topic with the schema and metadata of the file, every message with its time."""
    with Show() as show, show.viewer() as viewer:
        viewer.set(speed=20, paused=False)
        show.end()
    topics = recorded(show.out)
    assert viewer.channels.keys() == topics.keys()
    for name, (schema, metadata, messages) in topics.items():
        channel = viewer.channels[name]
        assert (channel["schemaName"], channel["encoding"]) == (schema.name, "protobuf")
        assert base64.b64decode(channel["schema"]) == schema.data
        assert channel.get("metadata", {}) == metadata
        assert viewer.messages[name] == messages, name


def test_the_server_tells_simulated_time_which_never_goes_back():
    """Viewers draw over it; what they are sent is never older than what they were sent."""
    with Show() as show, show.viewer() as viewer:
        viewer.set(speed=20, paused=False)
        show.end()
    assert {"time", "parameters"} <= set(viewer.said[0]["capabilities"])
    assert viewer.times == sorted(viewer.times)
    assert set(viewer.times) <= {EPOCH_NS + k * 50_000_000 for k in range(201)}
    assert viewer.times[-1] > EPOCH_NS
    for messages in viewer.messages.values():
        times = [time for time, _ in messages]
        assert times == sorted(times)


def test_every_run_is_a_session_of_its_own():
    """A viewer that connects again knows that what it has kept is of another run."""
    sessions = set()
    for _ in range(2):
        live = Live(build(load("glide.yaml")), port=0)
        with Viewer(live.address) as viewer:
            sessions.add(viewer.said[0]["sessionId"])
        live.stop()
    assert len(sessions) == 2


def test_recordings_with_and_without_a_viewer_are_the_same():
    """Without changes and without the wall clock they are byte-identical."""
    fly("glide.yaml", QUIET, out="alone.mcap")
    with Show(speed=float("inf")) as show, show.viewer() as viewer:
        viewer.set(paused=False)
        show.end()
    assert Path("alone.mcap").read_bytes() == show.out.read_bytes()


def test_what_a_viewer_changes_is_an_event_and_is_repeated_by_a_replay():
    """It acts from the next instant on; the second flight is the same to the last bit."""
    fly("glide.yaml", QUIET, out="alone.mcap")
    with Show() as show, show.viewer() as viewer:
        viewer.set(pilot__height_m=61.1)
        viewer.set(speed=4, paused=False)
        viewer.wait(lambda: len(viewer.messages["/glider/state"]) > 20)
        viewer.set(pilot__height_m=72, speed=1000)
        show.end()
    recording = Recording.open(show.out)
    made = [event.message for event in recording.events if event.kind == "set"]
    assert sorted(made) == [f"pilot.height_m = {value}" for value in (50.0, 61.1, 72.0)]
    assert recording["pilot.height_m"][1].tolist()[:2] == [100.0, 61.1]
    altitude = "glider.state.altitude"
    assert not np.array_equal(recording[altitude][1], Recording.open("alone.mcap")[altitude][1])
    assert replay(recording, Path("again.mcap")).differences == []


def test_a_viewer_cannot_ask_for_what_is_no_value():
    """It is told why, the flight goes on as it was, and nothing of it is recorded."""
    with Show() as show, show.viewer() as viewer:
        viewer.set(pilot__height_m="high", pilot__gain_per_s=2.0, speed=0, paused=1)
        viewer.wait(lambda: len(viewer.answers("status")) >= 4)
        viewer.set(speed=1000, paused=False)
        show.end()
    warnings = [one["message"] for one in viewer.answers("status") if one["level"] == 1]
    assert len(warnings) == 4
    assert warnings[0] == "pilot.height_m: wrong type, got 'high', expected a number in m"
    assert "pilot.gain_per_s: cannot be set, got 2.0, expected one of" in warnings[1]
    events = Recording.open(show.out).events
    assert [event.message for event in events if event.kind == "set"] == ["pilot.height_m = 50.0"]


def test_values_out_of_bounds_are_refused_before_they_reach_the_component():
    """Bounds are those of the description, and those of the parameter's field."""
    made = build(load("glide.yaml"))
    port = made.ports["pilot"]["gain_per_s"]
    found = bounds(made.plans)
    assert accepted(port, 3, found) == 3.0
    with pytest.raises(
        ValueError, match=r"^out of range, got -1\.0 1/s, expected a number >= 0 1/s$"
    ):
        accepted(port, -1, found)
    with pytest.raises(ValueError, match=r"parameter 'gain_per_s' is out of range, got 3\.0 1/s"):
        accepted(replace(port, max=2.0), 3, found)


def test_a_change_that_ends_the_flight_is_repeated_too():
    """It is recorded before it is made."""

    class Brittle(Scripted):
        def set(self, values):
            if values.get("k", 0.0) > 1.0:
                raise ValueError("too much")
            super().set(values)

    row = Row("k", "parameter", 1.0, variability="tunable")
    made = system({"c": Brittle("sampled", 2.0, [row, Row("y", "output")], lambda *_: None)})
    change = Change(0, made.ports["c"]["k"], 2.0)
    trace = Trace()
    result = simulate(made, [trace], requests=lambda time_ns: [change] if time_ns else [])
    assert result.outcome == "component error"
    assert trace.events[0] == (0.5, "set", "c", "c.k = 2.0")


@given(
    st.one_of(
        st.floats(allow_nan=False), st.integers(-(2**63), 2**63 - 1), st.booleans(), st.text(),
        st.binary(), st.lists(st.floats(allow_nan=False), min_size=1).map(np.array),
    )
)  # fmt: skip
def test_a_written_change_is_read_back_as_it_was(value):
    """Of every type, to the last bit."""
    kinds = {bool: "Boolean", int: "Int64", str: "String", bytes: "Binary"}
    port = Port(
        "c", "x.y", "parameter", "tunable", kinds.get(type(value), "Float64"), np.shape(value)
    )
    spec = read(0.5, written(Change(0, port, value)))
    (again,) = changes([spec], {"c": {"x.y": port}}, [], None)
    assert (again.port, type(again.value)) == (port, type(value))
    assert np.asarray(again.value).tobytes() == np.asarray(value).tobytes()


def test_a_viewer_pauses_and_plays():
    """By the playback bar of Foxglove or by two parameters; nothing happens while paused."""
    with Show() as show, show.viewer() as viewer:
        before = len(viewer.messages["/glider/state"])
        viewer.control(0, 4.0)
        viewer.wait(lambda: len(viewer.messages["/glider/state"]) > before + 20)
        viewer.control(1, 4.0)
        viewer.wait(lambda: viewer.states and viewer.states[-1][0] == 1)
        viewer.send(op="getParameters", parameterNames=["paused", "speed"], id="get")
        viewer.wait(lambda: viewer.answers("parameterValues"))
        values = {
            p["name"]: p["value"] for p in viewer.answers("parameterValues")[-1]["parameters"]
        }
        assert values["speed"] == 4.0
        assert show.flight is None
        viewer.set(speed=1000, paused=False)
        assert show.end().result.outcome == "flown"
    assert viewer.states[-1][0] == 3  # ended


def test_a_paused_run_can_be_interrupted():
    """Ctrl-C reaches a run that waits."""
    asked = []
    made = build(load("glide.yaml"))
    live = Live(made, port=0, interrupt=lambda: asked.append(0) or len(asked) > 2)
    live._desk.wishes.put(("paused", True))
    flown = fly_system(
        made, interrupt=lambda: len(asked) > 2, listeners=[live], requests=live.requests
    )
    assert (flown.result.outcome, flown.result.time_ns) == ("interrupted", 0)


class Hill:
    """Terrain that the scene can draw."""

    def surface(self):
        """Return posts."""
        posts = np.linspace(-500.0, 500.0, 11)
        return posts, posts, np.zeros((11, 11))


def test_who_comes_late_gets_the_scene_and_the_last_of_everything():
    """Ground and craft are sent once; a viewer that comes later is given them all the same."""
    made = replace(helicopter(cells=20, capacity=8, posts=5), resources={"terrain": Hill()})
    scene = {**made.scenario.scene, "terrain": "${terrain}"}
    made = replace(made, scenario=replace(made.scenario, scene=scene))
    calls = flight(made, 3.0)
    tell(Recorder(Path("alone.mcap")), made, calls)
    last = {
        name: messages[-1][1] for name, (*_, messages) in recorded("alone.mcap").items() if messages
    }
    live = Live(made, port=0, speed=float("inf"))
    live.open(made)
    for call, arguments in calls:
        getattr(live, call)(*arguments)
        live.requests(arguments[0])
    with Viewer(live.address, subscribes=False) as viewer:
        viewer.wait(lambda: viewer.channels.keys() >= last.keys())
        viewer.subscribe([topic for topic in last if topic not in ("/events", "/log")])
        live._desk.wishes.put(("paused", True))
        live._interrupt = lambda: all(viewer.messages.values())
        live.requests(60 * TICK_NS)
        live.close(Result("flown", "", 60 * TICK_NS, {}, 1.0, 1.0))
    assert {"/scene/terrain", "/scene/terrain_points", "/scene/craft", "/tf"} <= last.keys()
    for topic, messages in viewer.messages.items():
        assert messages == [(EPOCH_NS + 60 * TICK_NS, last[topic])], topic


def test_a_viewer_that_stops_reading_or_vanishes_holds_nothing_up():
    """More is sent than all buffers hold: the run ends all the same, and the other sees its end."""
    made = helicopter(cells=5000, capacity=8, posts=5, wall_clock=True)
    calls = flight(made, 20.0)
    live = Live(made, port=0, speed=float("inf"))
    live.open(made)
    with Viewer(live.address) as viewer:
        viewer.wait(lambda: "/log" in viewer.channels)
        deaf, gone = (_deaf(live.address, viewer.channels) for _ in range(2))
        sent = 0
        for call, arguments in calls:
            getattr(live, call)(*arguments)
            live.requests(arguments[0])
            if call == "outputs" and arguments[1] == "sensor":
                sent += sum(v.nbytes for v in arguments[2].values() if isinstance(v, np.ndarray))
            if arguments[0] == 10 * 10**9:
                gone.close()
        live.close(Result("flown", "", 20 * 10**9, {}, 1.0, 1.0))
        viewer.wait(lambda: viewer.states and viewer.states[-1][0] == 3)
        assert sent > 4_000_000
        assert viewer.messages["/log"]
        assert viewer.messages["/wall_clock"]
    deaf.close()


def _deaf(address, channels):
    """Return the socket of a viewer that watches everything and reads nothing."""
    host, port = address.removeprefix("ws://").split(":")
    talk = socket.create_connection((host, int(port)))
    talk.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    lines = (
        f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n"
    )
    talk.sendall(lines.encode())
    assert talk.recv(4096).startswith(b"HTTP/1.1 101")
    wanted = [{"id": k, "channelId": c["id"]} for k, c in enumerate(channels.values())]
    text = json.dumps({"op": "subscribe", "subscriptions": wanted}).encode()
    head = b"\x81" + bytes([0x80 | 126]) + len(text).to_bytes(2, "big") + bytes(4)  # mask of zeros
    talk.sendall(head + text)
    return talk


def test_simulated_time_is_due_when_the_wall_clock_says_so():
    """Twice the speed is half the wait; who is late does not catch up; a pause has no end."""
    pace = Pace(2.0)
    assert pace.wait_s(0, 100.0) == 0.0
    assert pace.wait_s(1_000_000_000, 100.0) == 0.5
    assert pace.wait_s(1_000_000_000, 100.75) == 0.0
    assert pace.wait_s(2_000_000_000, 100.75) == 0.25
    assert pace.wait_s(2_000_000_000, 101.0 + 2 * LATE_S) == 0.0
    assert pace.wait_s(3_000_000_000, 101.0 + 2 * LATE_S) == 0.5
    pace.change(is_paused=True)
    assert pace.wait_s(3_000_000_000, 200.0) == float("inf")
    pace.change(is_paused=False, speed=float("inf"))
    assert [pace.wait_s(t, 300.0) for t in (3_000_000_000, 9_000_000_000)] == [0.0, 0.0]


def test_one_line_says_how_it_goes(monkeypatch):
    """Time, height above ground, speed, cost; then how fast it goes, or that it is paused."""
    clock = iter((100.0, 100.1, 102.0))
    monkeypatch.setattr("orchestrator.live.line.perf_counter", lambda: next(clock))
    shown = []
    line = Line(helicopter(cells=5, capacity=8, posts=5), shown.append)
    line.update(0, is_paused=True)
    assert shown == ["t 0.0 s, paused"]
    velocity = {"velocity.north": 3.0, "velocity.east": 4.0, "velocity.down": 9.0}
    line.outputs("vehicle", {"clearance": 12.34, **velocity})
    line.outputs("mpc", {"cost.after": 0.00123})
    line.update(1_000_000_000, is_paused=False)  # too soon
    assert len(shown) == 1
    line.update(1_000_000_000, is_paused=False)
    assert shown[1:] == ["t 1.0 s, height 12.3 m, speed 5.0 m/s, cost 0.00123, 0.50 x real time"]


def test_the_command_flies_live(capsys):
    """It says where to look; the recording is what it is without."""
    fly("glide.yaml", QUIET, out="alone.mcap")
    options = ["--set", QUIET[0], "--live", "--speed", "max", "--port", "0"]
    assert status(["run", "glide.yaml", *options]) == 0
    assert "live: ws://127.0.0.1:" in capsys.readouterr().err
    assert Path("alone.mcap").read_bytes() == Path("glide.mcap").read_bytes()


def test_a_missing_extra_is_one_line_that_says_how_to_install_it(capsys, monkeypatch):
    """The package is needed for this alone."""
    monkeypatch.setitem(sys.modules, "foxglove", None)
    monkeypatch.delitem(sys.modules, "orchestrator.live.live")
    assert status(["run", "glide.yaml", "--live"]) == 2
    wanted = "--live: needs foxglove-sdk, got none, expected `pip install foxglove-sdk`\n"
    assert capsys.readouterr().err.endswith(wanted)


def test_a_port_that_is_taken_is_one_line(capsys):
    """The flight does not begin."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert status(["run", "glide.yaml", "--live", "--port", port]) == 2
    assert f"live: cannot listen on port {port}, got" in capsys.readouterr().err
    assert not Path("glide.mcap").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--speed", "2"], "run: --speed and --port are for --live"),
        (["--live", "--speed", "0"], "--speed: got 0.0, expected a number above 0 or 'max'"),
        (["--live", "--speed", "nan"], "--speed: got nan, expected a number above 0 or 'max'"),
    ],
)
def test_speeds_that_make_no_sense_are_refused(capsys, options, message):
    """One line, exit code 2."""
    assert status(["run", "glide.yaml", *options]) == 2
    assert message in capsys.readouterr().err
