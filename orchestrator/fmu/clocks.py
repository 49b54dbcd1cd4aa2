"""When the time-based clocks of an FMI 3 FMU tick."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from orchestrator.fmu.description import interval

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

MOVING = ("changing", "countdown")  # the FMU says the interval again after every tick
UNSAID = ("fixed", "tunable", *MOVING)  # the FMU may say it once it is initialized


@dataclass
class Clock:
    """One clock that the importer has to tick.

    Attributes
    ----------
    priority : int
        Lower ones first at the same instant.
    interval : float or None
        s; None while not known: it does not tick.
    origin, count : float, int
        The next tick is at ``origin + count * interval``: nothing adds up.
    """

    reference: int
    priority: int
    variability: str
    interval: float | None
    shift: float
    origin: float = 0.0
    count: int = 0

    @property
    def next(self) -> float:
        """Time of the next tick, s."""
        if self.interval is None:
            return float("inf")
        return self.origin + self.count * self.interval

    def start(self, time: float) -> None:
        """Begin to count; a countdown ticks after its first interval, all others at the shift."""
        self.origin, self.count = time + self.shift, int(self.variability == "countdown")

    def ticked(self) -> None:
        """Note that it has ticked."""
        self.count += 1
        if self.variability == "countdown":
            self.interval = None  # until the FMU names the next

    def renew(self, time: float, interval: float | None) -> None:
        """Take over what the FMU says, at ``time``, of the interval to the next tick."""
        if interval is not None and interval > 0.0 and interval != self.interval:
            self.origin, self.count, self.interval = time, 1, interval


def clocks(description: "ModelDescription") -> list[Clock]:
    """Return the clocks that need the importer, by priority: time-based inputs."""
    found = [
        Clock(
            one.valueReference,
            one.priority if one.priority is not None else 1 << 31,
            str(one.intervalVariability),
            interval(one),
            one.shiftCounter / one.resolution if one.resolution else float(one.shiftDecimal or 0.0),
        )
        for one in description.modelVariables
        if one.type == "Clock" and one.causality == "input"
        if one.intervalVariability in ("constant", *UNSAID)
    ]
    return sorted(found, key=lambda clock: clock.priority)


def following(clocks: Iterable[Clock]) -> float:
    """Return when the next clock ticks, s."""
    return min((clock.next for clock in clocks), default=float("inf"))
