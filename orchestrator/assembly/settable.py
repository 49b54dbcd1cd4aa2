"""What may be changed from outside while a system runs, and to which values."""

import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, cast, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from orchestrator.assembly.description import PYTHON, Port, mismatch
from orchestrator.assembly.plan import Plan
from orchestrator.component import Value
from orchestrator.errors import nearest
from orchestrator.run.ranges import excess
from orchestrator.scenario.wording import expected, show

EXPECTED = {
    "float": "a number",
    "boolean": "true or false",
    "string": "text",
    "binary": "hexadecimal text",
}  # all others: a whole number
INTEGERS = {"Integer": "int32"}  # all others: as numpy calls them, in small letters


def tunables(ports: Mapping[str, Mapping[str, Port]]) -> dict[str, Port]:
    """Return the tunable parameters of all components by full name."""
    return {
        str(port): port
        for own in ports.values()
        for port in own.values()
        if port.causality == "parameter" and port.variability == "tunable" and port.kind != "binary"
    }


def bounds(plans: Iterable[Plan]) -> dict[str, Any]:
    """Return by full name what the fields of components' parameter dataclasses must be."""
    found: dict[str, Any] = {}
    for plan in plans:
        if plan.path[0] == "components" and "parameters" in plan.arguments:
            record = type(plan.arguments["parameters"])
            hints = get_type_hints(record, include_extras=True)
            found |= {f"{plan.path[1]}.{name}": hint for name, hint in hints.items()}
    return found


def accepted(port: Port, raw: object, bounds: Mapping[str, Any]) -> Value:
    """Return what a scenario or a viewer asks for as a value of an input or tunable parameter.

    Raises
    ------
    ValueError
        If it has another type or is out of bounds: those of the description, and those of the
        field of the component's parameters that has its name.
    """
    value = parsed(port, raw)
    if port.kind in ("float", "integer"):
        if np.any(np.isnan(value)):  # pyright: ignore[reportArgumentType]
            raise ValueError(f"not a number, got {value}, expected {_expected(port)}")
        low = -np.inf if port.min is None else port.min
        high = np.inf if port.max is None else port.max
        array = np.asarray(value)
        if not np.all((array >= low) & (array <= high)):
            raise ValueError(excess(port, value))
    if str(port) in bounds and port.causality == "parameter" and not port.shape:
        adapter = TypeAdapter(bounds[str(port)])
        try:
            adapter.validate_python(value)
        except ValidationError as error:
            schema = adapter.json_schema()
            wanted = expected(schema, schema, port.name)
            raise ValueError(
                f"out of range, got {value}{port.unit_suffix}, expected {wanted}"
            ) from error
    return value


def parsed(port: Port, raw: object) -> Value:
    """Return a number, text or list of a scenario as a value of ``port``.

    An integer does for a float, an item's text for an enumeration, hexadecimal digits for bytes.

    Raises
    ------
    ValueError
        If it is not of the port's type and shape, or beyond what the type holds.
    """
    if port.items and isinstance(raw, str):
        texts = {text: value for value, text in port.items.items()}
        if raw not in texts:
            near = nearest(raw, list(texts))
            raise ValueError(f"no such item, got {raw!r}, expected one of {list(texts)}{near}")
        return texts[raw]
    value = raw
    if port.shape and isinstance(raw, list):
        value = _elements(replace(port, shape=()), cast(list[object], raw))
    try:
        if port.kind == "float" and isinstance(raw, int) and not isinstance(raw, bool):
            value = float(raw)
        elif isinstance(value, list):
            value = np.array(value, object if port.kind == "binary" else None)
        elif port.kind == "binary" and isinstance(raw, str):
            value = bytes.fromhex(raw)
    except OverflowError:
        most = f"{_expected(port)} of at most {sys.float_info.max:.2g}"
        raise ValueError(f"out of range, got {show(raw)}, expected {most}") from None
    except ValueError:
        value = None
    wanted = np.ndarray if port.shape else PYTHON.get(port.kind, int)
    fault = mismatch(port, value)
    if fault is not None:
        is_other = not isinstance(value, wanted) or isinstance(value, bool)
        wrong = f"wrong type, got {show(raw)}, expected {_expected(port)}"
        raise ValueError(wrong if is_other else fault)
    if port.kind == "integer" and not port.shape:
        held = np.iinfo(INTEGERS.get(port.type, port.type.lower()))
        if not held.min <= cast(int, value) <= held.max:
            raise ValueError(excess(replace(port, min=held.min, max=held.max), cast(int, value)))
    return value  # pyright: ignore[reportReturnType]  (mismatch has checked it)


def _elements(port: Port, raw: list[object]) -> list[object]:
    """Return a list, or a list of lists, of values of a scalar port."""
    return [
        _elements(port, cast(list[object], one)) if isinstance(one, list) else parsed(port, one)
        for one in raw
    ]


def _expected(port: Port) -> str:
    words = EXPECTED.get(port.kind, "a whole number")
    if port.shape:
        return f"a list of shape {' x '.join(map(str, port.shape))}, each {words}"
    return words + (port.unit_suffix and f" in{port.unit_suffix}")
