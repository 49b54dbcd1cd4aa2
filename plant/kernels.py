"""The compiled kernels: rollouts of either plant, their tangents, and single derivatives.

The named functions are thin on purpose: numba's cache tells kernels apart by name and line, so each
plant's rollout needs a ``def`` of its own. The constants come as an array and are spread here: out of
a named tuple numba takes sixty objects one by one, at every call.
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

import math
from typing import Any

from numba.np.unsafe.ndarray import to_fixed_tuple

from plant import dynamics, lanes, tangent, terrain
from plant.dynamics import NO_GROUND
from plant.elementary import COMPILED, compiled, inject, inline
from plant.jit import kernel
from plant.r50 import Constants

_dynamics = compiled(dynamics)
_shared = {**COMPILED, **_dynamics, "height": terrain.height}
_thrust = inject(lanes, _shared, inline)
_collective = inject(lanes, {**_shared, "derivative": _dynamics["derivative_collective"]}, inline)
_roll_thrust = _thrust["roll"]
_roll_collective = _collective["roll"]
_height = terrain.height
_actuators = _dynamics["actuators"]
_collective_thrust = _dynamics["collective_thrust"]
_derivative_thrust = _dynamics["derivative"]
_derivative_collective = _dynamics["derivative_collective"]
_STILL = (0.0, 0.0, 0.0)
_CONSTANTS = len(Constants._fields)
_tuple: Any = to_fixed_tuple  # numba passes it one argument more


@kernel
def roll_thrust(x0, commands, wind, bias, constants, h, substeps, ground, grid, out, last, valid):
    """:func:`plant.lanes.roll` of the thrust-commanded plant, with arrays for tuples."""
    p = Constants(*_tuple(constants, _CONSTANTS))
    air, push = _tuple(wind, 3), _tuple(bias, 3)
    _roll_thrust(x0, commands, air, push, p, h, substeps, ground, grid, out, last, valid)


@kernel
def roll_collective(
    x0, commands, wind, bias, constants, h, substeps, ground, grid, out, last, valid
):
    """:func:`plant.lanes.roll` of the collective plant, with arrays for tuples."""
    p = Constants(*_tuple(constants, _CONSTANTS))
    air, push = _tuple(wind, 3), _tuple(bias, 3)
    _roll_collective(x0, commands, air, push, p, h, substeps, ground, grid, out, last, valid)


_walk_thrust = inject(tangent, {"roll": roll_thrust}, inline)["walk"]
_walk_collective = inject(tangent, {"roll": roll_collective}, inline)["walk"]


@kernel
def walk_thrust(x0, commands, wind, bias, constants, h, substeps, ground, grid, y, slopes, valid):
    """:func:`plant.tangent.walk` of the thrust-commanded plant, with arrays for tuples."""
    _walk_thrust(x0, commands, wind, bias, constants, h, substeps, ground, grid, y, slopes, valid)


@kernel
def walk_collective(
    x0, commands, wind, bias, constants, h, substeps, ground, grid, y, slopes, valid
):
    """:func:`plant.tangent.walk` of the collective plant, with arrays for tuples."""
    _walk_collective(
        x0, commands, wind, bias, constants, h, substeps, ground, grid, y, slopes, valid
    )


@kernel
def derivative_thrust(x, u, wind, ground, bias, p):
    """:func:`plant.dynamics.derivative`, compiled."""
    return _derivative_thrust(x, u, wind, ground, bias, p)


@kernel
def derivative_collective(x, u, wind, ground, bias, p):
    """:func:`plant.dynamics.derivative_collective`, compiled."""
    return _derivative_collective(x, u, wind, ground, bias, p)


@kernel
def readings(state, command, wind, over_terrain, grid, constants, collective):
    """Return (clearance m, thrust G, velocity NED m/s, actuators, load factor g) of a vehicle.

    The clearance is NaN where the terrain is not known.
    """
    p = Constants(*_tuple(constants, _CONSTANTS))
    x, u, air = _tuple(state, 17), _tuple(command, 4), _tuple(wind, 3)
    elevation = _height(grid, x[0], x[1]) if over_terrain else 0.0
    ground = elevation if over_terrain and not math.isnan(elevation) else NO_GROUND
    if collective:
        rate = _derivative_collective(x, u, air, ground, _STILL, p)
        thrust = _collective_thrust(x, u, air, p)[0] / p.weight
    else:
        rate = _derivative_thrust(x, u, air, ground, _STILL, p)
        thrust = x[14]
    gravity = p.g * math.cos(x[6]) * math.cos(x[7])
    load = (gravity + x[10] * x[3] - x[9] * x[4] - rate[5]) / p.g
    return -x[2] - elevation, thrust, rate[:3], _actuators(x, u, p), load
