"""The compiled kernels: rollouts of either plant, and single derivatives.

The named functions are thin on purpose: numba's cache tells kernels apart by name and line, so each
plant's rollout needs a ``def`` of its own.
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

import math

from plant import dynamics, lanes, terrain
from plant.elementary import COMPILED, compiled, inject, inline
from plant.jit import kernel

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


@kernel(error_model="numpy")
def roll_thrust(x0, commands, wind, bias, p, h, substeps, ground, grid, out, last, valid):
    """:func:`plant.lanes.roll` of the thrust-commanded plant."""
    _roll_thrust(x0, commands, wind, bias, p, h, substeps, ground, grid, out, last, valid)


@kernel(error_model="numpy")
def roll_collective(x0, commands, wind, bias, p, h, substeps, ground, grid, out, last, valid):
    """:func:`plant.lanes.roll` of the collective plant."""
    _roll_collective(x0, commands, wind, bias, p, h, substeps, ground, grid, out, last, valid)


@kernel(error_model="numpy")
def derivative_thrust(x, u, wind, ground, bias, p):
    """:func:`plant.dynamics.derivative`, compiled."""
    return _derivative_thrust(x, u, wind, ground, bias, p)


@kernel(error_model="numpy")
def derivative_collective(x, u, wind, ground, bias, p):
    """:func:`plant.dynamics.derivative_collective`, compiled."""
    return _derivative_collective(x, u, wind, ground, bias, p)


@kernel(error_model="numpy")
def readings(x, u, wind, ground, p, collective):
    """Return (thrust G, velocity NED m/s, actuators, load factor g) of a vehicle in flight."""
    if collective:
        rate = _derivative_collective(x, u, wind, ground, _STILL, p)
        thrust = _collective_thrust(x, u, wind, p)[0] / p.weight
    else:
        rate = _derivative_thrust(x, u, wind, ground, _STILL, p)
        thrust = x[14]
    gravity = p.g * math.cos(x[6]) * math.cos(x[7])
    load = (gravity + x[10] * x[3] - x[9] * x[4] - rate[5]) / p.g
    return thrust, rate[:3], _actuators(x, u, p), load


@kernel(error_model="numpy")
def height(grid, north, east):
    """:func:`plant.terrain.height`, callable from Python."""
    return _height(grid, north, east)
