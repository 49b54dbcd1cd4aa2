"""The course over the ground, and the path in space that is flown along it.

The course is straight legs between way-points, joined by circular arcs. A station s is the distance
flown along it, 0 at the first way-point; an offset l is to the right of it. It is straight before
the first and beyond the last way-point, so that an aircraft a little behind the start, or flying on
past the goal, still has a course. A path is the reference sampled over the same stations.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.jit import kernel

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
LEAD_IN_M = 200
_Piece = tuple[float, float, float]  # length (m), heading at its start (rad), curvature (1/m)


class Course(NamedTuple):
    """Samples (K,) every metre: positions north, east (m), heading (rad, unwrapped), curvature.

    ``first`` is the station of the first sample and ``goal`` that of the last way-point, in metres.
    Curvature is in 1/m, positive in a right turn.
    """

    first: float
    goal: float
    north: Array
    east: Array
    heading: Array
    curvature: Array


class Path(NamedTuple):
    """The reference at even stations, ``spacing`` metres apart from ``start`` on, arrays (K,).

    North, east and altitude in metres; heading of the path (rad, unwrapped), offset included; speed
    along the path in m/s; slope dz/ds.
    """

    start: float
    spacing: float
    north: Array
    east: Array
    altitude: Array
    heading: Array
    speed: Array
    slope: Array


class Samples(NamedTuple):
    """The reference at given stations, arrays (K,), as in :class:`Path`."""

    north: Array
    east: Array
    altitude: Array
    heading: Array
    speed: Array
    slope: Array


def turn_radius(speed_mps: float, bank_deg: float) -> float:
    """Return the radius (m) of a level turn, V^2 / (g tan(bank))."""
    return speed_mps**2 / (STANDARD_GRAVITY * math.tan(math.radians(bank_deg)))


def make_course(
    waypoints: Sequence[tuple[float, float]],
    speed_mps: float,
    bank_max_deg: float = 30.0,
    beyond_m: float = 2000.0,
) -> Course:
    """Return the course through way-points (north, east) in metres.

    Corners are rounded with the radius of a level turn at ``speed_mps`` and ``bank_max_deg``, so
    the course passes inside its way-points; the first and the last lie on it. It continues for
    ``beyond_m`` past the last.

    Raises
    ------
    ValueError
        If there are fewer than two way-points, two in succession coincide, or the legs beside a
        corner are too short for its arc.
    """
    points = np.asarray(waypoints, float)
    if points.ndim != 2 or points.shape[0] < 2 or points.shape[1] != 2:
        msg = f"way-points: no course, got shape {points.shape}, expected 2 or more (north, east)"
        raise ValueError(msg)
    if not np.isfinite(points).all():
        msg = f"way-points: not a position, got {points.tolist()}, expected finite metres"
        raise ValueError(msg)
    pieces = _pieces(points, turn_radius(speed_mps, bank_max_deg), beyond_m)
    goal = sum(length for length, _, _ in pieces) - LEAD_IN_M - beyond_m
    start = points[0] - LEAD_IN_M * np.array([math.cos(pieces[0][1]), math.sin(pieces[0][1])])
    return _sample(pieces, goal, start)


def _pieces(points: Array, radius: float, beyond_m: float) -> list[_Piece]:
    """Return straight lines and arcs in turn, lead-in and continuation included."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    for i in np.flatnonzero(lengths == 0):
        msg = f"way-point {i + 1}: no leg leads to it, got {points[i + 1].tolist()} m twice"
        raise ValueError(msg + ", expected another position")
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turns = np.diff(headings)
    # the tangent from a corner to where its arc begins; the first and last way-point have none
    tangents = np.concatenate(([0.0], radius * np.tan(np.abs(turns) / 2), [0.0]))
    for i, length in enumerate(lengths):
        needed = tangents[i] + tangents[i + 1]
        if needed > length:
            corner = i if tangents[i] > tangents[i + 1] else i + 1
            turn = math.degrees(abs(turns[corner - 1]))
            msg = (
                f"way-point {corner}: no room for a turn of {turn:.0f} deg at a radius of"
                f" {radius:.1f} m, got a leg of {length:.1f} m between way-points {i} and {i + 1},"
                f" expected {needed:.4g} m or more"
            )
            raise ValueError(msg)
    straights = lengths - tangents[:-1] - tangents[1:]
    straights[0] += LEAD_IN_M
    straights[-1] += beyond_m
    pieces: list[_Piece] = [(straights[0], headings[0], 0.0)]
    for turn, straight, before, after in zip(
        turns, straights[1:], headings[:-1], headings[1:], strict=True
    ):
        pieces.append((radius * abs(turn), before, math.copysign(1 / radius, turn)))
        pieces.append((straight, after, 0.0))
    return pieces


