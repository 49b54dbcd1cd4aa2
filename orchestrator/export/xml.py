"""The modelDescription.xml of an FMU, for FMI 2.0 and 3.0."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from orchestrator.assembly.units import BASES, units
from orchestrator.component import Execution
from orchestrator.export.rows import FMI2, Row

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

CATEGORIES = {
    "logStatusOK": "what the component logs",
    "logStatusWarning": "what may be wrong",
    "logStatusDiscard": "why a step was refused",
    "logStatusError": "why a call failed",
    "logStatusFatal": "why the instance is lost",
}


@dataclass(frozen=True)
class Abilities:
    """What an FMU's back end can do, as capability flags say it."""

    variable_step: bool
    state: bool
    directional: bool
    needs_tool: bool


def model_description_xml(
    description: "ModelDescription",
    found: Sequence[Row],
    *,
    fmi: int,
    identifier: str,
    token: str,
    tool: str,
    abilities: Abilities,
    execution: Execution,
    sources: Sequence[str],
) -> bytes:
    """Return the XML; equal arguments give equal bytes."""
    if fmi == 2:  # FMI 2 needs no independent variable, and masters' parsers stumble over it
        found = [row for row in found if row.role != "time"]
    names = {"fmiVersion": f"{fmi}.0", "modelName": str(description.modelName)}
    names["guid" if fmi == 2 else "instantiationToken"] = token
    if description.description:
        names["description"] = description.description
    names["generationTool"] = tool
    names["variableNamingConvention"] = description.variableNamingConvention or "flat"
    root = Element("fmiModelDescription", names)
    element = SubElement(root, "CoSimulation", _capabilities(fmi, identifier, abilities))
    if fmi == 2:
        files = SubElement(element, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)
    _units(root, description)
    _types(root, description, {row.declared_type for row in found}, fmi)
    categories = SubElement(root, "LogCategories")
    for name, meaning in CATEGORIES.items():
        SubElement(categories, "Category", name=name, description=meaning)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=_text(1.0 / execution.rate_hz))
    if fmi == 2:
        tool_element = SubElement(SubElement(root, "VendorAnnotations"), "Tool", name="hedgehop")
        _execution(tool_element, execution, arrays=any(row.shape for row in found))
    variables = SubElement(root, "ModelVariables")
    for row in found:
        _variable_2(variables, row) if fmi == 2 else _variable_3(variables, row)
    _structure(root, found, fmi)
    if fmi == 3:
        annotation = SubElement(SubElement(root, "Annotations"), "Annotation", type="hedgehop")
        _execution(annotation, execution, arrays=False)
    indent(root)
    return tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _capabilities(fmi: int, identifier: str, abilities: Abilities) -> dict[str, str]:
    state, directional = ("state", "Derivative") if fmi == 2 else ("State", "Derivatives")
    flags = {
        "needsExecutionTool": abilities.needs_tool,
        "canHandleVariableCommunicationStepSize": abilities.variable_step,
        f"canGetAndSetFMU{state}": abilities.state,
        f"canSerializeFMU{state}": abilities.state,
        f"providesDirectional{directional}": abilities.directional,
    }
    if fmi == 2:
        flags["canNotUseMemoryManagementFunctions"] = True
    return {"modelIdentifier": identifier} | {key: _text(flag) for key, flag in flags.items()}


def _execution(parent: Element, execution: Execution, *, arrays: bool) -> None:
    """Say what FMI has no word for; Hedgehop's importer reads it."""
    SubElement(
        parent,
        "Execution",
        kind=execution.kind,
        rate_hz=_text(float(execution.rate_hz)),
        interface=str(execution.interface),
        arrays=_text(arrays),
    )


def _units(root: Element, description: "ModelDescription") -> None:
    if not description.unitDefinitions:
        return
    section = SubElement(root, "UnitDefinitions")
    defined = units(description)
    for unit in description.unitDefinitions:
        element = SubElement(section, "Unit", name=str(unit.name))
        one = defined.get(str(unit.name))
        if one is not None and one.dimension is not None:
            base = {name: str(n) for name, n in zip(BASES, one.dimension, strict=True) if n}
            base |= {} if one.factor == 1.0 else {"factor": _text(one.factor)}
            base |= {"offset": _text(one.offset)} if one.offset else {}
            SubElement(element, "BaseUnit", base)
        for display in unit.displayUnits:
            factor, offset = float(display.factor or 1.0), float(display.offset or 0.0)
            SubElement(element, "DisplayUnit", name=str(display.name), factor=_text(factor),
                       offset=_text(offset))  # fmt: skip


