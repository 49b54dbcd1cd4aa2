"""Gather scalars named ``u[1]``, ``u[1,2]`` into arrays, as FMI 2 cannot say arrays itself."""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable, Unknown

ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>\d+(?:\s*,\s*\d+)*)\]")
ALIKE = ("type", "causality", "variability", "initial", "unit", "declaredType")

Elements = Mapping[str, Sequence[int]]


def gathered(description: "ModelDescription") -> tuple["ModelDescription", Elements]:
    """Return the description with arrays, and the value references of every array's elements.

    An array needs elements from 1 on, none missing, alike in all but start value; what is not so
    stays scalar. Elements are in row-major order.
    """
    from attrs import evolve

    found: dict[str, dict[tuple[int, ...], ModelVariable]] = {}
    for variable in description.modelVariables:
        if (match := ELEMENT.fullmatch(variable.name)) and not variable.dimensions:
            index = tuple(int(one) for one in match["index"].split(","))
            found.setdefault(match["name"], {})[index] = variable
    taken = {variable.name for variable in description.modelVariables}
    arrays: dict[int, ModelVariable] = {}  # by id of an element
    elements: dict[str, Sequence[int]] = {}
    for name, parts in found.items():
        shape = tuple(max(index[i] for index in parts) for i in range(len(next(iter(parts)))))
        if name in taken or not _is_complete(parts, shape):
            continue
        ordered = [parts[i] for i in product(*(range(1, n + 1) for n in shape))]
        array = _array(name, shape, ordered)
        elements[name] = [one.valueReference for one in ordered]
        arrays |= {id(one): array for one in ordered}

    def unknowns(listed: Iterable["Unknown"]) -> "list[Unknown]":
        return _merged(listed, arrays)

    variables = dict.fromkeys(arrays.get(id(one), one) for one in description.modelVariables)
    whole = evolve(
        description,
        modelVariables=list(variables),
        outputs=unknowns(description.outputs),
        derivatives=unknowns(description.derivatives),
        initialUnknowns=unknowns(description.initialUnknowns),
    )
    for variable in whole.modelVariables:
        if variable.derivative is not None:
            variable.derivative = arrays.get(id(variable.derivative), variable.derivative)
    return whole, elements


def _is_complete(parts: Mapping[tuple[int, ...], "ModelVariable"], shape: tuple[int, ...]) -> bool:
    first = next(iter(parts.values()))
    count = 1
    for size in shape:
        count *= size
    return (
        len(parts) == count
        and all(len(index) == len(shape) and min(index) >= 1 for index in parts)
        and all(getattr(one, key) == getattr(first, key) for one in parts.values() for key in ALIKE)
    )


def _array(
    name: str, shape: tuple[int, ...], ordered: Sequence["ModelVariable"]
) -> "ModelVariable":
    from attrs import evolve
    from fmpy.model_description import Dimension

    first = ordered[0]
    starts: list[Any] = [one.start for one in ordered]
    same = {
        key: getattr(first, key) if len({getattr(one, key) for one in ordered}) == 1 else None
        for key in ("min", "max", "nominal", "description")
    }
    return evolve(
        first,
        name=name,
        shape=shape,
        dimensions=[Dimension(start=str(size), valueReference=None) for size in shape],  # pyright: ignore[reportArgumentType]
        start=None if None in starts else starts,
        **same,
    )


def _merged(listed: Iterable["Unknown"], arrays: Mapping[int, "ModelVariable"]) -> "list[Unknown]":
    """Return one entry per array, which depends on what any of its elements depends on."""
    from fmpy.model_description import Unknown

    merged: dict[int, Unknown] = {}
    for one in listed:
        assert one.variable is not None
        variable = arrays.get(id(one.variable), one.variable)
        needs = one.dependencies
        if needs is not None:
            needs = list(dict.fromkeys(arrays.get(id(need), need) for need in needs))
        entry = merged.setdefault(id(variable), Unknown(variable=variable, dependencies=[]))
        if needs is None or entry.dependencies is None:
            entry.dependencies = None
        else:
            entry.dependencies = list(dict.fromkeys([*entry.dependencies, *needs]))
    return list(merged.values())
