"""What a run says: events, counts, and the reason why it ends."""

import logging
from collections import Counter, deque
from collections.abc import Sequence

from orchestrator.assembly.clock import SECOND
from orchestrator.listener import Listener

# kinds of events that are counted, and their plural in ``Result.counts``
COUNTED = {
    "warning": "warnings",
    "discard": "discards",
    "retry": "retries",
    "error": "errors",
    "died": "deaths",
    "timeout": "timeouts",
    "restart": "restarts",
    "nonfinite": "nonfinite",
    "range": "out_of_range",
    "overrun": "overruns",
}


LOGGER = "hedgehop.component"  # components log to "hedgehop.component.<name>"


class Ended(Exception):  # noqa: N818  (not an error: every run ends)
    """The run ends here; carries the result's outcome and reason."""

    def __init__(self, outcome: str, reason: str) -> None:
        super().__init__(reason)
        self.outcome = outcome
        self.reason = reason


class Report:
    """Counts what happens and tells the listeners; knows the instant that is simulated.

    Attributes
    ----------
    logged : deque
        Time, ns, and record of what components have logged and listeners have not been told yet.
    """

    def __init__(self, listeners: Sequence[Listener]) -> None:
        self.listeners = tuple(listeners)
        self.time_ns = 0
        self.counts: Counter[str] = Counter()
        self.logged: deque[tuple[int, logging.LogRecord]] = deque()

    def event(self, time_ns: int, kind: str, component: str, message: str) -> None:
        """Pass an event on; faults are counted under ``overruns.mpc`` and the like."""
        if kind in COUNTED:
            self.counts[f"{COUNTED[kind]}.{component}"] += 1
        for listener in self.listeners:
            listener.event(time_ns, kind, component, message)

    def said(self, component: str) -> str:
        """Return what a component has logged last, at this instant; usually why it failed."""
        for time_ns, record in reversed(list(self.logged)):
            if time_ns == self.time_ns and record.name == f"{LOGGER}.{component}":
                return " ".join(record.getMessage().split())
        return ""


def at(component: str, time_ns: int) -> str:
    """Return how messages begin.

    >>> at("mpc", 12_350_000_000)
    'mpc at t = 12.350 s'
    """
    return f"{component} at t = {time_ns / SECOND:.3f} s"