def _sample(pieces: list[_Piece], goal: float, start: Array) -> Course:
    """Return the samples, each exact on its line or arc."""
    length, heading, curvature = (np.array(column) for column in zip(*pieces, strict=True))
    begin = np.concatenate(([0.0], np.cumsum(length)))
    corners = start + np.concatenate(
        (np.zeros((1, 2)), np.cumsum(_chord(length, heading, curvature), axis=0))
    )
    station = np.arange(math.floor(begin[-1]) + 1.0)
    piece = np.minimum(np.searchsorted(begin, station, side="right") - 1, len(pieces) - 1)
    along = station - begin[piece]
    position = corners[piece] + _chord(along, heading[piece], curvature[piece])
    return Course(
        first=-float(LEAD_IN_M),
        goal=goal,
        north=np.ascontiguousarray(position[:, 0]),
        east=np.ascontiguousarray(position[:, 1]),
        heading=heading[piece] + curvature[piece] * along,
        curvature=curvature[piece],
    )


def _chord(length: Array, heading: Array, curvature: Array) -> Array:
    """Return the displacement (K, 2) along an arc: its chord, at half its turn."""
    half = curvature * length / 2
    chord = length * np.sinc(half / np.pi)
    return np.stack((chord * np.cos(heading + half), chord * np.sin(heading + half)), axis=-1)


@kernel
def position(course: Course, station: float, offset: float) -> tuple[float, float]:
    """Return north, east (m) at a station and an offset to the right, held straight at the ends."""
    x = station - course.first
    k = min(max(int(np.floor(x)), 0), course.north.size - 2)
    t = x - k
    heading = course.heading[k] + min(max(t, 0.0), 1.0) * (
        course.heading[k + 1] - course.heading[k]
    )
    north = course.north[k] + t * (course.north[k + 1] - course.north[k])
    east = course.east[k] + t * (course.east[k + 1] - course.east[k])
    return north - offset * np.sin(heading), east + offset * np.cos(heading)


@kernel
def _between(path: Path, station: float) -> tuple[int, float]:
    k = min(max(int(np.floor(station - path.start)), 0), path.north.size - 2)
    return k, station - path.start - k


@kernel
def sample_path(path: Path, stations: Array) -> Samples:
    """Return the samples at stations (K,), linear between metres; held straight at the ends."""
    n = stations.size
    out = np.empty((6, n))
    for m in range(n):
        k, t = _between(path, stations[m])
        inside = min(max(t, 0.0), 1.0)
        out[0, m] = path.north[k] + t * (path.north[k + 1] - path.north[k])
        out[1, m] = path.east[k] + t * (path.east[k + 1] - path.east[k])
        out[2, m] = path.altitude[k] + t * (path.altitude[k + 1] - path.altitude[k])
        out[3, m] = path.heading[k] + inside * (path.heading[k + 1] - path.heading[k])
        out[4, m] = path.speed[k] + inside * (path.speed[k + 1] - path.speed[k])
        out[5, m] = path.slope[k] + inside * (path.slope[k + 1] - path.slope[k])
    return Samples(out[0], out[1], out[2], out[3], out[4], out[5])


@kernel
def project(path: Path, north: float, east: float, near: float) -> float:
    """Return the station of the path's point nearest to a position, searched from ``near``.

    The search walks along the path while it comes nearer, so it does not jump to another leg that
    passes close by. The ends are held straight, as in :func:`sample_path`.
    """
    k, _ = _between(path, near)
    walked = 0
    while True:
        d_north, d_east = path.north[k + 1] - path.north[k], path.east[k + 1] - path.east[k]
        length = d_north * d_north + d_east * d_east
        t = ((north - path.north[k]) * d_north + (east - path.east[k]) * d_east) / length
        if t > 1.0 and k < path.north.size - 2 and walked >= 0:
            k, walked = k + 1, 1
        elif t < 0.0 and k > 0 and walked <= 0:
            k, walked = k - 1, -1
        else:
            break
    # a walk that would turn back has passed the nearest point: it is the corner between
    if (walked > 0 and t < 0.0) or (walked < 0 and t > 1.0):
        t = min(max(t, 0.0), 1.0)
    return path.start + k + t
