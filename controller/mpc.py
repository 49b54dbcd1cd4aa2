"""Model predictive control with control basis functions (CBF: control *basis* functions).

The component around :mod:`controller.update`: it keeps the memory, reads the scan, and publishes every
plan with everything that says how it came about.
"""

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from controller.course import make_course
from controller.mpc_variables import NO_PASS, inputs, outputs, published
from controller.optimise import Improve
from controller.parameters import TUNABLE, MpcParameters, basis_planner
from controller.prediction import PredictionModel
from controller.terrain_map import empty_map, read_scan
from controller.update import Memory, Plan, Task, trim_commands, update
from controller.variables import Execution, model_description, parameter_variables, unknown

Planner = Callable[[MpcParameters, PredictionModel, int], Improve]


def BasisMpc(
    parameters: MpcParameters, *, prediction_model: PredictionModel, latency_s: float = 0.0
) -> "Mpc":
    """Model predictive control with control basis functions, the paper's.

    The response S is identified from ``prediction_model``; errors and the rest as of :class:`Mpc`.
    """
    return Mpc(
        parameters,
        prediction_model=prediction_model,
        planner=basis_planner,
        latency_s=latency_s,
        name="BasisMpc",
        meaning="model predictive control with control basis functions",
    )


class Mpc:
    """A planner that is run again and again over a receding horizon (sampled, 2 Hz).

    Parameters
    ----------
    parameters : MpcParameters
    prediction_model : PredictionModel
    planner : callable
        Returns, for the parameters, the model and a horizon of H samples, how a plan is improved.
    latency_s : float
        From measurement to the plan's effect; compensated by predicting with the samples that are
        committed by then.
    name, meaning : str
        For the description.

    Raises
    ------
    ValueError
        If the horizon exceeds the plan's capacity, the basis does not exist at it, or the way-points
        leave no room for their turns.
    """

    execution = Execution("sampled", 2.0)

    def __init__(
        self,
        parameters: MpcParameters,
        *,
        prediction_model: PredictionModel,
        planner: Planner,
        latency_s: float = 0.0,
        name: str = "Mpc",
        meaning: str = "model predictive control",
    ) -> None:
        self._parameters = parameters
        self._name, self._meaning = name, meaning
        self._period = prediction_model.sample_period
        self._late = round(latency_s / self._period)
        longest = round(parameters.horizon_s / self._period)
        if longest > parameters.plan_capacity:
            raise ValueError(
                f"mpc: horizon longer than a plan, got {parameters.horizon_s:g} s, "
                f"expected up to {parameters.plan_capacity * self._period:g} s"
            )

        @cache
        def planner_for(horizon: int) -> Improve:
            return planner(parameters, prediction_model, horizon)

        planner_for(longest)
        course = make_course(parameters.waypoints_m, parameters.speed_mps)
        self._task = Task(prediction_model, course, planner_for)
        self._inputs: dict[str, Any] = {
            row.name: np.full(row.shape, row.start) if row.shape else row.start
            for row in inputs(parameters, self._task)
        }
        self._measured = False
        self._reset(0.0)

    def describe(self) -> Any:
        """Return the model description of this instance."""
        rows = [
            *inputs(self._parameters, self._task),
            *outputs(self._parameters, self._task),
            *parameter_variables(self._parameters, TUNABLE),
        ]
        return model_description(self._name, self._meaning, rows, has_state=True)

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Plan once from the state set before, without latency: there is time before a flight.

        Where no state was set the outputs are trim until the first step.
        """
        del stop_time, seed
        self._reset(start_time)
        if self._measured:
            self._update(start_time, 0, self._late or 1)
            self._memory = replace(self._memory, expected=None)

    def set(self, values: Mapping[str, Any]) -> None:
        """Set inputs and tunable parameters."""
        for name, value in values.items():
            if name in self._inputs:
                self._measured |= name.startswith("state.")
                self._inputs[name] = np.array(value) if isinstance(value, np.ndarray) else value
            elif name in TUNABLE:
                if not float(value) > 0 and not (value == 0 and name.endswith("_weight")):
                    raise ValueError(f"{name}: out of range, got {value:g}, expected above 0")
                self._parameters = replace(self._parameters, **{name: float(value)})
            else:
                raise unknown(name, [*self._inputs, *TUNABLE])

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return values of the last update; arrays are copies."""
        found: dict[str, Any] = {}
        for name in names:
            if name in self._outputs:
                value = self._outputs[name]
                found[name] = value.copy() if isinstance(value, np.ndarray) else value
            elif name in TUNABLE:
                found[name] = getattr(self._parameters, name)
            else:
                raise unknown(name, [*self._outputs, *TUNABLE])
        return found

    def step(self, time: float, step_size: float) -> int:
        """Update the plan from the state measured at ``time``; it takes effect a latency later.

        A state that is not finite is a warning, and the old plan goes on.
        """
        return self._update(time, self._late, round(step_size / self._period))

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next update depends on."""
        return pickle.dumps(
            (self._parameters, self._inputs, self._measured, self._memory, self._outputs)
        )

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned."""
        (self._parameters, self._inputs, self._measured, self._memory, self._outputs) = (
            pickle.loads(  # noqa: S301
                state
            )
        )

    def _reset(self, start_time: float) -> None:
        p, task = self._parameters, self._task
        headings = np.full(p.plan_capacity, task.course.heading[0])
        plan = Plan(0, start_time, 0, trim_commands(task, p.speed_mps, headings))
        self._memory = Memory(plan=plan, bias=np.zeros(3))
        self._outputs = dict(published(p, task, self._memory, None, 0))

    def _update(self, time: float, late: int, applied: int) -> int:
        scan = {
            name.removeprefix("scan."): v for name, v in self._inputs.items() if "scan." in name
        }
        old = self._memory.terrain_map
        if old is None or old.cell_size != scan["cell_size"]:
            old = empty_map(scan["cell_size"])
        sensed = read_scan(
            old, scan["count"], scan["north"], scan["east"], scan["elevation"], scan["source"]
        )
        memory = replace(self._memory, terrain_map=sensed)
        state = np.array([self._inputs[f"state.{name}"] for name in self._task.model.states])
        self._memory, best, rung = update(
            self._task, self._parameters, memory, state, time, late, applied
        )
        if best is None:
            self._outputs = {**self._outputs, **NO_PASS, "ladder": rung}
            return 1
        self._outputs = dict(published(self._parameters, self._task, self._memory, best, rung))
        return 0
