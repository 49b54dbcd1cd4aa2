"""The fault matrix: whatever an FMU does, the run ends or goes on as said, and is recorded.

Every flight has the faulty FMU beside a good one, which integrates the faulty one's output at the
same rate of 10 Hz; the fault happens in the step that begins at 0.3 s. Y of the faulty FMU is time.
"""

import gc
import math
import re
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest
from fmu_flights import complaints, flown, kinds, log, written

from orchestrator.command.app import status
from orchestrator.errors import ScenarioError
from orchestrator.flight import fly
from orchestrator.isolation import remote

pytestmark = pytest.mark.parametrize("fmi", [2, 3])

END = "component error"


@pytest.fixture(autouse=True)
def _patience():
    """Fail a test whose master hangs."""

    def give_up(*_):
        raise TimeoutError("the master hangs")

    signal.signal(signal.SIGALRM, give_up)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)


@pytest.fixture(autouse=True)
def _temporary(tmp_path, monkeypatch):
    """Give every test a folder for temporary files that must be empty in the end."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    gc.collect()  # a caught exception may hold a component that was never run
    assert list(folder.iterdir()) == []


@pytest.fixture
def fault(fmu, fmi, tmp_path):
    """Return a function that flies a fault and returns the recording."""

    def fly_fault(fault, *, isolation="none", keys=(), wall_clock=False, **defines):
        bad = {"use": fmu("faulty", fmi=fmi, FAULT=fault, **defines), "rate_hz": 10}
        good = {"use": fmu("integrator", fmi=fmi), "rate_hz": 10}
        made = {"bad": {**bad, "isolation": isolation, **dict(keys)}, "good": good}
        recording = {"wall_clock": wall_clock}
        return flown(tmp_path, made, ["bad.y -> good.u"], recording=recording)

    return fly_fault


def assert_ended(recording, kind, reason):
    """Assert that the run ended at 0.3 s (outputs: 0.4 s), the named event before the end."""
    result = recording.result
    assert result.outcome == END
    assert re.fullmatch(rf"bad at t = 0\.[34]00 s: {reason}", result.reason), result.reason
    assert kinds(recording) == [kind]
    event = recording.events[0]
    assert event.component == "bad"
    assert event.message.startswith(result.reason)
    assert event.time_s == pytest.approx(result.time_ns / 1e9)
    assert recording.events[-1].message == f"{END}: {result.reason}"
    times, values = recording["bad.y"]
    assert times[-1] == pytest.approx(0.3)
    assert values == pytest.approx(times, abs=1e-12)
    assert recording["good.y"][0][-1] == pytest.approx(result.time_ns / 1e9, abs=0.11)


def assert_flown(recording, *expected):
    """Assert that the run went on to its end, with these kinds of events."""
    assert recording.result.outcome == "flown", recording.result.reason
    assert kinds(recording) == list(expected)
    assert recording["good.y"][0][-1] == 1.0


def assert_exact(recording, *expected):
    """Assert that the run went on and the faulty FMU's output is the time all along."""
    assert_flown(recording, *expected)
    times, values = recording["bad.y"]
    assert len(times) == 11
    assert values == pytest.approx(times, abs=1e-12)


# ---- the process ends or hangs ----

CRASHES = [
    ("SEGFAULT", "died", "killed by SIGSEGV"),
    ("ABORT", "died", "killed by SIGABRT"),
    ("EXIT", "died", "exit code 3"),
    ("HANG", "timeout", "not answer"),
]


@pytest.mark.parametrize(("what", "kind", "reason"), CRASHES)
def test_a_lost_process_ends_the_run(fault, what, kind, reason):
    """A crash, an exit and a hang of an isolated FMU are named events; the recording is whole."""
    keys = {"timeout_s": 1.0} if what == "HANG" else {}
    recording = fault(what, isolation="process", keys=keys)
    assert_ended(recording, kind, f".*{reason}.*")


