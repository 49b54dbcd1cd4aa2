"""The lateral offset from the course: least terrain gradient through a corridor, then smoothed.

The paper asks for "a spline that elicits the lowest gradient over the prediction horizon" between
way-points (section III) and does not say how. Ours, after the dynamic programming of NASA's terrain
following / terrain avoidance guidance: stations every KNOT_M, offsets every LANE_M, and

    min sum_k [ (dh_k / dd_k)^2 + w_t (dl_k / ds)^2 + w_l (l_k / W)^2 + w_h (h_k - h_0) ] dd_k
    dd_k = hypot(ds, dl_k),   |dl_k| <= 2 lanes

solved exactly on the grid, then a smoothing spline through its stations.
"""

import numpy as np
from numpy.typing import NDArray

from controller.course import Course, position
from controller.jit import kernel
from controller.spline import (
    KNOT_M,
    normal_equations,
)
from controller.terrain_map import TerrainMap, height_and_slope

Array = NDArray[np.float64]

LANE_M = 5.0
STATIONS = 25
NARROWING, SETTLING_M = 0.25, 100.0
# costs per metre, above any squared gradient: of not knowing it, and of a lane outside the corridor
UNSENSED, OUTSIDE = 0.5, 1.0
# lambda (m^4) of the offsets, doubled until the curvature is within its limit
SMOOTHING, DOUBLINGS = 6e6, 12


def half_width(course: Course, corridor_m: float) -> Array:
    """Return the corridor's half width W (m) at every course sample, (K,).

    It is 0 where the course turns, since the arcs already use the whole bank angle, before the
    start and beyond the goal. It narrows towards these by NARROWING metres per metre, and is closed
    SETTLING_M before them.
    """
    station = course.first + np.arange(course.north.size)
    closed = (course.curvature != 0) | (station <= 0) | (station >= course.goal)
    width = np.where(closed, -NARROWING * SETTLING_M, corridor_m)
    ramp = NARROWING * station
    ahead = np.minimum.accumulate((width + ramp)[::-1])[::-1] - ramp
    return np.maximum(np.minimum(ahead, np.minimum.accumulate(width - ramp) + ramp), 0.0)


def plan_offsets(
    terrain_map: TerrainMap,
    course: Course,
    width: Array,
    knot: int,
    kept: Array,
    curvature_max: float,
    valley_weight: float = 0.0,
) -> Array:
    """Return the offset coefficients (spans,) that follow ``kept`` (3,), over sensed terrain.

    ``kept`` fixes offset, slope and curvature at station knot * KNOT_M; ``width`` is from
    :func:`half_width`; the path's curvature stays within ``curvature_max`` (1/m) where ``kept``
    allows it. ``valley_weight`` is w_h (1/m): above 0 seeks low ground.
    """
    start = (kept[0] + 4 * kept[1] + kept[2]) / 6
    slope = (kept[2] - kept[0]) / (2 * KNOT_M)
    offsets = least_gradient(
        terrain_map, course, width, knot * KNOT_M, start, slope, valley_weight=valley_weight
    )
    new = np.empty(0)
    for doubling in range(DOUBLINGS):
        H, f = normal_equations(kept, offsets, 1, SMOOTHING * 2.0**doubling)
        new = np.linalg.solve(H, -f)
        bend = np.diff(np.concatenate((kept[1:], new)), n=2) / KNOT_M**2
        if np.abs(bend).max() <= curvature_max:
            break
    return new


def least_gradient(
    terrain_map: TerrainMap,
    course: Course,
    width: Array,
    station: float,
    offset: float,
    slope: float,
    tangent_weight: float = 0.02,
    offset_weight: float = 4e-3,
    valley_weight: float = 0.0,
    stations: int = STATIONS,
) -> Array:
    """Return the offsets (stations + 1,) of least cost, KNOT_M apart, the first one given.

    The first step stays within a lane of the given slope. Leaving the corridor costs OUTSIDE a
    lane; leaving the sensed terrain UNSENSED, so that beyond it the path still obeys the corridor.
    ``offset_weight``, small against any gradient, lets it drift back over flat ground.
    """
    lanes = int(max(float(width.max()), abs(offset + slope * KNOT_M)) // LANE_M) + 1
    return _viterbi(
        terrain_map,
        course,
        width,
        station,
        offset,
        slope,
        lanes,
        stations,
        tangent_weight,
        offset_weight / max(float(width.max()), LANE_M) ** 2,
        valley_weight,
    )


@kernel
def _viterbi(
    terrain_map: TerrainMap,
    course: Course,
    width: Array,
    station: float,
    offset: float,
    slope: float,
    lanes: int,
    stations: int,
    w_t: float,
    w_l: float,
    w_h: float,
) -> Array:
    n = 2 * lanes + 1
    parent = np.zeros((stations + 1, n), np.int64)
    cost, h = np.full((stations + 1, n), np.inf), np.full((stations + 1, n), np.nan)
    north, east = position(course, station, offset)
    h_0 = height_and_slope(terrain_map, north, east)[0]
    datum = 0.0 if np.isnan(h_0) else h_0
    for k in range(1, stations + 1):
        s = station + k * KNOT_M
        W = width[min(max(int(s - course.first), 0), width.size - 1)]
        for j in range(n):
            l = (j - lanes) * LANE_M
            north, east = position(course, s, l)
            h[k, j] = height_and_slope(terrain_map, north, east)[0]
            outside = max(abs(l) - W, 0.0) / LANE_M
            here = w_l * l * l + OUTSIDE * outside * outside
            here += UNSENSED if np.isnan(h[k, j]) else w_h * (h[k, j] - datum)
            # the nearest lanes first: of equal costs the straightest step wins
            for step in (0, -1, 1, -2, 2):
                i = j + step
                paid, dl, dh = 0.0, l - offset, h[k, j] - h_0
                if k > 1 and 0 <= i < n:
                    paid, dl, dh = cost[k - 1, i], -step * LANE_M, h[k, j] - h[k - 1, i]
                elif k > 1 or step or abs(dl - slope * KNOT_M) > LANE_M:
                    continue
                dd = np.sqrt(KNOT_M * KNOT_M + dl * dl)
                gradient = 0.0 if np.isnan(dh) else dh / dd
                tangent = dl / KNOT_M
                total = paid + dd * (gradient * gradient + w_t * tangent * tangent + here)
                if total < cost[k, j]:
                    cost[k, j], parent[k, j] = total, i
    offsets = np.empty(stations + 1)
    offsets[0] = offset
    j = np.argmin(cost[stations])
    for k in range(stations, 0, -1):
        offsets[k] = (j - lanes) * LANE_M
        j = parent[k, j]
    return offsets
