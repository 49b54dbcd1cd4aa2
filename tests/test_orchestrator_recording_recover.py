"""Recordings that were killed, cut or damaged: what is left becomes a whole one, never a traceback."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from fake_system import flight, helicopter, tell
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from small_components import GROUND, SCENARIO

from orchestrator.command.app import status
from orchestrator.flight import recording_metrics
from orchestrator.listener import Result
from orchestrator.recording.diff import diff, info
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.recording.recover import recover

SYSTEM = helicopter(cells=20, capacity=8, posts=5, wall_clock=True)
SECONDS = 4


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    ending = Result("flown", "", SECONDS * 10**9, {}, 1.5, 1.6)
    tell(Recorder(path), SYSTEM, flight(SYSTEM, SECONDS), ending)
    return path


@pytest.fixture(scope="module")
def glide(tmp_path_factory):
    """Return the recording of a short flight, made by the command."""
    folder = tmp_path_factory.mktemp("glide")
    (folder / "glide.yaml").write_text(SCENARIO)
    (folder / "ground.txt").write_text(GROUND)
    out = folder / "glide.mcap"
    arguments = ["--out", str(out), "--set", "duration_s=4", "--set", "events=[]"]
    assert status(["run", str(folder / "glide.yaml"), *arguments]) == 0
    return out


def chunks(data):
    """Return start and end of every chunk in a file, with its record."""
    path, found, at = data, [], 8
    while at < len(path):
        opcode, length = path[at], int.from_bytes(path[at + 1 : at + 9], "little")
        if opcode == Opcode.CHUNK:
            found.append((at, at + 9 + length))
        if opcode == Opcode.FOOTER:
            return found
        at += 9 + length
    return found


def upto(path, end_s):
    """Return every topic's messages before a time."""
    topics = Recording.open(path).topics
    return {
        name: [raw for raw in topic.raw if raw[0] < end_s * 1e9] for name, topic in topics.items()
    }


