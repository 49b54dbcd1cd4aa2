"""The variables of a helicopter: names, units, meanings, limits."""

from collections.abc import Mapping

from plant.rotorcraft import COMMANDS, STATES, Rotorcraft
from plant.variables import Variable

OUTCOMES = ("flying", "collision", "departed", "left_terrain")
AXES = ("north", "east", "down")
STATE = tuple(f"state.{name}" for name in STATES)
POSE = tuple(f"pose.{name}" for name in (*AXES, "phi", "theta", "psi"))
VELOCITY = tuple(f"velocity.{axis}" for axis in AXES)
ACTUATOR = tuple(f"actuator.{name}" for name in COMMANDS["actuator"])
OUTPUTS = (*STATE, *POSE, *VELOCITY, *ACTUATOR, "clearance", "load_factor", "outcome", "valid")
WIND = tuple(f"wind.{axis}" for axis in AXES)
_STATE_UNITS = (
    ("m",) * 3 + ("m/s",) * 3 + ("rad",) * 3 + ("rad/s",) * 3 + ("rad", "rad", "G", "rad", "rad")
)
_STATE_MEANINGS = (
    "position north", "position east", "position down", "velocity forward", "velocity right",
    "velocity down (body)", "roll", "pitch", "heading, unwrapped", "roll rate", "pitch rate",
    "yaw rate", "longitudinal flapping, aft positive", "lateral flapping, right positive",
    "main-rotor thrust", "stabiliser bar, longitudinal", "stabiliser bar, lateral",
)  # fmt: skip


def _unit(command: str) -> str:
    return "G" if command in ("thrust", "tail") else "rad"


def helicopter_variables(craft: Rotorcraft, command: Mapping[str, float]) -> list[Variable]:
    """Return the rows of a vehicle that starts under a command, by name."""
    p = craft.p
    limits = {
        "thrust": (p.thrust_min, p.thrust_max),
        "pitch": (-p.tilt_max, p.tilt_max),
        "roll": (-p.tilt_max, p.tilt_max),
        "tail": (-p.tail_max, p.tail_max),
    }
    return [
        *(
            Variable(f"command.{name}", "input", _unit(name), f"commanded {name}", start=value)
            for name, value in command.items()
        ),
        *(Variable(n, "input", "m/s", f"velocity of the air, {n[5:]}") for n in WIND),
        *(
            Variable(name, "output", unit, meaning)
            for name, unit, meaning in zip(STATE, _STATE_UNITS, _STATE_MEANINGS, strict=True)
        ),
        *(Variable(n, "output", "m", f"{n[5:]} of the body") for n in POSE[:3]),
        *(Variable(n, "output", "rad", f"{n[5:]} of the body") for n in POSE[3:]),
        *(Variable(n, "output", "m/s", f"velocity over ground, {n[9:]}") for n in VELOCITY),
        *(
            Variable(
                f"actuator.{name}", "output", _unit(name), "actuator after stabiliser and limits",
                min=low, max=high,
            )
            for name, (low, high) in limits.items()
        ),
        Variable("clearance", "output", "m", "altitude above the terrain below"),
        Variable("load_factor", "output", "G", "specific force along body up, in g"),
        Variable("outcome", "output", "1", "how the flight stands", start=0, items=OUTCOMES),
        Variable("valid", "output", "1", "the model is within its validity", start=True),
    ]  # fmt: skip
