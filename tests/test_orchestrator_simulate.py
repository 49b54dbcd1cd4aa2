"""The run: who is called when, what is visible when, and how it ends."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import RandomWalk, Row, Scripted, clock, counter, gain, integrator, system

from orchestrator.component import Status
from orchestrator.errors import CouplingError, ScenarioError
from orchestrator.figures.trace import Trace
from orchestrator.run.initialize import component_seed
from orchestrator.run.simulate import simulate
from orchestrator.scenario.records import EventSpec


def fly(*arguments, **keys):
    """Return the trace of a scripted system's run."""
    trace = Trace()
    simulate(system(*arguments, **keys), [trace])
    return trace


def calls(log):
    """Return logged calls as words."""
    return [
        f"{name}.{verb}({', '.join(f'{x:g}' for x in rest) if verb == 'step' else ''})"
        if verb != "set"
        else f"{name}.set({', '.join(f'{k}={v:g}' for k, v in rest[0].items())})"
        for name, verb, *rest in log
    ]


ONE_SECOND = """
    plant.initialize() plant.get() mpc.set(u=0) mpc.initialize() mpc.get()
    plant.get() mpc.set(u=0) mpc.step(0, 0.5) mpc.get() plant.set(u=0) plant.step(0, 0.05)
    plant.get() plant.set(u=0) plant.step(0.05, 0.05)
    plant.get() plant.set(u=0) plant.step(0.1, 0.05)
    plant.get() plant.set(u=0) plant.step(0.15, 0.05)
    plant.get() plant.set(u=0) plant.step(0.2, 0.05)
    plant.get() plant.set(u=0) plant.step(0.25, 0.05)
    plant.get() plant.set(u=0) plant.step(0.3, 0.05)
    plant.get() plant.set(u=0) plant.step(0.35, 0.05)
    plant.get() plant.set(u=0) plant.step(0.4, 0.05)
    plant.get() plant.set(u=0) plant.step(0.45, 0.05)
    plant.get() mpc.set(u=10) mpc.step(0.5, 0.5) mpc.get() plant.set(u=20) plant.step(0.5, 0.05)
    plant.get() plant.set(u=20) plant.step(0.55, 0.05)
    plant.get() plant.set(u=20) plant.step(0.6, 0.05)
    plant.get() plant.set(u=20) plant.step(0.65, 0.05)
    plant.get() plant.set(u=20) plant.step(0.7, 0.05)
    plant.get() plant.set(u=20) plant.step(0.75, 0.05)
    plant.get() plant.set(u=20) plant.step(0.8, 0.05)
    plant.get() plant.set(u=20) plant.step(0.85, 0.05)
    plant.get() plant.set(u=20) plant.step(0.9, 0.05)
    plant.get() plant.set(u=20) plant.step(0.95, 0.05)
    plant.get() plant.terminate() mpc.terminate()
"""


def test_one_second_of_20_and_2_hz():
    """The controller's output acts on the plant at the instant at which its input was measured.

    One line per instant. The plant counts its steps; the controller answers twice the count.
    """
    log = []
    simulate(
        system(
            {
                "plant": counter(20.0, "continuous", name="plant", log=log),
                "mpc": gain(2.0, 2.0, name="mpc", log=log),
            },
            ["plant.y -> mpc.u", "mpc.z -> plant.u"],
        )
    )
    assert calls(log) == re.findall(r"\S+\(.*?\)", ONE_SECOND)


def test_a_closed_loop_is_exact():
    """An integrator under proportional control at 2 Hz decays by 1 - k T per period."""
    trace = fly(
        {"plant": integrator(20.0, y=1.0), "mpc": gain(-1.0, 2.0)},
        ["plant.y -> mpc.u", "mpc.z -> plant.u"],
        duration_s=2.0,
    )
    times, y = trace["plant.y"]
    np.testing.assert_allclose(times, np.arange(41) * 0.05, rtol=0, atol=1e-15)
    np.testing.assert_allclose(y[::10], 0.5 ** np.arange(5), rtol=1e-14)
    assert trace["mpc.z"][0].tolist() == [0.0, 0.5, 1.0, 1.5]


