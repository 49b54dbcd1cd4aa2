"""What a scenario chooses to record, and how: topics, thinning, chunks, and a disk that fills up."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path

import pytest
from fake_system import TICK_NS, flight, helicopter, tell
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from small_components import GROUND, SCENARIO

from orchestrator.command.app import status
from orchestrator.recording.chunks import split
from orchestrator.recording.diff import diff
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.recording.rows import Row, assemble, instant
from orchestrator.recording.wire import Layout


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that flies the glider with options and returns its recording."""
    monkeypatch.chdir(tmp_path)
    Path("glide.yaml").write_text(SCENARIO)
    Path("ground.txt").write_text(GROUND)

    def fly(*options, name="glide.mcap"):
        settings = [word for option in options for word in ("--set", f"recording.{option}")]
        assert status(["run", "glide.yaml", "--out", name, *settings]) == 0
        return Recording.open(name)

    return fly


def test_patterns_choose_the_topics(run):
    """What is included and not excluded is there, with all its messages, and nothing else is."""
    whole = run()
    left = run('include=["/glider/*","/events"]', 'exclude=["*/parameters"]', name="b.mcap")
    assert set(left.topics) == {"/glider/state", "/glider/outputs", "/glider/inputs", "/events"}
    for name, topic in left.topics.items():
        assert topic.raw == whole.topics[name].raw


def test_a_thinned_topic_holds_each_nth_message(run):
    """From the first one on; what is told once is never left out, and the file says what it is."""
    whole = run()
    thin = run('every={"/glider/state": 7, "/glider/*": 3}', name="b.mcap")
    for name, n in (("/glider/state", 7), ("/glider/outputs", 3)):
        assert thin.topics[name].raw == whole.topics[name].raw[::n]
        assert thin.topics[name].metadata["every"] == f"{n}"
    for name in ("/glider/inputs", "/glider/parameters", "/pilot/command", "/events"):
        assert thin.topics[name] == whole.topics[name]


def test_a_discrete_topic_is_looked_at_each_nth_time(tmp_path):
    """A thinned topic that is written on change holds what changed since the last look."""
    system = helicopter(cells=3, capacity=4, posts=2, wall_clock=False)
    spec = replace(system.scenario.recording, every={"/sensor/scan": 5})
    thinned = replace(system, scenario=replace(system.scenario, recording=spec))
    calls = flight(system, 3.0)
    tell(Recorder(tmp_path / "a.mcap"), system, calls)
    tell(Recorder(tmp_path / "b.mcap"), thinned, calls)
    samples = [Recording.open(tmp_path / n)["sensor.scan.sequence"] for n in ("a.mcap", "b.mcap")]
    whole, thin = (dict(zip(t.tolist(), v.tolist(), strict=True)) for t, v in samples)
    ticks = [round(time * 1e9) // TICK_NS for time in thin]
    assert ticks == [0, 10, 20, 25, 35, 40, 50, 60]
    assert [thin[k] for k in thin] == [
        next(value for then, value in reversed(whole.items()) if then <= time) for time in thin
    ]


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (
            'exclude=["/piolt/*"]',
            "recording.exclude: no such topic, got '/piolt/*', did you mean '/pilot/*'",
        ),
        (
            'include=["/glider/sate"]',
            "recording.include: no such topic, got '/glider/sate', did you mean '/glider/state'",
        ),
        ('every={"/events": 2}', "recording.every: no such topic, got '/events', expected one of"),
        ('every={"/events": 0}', "recording.every./events: out of range, got 0, expected a whole"),
        ("chunk_kb=0", "recording.chunk_kb: out of range, got 0 kB, expected a whole number >= 1"),
        ("compression=zip", "recording.compression: not a choice, got 'zip', expected one of"),
    ],
)
def test_what_chooses_nothing_is_refused(run, capsys, option, message):
    """A pattern that fits no topic names the nearest, with its place; nothing is recorded."""
    assert status(["run", "glide.yaml", "--set", f"recording.{option}"]) == 2
    assert f"--set #1: {message}" in capsys.readouterr().err
    assert not list(Path().glob("*.mcap"))


def test_a_topic_that_another_option_switches_off_may_be_named(run):
    """Patterns are about topics that could be there."""
    assert "/wall_clock" not in run("wall_clock=false", 'exclude=["/wall_clock"]').topics


@pytest.mark.parametrize("option", ["compression=lz4", "compression=none", "chunk_kb=1"])
def test_chunks_are_made_as_asked_and_hold_the_same(run, option):
    """Compression and size of chunks change no message; other readers find their way."""
    run("wall_clock=false")
    run("wall_clock=false", option, name="b.mcap")
    assert diff(Path("glide.mcap"), Path("b.mcap")) == []
    with Path("b.mcap").open("rb") as stream:
        count = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
        stream.seek(0)
        found = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in found if isinstance(record, Chunk)]
    recording = Recording.open("b.mcap")
    assert count == sum(len(topic.raw) for topic in recording.topics.values())
    if option == "chunk_kb=1":
        assert max(chunk.uncompressed_size for chunk in chunks) <= 1000
    else:
        name = option.removeprefix("compression=").replace("none", "")
        assert {chunk.compression for chunk in chunks} == {name}


