"""Policies: for every fault, what ends and what goes on."""

import logging
import re

import numpy as np
import pytest
from scripted import Row, Scripted, clock, gain, system

from orchestrator.component import Status
from orchestrator.errors import ScenarioError
from orchestrator.figures.trace import Trace
from orchestrator.run import participant
from orchestrator.run.policies import MOST_HALVINGS
from orchestrator.run.simulate import simulate


def faulty(fault, kind="sampled", rate_hz=20.0, **more):
    """Return a component whose y is the number of steps; ``fault(values, time)`` acts in each."""

    def behave(values, time, step_size):
        values["y"] += 1.0
        return fault(values, time)

    return Scripted(
        kind, rate_hz, [Row("y", "output"), Row("plan", "output", shape=(3,))], behave, **more
    )


def at(instant, answer):
    """Return a fault at one instant: a status, or a change of values."""

    def fault(values, time):
        if time != instant:
            return Status.OK
        return answer(values) if callable(answer) else answer

    return fault


def fly(component, **keys):
    """Return trace and result of a run of ``c`` beside a 20 Hz reader of its y."""
    trace = Trace()
    made = system({"c": component, "reader": gain()}, ["c.y -> reader.u"], c=keys)
    simulate(made, [trace])
    return trace


def fail(values):
    raise RuntimeError("the sky is falling")


def spoil(values):
    values["y"] = float("nan")


def spoil_plan(values):
    values["plan"][1] = float("inf")


PLACE = f" (test_orchestrator_policies.py:{fail.__code__.co_firstlineno + 1})"
ENDS = [
    (Status.DISCARD, "discard", "c at t = 0.500 s: step is refused (Discard)"),
    (Status.ERROR, "error", "c at t = 0.500 s: step failed (Error)"),
    (Status.FATAL, "error", "c at t = 0.500 s: step failed (Fatal)"),
    (7, "error", "c at t = 0.500 s: step answered 7, expected a status 0 to 4"),
    (True, "error", "c at t = 0.500 s: step answered True, expected a status 0 to 4"),
    (fail, "error", "c at t = 0.500 s: step failed, RuntimeError: the sky is falling" + PLACE),
    (spoil, "nonfinite", "c at t = 0.500 s: output 'y' is not finite, got nan"),
    (spoil_plan, "nonfinite", "c at t = 0.500 s: output 'plan[1]' is not finite, got inf"),
]


@pytest.mark.parametrize(("answer", "kind", "reason"), ENDS)
def test_faults_end_the_run_by_default(answer, kind, reason):
    """The reason names component, variable, value and time, and is an event too."""
    trace = fly(faulty(at(0.5, answer)))
    assert trace.result.outcome == "component error"
    assert trace.result.reason == reason
    assert trace.result.time_ns == 500_000_000
    assert trace.events[0][:3] == (0.5, kind, "c")
    assert trace.events[0].message.startswith(reason)
    assert trace.events[-1].message == f"component error: {reason}"
    assert trace["c.y"][0][-1] == 0.45


def test_a_traceback_goes_into_the_event_and_nowhere_else(capfd):
    """What a component raises is recorded in full; the screen stays clean."""
    trace = fly(faulty(at(0.5, fail)))
    assert re.search(r"Traceback .*in fail\n.*RuntimeError", trace.events[0].message, re.DOTALL)
    assert capfd.readouterr() == ("", "")


def test_a_traceback_is_shown_where_it_is_asked_for(capfd, monkeypatch):
    """With HEDGEHOP_TRACEBACK=1 it goes to stderr, of what is held too."""
    monkeypatch.setenv("HEDGEHOP_TRACEBACK", "1")
    fly(faulty(at(0.5, fail)), on_error="hold")
    out, err = capfd.readouterr()
    assert out == ""
    assert re.search(r"^Traceback .*in fail\n.*RuntimeError", err, re.DOTALL)


