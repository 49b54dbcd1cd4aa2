"""The reference: a path over the course's stations that grows as terrain is sensed.

What lies up to the commit distance ahead of the aircraft never changes again, to the last bit. Only
what lies beyond is planned again, with position, slope and curvature continuing, and only when
terrain was sensed or a tunable changed. The aircraft's own position decides nothing but how far
ahead the commitment reaches, so a height error is never flattered by a reference that follows it.

Beyond the sensed terrain the slope is held, or eased up to level where it descends, and the speed
falls; the horizon of a controller should end at ``known_until``.
"""

from dataclasses import dataclass
from math import ceil, floor, radians, tan
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Lt
from numpy.typing import ArrayLike, NDArray

from controller.course import (
    STANDARD_GRAVITY,
    Course,
    Path,
    Samples,
    position,
    project,
    sample_path,
)
from controller.jit import kernel
from controller.lateral import half_width, plan_offsets
from controller.profile import (
    SAMPLE_M,
    SAMPLES,
    Limits,
    Status,
    plan_altitude,
    plan_speed,
    unhindered_speed,
)
from controller.spline import KNOT_M, curvature_weights, evaluate, hold, slope_weights, weights
from controller.terrain_map import TerrainMap, height_and_slope

__all__ = [
    "Path",
    "Reference",
    "ReferenceParameters",
    "Samples",
    "extend",
    "project",
    "sample",
    "sample_path",
    "start",
]

Array = NDArray[np.float64]
LOOK_SPANS = 60  # how far ahead terrain is looked for
BEHIND_M = 100.0  # how much of the flown reference is kept
FIRM_M = 60.0  # beyond this distance terrain hardly changes the plan
GAP_CELLS = 2.5  # a longer stretch without cells ends the known terrain
PER_SPAN = int(KNOT_M)  # path samples
HEIGHT_CHANGE_G = 0.15  # load that a change of set height takes at most


@dataclass(frozen=True)
class ReferenceParameters:
    """What the reference should be like; all tunable, acting beyond the committed stretch."""

    speed_mps: Annotated[float, Gt(0), "speed along the path"] = 30.0
    height_agl_m: Annotated[float, Gt(0), "height above ground"] = 10.0
    clearance_min_m: Annotated[
        float | None, Ge(0), "height above ground never planned below; none: 0.9 of the height"
    ] = None
    corridor_m: Annotated[
        float, Ge(0), "half width of the corridor searched for low gradient; 0: straight legs"
    ] = 0.0
    valley_weight_per_m: Annotated[float, Ge(0), "preference for low ground in the corridor"] = 0.0
    smoothing_m4: Annotated[float, Ge(0), "weight of the squared curvature of the altitude"] = 2e4
    slope_max_deg: Annotated[float, Gt(0), Lt(90), "flight-path angle"] = 35.0
    load_up_G: Annotated[float, Gt(0), "upward acceleration"] = 0.6
    load_down_G: Annotated[float, Gt(0), "downward acceleration"] = 0.5
    bank_max_deg: Annotated[float, Gt(0), Lt(90), "bank angle in turns"] = 30.0
    acceleration_mps2: Annotated[float, Gt(0), "along the path"] = 1.5
    deceleration_mps2: Annotated[float, Gt(0), "along the path"] = 2.0
    speed_min_mps: Annotated[float, Gt(0), "speed that limits never go below"] = 5.0
    commit_s: Annotated[float, Ge(0), "flight time ahead that is never planned again"] = 2.5
    reach_m: Annotated[float, Gt(0), "distance ahead that is always defined"] = 400.0


class Ramp(NamedTuple):
    """Set height (m) from ``before`` to ``after`` over ``length`` metres from ``station``."""

    station: float
    length: float
    before: float
    after: float


