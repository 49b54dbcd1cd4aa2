"""What a scenario says of a component that is a file: an FMU, or a recording.

Its ``parameters`` are an FMU's start values, and resources cannot enter it, so that changing
``use`` alone puts an FMU in the place of the component that it was made from.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from orchestrator.assembly.parameters import Constructor, adapter
from orchestrator.errors import CouplingError
from orchestrator.scenario.marks import Fault, KeyPath, Node, dotted
from orchestrator.scenario.records import ComponentSpec
from orchestrator.scenario.validation import validate

EXPORTED = "resources/component.json"  # how our exporter made an FMU


def file_arguments(
    spec: ComponentSpec, takes: Constructor, kind: str, file: Path, root: Node, faults: list[Fault]
) -> tuple[Any, tuple[str, ...]] | None:
    """Return the parameters of a component that is a file, and lines for the run's log.

    What is wrong is appended to ``faults``, and None returned.
    """
    arguments = _fmu if kind == "fmu" else _recording
    return arguments(spec, takes, file.absolute(), root, faults)


def _recording(
    spec: ComponentSpec, takes: Constructor, file: Path, root: Node, faults: list[Fault]
) -> tuple[Any, tuple[str, ...]] | None:
    """Return the parameters of a recording: which of its components is played."""
    assert takes.record is not None
    path: KeyPath = ("components", spec.name, "parameters")
    component = spec.parameters.get("component", spec.name)
    data = {"file": str(file), "component": component}
    made = validate(adapter(takes.record), data, faults, root, path, {"folders": (Path(),)})
    ignored = [key for key in spec.parameters if key != "component"]
    return (made, _notes(spec, ignored, "a recording takes none")) if made is not None else None


def _fmu(
    spec: ComponentSpec, takes: Constructor, file: Path, root: Node, faults: list[Fault]
) -> tuple[Any, tuple[str, ...]] | None:
    """Return the parameters of an FMU, of which nothing is run yet."""
    from orchestrator.fmu.component import describe_fmu
    from orchestrator.fmu.start import start_values

    assert takes.record is not None
    path: KeyPath = ("components", spec.name)
    resources = [key for key, value in spec.parameters.items() if _is_reference(value)]
    start = {key: value for key, value in spec.parameters.items() if key not in resources}
    before = len(faults)
    for key in ("file", "start"):
        if key in spec.fmu:
            where = (*path, "fmu", key)
            what = f"{dotted(where)}: not an option, expected 'use' and 'parameters' to say it"
            faults.append(Fault(root.place_of_key(where), what, where))
    data = {**spec.fmu, "file": str(file), "start": start}
    context = {"folders": (Path(),)}
    made: Any = validate(adapter(takes.record), data, faults, root, (*path, "fmu"), context)
    if made is None or len(faults) > before:
        return None
    try:
        described = describe_fmu(made, only=[EXPORTED])
    except ValueError as error:
        return _refused(path, str(error), root, faults)
    try:
        fixed = _exported(described.folder)
        baked = [key for key in start if key not in described.variables and key in fixed]
        start = {key: value for key, value in start.items() if key not in baked}
        _, wrong = start_values(described.description, described.variables, start)
    except CouplingError as error:
        return _refused(path, str(error), root, faults)
    finally:
        described.close()
    wrong |= {
        key: f"is fixed in the FMU, got {spec.parameters[key]!r}, expected {fixed[key]!r}"
        for key in baked
        if not _is_same(spec.parameters[key], fixed[key])
    }
    for key, what in wrong.items():
        where = (*path, "parameters", key)
        place = root.place_of_key(where) if what.startswith("no such") else root.place(where)
        faults.append(Fault(place, f"{dotted(where)}: {what}", where))
    if wrong:
        return None
    notes = _notes(spec, resources, "resources cannot enter an FMU")
    return takes.record(**{**_fields(made), "start": start}), notes


def _fields(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass as they are."""
    return dict(vars(record))


def _refused(path: KeyPath, what: str, root: Node, faults: list[Fault]) -> None:
    where = (*path, "use")
    faults.append(Fault(root.place(where), f"{dotted(where)}: {what}", where))


def _notes(spec: ComponentSpec, ignored: list[str], why: str) -> tuple[str, ...]:
    return tuple(f"component {spec.name}: parameter {key!r} is ignored, {why}" for key in ignored)


def _is_reference(value: object) -> bool:
    return isinstance(value, str) and value.startswith("${") and value.endswith("}")


def _exported(folder: Path) -> Mapping[str, Any]:
    """Return the parameters with which our exporter made the component in an FMU."""
    try:
        return dict(json.loads((folder / EXPORTED).read_text())["parameters"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _is_same(given: object, fixed: object) -> bool:
    """Return whether a parameter is what it was at the export; files have been renamed there."""
    if isinstance(given, str) and isinstance(fixed, str):
        return given == fixed or Path(given).name == Path(fixed).name
    return bool(given == fixed)
