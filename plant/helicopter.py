"""The helicopter as a component that flies; as a model that predicts it is in ``prediction.py``."""

import math
import pickle
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plant import kernels, lanes
from plant.helicopter_variables import OUTCOMES, OUTPUTS, WIND, helicopter_variables
from plant.prediction import HelicopterModel, ModelParameters
from plant.rotorcraft import ROTOR, SAMPLE_PERIOD, rotorcraft
from plant.start import HelicopterParameters, Perturbation, starting_command, starting_state
from plant.terrain import Terrain
from plant.variables import Execution, model_description, parameter_variables, unknown

__all__ = [
    "Helicopter", "HelicopterModel", "HelicopterParameters", "ModelParameters", "Perturbation",
]  # fmt: skip

_STILL = np.zeros(3)


class Helicopter:
    """A Yamaha R-50 in flight (continuous, 20 Hz; Runge-Kutta with two substeps).

    Without a terrain the ground is a plane at elevation 0 that gives no ground effect.

    Raises
    ------
    ValueError
        If the start is outside the terrain or below ground.
    """

    execution = Execution("continuous", 20.0)

    def __init__(self, parameters: HelicopterParameters, *, terrain: Terrain | None = None) -> None:
        self._parameters = parameters
        self._terrain = terrain
        self._craft = rotorcraft(parameters, terrain)
        command = starting_command(parameters, self._craft)
        names = (*(f"command.{name}" for name in command), *WIND)
        self._inputs = {name: i for i, name in enumerate(names)}
        self._input = np.array([*command.values(), *_STILL])
        self._variables = helicopter_variables(self._craft, command)
        self._start()

    def describe(self) -> Any:
        """Return the model description of this instance."""
        rows = [*self._variables, *parameter_variables(self._parameters)]
        meaning = "Yamaha R-50, nonlinear, 9 degrees of freedom"
        return model_description("Helicopter", meaning, rows, has_state=True)

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Put the helicopter at its start; inputs set before are kept."""
        del start_time, stop_time, seed
        self._start()

    def set(self, values: Mapping[str, Any]) -> None:
        """Set inputs; they act from the next step on, until set again."""
        for name, value in values.items():
            if name not in self._inputs:
                raise unknown(name, self._inputs)
            self._input[self._inputs[name]] = value

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return values as of the end of the last step, under the inputs that acted in it."""
        try:
            return {name: self._outputs[name] for name in names}
        except KeyError as error:
            raise unknown(error.args[0], self._outputs) from None

    def step(self, time: float, step_size: float) -> int:
        """Advance by one sample of 50 ms; after the end of the flight the helicopter stays put."""
        del time
        if abs(step_size - SAMPLE_PERIOD) > 1e-9:
            raise ValueError(
                f"helicopter: wrong step size, got {step_size:g} s, expected {SAMPLE_PERIOD} s"
            )
        if self._outputs["outcome"] == 0:
            commands = np.empty((lanes.LANES, 1, 4))
            commands[:] = self._input[:4]
            rollout = self._craft.roll(self._lanes, commands, self._input[4:], _STILL)
            self._lanes = rollout.last
            self._read(valid=bool(rollout.valid[0]))
        return 0

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next step depends on."""
        return pickle.dumps((self._lanes, self._input, self._outputs))

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned, bit for bit."""
        self._lanes, self._input, self._outputs = pickle.loads(state)  # noqa: S301

    def c_source(self) -> Any:
        """Return what this vehicle as C is made of, :class:`plant.source.sources.Source`."""
        from plant.source.sources import helicopter_source

        return helicopter_source(self._parameters, self._terrain)

    def _start(self) -> None:
        state = starting_state(self._parameters, self._craft, self._terrain)
        self._lanes = np.tile(self._craft.own_state(state), (lanes.LANES, 1))
        self._read(valid=True)

    def _read(self, *, valid: bool) -> None:
        """Take the outputs from the state."""
        craft, x = self._craft, self._lanes[0].tolist()
        clearance, thrust, velocity, act, load = kernels.readings(
            self._lanes[0], self._input[:4], self._input[4:], craft.over_terrain, craft.grid,
            craft.constants, craft.collective,
        )  # fmt: skip
        level = max(abs(x[6]), abs(x[7])) <= lanes.ATTITUDE_LIMIT
        if not (level and math.isfinite(sum(x))):
            outcome = OUTCOMES.index("departed")
        elif math.isnan(clearance):
            outcome = OUTCOMES.index("left_terrain")
        else:
            outcome = OUTCOMES.index("collision") if clearance <= 0 else 0
        if math.isnan(clearance):
            clearance = -x[2]
        x[ROTOR] = thrust
        values = (*x, *x[:3], *x[6:9], *velocity, *act, clearance, load, outcome, valid)
        self._outputs: dict[str, Any] = dict(zip(OUTPUTS, values, strict=True))
