"""Altitude and speed over the station: a fit to terrain + set height within what can be flown.

One quadratic program in the new B-spline coefficients of z(s):

    min integral of (z - h - AGL)^2 + lambda z''^2
    s.t. z  >= h + h_min                     hard, every SAMPLE_M
         |z'| <= tan(gamma_max)              soft, every half span
         -a_dn / V^2 <= z'' <= a_up / V^2    soft, every knot: exact, since z'' is linear between

The kept coefficients enter as constants. They may make the hard limit unattainable just ahead,
where a new coefficient has almost no say; so there it is capped by what can be attained, which
keeps the program feasible (see :func:`_attainable`) and its solution tame.

Where clearing the terrain breaks a soft limit the speed falls until the limit holds again:
V <- V sqrt(a_up / (z'' V^2)), as far as the deceleration along the path allows.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.jit import kernel
from controller.spline import (
    KNOT_M,
    Weights,
    curvature_weights,
    evaluate,
    normal_equations,
    slope_weights,
    weights,
)

Array = NDArray[np.float64]
# fitted: within all limits; strained: a soft limit gave way; capped: the clearance did too;
# envelope: the solver failed; blind: no terrain was sensed ahead
Status = Literal["fitted", "strained", "capped", "envelope", "blind"]

SAMPLES = 5  # per span
SAMPLE_M = KNOT_M / SAMPLES
TIGHTENING_M = 0.1  # against dips between samples, SAMPLE_M^2 |h''| / 8
GRACE = 1.02  # a limit passed by less slows nothing: a soft limit is only nearly kept
EMERGENCY = 2.0  # times the nominal climb limits: what a cap assumes attainable
REACH = 2  # spans that the first new coefficients need to take hold


class Limits(NamedTuple):
    """What can be flown: speeds in m/s, accelerations in m/s^2, slope as tan(gamma_max)."""

    speed: float
    speed_min: float
    slope: float
    up: float
    down: float
    side: float
    acceleration: float
    deceleration: float


def plan_altitude(
    target: Array,
    floor: Array,
    kept: Array,
    old: Array,
    limits: Limits,
    speed: Array,
    smoothing: float = 2e4,
) -> tuple[Array, Status]:
    """Return the altitude coefficients (spans + 3 - m,) that follow ``kept`` (m,), and a status.

    Parameters
    ----------
    target, floor
        h + AGL and h + h_min (spans * SAMPLES + 1,) in metres, every SAMPLE_M from the first knot;
        NaN where the terrain is not sensed.
    kept
        The three coefficients that fix altitude, slope and curvature at the first knot, or none.
    old
        Altitudes at the same samples of the previous plan, which they never need to beat just
        ahead; NaN where it was not planned over sensed terrain.
    limits, speed
        The soft limits, at the speed (spans + 1,) in m/s that each knot is flown at.
    smoothing
        lambda, m^4.
    """
    from daqp import solve

    up, down = limits.up / speed**2, limits.down / speed**2
    H, f = normal_equations(kept, target, SAMPLES, smoothing)
    cap, capped = np.full(floor.size, np.inf), False
    if kept.size:
        cap = _attainable(kept, old, up, limits.slope)
        capped = bool(np.any(floor > cap + 1e-6))
    A, lower, upper, sense = _rows(
        kept, np.minimum(floor + TIGHTENING_M, cap), up, down, limits.slope
    )
    new, _, flag, _ = solve(H, f, A, upper, lower, sense, rho_soft=1e-6)
    if flag < 1 or not np.isfinite(new).all():
        return _envelope(target, kept.size), "envelope"
    value, soft = A @ new, sense > 0
    excess = np.maximum(value - upper, lower - value)[soft]
    strained = bool(np.any(excess > (GRACE - 1) * (upper - lower)[soft] / 2))
    return new, "capped" if capped else "strained" if strained else "fitted"


@kernel
def _attainable(kept: Array, old: Array, up: Array, slope: float) -> Array:
    """Return the altitude (samples,) above which no clearance is demanded.

    B-spline weights are not negative, so the spline of the largest coefficients that the
    (emergency) limits allow is the highest attainable one everywhere; and the coefficient-wise
    maximum of it and the old plan is feasible wherever the demand is below either.
    """
    spans = up.size - 1
    climb = np.empty(spans + 3)
    for k in range(3):
        climb[k] = kept[k]
    for k in range(3, spans + 3):
        step = climb[k - 1] - climb[k - 2]
        rise = step + EMERGENCY * up[k - 2] * KNOT_M**2
        climb[k] = climb[k - 1] + max(min(rise, EMERGENCY * slope * KNOT_M), step)
    cap = np.empty(spans * SAMPLES + 1)
    for k in range(cap.size):
        i = min(k // SAMPLES, spans - 1)
        highest = evaluate(climb, i, weights(k / SAMPLES - i))
        if np.isnan(old[k]):
            cap[k] = highest
        elif k <= REACH * SAMPLES:
            cap[k] = old[k]
        else:
            cap[k] = max(old[k], highest)
    return cap


@kernel
def _put(A: Array, row: int, first: int, w: Weights) -> None:
    for a in range(4):
        A[row, first + a] = w[a]


@kernel
def _rows(
    kept: Array, floor: Array, up: Array, down: Array, slope: float
) -> tuple[Array, Array, Array, NDArray[np.int32]]:
    """Return A (R, n), lower, upper (R,) and DAQP's row types (0 hard, 8 soft)."""
    spans = up.size - 1
    m, n = kept.size, spans + 3
    R = floor.size + 3 * spans + 2
    A = np.zeros((R, n))
    lower, upper = np.full(R, -1e30), np.full(R, 1e30)
    sense = np.zeros(R, np.int32)
    r = 0
    # at the first knot everything is kept, if anything is
    for k in range(1 if m else 0, floor.size):
        if np.isfinite(floor[k]):
            i = min(k // SAMPLES, spans - 1)
            _put(A, r, i, weights(k / SAMPLES - i))
            lower[r] = floor[k]
            r += 1
    for k in range(1 if m else 0, 2 * spans + 1):
        i = min(k // 2, spans - 1)
        _put(A, r, i, slope_weights(0.5 * k - i))
        lower[r], upper[r], sense[r] = -slope, slope, 8
        r += 1
    for k in range(1 if m else 0, spans + 1):
        i = min(k, spans - 1)
        _put(A, r, i, curvature_weights(float(k - i)))
        lower[r], upper[r], sense[r] = -down[k], up[k], 8
        r += 1
    for k in range(r):
        constant = 0.0
        for a in range(m):
            constant += A[k, a] * kept[a]
        lower[k] -= constant
        upper[k] -= constant
    return A[:r, m:].copy(), lower[:r].copy(), upper[:r].copy(), sense[:r].copy()


def _envelope(target: Array, kept: int) -> Array:
    """Return coefficients that are the highest target within their reach: z is never below it."""
    spans = (target.size - 1) // SAMPLES
    known = np.where(np.isfinite(target), target, -np.inf)
    highest = np.array(
        [
            known[max(i - 3, 0) * SAMPLES : (i + 1) * SAMPLES + 1].max(initial=-np.inf)
            for i in range(spans + 3)
        ]
    )
    return np.where(np.isfinite(highest), highest, known.max())[kept:]


def unhindered_speed(start: float, distance: Array, limits: Limits) -> Array:
    """Return the speed (m/s) a distance (m) after ``start`` (m/s), on the way to the set speed."""
    slower = np.sqrt(np.maximum(start**2 - 2 * limits.deceleration * distance, 0.0))
    faster = np.sqrt(start**2 + 2 * limits.acceleration * distance)
    return np.maximum(np.minimum(faster, limits.speed), slower)


@kernel
def plan_speed(
    start: float, known: int, slope: Array, bend: Array, turn: Array, limits: Limits
) -> Array:
    """Return the speed (K,) every metre, from ``start`` on.

    ``slope`` is z', ``bend`` z'' and ``turn`` the path's curvature over the ground (1/m). Sample
    ``known`` is the last over sensed terrain; beyond it the speed falls.
    """
    n = slope.size
    v = np.full(n, limits.speed_min)
    for k in range(min(known + 1, n)):
        v[k] = limits.speed
        if bend[k] > 0.0:
            v[k] = min(v[k], np.sqrt(GRACE * limits.up / bend[k]))
        elif bend[k] < 0.0:
            v[k] = min(v[k], np.sqrt(GRACE * limits.down / -bend[k]))
        if turn[k] != 0.0:
            v[k] = min(v[k], np.sqrt(GRACE * limits.side / abs(turn[k])))
        if abs(slope[k]) > GRACE * limits.slope:
            v[k] = min(v[k], limits.speed * GRACE * limits.slope / abs(slope[k]))
        v[k] = max(v[k], limits.speed_min)
    for k in range(min(known, n - 1) - 1, -1, -1):
        v[k] = min(v[k], np.sqrt(v[k + 1] ** 2 + 2.0 * limits.deceleration))
    v[0] = start
    for k in range(1, n):
        slowest = np.sqrt(max(v[k - 1] ** 2 - 2.0 * limits.deceleration, 0.0))
        v[k] = max(min(v[k], np.sqrt(v[k - 1] ** 2 + 2.0 * limits.acceleration)), slowest)
    return v
