"""What a controller sees of a helicopter's state: outputs by name, velocity over ground, offsets.

Arrays are (..., r, K): r values at K instants, in the order of the roles. Everything holds for complex
numbers too, which is how it is differentiated.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchestrator.fmu.roles import RIGID

Array = NDArray[np.float64]
OUTPUTS = (
    "north", "east", "altitude", "heading", "speed", "roll", "pitch",
    "velocity_north", "velocity_east", "velocity_down",
    "actuator_thrust", "actuator_pitch", "actuator_roll", "actuator_tail",
)  # fmt: skip


class Layout(NamedTuple):
    """Rows of what is read: states first; then ``velocity`` and ``actuator``, None if not offered."""

    states: int
    velocity: slice | None
    actuator: slice | None


def observed(values: Array, commands: Array, layout: Layout) -> Array:
    """Return the rows of OUTPUTS, (..., 14, K), of values (..., r, K) under commands (..., m, K).

    Velocity is turned out of body axes where it is not offered, and actuators are the commands.
    """
    rigid = values[..., : len(RIGID), :]
    u, v, w = (rigid[..., i, :] for i in (3, 4, 5))
    velocity = to_ground(rigid) if layout.velocity is None else values[..., layout.velocity, :]
    actuator = commands if layout.actuator is None else values[..., layout.actuator, :]
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
    return moved.imag / step


def to_ground(rigid: Array) -> Array:
    """Return the velocity over ground, NED (..., 3, K), of rigid states (..., 12, K)."""
    R = _rotation(rigid)
    return np.stack([sum(R[i][j] * rigid[..., 3 + j, :] for j in range(3)) for i in range(3)], -2)


def moved(values: Array, offset: Array, bias: Array, period: float, layout: Layout) -> Array:
    """Return states (n, K) of a shadow as the measured state and a bias say.

    Attitude, body velocity and rates are off by what they are off by now, constantly; a ``bias``
    (3,), m/s2, adds up in the velocity; the position follows the velocity.

    Parameters
    ----------
    values : (r, K + 1)
        What is read of the shadow, now and at the ends of the samples.
    offset : (n,)
        Measured state less that of the shadow.
    """
    own = values[: layout.states]
    true = own + offset[:, None]
    time = period * np.arange(own.shape[1])
    velocity = to_ground(true) + bias[:, None] * time
    gained = velocity - to_ground(own)
    mean = 0.5 * period * (gained[:, 1:] + gained[:, :-1])
    true[:3, 1:] += np.cumsum(mean, axis=1)
    R = _rotation(true)
    true[3:6] = np.stack([sum(R[i][j] * velocity[i] for i in range(3)) for j in range(3)])
    return true[:, 1:]


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
