"""A scenario as frozen records: what the loader makes of YAML and the orchestrator runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class ResourceSpec:
    """A shared object, made once and referred to as ``${name}`` in components' parameters."""

    name: str
    use: str
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class ComponentSpec:
    """One component: what to make, how often it runs, and what happens when it fails.

    Attributes
    ----------
    use : str
        ``module:attribute``, the name of an entry point, or a file.
    rate_hz : float or None
        Steps per simulated second; None takes the component's own preference.
    latency_s : float
        Sampled components: from the release, when inputs are read, to the outputs' validity, s.
    deadline_s : float or None
        Wall-clock time one step may take, s; None supervises nothing.
    isolation : str
        ``process`` runs it in a process of its own, which may crash or hang without harm.
    timeout_s : float or None
        Wall-clock time after which an isolated component that does not answer is given up, s.
    on_discard, on_error, on_nonfinite, on_range, on_overrun : str
        Policy for a refused step, a failed step or an exception, a NaN or infinite output, an
        output outside its declared min and max, and a step that took longer than ``deadline_s``.
        ``hold`` keeps the last outputs and flies on: a refused step is asked for again at the next
        instant, a failed component no more. ``restart``, of an isolated component whose state can
        be saved: a new process goes on from the state before the failed step.
    fmu : mapping
        How an FMU is taken in; see :class:`orchestrator.fmu.component.FmuParameters`.
    """

    name: str
    use: str
    rate_hz: float | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])
    latency_s: float = 0.0
    deadline_s: float | None = None
    on_discard: Literal["end", "hold", "retry"] = "end"
    on_error: Literal["end", "hold", "restart"] = "end"
    on_nonfinite: Literal["end", "hold"] = "end"
    on_range: Literal["log", "hold", "end"] = "log"
    on_overrun: Literal["log", "hold", "end"] = "log"
    isolation: Literal["none", "process"] = "none"
    timeout_s: float | None = None
    fmu: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class ConnectionSpec:
    """``start -> end``, each ``component.variable`` or ``component.group``; delayed by s.

    With a ``factor`` the end is factor * start + offset, in place of a conversion of units.
    """

    start: str
    end: str
    delay_s: float = 0.0
    factor: float | None = None
    offset: float = 0.0


@dataclass(frozen=True)
class EventSpec:
    """At ``at_s`` (s), set an unconnected input or tunable parameter ``component.variable``."""

    at_s: float
    set: str
    value: Any


@dataclass(frozen=True)
class RecordingSpec:
    """What a recording holds, and how.

    Attributes
    ----------
    wall_clock : bool
        Measured times too.
    scene : bool
        What viewers draw, too.
    include, exclude : tuple of str
        Patterns of topics, as of :mod:`fnmatch`: recorded is what an ``include`` matches (all, if
        there is none) and no ``exclude`` does.
    every : mapping
        Pattern to n: of topics that are published again and again, each n-th message.
    compression : str
        Of chunks.
    chunk_kb : int
        Largest chunk before compression, kB; none is longer than one simulated second.
    on_disk_full : str
        When the file cannot be written any more: ``stop`` recording and fly on, or ``end`` the run.
    """

    wall_clock: bool = True
    scene: bool = True
    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    every: Mapping[str, int] = field(default_factory=dict[str, int])
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    chunk_kb: int = 1000
    on_disk_full: Literal["stop", "end"] = "stop"


@dataclass(frozen=True)
class Scenario:
    """A whole run.

    Attributes
    ----------
    duration_s, settle_s : float
        Simulated time, and how much of its beginning the tracking figures leave out, s.
    seed : int
        Every component draws its own seed from this one and its name.
    scene : mapping
        Role (``pose``, ``clearance``, ``plan``, ...) to ``component.group``; for viewers, metrics.
    end_on : tuple of str
        Enumeration outputs; the run ends where one is not 0, with that item's text as outcome.
    folder : Path
        Where files are looked up first.
    origins : mapping
        Path through the keys to ``file:line:column``.
    """

    title: str
    duration_s: float
    settle_s: float = 2.0
    seed: int = 0
    resources: tuple[ResourceSpec, ...] = ()
    components: tuple[ComponentSpec, ...] = ()
    connections: tuple[ConnectionSpec, ...] = ()
    events: tuple[EventSpec, ...] = ()
    scene: Mapping[str, str] = field(default_factory=dict[str, str])
    end_on: tuple[str, ...] = ()
    recording: RecordingSpec = RecordingSpec()
    folder: Path = Path()
    origins: Mapping[tuple[str | int, ...], str] = field(
        default_factory=dict[tuple[str | int, ...], str]
    )
