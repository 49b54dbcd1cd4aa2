"""Inputs that could be connected and are not."""

from dataclasses import replace

import pytest
from scripted import Row, describe

from orchestrator.assembly.connections import connect
from orchestrator.assembly.description import ports
from orchestrator.assembly.forgotten import forgotten
from orchestrator.scenario.load import installed, load
from orchestrator.scenario.records import ComponentSpec, ConnectionSpec, EventSpec, Scenario

VEHICLE = [
    Row("command.thrust", "input"),
    Row("command.pitch", "input", unit="rad"),
    Row("wind.north", "input", unit="m"),
    Row("wind.east", "input", unit="m"),
    Row("height", "output", unit="m"),
]
PILOT = [
    Row("height", "input", 1.5, unit="km"),
    Row("mode", "input", 1, items=("idle", "busy")),
    Row("plan.thrust", "output"),
    Row("plan.pitch", "output", unit="deg"),
]
BOTH = {"vehicle": VEHICLE, "pilot": PILOT}
WHOLE = ("vehicle.height -> pilot.height", "pilot.plan -> vehicle.command")
KEPT = ": nothing is connected, the start value is kept"


def told(*texts, rows=BOTH, **keys):
    """Return what is told of a scenario with these connections."""
    described = {name: ports(name, describe(name, own)) for name, own in rows.items()}
    specs = [ConnectionSpec(*text.split(" -> ")) for text in texts]
    components = tuple(ComponentSpec(name, "x") for name in rows)
    scenario = Scenario("forgetful", 1.0, components=components)
    return forgotten(replace(scenario, **keys), described, connect(described, specs))


def test_what_nothing_could_feed_is_optional():
    """Neither wind without gusts nor an enumeration that nobody has is missed."""
    assert told(*WHOLE) == []


def test_a_group_that_another_component_could_feed_is_told_as_a_group():
    """By a group that has a fitting output for every input, whatever it is called."""
    assert told(WHOLE[0]) == ["vehicle.command" + KEPT]


def test_a_variable_is_told_with_its_start_value():
    """Units of the same dimension fit."""
    assert told(WHOLE[1]) == ["pilot.height (1.5 km)" + KEPT]


def test_one_line_for_every_component():
    """With all that it lacks."""
    rows = {**BOTH, "engine": [Row("thrust", "output")]}
    vehicle = [*VEHICLE, Row("trim", "input")]
    assert told(rows={**rows, "vehicle": vehicle}) == [
        "vehicle.command, vehicle.trim (0)" + KEPT,
        "pilot.height (1.5 km)" + KEPT,
    ]


def test_the_rest_of_a_group_that_is_partly_connected_is_told():
    """By name if it is a few variables, else by their number."""
    one = "pilot.plan.thrust -> vehicle.command.thrust"
    assert told(WHOLE[0], one) == ["vehicle.command.pitch (0 rad)" + KEPT]
    many = [Row(f"command.{k}", "input") for k in range(5)]
    rows = {"vehicle": many, "pilot": PILOT}
    assert told("pilot.plan.thrust -> vehicle.command.0", rows=rows) == [
        "vehicle.command (4 of 5 variables)" + KEPT
    ]


def test_what_an_event_or_the_parameters_set_is_given():
    """It has a value that somebody chose."""
    assert told(WHOLE[1], events=(EventSpec(0.5, "pilot.height", 1.0),)) == []
    gust = (EventSpec(0.5, "vehicle.wind.north", 1.0),)
    assert told(*WHOLE, events=gust) == []
    pilot = ComponentSpec("pilot", "x.fmu", parameters={"height": 2.0})
    assert told(WHOLE[1], components=(ComponentSpec("vehicle", "x"), pilot)) == []


def test_a_components_own_outputs_do_not_count():
    """Alone, a component has nothing that it could be connected to."""
    rows = {"a": [Row("u", "input"), Row("y", "output")]}
    assert told(rows=rows) == []


@pytest.mark.parametrize("file", sorted(installed().glob("*.yaml")), ids=lambda file: file.stem)
def test_installed_scenarios_forget_nothing(file):
    """What ships needs no note."""
    from orchestrator.assembly.build import build

    assert build(load(file)).notes == ()
