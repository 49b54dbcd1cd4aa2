"""Model descriptions, read once into frozen ports: native components and FMUs look the same."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import isnan
from typing import TYPE_CHECKING, cast

import numpy as np

from orchestrator.assembly.unit_names import read
from orchestrator.assembly.units import Unit, units
from orchestrator.component import Value
from orchestrator.errors import CouplingError, nearest

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

# FMI 2 and 3 type name -> kind of value; only equal kinds can be connected
KINDS = {
    **dict.fromkeys(("Real", "Float32", "Float64"), "float"),
    **dict.fromkeys(("Integer", "Int8", "Int16", "Int32", "Int64"), "integer"),
    **dict.fromkeys(("UInt8", "UInt16", "UInt32", "UInt64"), "integer"),
    "Enumeration": "enumeration",
    "Boolean": "boolean",
    "String": "string",
    "Binary": "binary",
}
PYTHON = {"float": float, "boolean": bool, "string": str, "binary": bytes}  # all others: int


@dataclass(frozen=True, eq=False)
class Port:
    """One variable of one component.

    Attributes
    ----------
    causality : str
        ``input``, ``output``, ``parameter``, ``local``, ``independent``, ...
    shape : tuple of int
        ``()`` for a scalar.
    unit : Unit or None
        None where the description gives none.
    start : Value or None
        Of the declared shape, read-only; None where the component calculates it.
    items : mapping of int to str
        Text of each value of an enumeration; empty for every other type.
    depends_on : frozenset of str
        Of an output: the inputs that act on it at the same instant, its direct feed-through.
    """

    component: str
    name: str
    causality: str
    variability: str
    type: str
    shape: tuple[int, ...] = ()
    unit: Unit | None = None
    start: Value | None = None
    min: float | None = None
    max: float | None = None
    items: Mapping[int, str] = field(default_factory=dict[int, str])
    description: str = ""
    depends_on: frozenset[str] = frozenset()

    @property
    def kind(self) -> str:
        """``float``, ``integer``, ``enumeration``, ``boolean``, ``string`` or ``binary``."""
        return KINDS[self.type]

    @property
    def unit_suffix(self) -> str:
        """What follows a value in a text: a space and the unit; nothing for a pure number."""
        return f" {self.unit.name}" if self.unit and self.unit.name != "1" else ""

    def __str__(self) -> str:
        return f"{self.component}.{self.name}"


def ports(component: str, description: "ModelDescription") -> dict[str, Port]:
    """Return the variables of a component, in the order of its description.

    Clocks, which cannot be coupled, are left out. An output that the model structure does not list
    may depend on every input.

    Raises
    ------
    CouplingError
        If the description is not valid; the message lists everything found.
    """
    from fmpy.validation import validate_model_description

    try:
        problems = [
            problem.replace(" (line None)", "").rstrip(".")
            for problem in validate_model_description(description)
        ]
    except Exception as error:  # of a description that lacks even what FMPy takes for granted
        what = f"it cannot be read, {type(error).__name__}: {error}"
        raise CouplingError(_invalid(component, [what])) from error
    problems += _misnamed(description)
    if problems:
        raise CouplingError(_invalid(component, problems))
    defined = units(description)
    inputs = frozenset(v.name for v in description.modelVariables if v.causality == "input")
    # FMI: no list of dependencies means all inputs, an empty list means none
    through = {v.name: inputs for v in description.modelVariables if v.causality == "output"}
    through |= {
        unknown.variable.name: inputs
        if unknown.dependencies is None
        else inputs.intersection(v.name for v in unknown.dependencies)
        for unknown in description.outputs
        if unknown.variable is not None
    }
    through |= {  # FMI 3 lists no aliases
        v.name: through[v.alias.name]
        for v in description.modelVariables
        if v.alias is not None and v.causality == "output"
    }
    made: dict[str, Port] = {}
    for variable in description.modelVariables:
        if variable.type not in KINDS:
            continue
        try:
            made[variable.name] = _port(component, variable, defined, through)
        except ValueError as error:
            problems.append(f"variable {variable.name!r}: {error}")
    if problems:
        raise CouplingError(_invalid(component, problems))
    return made


def _misnamed(description: "ModelDescription") -> list[str]:
    """Return what is wrong with the names in the list of outputs."""
    known = [variable.name for variable in description.modelVariables]
    seen: set[str] = set()
    problems: list[str] = []
    for unknown in description.outputs:
        if unknown.variable is None:
            continue
        name = unknown.variable.name
        if name in seen:
            problems.append(f"output {name!r} is listed twice, expected once")
        seen.add(name)
        for dependency in unknown.dependencies or ():
            if dependency.name not in known:
                near = nearest(dependency.name, known)
                problems.append(
                    f"output {name!r} depends on {dependency.name!r}, no variable{near}"
                )
    return problems


def members(ports: Mapping[str, Port], group: str) -> dict[str, Port]:
    """Return the ports ``group.member`` by member name, in their order; empty if no such group."""
    start = group + "."
    return {
        name.removeprefix(start): port for name, port in ports.items() if name.startswith(start)
    }


def mismatch(port: Port, value: object) -> str | None:
    """Return what keeps ``value`` from being a value of ``port``; None if it is one."""
    python = PYTHON.get(port.kind, int)
    if port.shape:
        if not isinstance(value, np.ndarray):
            return f"not an array, got {type(value).__name__}, expected shape {port.shape}"
        if value.shape != port.shape:
            return f"wrong shape, got {value.shape}, expected {port.shape}"
        dtype = np.dtype({"string": np.str_, "binary": object}.get(port.kind, python))
        if value.dtype.kind != dtype.kind or (dtype.kind in "if" and value.dtype != dtype):
            return f"wrong type, got {value.dtype}, expected {dtype}"
        return None
    if not isinstance(value, python) or (python is int and isinstance(value, bool)):
        return f"wrong type, got {type(value).__name__}, expected {python.__name__}"
    if port.items and value not in port.items:
        return f"not an item, got {value}, expected {' or '.join(map(str, port.items))}"
    return None


def plain(port: Port, value: object) -> object:
    """Return a number or numpy scalar as a value of a scalar port, where nothing is lost by that.

    An int or any numpy number for a float, numpy's integers and booleans for an integer and a
    boolean. Everything else, a bool for a number among it, is returned as it is.
    """
    if port.shape or isinstance(value, PYTHON.get(port.kind, int)):
        return value
    if port.kind == "float" and isinstance(value, int | np.integer | np.floating):
        try:
            number = float(value)
        except OverflowError:
            return value
        is_lost = number != value and not isnan(number)
        return value if is_lost or isinstance(value, bool) else number
    if port.kind in ("integer", "enumeration") and isinstance(value, np.integer):
        return int(value)
    return bool(value) if port.kind == "boolean" and isinstance(value, np.bool_) else value


def _invalid(component: str, problems: Iterable[str]) -> str:
    return f"component {component!r}: model description is not valid: {'; '.join(problems)}"


def _port(
    component: str,
    variable: "ModelVariable",
    defined: Mapping[str, Unit],
    through: Mapping[str, frozenset[str]],
) -> Port:
    declared = variable.declaredType
    unit = variable.unit or (declared.unit if declared is not None else None)
    shape = tuple(
        int(size.variable.start if size.variable is not None else size.start)  # pyright: ignore[reportArgumentType]
        for size in variable.dimensions
    )
    items = declared.items if declared is not None else []
    kind = KINDS[variable.type]
    return Port(
        component=component,
        name=variable.name,
        causality=variable.causality,
        variability=variable.variability,
        type=variable.type,
        shape=shape,
        unit=None if unit is None else defined.get(unit) or Unit(unit, *read(unit)),
        start=None if variable.start is None else _start(kind, variable.start, shape),
        min=_number(variable.min),
        max=_number(variable.max),
        items={int(str(item.value)): str(item.name) for item in items},
        description=variable.description or "",
        depends_on=through.get(variable.name, frozenset()),
    )


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)


def _boolean(text: str) -> bool:
    if text not in ("true", "false", "1", "0"):
        raise ValueError(f"start value is not a boolean, got {text!r}, expected 'true' or 'false'")
    return text in ("true", "1")


def _start(kind: str, text: object, shape: tuple[int, ...]) -> Value:
    """Parse a start value; a single one fills an array."""
    parse: Callable[[str], Value] = {
        "float": float,
        "boolean": _boolean,
        "string": str,
        "binary": bytes.fromhex,
    }.get(kind, int)
    if not shape:
        return parse(str(text))
    texts = cast(list[str], text) if isinstance(text, list) else str(text).split()
    values = np.array([parse(one) for one in texts], object if kind == "binary" else None)
    if values.size not in (1, int(np.prod(shape))):
        raise ValueError(
            f"wrong number of start values, got {values.size}, expected 1 or {int(np.prod(shape))}"
        )
    array = np.full(shape, values[0]) if values.size == 1 else values.reshape(shape)
    array.flags.writeable = False
    return array
