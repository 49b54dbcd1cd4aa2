"""Find arguments with which a component can be made, to look at it or to check it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from orchestrator.assembly.build import arguments, make
from orchestrator.assembly.discovery import Factory, resolve
from orchestrator.assembly.parameters import constructor
from orchestrator.assembly.plans import Plan, make_plans
from orchestrator.errors import ScenarioError
from orchestrator.scenario.load import installed, load


def example(factory: Factory, scenario: Path | None = None) -> tuple[dict[str, Any], str]:
    """Return arguments that a factory accepts, and where they are from.

    They are those of the given scenario; otherwise its defaults, if they suffice; otherwise those
    of the first installed scenario that has such a component.

    Raises
    ------
    ValueError
        If there are none.
    """
    takes = constructor(factory)
    if scenario is None and not any(takes.injected.values()):
        try:
            return ({} if takes.record is None else {"parameters": takes.record()}), "defaults"
        except TypeError:
            pass  # a parameter has no default
    for file in [scenario] if scenario else sorted(installed().glob("*.yaml")):
        try:
            plans = make_plans(load(file))
        except ScenarioError:
            if scenario:
                raise
            continue
        for plan in plans:
            if plan.factory is factory:
                made = make(_needed(plan, plans))
                return arguments(plan, made), f"{plan.path[1]} of {file}"
    raise ValueError(
        f"{factory.__name__}: cannot be made from its defaults, "
        f"expected a scenario that holds one, by --scenario"
    )


def _needed(plan: Plan, plans: list[Plan]) -> Iterator[Plan]:
    """Yield the plans of the resources that a plan needs, in order of making."""
    paths = set(plan.needs)
    for other in reversed(plans):
        if other.path in paths:
            paths.update(other.needs)
    yield from (other for other in plans if other.path in paths)


def find(use: str) -> Factory:
    """Return what ``use`` names, as in a scenario of the current folder."""
    return resolve(use, Path())
