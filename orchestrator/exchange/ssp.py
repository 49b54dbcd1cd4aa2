"""A scenario as an SSP archive, and an SSP archive as a scenario.

Out: every component is in the archive as an FMI 2 FMU, its arrays as scalars ``u[1]``. In: rates,
policies, delays and events are those that Hedgehop wrote, else what the FMUs and the archive say.
"""

import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any, cast

from orchestrator.assembly.build import build
from orchestrator.assembly.description import Port
from orchestrator.assembly.discovery import find_file
from orchestrator.assembly.system import Link, System
from orchestrator.assembly.units import Unit, conversion
from orchestrator.exchange import ssd
from orchestrator.exchange.structure import (
    Connection,
    Connector,
    Element,
    Parameter,
    Structure,
    Type,
)
from orchestrator.scenario.load import installed, load
from orchestrator.scenario.records import ComponentSpec, Scenario
from orchestrator.scenario.yaml_source import dump

TYPES: dict[str, Type] = {
    "float": "Real",
    "integer": "Integer",
    "boolean": "Boolean",
    "string": "String",
    "enumeration": "Integer",  # FMI 2 passes the number; libcosim knows no other form
}
_INDEXED = re.compile(r"(.+)\[(\d+(?:,\d+)*)\]")
_NOTED = ("title", "settle_s", "seed", "events", "scene", "end_on", "recording")


def export_ssp(path: Path, out: Path, overrides: Sequence[str] = ()) -> list[str]:
    """Write a scenario as an SSP 1.0 archive; return what masters may take otherwise.

    Raises
    ------
    ScenarioError
        If the scenario is not valid.
    ValueError
        If a component cannot be exported, or is an FMU of FMI 3.
    """
    from orchestrator.export.export import choose, export
    from orchestrator.export.package import archived

    scenario = load(path, overrides)
    system = build(scenario)
    members: dict[str, bytes] = {}
    try:
        with TemporaryDirectory() as folder:
            for spec in scenario.components:
                fmu = _fmu(spec, scenario)
                if fmu is None:
                    fmu = Path(folder) / f"{spec.name}.fmu"
                    export(choose(spec.name, path, overrides), fmu, fmi=2)
                members[_source(spec)] = fmu.read_bytes()
    finally:
        for instance in system.instances.values():
            instance.terminate()
    members |= ssd.write(structure_of(system))
    archived(out, members)
    return list(_warnings(system))


def structure_of(system: System) -> Structure:
    """Return a system's structure; its components' FMUs are in ``resources/``."""
    scenario, schedule = system.scenario, system.schedule
    linked = {port for link in system.links for port in (link.source, link.target)}
    units: dict[str, Unit] = {}
    elements: list[Element] = []
    for spec in scenario.components:
        connectors: list[Connector] = []
        for port in (p for p in system.ports[spec.name].values() if p in linked):
            unit = port.unit if port.kind == "float" else None
            if unit is not None:
                units[unit.name] = unit
            kind = "output" if port.causality == "output" else "input"
            name = "" if unit is None else unit.name
            connectors += [Connector(one, kind, TYPES[port.kind], name) for one in _scalars(port)]
        elements.append(
            Element(
                name=spec.name,
                source=_source(spec),
                connectors=tuple(connectors),
                parameters=tuple(_parameters(spec, system.ports[spec.name])),
                notes=_notes(spec),
                step_s=schedule.period_ns[spec.name] / 1e9,
            )
        )
    plain = asdict(scenario)
    notes = {key: plain[key] for key in _NOTED}
    notes["scene"] = {k: v for k, v in scenario.scene.items() if not v.startswith("$")}
    return Structure(
        name=scenario.title,
        elements=tuple(elements),
        connections=tuple(one for link in system.links for one in _connections(link)),
        units=tuple(units.values()),
        stop_s=schedule.end_ns / 1e9,
        step_s=schedule.base_ns / 1e9,
        notes=notes,
    )


