"""The sequencer: plays the newest valid plan, sample by sample."""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt

from controller.plan import CHANNELS, PlanForm, plan_variables
from controller.variables import Execution, Variable, model_description, unknown

SOURCES = ("plan", "tail", "trim")


@dataclass(frozen=True)
class SequencerParameters:
    """What plans look like."""

    command: Annotated[PlanForm, "fourth channel: tail-rotor thrust or heading set-point"] = (
        "attitude"
    )
    plan_capacity: Annotated[int, Ge(1), "samples in a plan"] = 200
    update_period_s: Annotated[float, Gt(0), "a plan older than this is playing its tail"] = 0.5


class PlanSequencer:
    """Turns plans into commands (sampled, 20 Hz).

    A plan counts from its ``start_time``: sample k is held over [start + k Ts, start + (k + 1) Ts).
    The newest plan whose start has come is played; while a newer one is late or failed the old one
    goes on, first through its tail, then on its last sample, which is trim.
    """

    execution = Execution("sampled", 20.0)

    def __init__(self, parameters: SequencerParameters) -> None:
        self._parameters = parameters
        self._channels = CHANNELS[parameters.command]
        self._plans = plan_variables(self._channels, parameters.plan_capacity, "input")
        self._inputs: dict[str, Any] = {
            row.name: np.full(row.shape, row.start) if row.shape else row.start
            for row in self._plans
        }
        self._arrived: tuple[int, float, float, Any] | None = None
        self._playing: tuple[int, float, float, Any] | None = None
        self._outputs: dict[str, Any] = {f"command.{name}": 0.0 for name in self._channels}
        self._outputs |= {"playing.sequence": 0, "playing.source": SOURCES.index("trim")}

    def describe(self) -> Any:
        """Return the model description of this instance."""
        rows = [*self._plans]
        for name in self._channels:
            unit = "G" if name in ("thrust", "tail") else "rad"
            rows.append(Variable(f"command.{name}", "output", unit, f"commanded {name}",
                                 depends_on=("plan",)))  # fmt: skip
        rows.append(Variable("playing.sequence", "output", "1", "number of the plan in play", start=0,
                             depends_on=("plan",)))  # fmt: skip
        rows.append(Variable("playing.source", "output", "1", "part of the plan in play", start=0,
                             items=SOURCES, depends_on=("plan",)))  # fmt: skip
        return model_description("PlanSequencer", "plays plans", rows, has_state=True)

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Take up the plan that was set before."""
        del stop_time, seed
        self._arrived = self._playing = None
        self._play(start_time)

    def set(self, values: Mapping[str, Any]) -> None:
        """Set inputs."""
        for name, value in values.items():
            if name not in self._inputs:
                raise unknown(name, self._inputs)
            self._inputs[name] = np.array(value) if isinstance(value, np.ndarray) else value

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the command held now, and what is playing."""
        try:
            return {name: self._outputs[name] for name in names}
        except KeyError as error:
            raise unknown(error.args[0], self._outputs) from None

    def step(self, time: float, step_size: float) -> int:
        """Play the sample that begins at ``time``."""
        del step_size
        self._play(time)
        return 0

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next step depends on."""
        return pickle.dumps((self._inputs, self._arrived, self._playing, self._outputs))

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned."""
        self._inputs, self._arrived, self._playing, self._outputs = pickle.loads(state)  # noqa: S301

    def _play(self, time: float) -> None:
        sequence = self._inputs["plan.sequence"]
        if self._arrived is None or sequence != self._arrived[0]:
            samples = np.stack([self._inputs[f"plan.{name}"] for name in self._channels], axis=1)
            start, period = self._inputs["plan.start_time"], self._inputs["plan.sample_period"]
            if self._arrived is None or np.isfinite(samples).all():  # else it failed
                self._arrived = (sequence, start, period, samples)
        if self._arrived[1] <= time + 1e-9:
            self._playing = self._arrived
        if self._playing is None:
            self._playing = self._arrived
        sequence, start, period, samples = self._playing
        k = max(int(np.floor((time - start) / period + 1e-6)), 0)
        last = len(samples) - 1
        fresh = time - start < self._parameters.update_period_s - 1e-9
        source = "trim" if k > last or sequence == 0 else "plan" if fresh else "tail"
        command = samples[min(k, last)].tolist()
        self._outputs = {f"command.{n}": v for n, v in zip(self._channels, command, strict=True)}
        self._outputs["playing.sequence"] = sequence
        self._outputs["playing.source"] = SOURCES.index(source)
