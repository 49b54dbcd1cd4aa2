"""The figures of a flight, from signals alone: how high, how far off, how hard, how long it took.

Signals come by the scene's roles, so any plant and any controller can fill them; a figure whose
role is missing is None. The same function takes the trace of a run and a recording of it.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from orchestrator.figures.deviation import (
    POSE,
    REFERENCE,
    VELOCITY,
    Array,
    Samples,
    deviation,
    held,
)
from orchestrator.listener import Result

DEPARTED_DEG = 45.0  # a heading this far from its reference is a departure
BOUND_TOLERANCE = 1e-6  # of the range between the bounds

NOTHING = np.empty(0)


class Signals(Protocol):
    """Signals by full name: a trace or a recording."""

    @property
    def names(self) -> Iterable[str]:
        """Full names, `component.variable`."""
        ...

    def __getitem__(self, name: str, /) -> Samples:
        """Return the times, s, and the values of a signal."""
        ...


class Variable(Protocol):
    """What a description says about a variable: a port, or a recorded signal."""

    @property
    def min(self) -> float | None:
        """Lower bound."""
        ...

    @property
    def max(self) -> float | None:
        """Upper bound."""
        ...

    @property
    def items(self) -> Mapping[int, str]:
        """Text of each value of an enumeration."""
        ...


def flight_metrics(
    signals: Signals,
    variables: Mapping[str, Variable],
    scene: Mapping[str, str],
    result: Result,
    settle_s: float,
    wall_clock: Mapping[str, Array] | None = None,
) -> dict[str, Any]:
    """Return the figures of a flight as plain data, ready for JSON.

    Parameters
    ----------
    signals
        What was published, by full name.
    variables
        Bounds and items, by full name.
    scene
        Role to full name of a variable or group.
    result
        How the run ended.
    settle_s
        Start of the flight, s, that every figure leaves out but the least clearance, the largest
        heading deviation and the ladder.
    wall_clock
        Durations of all steps, s, by component; None where timings are not wanted.
    """
    names = frozenset(signals.names)

    def role(name: str, member: str = "") -> Samples:
        full = scene.get(name, "") + member
        return signals[full] if full in names else (NOTHING, NOTHING)

    off = deviation(
        {name: role("pose", f".{name}") for name in POSE},
        {name: role("velocity", f".{name}") for name in VELOCITY},
        {name: role("reference", f".{name}") for name in REFERENCE},
    )
    flown = off.time >= settle_s
    heading_deg = _figure(np.max, np.degrees(np.abs(off.heading)))
    departed = heading_deg is not None and heading_deg > DEPARTED_DEG
    clearance = role("clearance")
    agl_error = clearance[1] - held(role("height_agl"), clearance[0])
    load_factor = _settled(role("load_factor"), settle_s)
    bounded = {
        name: (_settled(signals[name], settle_s), variables[name])
        for name in sorted(names)
        if name.startswith(scene.get("controls", ".") + ".")
    }
    ladder = scene.get("ladder", "")
    return {
        "outcome": "departed" if departed and result.outcome == "flown" else result.outcome,
        "reason": result.reason,
        "duration_s": result.time_ns / 1e9,
        "height_rms_m": _figure(_rms, off.height[flown]),
        "height_p95_m": _figure(_p95, np.abs(off.height[flown])),
        "agl_rms_m": _figure(_rms, _settled((clearance[0], agl_error), settle_s)),
        "clearance_min_m": _figure(np.min, clearance[1]),
        "cross_track_rms_m": _figure(_rms, off.cross_track[flown]),
        "speed_rms_mps": _figure(_rms, off.speed[flown]),
        "heading_max_deg": heading_deg,
        "load_factor_min": _figure(np.min, load_factor),
        "load_factor_max": _figure(np.max, load_factor),
        "saturation_percent": saturation_percent(bounded.values()),
        "ladder": ladder_counts(signals[ladder][1], variables[ladder]) if ladder in names else None,
        "faults": faults(result, has_overruns=wall_clock is not None),
        **timing(scene.get("plan", "").partition(".")[0], result, wall_clock),
    }


def saturation_percent(controls: Iterable[tuple[NDArray[Any], Variable]]) -> float | None:
    """Return the share of ticks, in percent, at which any control is at one of its bounds."""
    at_bound: list[NDArray[np.bool_]] = []
    for values, variable in controls:
        low = -np.inf if variable.min is None else variable.min
        high = np.inf if variable.max is None else variable.max
        near = BOUND_TOLERANCE * (high - low) if np.isfinite(high - low) else 0.0
        at_bound.append((values <= low + near) | (values >= high - near))
    return _figure(np.mean, 100.0 * np.any(at_bound, axis=0)) if at_bound else None


def ladder_counts(values: NDArray[Any], variable: Variable) -> dict[str, int]:
    """Return how often an enumeration was published with each of its items, by text."""
    return {text: int(np.count_nonzero(values == k)) for k, text in variable.items.items()}


def faults(result: Result, *, has_overruns: bool) -> dict[str, int]:
    """Return how often what happened to whom, as `out_of_range.mpc`; overruns if wanted."""
    return {
        name: count
        for name, count in sorted(result.counts.items())
        if count and (has_overruns or not _is_overrun(name))
    }


def timing(
    component: str, result: Result, wall_clock: Mapping[str, Array] | None
) -> dict[str, float | int | None]:
    """Return what one component's steps, all missed deadlines and the whole run cost.

    All None without wall clock.
    """
    measured = wall_clock is not None
    update_ms = 1e3 * wall_clock.get(component, NOTHING) if measured else NOTHING
    simulated_s = result.time_ns / 1e9
    return {
        "update_ms_median": _figure(np.median, update_ms),
        "update_ms_p99": _figure(_p99, update_ms),
        "deadline_misses": sum(n for name, n in result.counts.items() if _is_overrun(name))
        if measured
        else None,
        "cpu_ms_per_simulated_s": 1e3 * result.cpu_s / simulated_s
        if measured and simulated_s and result.cpu_s
        else None,
    }


def mb_per_min(size: int, duration_s: float) -> float | None:
    """Return the size of a recording, given in bytes, per simulated minute; None of no time."""
    return size / 1e6 * 60.0 / duration_s if duration_s else None


def _is_overrun(name: str) -> bool:
    """Whether a count is one of missed deadlines."""
    return name.startswith("overruns.")


def _settled(samples: Samples, settle_s: float) -> NDArray[Any]:
    return samples[1][samples[0] >= settle_s]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _p95(values: Array) -> float:
    return float(np.percentile(values, 95))


def _p99(values: Array) -> float:
    return float(np.percentile(values, 99))


def _figure(statistic: Callable[[Array], Any], values: Array) -> float | None:
    """Return a statistic of what is known, None where nothing is."""
    known = values[np.isfinite(values)]
    return float(statistic(known)) if len(known) else None
