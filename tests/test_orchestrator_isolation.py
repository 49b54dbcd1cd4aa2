"""A component in a process of its own: the same flight, and no fault of it is the run's."""

import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import small_faults

from orchestrator.assembly.build import build
from orchestrator.assembly.plan import Plan
from orchestrator.errors import ScenarioError
from orchestrator.figures.trace import Trace
from orchestrator.flight import fly as fly_file
from orchestrator.isolation.channel import Channel, packed
from orchestrator.isolation.remote import Remote
from orchestrator.recording.diff import diff
from orchestrator.recording.reader import Recording
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load

SCENARIO = """\
title: a counter that may fail
duration_s: 1
components:
  c: {use: small_faults:Counter, isolation: process, parameters: {fault: FAULT, marker: MARKER}}
  pilot: {use: small_components:Pilot}
connections: []
"""


class Listening(Trace):
    """A trace that keeps what is logged too."""

    def __init__(self):
        super().__init__()
        self.lines = []

    def log(self, time_ns, level, name, message):
        """Keep a line."""
        self.lines.append((time_ns / 1e9, level, name, message))


@pytest.fixture
def fly(tmp_path):
    """Return a function that flies the scenario with a fault and keys of the component."""

    def flown(fault="", *overrides, marker=""):
        file = tmp_path / "faulty.yaml"
        file.write_text(SCENARIO.replace("FAULT", f'"{fault}"').replace("MARKER", f'"{marker}"'))
        trace = Listening()
        simulate(build(load(file, [f"components.c.{one}" for one in overrides])), [trace])
        return trace

    return flown


def told(trace):
    """Return the faults that were told: kind and first line."""
    return [(e.kind, e.message.partition("\n")[0]) for e in trace.events if e.component == "c"]


def is_running(pid):
    """Return whether a process is there and not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


AT = "c at t = 0.500 s: "
RAISED = small_faults.raise_error.__code__.co_firstlineno + 1  # not where it was called from
ENDS = [
    ("exit", [], "died", "process died, exit code 3"),
    ("sys.exit", [], "died", "process died, exit code 4"),
    ("crash", [], "died", "process died, killed by SIGSEGV"),
    ("hang", ["timeout_s=0.3"], "timeout", "does not answer, expected within 0.3 s"),
    (
        "raise",
        [],
        "error",
        f"step failed, RuntimeError: NotPicklable: beyond words (small_faults.py:{RAISED})",
    ),
    ("error", [], "error", "step failed (Error), it says: about to error"),
    ("fatal", [], "error", "step failed (Fatal), it says: about to fatal"),
]


@pytest.mark.parametrize(("fault", "keys", "kind", "what"), ENDS, ids=[e[0] for e in ENDS])
def test_every_fault_ends_the_run_in_order(fly, fault, keys, kind, what):
    """A crash, an exit, a hang is an event with its time and the reason of the end; nobody is left."""
    trace = fly(fault, *keys)
    assert trace.result.outcome == "component error"
    assert trace.result.reason == AT + what
    assert told(trace) == [(kind, AT + what)]
    assert trace["c.y"][1].tolist() == [float(k) for k in range(11)]
    assert not is_running(trace["c.pid"][1][0])
    assert trace["c.pid"][1][0] != os.getpid()


def test_outputs_that_cannot_be_read_are_told_with_the_line_that_failed(fly):
    """It is the component's own, in another process, though the answer to the step has brought it."""
    trace = fly("raise in get")
    what = f"RuntimeError: NotPicklable: beyond words (small_faults.py:{RAISED})"
    assert trace.result.reason == f"{AT}get failed, {what}"


@pytest.mark.parametrize("fault", ["crash", "hang"])
def test_a_lost_component_can_be_held(fly, fault):
    """With on_error hold the outputs stay and the others fly on to the end."""
    trace = fly(fault, "on_error=hold", "timeout_s=0.3")
    assert trace.result.outcome == "flown"
    [(kind, message)] = told(trace)
    assert kind == ("timeout" if fault == "hang" else "died")
    assert message.endswith(", outputs are held")
    assert trace["c.y"][0][-1] == 0.5


