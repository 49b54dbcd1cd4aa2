"""FMPy's model description of a component that is known by its ports alone."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from orchestrator.assembly.description import Port
from orchestrator.assembly.units import BASES, Unit
from orchestrator.component import Value

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

KEPT = ("input", "output", "parameter")


def describe(name: str, description: str, ports: Iterable[Port]) -> "ModelDescription":
    """Return the model description (FMI 3.0 vocabulary) of inputs, outputs and parameters.

    Enumerations keep their items, arrays their shape, outputs their direct feed-through.
    """
    import fmpy.model_description

    fmi: Any = fmpy.model_description  # its literals are ours as they stand

    kept = [port for port in ports if port.causality in KEPT]
    types = {
        port.name: fmi.SimpleType(
            name=f"{port.name} items",
            type="Enumeration",
            items=[fmi.Item(name=text, value=str(n)) for n, text in port.items.items()],
        )
        for port in kept
        if port.items
    }
    time = fmi.ModelVariable(
        name="time",
        valueReference=0,
        type="Float64",
        shape=(),
        causality="independent",
        variability="continuous",
    )
    made = {
        port.name: fmi.ModelVariable(
            name=port.name,
            valueReference=reference,
            type=port.type,
            shape=port.shape,
            description=port.description,
            causality=port.causality,
            variability=port.variability,
            initial="calculated" if port.causality == "output" else "exact",
            start=None if port.causality == "output" else _text(port.start),
            unit=None if port.unit is None else port.unit.name,
            min=None if port.min is None else repr(port.min),
            max=None if port.max is None else repr(port.max),
            declaredType=types.get(port.name),
            dimensions=[fmi.Dimension(start=str(n), valueReference=None) for n in port.shape],
            sourceline=0,  # from a file: its units are what it says
        )
        for reference, port in enumerate(kept, start=1)
    }
    outputs = [port for port in kept if port.causality == "output"]
    units = {port.unit.name: port.unit for port in kept if port.unit is not None}
    return fmi.ModelDescription(
        fmiVersion="3.0",
        modelName=name,
        description=description,
        instantiationToken=name,
        variableNamingConvention="structured",
        coSimulation=fmi.CoSimulation(
            modelIdentifier=name, canHandleVariableCommunicationStepSize=True
        ),
        unitDefinitions=[fmi.Unit(name=n, baseUnit=_base(fmi, unit)) for n, unit in units.items()],
        typeDefinitions=list(types.values()),
        modelVariables=[time, *made.values()],
        outputs=[
            fmi.Unknown(
                variable=made[port.name], dependencies=[made[n] for n in sorted(port.depends_on)]
            )
            for port in outputs
        ],
        initialUnknowns=[fmi.Unknown(variable=made[port.name]) for port in outputs],
    )


def _base(fmi: Any, unit: Unit) -> Any:
    if unit.dimension is None:
        return None
    exponents = dict(zip(BASES, unit.dimension, strict=True))
    return fmi.BaseUnit(**exponents, factor=unit.factor, offset=unit.offset)


def _text(value: Value | None) -> str | None:
    if isinstance(value, np.ndarray):
        return " ".join(str(one) for one in value.ravel().tolist())
    if isinstance(value, bool):
        return str(value).lower()
    return None if value is None else str(value)
