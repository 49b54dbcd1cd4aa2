"""Plan how to make a scenario's resources and components, before any of them is made.

``${name}`` as a parameter's value is a resource, passed to the constructor's argument of that name;
everything else goes into the parameter dataclass. What ``parameters`` of a file mean is in
``files.py``.
"""

import re
from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

from orchestrator.assembly.discovery import FILES, find_file, resolve
from orchestrator.assembly.files import file_arguments
from orchestrator.assembly.parameters import TOLD, Constructor, adapter, constructor
from orchestrator.assembly.plan import Plan
from orchestrator.errors import nearest
from orchestrator.scenario.load import installed
from orchestrator.scenario.marks import Fault, KeyPath, Mark, Node, Origins, dotted, scenario_error
from orchestrator.scenario.records import ComponentSpec, ResourceSpec, Scenario
from orchestrator.scenario.validation import validate

REFERENCE = re.compile(r"\$\{([^}]*)\}")


def make_plans(scenario: Scenario) -> list[Plan]:
    """Return the plans of all resources and components, in the order of making.

    Raises
    ------
    ScenarioError
        With everything wrong in ``use`` and ``parameters``.
    """
    origins = scenario.origins
    root = origins.root if isinstance(origins, Origins) else Node({}, Mark("scenario"))
    faults: list[Fault] = []
    names = [spec.name for spec in scenario.resources]
    folders = (scenario.folder, Path(), installed())
    specs = (*scenario.resources, *scenario.components)
    made = [_plan(spec, names, folders, root, faults) for spec in specs]
    plans = {plan.path: plan for plan in made if plan is not None}
    try:
        order = list(
            TopologicalSorter({path: plan.needs for path, plan in plans.items()}).static_order()
        )
    except CycleError as error:
        cycle: list[KeyPath] = error.args[1]
        what = (
            f"resources: a cycle, got {' -> '.join(str(path[1]) for path in cycle)}, expected none"
        )
        faults.append(Fault(root.place(cycle[0]), what, cycle[0]))
        order = []
    if faults:
        raise scenario_error(faults)
    return [plans[path] for path in order]


def _plan(
    spec: ResourceSpec | ComponentSpec,
    resources: Sequence[str],
    folders: tuple[Path, ...],
    root: Node,
    faults: list[Fault],
) -> Plan | None:
    """Return the plan of one resource or component; what is wrong is appended to ``faults``."""
    path: KeyPath = _path(spec)
    try:
        file = find_file(spec.use, folders)
        factory = resolve(spec.use, *folders) if file is None else resolve(FILES[file[0]])
        takes = constructor(factory)
    except ValueError as error:
        where = (*path, "use")
        faults.append(Fault(root.place(where), f"{dotted(where)}: {error}", where))
        return None
    arguments: dict[str, Any] = {}
    if isinstance(spec, ComponentSpec):
        told = {"latency_s": spec.latency_s, "instance_name": spec.name}
        arguments = {name: told[name] for name in TOLD if name in takes.injected}
    if isinstance(spec, ComponentSpec) and file is not None:
        found = file_arguments(spec, takes, *file, root, faults)
        if found is None:
            return None
        arguments["parameters"], notes = found
        return Plan(path, factory, arguments, {}, notes)
    if isinstance(spec, ComponentSpec) and spec.fmu:
        where = (*path, "fmu")
        what = f"{dotted(where)}: not an FMU, got {spec.use!r}"
        faults.append(Fault(root.place_of_key(where), what, where))
    injected = {
        key: match[1]
        for key, value in spec.parameters.items()
        if isinstance(value, str) and (match := REFERENCE.fullmatch(value))
    }
    where = (*path, "parameters")
    for key, what in _wrong_injections(spec, takes, injected, resources).items():
        full = (*where, key)
        faults.append(Fault(root.place(full), f"{dotted(full)}: {what}", full))
    plain = {k: v for k, v in spec.parameters.items() if k not in {**injected, **takes.injected}}
    if takes.record is not None:
        arguments["parameters"] = validate(
            adapter(takes.record), plain, faults, root, where, {"folders": folders}
        )
    else:
        for key in plain:
            full = (*where, key)
            what = f"{dotted(full)}: unknown key, got {key!r}, expected no parameters"
            faults.append(Fault(root.place_of_key(full), what, full))
    return Plan(path, factory, arguments, injected)


def _path(spec: ResourceSpec | ComponentSpec) -> KeyPath:
    return ("components" if isinstance(spec, ComponentSpec) else "resources", spec.name)


def _wrong_injections(
    spec: ResourceSpec | ComponentSpec,
    takes: Constructor,
    injected: Mapping[str, str],
    resources: Sequence[str],
) -> dict[str, str]:
    """Return what is wrong with the resources a constructor is given, by argument."""
    wrong: dict[str, str] = {}
    accepted = [name for name in takes.injected if name not in TOLD]
    for key, name in injected.items():
        if key not in accepted:
            near = nearest(key, accepted) or f", expected one of {accepted}" if accepted else ""
            wrong[key] = f"takes no resource, got '${{{name}}}'{near}"
        elif name not in resources:
            near = nearest(name, resources) or f", expected one of {list(resources)}"
            wrong[key] = f"no resource {name!r}{near}"
    for key in accepted:
        example = f"'${{{key if key in resources else 'name'}}}'"
        if key in spec.parameters and key not in injected:
            wrong[key] = f"not a resource, got {spec.parameters[key]!r}, expected {example}"
        elif takes.injected[key] and key not in injected:
            wrong[key] = f"missing, expected a resource, as {example}"
    return wrong
