"""Start values of an FMU, as a scenario writes them: numbers, texts, lists, values with units."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from orchestrator.assembly.description import Port, ports
from orchestrator.assembly.settable import parsed
from orchestrator.assembly.units import Unit, conversion, units
from orchestrator.component import Value
from orchestrator.errors import nearest
from orchestrator.fmu.variables import Variable

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


def start_values(
    description: "ModelDescription",
    variables: Mapping[str, Variable],
    given: Mapping[str, Any],
) -> tuple[dict[str, Value], dict[str, str]]:
    """Return the values of what is given, and what is wrong with the others, by name.

    A value is in the variable's own unit, or ``{value: 90, unit: deg}`` in any unit of the same
    dimension that the FMU defines, display units included.

    Raises
    ------
    CouplingError
        If the description itself is not valid.
    """
    values: dict[str, Value] = {}
    wrong: dict[str, str] = {}
    if not given:
        return values, wrong
    own = ports("fmu", description)
    defined = {**_display_units(description), **units(description)}
    known = [name for name, one in variables.items() if one.has_start]
    for name, raw in given.items():
        if name not in own:
            near = nearest(name, known) or f", expected one of {known}"
            wrong[name] = f"no such variable in the FMU, got {name!r}{near}"
        elif own[name].causality == "structuralParameter":
            wrong[name] = f"structural, its value {own[name].start} is fixed"
        elif not variables[name].has_start:
            wrong[name] = f"takes no start value, got {own[name].causality}"
        else:
            try:
                values[name] = _value(own[name], raw, defined)
            except ValueError as error:
                wrong[name] = str(error)
    return values, wrong


def _value(port: Port, raw: object, defined: Mapping[str, Unit]) -> Value:
    if not isinstance(raw, Mapping):
        return parsed(port, raw)
    if set(raw) != {"value", "unit"}:
        raise ValueError(f"wrong keys, got {sorted(map(str, raw))}, expected 'value' and 'unit'")
    value, name = parsed(port, raw["value"]), str(raw["unit"])
    if port.unit is None or port.kind != "float":
        raise ValueError(f"has no unit, got {name!r}")
    if name not in defined:
        near = nearest(name, list(defined)) or f", expected one of {list(defined)}"
        raise ValueError(f"unknown unit, got {name!r}{near}")
    factor, offset = conversion(defined[name], port.unit) or (1.0, 0.0)
    return value * factor + offset  # pyright: ignore[reportOperatorIssue, reportReturnType]


def _display_units(description: "ModelDescription") -> dict[str, Unit]:
    """Return the display units that name no unit of their own; ``display = factor * unit + offset``."""
    found: dict[str, Unit] = {}
    for unit in units(description).values():
        listed = next(one for one in description.unitDefinitions if one.name == unit.name)
        for one in listed.displayUnits:
            factor, offset = float(one.factor), float(one.offset)
            found[str(one.name)] = Unit(
                str(one.name),
                unit.dimension,
                unit.factor / factor,
                unit.offset - unit.factor * offset / factor,
            )
    return found