@pytest.mark.parametrize(("what", "kind"), [(c[0], c[1]) for c in CRASHES if c[0] != "ABORT"])
def test_a_lost_process_can_be_held(fault, what, kind):
    """With on_error: hold its last outputs stay and the others fly on."""
    keys = {"on_error": "hold"} | ({"timeout_s": 1.0} if what == "HANG" else {})
    recording = fault(what, isolation="process", keys=keys)
    assert_flown(recording, kind)
    assert recording["bad.y"][0][-1] == pytest.approx(0.3)
    held = 0.1 * (0 + 0.1 + 0.2 + 7 * 0.3)  # by hand: u of the good FMU's ten steps
    assert recording["good.y"][1][-1] - 1.0 == pytest.approx(held)


@pytest.mark.parametrize(("what", "kind"), [(c[0], c[1]) for c in CRASHES if c[0] != "ABORT"])
def test_a_lost_process_can_be_restarted(fault, what, kind, tmp_path, monkeypatch):
    """With on_error: restart a new process takes the step again, and no trace of the fault is left.

    The fault happens once: a file says that it has.
    """
    monkeypatch.setenv("FMU_ONCE", str(tmp_path / "once"))
    keys = {"on_error": "restart"} | ({"timeout_s": 1.0} if what == "HANG" else {})
    recording = fault(what, isolation="process", keys=keys, SERIALIZED=1)
    assert_exact(recording, kind, "restart")


def test_a_restart_that_does_not_help_ends_the_run(fault):
    """The same step failing twice is the end: there is no third process."""
    recording = fault("SEGFAULT", isolation="process", keys={"on_error": "restart"}, SERIALIZED=1)
    assert recording.result.outcome == END
    assert kinds(recording) == ["died", "restart", "died"]
    assert recording["bad.y"][0][-1] == pytest.approx(0.3)


def test_a_restart_needs_a_state_that_can_be_saved(fmu, fmi, tmp_path):
    """Without one the scenario is refused, in one line."""
    use = fmu("faulty", fmi=fmi, FAULT="SEGFAULT")
    bad = {"use": use, "rate_hz": 10, "isolation": "process", "on_error": "restart"}
    with pytest.raises(
        ScenarioError, match="on_error 'restart' is not possible.*State|state"
    ) as caught:
        fly(written(tmp_path, {"bad": bad}))
    assert len(caught.value.problems) == 1


def test_a_process_that_ends_between_two_steps_is_lost_too(fmu, fmi, tmp_path):
    """A broken connection is found by the next step, while another component took its time."""
    later = fmu("faulty", fmi=fmi, FAULT="EXIT_LATER")
    slow = fmu("faulty", fmi=fmi, FAULT="SLEEP", DURATION=0.3)
    components = {
        "bad": {"use": later, "rate_hz": 10, "isolation": "process"},
        "slow": {"use": slow, "rate_hz": 10},
    }
    recording = flown(tmp_path, components)
    assert recording.result.outcome == END
    assert re.fullmatch(r"bad at t = 0.400 s: .*SIGALRM.*", recording.result.reason)
    assert kinds(recording) == ["died"]


def test_a_native_component_can_be_isolated_too(fmi, tmp_path):
    """A Python component whose process is killed is lost like an FMU."""
    components = {"bad": {"use": "lethal:Lethal", "rate_hz": 10, "isolation": "process"}}
    recording = flown(tmp_path, components)
    assert recording.result.reason.startswith("bad at t = 0.300 s: ")
    assert "SIGKILL" in recording.result.reason
    assert kinds(recording) == ["died"]


@pytest.mark.parametrize("where", ["Terminate", "FreeInstance"])
def test_a_crash_at_the_very_end_spoils_nothing(fault, where):
    """The flight counts, the recording is finished, and the crash is told."""
    recording = fault("SEGFAULT", isolation="process", WHERE=f'"{where}"')
    assert recording.result.outcome == "flown"
    assert len(recording["bad.y"][0]) == 11
    assert kinds(recording) == ["error"]
    assert "SIGSEGV" in recording.events[0].message


