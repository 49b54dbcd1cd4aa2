"""Plan how variables travel: what one FMI call transfers, and where each value lies in it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING

from orchestrator.assembly.description import KINDS

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


@dataclass(frozen=True)
class Variable:
    """One variable of an FMU.

    Attributes
    ----------
    function : str
        The type in the names of the functions that get and set it: ``Real``, ``Int64``, ...
    kind : str
        As of a port: ``float``, ``integer``, ``enumeration``, ``boolean``, ``string``, ``binary``.
    references : tuple of int
        Value references: one, or one per element of an array that was gathered from scalars.
    clocks : tuple of int
        Value references of the clocks at whose ticks alone it may be set.
    """

    name: str
    function: str
    kind: str
    references: tuple[int, ...]
    shape: tuple[int, ...]
    causality: str
    variability: str
    initial: str | None
    clocks: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Number of values."""
        return prod(self.shape)

    @property
    def has_start(self) -> bool:
        """Whether FMI allows a start value to be given."""
        is_given = self.causality in ("input", "parameter") or self.initial in ("exact", "approx")
        return is_given and self.variability != "constant"


@dataclass(frozen=True)
class Block:
    """The values that one call gets or sets: scalars first, then arrays row by row."""

    function: str
    kind: str
    scalars: tuple[Variable, ...]
    arrays: tuple[Variable, ...]

    @property
    def variables(self) -> tuple[Variable, ...]:
        """All, in the order of the call."""
        return self.scalars + self.arrays

    @property
    def references(self) -> tuple[int, ...]:
        """Value references, in the order of the call."""
        return tuple(one for variable in self.variables for one in variable.references)

    @property
    def size(self) -> int:
        """Number of values."""
        return sum(variable.size for variable in self.variables)

    @property
    def starts(self) -> dict[str, int]:
        """Index of the first value of each array."""
        starts: dict[str, int] = {}
        at = len(self.scalars)
        for variable in self.arrays:
            starts[variable.name] = at
            at += variable.size
        return starts


def variables(
    description: "ModelDescription", elements: Mapping[str, Sequence[int]]
) -> dict[str, Variable]:
    """Return the variables of a description by name; clocks are left out.

    Parameters
    ----------
    elements : mapping
        Value references of the arrays that were gathered from scalars.
    """
    enumeration = "Integer" if description.fmiVersion == "2.0" else "Int64"
    return {
        one.name: Variable(
            one.name,
            enumeration if one.type == "Enumeration" else one.type,
            KINDS[one.type],
            tuple(elements.get(one.name, (one.valueReference,))),
            tuple(one.shape or ()),
            one.causality,
            one.variability,
            one.initial,
            tuple(clock.valueReference for clock in one.clocks or ()),  # pyright: ignore[reportAttributeAccessIssue]
        )
        for one in description.modelVariables
        if one.type in KINDS
    }


def blocks(variables: Iterable[Variable]) -> list[Block]:
    """Return what is transferred together, one block per type."""
    found: dict[str, list[Variable]] = {}
    for one in variables:
        # FMI 2: booleans and enumerations are ints in C, but only enumerations share a function
        found.setdefault(one.function, []).append(one)
    return [
        Block(
            function,
            listed[0].kind,
            tuple(one for one in listed if not one.shape),
            tuple(one for one in listed if one.shape),
        )
        for function, listed in found.items()
    ]
