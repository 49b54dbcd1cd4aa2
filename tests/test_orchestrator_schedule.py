"""Exact time, and the order of things at one instant."""

from fractions import Fraction
from math import gcd

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import Row, Scripted, clock, counter, gain, integrator, system

from orchestrator.assembly.clock import nanoseconds, period_ns, whole_ticks
from orchestrator.assembly.couple import couple
from orchestrator.assembly.schedule import instants
from orchestrator.errors import ScenarioError
from orchestrator.scenario.records import ComponentSpec, Scenario

usable_rates = st.sampled_from([0.5, 1.0, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0])


def operations(made):
    """Return ``(time_s, kind, component)`` of a whole run, the last instant left out."""
    schedule = made.schedule
    return [
        (time / 1e9, operation.kind, operation.component)
        for time, entry in instants(schedule, schedule.table)
        if time < schedule.end_ns
        for operation in entry
    ]


def order(made):
    """Return ``kind component`` of the first instant."""
    return [f"{kind} {name}" for time, kind, name in operations(made) if time == 0]


def refusal(*arguments, **keys):
    """Return the problems of a system."""
    with pytest.raises(ScenarioError) as caught:
        system(*arguments, **keys)
    return {problem.path: problem.message for problem in caught.value.problems}


@given(st.integers(0, 10**12), st.integers(0, 9))
def test_decimals_are_read_as_written(digits, places):
    """A time with up to nine decimals is exactly that many nanoseconds."""
    exact = Fraction(digits, 10**places)
    if len(str(digits)) <= 15:  # what a double can hold
        assert nanoseconds(float(exact)) == exact * 10**9


def test_periods_are_exact():
    """20 Hz is 50 ms; 3 Hz has no period in whole nanoseconds and says which rates do."""
    assert period_ns(20) == 50_000_000
    assert period_ns(0.1) == 10_000_000_000
    with pytest.raises(ValueError, match=r"got 3 Hz, expected 2.56 Hz or 3.125 Hz"):
        period_ns(3)
    with pytest.raises(ValueError, match="got 0 Hz, expected above 0 Hz"):
        period_ns(0)


@given(st.floats(0.01, 1000.0))
def test_rates_that_are_named_can_be_used(rate_hz):
    """Whatever the refused rate, the ones proposed are usable and lie around it."""
    try:
        period_ns(rate_hz)
    except ValueError as error:
        near = [
            float(text.split(" Hz")[0]) for text in str(error).split("expected ")[1].split(" or ")
        ]
        assert all(period_ns(rate) for rate in near)
        assert near[0] < rate_hz < near[1]


def test_times_between_ticks():
    """A time between two base ticks names both."""
    assert whole_ticks(0.15, 50_000_000) == 150_000_000
    with pytest.raises(ValueError, match=r"got 0.12 s, expected 0.1 s or 0.15 s"):
        whole_ticks(0.12, 50_000_000)


@given(st.lists(st.tuples(usable_rates, st.booleans()), min_size=1, max_size=4), st.integers(1, 3))
def test_everything_fires_at_every_multiple_of_its_period(rates, cycles):
    """A component steps exactly duration / period times, at k times its period, for any rates."""
    components = {
        f"c{i}": clock(rate, "continuous" if is_continuous else "sampled")
        for i, (rate, is_continuous) in enumerate(rates)
    }
    periods = {name: period_ns(c.rate_hz) for name, c in components.items()}
    hyperperiod = system(components, duration_s=1000.0).schedule.hyperperiod_ns
    made = system(components, duration_s=cycles * hyperperiod / 1e9)
    assert made.schedule.base_ns == gcd(*periods.values())
    for name, period in periods.items():
        times = [
            round(time * 1e9)
            for time, kind, component in operations(made)
            if component == name and kind in ("sample", "advance")
        ]
        assert times == list(range(0, made.schedule.end_ns, period))


