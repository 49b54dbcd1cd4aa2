"""Keep a run in memory: every output over time, by name."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchestrator.assembly.clock import SECOND
from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.errors import nearest
from orchestrator.listener import Result


class Event(NamedTuple):
    """Something that happened at ``time_s``, s; kinds are those of ``Listener.event``."""

    time_s: float
    kind: str
    component: str
    message: str


class Trace:
    """A listener that collects outputs and events.

    ``trace["vehicle.state.u"]`` is ``(times_s, values)``: arrays of shape (K,) and (K, *shape), one
    row for every publishing.

    Attributes
    ----------
    names : tuple of str
        ``component.output`` of everything that is collected.
    events : list of Event
        In order of time.
    result : Result or None
        How the run ended, once it has.
    """

    wants_wall_clock = False

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.events: list[Event] = []
        self.result: Result | None = None
        self._rows: dict[str, list[tuple[int, Mapping[str, Value]]]] = {}

    def __getitem__(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.generic]]:
        """Return times, s, and values of an output."""
        if name not in self.names:
            raise KeyError(f"trace: no output {name!r}{nearest(name, self.names)}")
        component, _, variable = name.partition(".")
        rows = self._rows[component]
        times = np.array([time for time, _ in rows], np.int64) / SECOND
        return times, np.array([values[variable] for _, values in rows])

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def open(self, system: System) -> None:
        """Note what there is to collect."""
        self.names = tuple(
            str(port)
            for ports in system.ports.values()
            for port in ports.values()
            if port.causality == "output"
        )
        self._rows = {name: [] for name in system.ports}

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value]) -> None:
        """Keep a component's outputs."""
        self._rows[component].append((time_ns, values))

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value]) -> None:
        """Do nothing: inputs are their sources."""

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value]) -> None:
        """Do nothing: changes are among the events."""

    def event(self, time_ns: int, kind: str, component: str, message: str) -> None:
        """Keep an event."""
        self.events.append(Event(time_ns / SECOND, kind, component, message))

    def log(self, time_ns: int, level: int, name: str, message: str) -> None:
        """Do nothing."""

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float) -> None:
        """Do nothing: nothing measured is collected."""

    def close(self, result: Result) -> None:
        """Keep the result."""
        self.result = result