def test_a_slow_continuous_output_is_never_early():
    """x(0.5) of a component that steps by 0.5 s is seen at 0.5 s and not before."""
    trace = fly(
        {"slow": clock(2.0), "probe": gain(rate_hz=20.0)}, ["slow.y -> probe.u"], duration_s=1.0
    )
    times, seen = trace["probe.z"]
    np.testing.assert_array_equal(seen, np.floor(times / 0.5 + 1e-9) * 0.5)


rates = st.sampled_from([1.0, 2.0, 4.0, 5.0, 10.0, 20.0])


@given(rates, rates, st.integers(0, 30), st.integers(0, 30))
def test_what_is_seen_when(source_hz, reader_hz, latency_ticks, delay_ticks):
    """At t a reader sees the newest sample that was taken at or before t - latency - delay."""
    components = {"source": clock(source_hz, "sampled"), "reader": gain(rate_hz=reader_hz)}
    tick = system(components).schedule.base_ns / 1e9
    latency, delay = latency_ticks * tick, delay_ticks * tick
    trace = fly(
        {"source": clock(source_hz, "sampled"), "reader": gain(rate_hz=reader_hz)},
        [("source.y -> reader.u", round(delay, 9))],
        duration_s=4.0,
        source={"latency_s": round(latency, 9)},
    )
    times, seen = trace["reader.z"]
    newest = np.floor((times - latency - delay) * source_hz + 1e-6) / source_hz
    np.testing.assert_allclose(seen, np.maximum(newest, 0.0), rtol=0, atol=1e-12)


class InHalves(Scripted):
    """A scripted component that lives elsewhere: a step can be begun before it is waited for."""

    def begin_step(self, time, step_size):
        """Begin."""
        self._say("begin")
        self.begun = time, step_size

    def finish_step(self):
        """Step now."""
        self._say("finish")
        return self.step(*self.begun)


def test_steps_in_several_processes_overlap():
    """All that advance at an instant have begun before one is waited for, and nothing else changes.

    The same flight as one after the other; a component with a deadline is not kept waiting.
    """

    def cross(make, **more):
        log = []
        rows = [Row("u", "input"), Row("y", "output")]
        parts = {
            name: make("continuous", 20.0, rows, accumulate, name=name, log=log, values={"y": y})
            for name, y in (("a", 1.0), ("b", 2.0), ("c", 3.0))
        }
        links = ["a.y -> b.u", "b.y -> c.u", "c.y -> a.u"]
        return fly(parts, links, duration_s=0.5, **more)["c.y"][1], log

    def accumulate(values, time, step_size):
        values["y"] += step_size * values["u"]

    y, log = cross(InHalves)
    np.testing.assert_array_equal(y, cross(Scripted)[0])
    order = [f"{name}.{verb}" for name, verb, *_ in log if verb in ("begin", "finish")]
    assert order[:6] == ["a.begin", "b.begin", "c.begin", "a.finish", "b.finish", "c.finish"]
    _, log = cross(InHalves, b={"deadline_s": 10.0})
    order = [f"{name}.{verb}" for name, verb, *_ in log if verb in ("begin", "finish", "step")]
    assert order[:6] == ["a.begin", "c.begin", "a.finish", "a.step", "b.step", "c.finish"]


def test_latency_publishes_late_and_once():
    """The first outputs hold from 0; every result is published at its instant plus latency."""
    trace = fly({"late": counter(2.0)}, duration_s=2.0, late={"latency_s": 0.5})
    times, y = trace["late.y"]
    assert times.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert y.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_latency_longer_than_the_period_keeps_results_apart():
    """Two results may be on their way at once."""
    trace = fly(
        {"late": counter(2.0), "tick": clock(4.0)}, duration_s=2.0, late={"latency_s": 0.75}
    )
    times, y = trace["late.y"]
    assert times.tolist() == [0.0, 0.75, 1.25, 1.75]
    assert y.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_a_delayed_input_keeps_its_start_value():
    """Until the delay has passed for the first time, the reader's own start value counts."""
    reader = gain()
    reader.rows[0] = Row("u", "input", 7.0)
    reader.values["u"] = 7.0
    trace = fly({"source": clock(20.0), "reader": reader}, [("source.y -> reader.u", 0.1)])
    np.testing.assert_allclose(trace["reader.z"][1][:5], [7.0, 7.0, 0.0, 0.05, 0.1], atol=1e-15)