@pytest.mark.parametrize("answer", [None, False, np.bool_(0), 0.0, "OK", 5, -1])
@pytest.mark.parametrize("keys", [{}, {"deadline_s": 10.0}])
def test_what_is_no_status_is_a_fault_of_the_component(answer, keys):
    """However false or small it is, timed or not; it counts as Error, which can be held."""
    component = clock(2.0, "sampled")
    component.step = lambda time, step_size: answer
    trace = fly(component, **keys)
    expected = f"c at t = 0.000 s: step answered {answer!r}, expected a status 0 to 4"
    assert trace.result.reason == expected
    assert fly(component, on_error="hold", **keys).result.outcome == "flown"


@pytest.mark.parametrize("answer", [0, Status.OK, np.int64(0), 1, np.int8(1)])
def test_any_integer_is_a_status(answer):
    """Of numpy too."""
    component = clock(2.0, "sampled")
    component.step = lambda time, step_size: answer
    trace = fly(component)
    assert trace.result.outcome == "flown"
    assert trace.result.counts == ({"warnings.c": 2} if answer else {})


def test_a_retried_step_without_a_status_is_a_fault():
    """The policy for refused steps does not mistake it for one."""
    component = picky(0.125)
    component.step = lambda time, step_size: None
    trace = fly(component, on_discard="retry")
    assert trace.result.reason.endswith("step answered None, expected a status 0 to 4")


@pytest.mark.parametrize("call", ["set", "get", "step"])
@pytest.mark.parametrize("kind", ["sampled", "continuous"])
def test_a_failure_names_the_call(call, kind):
    """Set, get or step: whichever raised, with the line of the component's own code."""
    component = gain(kind=kind)

    def fall(*_):
        raise KeyError("u")

    def breaking(values, time, step_size):
        if time == 0.5:
            due.append(time)

    due, member = [], getattr(component, call)
    setattr(component, call, lambda *arguments: fall() if due else member(*arguments))
    breaker = Scripted("sampled", 20.0, [Row("y", "output")], breaking)
    trace = Trace()
    simulate(system({"a": breaker, "c": component}, ["a.y -> c.u"]), [trace])
    line = fall.__code__.co_firstlineno + 1
    expected = f"s: {call} failed, KeyError: 'u' (test_orchestrator_policies.py:{line})"
    assert trace.result.reason.endswith(expected)


@pytest.mark.parametrize("answer", [Status.DISCARD, Status.ERROR, Status.FATAL])
def test_a_status_comes_with_what_was_logged_last(answer):
    """If the component has logged at that instant, that usually is the reason."""
    logger = logging.getLogger("hedgehop.component.c")

    def complain(values):
        logger.warning("too hot:\n%d K", 400)
        logging.getLogger("hedgehop.component.reader").warning("another's")
        return answer

    trace = fly(faulty(at(0.5, complain)))
    assert trace.result.reason.endswith(f"({answer.name.capitalize()}), it says: too hot: 400 K")

    def early(values, time):
        if time == 0.25:
            logger.warning("warm")
        return answer if time == 0.5 else Status.OK

    assert fly(faulty(early)).result.reason.endswith(f"({answer.name.capitalize()})")


HOLDS = [
    (Status.DISCARD, {"on_discard": "hold"}, 1, "discards.c"),
    (Status.ERROR, {"on_error": "hold"}, 10, "errors.c"),
    (fail, {"on_error": "hold"}, 10, "errors.c"),
    (spoil, {"on_nonfinite": "hold"}, 1, "nonfinite.c"),
]


@pytest.mark.parametrize("kind", ["sampled", "continuous"])
@pytest.mark.parametrize(("answer", "keys", "missed", "count"), HOLDS)
def test_held_outputs_keep_their_last_values(kind, answer, keys, missed, count):
    """Discard and non-finite outputs miss one publishing; a failed component is silent for good."""

    def behave(values):
        return answer(values) if callable(answer) else answer

    component = faulty(at(0.5, behave), kind)
    was = component.behave

    def healing(values, time, step_size):
        if not np.isfinite(values["y"]):
            values["y"] = 11.0
        return was(values, time, step_size)

    component.behave = healing
    trace = fly(component, **keys)
    assert trace.result.outcome == "flown"
    assert trace.result.counts == {count: 1}
    assert trace.events[0].message.split("\n")[0].endswith("outputs are held")
    seen = trace["reader.z"][1]
    late = 1 if kind == "continuous" else 0  # whose step at 0.5 s is for the next instant
    assert seen[10 + late] == seen[9 + late]
    assert len(seen) == 20
    assert len(trace["c.y"][0]) == 20 + late - missed


