"""Timed changes of unconnected inputs and tunable parameters."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from orchestrator.assembly.clock import nanoseconds, whole_ticks
from orchestrator.assembly.connections import Ports, find
from orchestrator.assembly.description import Port
from orchestrator.assembly.settable import accepted
from orchestrator.assembly.system import Link, Schedule
from orchestrator.component import Value
from orchestrator.errors import Problem, ScenarioError
from orchestrator.scenario.records import EventSpec


@dataclass(frozen=True)
class Change:
    """A variable takes a value at ``time_ns``, before anything else happens at that instant."""

    time_ns: int
    port: Port
    value: Value


def changes(
    specs: Sequence[EventSpec],
    ports: Ports,
    links: Iterable[Link],
    schedule: Schedule | None,
    bounds: Mapping[str, Any] | None = None,
) -> tuple[Change, ...]:
    """Return the events in order of time, those of one instant in the order of the scenario.

    What would come after the end is checked and left out. Without a ``schedule`` the times are not
    checked against base tick and end; ``bounds`` are those of parameters' fields, by full name.

    Raises
    ------
    ScenarioError
        With every event whose variable is unknown, connected or not tunable, or whose time or value
        does not fit, each at ``("events", index, key)``.
    """
    sources = {link.target: link.source for link in links}
    made: list[Change] = []
    problems: list[Problem] = []
    for index, spec in enumerate(specs):
        part = "set"
        try:
            port = _settable(spec.set, ports, sources)
            part = "at_s"
            time_ns = nanoseconds(spec.at_s)
            if schedule is not None:
                whole_ticks(spec.at_s, schedule.base_ns)
            part = "value"
            made.append(Change(time_ns, port, accepted(port, spec.value, bounds or {})))
        except ValueError as error:
            path = ("events", index, part)
            problems.append(Problem(path, f"event {spec.set}: {error}"))
    if problems:
        raise ScenarioError(problems)
    end_ns = inf if schedule is None else schedule.end_ns
    happening = (change for change in made if change.time_ns <= end_ns)
    return tuple(sorted(happening, key=lambda change: change.time_ns))


def too_late(specs: Iterable[EventSpec], schedule: Schedule) -> list[str]:
    """Return a line about the events after the end, if there are any."""
    count = sum(nanoseconds(spec.at_s) > schedule.end_ns for spec in specs)
    end = f"after the end at {schedule.end_ns / 1e9:g} s never"
    return [f"{count} event{'s' * (count > 1)} {end} happen{'s' * (count == 1)}"] if count else []


def written(change: Change) -> str:
    """Return a change as events tell it, ``component.variable = value``; the value is JSON."""
    return f"{change.port} = {json.dumps(change.value, default=_plain)}"


def read(at_s: float, text: str) -> EventSpec:
    """Return the event that makes a change again, which was ``written`` to a recording.

    >>> read(0.5, "mpc.height_agl_m = 30.0")
    EventSpec(at_s=0.5, set='mpc.height_agl_m', value=30.0)
    """
    name, _, value = text.partition(" = ")
    return EventSpec(at_s, name, json.loads(value))


def _settable(name: str, ports: Ports, sources: Mapping[Port, Port]) -> Port:
    """Return the variable of that name, if an event can set it."""
    group = find(ports, name)[1]
    if "" not in group:
        raise ValueError(f"is a group, expected a variable such as {next(iter(group.values()))}")
    port = group[""]
    if port.causality == "parameter":
        if port.variability != "tunable":
            raise ValueError(f"parameter cannot change, got {port.variability}, expected tunable")
    elif port.causality != "input":
        raise ValueError(f"got {port.causality}, expected input or tunable parameter")
    if port in sources:
        raise ValueError(f"input is connected to {sources[port]}, expected an unconnected one")
    return port


def _plain(value: object) -> object:
    """Return an array or bytes as :func:`accepted` takes them."""
    return value.hex() if isinstance(value, bytes) else np.asarray(value).tolist()
