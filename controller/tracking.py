"""How far a predicted flight is from its reference: targets, errors and the true nonlinear cost.

The reference is a path in space, not a point that runs ahead of the aircraft. Along a prediction

* north and east aim at a point that starts abeam of the aircraft and moves at the reference speed,
* altitude, heading and speed are compared with the path *where the aircraft then is*: its station is
  found on the nominal prediction, and moves with the position along the path's tangent.

So the altitude error is ``e = altitude - z(s)``, and since ds = t.(dN, dE), its response to the
coefficients is that of the altitude minus z'(s) times that of the station.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.jit import kernel
from controller.reference import Path, project, sample_path
from controller.terrain_map import TerrainMap, height_and_slope

Floats = NDArray[np.float64]


class Targets(NamedTuple):
    """What the samples of a prediction should be, each (H,), on the nominal path's stations."""

    nominal_north: Floats
    nominal_east: Floats
    station: Floats
    north: Floats
    east: Floats
    altitude: Floats
    slope: Floats
    heading: Floats
    speed: Floats
    tangent_north: Floats
    tangent_east: Floats


class Weights(NamedTuple):
    """Q over north, east, altitude, heading, speed; R over the actuators; Rc over the commands."""

    Q: tuple[float, float, float, float, float]
    R: tuple[float, float, float, float]
    Rc: tuple[float, float, float, float]
    attitude_limit: float
    heading_limit: float
    clearance: float
    rho1: float
    rho2: float


@kernel
def _stations(path: Path, north: Floats, east: Floats, near: float) -> Floats:
    """Return the stations abeam of successive positions."""
    out = np.empty(north.shape[0])
    for k in range(north.shape[0]):
        near = project(path, north[k], east[k], near)
        out[k] = near
    return out


@kernel
def advance(path: Path, station: float, period: float, number: int) -> Floats:
    """Return the stations (number,) after 1, 2, ... sample periods (s) at the reference speed."""
    out = np.empty(number)
    for m in range(number):
        k = min(max(int(np.floor((station - path.start) / path.spacing)), 0), path.north.size - 2)
        slope = path.slope[k]
        station += path.speed[k] * period / np.sqrt(1.0 + slope * slope)
        out[m] = station
    return out


def on_branch(heading: Floats, measured: float) -> Floats:
    """Return unwrapped headings (K,), rad, moved by whole turns: the first is near ``measured``."""
    return heading + 2.0 * np.pi * np.round((measured - heading[0]) / (2.0 * np.pi))


def targets(
    path: Path, north: Floats, east: Floats, near: float, period: float, heading: float
) -> Targets:
    """Return the targets of a nominal prediction.

    Parameters
    ----------
    north, east : (H,)
        Nominal positions at the ends of the samples, m.
    near : float
        A guess of the first station, m.
    period : float
        Sample period, s.
    heading : float
        Measured heading, rad: chooses the reference's branch, so that a *planned* spin is never
        cheap and a spin that has happened is forgiven.
    """
    station = _stations(path, north, east, near)
    ahead = advance(path, station[0], period, len(station) - 1)
    at = sample_path(path, station)
    goal = sample_path(path, np.concatenate([station[:1], ahead]))
    return Targets(
        nominal_north=north,
        nominal_east=east,
        station=station,
        north=goal.north,
        east=goal.east,
        altitude=at.altitude,
        slope=at.slope,
        heading=on_branch(at.heading, heading),
        speed=at.speed,
        tangent_north=np.cos(at.heading),
        tangent_east=np.sin(at.heading),
    )


@kernel
def _altitude(path: Path, station: float) -> float:
    x = (station - path.start) / path.spacing
    k = min(max(int(np.floor(x)), 0), path.altitude.shape[0] - 2)
    return path.altitude[k] + (x - k) * (path.altitude[k + 1] - path.altitude[k])


@kernel
def _costs(
    Y: Floats,
    rows: NDArray[np.int64],
    commands: Floats,
    aim: Floats,
    actuators: Floats,
    command_aim: Floats,
    path: Path,
    weights: Weights,
    terrain_map: TerrainMap,
    every: int,
    out: Floats,
) -> None:
    Q, R, Rc = weights.Q, weights.R, weights.Rc
    for n in range(Y.shape[2]):
        J = 0.0
        sigma = 0.0
        excess = 0.0
        for k in range(Y.shape[1]):
            north, east = Y[rows[0], k, n], Y[rows[1], k, n]
            s = aim[2, k] + aim[9, k] * (north - aim[0, k]) + aim[10, k] * (east - aim[1, k])
            e_n = north - aim[3, k]
            e_e = east - aim[4, k]
            e_z = Y[rows[2], k, n] - _altitude(path, s)
            e_psi = Y[rows[3], k, n] - aim[7, k]
            e_v = Y[rows[4], k, n] - aim[8, k]
            J += Q[0] * e_n * e_n + Q[1] * e_e * e_e + Q[2] * e_z * e_z
            J += Q[3] * e_psi * e_psi + Q[4] * e_v * e_v
            for c in range(4):
                e_a = Y[rows[7 + c], k, n] - actuators[c]
                e_c = commands[n, k, c] - command_aim[c, k]
                J += R[c] * e_a * e_a + Rc[c] * e_c * e_c
            tilt = max(abs(Y[rows[5], k, n]), abs(Y[rows[6], k, n]))
            excess = max(excess, tilt - weights.attitude_limit)
            excess = max(excess, abs(e_psi) - weights.heading_limit)
            if (k + 1) % every == 0:
                h, _, _ = height_and_slope(terrain_map, north, east)
                short = weights.clearance - (Y[rows[2], k, n] - h)
                if short > sigma:  # false where not sensed
                    sigma = short
        out[0, n] = J
        out[1, n] = sigma
        out[2, n] = J + 2.0 * weights.rho1 * sigma + weights.rho2 * sigma * sigma + 1e4 * excess


def costs(
    Y: Floats,
    rows: NDArray[np.int64],
    commands: Floats,
    aim: Targets,
    actuators: Floats,
    command_aim: Floats,
    path: Path,
    weights: Weights,
    terrain_map: TerrainMap,
    every: int,
) -> Floats:
    """Return (J without penalty, slack m, merit) of N true rollouts, (3, N).

    The merit adds the exact penalty of the clearance slack, as the quadratic programme has it, and
    1e4 per radian beyond the limits of attitude and heading deviation.

    Parameters
    ----------
    Y : (p, H, N)
        Outputs; ``rows`` (11,) are those of north, east, altitude, heading, speed, roll, pitch and the
        four actuators.
    commands : (N, H, 4)
        What was flown.
    actuators : (4,)
        Trim that R pulls to.
    command_aim : (4, H)
        Commands that Rc pulls to.
    every : int
        Clearance is looked up at every which sample.
    """
    out = np.empty((3, Y.shape[2]))
    _costs(
        Y,
        rows,
        commands,
        np.stack(aim),
        actuators,
        command_aim,
        path,
        weights,
        terrain_map,
        every,
        out,
    )
    return out