def test_20_and_8_hz_meet_every_quarter_second():
    """Rates need not divide each other; only instants at which something happens are listed."""
    made = system({"a": clock(20.0), "b": clock(8.0)}, duration_s=0.5)
    assert made.schedule.base_ns == 25_000_000
    assert made.schedule.hyperperiod_ns == 250_000_000
    assert sorted({time for time, _, _ in operations(made)}) == [
        0.0, 0.05, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.35, 0.375, 0.4, 0.45,
    ]  # fmt: skip


def test_sampled_components_follow_feed_through():
    """Whatever the scenario's order: the plant is read, values are passed on, the plant steps."""
    made = system(
        {"sequencer": gain(), "mpc": gain(rate_hz=2.0), "plant": integrator()},
        ["plant.y -> mpc.u", "mpc.z -> sequencer.u", "sequencer.z -> plant.u"],
    )
    assert order(made) == ["read plant", "sample mpc", "sample sequencer", "advance plant"]
    assert made.schedule.initialization == ("plant", "mpc", "sequencer")


def test_sources_come_first_even_where_nothing_is_passed_on():
    """Without feed-through a reader still follows its source, so that it sees the newest value."""
    made = system({"reader": counter(20.0), "source": counter(20.0)}, ["source.y -> reader.u"])
    assert order(made) == ["sample source", "sample reader"]


def test_ties_follow_the_scenario():
    """Components that do not need each other run in the order in which they are written."""
    made = system({"b": counter(20.0), "a": counter(20.0)}, ["a.y -> b.u", "b.y -> a.u"])
    assert order(made) == ["sample b", "sample a"]


def test_continuous_feed_through_is_read_in_its_place():
    """A continuous gain between two others is refreshed after its source, before its reader."""
    made = system(
        {"last": gain(), "middle": gain(kind="continuous"), "first": integrator()},
        ["first.y -> middle.u", "middle.z -> last.u", "last.z -> first.u"],
    )
    assert order(made) == [
        "read first", "read middle", "sample last", "advance middle", "advance first",
    ]  # fmt: skip


def test_outputs_of_one_component_are_read_apart():
    """A state is read before the controller although another output passes its command on."""
    plant = Scripted(
        "continuous",
        20.0,
        [Row("u", "input"), Row("y", "output"), Row("actuator", "output", through=("u",))],
    )
    made = system({"plant": plant, "mpc": gain()}, ["plant.y -> mpc.u", "mpc.z -> plant.u"])
    assert order(made) == ["read plant", "sample mpc", "read plant", "advance plant"]
    assert [o.outputs for o in made.schedule.table[0][1] if o.kind == "read"] == [
        ("y",), ("actuator",),
    ]  # fmt: skip


def named_gains(**more):
    """Return gains a (v to y) and b (u to z)."""
    a = Scripted("sampled", 20.0, [Row("v", "input"), Row("y", "output", through=("v",))])
    return {"a": a, "b": gain(**more)}


def test_a_cycle_is_named_whole():
    """Values that need themselves at the same instant are refused, variable by variable."""
    problems = refusal(named_gains(rate_hz=2.0), ["a.y -> b.u", "b.z -> a.v"])
    assert problems[("connections",)] == (
        "connections: cycle of direct feed-through a.y -> b.u -> b.z -> a.v -> a.y, "
        "expected a delay_s on one of its connections or a latency_s on one of its components"
    )


def test_a_component_connected_to_itself_is_a_cycle():
    """The shortest cycle has one connection."""
    problems = refusal({"g": gain()}, ["g.z -> g.u"])
    assert "cycle of direct feed-through g.z -> g.u -> g.z," in problems[("connections",)]


def test_unsaid_feed_through_is_all_feed_through():
    """A description without dependencies may pass on every input."""
    component = Scripted("continuous", 20.0, [Row("u", "input"), Row("y", "output", through=None)])
    assert ("connections",) in refusal({"a": component, "g": gain()}, ["a.y -> g.u", "g.z -> a.u"])