def test_continuous_feed_through_is_passed_on_at_once():
    """A continuous gain shows at t what its source shows at t, and is recorded so."""
    trace = fly(
        {"last": gain(), "middle": gain(2.0, kind="continuous"), "first": clock()},
        ["first.y -> middle.u", "middle.z -> last.u"],
    )
    times, z = trace["middle.z"]
    np.testing.assert_allclose(z, 2 * times, atol=1e-15)
    np.testing.assert_array_equal(trace["last.z"][1], z[:-1])


def split_plant(**more):
    """Return a plant whose state y integrates u and whose actuator output passes u on."""

    def behave(values, time, step_size):
        values["y"] += step_size * values["u"]

    rows = [Row("u", "input"), Row("y", "output"), Row("actuator", "output", through=("u",))]
    return Scripted(
        "continuous",
        20.0,
        rows,
        behave,
        lambda v: v.update(actuator=v["u"]),
        values={"y": 1.0},
        **more,
    )


def test_a_component_read_twice_is_published_once():
    """State and actuator of one instant are told together, the command of that instant in it."""
    trace = fly(
        {"plant": split_plant(), "mpc": gain(-3.0)}, ["plant.y -> mpc.u", "mpc.z -> plant.u"]
    )
    times, actuator = trace["plant.actuator"]
    assert len(times) == len(set(times)) == 21
    np.testing.assert_array_equal(actuator[:-1], -3.0 * trace["plant.y"][1][:-1])


def test_units_are_converted_on_the_way():
    """A source in km arrives in m, and the listener is told of the converted input."""
    told = []
    source = Scripted("sampled", 2.0, [Row("y", "output", unit="km")], values={"y": 1.5})
    reader = Scripted("sampled", 2.0, [Row("u", "input", unit="m"), Row("z", "output")])
    made = system({"source": source, "reader": reader}, ["source.y -> reader.u"])
    listener = Trace()
    listener.inputs = lambda *what: told.append(what)
    simulate(made, [listener])
    assert reader.values["u"] == 1500.0
    assert told == [(0, "reader", {"u": 1500.0}), (500_000_000, "reader", {"u": 1500.0})]