def import_ssp(archive: Path, folder: Path, duration_s: float | None = None) -> Path:
    """Unpack an archive into a folder and write the scenario; return its file.

    Nothing of what is in the archive is run.

    Raises
    ------
    OSError
        If a file cannot be read or written.
    ValueError
        If it is no SSP 1.0 archive, or holds what a scenario cannot say, which is named.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            names = [n for n in opened.namelist() if n.endswith((".ssd", ".ssv"))]
            structure = ssd.read({name: opened.read(name) for name in names})
            sources = dict.fromkeys(element.source for element in structure.elements)
            for source in sources:
                _check_source(source, opened.namelist())
            plain = plain_scenario(structure, archive.stem, duration_s)
            for source in sources:
                target = folder / source
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(opened.read(source))
    except zipfile.BadZipFile as error:
        raise ValueError(f"{archive}: not a zip archive, expected an .ssp file") from error
    except ValueError as error:
        raise ValueError(f"{archive}: {error}") from error
    file = folder / f"{archive.stem}.yaml"
    file.write_text(dump(plain), encoding="utf-8")
    return file


def plain_scenario(
    structure: Structure, title: str, duration_s: float | None = None
) -> dict[str, Any]:
    """Return a structure as the plain data of a scenario file.

    Raises
    ------
    ValueError
        If it starts at another time than 0 or does not say how long it lasts.
    """
    if structure.start_s:
        raise ValueError(f"starts at {structure.start_s} s, expected 0 s")
    stop = structure.stop_s if duration_s is None else duration_s
    if stop is None:
        raise ValueError("DefaultExperiment: no stopTime, expected one, or --duration-s")
    names = _names(structure)
    whole, scalars = _merged(structure)
    components: dict[str, Any] = {}
    for element in structure.elements:
        entry: dict[str, Any] = {"use": element.source, **element.notes}
        if "rate_hz" not in entry and element.step_s:
            entry["rate_hz"] = 1.0 / element.step_s
        if element.parameters:
            entry["parameters"] = {each.name: each.value for each in element.parameters}
        if element.name in scalars:
            entry["fmu"] = {**entry.get("fmu", {}), "arrays": False}
        components[names[element.name]] = entry
    plain: dict[str, Any] = {"title": structure.name or title, "duration_s": stop, "settle_s": 0.0}
    plain |= structure.notes
    plain["components"] = components
    plain["connections"] = [_plain(each, names, structure) for each in whole]
    return plain


def _fmu(spec: ComponentSpec, scenario: Scenario) -> Path | None:
    """Return the file of a component that is an FMU already; None for others."""
    if not spec.use.endswith(".fmu"):
        return None
    from fmpy import read_model_description

    found = find_file(spec.use, (scenario.folder, Path(), installed()))
    assert found is not None  # it was built
    file = found[1]
    version = str(read_model_description(str(file), validate=False).fmiVersion)
    if not version.startswith("2"):
        raise ValueError(f"component {spec.name!r}: is FMI {version}, expected FMI 2, as SSP 1.0")
    return file


def _source(spec: ComponentSpec) -> str:
    return f"resources/{spec.name}.fmu"


def _notes(spec: ComponentSpec) -> dict[str, Any]:
    """Return what SSP has no word for, as far as it is not the default."""
    plain, default = asdict(spec), asdict(ComponentSpec("", ""))
    left = {"name", "use", "parameters"}
    return {k: v for k, v in plain.items() if k not in left and v != default[k]}


def _parameters(spec: ComponentSpec, ports: Mapping[str, Port]) -> Iterator[Parameter]:
    """Yield the start values that the scenario gives an FMU."""
    if not spec.use.endswith(".fmu"):
        return
    for name, value in spec.parameters.items():
        port = ports.get(name)
        if port is None or port.kind not in TYPES:
            continue
        values = value if isinstance(value, list) else [value]
        for scalar, one in zip(_scalars(port), cast(list[Any], values), strict=False):
            number = float(one) if port.kind == "float" else one
            yield Parameter(scalar, TYPES[port.kind], number)


def _scalars(port: Port) -> Iterator[str]:
    """Yield the names of a variable's scalars: ``u``, or ``u[1,1]``, ``u[1,2]``, ... by rows."""
    if not port.shape:
        yield port.name
        return
    for index in product(*(range(1, n + 1) for n in port.shape)):
        yield f"{port.name}[{','.join(map(str, index))}]"


