"""Check the scene: what a scenario says viewers should draw and figures be taken from."""

from collections.abc import Mapping

from orchestrator.assembly.connections import Ports, find
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


def check_scene(scenario: Scenario, ports: Ports) -> None:
    """Refuse roles that name nothing, or nothing of their kind.

    Raises
    ------
    ScenarioError
        With every such role, each at ``("scene", role)``.
    """
    resources = [f"${{{spec.name}}}" for spec in scenario.resources]
    problems: list[Problem] = []
    for role, name in scenario.scene.items():
        what = _wrong_resource(name, resources) if role == "terrain" else _wrong(role, name, ports)
        if what:
            problems.append(Problem(("scene", role), f"scene.{role}: {what}"))
    if problems:
        raise ScenarioError(problems)


def _wrong_resource(name: str, resources: list[str]) -> str | None:
    if name in resources:
        return None
    return f"no resource, got {name!r}, expected one of {resources}{nearest(name, resources)}"


def _wrong(role: str, name: str, ports: Ports) -> str | None:
    try:
        _, found = find(ports, name)
    except ValueError as error:
        return str(error)
    if role not in GROUPS:
        return None if "" in found else f"a group, got {name!r}, expected a variable"
    if "" in found:
        return f"a variable, got {name!r}, expected a group"
    missing = [member for member in GROUPS[role] if member not in found]
    return f"{name!r} lacks members, expected {', '.join(missing)}" if missing else None
