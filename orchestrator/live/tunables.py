"""What may be changed in flight, and to which values."""

from collections.abc import Mapping
from typing import Any, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from orchestrator.assembly.description import Port
from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.run.events import parsed
from orchestrator.run.ranges import excess


def tunables(system: System) -> dict[str, Port]:
    """Return the tunable parameters of all components by full name."""
    return {
        str(port): port
        for ports in system.ports.values()
        for port in ports.values()
        if port.causality == "parameter" and port.variability == "tunable" and port.kind != "binary"
    }


def bounds(system: System) -> dict[str, Any]:
    """Return by full name what the fields of components' parameter dataclasses must be."""
    found: dict[str, Any] = {}
    for plan in system.plans:
        if plan.path[0] == "components" and "parameters" in plan.arguments:
            record = type(plan.arguments["parameters"])
            hints = get_type_hints(record, include_extras=True)
            found |= {f"{plan.path[1]}.{name}": hint for name, hint in hints.items()}
    return found


def accepted(port: Port, raw: object, bounds: Mapping[str, Any]) -> Value:
    """Return what a viewer asks for as a value of a tunable parameter.

    Raises
    ------
    ValueError
        If it has another type or is out of bounds: those of the description, and those of the
        field of the component's parameters that has its name.
    """
    value = parsed(port, raw)
    if port.kind in ("float", "integer"):
        low = -np.inf if port.min is None else port.min
        high = np.inf if port.max is None else port.max
        array = np.asarray(value)
        if not np.all((array >= low) & (array <= high)):
            raise ValueError(excess(port, value))
    if str(port) in bounds and not port.shape:
        try:
            TypeAdapter(bounds[str(port)]).validate_python(value)
        except ValidationError as error:
            wanted = error.errors()[0]["msg"].removeprefix("Input should be ")
            unit = f" {port.unit.name}" if port.unit and port.unit.name != "1" else ""
            raise ValueError(f"out of range, got {value}{unit}, expected {wanted}") from error
    return value
