"""The helicopter as a prediction model for a controller."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plant import lanes
from plant.rotorcraft import (
    COMMANDS,
    SAMPLE_PERIOD,
    SET_POINT_LIMIT,
    STATES,
    AirframeParameters,
    Linearisation,
    Rollout,
    rotorcraft,
)
from plant.terrain import Terrain

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ModelParameters(AirframeParameters):
    """Which helicopter to predict."""


class HelicopterModel:
    """The same helicopter as a prediction model for a controller: batched rollouts.

    With a ``terrain`` the ground effect is predicted and a trajectory that leaves the terrain is
    invalid; without one there is neither.
    """

    states = STATES
    outputs = lanes.OUTPUTS
    sample_period = SAMPLE_PERIOD

    def __init__(self, parameters: ModelParameters, *, terrain: Terrain | None = None) -> None:
        self._craft = rotorcraft(parameters, terrain)
        self.commands = COMMANDS[parameters.command]
        p = self._craft.p
        tilt = SET_POINT_LIMIT if self._craft.attitude else p.tilt_max
        turn = math.inf if self._craft.attitude else p.tail_max
        self.command_min = np.array([p.thrust_min, -tilt, -tilt, -turn])
        self.command_max = np.array([p.thrust_max, tilt, tilt, turn])
        self.actuator_min = np.array([p.thrust_min, -p.tilt_max, -p.tilt_max, -p.tail_max])
        self.actuator_max = np.array([p.thrust_max, p.tilt_max, p.tilt_max, p.tail_max])

    def trim(self, speed: float) -> tuple[Floats, Floats, Floats]:
        """Return (state (17,), command (4,), actuators (4,)) of level flight north at ``speed`` m/s."""
        level = self._craft.trim(speed)
        return np.array(level.state), self._craft.trim_command(level), np.array(level.actuators)

    def rollout(self, state: Floats, commands: Floats, wind: Floats, bias: Floats) -> Rollout:
        """Predict N trajectories.

        Parameters
        ----------
        state : (17,) or (N, 17)
            Common state at the start.
        commands : (N, H, 4)
            Held over each sample of 50 ms.
        wind, bias : (3,)
            Air velocity, m/s, and unmodelled acceleration, m/s2; NED.
        """
        own = self._craft.own_state(np.broadcast_to(state, (len(commands), len(STATES))))
        rollout = self._craft.roll(own, commands, wind, bias)
        if not self._craft.collective:
            return rollout
        return rollout._replace(last=self._craft.common_state(rollout.last, commands[:, -1], wind))

    def symbolic(self) -> tuple[Any, Any]:
        """Return one sample without ground as CasADi functions, :class:`plant.symbolic.SampleMap`.

        Raises
        ------
        ValueError
            If CasADi is missing, or the rotor is collective: its state is not the common one.
        """
        from plant.symbolic import sample_map  # tracing is for optimal control only

        if self._craft.collective:
            raise ValueError(
                "symbolic model: the rotor's state is not the common one, got rotor 'collective', "
                "expected 'thrust'"
            )
        return sample_map(self._craft)

    def linearise(
        self, state: Floats, commands: Floats, wind: Floats, bias: Floats
    ) -> Linearisation:
        """Return the tangent of each sample along one trajectory.

        Parameters
        ----------
        state : (17,)
            Common state at the start.
        commands : (H, 4)
            Held over each sample of 50 ms.
        wind, bias : (3,)
            As :meth:`rollout`.
        """
        return self._craft.linearise(self._craft.own_state(state), commands, wind, bias)