@dataclass(frozen=True)
class Reference:
    """The reference of one moment.

    ``lateral`` and ``altitude`` (spans + 3,) are B-spline coefficients (m) from span ``first_span``
    on, and ``path`` their samples. ``knot`` is where the last planning began: all before it is
    committed. ``known_until`` is the station up to which terrain was sensed, and ``origin`` that of
    the start. ``width`` is the corridor (:func:`controller.lateral.half_width`), ``height`` the set
    height over the station, ``last_count`` the map's count that it was planned over.
    """

    parameters: ReferenceParameters
    course: Course
    width: Array
    height: Ramp
    first_span: int
    knot: int
    lateral: Array
    altitude: Array
    path: Path
    known_until: float
    origin: float
    last_count: int
    status: Status


def start(
    course: Course,
    terrain_map: TerrainMap,
    parameters: ReferenceParameters,
    *,
    altitude: float,
    station: float = 0.0,
) -> Reference:
    """Return the first reference, over what is sensed around ``station`` on the course.

    It starts at the aircraft's ``altitude`` (m) where the ground below is not sensed. Where nothing
    is sensed at all it is level there, at the set speed, and :func:`extend` starts again.
    """
    knot = floor((station - BEHIND_M / 2) / KNOT_M)
    agl, speed = parameters.height_agl_m, parameters.speed_mps
    nothing = Reference(
        parameters=parameters,
        course=course,
        width=half_width(course, parameters.corridor_m),
        height=Ramp(station, 0.0, agl, agl),
        first_span=knot,
        knot=knot,
        lateral=np.zeros(3),
        altitude=np.full(3, altitude),
        path=Path(
            knot * KNOT_M, 1.0, *(np.array([x]) for x in (0.0, 0.0, altitude, 0.0, speed, 0.0))
        ),
        known_until=station,
        origin=station,
        last_count=0,
        status="blind",
    )
    return _plan(nothing, terrain_map, parameters, station, knot)


def extend(
    reference: Reference,
    terrain_map: TerrainMap,
    station: float,
    parameters: ReferenceParameters | None = None,
) -> Reference:
    """Return the reference continued over the terrain sensed since, for an aircraft at ``station``.

    ``parameters`` replace those it was planned with; a new set height is approached gradually.
    """
    new = reference.parameters if parameters is None else parameters
    path = reference.path
    if reference.known_until <= reference.origin:
        level = float(reference.altitude[0])
        return start(reference.course, terrain_map, new, altitude=level, station=station)
    nothing_new = terrain_map.last_count == reference.last_count and new == reference.parameters
    if nothing_new and path.start + path.north.size - 1 >= station + new.reach_m:
        return reference
    ahead = new.commit_s * float(sample(reference, [station]).speed[0])
    # the end of the known stretch is not firm yet, but what is flown is flown
    firm = floor((reference.known_until - FIRM_M) / KNOT_M)
    knot = max(min(ceil((station + ahead) / KNOT_M), firm), ceil(station / KNOT_M), reference.knot)
    last = reference.first_span + reference.altitude.size - 3
    return _plan(reference, terrain_map, new, station, min(knot, last))