# ---- slow ----


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize("policy", ["log", "hold", "end"])
def test_an_overrun_is_told(fault, policy, isolation):
    """A step above its deadline is an event; log keeps its outputs, hold misses one publishing."""
    keys = {"deadline_s": 0.2, "on_overrun": policy}
    recording = fault("SLEEP", isolation=isolation, keys=keys, wall_clock=True, DURATION=0.4)
    event = next(e for e in recording.events if e.time_s == pytest.approx(0.3))
    assert event.kind == "overrun"
    assert re.search(r"step took 0\.[4-9].* s, expected at most 0\.2 s", event.message)
    assert recording.result.counts["overruns.bad"] >= 1
    assert recording.result.outcome == (END if policy == "end" else "flown")
    if policy != "end":
        times, values = recording["bad.y"]
        assert (0.4 in times.round(9)) == (policy == "log")
        assert values[-1] == pytest.approx(1.0)


# ---- answers of a step ----


@pytest.mark.parametrize("isolation", ["none", "process"])
def test_a_warning_is_told_and_the_step_counts(fault, isolation):
    """Warning is an event and nothing else."""
    recording = fault("WARN", isolation=isolation)
    assert_exact(recording, "warning")
    assert recording.result.counts == {"warnings.bad": 1}


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize(
    ("what", "kind", "reason"),
    [
        ("REFUSE", "discard", r"step is refused \(Discard\).*"),
        ("FAIL", "error", r".*Error.*"),
        ("DIE", "error", r".*Fatal.*"),
        ("NOT_A_NUMBER", "nonfinite", "output 'y' is not finite, got nan"),
        ("INFINITE", "nonfinite", "output 'y' is not finite, got inf"),
        ("TERMINATED", "error", ".*(asks|wants|end|terminat).*"),
    ],
)
def test_faults_end_the_run_by_default(fault, what, kind, reason, isolation):
    """The reason names component, variable, value and time, and is an event too."""
    assert_ended(fault(what, isolation=isolation), kind, reason)


@pytest.mark.parametrize("isolation", ["none", "process"])
def test_the_reason_of_an_error_is_in_the_log(fault, isolation):
    """What the FMU says about itself is recorded at its simulated time."""
    recording = fault("FAIL", isolation=isolation)
    said = [(time, message) for time, _, message in log(recording) if "the model failed" in message]
    own = [message for _, message in said if not message.startswith(("error:", "end:"))]
    assert [time for time, _ in said] == pytest.approx([0.3] * 3)  # its own, the event, the end
    assert len(own) == 1
    assert own[0].endswith("the model failed (at 0.3 s)")
    assert recording.result.reason.endswith(f"step failed (Error), it says: {own[0]}")


@pytest.mark.parametrize(
    ("what", "key", "kind", "missed"),
    [
        ("REFUSE", "on_discard", "discard", 1),
        ("FAIL", "on_error", "error", 7),
        ("NOT_A_NUMBER", "on_nonfinite", "nonfinite", 1),
        ("INFINITE", "on_nonfinite", "nonfinite", 1),
    ],
)
def test_faults_can_be_held(fault, what, key, kind, missed):
    """The last good outputs stay: nothing that is not finite reaches anyone."""
    recording = fault(what, keys={key: "hold"})
    times, values = recording["bad.y"]
    assert_flown(recording, kind)
    assert len(times) == 11 - missed
    assert all(map(math.isfinite, values))
    assert all(map(math.isfinite, recording["good.y"][1]))


def test_an_error_can_be_restarted(fault, tmp_path, monkeypatch):
    """A new process goes on from the state before the step that failed."""
    monkeypatch.setenv("FMU_ONCE", str(tmp_path / "once"))
    recording = fault("FAIL", isolation="process", keys={"on_error": "restart"}, SERIALIZED=1)
    assert_exact(recording, "error", "restart")


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize("policy", ["end", "hold"])
def test_after_fatal_nothing_is_called(fault, isolation, policy, tmp_path, monkeypatch):
    """Not even terminate or freeInstance, whatever the policy."""
    trace = tmp_path / "calls.txt"
    monkeypatch.setenv("FMU_TRACE", str(trace))
    assert_ended(fault("DIE", isolation=isolation, keys={"on_error": policy}), "error", ".*Fatal.*")
    calls = [line.split() for line in trace.read_text().splitlines()]
    assert [call for name, call in calls if name == "bad"][-1] == "DoStep"
    assert [call for name, call in calls if name == "good"][-2:] == ["Terminate", "FreeInstance"]


