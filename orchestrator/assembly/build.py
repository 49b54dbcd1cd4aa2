"""Build a scenario: make its resources and components, inject, couple.

Everything cheap is checked first, and for all of them: see ``plans.py``.
"""

import hashlib
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from threading import Timer
from typing import Any

from orchestrator.assembly.couple import couple
from orchestrator.assembly.plans import Plan, make_plans
from orchestrator.assembly.system import System
from orchestrator.errors import Problem, ScenarioError
from orchestrator.recording.provenance import canonical
from orchestrator.scenario.marks import KeyPath, dotted, located
from orchestrator.scenario.records import Scenario
from orchestrator.scenario.scene import check_scene

PATIENCE = 1.0  # s, after which a construction is announced
Announce = Callable[[str], None]


def _silent(_: str) -> None:
    pass


def build(scenario: Scenario, announce: Announce = _silent) -> System:
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
    try:
        made = make(plans, announce)
        components = {spec.name: made["components", spec.name] for spec in scenario.components}
        system = couple(scenario, components)
        check_scene(scenario, system.ports)
    except ScenarioError as error:
        raise located(error, scenario.origins) from error
    return system


def make(plans: Iterable[Plan], announce: Announce = _silent) -> dict[KeyPath, Any]:
    """Return the resources and components of plans, by path.

    Raises
    ------
    ScenarioError
        With every constructor's refusal, not yet located.
    """
    made: dict[KeyPath, Any] = {}
    problems: list[Problem] = []
    for plan in plans:
        if not all(path in made for path in plan.needs):
            continue  # that one has failed, and is reported
        try:
            with _announced(str(plan.path[1]), announce):
                made[plan.path] = plan.factory(**arguments(plan, made))
        except (ValueError, KeyError, OSError, ImportError) as error:
            problems.append(_problem(plan, error))
        except Exception as error:
            error.add_note(f"while making {dotted(plan.path)}")
            raise
    if problems:
        raise ScenarioError(problems)
    return made


def arguments(plan: Plan, made: Mapping[KeyPath, Any]) -> dict[str, Any]:
    """Return what a plan's factory is called with."""
    return {**plan.arguments, **{k: made["resources", name] for k, name in plan.resources.items()}}


@contextmanager
def _announced(name: str, announce: Announce) -> Generator[None]:
    timer = Timer(PATIENCE, announce, [name])
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _problem(plan: Plan, error: Exception) -> Problem:
    """Return what a constructor refused; at the parameter that its message begins with, if any."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.strerror.lower()}, got {str(error.filename)!r}"
    name, _, what = text.partition(": ")
    if hasattr(plan.arguments.get("parameters"), name):
        path = (*plan.path, "parameters", name)
        return Problem(path, f"{dotted(path)}: {what}")
    return Problem(plan.path, f"{dotted(plan.path)}: {text}")


def specification_hash(scenario: Scenario, resource: str) -> str:
    """Return the SHA-256 of everything that determines a resource.

    That is its constructor, its parameters with all defaults, the content of the files among them
    and the resources it is given, but no file's name or place.
    """
    plans = {plan.path: plan for plan in make_plans(scenario)}

    def digest(name: str) -> str:
        plan = plans["resources", name]
        record = plan.arguments.get("parameters")
        plain = {
            "use": f"{plan.factory.__module__}:{plan.factory.__qualname__}",
            "parameters": {} if record is None else _contents(asdict(record)),
            "resources": {key: digest(one) for key, one in plan.resources.items()},
        }
        return hashlib.sha256(canonical(plain)).hexdigest()

    return digest(resource)


def _contents(value: object) -> object:
    """Return plain data with files replaced by what is in them."""
    if isinstance(value, Path):
        return {"sha256": hashlib.sha256(value.read_bytes()).hexdigest()}
    if isinstance(value, dict):
        return {str(key): _contents(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_contents(one) for one in value]
    return value
