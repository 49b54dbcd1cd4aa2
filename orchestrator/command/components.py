"""Commands about components."""

from pathlib import Path
from typing import Literal

from orchestrator.command.arguments import Flag, Out, Overrides, user_errors


def list_() -> None:
    """List the installed components."""
    import re
    from inspect import getdoc

    from orchestrator.assembly.discovery import installed_components, resolve
    from orchestrator.command.tables import components_table
    from orchestrator.command.terminal import print_table

    rows: list[tuple[str, str, str]] = []
    for name, point in installed_components().items():
        try:
            first = (getdoc(resolve(point.value)) or "").partition("\n")[0]
            meaning = re.sub(
                r"(?::\w+)*:?`+~?(.+?)`+", r"\1", first
            )  # roles are for readers of code
        except ValueError as error:
            meaning = f"broken: {error}"
        rows.append((name, point.value, meaning))
    print_table("installed components", components_table(rows))


def inspect(use: str, /, *, scenario: Path | None = None) -> None:
    """Show a component's variables and parameters, or all components of a recording.

    Parameters
    ----------
    use
        An FMU, a recording, the name of an installed component, or module:attribute.
    scenario
        A scenario that holds one, where its defaults are not enough to make one.
    """
    from orchestrator.assembly.description import ports
    from orchestrator.assembly.discovery import find_file
    from orchestrator.assembly.examples import example, find
    from orchestrator.assembly.parameters import adapter, constructor
    from orchestrator.command.tables import parameters_table
    from orchestrator.command.terminal import print_table
    from orchestrator.command.variables import feed_through, resources, variables_table
    from orchestrator.component import Instance
    from orchestrator.failure import failure

    with user_errors():
        file = find_file(use, (Path(),))
        if file is not None and file[0] == "mcap":
            _inspect_recording(file[1])
            return
        factory = find(use)
        takes = constructor(factory)
        record = takes.record
        is_fmu = record is not None and "event_mode" in record.__dataclass_fields__
        if record is not None:
            what = "options, under 'fmu' in a scenario" if is_fmu else "parameters"
            print_table(f"{use}: {what}", parameters_table(adapter(record).json_schema()))
        if said := resources(takes.injected):
            print(f"takes {said}")
        if isinstance(factory, type) and not hasattr(factory, "describe"):
            return  # a resource
        _, arguments, where = example(use, scenario)
        try:
            instance = Instance(use, factory(**arguments))
        except Exception as error:
            raise ValueError(f"{use}: {failure(error, factory, 'constructor')}") from error
        described, execution = ports(use, instance.description), instance.execution
    runs = f"{execution.kind}, {execution.rate_hz:g} Hz unless told otherwise"
    table = variables_table(described.values(), has_fixed=is_fmu)
    print_table(f"\n{use}: {runs}; variables, made with {where}", table)
    if passed := feed_through(described.values()):
        print(f"at the same instant: {passed}")


def _inspect_recording(file: Path) -> None:
    from orchestrator.command.terminal import print_table
    from orchestrator.command.variables import recorded_table
    from orchestrator.recording.inventory import recorded
    from orchestrator.recording.reader import Recording

    recording = Recording.open(file)
    print(f"{file}: {recording.scenario['title']}")
    for name, plain in recording.components.items():
        one = recorded(name, plain)
        title = f"\n{name}: {one.kind}, {one.rate_hz:g} Hz"
        print_table(title, recorded_table(one.ports.values(), recording))


def check(use: str, /, *, scenario: Path | None = None, timeout_s: float = 60.0) -> int:
    """Check that a component keeps the contract; exit code 1 if it does not.

    Parameters
    ----------
    use
        An FMU, the name of an installed component, or module:attribute.
    scenario
        A scenario that holds one, where its defaults are not enough to make one.
    timeout_s
        How long each clause may take, s; the first may have to compile.
    """
    from orchestrator.assembly.examples import example
    from orchestrator.command.tables import clauses_table
    from orchestrator.command.terminal import print_table
    from orchestrator.conformance.check import check_component

    with user_errors():
        factory, arguments, where = example(use, scenario)
        name = f"{factory.__module__}:{factory.__qualname__}"
        clauses = check_component(name, arguments, timeout_s=timeout_s)
    print_table(f"{use}, made with {where}", clauses_table(clauses))
    return int(any(clause.verdict == "failed" for clause in clauses))


def export(
    component: str,
    /,
    *,
    out: Out,
    fmi: Literal[2, 3] = 3,
    scenario: Path | None = None,
    overrides: Overrides = None,
    c: Flag = False,
) -> None:
    """Write a component as an FMU for co-simulation.

    Parameters
    ----------
    component
        The name of an installed component, module:attribute, or a name in the scenario.
    out
        The FMU to write.
    fmi
        Version of the standard, 2 or 3.
    scenario
        A scenario that holds the component, where its defaults are not enough or not meant.
    overrides
        A value of the scenario to change, as components.vehicle.parameters.speed_mps=20.
    c
        Write C sources in place of Python, if the component has them.
    """
    from orchestrator.export.export import choose
    from orchestrator.export.export import export as write

    with user_errors():
        chosen = choose(component, scenario, overrides or ())
        write(chosen, out, fmi=fmi, language="c" if c else "python")
    print(f"{out}: FMI {fmi}.0, made with {chosen.origin}")


def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from json import dumps

    from orchestrator.scenario.load import json_schema

    print(dumps(json_schema(), indent=2))
