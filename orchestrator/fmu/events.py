"""Event mode of an FMI 3 co-simulation FMU: its own events, and the clocks it is given."""

from collections.abc import Callable, Sequence

from orchestrator.fmu.clocks import MOVING, Clock, following
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.fmi3 import Fmi3

MOST_EVENTS = 1_000  # at one instant
NEVER = float("inf")


class Events:
    """Handles events of one instance.

    Parameters
    ----------
    clocks : sequence of Clock
        Those that the importer ticks.
    is_variable : bool
        Whether a communication step may be cut at an event.
    at_tick : callable
        Sets the inputs that may be set only while the clocks of these references tick.
    """

    def __init__(
        self,
        instance: Fmi3,
        clocks: Sequence[Clock],
        at_tick: Callable[[Sequence[int]], None],
        *,
        is_variable: bool,
    ) -> None:
        self._instance = instance
        self._clocks = clocks
        self._is_variable = is_variable
        self._at_tick = at_tick

    def start(self, time: float) -> None:
        """Settle after initialization, and ask for the intervals that only the FMU knows."""
        self._instance.update_discrete_states()
        start_clocks(self._instance, self._clocks, time)
        self._instance.enter_step_mode()

    def next(self, time: float) -> float:
        """Handle what is due at ``time`` and return when something is due again, s.

        Raises
        ------
        FmuError
            If there is no end of events at one instant.
        """
        near = 1e-9 * abs(time) + 1e-12
        for _ in range(MOST_EVENTS):
            limit = min(following(self._clocks), self._instance.next_event)
            if limit > time + near:
                return limit if self._is_variable else NEVER
            self._instance.next_event = NEVER  # it is handled now
            self.handle(time + near)
        raise FmuError(f"events do not end, got {MOST_EVENTS} at t = {time} s")

    def handle(self, time: float = -NEVER, write: Callable[[], None] | None = None) -> None:
        """Enter event mode, tick what is due by ``time``, call ``write``, settle, and go on."""
        instance = self._instance
        instance.enter_event_mode()
        due = [clock for clock in self._clocks if clock.next <= time]
        if due:
            instance.tick([clock.reference for clock in due])
            self._at_tick([clock.reference for clock in due])
        if write is not None:
            write()
        instance.update_discrete_states()
        for clock in due:
            tick(instance, clock)
        instance.enter_step_mode()


def start_clocks(instance: Fmi3, clocks: Sequence[Clock], time: float) -> None:
    """Begin to count the ticks of clocks; the FMU is asked for intervals it does not declare."""
    for clock in clocks:
        clock.start(time)
        if clock.interval is None:
            clock.interval = instance.interval(clock.reference)


def tick(instance: Fmi3, clock: Clock) -> None:
    """Note that a clock has ticked, and ask when it does so again if that is for the FMU to say."""
    now = clock.next
    clock.ticked()
    if clock.variability in MOVING:
        clock.renew(now, instance.interval(clock.reference))
