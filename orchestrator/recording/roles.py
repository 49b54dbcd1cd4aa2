"""The roles of a scenario's scene that are drawn: which variables of which component fill them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from orchestrator.assembly.description import Port, members
from orchestrator.recording.wire import pick

POSE = ("north", "east", "down", "phi", "theta", "psi")
POSITION = ("north", "east", "down")
GROUPS = {  # role: its members, and how many dimensions they have
    "pose": (POSE, 0),
    "velocity": (POSITION, 0),
    "path": (POSITION, 1),
    "reference": (("north", "east", "altitude", "heading", "speed"), 1),
    "scan": (("north", "east", "elevation"), 1),
    "wind": (POSITION, 0),
}

Scene = Mapping[str, str]
Ports = Mapping[str, Mapping[str, Port]]


Look = Callable[[Any], tuple[Any, ...]]  # at what a row holds, for the values of a role


class Filled(NamedTuple):
    """Who fills a role: a component, and the names of its variables."""

    component: str
    names: tuple[str, ...]

    def look(self, sources: Sequence[str]) -> Look:
        """Return how to find them in the values of one component, or in a tuple of several's."""
        find = pick(self.names)
        if len(sources) == 1:
            return find
        k = sources.index(self.component)
        return lambda values: find(values[k])


def filled(scene: Scene, ports: Ports) -> dict[str, Filled]:
    """Return who fills the roles that there are.

    Raises
    ------
    ValueError
        If a role names no outputs, or others than it needs.
    """
    made = {role: _group(role, scene[role], ports) for role in GROUPS if role in scene}
    if "clearance" in scene:
        made["clearance"] = _number("clearance", scene["clearance"], ports)
    return made


def beside(cells: Filled, member: str, ports: Ports) -> Filled | None:
    """Return a further member of a group, if it has one."""
    name = f"{cells.names[0].rpartition('.')[0]}.{member}"
    return Filled(cells.component, (name,)) if name in ports[cells.component] else None


def _group(role: str, named: str, ports: Ports) -> Filled:
    wanted, ndim = GROUPS[role]
    component, _, group = named.partition(".")
    found = members(ports.get(component, {}), group)
    given = (found.get(member) for member in wanted)
    if any(p is None or p.causality != "output" or len(p.shape) != ndim for p in given):
        kind = "arrays " if ndim else ""
        raise ValueError(
            f"scene.{role}: no such outputs, got {named!r}, "
            f"expected a group with {kind}{', '.join(wanted)}"
        )
    return Filled(component, tuple(f"{group}.{member}" for member in wanted))


def _number(role: str, named: str, ports: Ports) -> Filled:
    component, _, name = named.partition(".")
    found = ports.get(component, {}).get(name)
    if found is None or found.causality != "output" or found.shape:
        raise ValueError(f"scene.{role}: no such output, got {named!r}, expected a number")
    return Filled(component, (name,))
