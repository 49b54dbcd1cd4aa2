"""Components leave as FMUs: find the component, describe it, pack it with what makes it again."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from orchestrator.assembly.discovery import Factory
from orchestrator.assembly.examples import find
from orchestrator.assembly.make import make, needed
from orchestrator.assembly.parameters import TOLD, constructor
from orchestrator.assembly.plans import Plan, make_plans
from orchestrator.component import Instance
from orchestrator.errors import ScenarioError
from orchestrator.export.package import BackEnd, c_file, package
from orchestrator.export.recipe import component_json
from orchestrator.export.rows import rows
from orchestrator.export.xml import Abilities
from orchestrator.run.initialize import component_seed
from orchestrator.scenario.load import installed, load

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


@dataclass(frozen=True)
class Chosen:
    """A component to export: the calls that make it, its seed, and where its parameters are from."""

    plan: Plan
    resources: list[Plan]
    seed: int
    origin: str


def choose(use: str, scenario: Path | None = None, overrides: Sequence[str] = ()) -> Chosen:
    """Return what is to be exported.

    Parameters
    ----------
    use : str
        The name of a component in the scenario, or what ``use`` may say there.
    scenario : Path, optional
        Where its parameters are from. Without one they are its defaults, if they suffice, or those
        of the first installed scenario that holds such a component.
    overrides : sequence of str
        Of the scenario, as ``components.mpc.parameters.basis=tent``.

    Raises
    ------
    ValueError
        If there is no such component, or nothing to make it from.
    """
    if scenario is None and overrides:
        raise ValueError("--set: no scenario to change, expected --scenario")
    if scenario is not None:
        loaded = load(scenario, overrides)
        if use in (spec.name for spec in loaded.components):
            found = _planned(make_plans(loaded), name=use)
        else:
            found = _planned(make_plans(loaded), factory=find(use))
        if found is None:
            names = ", ".join(spec.name for spec in loaded.components)
            raise ValueError(f"{scenario}: has no component {use!r}, expected one of {names}")
        plan, resources = found
        name = str(plan.path[1])
        return Chosen(plan, resources, component_seed(loaded.seed, name), f"{name} of {scenario}")
    factory = find(use)
    if (plan := _default(factory)) is not None:
        return Chosen(plan, [], 0, "defaults")
    for file in sorted(installed().glob("*.yaml")):
        try:
            found = _planned(make_plans(load(file)), factory=factory)
        except ScenarioError:
            continue
        if found is not None:
            plan, resources = found
            return Chosen(plan, resources, 0, f"{plan.path[1]} of {file}")
    raise ValueError(
        f"{use}: cannot be made from its defaults, expected a scenario that holds one, by --scenario"
    )


def _planned(
    plans: list[Plan], *, name: str = "", factory: Factory | None = None
) -> tuple[Plan, list[Plan]] | None:
    for plan in plans:
        if plan.path == ("components", name) or (factory and plan.factory is factory):
            return plan, needed(plan, plans)
    return None


def _default(factory: Factory) -> Plan | None:
    """Return the plan of a component made from its defaults; None if they do not suffice."""
    takes = constructor(factory)
    told: dict[str, Any] = {"latency_s": 0.0, "instance_name": "fmu"}
    given = {name: told[name] for name in TOLD if name in takes.injected}
    if any(needs and name not in given for name, needs in takes.injected.items()):
        return None
    try:
        if takes.record is not None:
            given["parameters"] = takes.record()
    except TypeError:
        return None  # a parameter has no default
    return Plan(("components", "fmu"), factory, given, {})


def export(
    chosen: Chosen,
    out: Path,
    *,
    fmi: Literal[2, 3] = 3,
    language: Literal["python", "c"] = "python",
) -> None:
    """Write the FMU of a component.

    Parameters
    ----------
    chosen : Chosen
    out : Path
    fmi : int
        Version of the standard.
    language : str
        What runs in it: a Python process, or C, of components that have a method ``c_source``.

    Raises
    ------
    ScenarioError
        If the component cannot be made.
    ValueError
        If it cannot be described, compiled or packed.
    """
    from fmpy.validation import validate_model_description

    component = make([*chosen.resources, chosen.plan])[chosen.plan.path]
    tool = f"hedgehop {version('hedgehop')}"
    if language == "c":
        _export_c(component, out, fmi, tool)
        return
    description = Instance(str(chosen.plan.path[1]), component).description
    problems = validate_model_description(description, validate_variable_names=True)
    if problems:
        raise ValueError(f"{chosen.origin}: description is not valid: {'; '.join(problems)}")
    given = chosen.plan.arguments
    found = rows(description, given.get("parameters"), fmi=fmi, latency_s=given.get("latency_s"),
                 seed=chosen.seed)  # fmt: skip
    recipe, files = component_json([*chosen.resources, chosen.plan], found)
    worker = (Path(__file__).parent / "worker").glob("*.py")
    resources = {
        **files,
        "component.json": json.dumps(recipe, indent=1).encode(),
        **{f"hedgehop_worker/{file.name}": file.read_bytes() for file in worker},
    }
    back_end = BackEnd(
        {"process.c": c_file("process.c")}, _abilities(description, needs_tool=True), resources,
        python=sys.executable,
    )  # fmt: skip
    package(out, description, found, component.execution, back_end, fmi=fmi, tool=tool)


def _export_c(component: Any, out: Path, fmi: int, tool: str) -> None:
    """Write the FMU of a component that says itself what it is in C."""
    if not hasattr(component, "c_source"):
        raise ValueError(
            f"{type(component).__name__}: cannot be exported as C, has no method 'c_source'"
        )
    source = component.c_source()
    abilities = _abilities(source.description, needs_tool=False)
    back_end = BackEnd(source.sources, abilities, source.resources)
    found = rows(source.description, fmi=fmi)
    package(out, source.description, found, component.execution, back_end, fmi=fmi, tool=tool)


def _abilities(description: "ModelDescription", *, needs_tool: bool) -> Abilities:
    flags = description.coSimulation
    if flags is None:
        raise ValueError(f"{description.modelName}: describes no co-simulation")
    return Abilities(
        variable_step=flags.canHandleVariableCommunicationStepSize,
        state=flags.canGetAndSetFMUstate and flags.canSerializeFMUstate,
        directional=bool(flags.providesDirectionalDerivative) and not needs_tool,
        needs_tool=needs_tool,
    )