def _connections(link: Link) -> Iterator[Connection]:
    notes = {"delay_s": link.delay_ns / 1e9} if link.delay_ns else {}
    for source, target in zip(_scalars(link.source), _scalars(link.target), strict=True):
        yield Connection(
            (link.source.component, source),
            (link.target.component, target),
            link.factor,
            link.offset,
            notes,
        )


def _warnings(system: System) -> Iterator[str]:
    """Yield what the masters at hand are known to take differently or not at all."""
    for link in system.links:
        if (link.factor, link.offset) != (1.0, 0.0):
            yield f"{link}: is transformed; masters differ in whether and when they do it"
        if link.delay_ns:
            yield f"{link}: is delayed; other masters do not know of it"
    for name, latency in system.schedule.latency_ns.items():
        if latency:
            yield f"{name}: has a latency; other masters do not know of it"
    for name, instance in system.instances.items():
        if instance.component.execution.kind == "sampled":
            yield f"{name}: is sampled; other masters take its outputs one step later"
    if system.scenario.events:
        yield "events: other masters do not know of them"


def _check_source(source: str, members: Sequence[str]) -> None:
    path = PurePosixPath(source)
    if path.suffix != ".fmu" or path.is_absolute() or ".." in path.parts or ":" in source:
        raise ValueError(f"component source: got {source!r}, expected an .fmu in the archive")
    if source not in members:
        raise ValueError(f"component source: not in the archive, got {source!r}")


def _names(structure: Structure) -> dict[str, str]:
    """Return the name of every element as a scenario may spell it."""
    names: dict[str, str] = {}
    for element in structure.elements:
        plain = (
            re.sub(r"\W+", "_", element.name, flags=re.ASCII).lstrip("0123456789") or "component"
        )
        while plain in names.values():
            plain += "_"
        names[element.name] = plain
    return names


def _merged(structure: Structure) -> tuple[list[Connection], set[str]]:
    """Return the connections, and the elements whose arrays are to stay scalars.

    What Hedgehop wrote connects whole arrays, one scalar at a time: those become one connection.
    """
    ends = [(each, (each.start, each.end)) for each in structure.connections]
    if not structure.notes:
        scalars = {e for _, sides in ends for e, name in sides if _INDEXED.fullmatch(name)}
        return [each for each, _ in ends], scalars
    whole: dict[tuple[tuple[str, str], ...], Connection] = {}
    for each, sides in ends:
        start, end = ((element, name.partition("[")[0]) for element, name in sides)
        whole.setdefault((start, end), replace(each, start=start, end=end))
    return list(whole.values()), set()


def _plain(
    each: Connection, names: Mapping[str, str], structure: Structure
) -> str | dict[str, Any]:
    """Return a connection as a scenario writes it."""
    start = f"{names[each.start[0]]}.{each.start[1]}"
    end = f"{names[each.end[0]]}.{each.end[1]}"
    notes = {key: value for key, value in each.notes.items() if key != "is_final"}
    factor, offset = each.factor, each.offset
    if (factor, offset) == (1.0, 0.0) and not notes:
        return f"{start} -> {end}"
    if (factor, offset) != (1.0, 0.0):
        if not each.notes.get("is_final"):  # the units are to be converted after it
            further = conversion(*(_unit(structure, side) for side in (each.start, each.end)))
            scale, shift = further or (1.0, 0.0)
            factor, offset = scale * factor, scale * offset + shift
        notes |= {"factor": factor, "offset": offset}
    return {"from": start, "to": end, **notes}


def _unit(structure: Structure, side: tuple[str, str]) -> Unit | None:
    """Return the unit of a connector, or an array of them, if it and its definition are given."""
    name, connector = side
    given = [
        each.unit
        for element in structure.elements
        if element.name == name
        for each in element.connectors
        if each.name in (connector, f"{connector}[1]", f"{connector}[1,1]")
    ]
    return next((unit for unit in structure.units if unit.name in given), None)
