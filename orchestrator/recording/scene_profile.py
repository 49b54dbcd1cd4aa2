"""A flight in a few numbers, for plots: where the craft is and where it should be, heights up."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, hypot
from typing import Any

import numpy as np
from google.protobuf.message import Message

from orchestrator.assembly.description import Port
from orchestrator.assembly.units import Unit
from orchestrator.recording.descriptors import descriptors, message_class
from orchestrator.recording.roles import Look
from orchestrator.recording.wire import Instant, Layout, WireField, layout

UNITS = {
    "altitude": "m",
    "heading": "deg",
    "ground": "m",
    "speed": "m/s",
    "reference_altitude": "m",
    "reference_heading": "deg",
    "reference_speed": "m/s",
}


@dataclass(frozen=True)
class Profile:
    """The message, the unit of each of its fields, and its layout."""

    message: type[Message]
    units: Mapping[str, str]
    layout: Layout


def profile(look: Mapping[str, Look]) -> Profile:
    """Return what can be told of the roles; of the reference, where it is nearest to the craft."""
    pose = look["pose"]
    clearance, velocity, reference = (look.get(k) for k in ("clearance", "velocity", "reference"))
    known = {"altitude", "heading"} | ({"ground"} if clearance else set[str]())
    known |= {"speed"} if velocity else set[str]()
    known |= {name for name in UNITS if name.startswith("reference") and reference}
    units = {name: unit for name, unit in UNITS.items() if name in known}
    plain = layout([WireField(k, name, "double") for k, name in enumerate(units, start=2)])

    def computed(_: Instant, values: Any) -> list[float]:
        north, east, down, _phi, _theta, psi = pose(values)
        told = {"altitude": -down, "heading": degrees(psi)}
        if clearance:
            told["ground"] = -down - clearance(values)[0]
        if velocity:
            told["speed"] = hypot(*velocity(values))
        if reference:
            n, e, altitude, heading, speed = reference(values)
            near = int(np.argmin(np.square(n - north) + np.square(e - east)))
            told["reference_altitude"] = float(altitude[near])
            told["reference_heading"] = degrees(heading[near])
            told["reference_speed"] = float(speed[near])
        return [told[name] for name in units]

    ports = [Port("", n, "output", "continuous", "Float64", unit=Unit(u)) for n, u in units.items()]
    data = descriptors("hedgehop", "Profile", list(units), ports)
    laid_out = Layout(plain.pieces, computed=computed)
    return Profile(message_class("hedgehop.Profile", data), units, laid_out)