@pytest.mark.parametrize("policy", ["log", "hold", "end"])
def test_a_value_out_of_range_is_told_once(fault, policy):
    """Min and max are the FMU's own; the one event names variable, value and bound."""
    recording = fault("OUT_OF_RANGE", keys={"on_range": policy}, TIMES=-1)
    assert kinds(recording) == ["range"]
    assert re.search(r"bad at t = 0.400 s: .*'y'.*1000\.4.*100", recording.events[0].message)
    assert recording.result.outcome == (END if policy == "end" else "flown")
    assert max(recording["bad.y"][1]) == pytest.approx(1001.0 if policy == "log" else 0.3)


# ---- steps that are refused or cut short ----

FREE = {"VARIABLE": 1, "STATE_SAVED": 1}


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize("serialized", [0, 1])
@pytest.mark.parametrize(
    ("what", "more"),
    [("REFUSE", {}), ("REFUSE_LONG", {"LIMIT": 0.03}), ("REFUSE_HALF", {})],
)
def test_a_refused_step_is_tried_again_in_parts(fault, what, more, serialized, isolation):
    """With on_discard: retry the answer is exact, also where a state can be saved but not written."""
    keys = {"on_discard": "retry"}
    recording = fault(what, keys=keys, isolation=isolation, SERIALIZED=serialized, **FREE, **more)
    assert set(kinds(recording)) <= {"retry"}
    assert recording.result.outcome == "flown"
    assert recording["bad.y"][1][-1] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("what", ["REFUSE", "REFUSE_HALF", "STAND_STILL"])
def test_a_step_that_is_refused_for_ever_ends_the_run(fault, what):
    """Retrying is bounded; so is going on from where a step stopped short."""
    recording = fault(what, keys={"on_discard": "retry"}, TIMES=-1, AT=3, **FREE)
    if what == "REFUSE_HALF":  # every part of a part is done by half: time does advance
        assert recording.result.outcome in ("flown", END)
        return
    assert recording.result.outcome == END
    assert recording.result.time_ns == 300_000_000
    assert set(kinds(recording)) <= {"retry", "discard", "error"}


def test_trying_again_needs_a_variable_step(fmu, fmi, tmp_path):
    """An FMU that cannot take smaller steps, or go back, is refused with that policy at load."""
    for flags in ({"VARIABLE": 1}, {"STATE_SAVED": 1}):
        use = fmu("faulty", fmi=fmi, FAULT="REFUSE", **flags)
        bad = {"use": use, "rate_hz": 10, "on_discard": "retry"}
        with pytest.raises(ScenarioError, match=r"on_discard"):
            fly(written(tmp_path, {"bad": bad}))


def test_an_early_return_is_continued(fault, fmi):
    """Also of an FMU that has not declared it (FMI 3): from the last successful time."""
    if fmi == 2:  # which knows early return as a Discard that got somewhere
        assert_exact(fault("REFUSE_HALF", TIMES=3))
    else:
        assert_exact(fault("RETURN_EARLY", TIMES=3))


def test_events_without_an_end_end_the_run(fault, fmi):
    """Event mode that is never done is an Error, not a hang (FMI 3; FMI 2 has a still step)."""
    recording = fault("EVENT_LOOP" if fmi == 3 else "STAND_STILL", TIMES=-1)
    assert recording.result.outcome == END
    assert recording.result.time_ns == 300_000_000
    assert kinds(recording) in (["error"], ["discard"])


# ---- messages ----


