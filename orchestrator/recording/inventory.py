"""What the components of a recorded system were: every port, as plain data and back."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from orchestrator.assembly.description import Port
from orchestrator.assembly.system import System
from orchestrator.assembly.units import Unit
from orchestrator.component import INTERFACE, Value

INVENTORY = "components.json"  # name of the attachment


@dataclass(frozen=True)
class Recorded:
    """One component of a recorded system.

    Attributes
    ----------
    kind, rate_hz, interface
        Its execution as it ran.
    ports : mapping
        Every variable by name: outputs, inputs, parameters.
    """

    kind: Literal["continuous", "sampled"]
    rate_hz: float
    ports: Mapping[str, Port]
    interface: int = INTERFACE


def inventory(system: System) -> dict[str, Any]:
    """Return a system's components as plain data."""
    return {
        name: {
            "kind": instance.component.execution.kind,
            "rate_hz": 1e9 / system.schedule.period_ns[name],
            "variables": [_plain(port) for port in system.ports[name].values()],
        }
        for name, instance in system.instances.items()
    }


def recorded(component: str, plain: Mapping[str, Any]) -> Recorded:
    """Return one component's entry of :func:`inventory` as a record."""
    ports = (_port(component, each) for each in plain["variables"])
    return Recorded(plain["kind"], plain["rate_hz"], {port.name: port for port in ports})


def _plain(port: Port) -> dict[str, Any]:
    """Return a port as plain data; what is not said is left out."""
    entries = asdict(port) | {"depends_on": sorted(port.depends_on)}
    del entries["component"]
    if isinstance(port.start, np.ndarray):
        entries["start"] = port.start.tolist()
    elif isinstance(port.start, bytes):
        entries["start"] = port.start.hex()
    return {key: value for key, value in entries.items() if value not in (None, "", (), {}, [])}


def _port(component: str, plain: Mapping[str, Any]) -> Port:
    unit = plain.get("unit")
    if unit is not None:
        unit = Unit(**unit | {"dimension": unit["dimension"] and tuple(unit["dimension"])})
    shape = tuple(plain.get("shape", ()))
    return Port(
        component=component,
        name=plain["name"],
        causality=plain["causality"],
        variability=plain["variability"],
        type=plain["type"],
        shape=shape,
        unit=unit,
        start=_start(plain.get("start"), plain["type"], shape),
        min=plain.get("min"),
        max=plain.get("max"),
        items={int(value): text for value, text in plain.get("items", {}).items()},
        description=plain.get("description", ""),
        depends_on=frozenset(plain.get("depends_on", ())),
    )


def _start(plain: Any, kind: str, shape: tuple[int, ...]) -> Value | None:
    if kind == "Binary" and plain is not None:
        return bytes.fromhex(plain)
    if not shape or plain is None:
        return plain
    array = np.array(plain).reshape(shape)
    array.flags.writeable = False
    return array
