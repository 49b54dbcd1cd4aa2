"""The recorder: what other programs find in its files, and what is left when things go wrong."""

import errno
import json
import logging
import weakref
from contextlib import suppress
from io import FileIO

import numpy as np
import pytest
from fake_system import SCENE, TICK_NS, flight, helicopter, make_system, port, tell
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from orchestrator.assembly.system import Link
from orchestrator.listener import Result
from orchestrator.recording import recorder
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.recorder import Recorder
from orchestrator.scenario.records import ComponentSpec, EventSpec

SYSTEM = helicopter(cells=20, capacity=8, posts=5, wall_clock=True)
CALLS = flight(SYSTEM, 3.0)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    tell(Recorder(path, metrics=lambda result: {"outcome": result.outcome}), SYSTEM, CALLS)
    return path


def messages(path, topic=None):
    """Return (channel, raw, decoded) of all messages, by `mcap` and `mcap_protobuf` alone."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        topics = None if topic is None else [topic]
        return [(c, m, d) for _, c, m, d in reader.iter_decoded_messages(topics=topics)]


def record(path, system, calls, **options):
    tell(Recorder(path, **options), system, calls)
    return path


def test_other_programs_read_every_signal_with_its_unit(file):
    """`mcap` and `mcap_protobuf` alone give back every output that was told, with its unit."""
    told = {}
    for call, arguments in CALLS:
        if call == "outputs":
            time_ns, component, values = arguments
            told |= {(component, name, time_ns): value for name, value in values.items()}
    read, units = {}, {}
    for channel, message, decoded in messages(file):
        notes = channel.metadata
        if notes.get("kind") != "outputs":
            continue
        group = channel.topic.rsplit("/", 1)[1]
        for field in decoded.DESCRIPTOR.fields[1:]:
            name = field.name if group == "outputs" else f"{group}.{field.name}"
            value = getattr(decoded, field.name)
            read[notes["component"], name, message.log_time - EPOCH_NS] = value
            units[notes["component"], name] = notes[f"unit.{field.name}"]
    for key, value in read.items():
        np.testing.assert_array_equal(value, told[key])
    # what was told and not written is discrete and has not changed
    assert {key[:2] for key in told} == {key[:2] for key in read}
    assert {key[:2] for key in told.keys() - read.keys()} <= {
        (p.component, p.name)
        for ports in SYSTEM.ports.values()
        for p in ports.values()
        if p.variability == "discrete"
    }
    for component, ports in SYSTEM.ports.items():
        for name, each in ports.items():
            if each.causality == "output":
                assert units[component, name] == (each.unit.name if each.unit else "1")


def survivors(path):
    """Return the records of a file up to where it breaks off."""
    records = []
    with path.open("rb") as stream, suppress(EndOfFile):
        records.extend(StreamReader(stream, validate_crcs=True).records)
    return records


def test_every_message_has_one_time_and_its_place(file):
    """Log time, publish time and time stamp agree; sequence numbers count up on every channel."""
    last = {}
    for channel, message, decoded in messages(file):
        stamped = decoded.entities if hasattr(decoded, "entities") else [decoded]
        for one in stamped:
            assert message.log_time == message.publish_time == one.timestamp.ToNanoseconds()
        assert message.sequence == last.get(channel.topic, 0) + 1
        last[channel.topic] = message.sequence


def test_every_channel_is_listed_even_if_silent(tmp_path):
    """A topic that stays empty is in the file, with a protobuf schema."""
    path = record(tmp_path / "silent.mcap", SYSTEM, CALLS[:1])
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/vehicle/state", "/mpc/plan", "/tf", "/scene/plan", "/log", "/events"} <= topics
    assert all(
        summary.schemas[c.schema_id].encoding == "protobuf" for c in summary.channels.values()
    )
    assert summary.statistics.message_count == 1


def test_summary_and_statistics_are_true(file):
    """Indexed and sequential reading agree with the statistics, and all CRCs with the data."""
    with file.open("rb") as stream:
        counted = {}
        for r in StreamReader(stream, validate_crcs=True).records:
            if isinstance(r, Message):
                counted[r.channel_id] = counted.get(r.channel_id, 0) + 1
    with file.open("rb") as stream:
        statistics = make_reader(stream).get_summary().statistics
    assert statistics.channel_message_counts == counted
    assert statistics.message_count == len(messages(file))
    assert statistics.message_start_time == EPOCH_NS
    assert statistics.message_end_time == EPOCH_NS + 3 * 10**9


def test_attachments_and_metadata_tell_where_it_comes_from(file):
    """Scenario, versions, seed, time base, frames, roles, outcome and metrics are in the file."""
    with file.open("rb") as stream:
        reader = make_reader(stream)
        attached = {a.name: a.data for a in reader.iter_attachments()}
        tables = {m.name: m.metadata for m in reader.iter_metadata()}
    assert json.loads(attached["scenario.json"])["title"] == "a made-up flight"
    assert b"title: a made-up flight" in attached["scenario.yaml"]
    provenance = tables["hedgehop.provenance"]
    assert provenance["epoch_ns"] == "1767225600000000000"
    assert provenance["time_base"] == "simulated"
    assert {"version.hedgehop", "version.numpy", "python", "seed", "interface"} <= set(provenance)
    assert len(provenance["scenario.sha256"]) == 64
    assert tables["hedgehop.scene"] == SCENE
    summary = tables["hedgehop.summary"]
    assert (summary["outcome"], summary["cpu_s"]) == ("flown", "1.5")
    assert json.loads(summary["metrics"]) == {"outcome": "flown"}
    assert json.loads(summary["counts"]) == {"overruns.mpc": 3}


def test_equal_runs_give_equal_bytes_without_wall_clock(tmp_path):
    """Measured times that differ, missed deadlines too, leave no trace without the wall clock."""
    files = []
    for k in range(2):
        specs = (ComponentSpec("mpc", "x:Y"), ComponentSpec("sensor", "x:Y", on_overrun="hold"))
        system = helicopter(cells=5, capacity=8, posts=5, components=specs)
        calls = flight(system, 2.0)
        calls = [(call, (*a[:2], k) if call == "wall_clock" else a) for call, a in calls]
        calls.append(("event", (2 * 10**9, "overrun", "mpc", f"step took {k} s")))
        counts = {"overruns.mpc": k, "retries.vehicle": 1}
        path = tmp_path / f"{k}.mcap"
        listener = Recorder(path, wall_clock=False)
        assert not listener.wants_wall_clock
        tell(listener, system, calls, Result("flown", "", 2 * 10**9, counts, k, k))
        files.append(path.read_bytes())
    assert files[0] == files[1]
    assert not messages(tmp_path / "1.mcap", "/wall_clock")


def test_an_overrun_that_steers_the_flight_is_recorded(tmp_path):
    """Where the policy is not `log`, missed deadlines are in the file even without wall clock."""
    specs = (ComponentSpec("mpc", "x:Y", on_overrun="hold"),)
    system = make_system([port("mpc", "x")], components=specs)
    calls = [("event", (0, "overrun", "mpc", "step took 1 s"))]
    path = record(tmp_path / "a.mcap", system, calls, wall_clock=False)
    ((_, _, event),) = messages(path, "/events")
    assert (event.kind, event.component, event.message) == ("overrun", "mpc", "step took 1 s")


def test_the_scenario_can_switch_the_wall_clock_off(tmp_path):
    """A scenario without wall clock has no such topic, whatever the recorder would like."""
    system = make_system([port("mpc", "x")], wall_clock=False)
    path = record(tmp_path / "a.mcap", system, [("wall_clock", (0, "mpc", 0.5))], wall_clock=True)
    with path.open("rb") as stream:
        topics = {c.topic for c in make_reader(stream).get_summary().channels.values()}
    assert "/wall_clock" not in topics


def test_wall_clock_is_recorded_where_wanted(file):
    """One message per instant holds every measured step of it, a field for each component."""
    told = [a for call, a in CALLS if call == "wall_clock"]
    read = [
        (m.log_time - EPOCH_NS, component, getattr(decoded, component))
        for _, m, decoded in messages(file, "/wall_clock")
        for component in SYSTEM.ports
        if getattr(decoded, component) > 0
    ]
    assert sorted(read) == sorted(told)


def test_discrete_groups_are_written_on_change_only(tmp_path):
    """A wholly discrete group: at the start and at changes; one with a continuous member: always."""
    held = {"variability": "discrete"}
    ports = [port("mpc", "plan.n", kind="Int64"), port("mpc", "plan.x", shape=(2,), **held)]
    ports += [port("mpc", "mixed.n", kind="Int64"), port("mpc", "mixed.x")]
    nan = np.array([np.nan, 0.0])
    plans = [(1, nan), (1, nan.copy()), (2, nan), (2, np.array([np.nan, -0.0]))]
    calls = [
        ("outputs", (k * TICK_NS, "mpc", {"plan.n": n, "plan.x": x, "mixed.n": 0, "mixed.x": 0.0}))
        for k, (n, x) in enumerate(plans)
    ]
    path = record(tmp_path / "a.mcap", make_system(ports), calls)
    ticks = [(m.log_time - EPOCH_NS) // TICK_NS for _, m, _ in messages(path, "/mpc/plan")]
    assert ticks == [0, 2, 3]
    assert len(messages(path, "/mpc/mixed")) == len(plans)


def test_what_metrics_count_is_written_every_time(tmp_path):
    """A discrete ladder is counted by its publishings, so none of them is left out."""
    ports = [port("mpc", "ladder", kind="Enumeration", items={0: "full step"})]
    calls = [("outputs", (k * TICK_NS, "mpc", {"ladder": 0})) for k in range(4)]
    path = record(tmp_path / "a.mcap", make_system(ports, {"ladder": "mpc.ladder"}), calls)
    assert len(messages(path, "/mpc/outputs")) == 4


def test_parameters_and_changed_inputs(tmp_path):
    """Parameters: all known ones, again at a change. Inputs: those that differ from their source."""
    ports = [port("mpc", name, causality="parameter") for name in ("speed", "height", "computed")]
    ports += [port("mpc", name, causality="input") for name in ("plain", "delayed", "set")]
    source = port("vehicle", "y")
    links = [Link(source, ports[3]), Link(source, ports[4], delay_ns=TICK_NS)]
    events = (EventSpec(0.05, "mpc.set", 1.0), EventSpec(0.05, "mpc.height", 5.0))
    system = make_system([*ports, source], links=links, events=events)
    calls = [
        ("parameters", (0, "mpc", {"speed": 30.0, "height": 10.0})),
        ("inputs", (0, "mpc", {"delayed": 0.0})),
        ("inputs", (TICK_NS, "mpc", {"set": 1.0})),
        ("parameters", (TICK_NS, "mpc", {"height": 5.0})),
    ]
    path = record(tmp_path / "a.mcap", system, calls)
    parameters = [m for _, _, m in messages(path, "/mpc/parameters")]
    assert [(m.speed, m.height) for m in parameters] == [(30.0, 10.0), (30.0, 5.0)]
    assert not parameters[1].HasField("computed")
    inputs = [m for _, _, m in messages(path, "/mpc/inputs")]
    assert [f.name for f in inputs[0].DESCRIPTOR.fields] == ["timestamp", "delayed", "set"]
    assert [(m.HasField("delayed"), m.HasField("set")) for m in inputs] == [(1, 0), (0, 1)]


def test_viewers_get_the_scene_in_their_frames(tmp_path):
    """The official Foxglove classes read transform, pose, path and log; NED has become ENU."""
    system = helicopter(cells=2, capacity=3, posts=2)
    values = dict.fromkeys(system.ports["vehicle"], 0.0)
    values |= {"pose.north": 1.0, "pose.east": 2.0, "pose.down": -3.0, "outcome": 0}
    mpc = {
        n: np.zeros(p.shape) if p.shape else 0
        for n, p in system.ports["mpc"].items()
        if p.causality == "output"
    }
    mpc |= {"path.north": np.arange(3.0), "path.east": np.ones(3), "path.down": -np.ones(3)}
    calls = [("outputs", (0, "vehicle", values)), ("outputs", (0, "mpc", mpc))]
    calls += [("log", (0, logging.WARNING, "mpc", "late"))]
    path = record(tmp_path / "a.mcap", system, calls)
    ((_, _, transform),) = messages(path, "/tf")
    assert transform.DESCRIPTOR.full_name == "foxglove.FrameTransform"
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "heli")
    point, turn = transform.translation, transform.rotation
    assert (point.x, point.y, point.z) == (2.0, 1.0, 3.0)
    half = 0.5**0.5  # heading north: a quarter turn from east, about z
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0, 0, half, half))
    ((_, _, pose),) = messages(path, "/scene/pose")
    assert (pose.frame_id, pose.pose.position.z) == ("map", 3.0)
    assert pose.pose.orientation.w == turn.w
    ((_, _, plan),) = messages(path, "/scene/plan")
    assert [(p.position.x, p.position.y, p.position.z) for p in plan.poses] == [
        (1.0, 0.0, 1.0),
        (1.0, 1.0, 1.0),
        (1.0, 2.0, 1.0),
    ]
    assert {(p.orientation.x, p.orientation.w) for p in plan.poses} == {(0.0, 1.0)}
    ((_, _, log),) = messages(path, "/log")
    assert (log.name, log.message, log.level) == ("mpc", "late", 3)


def test_a_role_without_its_members_is_refused_before_the_file_is_touched(tmp_path):
    """The message names role, group and expectation; no file is made."""
    path = tmp_path / "a.mcap"
    system = make_system([port("vehicle", "pose.north")], {"pose": "vehicle.pose"})
    with pytest.raises(ValueError, match=r"scene\.pose: no such outputs, got 'vehicle\.pose'"):
        Recorder(path).open(system)
    assert not path.exists()


def test_a_killed_run_leaves_its_flushed_seconds(tmp_path):
    """What is on the disk at any instant holds every message up to the last whole second."""
    path = tmp_path / "killed.mcap"
    listener = Recorder(path)
    listener.open(SYSTEM)
    for call, arguments in CALLS:
        if arguments[0] < 2.5e9:
            getattr(listener, call)(*arguments)
    records = survivors(path)
    listener.close(Result("interrupted"))
    assert "/mpc/plan" in {r.topic for r in records if isinstance(r, Channel)}
    last = max(r.log_time for r in records if isinstance(r, Message))
    assert last - EPOCH_NS == 2 * 10**9


def test_an_unwritable_path_is_one_clear_line(tmp_path):
    """The OSError at open names the file and the reason."""
    path = tmp_path / "missing" / "a.mcap"
    with pytest.raises(OSError, match="cannot be written, No such file or directory") as caught:
        Recorder(path).open(SYSTEM)
    assert str(caught.value).startswith(f"{path}: ")


class FullDisk(FileIO):
    """A file on a disk with room for so many bytes; what is cut off makes room again."""

    room = 40_000

    def write(self, data):
        """Write what there is room for."""
        if self.tell() + len(data) <= self.room:
            return super().write(data)
        if self.tell() < self.room:
            return super().write(data[: self.room - self.tell()])
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_ends_the_recording_not_the_run(tmp_path, monkeypatch, caplog):
    """The failure is logged and kept, the run goes on, and every flushed second is readable."""
    system = helicopter()
    monkeypatch.setattr(recorder, "FileIO", FullDisk)
    monkeypatch.setattr(FullDisk, "room", 250_000)
    path = tmp_path / "full.mcap"
    listener = Recorder(path)
    listener.open(system)
    calls = flight(system, 4.0)
    for call, arguments in calls:
        getattr(listener, call)(*arguments)
    listener.close(Result("flown", "", 4 * 10**9))
    assert listener.failure.errno == errno.ENOSPC
    records = survivors(path)
    last_ns = max(r.log_time - EPOCH_NS for r in records if isinstance(r, Message))
    assert last_ns >= 10**9
    assert f"full.mcap: recording stopped after {last_ns / 1e9:g} s" in caplog.text


def test_after_a_failure_nothing_is_kept_in_memory(tmp_path, monkeypatch):
    """The run may go on for hours: what it tells is let go at once."""
    monkeypatch.setattr(recorder, "FileIO", FullDisk)
    system = make_system([port("mpc", "plan.x", shape=(3,)), port("mpc", "cost")])
    listener = Recorder(tmp_path / "full.mcap")
    listener.open(system)
    monkeypatch.setattr(FullDisk, "room", listener.path.stat().st_size)
    for k in range(22):
        listener.outputs(k * TICK_NS, "mpc", {"plan.x": np.full(3, k), "cost": 0.0})
    assert listener.failure is not None
    x = np.zeros(3)
    told = weakref.ref(x)
    listener.outputs(30 * TICK_NS, "mpc", {"plan.x": x, "cost": 0.0})
    listener.parameters(30 * TICK_NS, "mpc", {})
    del x
    assert told() is None
    listener.close(Result("flown"))


def test_what_cannot_be_recorded_is_an_error_and_the_rest_is_kept(tmp_path):
    """A wrong shape names topic, time and variable; all other values are in a finished file."""
    system = make_system([port("mpc", "plan.x", shape=(3,)), port("mpc", "cost")])
    path = tmp_path / "a.mcap"
    listener = Recorder(path)
    listener.open(system)
    for k in range(40):
        shape = 2 if k in (21, 23) else 3
        listener.outputs(k * TICK_NS, "mpc", {"plan.x": np.full(shape, k), "cost": 0.0})
    what = r"/mpc/plan at t = 1\.050 s: cannot .*, plan\.x: shape, got \(2,\), expected \(3,\)"
    with pytest.raises(ValueError, match=what):
        listener.close(Result("flown"))
    assert len(messages(path, "/mpc/outputs")) == 40
    times = [(m.log_time - EPOCH_NS) // TICK_NS for _, m, _ in messages(path, "/mpc/plan")]
    assert times == [k for k in range(40) if k not in (21, 23)]


def test_failing_metrics_leave_a_finished_file(tmp_path):
    """An exception in the metrics is passed on, after the file is finished."""
    path = tmp_path / "a.mcap"

    def fail(_):
        raise ValueError("no such figure")

    with pytest.raises(ValueError, match="no such figure"):
        record(path, SYSTEM, CALLS[:5], metrics=fail)
    assert messages(path)


def test_close_without_open_and_twice_does_nothing(tmp_path):
    """Every way out of a run may close."""
    listener = Recorder(tmp_path / "a.mcap")
    listener.close(Result("interrupted"))
    tell(listener, SYSTEM, CALLS[:5])
    size = listener.path.stat().st_size
    listener.close(Result("interrupted"))
    assert listener.path.stat().st_size == size
