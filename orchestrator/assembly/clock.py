"""Simulated time: whole nanoseconds inside the orchestrator, seconds only at its edge."""

from fractions import Fraction
from math import isfinite

SECOND = 1_000_000_000  # ns


def nanoseconds(seconds: float) -> int:
    """Return a time as whole nanoseconds, reading the number as it is written in decimals.

    Raises
    ------
    ValueError
        If it is not finite, or not a whole number of nanoseconds.

    Examples
    --------
    >>> nanoseconds(0.1)
    100000000
    """
    time = Fraction(str(float(seconds))) * SECOND if isfinite(seconds) else Fraction(1, 2)
    if time.denominator != 1:
        raise ValueError(f"not a whole number of nanoseconds, got {seconds} s")
    return time.numerator


def whole_ticks(seconds: float, base_ns: int) -> int:
    """Return a time that is not negative and a multiple of the base tick, ns.

    Raises
    ------
    ValueError
        If it is not; the message names the nearest times.
    """
    time = nanoseconds(seconds)
    if time < 0:
        raise ValueError(f"negative, got {seconds} s, expected 0 s or more")
    below = time // base_ns * base_ns
    if time != below:
        raise ValueError(
            f"not a multiple of the base tick of {base_ns / SECOND} s, got {seconds} s, "
            f"expected {below / SECOND} s or {(below + base_ns) / SECOND} s"
        )
    return time


def period_ns(rate_hz: float) -> int:
    """Return the exact period of a rate, ns.

    Raises
    ------
    ValueError
        If the rate is not positive or its period is not a whole number of nanoseconds; the message
        names the nearest rates that can be used.

    Examples
    --------
    >>> period_ns(20)
    50000000
    >>> period_ns(3)
    Traceback (most recent call last):
    ValueError: period is not a whole number of nanoseconds, got 3 Hz, expected 2.56 Hz or 3.125 Hz
    """
    if not (isfinite(rate_hz) and rate_hz > 0):
        raise ValueError(f"rate is not positive and finite, got {rate_hz} Hz, expected above 0 Hz")
    rate = Fraction(str(float(rate_hz)))
    period = SECOND / rate
    if period.denominator != 1:
        near = " or ".join(f"{float(usable):g} Hz" for usable in _usable_rates(rate))
        raise ValueError(
            f"period is not a whole number of nanoseconds, got {rate_hz} Hz, expected {near}"
        )
    return period.numerator


def _usable_rates(rate: Fraction) -> list[Fraction]:
    """Return the nearest usable rates below and above that take at most four digits to write."""
    rates = sorted(
        usable
        for twos in range(60)
        for fives in range(30)
        for usable in (Fraction(SECOND, 2**twos * 5**fives),)
        if Fraction(f"{float(usable):.4g}") == usable
    )
    below = [usable for usable in rates if usable < rate][-1:]
    return below + [usable for usable in rates if usable > rate][:1]


def is_multiple(step: float, part: float) -> bool:
    """Return whether a step is a whole number of parts, but for rounding.

    >>> is_multiple(0.05, 0.01), is_multiple(0.05, 0.02), is_multiple(0.01, 0.05)
    (True, False, False)
    """
    ratio = step / part
    return round(ratio) >= 1 and abs(ratio - round(ratio)) <= 1e-9 * ratio
