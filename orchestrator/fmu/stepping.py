"""Take one communication step: early returns, events and ticks of clocks lie in between.

Nothing here can go on for ever: every step has a bounded number of parts, and instants at which
time stands still are counted.
"""

from typing import Protocol

from orchestrator.component import Status
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.events import MOST_EVENTS, Events
from orchestrator.fmu.instance import Outcome

MOST_PARTS = 100_000  # of one communication step
NEAR = 1e-9  # of the step size: times closer than this are equal


class Stepping(Protocol):
    """The part of an instance that steps."""

    def do_step(self, time: float, step_size: float) -> int:
        """Step; 0 if that is all there is to say."""
        ...

    def outcome(self, status: int, time: float, step_size: float) -> Outcome:
        """Return how the step went."""
        ...


def advance(
    instance: Stepping,
    time: float,
    end: float,
    *,
    longest: float,
    events: Events | None = None,
    first: int | None = None,
) -> tuple[int, float]:
    """Step from ``time`` to ``end`` and return the FMI status and the time that was reached.

    Parameters
    ----------
    longest : float
        The communication step size, s: no part is longer.
    events : Events, optional
        What handles events, where the FMU leaves that to its importer.
    first : int, optional
        What ``do_step`` from ``time`` over ``longest`` has answered already.

    Raises
    ------
    FmuError
        If the FMU asks to end, or does not get there.
    """
    near, worst, standing = NEAR * longest, int(Status.OK), 0
    for _ in range(MOST_PARTS):
        if end - time <= near:
            return worst, end
        part = min(longest, end - time)
        if first is None:
            if events is not None:
                limit = events.next(time)
                part = limit - time if limit < time + part - near else part
            status = instance.do_step(time, part)
        else:
            status, first = first, None
        if status == Status.OK:
            time, standing = time + part, 0
            continue
        outcome = instance.outcome(status, time, part)
        if outcome.status > Status.WARNING and not outcome.reached > time + near:
            return outcome.status, time
        if outcome.status > Status.DISCARD:
            return outcome.status, time
        if outcome.status == Status.WARNING:
            worst = int(Status.WARNING)
        if outcome.needs_event and events is not None:
            events.handle()
        standing = standing + 1 if outcome.reached <= time else 0
        if standing > MOST_EVENTS:
            raise FmuError(f"time stands still, got {standing} early returns at t = {time} s")
        time = outcome.reached
    raise FmuError(f"a step is cut too small, got {MOST_PARTS} parts before t = {end} s")