MESSAGES = st.lists(st.tuples(st.integers(0, 9), st.binary(max_size=9)), min_size=1, max_size=20)
ROW = Row({1: Layout((), tail=lambda _, data: data, is_stamped=False)})


@given(MESSAGES, st.integers(0, 400))
def test_a_split_loses_nothing_and_keeps_the_order(messages, size):
    """Put together again it is what it was; parts follow in time and only an instant is too large."""
    whole = [
        (time, ROW, *ROW.fill(1, instant(time), data))
        for time, data in sorted(messages, key=lambda message: message[0])
    ]
    parts = list(split(whole, size))
    assert list(chain.from_iterable(parts)) == whole
    spans = [{time for time, *_ in part} for part in parts]
    assert all(max(a) < min(b) for a, b in pairwise(spans))
    for part, span in zip(parts, spans, strict=True):
        assert part
        assert len(span) == 1 or len(assemble(part)[0]) <= size


def test_metrics_leave_out_what_was_not_recorded_and_say_so(run, capsys):
    """A figure without its channel is null, and a note names the role."""
    run('exclude=["/glider/outputs"]')
    capsys.readouterr()
    assert status(["metrics", "glide.mcap", "--json"]) == 0
    printed = capsys.readouterr()
    figures = json.loads(printed.out)
    assert figures["clearance_min_m"] is None
    assert figures["agl_rms_m"] is None
    assert printed.err == "note: clearance: glider.clearance was not recorded\n"


def test_a_thinned_count_is_left_out(run, capsys):
    """Rungs of a ladder are counted by messages: not of a thinned topic; extremes carry a note."""
    Path("glide.yaml").write_text(SCENARIO.replace("scene: {", "scene: {ladder: glider.outcome, "))
    run()
    status(["metrics", "glide.mcap", "--json"])
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["ladder"]["flying"] == 201
    run('every={"/glider/outputs": 4}')
    capsys.readouterr()
    assert status(["metrics", "glide.mcap", "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["ladder"] is None
    assert "note: ladder: one message of 4 of glider.outcome was recorded" in printed.err
    assert "note: clearance: one message of 4 of glider.clearance was recorded" in printed.err


def test_a_thinned_component_is_not_played(run, capsys):
    """It would not be what flew: refused, with the topic."""
    run('every={"/pilot/command": 2}')
    assert status(["run", "glide.yaml", "--set", "components.pilot.use=glide.mcap"]) == 2
    text = "one message of 2 of /pilot/command was recorded, expected all of them"
    assert text in capsys.readouterr().err


def test_a_run_tells_its_size_per_minute(run, capsys):
    """In the closing table and in JSON, from the file's size and simulated time."""
    run()
    size = Path("glide.mcap").stat().st_size / 1e6
    assert f"{size * 6:.3g} MB per flight minute" in capsys.readouterr().out
    assert status(["metrics", "glide.mcap", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recording_mb_per_min"] == pytest.approx(size * 6)


def on_small_disk(folder, *options):
    """Fly where there is room for 50 kB: on a disk of that size, or else under a limit."""
    (folder / "ground.txt").write_text(GROUND)
    text = SCENARIO.replace("duration_s: 10", "duration_s: 60")
    (folder / "glide.yaml").write_text(text)
    (folder / "disk").mkdir()
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "orchestrator", "run", "glide.yaml", "--out", "disk/a.mcap"]
    command += [word for option in options for word in ("--set", f"recording.{option}")]
    # a disk of that size is seen in there only, and gone afterwards: what is on it is kept
    inside = ["unshare", "--map-root-user", "--mount", "sh", "-c"]
    mount = "mount -t tmpfs -o size=48k none disk"
    script = f'{mount} && "$@"; code=$?; cp disk/* . && exit $code'
    if subprocess.run(
        ["sh", "-c", f"unshare -rm sh -c '{mount}'"], cwd=folder, check=False
    ).returncode:
        inside = ["sh", "-c"]
        script = 'ulimit -f 96; "$@"; code=$?; cp disk/* . && exit $code'  # blocks of 512 bytes
    done = subprocess.run(
        [*inside, script, "sh", *command],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path, "XDG_CACHE_HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    return done, folder / "a.mcap"


@pytest.mark.parametrize("policy", ["stop", "end"])
def test_a_full_disk_is_dealt_with_as_the_scenario_says(tmp_path, capsys, policy):
    """The run flies on or ends, its figures are printed, and what was recorded can be recovered."""
    done, kept = on_small_disk(tmp_path, f"on_disk_full={policy}", "compression=none")
    assert done.returncode == 2
    why = ("No space left on device", "File too large")
    assert any(f"s of simulated time, {reason}" in done.stderr for reason in why)
    assert "a.mcap: incomplete, `hedgehop recover` makes it whole" in done.stderr
    assert "Traceback" not in done.stderr
    outcome = "flown after 60 s" if policy == "stop" else "interrupted after "
    assert outcome in done.stdout
    assert "minimum clearance" in done.stdout
    assert any(reason in done.stdout for reason in why) == (policy == "end")
    out = tmp_path / "ok.mcap"
    assert status(["recover", str(kept), "-o", str(out)]) == 0
    left = Recording.open(out)
    assert left.result.outcome == "interrupted"
    assert left.recovered["lost_messages"] == "0"
    assert "everything up to" in capsys.readouterr().out
