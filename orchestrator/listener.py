"""What a run tells whoever listens: a recorder, an in-memory trace, a progress display."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from orchestrator.component import Value

if TYPE_CHECKING:
    from orchestrator.assembly.system import System


@dataclass(frozen=True)
class Result:
    """How a run ended.

    Attributes
    ----------
    outcome : str
        ``flown``, the text of an ``end_on`` item, ``component error`` or ``interrupted``.
    reason : str
        One line that names component, variable, value and time; empty for ``flown``.
    time_ns : int
        Simulated time at the end, ns from the start.
    counts : mapping
        ``overruns.mpc``, ``warnings.vehicle``, ... : how often; absent means never.
    cpu_s, wall_s : float
        Time the run took once it was initialized, s. Measured, hence no part of a reproducible
        recording.
    """

    outcome: str
    reason: str = ""
    time_ns: int = 0
    counts: Mapping[str, int] = field(default_factory=dict[str, int])
    cpu_s: float = 0.0
    wall_s: float = 0.0


class Listener(Protocol):
    """Hears everything that happens in a run, in the order of simulated time.

    Times are integer nanoseconds from 0. Values must not be changed: they are the ones that the
    components exchange. They may be kept: every call brings fresh objects.
    """

    @property
    def wants_wall_clock(self) -> bool:
        """Whether to measure every step; read once, before ``open``."""
        ...

    def open(self, system: "System", /) -> None:
        """Prepare for a run; called once, before anything else."""
        ...

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Take all outputs of a component at the instant they become valid.

        Called once per publishing, at most once per component and instant.
        """
        ...

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Take inputs that differ from their sources: converted, delayed or set by an event."""
        ...

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Take all parameters at the start, and those that an event changes."""
        ...

    def event(self, time_ns: int, kind: str, component: str, message: str, /) -> None:
        """Take a fault, its policy, a timed change or the end; ``message`` may hold a traceback."""
        ...

    def log(self, time_ns: int, level: int, name: str, message: str, /) -> None:
        """Take a line of text; ``level`` is one of the standard library's ``logging`` levels."""
        ...

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float, /) -> None:
        """Take the measured duration of one step; only where ``wants_wall_clock``."""
        ...

    def close(self, result: Result, /) -> None:
        """Finish; called once on every way out of a run after ``open`` was called."""
        ...
