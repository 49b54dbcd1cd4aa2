"""A runnable system as frozen records: components, what connects them, and when each runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from orchestrator.assembly.description import Port
from orchestrator.component import Instance
from orchestrator.scenario.records import Scenario

if TYPE_CHECKING:
    from orchestrator.assembly.plans import Plan


@dataclass(frozen=True)
class Link:
    """One variable to one variable: ``target = factor * source + offset``, ``delay_ns`` later.

    Until a delay has passed for the first time the target keeps its start value.
    """

    source: Port
    target: Port
    factor: float = 1.0
    offset: float = 0.0
    delay_ns: int = 0

    @property
    def is_plain(self) -> bool:
        """Whether the target always equals its source."""
        return self.factor == 1.0 and self.offset == 0.0 and self.delay_ns == 0

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


@dataclass(frozen=True)
class Operation:
    """One entry of the schedule.

    ``read``     continuous: take over ``inputs`` (direct feed-through), read ``outputs``.
    ``release``  sampled with latency: outputs of an earlier step become valid now.
    ``sample``   sampled: take over all inputs, step, read all outputs.
    ``advance``  continuous: take over all inputs, step to the next communication point.
    """

    kind: Literal["read", "release", "sample", "advance"]
    component: str
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Schedule:
    """Who does what when, in integer nanoseconds.

    ``table`` holds one hyperperiod: ``(offset_ns, operations)`` of every instant at which something
    happens, in order. At ``end_ns`` only ``read`` and ``release`` are carried out.
    """

    end_ns: int
    base_ns: int
    hyperperiod_ns: int
    period_ns: Mapping[str, int]
    latency_ns: Mapping[str, int]
    initialization: tuple[str, ...]
    table: tuple[tuple[int, tuple[Operation, ...]], ...]


@dataclass(frozen=True)
class System:
    """What ``simulate`` runs; made by :func:`orchestrator.assembly.couple.couple`.

    ``ports`` is every variable of every component, ``log`` what happened while coupling, ``notes``
    those lines of it that tell of what may not be meant, ``plans`` what its parts were made from,
    in the order of making, ``resources`` what they share, by name.
    """

    instances: dict[str, Instance]
    ports: dict[str, dict[str, Port]]
    schedule: Schedule
    links: tuple[Link, ...]
    scenario: Scenario
    log: list[str] = field(default_factory=list[str])
    notes: tuple[str, ...] = ()
    plans: "tuple[Plan, ...]" = ()
    resources: Mapping[str, object] = field(default_factory=dict[str, object])
