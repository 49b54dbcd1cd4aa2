"""Describe a component's variables once; FMPy's ``ModelDescription`` follows from the table."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

Causality = Literal["input", "output", "parameter", "local"]

SUFFIX_UNITS = {
    "_per_s": "1/s", "_m": "m", "_s": "s", "_kg": "kg", "_deg": "deg", "_rad": "rad",
    "_mps": "m/s", "_mps2": "m/s2", "_radps": "rad/s", "_hz": "Hz", "_G": "G",
}  # fmt: skip


@dataclass(frozen=True)
class Execution:
    """What FMI has no word for: when a component runs."""

    kind: Literal["continuous", "sampled"]
    rate_hz: float
    interface: int = 1


@dataclass(frozen=True)
class Variable:
    """One row: a scalar or an array of one unit.

    ``depends_on`` names the inputs (or groups of inputs) that act on an output at the same instant:
    its direct feed-through. ``items`` makes the variable an enumeration, numbered from 0.
    """

    name: str
    causality: Causality
    unit: str
    description: str
    start: float | int | bool | str = 0.0
    shape: tuple[int, ...] = ()
    variability: Literal["continuous", "discrete", "tunable", "fixed"] = "continuous"
    min: float | None = None
    max: float | None = None
    items: tuple[str, ...] = ()
    depends_on: tuple[str, ...] = ()

    @property
    def type(self) -> Any:
        """FMI 3 type name, from the start value."""
        if self.items:
            return "Enumeration"
        kinds: dict[type, str] = {bool: "Boolean", int: "Int64", str: "String"}
        return kinds.get(type(self.start), "Float64")


def parameter_variables(record: Any, tunable: Sequence[str] = ()) -> list[Variable]:
    """Return a row for every number and flag of a parameter dataclass; suffixes give the units.

    A string inside ``Annotated[...]`` is the field's meaning. Texts choose a structure, which the rest
    of the description shows; they are not variables.
    """
    hints = get_type_hints(type(record), include_extras=True)
    types = get_type_hints(type(record))
    rows: list[Variable] = []
    for field in fields(record):
        value = getattr(record, field.name)
        if not isinstance(value, bool | int | float):
            continue
        hint, type_ = hints[field.name], types[field.name]
        notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
        if float in (type_, *get_args(type_)):  # also of a union
            value = float(value)  # 10 is a float's value too
        unit = next((u for s, u in SUFFIX_UNITS.items() if field.name.endswith(s)), "1")
        rows.append(
            Variable(
                field.name,
                "parameter",
                unit,
                next((note for note in notes if isinstance(note, str)), ""),
                start=value,
                variability="tunable" if field.name in tunable else "fixed",
            )
        )
    return rows


def unknown(name: str, known: Iterable[str]) -> KeyError:
    """Return the error for a name that a component does not have, with the nearest that it has."""
    near = get_close_matches(name, list(known), n=1)
    hint = f", did you mean {near[0]!r}?" if near else ""
    return KeyError(f"unknown variable {name!r}{hint}")


def _check_names(rows: Sequence[Variable]) -> None:
    """Refuse names that are there twice, and dependencies that name no input."""
    names = [row.name for row in rows]
    inputs = [row.name for row in rows if row.causality == "input"]
    for i, row in enumerate(rows):
        if row.name in names[:i]:
            raise ValueError(f"variable {row.name!r}: described twice, expected once")
        for group in row.depends_on:
            if not any(_belongs(name, group) for name in inputs):
                near = get_close_matches(group, inputs, n=1)
                hint = f", did you mean {near[0]!r}" if near else ""
                what = f"depends_on: no input, got {group!r}{hint}"
                raise ValueError(f"variable {row.name!r}: {what}")


def _belongs(name: str, group: str) -> bool:
    return name == group or name.startswith((group + ".", group + "["))


def model_description(
    name: str, description: str, variables: Iterable[Variable], *, has_state: bool = False
) -> Any:
    """Return FMPy's ``ModelDescription`` (FMI 3.0 vocabulary) of a native component.

    Units are given by name alone.

    Raises
    ------
    ValueError
        If two variables have one name, or an output depends on what is no input.
    """
    from fmpy.model_description import (
        CoSimulation,
        Dimension,
        Item,
        ModelDescription,
        ModelVariable,
        SimpleType,
        Unit,
        Unknown,
    )

    rows = list(variables)
    _check_names(rows)
    time = ModelVariable(
        name="time",
        valueReference=0,
        type="Float64",
        shape=(),
        causality="independent",
        variability="continuous",
        description="simulated time",
        unit="s",
    )
    types: list[SimpleType] = []
    made: dict[str, ModelVariable] = {}
    for reference, row in enumerate(rows, start=1):
        declared = None
        if row.items:
            items = [Item(name=text, value=str(i)) for i, text in enumerate(row.items)]
            declared = SimpleType(name=f"{row.name} values", type="Enumeration", items=items)
            types.append(declared)
        discrete = row.type != "Float64" and row.variability == "continuous"
        start = str(row.start).lower() if isinstance(row.start, bool) else str(row.start)
        calculated = row.causality in ("output", "local")
        made[row.name] = ModelVariable(
            name=row.name,
            valueReference=reference,
            type=row.type,
            shape=row.shape,
            description=row.description,
            causality=row.causality,
            variability="discrete" if discrete else row.variability,
            initial="calculated" if calculated else "exact",
            start=None if calculated else start,
            unit=row.unit if row.type == "Float64" else None,
            min=None if row.min is None else str(row.min),
            max=None if row.max is None else str(row.max),
            declaredType=declared,
            dimensions=[Dimension(start=str(n), valueReference=None) for n in row.shape],  # pyright: ignore[reportArgumentType]
        )
    used = sorted({row.unit for row in rows if row.type == "Float64"} | {"s"})
    return ModelDescription(
        fmiVersion="3.0",
        modelName=name,
        description=description,
        instantiationToken=name,
        variableNamingConvention="structured",
        coSimulation=CoSimulation(
            modelIdentifier=name,
            canHandleVariableCommunicationStepSize=False,
            canGetAndSetFMUstate=has_state,
            canSerializeFMUstate=has_state,
        ),
        unitDefinitions=[Unit(name=unit) for unit in used if unit],  # read by whoever couples
        typeDefinitions=types,
        modelVariables=[time, *made.values()],
        outputs=[
            Unknown(
                variable=made[row.name],
                dependencies=[
                    made[other.name]
                    for other in rows
                    if other.causality == "input"
                    and any(_belongs(other.name, group) for group in row.depends_on)
                ],
            )
            for row in rows
            if row.causality == "output"
        ],
        initialUnknowns=[Unknown(variable=made[r.name]) for r in rows if r.causality == "output"],
    )
