"""Find inputs that nothing is connected to though something here could be."""

from collections.abc import Iterable, Mapping

import numpy as np

from orchestrator.assembly.connections import Ports, fits
from orchestrator.assembly.description import Port
from orchestrator.assembly.system import Link
from orchestrator.scenario.records import Scenario

NAMED = 3  # of a group that is partly given
Group = Mapping[str, Port]  # by member


def forgotten(scenario: Scenario, ports: Ports, links: Iterable[Link]) -> list[str]:
    """Return a line for every component with inputs that keep their start value but need not.

    What an event or the component's own ``parameters`` set is given. Of what is not given, an input
    is told if the rest of its group is connected, or if another component here could feed it: a
    variable by any output that fits, a group by one that has a fitting output for every member. So
    the wind is optional in a scenario without gusts, a command never is beside its controller.
    """
    fed = {str(link.target) for link in links}
    given = fed | {event.set for event in scenario.events}
    given |= {f"{one.name}.{name}" for one in scenario.components for name in one.parameters}
    outputs = {name: _groups(own, "output") for name, own in ports.items()}
    lines: list[str] = []
    for component, own in ports.items():
        others = [group for name, each in outputs.items() if name != component for group in each]
        told: list[str] = []
        for group in _groups(own, "input"):
            left = {m: port for m, port in group.items() if str(port) not in given}
            is_part = any(str(port) in fed for port in group.values())
            if left and (is_part or any(_could_feed(other, group) for other in others)):
                told += _words(left, len(group))
        if told:
            lines.append(f"{', '.join(told)}: nothing is connected, the start value is kept")
    return lines


def _groups(ports: Mapping[str, Port], causality: str) -> list[Group]:
    """Return the variables of a causality by group; those without one make a group of their own."""
    made: dict[str, dict[str, Port]] = {}
    for name, port in ports.items():
        if port.causality == causality:
            group, dot, member = name.rpartition(".")
            made.setdefault(group + dot or name, {})[member] = port
    return list(made.values())


def _could_feed(source: Group, target: Group) -> bool:
    if len(target) == 1:
        return any(fits(port, one) for one in target.values() for port in source.values())
    return all(m in source and fits(source[m], port) for m, port in target.items())


def _words(left: Group, size: int) -> list[str]:
    """Return what to call the inputs that are left of a group of that size."""
    if size == 1 or len(left) <= min(NAMED, size - 1):
        return [_start(port) for port in left.values()]
    group = str(next(iter(left.values()))).rpartition(".")[0]
    return [group if len(left) == size else f"{group} ({len(left)} of {size} variables)"]


def _start(port: Port) -> str:
    if isinstance(port.start, np.ndarray) or port.start is None:
        return str(port)
    value = port.items.get(port.start, port.start) if isinstance(port.start, int) else port.start
    return f"{port} ({f'{value:g}' if isinstance(value, float) else value}{port.unit_suffix})"
