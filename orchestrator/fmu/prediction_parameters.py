"""Which FMU a controller predicts with, what its variables mean, and what follows from that."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from orchestrator.component import Value
from orchestrator.fmu.description import preferred_rate
from orchestrator.fmu.fmu import Described
from orchestrator.fmu.roles import ACTUATORS, GROUPS, Group, Roles, Source
from orchestrator.fmu.start import start_values

Floats = NDArray[np.float64]
OPEN = (-math.inf, math.inf)


@dataclass(frozen=True)
class FmuModelParameters:
    """Which FMU, and what its variables mean; the defaults fit our own vehicle exported as C."""

    file: Annotated[Path, "the FMU, or the folder of an unpacked one"]
    start: Annotated[Mapping[str, Any], "start values by variable"] = field(
        default_factory=dict[str, Any]
    )
    state: Annotated[str, "group of variables that publish the state"] = GROUPS["state"]
    settable: Annotated[
        str, "group that takes a measured state; where there is none a shadow flies along"
    ] = GROUPS["settable"]
    restart: Annotated[str, "flag that makes a step start from it, if one is needed"] = "restart"
    command: Annotated[str, "group of the commands"] = GROUPS["command"]
    velocity: Annotated[str, "group of the velocity over ground"] = GROUPS["velocity"]
    actuator: Annotated[str, "group of the actuators that act in a step"] = GROUPS["actuator"]
    wind: Annotated[str, "group of the velocity of the air"] = GROUPS["wind"]
    bias: Annotated[str, "group of the unmodelled acceleration"] = GROUPS["bias"]
    valid: Annotated[str, "flag that says whether the model is valid"] = "valid"
    names: Annotated[
        Mapping[str, str | Source], "variables that are called otherwise, by part: state.down, ..."
    ] = field(default_factory=dict[str, str | Source])
    states: Annotated[tuple[str, ...], "states in order; as the FMU has the group, if empty"] = ()
    commands: Annotated[
        tuple[str, ...], "commands in order; as the FMU has the group, if empty"
    ] = ()
    set_point_limit_deg: Annotated[float, Gt(0), "of pitch and roll set-points"] = 50.0
    trim_altitude_m: Annotated[float, "where level flight is sought, out of ground effect"] = 1e5
    sample_period_s: Annotated[
        Annotated[float, Gt(0)] | None, "over which a command is held; as the FMU says if null"
    ] = None
    derivatives: Annotated[
        bool, "identify by the FMU's directional derivatives instead of by perturbed rollouts"
    ] = False
    processes: Annotated[int, Ge(1), "processes that share the trajectories"] = 1


class Limits(NamedTuple):
    """Of commands and actuators, (4,) each; infinite where there are none."""

    command_min: Floats
    command_max: Floats
    actuator_min: Floats
    actuator_max: Floats


def sample_period(described: Described, p: FmuModelParameters) -> float:
    """Return the sample period, s.

    Raises
    ------
    ValueError
        If neither the parameters nor the FMU say one.
    """
    if p.sample_period_s is not None:
        return p.sample_period_s
    rate = preferred_rate(described.description, described.annotation, is_scheduled=False)
    if rate is None:
        raise ValueError(f"sample_period_s: {described.name} says none, expected a number")
    return 1.0 / rate


def start_of(described: Described, p: FmuModelParameters) -> dict[str, Value]:
    """Return the start values.

    Raises
    ------
    ValueError
        If one does not fit.
    """
    values, wrong = start_values(described.description, described.variables, p.start)
    for name, what in wrong.items():
        raise ValueError(f"start: {name}: {what}")
    return values


def check_abilities(described: Described, roles: Roles, p: FmuModelParameters) -> None:
    """Refuse an FMU that cannot do what a prediction needs.

    Raises
    ------
    ValueError
    """
    can, name = described.interface, described.name
    if described.is_scheduled:
        raise ValueError(f"file: {name}: is for scheduled execution, expected co-simulation")
    if not can.canGetAndSetFMUstate:
        raise ValueError(f"file: {name}: its state cannot be saved, expected an FMU whose can")
    if not roles.settable.names and not can.canSerializeFMUstate:
        raise ValueError(
            f"settable: {name} takes no measured state and its own cannot be serialised, "
            "expected the one or the other"
        )
    if p.derivatives and not (can.providesDirectionalDerivative and roles.settable.names):
        raise ValueError(
            f"derivatives: {name} gives none by a state that can be set, "
            "expected 'derivatives: false'"
        )
    if not roles.actuator.names and roles.command.names != ACTUATORS:
        raise ValueError(
            f"actuator: not in {name}, got commands {', '.join(roles.command.names)}, "
            f"expected a group of {', '.join(ACTUATORS)}"
        )


def limits(described: Described, roles: Roles, p: FmuModelParameters) -> Limits:
    """Return the limits that the FMU declares.

    A command without any has those of the actuator of its name, but set-points of pitch and roll
    those of the parameters.
    """
    declared = {one.name: one for one in described.description.modelVariables}

    def of(group: Group) -> dict[str, tuple[float, float]]:
        found: dict[str, tuple[float, float]] = {}
        for name, variable, factor in zip(*group, strict=True):
            one = declared[variable.name]
            low = -math.inf if one.min is None else float(one.min)
            high = math.inf if one.max is None else float(one.max)
            found[name] = min(factor * low, factor * high), max(factor * low, factor * high)
        return found

    commands = of(roles.command)
    actuators = of(roles.actuator) if roles.actuator.names else commands
    usual = dict(actuators)
    if "heading" in commands:
        tilt = float(np.radians(p.set_point_limit_deg))
        usual |= {"pitch": (-tilt, tilt), "roll": (-tilt, tilt), "heading": OPEN}
    chosen = [usual[name] if both == OPEN else both for name, both in commands.items()]
    return Limits(*np.transpose(chosen), *np.transpose([actuators[name] for name in ACTUATORS]))