@pytest.mark.parametrize("isolation", ["none", "process"])
def test_messages_go_to_the_log(fault, isolation):
    """With time and level, and per cent signs as they are."""
    recording = fault("LOG", isolation=isolation)
    assert_exact(recording)
    said = [(t, level, m) for t, level, m in log(recording) if "ice" in m or "sure" in m]
    assert [t for t, _, _ in said] == pytest.approx([0.3, 0.3])
    assert said[0][2].endswith("ice on the wing (at 0.3 s)")
    assert said[1][2].endswith("100% sure (at 0.3 s)")
    assert said[0][1] > said[1][1]


# ---- before the first step ----


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize(
    "where", ["Instantiate", "EnterInitializationMode", "ExitInitializationMode"]
)
def test_a_failed_start_is_one_line(fmu, fmi, where, isolation, tmp_path, capfd):
    """Exit code 2, no recording, and the FMU's own words where it has some."""
    use = fmu("faulty", fmi=fmi, FAULT="FAIL", WHERE=f'"{where}"')
    file = written(tmp_path, {"bad": {"use": use, "rate_hz": 10, "isolation": isolation}})
    out = tmp_path / "flight.mcap"
    assert status(["run", str(file), "--out", str(out)]) == 2
    error = capfd.readouterr().err.strip()
    assert len(complaints(error)) == 1
    assert "'bad'" in error or "components.bad" in error
    assert re.search("instantiat|nitializ", error)
    assert not out.exists()


@pytest.mark.parametrize("what", ["SEGFAULT", "EXIT", "HANG"])
@pytest.mark.parametrize("where", ["Instantiate", "EnterInitializationMode"])
def test_a_process_lost_at_the_start_is_one_line(
    fmu, fmi, what, where, tmp_path, capfd, monkeypatch
):
    """The same for a crash or a hang of an isolated FMU, while it is made or initialized."""
    monkeypatch.setattr(remote, "MAKING_S", 2.0)
    use = fmu("faulty", fmi=fmi, FAULT=what, WHERE=f'"{where}"')
    bad = {"use": use, "rate_hz": 10, "isolation": "process", "timeout_s": 2.0}
    file = written(tmp_path, {"bad": bad})
    assert status(["run", str(file), "--out", str(tmp_path / "flight.mcap")]) == 2
    error = capfd.readouterr().err.strip()
    assert len(complaints(error)) == 1
    assert "bad" in error


# ---- errors found at load ----


def refused(folder, components, connections=(), **keys):
    """Return what a scenario is refused for."""
    with pytest.raises(ScenarioError) as caught:
        fly(written(folder, components, connections, **keys))
    return str(caught.value)


def test_a_misspelt_variable_has_a_nearest_name(fmu, fmi, tmp_path):
    """On either side of a connection."""
    two = {"a": {"use": fmu("relay", fmi=fmi)}, "b": {"use": fmu("staircase", fmi=fmi)}}
    for one in two.values():
        one["rate_hz"] = 10
    text = refused(tmp_path, two, ["b.cuont -> a.u"])
    assert "'cuont'" in text
    assert "did you mean 'count'" in text


def test_a_misspelt_parameter_has_a_nearest_name_and_a_place(fmu, fmi, tmp_path):
    """Parameters of the scenario are start values of the FMU's own names."""
    one = {"use": fmu("feedthrough", fmi=fmi), "rate_hz": 10, "parameters": {"gear_ration": 2.0}}
    text = refused(tmp_path, {"a": one})
    assert re.match(r".*flight\.yaml:\d+:\d+: components\.a\.parameters\.gear_ration", text)
    assert "did you mean 'gear_ratio'" in text


def test_causality_is_checked(fmu, fmi, tmp_path):
    """An output cannot be driven, an input has one source."""
    two = {name: {"use": fmu("relay", fmi=fmi), "rate_hz": 10} for name in "ab"}
    assert "output" in refused(tmp_path, two, ["a.y -> b.y"])
    assert "a.y" in refused(tmp_path, two, ["a.y -> b.u", "b.y -> b.u"])


