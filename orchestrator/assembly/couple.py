"""Make a system of components: describe, connect, schedule; every problem is reported at once."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from orchestrator.assembly.connections import Ports, connect, conversions, find
from orchestrator.assembly.description import Port, ports
from orchestrator.assembly.forgotten import forgotten
from orchestrator.assembly.schedule import compile_schedule
from orchestrator.assembly.system import System
from orchestrator.component import INTERFACE, Component, Instance
from orchestrator.errors import CouplingError, Problem, ScenarioError
from orchestrator.run.events import changes, too_late
from orchestrator.scenario.records import ComponentSpec, Scenario

Made = TypeVar("Made")


def couple(
    scenario: Scenario,
    components: Mapping[str, Component],
    *,
    bounds: Mapping[str, Any] | None = None,
    max_steps: int = 10_000_000,
) -> System:
    """Return the system of a scenario's components, which are given by name and not initialized.

    Events are held to the ``bounds`` of parameters too: see :mod:`orchestrator.assembly.settable`.

    Raises
    ------
    KeyError
        If a component of the scenario is not given.
    ScenarioError
        With every problem found: descriptions, connections, events, policies, times, cycles.
    """
    problems: list[Problem] = []

    def attempt(make: Callable[[], Made]) -> Made | None:
        try:
            return make()
        except ScenarioError as error:
            problems.extend(error.problems)
            return None

    instances = {s.name: Instance(s.name, components[s.name]) for s in scenario.components}
    described: dict[str, dict[str, Port]] = {}
    cause: CouplingError | None = None
    for spec in scenario.components:
        try:
            described[spec.name] = ports(spec.name, instances[spec.name].description)
            _check(spec, instances[spec.name])
        except CouplingError as error:
            problems.append(Problem(("components", spec.name), str(error)))
            cause = error
    if problems:
        raise ScenarioError(problems) from cause
    executions = {name: instance.execution for name, instance in instances.items()}
    links = attempt(lambda: connect(described, scenario.connections))
    timed = scenario if links is not None else replace(scenario, connections=())
    schedule = attempt(
        lambda: compile_schedule(timed, executions, described, links or (), max_steps=max_steps)
    )
    attempt(lambda: changes(scenario.events, described, links or (), schedule, bounds))
    attempt(lambda: _check_end(scenario, described))
    if problems or links is None or schedule is None:
        raise ScenarioError(problems)
    notes = (*forgotten(scenario, described, links), *too_late(scenario.events, schedule))
    log = [*conversions(links), *notes]
    return System(instances, described, schedule, links, scenario, log, notes)


def _check(spec: ComponentSpec, instance: Instance) -> None:
    """Refuse an execution or a policy that the component cannot keep."""
    execution = instance.execution
    start = f"component {spec.name!r}: "
    if execution.interface != INTERFACE:
        raise CouplingError(
            f"{start}other version of the contract, got {execution.interface}, expected {INTERFACE}"
        )
    if execution.kind not in ("continuous", "sampled"):
        raise CouplingError(
            f"{start}unknown execution, got {execution.kind!r}, expected 'continuous' or 'sampled'"
        )
    if spec.on_discard == "retry":
        co_simulation = instance.description.coSimulation
        is_variable = (
            co_simulation is not None and co_simulation.canHandleVariableCommunicationStepSize
        )
        can_go_back = instance.is_restorable or (
            co_simulation is not None
            and co_simulation.canGetAndSetFMUstate
            and hasattr(instance.component, "snapshot")
        )
        if not (is_variable and can_go_back and execution.kind == "continuous"):
            raise CouplingError(
                f"{start}on_discard 'retry' is not possible, expected a continuous component that "
                "advertises canHandleVariableCommunicationStepSize and canSerializeFMUstate"
            )
    is_isolated = spec.isolation == "process"
    if spec.on_error == "restart" and not (is_isolated and instance.is_restorable):
        raise CouplingError(
            f"{start}on_error 'restart' is not possible, expected isolation 'process' and a "
            "component that advertises canSerializeFMUstate"
        )
    if spec.timeout_s is not None and not is_isolated:
        raise CouplingError(
            f"{start}timeout_s is not possible, got {spec.timeout_s} s, expected isolation "
            "'process', or deadline_s, which is measured after each step"
        )


def _check_end(scenario: Scenario, ports: Ports) -> None:
    """Refuse an ``end_on`` that is not an enumeration output."""
    problems: list[Problem] = []
    for index, path in enumerate(scenario.end_on):
        try:
            port = find(ports, path)[1].get("")
        except ValueError as error:
            problems.append(Problem(("end_on", index), f"end_on {path}: {error}"))
            continue
        if port is None or port.causality != "output" or not port.items or port.shape:
            got = "a group" if port is None else f"{port.causality} of type {port.type}"
            message = f"end_on {path}: got {got}, expected an enumeration output"
            problems.append(Problem(("end_on", index), message))
    if problems:
        raise ScenarioError(problems)
