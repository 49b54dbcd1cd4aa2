"""Where a flight starts: trimmed over the terrain, perturbed if asked."""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from plant.dynamics import body_from_ned, sincos
from plant.rotorcraft import COMMANDS, AirframeParameters, Rotorcraft
from plant.terrain import Terrain

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Perturbation:
    """What to add to the trimmed start."""

    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float = 0.0
    forward_mps: float = 0.0
    right_mps: float = 0.0
    up_mps: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    heading_deg: float = 0.0


@dataclass(frozen=True)
class HelicopterParameters(AirframeParameters):
    """Which helicopter, and where it starts."""

    speed_mps: Annotated[float, Ge(0), "speed at the start"] = 30.0
    north_m: Annotated[float, "start position"] = 0.0
    east_m: Annotated[float, "start position"] = 0.0
    heading_deg: Annotated[float, "heading at the start, from north to east"] = 0.0
    height_agl_m: Annotated[float, "height above ground at the start"] = 10.0
    slope_matched: Annotated[bool, "start along the slope of the ground rather than level"] = True
    perturbation: Annotated[Perturbation, "added to the trimmed start"] = Perturbation()


def starting_command(p: HelicopterParameters, craft: Rotorcraft) -> dict[str, float]:
    """Return the command that trims the helicopter at its start, by name."""
    values = craft.trim_command(craft.trim(p.speed_mps))
    command = dict(zip(COMMANDS[p.command], values.tolist(), strict=True))
    if "heading" in command:
        command["heading"] += math.radians(p.heading_deg)
    return command


def starting_state(p: HelicopterParameters, craft: Rotorcraft, terrain: Terrain | None) -> Floats:
    """Return the common state, (17,), at the start.

    Without a terrain the ground is at elevation 0.

    Raises
    ------
    ValueError
        If the start is outside the terrain or below ground.
    """
    delta, heading = p.perturbation, math.radians(p.heading_deg)
    north, east = p.north_m + delta.north_m, p.east_m + delta.east_m
    ground = climb = 0.0
    if terrain is not None:
        ground = float(terrain.elevation(north, east))
        if p.slope_matched:
            h_n, h_e = terrain.slope(north, east)
            climb = math.atan(float(h_n) * math.cos(heading) + float(h_e) * math.sin(heading))
    height = p.height_agl_m + delta.up_m
    if height <= 0:
        raise ValueError(
            f"height_agl_m: start below ground, got height {height:g} m, expected above 0 m"
        )
    state = np.array(craft.trim(p.speed_mps).state)
    state[:3] = north, east, -(ground + height)
    state[6] += math.radians(delta.roll_deg)
    state[7] += math.radians(delta.pitch_deg)
    state[8] = heading + math.radians(delta.heading_deg)
    ahead = (  # velocity in axes along the course
        p.speed_mps * math.cos(climb) + delta.forward_mps,
        delta.right_mps,
        -p.speed_mps * math.sin(climb) - delta.up_mps,
    )
    turn = math.radians(delta.heading_deg)
    state[3:6] = body_from_ned(ahead, (*sincos(state[6]), *sincos(state[7]), *sincos(turn)))
    return state
