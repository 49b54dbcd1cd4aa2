"""Inertial NED and body FRD, as everything here flies, to the ENU and FLU of the viewers.

The only place where a recording changes frames. `map` is ENU (x east, y north, z up), `heli` FLU
(x forward, y left, z up); both are right-handed.
"""

from math import cos, sin, sqrt
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Length = TypeVar("Length", float, NDArray[np.float64])

MAP = "map"
BODY = "heli"
CONVENTION = "map: ENU, z up, right-handed; heli: FLU; signals: NED and FRD"

_HALF = 1.0 / sqrt(2.0)


def ned_to_enu(north: Length, east: Length, down: Length) -> tuple[Length, Length, Length]:
    """Return the position (x, y, z) in m in ENU of a point in NED, scalar or array."""
    return east, north, -down


def orientation(phi: float, theta: float, psi: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion (x, y, z, w) that turns FLU into ENU.

    Parameters
    ----------
    phi, theta, psi
        3-2-1 Euler angles from NED to FRD in rad: roll, pitch, heading.

    Notes
    -----
    With R the matrix FRD -> NED, this is the quaternion of A R B, where A = NED -> ENU is half a
    turn about (1, 1, 0) and B = FLU -> FRD half a turn about x. Multiplied out on the quaternion
    (w, x, y, z) of R that is (w + z, x + y, x - y, w - z) / sqrt(2).
    """
    cr, sr = cos(0.5 * phi), sin(0.5 * phi)
    cp, sp = cos(0.5 * theta), sin(0.5 * theta)
    cy, sy = cos(0.5 * psi), sin(0.5 * psi)
    w = cr * cp * cy + sr * sp * sy
    x = sr * cp * cy - cr * sp * sy
    y = cr * sp * cy + sr * cp * sy
    z = cr * cp * sy - sr * sp * cy
    return _HALF * (x + y), _HALF * (x - y), _HALF * (w - z), _HALF * (w + z)