def test_the_same_seed_gives_the_same_run():
    """Two runs agree to the last bit; another seed does not."""
    runs = [fly({"walk": RandomWalk()}, seed=seed)["walk.y"][1].tobytes() for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


def test_a_component_more_changes_no_seed():
    """A component's randomness depends on the scenario's seed and its own name alone."""
    alone = fly({"walk": RandomWalk()})["walk.y"][1]
    beside = fly({"other": RandomWalk(), "walk": RandomWalk()})
    np.testing.assert_array_equal(beside["walk.y"][1], alone)
    assert not np.array_equal(beside["other.y"][1], alone)
    assert component_seed(1, "walk") == 1849540544955161197


def test_progress_and_parameters_are_told():
    """Progress rises to the end; parameters are told once at the start."""
    told, seen = [], []
    component = Scripted(
        "sampled", 20.0, [Row("y", "output"), Row("k", "parameter", 2.0), Row("u", "input")]
    )
    listener = Trace()
    listener.parameters = lambda *what: told.append(what)
    simulate(system({"c": component}, duration_s=100.0), [listener], progress=seen.append)
    assert told == [(0, "c", {"k": 2.0})]
    assert seen == sorted(seen)
    assert seen[0] == 0
    assert seen[-1] == 100 * 10**9
    assert 190 <= len(seen) <= 210


def test_the_run_ends_where_an_outcome_is_not_zero():
    """The first tick whose enumeration is not 0 is the last; its item is the outcome."""

    def behave(values, time, step_size):
        values["outcome"] = 1 if time + step_size > 0.32 else 0

    rows = [Row("outcome", "output", 0, items=("flying", "collision"))]
    trace = fly({"plant": Scripted("continuous", 20.0, rows, behave)}, end_on=["plant.outcome"])
    assert trace.result.outcome == "collision"
    assert trace.result.reason == "plant at t = 0.350 s: 'outcome' is 'collision'"
    assert trace.result.time_ns == 350_000_000
    assert trace["plant.outcome"][1].tolist() == [0] * 7 + [1]


@pytest.mark.parametrize("path", ["plant.y", "plant.nothing", "plant"])
def test_only_enumerations_end_a_run(path):
    """Any other end_on is refused when coupling."""
    with pytest.raises(ScenarioError, match=f"end_on {path}: "):
        system({"plant": integrator()}, end_on=[path])


def test_interruption():
    """The run ends at the next tick, and everything is closed and terminated."""
    log, trace, asked = [], Trace(), iter([False, False, True])
    result = simulate(
        system({"plant": integrator(name="plant", log=log)}), [trace], interrupt=lambda: next(asked)
    )
    assert (result.outcome, result.time_ns) == ("interrupted", 100_000_000)
    assert result.reason == "interrupted at t = 0.100 s"
    assert trace.result is result
    assert log[-1] == ("plant", "terminate")


def test_a_keyboard_interrupt_passes_through_tidily():
    """Ctrl-C in the middle of a step closes everything before it goes on."""

    def behave(values, time, step_size):
        if time > 0.3:
            raise KeyboardInterrupt

    trace = Trace()
    made = system({"plant": Scripted("continuous", 20.0, [Row("y", "output")], behave)})
    with pytest.raises(KeyboardInterrupt):
        simulate(made, [trace])
    assert trace.result.outcome == "interrupted"
    assert made.instances["plant"].state == "terminated"


class Failing(Trace):
    """A listener that fails in one of its calls."""

    def __init__(self, call):
        super().__init__()
        self.call = call
        self.is_closed = False
        if call != "close":
            setattr(self, call, self.fail)

    def fail(self, *_):
        """Fail, as a full disk does."""
        raise OSError(f"disk full in {self.call}")

    def close(self, result):
        """Note the call, then do as the others."""
        self.is_closed = True
        if self.call == "close":
            self.fail()


@pytest.mark.parametrize("call", ["open", "parameters", "outputs", "inputs", "event", "close"])
def test_a_failing_listener_leaves_nothing_open(call):
    """Whatever a listener raises is raised again after all are closed and terminated."""
    log, failing, other = [], Failing(call), Trace()
    made = system(
        {"plant": integrator(name="plant", log=log), "g": gain()},
        [("plant.y -> g.u", 0.05)],
    )
    with pytest.raises(OSError, match=f"disk full in {call}"):
        simulate(made, [other, failing])
    assert failing.is_closed
    assert other.result.outcome == ("flown" if call in ("close", "event") else "interrupted")
    assert other.result.counts == {}
    assert log[-1] == ("plant", "terminate")


def test_a_component_that_cannot_be_initialized_is_a_problem_of_the_scenario():
    """Nothing has flown, no listener was opened, and what could be terminated has been."""
    log, trace = [], Trace()
    bad = integrator()

    def initialize(**_):
        raise ValueError("start: below ground, got 90 m, expected above 100 m")

    bad.initialize = initialize
    made = system({"good": integrator(name="good", log=log), "bad": bad})
    with pytest.raises(ScenarioError, match="component 'bad': cannot be initialized, start: below"):
        simulate(made, [trace])
    assert trace.result is None
    assert log[-1] == ("good", "terminate")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "output 'y': is missing"),
        (None, "get failed, TypeError"),
        ({"y": True}, "output 'y': wrong type, got bool, expected float"),
        ({"y": 2**53 + 1}, "output 'y': wrong type, got int, expected float"),
        ({"y": 10**400}, "output 'y': wrong type, got int, expected float"),
        ({"y": np.array(1.0)}, "output 'y': wrong type, got ndarray, expected float"),
        ({"y": np.array([1.0])}, "output 'y': wrong type, got ndarray, expected float"),
        ({"y": np.bool_(1)}, "output 'y': wrong type, got bool, expected float"),
    ],
)
def test_first_outputs_are_what_was_described(values, message):
    """A missing or mistyped output is found before the run."""
    component = integrator()
    component.get = lambda names: values
    with pytest.raises(ScenarioError, match=message):
        simulate(system({"c": component}))


