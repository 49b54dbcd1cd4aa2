"""The variables of an FMU, in flat buffers: what its XML, its C header and its worker share."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from orchestrator.assembly.description import Port, ports

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

Role = Literal["set", "field", "latency_s", "seed", "time", "get"]

FMI2 = {"Float64": "Real", "Float32": "Real", "Enumeration": "Enumeration", "Boolean": "Boolean",
        "String": "String"}  # fmt: skip
"""FMI 3 type to FMI 2 type; all others are Integer."""


@dataclass(frozen=True, eq=False)
class Row:
    """One variable, scalar or array.

    Attributes
    ----------
    role : str
        Who takes it: the component's ``set``, a ``field`` of its parameters, its ``latency_s``, its
        ``seed``, the front end (``time``); or it is computed (``get``).
    type : str
        Of FMI 3.
    start : tuple
        Flat, row by row; empty for what is computed.
    depends_on : tuple of str or None
        Of an output: the inputs that act on it at the same instant; None if all do.
    first : int
        Its value reference; the first of ``span`` if it is an array in FMI 2.
    at : int
        Where it begins in its buffer, in elements.
    """

    name: str
    role: Role
    type: str
    causality: str
    variability: str
    initial: str | None = None
    shape: tuple[int, ...] = ()
    start: tuple[float | int | bool | str, ...] = ()
    description: str = ""
    unit: str | None = None
    display_unit: str | None = None
    declared_type: str | None = None
    min: float | None = None
    max: float | None = None
    nominal: str | None = None
    depends_on: tuple[str, ...] | None = None
    first: int = 0
    span: int = 1
    at: int = 0

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def buffer(self) -> str:
        """The buffer that holds it."""
        return {"Float64": "reals", "Float32": "reals", "String": "strings"}.get(
            self.type, "integers"
        )

    @property
    def is_settable(self) -> bool:
        """Whether it is in the first part of its buffer, which the front end owns."""
        return self.role != "get"

    @property
    def is_unknown(self) -> bool:
        """Whether it is computed during initialization and belongs to ``InitialUnknowns``."""
        calculated = self.initial in ("approx", "calculated")
        return self.causality == "calculatedParameter" or (
            self.causality == "output" and calculated
        )


def rows(
    description: "ModelDescription",
    parameters: object = None,
    *,
    fmi: int,
    latency_s: float | None = None,
    seed: int | None = None,
) -> list[Row]:
    """Return the variables of a component's FMU.

    Those of its description come first. Fields of its parameters that the description leaves out
    follow where they are texts or numbers, then ``latency_s`` and ``seed``; None takes none.

    Raises
    ------
    ValueError
        If a variable has a type that cannot be exported.
    """
    described = ports(str(description.modelName), description)
    known = {variable.name: variable for variable in description.modelVariables}
    for variable in known.values():
        if variable.type in ("Binary", "Clock"):
            raise ValueError(
                f"variable {variable.name!r}: cannot be exported, got type {variable.type}, "
                "expected a number, boolean, enumeration or string"
            )
    own = members(parameters)
    every = tuple(name for name, port in described.items() if port.causality == "input")
    found = [_row(known[name], port, own, every) for name, port in described.items()]
    if not any(row.role == "time" for row in found):
        name = _free("time", known)
        found.append(Row(name, "time", "Float64", "independent", "continuous", start=(0.0,)))
    for name, value in own.items():
        if name not in known and (row := _field(name, value)) is not None:
            found.append(row)
    if latency_s is not None and "latency_s" not in known:
        found.append(_parameter("latency_s", "latency_s", latency_s, "from inputs to outputs, s"))
    if seed is not None:
        number = str(seed) if fmi == 2 else seed  # an Integer of FMI 2 has 32 bits
        found.append(_parameter(_free("seed", known), "seed", number, "of all randomness"))
    return _placed(found, fmi)


def members(record: object) -> dict[str, Any]:
    """Return the values that make a parameter dataclass, by name; none of what is no dataclass."""
    if not is_dataclass(record) or isinstance(record, type):
        return {}
    return {one.name: getattr(record, one.name) for one in fields(record) if one.init}


def _free(name: str, known: Mapping[str, object]) -> str:
    return name if name not in known else _free(f"{name}_", known)


def _row(
    variable: "ModelVariable", port: Port, own: Mapping[str, Any], every: tuple[str, ...]
) -> Row:
    causality, declared = variable.causality, variable.declaredType
    role: Role = "get"
    if causality == "independent":
        role = "time"
    elif causality == "structuralParameter" or (
        causality == "parameter" and variable.variability == "fixed" and port.name in own
    ):
        role = "field"
    elif causality in ("input", "parameter") or (variable.initial == "exact"):
        role = "set"
    start = () if port.start is None else tuple(np.ravel(np.asarray(port.start, object)).tolist())
    return Row(
        name=port.name,
        role=role,
        type={"Real": "Float64", "Integer": "Int32"}.get(port.type, port.type),
        causality="parameter" if causality == "structuralParameter" else causality,
        variability=variable.variability,
        initial=variable.initial,
        shape=port.shape,
        start=(0.0,) if role == "time" else start if role != "get" else (),
        description=port.description,
        unit=variable.unit or (None if declared is None else declared.unit),
        display_unit=variable.displayUnit,
        declared_type=declared.name if declared is not None and declared.items else None,
        min=port.min,
        max=port.max,
        nominal=variable.nominal,
        depends_on=None if port.depends_on == frozenset(every) else tuple(
            name for name in every if name in port.depends_on
        ),
    )  # fmt: skip


def _field(name: str, value: object) -> Row | None:
    """Return the row of a parameter that the description leaves out; None if FMI has no type for it."""
    if isinstance(value, str | bool | int | float):
        return _parameter(name, "field", value, "")
    if not isinstance(value, tuple | list):
        return None
    try:
        array = np.array(value)
    except ValueError:
        return None  # ragged
    if array.dtype.kind not in "if" or not array.size:
        return None
    flat = tuple(array.ravel().tolist())
    return replace(_parameter(name, "field", flat[0], ""), shape=array.shape, start=flat)


def _parameter(name: str, role: Role, value: float | bool | str, meaning: str) -> Row:
    kinds: dict[type, str] = {bool: "Boolean", int: "Int64", str: "String"}
    kind = kinds.get(type(value), "Float64")
    return Row(name, role, kind, "parameter", "fixed", "exact", start=(value,), description=meaning)


def _placed(found: Iterable[Row], fmi: int) -> list[Row]:
    """Return the rows with value references and places in the buffers: settable ones first."""
    reference = 0
    numbered: list[Row] = []
    for row in sorted(found, key=lambda row: row.role != "time"):
        span = row.size if fmi == 2 else 1
        numbered.append(replace(row, first=reference, span=span))
        reference += span
    places: dict[str, int] = {}
    used = {"reals": 0, "integers": 0, "strings": 0}
    for row in sorted(numbered, key=lambda row: not row.is_settable):
        places[row.name] = used[row.buffer]
        used[row.buffer] += row.size
    return [replace(row, at=places[row.name]) for row in numbered]


def sizes(found: Iterable[Row]) -> dict[str, tuple[int, int]]:
    """Return the length of each buffer's settable part and of all of it."""
    counted = {"reals": (0, 0), "integers": (0, 0), "strings": (0, 0)}
    for row in found:
        settable, total = counted[row.buffer]
        counted[row.buffer] = (settable + row.size * row.is_settable, total + row.size)
    return counted
