"""Build a scenario: make its resources and components, inject, couple.

Everything cheap is checked first, and for all of them: see ``plans.py``.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from orchestrator.assembly.couple import couple
from orchestrator.assembly.make import Announce, announced, make, needed, problem, silent
from orchestrator.assembly.plan import Plan
from orchestrator.assembly.plans import make_plans
from orchestrator.assembly.settable import bounds
from orchestrator.assembly.system import System
from orchestrator.errors import ComponentDied, ComponentTimeout, Problem, ScenarioError
from orchestrator.isolation.remote import Remote
from orchestrator.scenario.marks import KeyPath, dotted, located
from orchestrator.scenario.records import ComponentSpec, RecordingSpec, Scenario
from orchestrator.scenario.scene import check_scene


def build(scenario: Scenario, announce: Announce = silent) -> System:
    """Return the runnable system of a scenario; nothing is initialized yet.

    Parameters
    ----------
    scenario : Scenario
    announce : callable, optional
        Hears the name of a resource or component whose construction takes more than 1 s.

    Raises
    ------
    ScenarioError
        With all that is wrong in names and parameters, or then in the constructors, or then in
        the coupling; each by file, line and column.
    """
    plans = make_plans(scenario)
    made: dict[KeyPath, Any] = {}
    try:
        _make(scenario, plans, made, announce)
        components = {spec.name: made["components", spec.name] for spec in scenario.components}
        system = couple(scenario, components, bounds=bounds(plans))
        check_scene(scenario, system.ports, system.links)
        if scenario.recording != RecordingSpec():
            from orchestrator.recording.choice import check_recording  # protobuf takes a while

            check_recording(system)
    except BaseException as error:
        for component in (one for path, one in made.items() if path[0] == "components"):
            with suppress(Exception):
                component.terminate()
        if isinstance(error, ScenarioError):
            raise located(error, scenario.origins) from error
        raise
    notes = [note for plan in plans for note in plan.notes]
    resources = {str(path[1]): one for path, one in made.items() if path[0] == "resources"}
    return replace(system, plans=tuple(plans), log=[*notes, *system.log], resources=resources)


def _make(
    scenario: Scenario, plans: Sequence[Plan], made: dict[KeyPath, Any], announce: Announce
) -> None:
    """Make isolated components in their processes, which start at once, and all others here.

    A resource is made wherever it is needed. What is made is in ``made`` at once, so that it can be
    ended where another cannot be made.
    """
    problems: list[Problem] = []
    cause: ScenarioError | None = None
    remotes: dict[KeyPath, Remote] = {}
    isolated: dict[KeyPath, ComponentSpec] = {
        ("components", s.name): s for s in scenario.components if s.isolation == "process"
    }
    for plan in plans:
        if plan.path in isolated:
            spec = isolated[plan.path]
            try:
                made[plan.path] = remotes[plan.path] = Remote(
                    [*needed(plan, plans), plan],
                    plan.path,
                    timeout_s=spec.timeout_s,
                    keeps_state=spec.on_error == "restart",
                )
            except ValueError as error:
                problems.append(problem(plan, error))
    drawn = scenario.scene.get("terrain") if scenario.recording.scene else None
    injected = {path for plan in plans for path in plan.needs if drawn != f"${{{path[1]}}}"}
    roots = [plan for plan in plans if plan.path not in injected and plan.path not in isolated]
    here = {one.path for root in roots for one in (root, *needed(root, plans))}
    try:
        make([plan for plan in plans if plan.path in here], announce, made)
    except ScenarioError as error:
        problems += error.problems
        cause = error
    for path, remote in remotes.items():
        try:
            with announced(str(path[1]), announce):
                remote.made()
        except ScenarioError as error:
            problems += error.problems
            cause = error
        except (ComponentDied, ComponentTimeout, ValueError) as error:
            problems.append(Problem(path, f"{dotted(path)}: {error}"))
    if problems:
        raise ScenarioError(dict.fromkeys(problems)) from cause
