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
from controller.terrain_map import TerrainMap, height_and_slope

Floats = NDArray[np.float64]


class Path(NamedTuple):
    """The reference as a polyline of K points, evenly spaced in station.

    ``start`` and ``spacing`` in m; north, east, altitude (m), heading of the path (rad, unwrapped)
    and speed (m/s), each (K,).
    """

    start: float
    spacing: float
    north: Floats
    east: Floats
    altitude: Floats
    heading: Floats
    speed: Floats


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
    clearance: float
    rho1: float
    rho2: float


@kernel()
def _interpolate(values: Floats, x: float) -> tuple[float, float]:
    """Return the value at fractional index x and its slope per index; held beyond the ends."""
    last = values.shape[0] - 2
    i = min(max(int(np.floor(x)), 0), last)
    t = min(max(x - i, 0.0), 1.0)
    slope = values[i + 1] - values[i]
    return values[i] + t * slope, slope


@kernel()
def _abeam(path: Path, north: float, east: float, near: float) -> float:
    """Return the station whose normal passes through a point, by Newton's steps from ``near``."""
    s = near
    for _ in range(3):
        x = (s - path.start) / path.spacing
        n, dn = _interpolate(path.north, x)
        e, de = _interpolate(path.east, x)
        square = dn * dn + de * de
        s += path.spacing * ((north - n) * dn + (east - e) * de) / square
    return s


@kernel()
def _targets(
    path: Path, north: Floats, east: Floats, near: float, period: float, out: Floats
) -> None:
    station = _abeam(path, north[0], east[0], near)
    goal = station
    for k in range(north.shape[0]):
        if k > 0:
            move = np.hypot(north[k] - north[k - 1], east[k] - east[k - 1])
            station = _abeam(path, north[k], east[k], station + move)
        x = (station - path.start) / path.spacing
        g = (goal - path.start) / path.spacing
        altitude, rise = _interpolate(path.altitude, x)
        _, dn = _interpolate(path.north, x)
        _, de = _interpolate(path.east, x)
        length = np.hypot(dn, de)
        out[0, k] = station
        out[1, k] = _interpolate(path.north, g)[0]
        out[2, k] = _interpolate(path.east, g)[0]
        out[3, k] = altitude
        out[4, k] = rise / path.spacing
        out[5, k] = _interpolate(path.heading, x)[0]
        out[6, k] = _interpolate(path.speed, x)[0]
        out[7, k] = dn / length
        out[8, k] = de / length
        speed, _ = _interpolate(path.speed, g)
        _, rise = _interpolate(path.altitude, g)
        slope = rise / path.spacing
        goal += speed * period / np.sqrt(1.0 + slope * slope)


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
    out = np.empty((9, north.shape[0]))
    _targets(path, north, east, near, period, out)
    turns = np.round((heading - out[5, 0]) / (2.0 * np.pi))
    out[5] += 2.0 * np.pi * turns
    return Targets(north, east, *out)


@kernel()
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
            z, _ = _interpolate(path.altitude, (s - path.start) / path.spacing)
            e_n = north - aim[3, k]
            e_e = east - aim[4, k]
            e_z = Y[rows[2], k, n] - z
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
    1e4 per radian beyond the attitude limit.

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
