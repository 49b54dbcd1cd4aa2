"""What a controller sees of a helicopter's state: outputs by name, velocity over ground, offsets.

Arrays are (..., r, K): r values at K instants, in the order of the roles. Everything holds for complex
numbers too, which is how it is differentiated.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchestrator.fmu.roles import RIGID

Array = NDArray[Any]
OUTPUTS = (
    "north", "east", "altitude", "heading", "speed", "roll", "pitch",
    "velocity_north", "velocity_east", "velocity_down",
    "actuator_thrust", "actuator_pitch", "actuator_roll", "actuator_tail",
)  # fmt: skip


class Layout(NamedTuple):
    """How many rows of what is read are states, velocity (0 if not offered) and actuators (0)."""

    states: int
    velocity: int
    actuators: int


def observed(values: Array, commands: Array, layout: Layout) -> Array:
    """Return the rows of OUTPUTS, (..., 14, K), of values (..., r, K) under commands (..., m, K).

    Velocity is turned out of body axes where it is not offered, and actuators are the commands.
    """
    rigid = values[..., : len(RIGID), :]
    u, v, w = (rigid[..., i, :] for i in (3, 4, 5))
    n, end = layout.states, layout.states + layout.velocity
    velocity = values[..., n:end, :] if layout.velocity else to_ground(rigid)
    actuator = values[..., end:, :] if layout.actuators else commands
    speed = np.sqrt(u * u + v * v + w * w)[..., None, :]
    return np.concatenate(
        [rigid[..., :2, :], -rigid[..., 2:3, :], rigid[..., 8:9, :], speed, rigid[..., 6:8, :],
         velocity, actuator],
        axis=-2,
    )  # fmt: skip


def tangent(values: Array, along: Array, commands: Array, by: Array, layout: Layout) -> Array:
    """Return the derivative of :func:`observed` along directions, by a complex step: exact."""
    step = 1e-30
    moved = observed(values + 1j * step * along, commands + 1j * step * by, layout)
    return np.imag(moved) / step


def to_ground(rigid: Array) -> Array:
    """Return the velocity over ground, NED (..., 3, K), of rigid states (..., 12, K)."""
    R = _rotation(rigid)
    return np.stack([sum(R[i][j] * rigid[..., 3 + j, :] for j in range(3)) for i in range(3)], -2)


def moved(states: Array, offset: Array, bias: Array, period: float) -> tuple[Array, Array]:
    """Return states (..., n, K) as the measured state and a bias say, and the velocity gained.

    Attitude, body velocity and all others are off by what they are off by now; a ``bias`` (3,), m/s2,
    adds up in the velocity; the position follows the velocity gained (..., 3, K), m/s, NED.

    Parameters
    ----------
    states : (..., n, K + 1)
        Of the model, now and at the ends of the samples.
    offset : (n,)
        Measured state less that of the model now.
    period : float
        Sample period, s.
    """
    true = states + offset[:, None]
    time = period * np.arange(states.shape[-1])
    velocity = to_ground(true) + bias[:, None] * time
    gained = velocity - to_ground(states)
    true[..., :3, 1:] += period * np.cumsum(0.5 * (gained[..., 1:] + gained[..., :-1]), axis=-1)
    R = _rotation(true)
    for j in range(3):
        true[..., 3 + j, :] = sum(R[i][j] * velocity[..., i, :] for i in range(3))
    return true[..., 1:], gained[..., 1:]


def _rotation(rigid: Array) -> list[list[Array]]:
    """Return the matrix from body axes to NED, of 3-2-1 Euler angles."""
    phi, theta, psi = (rigid[..., i, :] for i in (6, 7, 8))
    s_phi, c_phi, s_th, c_th = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    s_psi, c_psi = np.sin(psi), np.cos(psi)
    return [
        [c_th * c_psi, s_phi * s_th * c_psi - c_phi * s_psi, c_phi * s_th * c_psi + s_phi * s_psi],
        [c_th * s_psi, s_phi * s_th * s_psi + c_phi * c_psi, c_phi * s_th * s_psi - s_phi * c_psi],
        [-s_th, s_phi * c_th, c_phi * c_th],
    ]
