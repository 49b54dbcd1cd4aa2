"""Read an FMU's model description: FMPy does, and here what it leaves out is added.

FMPy 0.3 does not read how clocks tick, limits of unsigned integers, arrays of texts, vendor
annotations, FMI 3's spelling of ``providesDirectionalDerivatives``, nor step sizes as numbers.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from orchestrator.assembly.clock import is_multiple
from orchestrator.fmu.archive import DESCRIPTION

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

Kind = Literal["continuous", "sampled"]
TOOL = "hedgehop"  # name of our vendor annotation
_CLOCK: Mapping[str, Callable[[str], float]] = {
    "intervalDecimal": float,
    "shiftDecimal": float,
    "priority": int,
    "intervalCounter": int,
    "resolution": int,
    "shiftCounter": int,
}


@dataclass(frozen=True)
class Annotation:
    """What our own exporter says about a component, beyond FMI."""

    kind: Kind = "continuous"
    rate_hz: float | None = None
    arrays: bool = False


def read(
    folder: Path, name: str, *, validate: bool = True, scheduled: bool = False
) -> tuple["ModelDescription", bool]:
    """Return the description in an unpacked FMU, and whether it is for scheduled execution.

    Parameters
    ----------
    name : str
        How messages call the FMU.
    validate : bool
        Refuse what breaks the standard. Otherwise the commonest slips are mended.
    scheduled : bool
        Prefer scheduled execution where co-simulation is offered as well.

    Raises
    ------
    ValueError
        In one line, if it cannot be read, is not valid, is of FMI 1.0, or offers neither
        co-simulation nor scheduled execution.
    """
    from fmpy.model_description import CoSimulation, ValidationError, read_model_description
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

    file = folder / DESCRIPTION
    try:
        root: Any = etree.parse(file).getroot()
    except (etree.XMLSyntaxError, OSError) as error:
        raise ValueError(f"{name}: {DESCRIPTION} is broken, {_line(error)}") from error
    _check_version(root, name)
    try:
        description = read_model_description(str(file), validate=validate)
    except ValidationError as error:
        problems = [" ".join(str(one).split()).rstrip(".") for one in error.problems]
        others = f", and {len(problems) - 1} more" if len(problems) > 1 else ""
        hint = ", expected a valid one or 'validate: false' under 'fmu'"
        raise ValueError(
            f"{name}: {DESCRIPTION} is not valid, {problems[0]}{others}{hint}"
        ) from error
    except Exception as error:  # FMPy: whatever a missing or wrong attribute leads to
        raise ValueError(f"{name}: {DESCRIPTION} cannot be read, {_line(error)}") from error
    try:
        _complete(description, root)
    except (ValueError, KeyError) as error:
        raise ValueError(f"{name}: {DESCRIPTION} cannot be read, {_line(error)}") from error
    if not validate:
        _mend(description)
    found = description.scheduledExecution
    is_scheduled = found is not None and (scheduled or description.coSimulation is None)
    if found is not None and is_scheduled:
        # whether states can be saved is asked of coSimulation, as native components have only that
        description.coSimulation = CoSimulation(
            modelIdentifier=found.modelIdentifier,
            canGetAndSetFMUstate=found.canGetAndSetFMUstate,
            canSerializeFMUstate=found.canSerializeFMUstate,
        )
    elif description.coSimulation is None:
        raise ValueError(
            f"{name}: FMI {description.fmiVersion} ModelExchange only, expected CoSimulation; "
            "export it for co-simulation, which brings its own solver"
        )
    return description, is_scheduled


def annotation(folder: Path) -> Annotation | None:
    """Return our exporter's annotation of an unpacked FMU; None if it is somebody else's."""
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

    root: Any = etree.parse(folder / DESCRIPTION).getroot()
    found = root.find(f"VendorAnnotations/Tool[@name='{TOOL}']/Execution")
    if found is None:
        found = root.find(f"Annotations/Annotation[@type='{TOOL}']/Execution")
    if found is None:
        return None
    rate = found.get("rate_hz")
    return Annotation(
        "sampled" if found.get("kind") == "sampled" else "continuous",
        None if rate is None else float(rate),
        found.get("arrays") == "true",
    )


def preferred_rate(
    description: "ModelDescription", annotation: Annotation | None, *, is_scheduled: bool
) -> float | None:
    """Return the rate that an FMU asks for, Hz; None if it asks for none.

    In this order: our annotation, its fastest periodic clock (where clocks are served), the step
    size of its default experiment if that is whole internal steps, its internal step size.
    """
    if annotation is not None and annotation.rate_hz is not None:
        return annotation.rate_hz
    steps: list[float] = []
    co_simulation = description.coSimulation
    if is_scheduled or (co_simulation is not None and co_simulation.hasEventMode):
        steps += sorted(t for t in map(interval, description.modelVariables) if t)[:1]
    experiment = description.defaultExperiment
    step = positive(experiment.stepSize) if experiment else None
    internal = None if co_simulation is None else co_simulation.fixedInternalStepSize
    if step is not None and (internal is None or is_multiple(step, internal)):
        steps.append(step)
    if internal is not None:
        steps.append(internal)
    return _rate(steps[0]) if steps else None


def interval(variable: "ModelVariable") -> float | None:
    """Return the declared interval of a clock, s; None of everything else."""
    if variable.type != "Clock":
        return None
    if variable.intervalCounter and variable.resolution:
        return variable.intervalCounter / variable.resolution
    return positive(variable.intervalDecimal)


def positive(text: object) -> float | None:
    """Return a number above 0, else None."""
    value = float(str(text)) if text is not None else 0.0
    return value if 0.0 < value < float("inf") else None


def _rate(step: float) -> float:
    """Return the rate of a step size as it is written in decimals.

    >>> _rate(0.003), _rate(0.1)
    (333.3333333333333, 10.0)
    """
    from fractions import Fraction

    return float(1 / Fraction(str(step)))


def _check_version(root: Any, name: str) -> None:
    version = root.get("fmiVersion")
    if root.tag != "fmiModelDescription" or version is None:
        raise ValueError(f"{name}: {DESCRIPTION} is broken, got no fmiModelDescription")
    if version == "1.0":
        raise ValueError(f"{name}: FMI 1.0 is not supported, expected FMI 2.0 or 3.0")
    if version != "2.0" and not version.startswith("3."):
        raise ValueError(f"{name}: unknown FMI version, got {version!r}, expected '2.0' or '3.0'")


def _complete(description: "ModelDescription", root: Any) -> None:
    """Add what FMPy leaves out."""
    cs, element = description.coSimulation, root.find("CoSimulation")
    if cs is not None:
        cs.fixedInternalStepSize = positive(cs.fixedInternalStepSize)
        flag = element.get("providesDirectionalDerivatives")
        cs.providesDirectionalDerivative |= flag in ("true", "1")
    if not description.fmiVersion or not description.fmiVersion.startswith("3."):
        return
    elements = {one.get("name"): one for one in root.find("ModelVariables").iterchildren("*")}
    for variable in description.modelVariables:
        own = elements[(variable.alias or variable).name]
        if variable.type == "Clock":
            for key, number in _CLOCK.items():
                if own.get(key) is not None:
                    setattr(variable, key, number(own.get(key)))
        elif variable.type.startswith("UInt"):
            variable.min, variable.max = own.get("min"), own.get("max")
        elif variable.type in ("String", "Binary") and variable.dimensions:
            starts: Any = [one.get("value") for one in own.findall("Start")]
            variable.start = starts or None


def _mend(description: "ModelDescription") -> None:
    """Mend what careless exporters write and simulations do not depend on."""
    for variable in description.modelVariables:
        if variable.variability == "continuous" and variable.type not in (
            "Real",
            "Float32",
            "Float64",
        ):
            variable.variability = "discrete"
        if variable.initial == "calculated" or variable.causality == "independent":
            variable.start = None
        if variable.start is None and variable.causality in ("input", "parameter"):
            variable.start = {"Boolean": "false", "String": "", "Binary": ""}.get(
                variable.type, "0"
            )


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
