"""Keep in memory what the figures of a flight need beside a trace: parameters, measured times."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.assembly.clock import SECOND
from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.figures.trace import Trace
from orchestrator.listener import Result


class Logbook:
    """A listener; the signals of a trace and the parameters by full name, ``logbook[name]``."""

    wants_wall_clock = True

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._parameters: dict[str, list[tuple[int, Value]]] = {}
        self._elapsed: dict[str, list[float]] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """``component.variable`` of every output and parameter."""
        return (*self._trace.names, *self._parameters)

    def __getitem__(self, name: str) -> tuple[NDArray[np.float64], NDArray[Any]]:
        """Return times, s, and values."""
        if name not in self._parameters:
            return self._trace[name]
        times, values = zip(*self._parameters[name], strict=True)
        return np.array(times, np.int64) / SECOND, np.array(values)

    @property
    def durations(self) -> dict[str, NDArray[np.float64]]:
        """Wall-clock duration of every step, s, by component."""
        return {name: np.array(elapsed) for name, elapsed in self._elapsed.items()}

    def open(self, system: System, /) -> None:
        """Do nothing."""

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Do nothing: the trace has them."""

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Do nothing: inputs are their sources."""

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Keep parameters."""
        for name, value in values.items():
            self._parameters.setdefault(f"{component}.{name}", []).append((time_ns, value))

    def event(self, time_ns: int, kind: str, component: str, message: str, /) -> None:
        """Do nothing: the trace has them."""

    def log(self, time_ns: int, level: int, name: str, message: str, /) -> None:
        """Do nothing."""

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float, /) -> None:  # noqa: ARG002
        """Keep a step's duration."""
        self._elapsed.setdefault(component, []).append(elapsed_s)

    def close(self, result: Result, /) -> None:
        """Do nothing."""