@pytest.mark.parametrize("fault", ["crash", "hang", "raise", "raise in get", "fatal"])
def test_a_restarted_component_goes_on_from_its_saved_state(fly, tmp_path, fault):
    """The failed step is taken again in a new process; the flight is the undisturbed one."""
    trace = fly(fault, "on_error=restart", "timeout_s=2", marker=tmp_path / "marker")
    assert trace.result.outcome == "flown"
    kind = {"hang": "timeout", "crash": "died"}.get(fault, "error")
    assert [kind for kind, _ in told(trace)] == [kind, "restart"]
    assert told(trace)[1][1] == AT + "goes on in a new process, from the last saved state"
    assert trace["c.y"][1].tolist() == [float(k) for k in range(21)]
    assert trace["c.ring"][1][:, 7].tolist() == [float(k // 5 * 5) for k in range(21)]
    assert len(set(trace["c.pid"][1])) == 2
    assert trace.result.counts["restarts.c"] == 1


def test_the_same_step_failing_twice_ends_the_run(fly):
    """A restart that does not help is not tried for ever."""
    trace = fly("exit", "on_error=restart")
    assert [kind for kind, _ in told(trace)] == ["died", "restart", "died"]
    assert trace.result.reason == AT + "process died, exit code 3"


def test_a_restart_keeps_inputs_and_tuned_parameters(tmp_path):
    """What was set by an event before the crash holds after it."""
    events = "events=[{at_s: 0.2, set: c.gain, value: 3.0}, {at_s: 0.1, set: c.u, value: 2.0}]"
    file = tmp_path / "faulty.yaml"
    marker = str(tmp_path / "marker")
    file.write_text(SCENARIO.replace("FAULT", "crash").replace("MARKER", marker))
    trace = Listening()
    simulate(build(load(file, [events, "components.c.on_error=restart"])), [trace])
    assert trace.result.counts["restarts.c"] == 1
    assert trace["c.y"][1].tolist() == [0, 1, 2, 4, 6, *range(12, 103, 6)]


def test_isolation_changes_no_bit(fly):
    """Every output of an isolated flight is that of the same flight in one process."""
    apart, together = fly(), fly("", "isolation=none")
    for name in ("c.y", "c.ring", "pilot.command.climb"):
        for a, b in zip(apart[name], together[name], strict=True):
            assert a.tobytes() == b.tobytes()
    assert told(apart) == told(together) == []


def test_an_array_that_does_not_change_is_not_sent_again(fly):
    """The recorder sees the same read-only object until the component has another."""
    trace = fly()
    rings = [values["ring"] for _, values in trace._rows["c"]]
    assert len({id(ring) for ring in rings}) == 5
    assert not any(ring.flags.writeable for ring in rings)
    assert rings[0] is rings[4] is not rings[5]


def test_log_records_arrive_before_a_crash(fly):
    """What a component logged last is told with its simulated time, however it ended."""
    assert fly("crash").lines == [(0.5, 30, "c", "about to crash")]


def test_log_records_of_a_component_in_the_same_process_are_told_too(fly):
    """Routing does not depend on where the component lives."""
    assert fly("error", "isolation=none").lines == [(0.5, 30, "c", "about to error")]


def test_temporary_files_are_left_in_a_folder_that_is_removed(fly):
    """Not even a killed component leaves files behind."""
    trace = fly("crash")
    folder = Path(str(trace["c.temporary"][1][0]))
    assert folder.parent.name.startswith("hedgehop-")
    assert not folder.parent.exists()


REFUSED = [
    ("refuse", [], "components.c.parameters.fault: impossible, got 'refuse', expected another"),
    ("crash at once", [], "components.c: process died, killed by SIGSEGV"),
    ("hang at first", ["timeout_s=0.3"],
     "component 'c': cannot be initialized, does not answer, expected within 0.3 s"),
    ("", ["isolation=none", "timeout_s=1"], "'c': timeout_s is not possible, got 1.0 s"),
    ("", ["isolation=none", "on_error=restart"], "'c': on_error 'restart' is not possible"),
    ("", ["use=small_components:Pilot", "parameters=null", "on_error=restart"],
     "'c': on_error 'restart' is not possible"),
]  # fmt: skip


@pytest.mark.parametrize(("fault", "keys", "message"), REFUSED)
def test_what_cannot_start_is_one_line(fly, fault, keys, message):
    """A refusal, a crash, a hang at the start is a problem of the scenario."""
    with pytest.raises(ScenarioError) as error:
        fly(fault, *keys)
    assert [p.message.partition(message)[1] for p in error.value.problems] == [message]


def test_a_component_that_does_not_terminate_is_killed(fly):
    """The result is there, and the failure told."""
    trace = fly("hang at last", "timeout_s=0.3")
    assert trace.result.outcome == "flown"
    assert trace.result.counts == {"errors.c": 1}
    assert "does not answer" in trace.events[0].message
    assert not is_running(trace["c.pid"][1][0])


def test_a_refused_parameter_is_an_error_at_its_time(fly, tmp_path):
    """An event that the component refuses ends the run then, not at the next step."""
    fly()
    scenario = load(tmp_path / "faulty.yaml", ["events=[{at_s: 0.5, set: c.gain, value: -1.0}]"])
    trace = Listening()
    simulate(build(scenario), [trace])
    expected = AT + "set failed, ValueError: gain: negative, got -1.0, expected 0 or more"
    assert re.fullmatch(re.escape(expected) + r" \(small_faults.py:\d+\)", trace.result.reason)
    assert "small_faults.py" in trace.events[-2].message.partition("\n")[2]  # the traceback


def run(text, folder, **more):
    """Run a script without any ``if __name__ == "__main__"``."""
    script = folder / "script.py"
    script.write_text(textwrap.dedent(text))
    return subprocess.Popen(
        [sys.executable, str(script)], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, **more,
    )  # fmt: skip


HEAD = """
import sys; sys.path.insert(0, {tests!r})
from orchestrator.assembly.build import build
from orchestrator.scenario.load import load
from orchestrator.run.simulate import simulate
system = build(load("faulty.yaml"))
pid = system.instances["c"].component
"""


def test_a_script_needs_no_guard(fly, tmp_path):
    """Flying at a script's top level starts one worker, which does not run the script again."""
    fly()
    text = HEAD.format(tests=str(Path(__file__).parent)) + "print(simulate(system).outcome)"
    out, err = run(text, tmp_path).communicate(timeout=60)
    assert (out, err) == ("flown\n", "")


def test_workers_end_with_a_parent_that_is_killed(fly, tmp_path):
    """SIGKILL of the run, while its component hangs, leaves neither process nor files."""
    fly("hang", "timeout_s=0.3")
    (tmp_path / "faulty.yaml").write_text(
        (tmp_path / "faulty.yaml").read_text().replace("duration_s: 1", "duration_s: 1000")
    )
    text = HEAD.format(tests=str(Path(__file__).parent)) + (
        "from orchestrator.figures.trace import Trace\n"
        "class Saying(Trace):\n"
        "    def outputs(self, time_ns, component, values):\n"
        "        if component == 'c' and not time_ns:\n"
        "            print(values['pid'], values['temporary'], flush=True)\n"
        "simulate(system, [Saying()])\n"
    )
    parent = run(text, tmp_path)
    pid, folder = parent.stdout.readline().split()
    assert is_running(pid)
    parent.kill()
    parent.communicate()
    for _ in range(500):
        if not is_running(pid) and not Path(folder).parent.exists():
            break
        time.sleep(0.01)
    assert not is_running(pid)
    assert not Path(folder).parent.exists()


def test_channels_carry_messages_of_any_size():
    """Long messages arrive whole, short ones one by one though they come together."""
    here, there = socket.socketpair()
    with here, there:
        sent = [np.arange(200_000.0), "a", "b", None, np.zeros(0)]
        data = b"".join(packed(message) for message in sent)
        writer = threading.Thread(target=Channel(here).write, args=(data,))
        writer.start()
        channel = Channel(there)
        for message in sent:
            assert np.array_equal(channel.read(), message)
        writer.join()
        channel.limit(0.01)
        with pytest.raises(TimeoutError):
            channel.read()
        here.close()
        with pytest.raises(EOFError):
            channel.read()


def test_the_shipped_scenario_flies_the_same_in_processes(scenarios, tmp_path):
    """Vehicle, terrain and MPC, rebuilt in two processes, give the recording of one process."""
    files = [tmp_path / "together.mcap", tmp_path / "apart.mcap"]
    apart = [f"components.{name}.isolation=process" for name in ("vehicle", "mpc")]
    for file, overrides in zip(files, ([], apart), strict=True):
        fly_file(scenarios / "jacksboro.yaml", ["duration_s=2", *overrides], file)
    assert diff(*files) == []


def test_a_part_of_a_script_cannot_be_isolated():
    """A class that only the running script has is refused in words."""

    def factory():
        return None

    factory.__module__ = "__main__"
    with pytest.raises(ValueError, match="isolation: not possible, got a part of a script"):
        Remote([Plan(("components", "c"), factory, {}, {})], ("components", "c"))


def test_plans_that_cannot_be_pickled_are_refused():
    """So is what has no name to be found by."""
    plan = Plan(("components", "c"), lambda: None, {}, {})
    with pytest.raises(ValueError, match="isolation: cannot go to another process"):
        Remote([plan], ("components", "c"))


def test_ctrl_c_ends_an_isolated_flight_in_order(fly, tmp_path):
    """SIGINT to the whole process group ends the run at the next instant, not the workers first."""
    fly()
    text = (tmp_path / "faulty.yaml").read_text().replace("duration_s: 1", "duration_s: 10000")
    (tmp_path / "faulty.yaml").write_text(text)
    command = [sys.executable, "-m", "orchestrator", "run", "faulty.yaml"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    process = subprocess.Popen(
        command, cwd=tmp_path, env=environment, process_group=0,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    recording = tmp_path / "faulty.mcap"
    while not (recording.exists() and recording.stat().st_size) and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "")
    assert "interrupted" in out
    assert Recording.open(recording).result.counts == {}
