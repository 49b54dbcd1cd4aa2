"""A flight in a few numbers, for plots: where the craft is and where it should be, heights up."""

from collections.abc import Callable, Mapping
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

UNITS = {"altitude": "m", "heading": "deg", "ground": "m", "speed": "m/s"}


@dataclass(frozen=True)
class Numbers:
    """The message, the unit of each of its fields, and its layout."""

    message: type[Message]
    units: Mapping[str, str]
    layout: Layout


def profile(look: Mapping[str, Look]) -> Numbers:
    """Return where the craft is, as far as the roles tell."""
    pose, clearance, velocity = look["pose"], look.get("clearance"), look.get("velocity")
    names = ["altitude", "heading"]
    names += (["ground"] if clearance else []) + (["speed"] if velocity else [])

    def computed(_: Instant, values: Any) -> list[float]:
        _north, _east, down, _phi, _theta, psi = pose(values)
        told = [-down, degrees(psi)]
        if clearance:
            told.append(-down - clearance(values)[0])
        if velocity:
            told.append(hypot(*velocity(values)))
        return told

    return _numbers("Profile", names, computed)


def reference_profile(look: Mapping[str, Look]) -> Numbers:
    """Return where the craft should be: the reference where it is nearest to it."""
    pose, reference = look["pose"], look["reference"]

    def computed(_: Instant, values: Any) -> list[float]:
        north, east, *_rest = pose(values)
        n, e, altitude, heading, speed = reference(values)
        near = int(np.argmin(np.square(n - north) + np.square(e - east)))
        return [float(altitude[near]), degrees(heading[near]), float(speed[near])]

    return _numbers("Reference", ["altitude", "heading", "speed"], computed)


def _numbers(
    title: str, names: list[str], computed: Callable[[Instant, Any], list[float]]
) -> Numbers:
    """Return a message of numbers, computed in this order."""
    units = {name: UNITS[name] for name in names}
    plain = layout([WireField(k, name, "double") for k, name in enumerate(names, start=2)])
    ports = [Port("", n, "output", "continuous", "Float64", unit=Unit(u)) for n, u in units.items()]
    message = message_class(f"hedgehop.{title}", descriptors("hedgehop", title, names, ports))
    return Numbers(message, units, Layout(plain.pieces, computed=computed))