def test_fatal_cannot_be_held():
    """A component that must not be called again ends the run whatever the policy says."""
    component = faulty(at(0.5, Status.FATAL), name="c", log=[])
    trace = fly(component, on_error="hold", on_discard="hold")
    assert trace.result.outcome == "component error"
    assert component.log[-1] == ("c", "step", 0.5, 0.05)


def test_a_failed_component_is_only_terminated():
    """After Error and hold nobody calls the component until the end."""
    component = faulty(at(0.5, Status.ERROR), name="c", log=[])
    fly(component, on_error="hold")
    assert component.log[-2:] == [("c", "step", 0.5, 0.05), ("c", "terminate")]


def test_large_finite_outputs_are_finite():
    """Outputs whose sum overflows are still finite one by one."""

    def grow(values, time):
        values["plan"][:] = 1e308
        values["y"] = 1.7e308
        return Status.OK

    assert fly(faulty(grow)).result.outcome == "flown"


@pytest.mark.parametrize(("policy", "outcome", "published"), [
    ("log", "flown", 20), ("hold", "flown", 0), ("end", "component error", 0),
])  # fmt: skip
def test_deadlines(policy, outcome, published):
    """A step longer than its deadline is logged, its result dropped, or the end, as wanted."""
    trace = fly(faulty(lambda values, time: Status.OK), deadline_s=0.0, on_overrun=policy)
    assert trace.result.outcome == outcome
    assert trace.events[0].kind == "overrun"
    assert trace.result.counts["overruns.c"] == (20 if outcome == "flown" else 1)
    assert len(trace["c.y"][0]) == published


def test_an_overrun_with_latency_drops_one_result():
    """A held late result is never released; those before and after are."""
    trace = fly(faulty(lambda v, t: Status.OK), latency_s=0.1, deadline_s=0.0, on_overrun="hold")
    assert trace["c.y"][1].tolist() == [0.0]


def test_steps_within_their_deadline_pass():
    """A generous deadline changes nothing."""
    trace = fly(faulty(lambda values, time: Status.OK), deadline_s=1e6, on_overrun="end")
    assert trace.result.counts == {}


def test_wall_clock_is_measured_only_if_wanted(monkeypatch):
    """Without deadline and without an interested listener no clock is read in the loop."""
    told = []

    class Interested(Trace):
        wants_wall_clock = True

        def wall_clock(self, time_ns, component, elapsed_s):
            told.append((time_ns, component, elapsed_s >= 0.0))

    simulate(system({"c": clock(2.0)}), [Interested()])
    assert told == [(0, "c", True), (500_000_000, "c", True)]
    monkeypatch.delattr(participant, "perf_counter")
    simulate(system({"c": clock(2.0)}), [Trace()])


def picky(longest, *, refuses_forever=False):
    """Return an integrator of 1 that refuses steps longer than ``longest``, after moving."""

    def behave(values, time, step_size):
        values["y"] += step_size
        values["tries"] = values["tries"] + 1
        is_too_long = step_size > longest or (refuses_forever and time >= 0.5)
        return Status.DISCARD if is_too_long else Status.OK

    rows = [Row("y", "output"), Row("tries", "output", 0)]
    return Scripted("continuous", 2.0, rows, behave, variable_step=True, is_restorable=True)