@pytest.mark.parametrize(
    ("connections", "keys"),
    [
        ([("a.y -> b.u", 0.05), "b.z -> a.v"], {}),
        (["a.y -> b.u", "b.z -> a.v"], {"b": {"latency_s": 0.05}}),
    ],
    ids=["delay", "latency"],
)
def test_delay_or_latency_breaks_a_cycle(connections, keys):
    """A value that arrives later is no value of this instant."""
    assert system(named_gains(), connections, **keys).schedule.table


def test_latency_steps_last_and_releases_first():
    """A late component samples when everything is published; its result comes at the beginning."""
    made = system(
        {"late": gain(), "reader": gain(), "plant": integrator()},
        ["plant.y -> late.u", "late.z -> reader.u"],
        late={"latency_s": 0.1},
    )
    assert order(made) == [
        "release late", "read plant", "sample reader", "sample late", "advance plant",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "path", "message"),
    [
        (
            {"duration_s": 1.01},
            ("duration_s",),
            (
                "duration_s: not a multiple of the base tick of 0.05 s, got 1.01 s, "
                "expected 1.0 s or 1.05 s"
            ),
        ),
        ({"duration_s": 0.0}, ("duration_s",), "not positive, got 0.0 s, expected above 0 s"),
        ({"duration_s": 1e9}, ("duration_s",), "too many steps, got 22000000000, expected at most"),
        (
            {"mpc": {"latency_s": 0.03}},
            ("components", "mpc", "latency_s"),
            (
                "components.mpc.latency_s: not a multiple of the base tick of 0.05 s, got 0.03 s, "
                "expected 0.0 s or 0.05 s"
            ),
        ),
        (
            {"plant": {"latency_s": 0.05}},
            ("components", "plant", "latency_s"),
            "continuous components have none, got 0.05 s, expected 0 s",
        ),
        (
            {"mpc": {"rate_hz": 3.0}},
            ("components", "mpc", "rate_hz"),
            "components.mpc.rate_hz: period is not a whole number of nanoseconds, got 3.0 Hz",
        ),
        (
            {"connections": [("plant.y -> mpc.u", 0.02)]},
            ("connections", 0, "delay_s"),
            "connections.0.delay_s: not a multiple of the base tick of 0.05 s, got 0.02 s",
        ),
    ],
)
def test_times_that_do_not_fit(keys, path, message):
    """Duration, latency, rate and delay are checked against exact time, each at its own key."""
    problems = refusal({"plant": integrator(), "mpc": gain(rate_hz=2.0)}, **keys)
    assert message in problems[path]


def test_the_duration_is_whole_steps_of_continuous_components():
    """Nobody steps beyond the end; a sampled component may be cut short."""
    assert (
        "0.5 s"
        in refusal({"slow": clock(2.0), "fast": clock(20.0)}, duration_s=0.75)[("duration_s",)]
    )
    assert system({"slow": clock(2.0, "sampled"), "fast": clock(20.0)}, duration_s=0.75)


def test_the_limit_of_steps_can_be_set():
    """More steps than asked for are refused."""
    scenario = Scenario("t", 1.0, components=(ComponentSpec("c", ""),))
    with pytest.raises(ScenarioError, match="too many steps, got 20, expected at most 19"):
        couple(scenario, {"c": clock(20.0)}, max_steps=19)


def test_all_problems_of_a_system_at_once():
    """Connections, times, events and policies are reported together."""
    problems = refusal(
        {"plant": integrator(), "mpc": gain(rate_hz=2.0)},
        ["plant.y -> mpc.w"],
        mpc={"latency_s": 0.01},
        end_on=["plant.y"],
    )
    assert set(problems) == {
        ("connections", 0), ("components", "mpc", "latency_s"), ("end_on", 0),
    }  # fmt: skip