def _plan(
    old: Reference,
    terrain_map: TerrainMap,
    parameters: ReferenceParameters,
    station: float,
    knot: int,
) -> Reference:
    """Return the reference planned again from station knot * KNOT_M on."""
    course, limits, s_0, at = old.course, _limits(parameters), knot * KNOT_M, knot - old.first_span
    turn_max = limits.side / limits.speed**2
    width = old.width
    if parameters.corridor_m != old.parameters.corridor_m:
        width = half_width(course, parameters.corridor_m)
    lateral = old.lateral[at : at + 3]
    if parameters.corridor_m > 0:
        weight = parameters.valley_weight_per_m
        new = plan_offsets(terrain_map, course, width, knot, lateral, turn_max, weight)
        lateral = np.concatenate((lateral, new))
    lateral = hold(lateral, LOOK_SPANS + 3, 0.0, 0.0, turn_max)

    gap = int(GAP_CELLS * terrain_map.cell_size / SAMPLE_M)
    ground = _ground_along(terrain_map, course, lateral, knot, gap)
    known_until = s_0 + (ground.size - 1) * SAMPLE_M if ground.size else old.known_until
    height = old.height
    if parameters.height_agl_m != height.after:
        height = _ramp(s_0, float(_height(height, s_0)), parameters)
    altitude, status = old.altitude[at : at + 3], "blind"
    if ground.size > 1:
        altitude, status = _plan_altitude(old, ground, height, parameters, station, at)
    # half as much again, so that an outage of the sensor does not plan again at every call
    end = max(known_until + BEHIND_M, station + 1.5 * parameters.reach_m)
    total = 3 + max(ceil((end - s_0) / KNOT_M), altitude.size - 3)
    altitude = hold(altitude, total, 0.0, np.inf, limits.up / limits.speed**2)
    lateral = hold(lateral, total, 0.0, 0.0, turn_max)[:total]

    north, east, z, heading, slope, bend, turn = _trace(course, lateral, altitude, knot)
    v_0 = float(old.path.speed[at * PER_SPAN])
    # with nothing sensed ever there is no end of the terrain to be careful of
    known = int(known_until - s_0) if known_until > old.origin else north.size
    speed = plan_speed(v_0, known, slope, bend, turn, limits)
    drop = min(max(floor((station - BEHIND_M) / KNOT_M) - old.first_span, 0), at)
    new_path = (north, east, z, heading, speed, slope)
    path = (
        np.concatenate((before[drop * PER_SPAN : at * PER_SPAN], after))
        for before, after in zip(old.path[2:], new_path, strict=True)
    )
    first_span = old.first_span + drop
    return Reference(
        parameters=parameters,
        course=course,
        width=width,
        height=height,
        first_span=first_span,
        knot=knot,
        lateral=np.concatenate((old.lateral[drop:at], lateral)),
        altitude=np.concatenate((old.altitude[drop:at], altitude)),
        path=Path(first_span * KNOT_M, 1.0, *path),
        known_until=known_until,
        origin=old.origin,
        last_count=terrain_map.last_count,
        status=status,
    )


def _plan_altitude(
    old: Reference,
    ground: Array,
    height: Ramp,
    parameters: ReferenceParameters,
    station: float,
    at: int,
) -> tuple[Array, Status]:
    """Return the altitude coefficients over sensed ground, kept ones first, and a status."""
    s_0 = (old.first_span + at) * KNOT_M
    limits = _limits(parameters)
    spans = ceil((ground.size - 1) / SAMPLES)
    h = np.full(spans * SAMPLES + 1, np.nan)
    h[: ground.size] = ground
    agl = _height(height, s_0 + SAMPLE_M * np.arange(h.size))
    lowest = parameters.clearance_min_m
    clearance = 0.9 * agl if lowest is None else np.minimum(lowest, agl)
    target = h + agl
    # nothing is committed before the first plan, so its start is free
    kept = old.altitude[at : at + (3 if at else 0)]
    if at == 0:
        _fill_start(target, round((station - s_0) / SAMPLE_M), float(old.altitude[0]))
    sensed = int(max(old.known_until - s_0, -1.0)) + 1
    planned = old.path.altitude[at * PER_SPAN :][:sensed][:: int(SAMPLE_M)][: h.size]
    before = np.full(h.size, np.nan)
    before[: planned.size] = planned
    v_0 = float(old.path.speed[at * PER_SPAN])
    speed = unhindered_speed(v_0, KNOT_M * np.arange(spans + 1.0), limits)
    new, status = plan_altitude(
        target, h + clearance, kept, before, limits, speed, parameters.smoothing_m4
    )
    return np.concatenate((kept, new)), status


def _limits(parameters: ReferenceParameters) -> Limits:
    return Limits(
        speed=parameters.speed_mps,
        speed_min=min(parameters.speed_min_mps, parameters.speed_mps),
        slope=tan(radians(parameters.slope_max_deg)),
        up=STANDARD_GRAVITY * parameters.load_up_G,
        down=STANDARD_GRAVITY * parameters.load_down_G,
        side=STANDARD_GRAVITY * tan(radians(parameters.bank_max_deg)),
        acceleration=parameters.acceleration_mps2,
        deceleration=parameters.deceleration_mps2,
    )


