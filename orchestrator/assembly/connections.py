"""Check a scenario's connections against the components' ports and expand groups to variables."""

import logging
from collections.abc import Iterable, Mapping, Sequence

from orchestrator.assembly.clock import nanoseconds
from orchestrator.assembly.description import Port, members
from orchestrator.assembly.system import Link
from orchestrator.assembly.units import conversion
from orchestrator.errors import Problem, ScenarioError, nearest
from orchestrator.scenario.records import ConnectionSpec

Ports = Mapping[str, Mapping[str, Port]]

logger = logging.getLogger(__name__)


def connect(ports: Ports, specs: Sequence[ConnectionSpec]) -> tuple[Link, ...]:
    """Return one link per variable, in the order of the scenario.

    ``a.group -> b.group`` joins the members by name; every input of the target's group must have a
    source. Inputs that nothing is connected to keep their start value: see ``forgotten.py``.

    Raises
    ------
    ScenarioError
        With every problem found, each at ``("connections", index)``.
    """
    links: dict[Port, Link] = {}
    problems: list[Problem] = []
    for index, spec in enumerate(specs):
        messages: list[str] = []
        for link in _expand(ports, spec, messages):
            other = links.setdefault(link.target, link)
            if other is not link:
                messages.append(f"{link.target} has two sources, the other is {other.source}")
        start = f"connection {spec.start} -> {spec.end}: "
        problems += [Problem(("connections", index), start + message) for message in messages]
    if problems:
        raise ScenarioError(problems)
    for line in conversions(links.values()):
        logger.info(line)
    return tuple(links.values())


def conversions(links: Iterable[Link]) -> list[str]:
    """Return one line for every link that converts units."""
    return [
        f"connection {link}: {link.source.unit or 'no unit'} is converted to "
        f"{link.target.unit or 'no unit'}, factor {link.factor!r}, offset {link.offset!r}"
        for link in links
        if link.factor != 1.0 or link.offset != 0.0
    ]


def fits(source: Port, target: Port) -> bool:
    """Whether a connection of the two would be accepted."""
    if (source.kind, source.shape) != (target.kind, target.shape):
        return False
    problems: list[str] = []
    _compare(source, target, ConnectionSpec(str(source), str(target)), problems)
    return not problems


def find(ports: Ports, path: str) -> tuple[str, Mapping[str, Port]]:
    """Return the component and the variables that ``component.variable`` or a group names.

    A single variable is returned under the empty name, a group by its members' names. A group comes
    before a parameter of its name, which cannot be connected.

    Raises
    ------
    ValueError
        If there is no such component, variable or group; the message says the nearest name.
    """
    component, _, name = path.partition(".")
    if component not in ports:
        raise ValueError(f"no component {component!r}{nearest(component, list(ports))}")
    own = ports[component]
    group = members(own, name)
    if name in own and not (group and own[name].causality == "parameter"):
        return component, {"": own[name]}
    if not name or not group:
        prefixes = [n[:i] for n in own for i, letter in enumerate(n) if letter == "."]
        known = list(dict.fromkeys([*own, *prefixes]))
        raise ValueError(
            f"component {component!r} has no variable or group {name!r}{nearest(name, known)}"
        )
    return component, group


def _expand(ports: Ports, spec: ConnectionSpec, problems: list[str]) -> list[Link]:
    """Return a connection's links; what is wrong is added to ``problems``."""
    delay_ns = 0
    try:
        delay_ns = nanoseconds(spec.delay_s)
    except ValueError as error:
        problems.append(f"delay_s is {error}")
    if delay_ns < 0:
        problems.append(f"delay_s is negative, got {spec.delay_s} s, expected 0 s or more")
    sides: list[Mapping[str, Port]] = []
    for path in (spec.start, spec.end):
        try:
            sides.append(find(ports, path)[1])
        except ValueError as error:
            problems.append(str(error))
    if len(sides) < 2:
        return []
    sources, targets = sides
    links: list[Link] = []
    for source, target in _pairs(spec, sources, targets, problems):
        factor, offset = _compare(source, target, spec, problems)
        links.append(Link(source, target, factor, offset, delay_ns))
    return links


def _pairs(
    spec: ConnectionSpec,
    sources: Mapping[str, Port],
    targets: Mapping[str, Port],
    problems: list[str],
) -> list[tuple[Port, Port]]:
    """Return source and target of every variable; what is missing is added to ``problems``."""
    if ("" in sources) != ("" in targets):
        kinds = ["a variable" if "" in side else "a group" for side in (sources, targets)]
        problems.append(f"{spec.start} is {kinds[0]} but {spec.end} is {kinds[1]}")
        return []
    if "" in targets:
        return [(sources[""], targets[""])]
    inputs = {name: port for name, port in targets.items() if port.causality == "input"}
    if not inputs:
        problems.append(f"{spec.end} has no inputs, got {_causalities(targets)}")
    missing = [name for name in inputs if name not in sources]
    if missing:
        lacking = ", ".join(repr(name) + nearest(name, list(sources)) for name in missing)
        problems.append(f"{spec.start} has no source for {lacking}")
    return [(sources[name], port) for name, port in inputs.items() if name in sources]


def _causalities(ports: Mapping[str, Port]) -> str:
    return " and ".join(sorted({port.causality for port in ports.values()}))


def _compare(
    source: Port, target: Port, spec: ConnectionSpec, problems: list[str]
) -> tuple[float, float]:
    """Return factor and offset: as given, or of the units; misfits are added to ``problems``."""
    if source.causality != "output":
        problems.append(f"{source} cannot be a source, got {source.causality}, expected output")
    if target.causality != "input":
        hint = "; events change tunable parameters" if target.causality == "parameter" else ""
        problems.append(
            f"{target} cannot be a target, got {target.causality}, expected input{hint}"
        )
    if source.causality != "output" or target.causality != "input":
        return 1.0, 0.0
    if source.shape != target.shape:
        problems.append(f"{target}: wrong shape, got {source.shape}, expected {target.shape}")
    if source.kind != target.kind:
        problems.append(f"{target}: wrong type, got {source.type}, expected {target.type}")
    elif source.items != target.items:
        got, expected = (list(port.items.values()) for port in (source, target))
        problems.append(f"{target}: other enumeration items, got {got}, expected {expected}")
    if spec.factor is not None or spec.offset:
        if not source.kind == target.kind == "float":
            problems.append(f"{target}: factor and offset are for floats, got {target.type}")
        return 1.0 if spec.factor is None else spec.factor, spec.offset
    if source.kind == target.kind == "float":
        try:
            return conversion(source.unit, target.unit) or (1.0, 0.0)
        except ValueError as error:
            problems.append(f"{target}: {error}")
    return 1.0, 0.0
