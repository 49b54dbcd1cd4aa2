"""Timed changes of unconnected inputs and tunable parameters."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orchestrator.assembly.clock import nanoseconds, whole_ticks
from orchestrator.assembly.connections import Ports, find
from orchestrator.assembly.description import Port, mismatch
from orchestrator.assembly.system import Link, Schedule
from orchestrator.component import Value
from orchestrator.errors import Problem, ScenarioError, nearest
from orchestrator.scenario.records import EventSpec


@dataclass(frozen=True)
class Change:
    """A variable takes a value at ``time_ns``, before anything else happens at that instant."""

    time_ns: int
    port: Port
    value: Value


def changes(
    specs: Sequence[EventSpec], ports: Ports, links: Iterable[Link], schedule: Schedule | None
) -> tuple[Change, ...]:
    """Return the events in order of time, those of one instant in the order of the scenario.

    Without a ``schedule`` the times are not checked against base tick and end.

    Raises
    ------
    ScenarioError
        With every event whose variable is unknown, connected or not tunable, or whose time or value
        does not fit, each at ``("events", index)``.
    """
    sources = {link.target: link.source for link in links}
    made: list[Change] = []
    problems: list[Problem] = []
    for index, spec in enumerate(specs):
        try:
            made.append(_change(spec, ports, sources, schedule))
        except ValueError as error:
            problems.append(Problem(("events", index), f"event {spec.set}: {error}"))
    if problems:
        raise ScenarioError(problems)
    return tuple(sorted(made, key=lambda change: change.time_ns))


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


def parsed(port: Port, raw: object) -> Value:
    """Return a number, text or list of a scenario as a value of ``port``.

    An integer does for a float, an item's text for an enumeration, hexadecimal digits for bytes.

    Raises
    ------
    ValueError
        If it is not of the port's type and shape.
    """
    if port.items and isinstance(raw, str):
        texts = {text: value for value, text in port.items.items()}
        if raw not in texts:
            near = nearest(raw, list(texts))
            raise ValueError(f"no such item, got {raw!r}, expected one of {list(texts)}{near}")
        return texts[raw]
    value = raw
    if port.kind == "float" and isinstance(raw, int) and not isinstance(raw, bool):
        value = float(raw)
    elif port.shape and isinstance(raw, list):
        value = np.array(raw, float if port.kind == "float" else None)
    elif port.kind == "binary" and isinstance(raw, str):
        value = bytes.fromhex(raw)
    fault = mismatch(port, value)
    if fault is not None:
        raise ValueError(fault)
    return value  # pyright: ignore[reportReturnType]  (mismatch has checked it)


def _change(
    spec: EventSpec, ports: Ports, sources: Mapping[Port, Port], schedule: Schedule | None
) -> Change:
    group = find(ports, spec.set)[1]
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
    time_ns = nanoseconds(spec.at_s)
    if schedule is not None:
        whole_ticks(spec.at_s, schedule.base_ns)
        if time_ns > schedule.end_ns:
            end = schedule.end_ns / 1e9
            raise ValueError(f"at_s is after the end, got {spec.at_s} s, expected up to {end} s")
    return Change(time_ns, port, parsed(port, spec.value))


def _plain(value: object) -> object:
    """Return an array or bytes as :func:`parsed` takes them."""
    return value.hex() if isinstance(value, bytes) else np.asarray(value).tolist()