@pytest.mark.parametrize(
    ("start", "value", "expected"),
    [
        (0.0, 3, 3.0),
        (0.0, np.float32(0.1), float(np.float32(0.1))),
        (0.0, np.int16(-2), -2.0),
        (0, np.uint8(7), 7),
        (False, np.bool_(1), True),
    ],
)
@pytest.mark.parametrize("kind", ["sampled", "continuous"])
def test_numbers_that_lose_nothing_are_taken_as_what_was_described(start, value, expected, kind):
    """An int or a numpy scalar becomes a Python number: at the start, and at every reading."""
    component = Scripted(kind, 2.0, [Row("y", "output", start), Row("z", "output")])
    component.get = lambda names: {"y": value, "z": 1.0}
    heard = []

    class Hearing(Trace):
        def outputs(self, time_ns, component, values):
            heard.append(values["y"])

    simulate(system({"c": component}), [Hearing()])
    assert len(heard) >= 2
    assert {(type(one), one) for one in heard} == {(type(expected), expected)}


def test_nothing_is_never_set():
    """A component without inputs, or whose delayed inputs are not there yet, is not asked to."""
    asked = []

    def wary(component):
        component.set = lambda values: asked.append(len(values))
        return component

    late = ["a.y -> b.u"]
    simulate(system({"a": wary(clock()), "b": wary(gain())}))
    simulate(system({"a": wary(clock()), "b": wary(gain())}, [(late[0], 0.5)]))
    simulate(system({"a": wary(clock()), "b": wary(gain(kind="continuous"))}, [(late[0], 0.5)]))
    assert set(asked) == {1}


@pytest.mark.parametrize("call", ["set", "initialize", "get"])
def test_a_failed_initialization_names_the_call(call):
    """With the exception and its place; a ValueError in initialize is a refusal, as it is said."""
    component = gain()

    def fall(*_, **__):
        raise KeyError("pose.east")

    setattr(component, call, fall)
    place = f"test_orchestrator_simulate.py:{fall.__code__.co_firstlineno + 1}"
    with pytest.raises(ScenarioError) as caught:
        simulate(system({"a": clock(), "hold": component}, ["a.y -> hold.u"]))
    assert str(caught.value) == (
        f"component 'hold': cannot be initialized, {call} failed, KeyError: 'pose.east' ({place})"
    )


def test_arguments_that_do_not_fit_are_placed_where_the_method_begins():
    """Nothing of the component has run then."""
    component = gain()

    def initialize(start, stop):
        pass

    component.initialize = initialize
    line = initialize.__code__.co_firstlineno
    place = re.escape(f"(test_orchestrator_simulate.py:{line})") + "$"
    with pytest.raises(ScenarioError, match=f"initialize failed, TypeError: .*{place}"):
        simulate(system({"c": component}))


def test_outputs_that_go_missing_are_an_error_of_the_component():
    """Later, another set of outputs than at the start is dealt with by the policies."""
    component = integrator()
    component.get = lambda names: {"y": 0.0} if component.values["u"] == 0.0 else {}
    trace = fly({"c": component}, events=[EventSpec(0.5, "c.u", 1.0)])
    assert trace.result.reason.startswith("c at t = 0.500 s: output 'y': is missing")
    assert trace.result.outcome == "component error"
    assert trace.result.counts == {"errors.c": 1}


def test_a_system_runs_once():
    """A second run needs new components."""
    made = system({"plant": integrator()})
    simulate(made)
    with pytest.raises(CouplingError, match="has been run before"):
        simulate(made)


def test_a_component_that_cannot_terminate_does_not_hide_the_run():
    """The outcome stays; the failure is an event with its traceback."""
    component = integrator()
    component.terminate = lambda: 1 / 0
    trace = fly({"c": component})
    assert trace.result.outcome == "flown"
    assert trace.result.counts == {"errors.c": 1}
    assert "ZeroDivisionError" in trace.events[0].message
    assert trace.events[-1] == (1.0, "end", "orchestrator", "flown")


