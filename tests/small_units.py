"""A component whose units are parameters."""

# ruff: noqa: D102  (the methods are the contract's)

from dataclasses import dataclass

from plant.variables import Execution, Variable, model_description, unknown


@dataclass(frozen=True)
class GaugeParameters:
    """What it is told and what it shows."""

    told: str = "kN.mm"
    shown: str = "degC"
    start: float = 1.0


class Gauge:
    """Pass u on as y (sampled)."""

    execution = Execution("sampled", 10.0)

    def __init__(self, parameters: GaugeParameters) -> None:
        self.parameters = parameters
        self.u = parameters.start

    def describe(self):
        rows = [
            Variable("u", "input", self.parameters.told, "in", start=self.parameters.start),
            Variable("y", "output", self.parameters.shown, "out", depends_on=("u",)),
        ]
        return model_description("Gauge", "passes on", rows)

    def initialize(self, *, start_time, stop_time=None, seed=0):
        self.y = self.u

    def set(self, values):
        for name, value in values.items():
            if name != "u":
                raise unknown(name, ["u"])
            self.u = value

    def get(self, names):
        if wrong := [name for name in names if name not in ("u", "y")]:
            raise unknown(wrong[0], ["u", "y"])
        return {name: getattr(self, name) for name in names}

    def step(self, time, step_size):
        self.y = self.u
        return 0

    def terminate(self):
        pass