def test_a_refused_step_is_tried_again_in_parts():
    """Back to where it was, then halves, quarters, ... until it is taken; the result is exact."""
    trace = Trace()
    made = system({"c": picky(0.125)}, c={"on_discard": "retry"})
    simulate(made, [trace])
    assert trace["c.y"][1].tolist() == [0.0, 0.5, 1.0]
    assert trace.result.counts == {"retries.c": 4}
    assert [event.message for event in trace.events[:2]] == [
        "c at t = 0.000 s: step is tried again in 2 parts",
        "c at t = 0.000 s: step is tried again in 4 parts",
    ]


def test_retries_come_to_an_end():
    """A component that refuses everything is asked a bounded number of times, and the run ends."""
    trace = Trace()
    component = picky(1.0, refuses_forever=True)
    simulate(system({"c": component}, c={"on_discard": "retry"}), [trace])
    assert trace.result.outcome == "component error"
    assert trace.result.counts == {"retries.c": MOST_HALVINGS, "discards.c": 1}


def test_a_snapshot_is_preferred_to_a_saved_state():
    """Going back uses what the component offers within its process, and lets go of it."""
    component, log = picky(0.25), []

    def snapshot():
        log.append("snapshot")
        return dict(component.values)

    component.snapshot = snapshot
    component.rewind = lambda kept: log.append("rewind") or component.values.update(kept)
    component.release = lambda kept: log.append("release")
    component.get_state = None
    trace = Trace()
    simulate(system({"c": component}, c={"on_discard": "retry"}), [trace])
    assert trace["c.y"][1].tolist() == [0.0, 0.5, 1.0]
    assert log == ["snapshot", "rewind", "release"] * 2


def bounded(values):
    """Return a component whose y follows ``values`` step by step, declared from 0 to 2."""
    rows = [Row("y", "output"), Row("plan", "output", shape=(3,), unit="m")]

    def behave(own, time, step_size):
        own["y"] = values(time)
        own["plan"] = np.array([0.0, values(time), 1.0])

    component = Scripted("sampled", 20.0, rows, behave)
    described = component.describe()
    for variable in described.modelVariables:
        if variable.name != "time":
            variable.min, variable.max = "0", "2"
    component.describe = lambda: described
    return component


def test_a_value_beyond_its_bounds_is_told_once():
    """One event per variable, with component, variable, value, bounds and time; the flight goes on."""
    trace = fly(bounded(lambda time: 3.0 if time >= 0.5 else 2.0))
    assert trace.result.outcome == "flown"
    start = "c at t = 0.500 s: output"
    assert [tuple(event) for event in trace.events[:-1]] == [
        (0.5, "range", "c", f"{start} {text}")
        for text in (
            "'y' is out of range, got 3.0, expected at least 0 and at most 2",
            "'plan[1]' is out of range, got 3.0 m, expected at least 0 m and at most 2 m",
        )
    ]
    assert trace.result.counts == {"out_of_range.c": 2}


def test_values_beyond_their_bounds_can_be_held():
    """With on_range hold no such value is published; one event tells."""
    trace = fly(bounded(lambda time: -1.0 if 0.2 <= time < 0.4 else 1.0), on_range="hold")
    assert len(trace["c.y"][1]) == 20 - 4
    assert set(trace["c.y"][1]) == {1.0}
    assert [event.message.endswith(", outputs are held") for event in trace.events[:-1]] == [
        True
    ] * 2


def test_a_value_beyond_its_bounds_can_end_the_run():
    """With on_range end the reason names it."""
    trace = fly(bounded(lambda time: 2.5 if time == 0.5 else 1.0), on_range="end")
    assert trace.result.reason.startswith("c at t = 0.500 s: output 'y' is out of range, got 2.5,")
    assert trace.result.outcome == "component error"


@pytest.mark.parametrize("component", [clock(2.0), clock(2.0, "sampled")])
def test_retry_needs_a_component_that_can(component):
    """Retry without variable steps and saved states is refused when coupling."""
    with pytest.raises(ScenarioError, match="'c': on_discard 'retry' is not possible"):
        system({"c": component}, c={"on_discard": "retry"})
