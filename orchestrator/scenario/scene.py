"""Check the scene: what a scenario says viewers should draw and figures be taken from."""

from collections.abc import Iterable, Mapping

from orchestrator.assembly.connections import Ports, find
from orchestrator.assembly.description import Port
from orchestrator.assembly.system import Link
from orchestrator.errors import Problem, ScenarioError, nearest
from orchestrator.scenario.records import Scenario

POSITION = ("north", "east", "down")
GROUPS: Mapping[str, tuple[str, ...]] = {  # role: members that it must have
    "pose": (*POSITION, "phi", "theta", "psi"),
    "velocity": POSITION,
    "controls": (),
    "plan": (),
    "path": POSITION,
    "reference": ("north", "east", "altitude", "heading", "speed"),
    "scan": ("north", "east", "elevation"),
    "wind": POSITION,
}


def check_scene(scenario: Scenario, ports: Ports, links: Iterable[Link] = ()) -> None:
    """Refuse roles that name nothing, nothing of their kind, or inputs, which nobody publishes.

    Raises
    ------
    ScenarioError
        With every such role, each at ``("scene", role)``.
    """
    resources = [f"${{{spec.name}}}" for spec in scenario.resources]
    sources = {link.target: link.source for link in links}
    problems: list[Problem] = []
    for role, name in scenario.scene.items():
        if role == "terrain":
            what = _wrong_resource(name, resources)
        else:
            what = _wrong(role, name, ports, sources)
        if what:
            problems.append(Problem(("scene", role), f"scene.{role}: {what}"))
    if problems:
        raise ScenarioError(problems)


def _wrong_resource(name: str, resources: list[str]) -> str | None:
    if name in resources:
        return None
    return f"no resource, got {name!r}, expected one of {resources}{nearest(name, resources)}"


def _wrong(role: str, name: str, ports: Ports, sources: Mapping[Port, Port]) -> str | None:
    try:
        _, found = find(ports, name)
    except ValueError as error:
        return str(error)
    is_group = role in GROUPS
    if is_group == ("" in found):
        got, expected = ("variable", "group") if is_group else ("group", "variable")
        return f"a {got}, got {name!r}, expected a {expected}"
    missing = [member for member in GROUPS.get(role, ()) if member not in found]
    if missing:
        return f"{name!r} lacks members, expected {', '.join(missing)}"
    needed = [found[member] for member in GROUPS.get(role) or found]
    inputs = [port for port in needed if port.causality == "input"]
    if not inputs:
        return None
    feeding = [str(sources[port]) for port in inputs if port in sources]
    whole = dict.fromkeys(one.rpartition(".")[0] if is_group else one for one in feeding)
    expected = f"what feeds it, {', '.join(whole)}" if feeding else "what is published"
    return f"not an output, got {name!r}, expected {expected}"