def test_the_trace_knows_its_names():
    """Outputs are found by name, arrays by row; a wrong name says the nearest."""
    component = Scripted(
        "sampled", 2.0, [Row("scan.north", "output", shape=(2, 3)), Row("k", "input")]
    )
    trace = fly({"sensor": component})
    assert trace.names == ("sensor.scan.north",)
    assert "sensor.scan.north" in trace
    assert trace["sensor.scan.north"][1].shape == (2, 2, 3)
    with pytest.raises(KeyError, match=r"did you mean 'sensor.scan.north'"):
        trace["sensor.scan.nroth"]


def test_warnings_are_told_and_counted():
    """Warning is an event; the run goes on."""
    component = integrator()
    component.behave = lambda values, time, h: Status.WARNING if time == 0.5 else Status.OK
    trace = fly({"plant": component})
    assert trace.result.outcome == "flown"
    assert trace.result.counts == {"warnings.plant": 1}
    assert trace.events[0] == (
        0.5, "warning", "plant", "plant at t = 0.500 s: step is done with a Warning",
    )  # fmt: skip


LATER = [  # what an output of a type is at first, and later
    (0.0, True, "wrong type, got bool, expected float"),
    (0.0, 2**53 + 1, "wrong type, got int, expected float"),
    (0.0, np.array(1.0), "wrong type, got ndarray, expected float"),
    (0, 3.7, "wrong type, got float, expected int"),
    (False, 1, "wrong type, got int, expected bool"),
]


@pytest.mark.parametrize(("first", "later", "what"), LATER)
def test_a_type_that_changes_in_flight_is_an_error_of_the_component(first, later, what):
    """What is published later is held to the description as the first outputs are."""

    def behave(values, time, _):
        values["y"] = later if time > 0.35 else first

    component = Scripted("sampled", 10.0, [Row("y", "output", first)], behave)
    trace = fly({"c": component})
    assert trace.result.reason == f"c at t = 0.400 s: output 'y': {what}"


@pytest.mark.parametrize("first", [0.0, 0, np.float32(0.0)])
def test_numbers_are_pythons_whatever_comes_first(first):
    """What converts without loss is converted at every publishing: successors compute the same."""

    def behave(values, time, _):
        values["y"] = np.float32(0.1)

    component = Scripted("sampled", 10.0, [Row("y", "output", 0.0)], behave, values={"y": first})
    kinds = set()
    reader = gain(10.0, name="reader")
    take = reader.set
    reader.set = lambda values: (kinds.update(map(type, values.values())), take(values))
    fly({"c": component, "reader": reader}, ["c.y -> reader.u"])
    assert kinds == {float}


@pytest.mark.parametrize(
    ("answer", "what"),
    [
        (np.zeros(3), "step answered array([0., 0., 0.]), expected a status 0 to 4"),
        (2.0, "step answered 2.0, expected a status 0 to 4"),
        (SystemExit(0), "step failed, SystemExit: 0"),
    ],
)
def test_an_answer_that_is_no_status_and_an_exit_are_errors(answer, what):
    """Whatever they are: the run ends with a reason, never as if it had been interrupted."""
    component = counter(10.0)

    def step(time, size):
        if isinstance(answer, SystemExit):
            raise answer
        return answer

    component.step = step
    result = fly({"c": component}).result
    assert result.outcome == "component error"
    assert result.reason.startswith(f"c at t = 0.000 s: {what}")


def test_an_item_that_there_is_not_ends_nothing_but_is_an_error():
    """An enumeration of which the run may end is held to its items."""

    def behave(values, time, _):
        values["y"] = 7 if time > 0.05 else 0

    rows = [Row("y", "output", 0, items=("going", "done"))]
    component = Scripted("sampled", 10.0, rows, behave)
    result = fly({"c": component}, end_on=("c.y",)).result
    assert result.reason == "c at t = 0.100 s: output 'y': not an item, got 7, expected 0 or 1"
