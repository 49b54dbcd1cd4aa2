"""Find arguments with which a component can be made, to look at it or to check it."""

from pathlib import Path
from typing import Any

from orchestrator.assembly.discovery import Factory, find_file, resolve
from orchestrator.assembly.make import arguments, make, needed
from orchestrator.assembly.parameters import constructor
from orchestrator.assembly.plans import make_plans
from orchestrator.errors import ScenarioError
from orchestrator.scenario.load import installed, load


def example(use: str, scenario: Path | None = None) -> tuple[Factory, dict[str, Any], str]:
    """Return the factory that ``use`` names, arguments that it accepts, and where they are from.

    They are those of the given scenario; otherwise its defaults, if they suffice; otherwise those
    of the first installed scenario that has such a component, or one in whose place it can stand:
    one that takes the same arguments. Of a file they name the file.

    Raises
    ------
    ValueError
        If there are none.
    """
    factory = find(use)
    takes = constructor(factory)
    found = find_file(use, (Path(),))
    file = {} if found is None else {"file": found[1]}
    if scenario is None and not any(takes.injected.values()):
        try:
            record = {} if takes.record is None else {"parameters": takes.record(**file)}
        except TypeError:
            pass  # a parameter has no default
        else:
            return factory, record, "defaults"
    for path in [scenario] if scenario else sorted(installed().glob("*.yaml")):
        try:
            plans = make_plans(load(path))
        except ScenarioError:
            if scenario:
                raise
            continue
        for plan in sorted(plans, key=lambda plan: plan.factory is not factory):
            alike = takes.record is not None and constructor(plan.factory) == takes
            its_file: Any = getattr(plan.arguments.get("parameters"), "file", None)
            if (plan.factory is factory or alike) and (not file or file["file"].samefile(its_file)):
                made = make(needed(plan, plans))
                return factory, arguments(plan, made), f"{plan.path[1]} of {path}"
    raise ValueError(
        f"{use}: cannot be made from its defaults, "
        f"expected a scenario that holds one, by --scenario"
    )


def find(use: str) -> Factory:
    """Return what ``use`` names, as in a scenario of the current folder."""
    return resolve(use, Path())
