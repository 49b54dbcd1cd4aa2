"""A system structure as frozen records, in SSP's words: what both directions exchange."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from orchestrator.assembly.units import Unit

Kind = Literal["input", "output", "inout", "parameter", "calculatedParameter"]
Type = Literal["Real", "Integer", "Boolean", "String", "Enumeration"]


@dataclass(frozen=True)
class Connector:
    """A scalar variable of an element that can be connected."""

    name: str
    kind: Kind
    type: Type = "Real"
    unit: str = ""


@dataclass(frozen=True)
class Parameter:
    """A value that an element starts from."""

    name: str
    type: Type
    value: float | int | bool | str


@dataclass(frozen=True)
class Element:
    """A component: an FMU by its path in the archive, its connectors and start values.

    ``notes`` is what SSP has no word for; see ``ssp.py``. ``step_s`` is the communication step that
    it asks for, None where it does not.
    """

    name: str
    source: str
    connectors: tuple[Connector, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    notes: Mapping[str, Any] = field(default_factory=dict[str, Any])
    step_s: float | None = None


@dataclass(frozen=True)
class Connection:
    """``end = factor * start + offset``; both ends are (element, connector)."""

    start: tuple[str, str]
    end: tuple[str, str]
    factor: float = 1.0
    offset: float = 0.0
    notes: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class Structure:
    """A whole system of components, one level deep."""

    name: str
    elements: tuple[Element, ...]
    connections: tuple[Connection, ...]
    units: tuple[Unit, ...] = ()
    start_s: float = 0.0
    stop_s: float | None = None
    step_s: float | None = None
    notes: Mapping[str, Any] = field(default_factory=dict[str, Any])
