"""A prediction model that is exactly linear, and a straight reference over a plane to go with it.

Thrust moves a double integrator in altitude; pitch and roll follow their set-points with a lag and
move double integrators in north and east; the heading is a lag. Every sample k

    tilt += (1 - a) (set-point - tilt),   v += T (g [-pitch, roll, 1 - thrust] + bias),   x += T v
"""

from typing import NamedTuple

import numpy as np

from controller.course import Path
from controller.optimise import ACTUATORS, TRACKED, VELOCITY, Aim
from controller.terrain_map import empty_map, update
from controller.tracking import Weights

T = 0.05  # s
G = 9.80665  # m/s2
LAG = 0.8  # a, of roll, pitch and heading over one sample
FEEDBACK = 0.5  # of the tilt, in the actuators
STATES = ("north", "east", "down", "u", "v", "w", "phi", "theta", "psi")


class Rollout(NamedTuple):
    """Outputs (N, H, p), valid (N,), last states (N, 9)."""

    outputs: np.ndarray
    valid: np.ndarray
    last: np.ndarray


class LinearModel:
    """The model of the module's docstring, as a ``PredictionModel``."""

    states = STATES
    commands = ("thrust", "pitch", "roll", "heading")
    outputs = (*TRACKED, *ACTUATORS, *VELOCITY)
    command_min = np.array([-50.0, -5.0, -5.0, -np.inf])
    command_max = -command_min
    actuator_min = np.full(4, -50.0)
    actuator_max = -actuator_min
    sample_period = T

    def trim(self, speed):
        """Return level flight north: state, command, actuators."""
        state = np.zeros(len(STATES))
        state[3] = speed
        return state, np.array([1.0, 0, 0, 0]), np.array([1.0, 0, 0, 0])

    def rollout(self, state, commands, wind, bias):
        """Predict; the wind does nothing."""
        x = np.array(np.broadcast_to(state, (len(commands), len(STATES))))
        y = np.empty((*commands.shape[:2], len(self.outputs)))
        position, velocity, tilt = x[:, :3], x[:, 3:6], x[:, 6:]
        for k in range(commands.shape[1]):
            thrust, set_point = commands[:, k, 0], commands[:, k, [2, 1, 3]]
            y[:, k, 7] = thrust
            y[:, k, 8:11] = (set_point - FEEDBACK * tilt)[:, [1, 0, 2]]
            tilt += (1 - LAG) * (set_point - tilt)
            pull = np.stack([-tilt[:, 1], tilt[:, 0], 1.0 - thrust], axis=1)
            velocity += T * (G * pull + bias)
            position += T * velocity
            y[:, k, :2], y[:, k, 2] = position[:, :2], -position[:, 2]
            y[:, k, 3], y[:, k, 4] = tilt[:, 2], velocity[:, 0]
            y[:, k, 5:7], y[:, k, 11:] = tilt[:, :2], velocity
        return Rollout(y, np.ones(len(commands), bool), x)


def straight_path(heading=0.0, altitude=100.0, slope=0.0, speed=30.0, length=1000):
    """Return a straight reference from the origin, sampled from 100 m before it."""
    s = np.arange(-100.0, length)
    along = np.full(s.size, 1.0)
    return Path(-100.0, 1.0, s * np.cos(heading), s * np.sin(heading), altitude + slope * s,
                heading * along, speed * along, slope * along)  # fmt: skip


def plane_map(elevation=0.0, north=0.0, east=0.0):
    """Return a map of a sensed plane with the given slopes, 1000 m square."""
    axis = np.arange(-500.0, 501.0, 10.0)
    n, e = (side.ravel() for side in np.meshgrid(axis, axis))
    return update(empty_map(10.0), n, e, elevation + north * n + east * e, np.ones(n.size, int))


def aim_at(path, terrain_map, model, horizon, **weights):
    """Return an aim along a path that starts at the origin; ``weights`` change the usual ones."""
    usual = {
        "Q": (1.0, 1.0, 10.0, 10.0, 1.0),
        "R": (0.1, 1.0, 1.0, 1.0),
        "Rc": (0.0, 0.1, 0.1, 0.1),
        "attitude_limit": np.radians(50.0),
        "heading_limit": np.radians(30.0),
        "clearance": 5.0,
        "rho1": 2e3,
        "rho2": 2e2,
    }
    _, command, actuators = model.trim(30.0)
    return Aim(
        path=path,
        near=0.0,
        heading=float(path.heading[0]),
        actuators=actuators,
        commands=np.tile(command[:, None], horizon),
        reach=np.full(4, np.inf),
        weights=Weights(**{**usual, **weights}),
        terrain_map=terrain_map,
    )
