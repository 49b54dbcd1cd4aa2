"""How far a flight was from its reference, tick by tick."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Samples = tuple[Array, NDArray[Any]]  # times, s, and values

POSE = ("north", "east", "down", "psi")
VELOCITY = ("north", "east", "down")
REFERENCE = ("north", "east", "altitude", "heading", "speed")


@dataclass(frozen=True)
class Deviation:
    """How far a flight was from its reference, at every tick of the pose.

    Attributes
    ----------
    time : (n,) s
    height : (n,) m, altitude minus reference altitude
    cross_track : (n,) m, positive to the right of the course
    speed : (n,) m/s, magnitude of the velocity minus reference speed
    heading : (n,) rad, within -pi and pi
    north, east, altitude : (n,) m, the nearest point of the reference

    All are NaN before the first reference.
    """

    time: Array
    height: Array
    cross_track: Array
    speed: Array
    heading: Array
    north: Array
    east: Array
    altitude: Array


def deviation(
    pose: Mapping[str, Samples], velocity: Mapping[str, Samples], reference: Mapping[str, Samples]
) -> Deviation:
    """Return how far a flight was from the newest reference published at or before every tick.

    The position is projected on the nearest segment of the reference's polyline, between whose
    posts altitude, speed and (unwrapped) heading are linear. A missing signal leaves NaN.
    """
    time = pose["north"][0]
    north, east, down, psi = (held(pose[name], time) for name in POSE)
    speed = np.sqrt(sum(held(velocity[name], time) ** 2 for name in VELOCITY))
    nominal = np.full((len(REFERENCE), len(time)), np.nan)
    cross_track = np.full(len(time), np.nan)
    if all(len(reference[name][0]) for name in REFERENCE):
        times = reference["north"][0]
        newest = np.searchsorted(times, time, side="right") - 1
        for k in np.unique(newest[newest >= 0]):
            ticks = newest == k
            course = {name: reference[name][1][k] for name in REFERENCE}
            segment, fraction, cross_track[ticks] = project(
                north[ticks], east[ticks], course["north"], course["east"]
            )
            for row, name in enumerate(REFERENCE):
                post = course[name]
                nominal[row, ticks] = post[segment] + fraction * (post[segment + 1] - post[segment])
    reference_north, reference_east, altitude, heading, course_speed = nominal
    return Deviation(
        time=time,
        height=-down - altitude,
        cross_track=cross_track,
        speed=speed - course_speed,
        heading=(psi - heading + np.pi) % (2 * np.pi) - np.pi,
        north=reference_north,
        east=reference_east,
        altitude=altitude,
    )


def project(
    north: Array, east: Array, post_north: Array, post_east: Array
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the nearest points of a polyline.

    Parameters
    ----------
    north, east : (n,)
        Positions, m.
    post_north, post_east : (m,)
        The polyline's posts, m, at least two; a NaN takes its segments away.

    Returns
    -------
    segment, fraction : (n,)
        The nearest point lies this fraction of the way from post `segment` to the next.
    distance : (n,) m
        Positive to the right of the segment's direction.
    """
    along_n, along_e = np.diff(post_north), np.diff(post_east)
    length2 = along_n**2 + along_e**2
    from_n = north[:, None] - post_north[:-1]
    from_e = east[:, None] - post_east[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = (from_n * along_n + from_e * along_e) / length2
    fraction = np.where(length2 == 0.0, 0.0, np.clip(fraction, 0.0, 1.0))
    distance = np.hypot(from_n - fraction * along_n, from_e - fraction * along_e)
    segment = np.argmin(np.where(np.isnan(distance), np.inf, distance), axis=1)
    row = np.arange(len(north))
    right = along_n[segment] * from_e[row, segment] - along_e[segment] * from_n[row, segment]
    return segment, fraction[row, segment], np.copysign(distance[row, segment], right)


def held(samples: Samples, times: Array) -> Array:
    """Return the newest values at the given times, NaN before the first."""
    newest = np.searchsorted(samples[0], times, side="right") - 1
    if not len(samples[0]):
        return np.full(len(times), np.nan)
    return np.where(newest >= 0, samples[1][newest], np.nan)
