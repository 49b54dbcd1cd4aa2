"""Which variables of an FMU play which part in a prediction, found by the names in the parameters.

A part is called ``state.down``, ``command.thrust``, ``settable.u``, ``velocity.north``,
``actuator.tail``, ``wind.east``, ``bias.down``, ``restart`` or ``valid``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

from orchestrator.errors import nearest
from orchestrator.fmu.variables import Variable

if TYPE_CHECKING:
    from orchestrator.fmu.prediction_parameters import FmuModelParameters

RIGID = ("north", "east", "down", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")
"""The states that every prediction begins with: position, body velocity, Euler angles, body rates."""
ACTUATORS = ("thrust", "pitch", "roll", "tail")
FORMS = (ACTUATORS, (*ACTUATORS[:3], "heading"))
AXES = ("north", "east", "down")
FLOATS = ("Real", "Float64")
GROUPS = {
    "state": "state",
    "command": "command",
    "settable": "measured",
    "velocity": "velocity",
    "actuator": "applied",
    "wind": "wind",
    "bias": "bias",
}
"""Groups, and what our own vehicle calls them."""
FLAGS = ("restart", "valid")


@dataclass(frozen=True)
class Source:
    """A variable of an FMU; ``factor`` times its value is the controller's."""

    variable: Annotated[str, "name in the FMU"]
    factor: Annotated[float, "from the FMU's value to the controller's"] = 1.0


class Group(NamedTuple):
    """Variables of one kind by the controller's names, with their factors."""

    names: tuple[str, ...] = ()
    variables: tuple[Variable, ...] = ()
    factors: tuple[float, ...] = ()


def joined(*groups: Group) -> Group:
    """Return groups as one."""
    return Group(*(sum(parts, ()) for parts in zip(*groups, strict=True)))


@dataclass(frozen=True)
class Roles:
    """Every part, found; what an FMU does not offer is empty or None."""

    state: Group
    command: Group
    settable: Group
    velocity: Group
    actuator: Group
    wind: Group
    bias: Group
    restart: Variable | None
    valid: Variable | None

    @property
    def is_live(self) -> bool:
        """Whether a measured state may be set between steps, and not by initializing anew."""
        return all(map(_is_live, self.settable.variables))


def find_roles(have: Mapping[str, Variable], given: "FmuModelParameters") -> Roles:
    """Return the roles of an FMU's variables.

    Raises
    ------
    ValueError
        In one line that begins with the parameter's name: a name that the FMU does not have (with
        the nearest one), a group of which something is missing, a variable that cannot play its part.
    """
    states = given.states or _members(have, given.state) or RIGID
    commands = given.commands or _members(have, given.command) or FORMS[1]
    if states[: len(RIGID)] != RIGID:
        raise ValueError(
            f"states: wrong names, got {', '.join(states)}, expected first {', '.join(RIGID)}"
        )
    if commands not in FORMS:
        forms = " or ".join(", ".join(form) for form in FORMS)
        raise ValueError(f"commands: wrong names, got {', '.join(commands)}, expected {forms}")
    parts = {
        "state": states, "command": commands, "settable": states, "velocity": AXES,
        "actuator": ACTUATORS, "wind": AXES, "bias": AXES,
    }  # fmt: skip
    _check_names(have, given.names, [f"{group}.{name}" for group in parts for name in parts[group]])
    groups = {group: _group(have, given, group, names) for group, names in parts.items()}
    restart, valid = (_flag(have, given, name) for name in FLAGS)
    roles = Roles(**groups, restart=restart, valid=valid)
    if roles.restart is not None and not _is_live(roles.restart):
        raise ValueError(
            f"restart: cannot be set, got {roles.restart.causality}, expected an input"
        )
    for one in roles.settable.variables:
        if not (one.has_start or _is_live(one)):
            raise ValueError(
                f"settable: {one.name} cannot be set, got {one.causality}, "
                "expected an input, a parameter or a start value"
            )
    return roles


def _check_names(
    have: Mapping[str, Variable], names: Mapping[str, str | Source], parts: list[str]
) -> None:
    for key, source in names.items():
        if key not in (*parts, *FLAGS):
            near = nearest(key, parts) or ", expected one as 'state.down' or 'command.thrust'"
            raise ValueError(f"names: no such part, got {key!r}{near}")
        own = _source(source)
        if own.variable not in have:
            near = nearest(own.variable, list(have))
            raise ValueError(f"names: {key}: not in the FMU, got {own.variable!r}{near}")
        if own.factor == 0.0:
            raise ValueError(f"names: {key}: wrong factor, got 0, expected another number")


def _group(
    have: Mapping[str, Variable], given: "FmuModelParameters", group: str, members: Sequence[str]
) -> Group:
    """Return a group: all of it, or nothing where it may be missing."""
    own = getattr(given, group)
    wanted = {
        name: _source(given.names.get(f"{group}.{name}", f"{own}.{name}")) for name in members
    }
    found = {name: source for name, source in wanted.items() if source.variable in have}
    is_usual = own in ("", GROUPS[group]) and group not in ("state", "command")
    if not found and is_usual:
        return Group()
    for name in RIGID if group == "settable" else members:  # what is hidden may stay as it is
        if name not in found:
            near = nearest(wanted[name].variable, list(have))
            raise ValueError(f"{group}: not in the FMU, got {wanted[name].variable!r}{near}")
    variables = tuple(have[source.variable] for source in found.values())
    for one in variables:
        if one.function not in FLOATS or one.shape:
            what = f"{one.function}{list(one.shape) or ''}"
            raise ValueError(f"{group}: wrong type of {one.name!r}, got {what}, expected a float")
        if group in ("command", "wind", "bias") and not _is_live(one):
            what = f"got {one.causality}, expected an input"
            raise ValueError(f"{group}: {one.name!r} cannot be set between steps, {what}")
    return Group(tuple(found), variables, tuple(source.factor for source in found.values()))


def _flag(have: Mapping[str, Variable], given: "FmuModelParameters", name: str) -> Variable | None:
    own = _source(given.names.get(name, getattr(given, name))).variable
    if own not in have:
        if own in ("", name):
            return None
        raise ValueError(f"{name}: not in the FMU, got {own!r}{nearest(own, list(have))}")
    if have[own].kind != "boolean" or have[own].shape:
        raise ValueError(f"{name}: wrong type of {own!r}, got {have[own].kind}, expected boolean")
    return have[own]


def _members(have: Mapping[str, Variable], group: str) -> tuple[str, ...]:
    start = f"{group}."
    return tuple(name.removeprefix(start) for name in have if name.startswith(start))


def _source(given: str | Source) -> Source:
    return Source(given) if isinstance(given, str) else given


def _is_live(variable: Variable) -> bool:
    """Whether it may be set between steps."""
    is_tunable = variable.causality == "parameter" and variable.variability == "tunable"
    return variable.causality == "input" or is_tunable