def _ramp(station: float, before: float, parameters: ReferenceParameters) -> Ramp:
    """Return the smooth step to the set height, long enough to take at most HEIGHT_CHANGE_G."""
    change = abs(parameters.height_agl_m - before)
    load = HEIGHT_CHANGE_G * STANDARD_GRAVITY / parameters.speed_mps**2
    return Ramp(station, (6 * change / load) ** 0.5, before, parameters.height_agl_m)


def _height(ramp: Ramp, station: ArrayLike) -> Array:
    t = np.clip((np.asarray(station) - ramp.station) / max(ramp.length, 1.0), 0.0, 1.0)
    return ramp.before + (ramp.after - ramp.before) * t * t * (3 - 2 * t)


def _fill_start(target: Array, start: int, altitude: float) -> None:
    """Fill the samples before the first sensed one: no forward sensor sees the ground at the start.

    They lie on the parabola through the aircraft's altitude at ``start`` and two sensed samples; a
    fit that ends in nothing would be off by z'' sqrt(lambda) there, half a metre and more.
    """
    sensed = np.flatnonzero(np.isfinite(target))
    first = sensed[0]
    x = np.array([start, first, min(first + SAMPLES, sensed[-1])])
    if start < x[1] < x[2]:
        before = np.arange(first)
        target[:first] = np.polyval(np.polyfit(x, [altitude, *target[x[1:]]], 2), before)


@kernel
def _ground_along(
    terrain_map: TerrainMap, course: Course, lateral: Array, knot: int, gap: int
) -> Array:
    """Return the elevation (m) every SAMPLE_M up to the last sensed sample, or nothing.

    NaN before the first sensed sample; later gaps of up to ``gap`` samples are bridged by a line.
    """
    n = (lateral.size - 3) * SAMPLES
    h = np.full(n, np.nan)
    last = -1
    for k in range(n):
        if last >= 0 and k - last > gap:
            break
        i = k // SAMPLES
        offset = evaluate(lateral, i, weights(k / SAMPLES - i))
        north, east = position(course, knot * KNOT_M + k * SAMPLE_M, offset)
        h[k] = height_and_slope(terrain_map, north, east)[0]
        if np.isnan(h[k]):
            continue
        if last >= 0:
            for j in range(last + 1, k):
                h[j] = h[last] + (h[k] - h[last]) * (j - last) / (k - last)
        last = k
    return h[: last + 1]


@kernel
def _trace(
    course: Course, lateral: Array, altitude: Array, knot: int
) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """Return north, east, altitude (m), heading, slope, z'', ground curvature every metre."""
    spans = altitude.size - 3
    n = spans * PER_SPAN + 1
    out = np.empty((7, n))
    for k in range(n):
        i = min(k // PER_SPAN, spans - 1)
        t = k / PER_SPAN - i
        l = evaluate(lateral, i, weights(t))
        l_s = evaluate(lateral, i, slope_weights(t))
        s = knot * KNOT_M + k
        out[0, k], out[1, k] = position(course, s, l)
        out[2, k] = evaluate(altitude, i, weights(t))
        c = min(max(int(s - course.first), 0), course.heading.size - 1)
        out[3, k] = course.heading[c] + np.arctan2(l_s, 1.0 - course.curvature[c] * l)
        out[4, k] = evaluate(altitude, i, slope_weights(t))
        out[5, k] = evaluate(altitude, i, curvature_weights(t))
    for k in range(n - 1):
        distance = np.hypot(out[0, k + 1] - out[0, k], out[1, k + 1] - out[1, k])
        out[6, k] = (out[3, k + 1] - out[3, k]) / distance
    out[6, n - 1] = 0.0
    return out[0], out[1], out[2], out[3], out[4], out[5], out[6]


def sample(reference: Reference, stations: ArrayLike) -> Samples:
    """Return the reference at stations (K,) in metres; beyond its ends it goes straight on."""
    return sample_path(reference.path, np.ascontiguousarray(stations, float))