def run_killed(folder, *options):
    """Fly for a minute in a process of its own, which is killed at 30 s unless told otherwise."""
    (folder / "ground.txt").write_text(GROUND)
    text = SCENARIO.replace("duration_s: 10", "duration_s: 60")
    (folder / "glide.yaml").write_text(text.replace("small_components:Glider", "mortal:Mortal"))
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    arguments = ["run", "glide.yaml", "--set", "recording.wall_clock=false", *options]
    return subprocess.run(
        [sys.executable, "-m", "orchestrator", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_killed_flight_keeps_all_but_its_last_second(tmp_path, capsys):
    """SIGKILL at 30 s: the first 29 s of every channel are those of the flight that was not."""
    alive = ["--set", "components.glider.use=small_components:Glider", "--out", "whole.mcap"]
    assert run_killed(tmp_path, *alive).returncode == 0
    assert run_killed(tmp_path).returncode == -9
    broken, out = tmp_path / "glide.mcap", tmp_path / "ok.mcap"
    before = broken.read_bytes()
    assert status(["info", str(broken)]) == 2
    assert "`hedgehop recover`" in capsys.readouterr().err
    assert status(["recover", str(broken), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "everything up to 29 s" in said
    assert "lost: the end of the file" in said
    assert broken.read_bytes() == before
    whole = upto(tmp_path / "whole.mcap", 29.0)
    assert len(whole["/glider/state"]) == 29 * 20
    assert upto(out, 29.0) == whole
    figures = recording_metrics(out)
    assert (figures["outcome"], figures["duration_s"]) == ("interrupted", 29.0)


def test_a_recovered_flight_can_be_flown_again(glide, capsys):
    """It is an interrupted one: all that is in it comes again, bit by bit."""
    data = glide.read_bytes()
    broken, out = glide.with_name("cut.mcap"), glide.with_name("ok.mcap")
    broken.write_bytes(data[: chunks(data)[2][0]])
    recover(broken, out)
    assert status(["replay", str(out), "--trust"]) == 0
    assert "no difference" in capsys.readouterr().out


def test_an_undamaged_recording_comes_out_the_same(file, tmp_path):
    """Nothing was lost, says the result, and nothing differs."""
    out = tmp_path / "ok.mcap"
    recovery = recover(file, out)
    assert recovery.losses == ()
    assert recovery.complete_s == recovery.end_s == SECONDS
    assert diff(file, out) == []
    assert recording_metrics(out) == recording_metrics(file)
    assert Recording.open(out).recovered["reason"] == "nothing was lost"


def test_a_damaged_chunk_costs_its_second_only(file, tmp_path):
    """The count of what is missing is exact, and so is the time up to which nothing is."""
    data = bytearray(file.read_bytes())
    start, end = chunks(data)[1]
    data[(start + end) // 2] ^= 0x10
    broken, out = tmp_path / "broken.mcap", tmp_path / "ok.mcap"
    broken.write_bytes(data)
    recovery = recover(broken, out)
    with file.open("rb") as stream:
        total = make_reader(stream).get_summary().statistics.message_count
    assert recovery.messages + recovery.lost_messages == total
    assert recovery.damaged_records == 1
    assert recovery.complete_s == 1.0
    assert not recovery.is_cut
    whole, left = Recording.open(file), Recording.open(out)
    for name, topic in whole.topics.items():
        kept = [raw for raw in topic.raw if not 10**9 < raw[0] <= 2 * 10**9]
        assert left.topics[name].raw == kept
    assert left.result == whole.result
    assert left.recovered["complete_s"] == "1.0"
    assert info(out)["recovered"]["reason"] == left.recovered["reason"]


def test_a_wrong_length_does_not_hide_what_follows(file, tmp_path):
    """Reading goes on at the next chunk, whichever length is wrong."""
    data = file.read_bytes()
    start, _ = chunks(data)[1]
    for at in (start + 1, start + 3, start + 8, start + 9 + 32 + 4):
        broken, out = tmp_path / "broken.mcap", tmp_path / "ok.mcap"
        broken.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        recovery = recover(broken, out)
        assert (recovery.complete_s, recovery.end_s) == (1.0, SECONDS)
        assert recovery.lost_messages > 0


def test_what_the_summary_repeats_is_taken_from_there(file, tmp_path):
    """Damaged descriptions of topics cost nothing while the file's end is whole."""
    data = file.read_bytes()
    broken, out = tmp_path / "broken.mcap", tmp_path / "ok.mcap"
    for text in (b"/vehicle/pose", b"unit.north", b"hedgehop/mpc/Plan.proto"):
        at = data.index(text, data.index(b"components.json"))
        broken.write_bytes(data[:at] + b"\xff" + data[at + 1 :])
        recover(broken, out)
        assert diff(file, out) == []


def test_a_lost_scenario_file_is_made_again_from_its_twin(file, tmp_path):
    """The scenario is attached twice; one of them is enough."""
    data = file.read_bytes()
    at = data.index(b'"title": "a made-up flight"')
    broken, out = tmp_path / "broken.mcap", tmp_path / "ok.mcap"
    broken.write_bytes(data[:at] + b"?" + data[at + 1 :])
    recover(broken, out)
    assert Recording.open(out).scenario == Recording.open(file).scenario


def test_the_result_is_written_whole_or_not_at_all(file, tmp_path, capsys):
    """Neither the input nor an older result is touched when something is wrong."""
    source = tmp_path / "a.mcap"
    source.write_bytes(file.read_bytes()[:-100])
    linked = tmp_path / "b.mcap"
    linked.symlink_to(source)
    assert status(["recover", str(source), "-o", str(linked)]) == 2
    assert "is what is read, expected another file" in capsys.readouterr().err
    older = tmp_path / "c.mcap"
    older.write_text("older")
    source.write_bytes(b"no recording")
    assert status(["recover", str(source), "-o", str(older)]) == 2
    text = f"{source}: nothing to recover, expected at least a recording's beginning\n"
    assert capsys.readouterr().err == text
    assert older.read_text() == "older"
    assert sorted(tmp_path.iterdir()) == [source, linked, older]


def test_other_programs_read_the_result(file, tmp_path):
    """`mcap` alone finds summary, statistics and CRCs in order."""
    broken, out = tmp_path / "broken.mcap", tmp_path / "ok.mcap"
    broken.write_bytes(file.read_bytes()[: chunks(file.read_bytes())[2][1] - 5])
    recovery = recover(broken, out)
    with out.open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
        stream.seek(0)
        found = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    assert summary.statistics.message_count == recovery.messages
    assert sum(isinstance(r, Chunk) for r in found) == 2


def answers(path, folder, capsys):
    """Ask every command about a file; each ends with a result, or with one line about it."""
    out = folder / "ok.mcap"
    out.unlink(missing_ok=True)
    outcomes = [status(["recover", str(path), "-o", str(out)])]
    for file in (path, out) if out.exists() else (path,):
        outcomes += [status(["info", str(file)]), status(["metrics", str(file), "--json"])]
    assert set(outcomes) <= {0, 2}, capsys.readouterr().err
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err
    wrong = [line for line in printed.err.splitlines() if not line.startswith("note: ")]
    assert len(wrong) == outcomes.count(2)
    if out.exists():
        assert outcomes[0] == 0
        assert outcomes[3:] == [0, 0]  # a recovered recording has no faults
    return outcomes


def damaged(data, rng, kind):
    """Return a file cut at random, or with a random bit turned, or both."""
    data = bytearray(data[: rng.randrange(len(data))] if kind != "flip" else data)
    if kind != "cut" and data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


@pytest.mark.parametrize(("kind", "times"), [("cut", 200), ("flip", 200), ("both", 50)])
def test_no_damage_ends_in_a_traceback(glide, tmp_path, capsys, kind, times):
    """200 cuts, 200 turned bits, and both: recover, info and metrics answer or say in a line why."""
    rng = random.Random(kind)
    whole = glide.read_bytes()
    broken = tmp_path / "broken.mcap"
    saved = 0
    for _ in range(times):
        broken.write_bytes(damaged(whole, rng, kind))
        saved += answers(broken, tmp_path, capsys)[0] == 0
    assert saved >= times // (2 if kind == "flip" else 10)


def test_reports_of_damaged_recordings(glide, tmp_path, capsys):
    """What `report` says of a damaged recording, and of the one that was made of it."""
    rng = random.Random(0)
    whole = glide.read_bytes()
    for kind in ("cut", "flip") * 10:
        broken, out, page = (tmp_path / n for n in ("broken.mcap", "ok.mcap", "report.html"))
        broken.write_bytes(damaged(whole, rng, kind))
        assert status(["report", str(broken), "-o", str(page)]) in (0, 2)
        if status(["recover", str(broken), "-o", str(out)]) == 0:
            assert status(["report", str(out), "-o", str(page)]) == 0
        assert "Traceback" not in capsys.readouterr().err


@given(st.binary(max_size=300))
def test_any_bytes_are_no_recording(tmp_path_factory, data):
    """Whatever follows the magic bytes, the answer is one line."""
    folder = tmp_path_factory.mktemp("any")
    broken = folder / "a.mcap"
    broken.write_bytes(b"\x89MCAP0\r\n" + data)
    with pytest.raises(ValueError, match="nothing to recover"):
        recover(broken, folder / "b.mcap")
    assert list(folder.iterdir()) == [broken]


@pytest.mark.parametrize("offset", [0, len(b"end_ns") + 4], ids=["key", "number"])
def test_an_ending_that_cannot_be_read_is_lost_and_said_to_be(glide, tmp_path, offset):
    """A turned bit in the summary, which no checksum of its own covers, ends in no fault later."""
    whole = glide.read_bytes()
    at = whole.index(b"end_ns") + offset
    broken, out = tmp_path / "broken.mcap", tmp_path / "ok.mcap"
    broken.write_bytes(whole[:at] + b"v" + whole[at + 1 :])
    with pytest.raises(ValueError, match=r"broken\.mcap: is "):
        Recording.open(broken)
    assert "how the run ended" in recover(broken, out).lost
    assert Recording.open(out).result.outcome == "interrupted"