def _types(root: Element, description: "ModelDescription", used: set[str | None], fmi: int) -> None:
    declared = [one for one in description.typeDefinitions if one.name in used]
    if not declared:
        return
    section = SubElement(root, "TypeDefinitions")
    for one in declared:
        name = str(one.name)
        if fmi == 2:
            element = SubElement(SubElement(section, "SimpleType", name=name), "Enumeration")
        else:
            element = SubElement(section, "EnumerationType", name=name)
        for item in one.items:
            words = {"name": str(item.name), "value": str(item.value)}
            if item.description:
                words["description"] = str(item.description)
            SubElement(element, "Item", words)


def _common(row: Row) -> dict[str, str]:
    words = {"description": row.description} if row.description else {}
    words |= {"causality": row.causality, "variability": row.variability}
    if row.initial and row.causality not in ("input", "independent"):
        words["initial"] = row.initial
    return words


def _details(row: Row) -> dict[str, str]:
    """Return the attributes that depend on the type, without the start."""
    words = {"declaredType": row.declared_type} if row.declared_type else {}
    if row.buffer == "reals":
        words |= {"unit": row.unit} if row.unit else {}
        words |= {"displayUnit": row.display_unit} if row.display_unit else {}
        words |= {"nominal": row.nominal} if row.nominal else {}
    for key, limit in (("min", row.min), ("max", row.max)):
        if limit is not None and row.type not in ("Boolean", "String"):
            words[key] = _text(limit if row.buffer == "reals" else int(limit))
    return words


def element_names(row: Row) -> Iterator[str]:
    """Yield the names of a row's elements in FMI 2: ``u[1]``, ``u[1,2]``; of a scalar its own."""
    if not row.shape:
        yield row.name
        return
    for index in product(*(range(1, length + 1) for length in row.shape)):
        yield f"{row.name}[{','.join(map(str, index))}]"


def _has_start(row: Row) -> bool:
    return row.is_settable and row.role != "time"


def _variable_2(parent: Element, row: Row) -> None:
    common, details = _common(row), _details(row)
    kind = FMI2.get(row.type, "Integer")
    for k, name in enumerate(element_names(row)):
        reference = {"name": name, "valueReference": str(row.first + k)}
        words = dict(details)
        if _has_start(row):
            words["start"] = _text(row.start[k])
            if kind == "Integer" and not -(2**31) <= int(row.start[k]) < 2**31:
                raise ValueError(
                    f"variable {name!r}: start beyond an Integer of FMI 2, got {row.start[k]}, "
                    "expected 32 bits, or fmi 3"
                )
        SubElement(SubElement(parent, "ScalarVariable", reference | common), kind, words)


def _variable_3(parent: Element, row: Row) -> None:
    words = {"name": row.name, "valueReference": str(row.first)} | _common(row) | _details(row)
    if _has_start(row) and row.type != "String":
        words["start"] = " ".join(_text(value) for value in row.start)
    element = SubElement(parent, row.type, words)
    for length in row.shape:
        SubElement(element, "Dimension", start=str(length))
    if _has_start(row) and row.type == "String":
        for value in row.start:
            SubElement(element, "Start", value=_text(value))


def _structure(root: Element, found: Sequence[Row], fmi: int) -> None:
    """List outputs with their direct feed-through, and what initialization computes.

    Left-out dependencies mean all inputs; those of an initial unknown are left to that.
    """
    structure = SubElement(root, "ModelStructure")
    places: dict[str, range] = {}
    end = 1
    for row in found:
        if fmi == 2:  # by position, from 1, of each element
            places[row.name] = range(end, end := end + row.size)
        else:
            places[row.name] = range(row.first, row.first + 1)
    key = "index" if fmi == 2 else "valueReference"
    for section, rows in (
        ("Outputs", [row for row in found if row.causality == "output"]),
        ("InitialUnknowns", [row for row in found if row.is_unknown]),
    ):
        tag = "Unknown" if fmi == 2 else section.removesuffix("s")
        parent = SubElement(structure, section) if fmi == 2 and rows else structure
        for row in rows:
            words: dict[str, str] = {}
            if section == "Outputs" and row.depends_on is not None:
                words["dependencies"] = " ".join(
                    str(place) for name in row.depends_on for place in places[name]
                )
            for place in places[row.name]:
                SubElement(parent, tag, {key: str(place)} | words)


def _text(value: object) -> str:
    """Return a value as XML Schema writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"
    return repr(value) if isinstance(value, float) else str(value)
