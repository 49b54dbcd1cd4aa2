"""A step in altitude, flown over a receding horizon: the flights, and what is read from them."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.optimise import STEPS
from paper.converge import basis
from paper.problem import Form, Problem, level_flight
from paper.receding import APPLIED, Flown, fly

Floats = NDArray[np.float64]

HEIGHT_M = 10.0
AT_S = 12.0  # out of sight of the first plan
DURATION_S = 32.0
PERIOD_S = 0.05
ALTITUDE = 2  # row of the outputs
LATE_S = 10.0  # after the step: what moves then is residual ripple
LOST_M = 2.0 * HEIGHT_M  # an altitude error beyond any response to the step
TENTS, BOXES, LAGUERRE, LEGENDRE = "10 tents", "10 boxes", "5 Laguerre", "7 Legendre"
BASES: Mapping[str, tuple[str, int]] = {
    TENTS: ("tent", 10),
    BOXES: ("box", 10),
    LAGUERRE: ("laguerre", 5),
    LEGENDRE: ("legendre", 7),
    "5 Laguerre functions": ("laguerre_function", 5),
    "8 Laguerre functions": ("laguerre_function", 8),
}
Case = tuple[Form, bool]  # and whether the line is searched
SHIPPED: Case = ("attitude", True)
LITERAL: Case = ("actuator", False)


class Way(NamedTuple):
    """How a flight is flown."""

    form: Form
    is_searched: bool
    is_previewed: bool


class Transient(NamedTuple):
    """What is read from a response to the step; times after it, s, lengths in m.

    ``rise_s`` from 10 to 90 %; ``settle_1m_s`` and ``settle_2pct_s`` until the error stays within
    1 m and 2 %; ``overshoot_m`` beyond the new altitude and ``dip_m`` below the old one; ``ripple_m``
    from peak to peak and ``late_error_m``, both later than 10 s after the step. Infinite where the
    flight was lost.
    """

    rise_s: float
    settle_1m_s: float
    settle_2pct_s: float
    overshoot_m: float
    dip_m: float
    ripple_m: float
    late_error_m: float

    @property
    def excursion_m(self) -> float:
        """Return how far the altitude left the span of the step, both sides together."""
        return self.overshoot_m + self.dip_m


LOST = Transient(*[np.inf] * len(Transient._fields))


def stepping(level: Problem, *, is_previewed: bool) -> Callable[[float], Problem]:
    """Return, for :func:`paper.receding.fly`, level flight with the step at ``AT_S``."""

    def problem_at(time: float) -> Problem:
        ends = time + PERIOD_S * np.arange(1, level.horizon + 1)
        seen = ends if is_previewed else np.full_like(ends, time)
        reference = level.reference.copy()
        reference[0] = level.reference[4] * ends
        reference[2] = wanted(seen)
        return replace(level, reference=reference)

    return problem_at


def transient(time: Floats, altitude: Floats) -> Transient:
    """Return the figures of a response, altitude (T,) m at ``time`` (T,) s."""
    error = altitude - wanted(time)
    if np.abs(error).max() > LOST_M:
        return LOST

    def settled(band: float) -> float:
        beyond = time[np.abs(error) > band]
        return float(max(beyond[-1] - AT_S, 0.0)) if beyond.size else 0.0

    high = np.flatnonzero(altitude >= 0.9 * HEIGHT_M)
    low = np.flatnonzero(altitude[: high[0]] <= 0.1 * HEIGHT_M) if high.size else high
    late = altitude[time > AT_S + LATE_S]
    return Transient(
        rise_s=float(time[high[0]] - time[low[-1]]) if low.size else np.inf,
        settle_1m_s=settled(1.0),
        settle_2pct_s=settled(0.02 * HEIGHT_M),
        overshoot_m=float(max(altitude.max() - HEIGHT_M, 0.0)),
        dip_m=float(max(-altitude.min(), 0.0)),
        ripple_m=float(np.ptp(late)),
        late_error_m=float(np.abs(late - HEIGHT_M).max()),
    )


def respond(name: str, way: Way) -> Flown:
    """Fly one basis one way."""
    level = level_flight(form=way.form)
    family, count = BASES[name]
    updates = round(DURATION_S / (APPLIED * PERIOD_S))
    problem_at = stepping(level, is_previewed=way.is_previewed)
    lengths = STEPS if way.is_searched else (1.0,)
    return fly(problem_at, basis(family, count, level.horizon), updates, lengths=lengths)


def read(flown: Flown) -> Transient:
    """Return the figures of a flight; lost if it departed."""
    return transient(flown.time, flown.outputs[:, ALTITUDE]) if flown.valid else LOST


def ways(*, quick: bool) -> list[Way]:
    """Return the ways flown: quick, those that ship and those of the paper."""
    others: tuple[Case, ...] = (("actuator", True), ("attitude", False))
    cases = (SHIPPED, LITERAL) if quick else (SHIPPED, LITERAL, *others)
    return [Way(*case, is_previewed) for case in cases for is_previewed in (True, False)]


def histories(
    flights: Mapping[tuple[str, Way], Flown], form: Form, *, is_searched: bool
) -> dict[str, Any]:
    """Return the altitudes of one case by column, m; NaN from where a flight was lost."""
    number = round(DURATION_S / PERIOD_S)
    time = PERIOD_S * np.arange(1, number + 1)
    columns: dict[str, Any] = {"time_s": time}
    for (name, way), flown in flights.items():
        if (way.form, way.is_searched) == (form, is_searched):
            altitude = np.full(number, np.nan)
            altitude[: len(flown.time)] = flown.outputs[:, ALTITUDE]
            off = np.abs(altitude - wanted(time)) > LOST_M
            altitude[np.maximum.accumulate(off)] = np.nan
            columns[column(name, is_previewed=way.is_previewed)] = altitude
    return columns


def wanted(time: NDArray[Any]) -> Floats:
    """Return the altitude wanted, m, at times (T,), s."""
    return np.where(time >= AT_S - 1e-9, HEIGHT_M, 0.0)


def column(name: str, *, is_previewed: bool) -> str:
    """Return what :func:`histories` calls a flight."""
    return f"altitude_m, {name}, {'previewed' if is_previewed else 'not previewed'}"
