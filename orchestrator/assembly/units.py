"""Units as FMI defines them: eight SI exponents, a factor and an offset."""

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from orchestrator.assembly.unit_names import BASES, read

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


@dataclass(frozen=True)
class Unit:
    """``SI value = factor * value + offset``; ``dimension`` holds the exponents of ``BASES``.

    A dimension of None belongs to a unit whose description gives no base unit.
    """

    name: str
    dimension: tuple[int, ...] | None = (0,) * 8
    factor: float = 1.0
    offset: float = 0.0

    def __str__(self) -> str:
        if self.dimension is None:
            return f"{self.name!r} (no base unit)"
        parts = [
            base + ("" if exponent == 1 else str(exponent))
            for base, exponent in zip(BASES, self.dimension, strict=True)
            if exponent
        ]
        return f"{self.name!r} ({' '.join(parts) or 'dimensionless'})"


def units(description: "ModelDescription") -> dict[str, Unit]:
    """Return the units that a model description defines, by name.

    Where a component gives a name alone, it is read; what cannot be read is left out. A file's units
    (an FMU's) are what the file makes them: one without a base unit is of no known dimension.
    """
    is_file = any(variable.sourceline is not None for variable in description.modelVariables)
    defined: dict[str, Unit] = {}
    for unit in description.unitDefinitions:
        name, base = str(unit.name), unit.baseUnit
        if base is None and is_file:
            defined[name] = Unit(name, None)
        elif base is None:
            with suppress(ValueError):
                defined[name] = Unit(name, *read(name))
        else:
            dimension = tuple(int(getattr(base, symbol) or 0) for symbol in BASES)
            defined[name] = Unit(name, dimension, float(base.factor), float(base.offset))
    return defined


def conversion(source: Unit | None, target: Unit | None) -> tuple[float, float] | None:
    """Return ``(factor, offset)`` with ``target value = factor * source value + offset``.

    None where nothing needs to be converted: the units are equal, or one of the two is not given.

    Raises
    ------
    ValueError
        If the dimensions differ.

    Examples
    --------
    >>> degree = Unit("deg", (0, 0, 0, 0, 0, 0, 0, 1), 0.017453292519943295)
    >>> radian = Unit("rad", (0, 0, 0, 0, 0, 0, 0, 1))
    >>> conversion(degree, radian)
    (0.017453292519943295, 0.0)
    """
    if source is None or target is None or source == target:
        return None
    if source.dimension != target.dimension or source.dimension is None:
        raise ValueError(f"unit of another dimension, got {source}, expected {target}")
    factor = source.factor / target.factor
    offset = (source.offset - target.offset) / target.factor
    return None if factor == 1.0 and offset == 0.0 else (factor, offset)
