"""How fast simulated time may go by the wall clock."""

from math import inf

LATE_S = 1.0  # a run that is later than this does not try to catch up


class Pace:
    """Says how long to wait; counts from where it was last changed.

    Attributes
    ----------
    speed : float
        Simulated seconds per second, above 0; infinite: as fast as it goes.
    is_paused : bool
    """

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.is_paused = False
        self._start: tuple[int, float] | None = None  # simulated time, ns, and wall-clock time, s

    def change(self, *, speed: float | None = None, is_paused: bool | None = None) -> None:
        """Take another speed, pause or go on."""
        self.speed = self.speed if speed is None else speed
        self.is_paused = self.is_paused if is_paused is None else is_paused
        self._start = None

    def wait_s(self, time_ns: int, now: float) -> float:
        """Return the wall-clock time from `now` until `time_ns` is due, s; 0 where it has come."""
        if self.is_paused:
            return inf
        if self._start is None:
            self._start = time_ns, now
        start_ns, start = self._start
        due = start + (time_ns - start_ns) / 1e9 / self.speed
        if now > due + LATE_S:
            self._start = time_ns, now
        return max(due - now, 0.0)