def test_kinds_and_shapes_are_checked(fmu, fmi, tmp_path):
    """A text is no number, and three numbers are no matrix."""
    arrays = {"arrays": True} if fmi == 2 else {}
    two = {n: {"use": fmu("feedthrough", fmi=fmi), "rate_hz": 10, "fmu": arrays} for n in "ab"}
    assert "String_out" in refused(tmp_path, two, ["a.String_out -> b.Float64_in"])
    assert "shape" in refused(tmp_path, two, ["a.vector_out -> b.matrix_in"])


def test_a_cycle_of_feedthrough_is_named(fmu, fmi, tmp_path):
    """By what the ModelStructure says; another pair of variables makes no cycle."""
    two = {n: {"use": fmu("feedthrough", fmi=fmi), "rate_hz": 10} for n in "ab"}
    loop = ["a.Float64_out -> b.Float64_in", "b.Float64_out -> a.Float64_in"]
    text = refused(tmp_path, two, loop)
    assert "cycle" in text or "loop" in text
    assert "a" in text
    assert "b" in text
    chain = ["a.Float64_out -> b.Float64_in", "b.Int32_out -> a.Int32_in"]
    assert flown(tmp_path, two, chain).result.outcome == "flown"


def test_rates_must_be_whole_nanoseconds(fmu, fmi, tmp_path):
    """As for every component."""
    assert "rate_hz" in refused(tmp_path, {"a": {"use": fmu("relay", fmi=fmi), "rate_hz": 3}})


def test_a_step_that_the_fmu_cannot_take_is_refused(fmu, fmi, tmp_path):
    """A fixed internal step of 20 ms: 50 Hz and 25 Hz fly, 40 Hz does not (FMI 3 declares it)."""
    use = fmu("fixedstep", fmi=fmi)
    for rate in (50, 25):
        recording = flown(tmp_path, {"a": {"use": use, "rate_hz": rate}})
        assert recording["a.y"][1][-1] == pytest.approx(1.0)
    if fmi == 3:
        text = refused(tmp_path, {"a": {"use": use, "rate_hz": 40}})
        assert "0.02" in text
    else:  # FMI 2 has no word for it: the FMU says so itself, in the first step
        assert flown(tmp_path, {"a": {"use": use, "rate_hz": 40}}).result.outcome == END


def test_the_rate_is_the_fmus_own_where_none_is_given(fmu, fmi, tmp_path):
    """Its internal step, or that of its default experiment."""
    recording = flown(tmp_path, {"a": {"use": fmu("fixedstep", fmi=fmi)}})
    assert len(recording["a.y"][0]) == 51


def test_too_many_steps_are_refused(fmu, fmi, tmp_path):
    """Before anything runs."""
    one = {"a": {"use": fmu("relay", fmi=fmi), "rate_hz": 1000}}
    text = refused(tmp_path, one, duration_s=1_000_000)
    assert "too many steps, got 1000000000" in text


def test_a_missing_file_is_named(fmi, tmp_path):
    """With what is there instead."""
    Path(tmp_path / f"plant{fmi}.fmu").touch()
    text = refused(tmp_path, {"a": {"use": f"plent{fmi}.fmu", "rate_hz": 10}})
    assert f"plent{fmi}.fmu" in text
    assert len(complaints(text)) == 1


@pytest.mark.parametrize("what", ["SEGFAULT", "FAIL", "DIE", "NONE"])
def test_no_worker_is_left_behind(fault, what, monkeypatch):
    """However the run ended, its processes have ended too and have been waited for."""
    started = []

    class Noted(subprocess.Popen):
        def __init__(self, *arguments, **keys):
            super().__init__(*arguments, **keys)
            started.append(self)

    monkeypatch.setattr("orchestrator.isolation.process.subprocess.Popen", Noted)
    fault(what, isolation="process")
    workers = [one for one in started if "orchestrator.isolation" in str(one.args)]
    assert len(workers) == 1
    assert workers[0].returncode is not None
