"""Connections are checked and expanded before anything runs."""

import logging

import pytest
from scripted import Row, describe

from orchestrator.assembly.connections import connect, conversions
from orchestrator.assembly.description import ports
from orchestrator.errors import ScenarioError
from orchestrator.scenario.records import ConnectionSpec

PLANT = [
    Row("command.thrust", "input"),
    Row("command.pitch", "input", unit="rad"),
    Row("state.u", "output", unit="m"),
    Row("state.theta", "output", unit="rad"),
    Row("state.extra", "output"),
    Row("far", "output", unit="km"),
    Row("scan", "output", shape=(3,)),
    Row("count", "output", 0),
    Row("mode", "output", 0, items=("idle", "busy")),
    Row("mass", "parameter", variability="tunable"),
]
MPC = [
    Row("state.u", "input", unit="m"),
    Row("state.theta", "input", unit="deg"),
    Row("height", "input", unit="m"),
    Row("scan", "input", shape=(4,)),
    Row("count", "input", 0),
    Row("mode", "input", 0, items=("off", "on")),
    Row("plan.thrust", "output"),
    Row("plan.pitch", "output", unit="rad"),
]
PORTS = {
    "vehicle": ports("vehicle", describe("vehicle", PLANT)),
    "mpc": ports("mpc", describe("mpc", MPC)),
}


def links(*texts, delay_s=0.0):
    """Return the links of ``a -> b`` texts."""
    return connect(PORTS, [ConnectionSpec(*t.split(" -> "), delay_s) for t in texts])


def refusal(*texts, delay_s=0.0):
    """Return the problems of ``a -> b`` texts."""
    with pytest.raises(ScenarioError) as caught:
        links(*texts, delay_s=delay_s)
    return caught.value.problems


def test_variable_to_variable():
    """Equal units are passed on as they are."""
    (link,) = links("vehicle.state.u -> mpc.height")
    assert str(link) == "vehicle.state.u -> mpc.height"
    assert link.is_plain


def test_groups_join_by_name():
    """Each input of the target's group takes its namesake; more in the source does no harm."""
    joined = links("vehicle.state -> mpc.state", "mpc.plan -> vehicle.command")
    assert [str(link) for link in joined] == [
        "vehicle.state.u -> mpc.state.u",
        "vehicle.state.theta -> mpc.state.theta",
        "mpc.plan.thrust -> vehicle.command.thrust",
        "mpc.plan.pitch -> vehicle.command.pitch",
    ]


def test_units_of_one_dimension_are_converted(caplog):
    """Another unit of the same dimension gives factor and offset, and a line in the log."""
    with caplog.at_level(logging.INFO, "orchestrator.assembly.connections"):
        joined = links("vehicle.far -> mpc.height", "vehicle.state.theta -> mpc.state.theta")
    assert [link.factor for link in joined] == [1000.0, pytest.approx(57.29577951308232)]
    assert conversions(joined)[0] == (
        "connection vehicle.far -> mpc.height: 'km' (m) is converted to 'm' (m), "
        "factor 1000.0, offset 0.0"
    )
    assert len(caplog.records) == 2


def test_delay():
    """A delay becomes whole nanoseconds."""
    (link,) = links("vehicle.state.u -> mpc.height", delay_s=0.15)
    assert link.delay_ns == 150_000_000
    assert not link.is_plain


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("vehicel.far -> mpc.height", "no component 'vehicel', did you mean 'vehicle'"),
        (
            "vehicle.far -> mpc.hight",
            "component 'mpc' has no variable or group 'hight', did you mean 'height'",
        ),
        (
            "vehicle.stat -> mpc.state",
            "component 'vehicle' has no variable or group 'stat', did you mean 'state' or 'state.u'",
        ),
        ("vehicle -> mpc.height", "component 'vehicle' has no variable or group ''"),
        (
            "vehicle.far -> mpc.plan.thrust",
            "mpc.plan.thrust cannot be a target, got output, expected input",
        ),
        (
            "vehicle.command.thrust -> mpc.height",
            "vehicle.command.thrust cannot be a source, got input, expected output",
        ),
        (
            "mpc.plan.thrust -> vehicle.mass",
            (
                "vehicle.mass cannot be a target, got parameter, expected input; "
                "events change tunable parameters"
            ),
        ),
        ("vehicle.scan -> mpc.scan", "mpc.scan: wrong shape, got (3,), expected (4,)"),
        ("vehicle.count -> mpc.height", "mpc.height: wrong type, got Int64, expected Float64"),
        (
            "vehicle.mode -> mpc.mode",
            "mpc.mode: other enumeration items, got ['idle', 'busy'], expected ['off', 'on']",
        ),
        (
            "vehicle.state.theta -> mpc.height",
            "mpc.height: unit of another dimension, got 'rad' (rad), expected 'm' (m)",
        ),
        ("vehicle.state -> mpc.height", "vehicle.state is a group but mpc.height is a variable"),
        (
            "mpc.plan -> vehicle.state",
            "vehicle.state has no inputs, got output",
        ),
        (
            "mpc.plan -> mpc.state",
            "mpc.plan has no source for 'u', 'theta'",
        ),
    ],
)
def test_what_is_wrong_is_said_in_full(text, message):
    """Names, causality, shape, type and unit: one message with what was found and expected."""
    (problem,) = refusal(text)
    assert problem.message == f"connection {text}: {message}"
    assert problem.path == ("connections", 0)


def test_two_sources_for_one_input():
    """The second source of an input is refused and names the first, also within groups."""
    (problem,) = refusal("vehicle.state -> mpc.state", "vehicle.state.u -> mpc.state.u")
    assert problem.path == ("connections", 1)
    assert problem.message.endswith("mpc.state.u has two sources, the other is vehicle.state.u")


@pytest.mark.parametrize("delay_s", [-0.1, 1e-10, float("nan")])
def test_delays_are_whole_and_not_negative(delay_s):
    """A delay below 0 or between nanoseconds is refused."""
    (problem,) = refusal("vehicle.state.u -> mpc.height", delay_s=delay_s)
    assert "delay_s is" in problem.message


def test_all_problems_at_once():
    """Nothing is left for a second attempt."""
    problems = refusal(
        "vehicle.fra -> mpc.hight", "vehicle.far -> mpc.height", "vehicle.state -> mpc.height"
    )
    assert [problem.path[1] for problem in problems] == [0, 0, 2]
