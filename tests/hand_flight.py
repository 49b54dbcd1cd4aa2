"""A flight by hand: vehicle, controller and sequencer in turn, as the orchestrator would.

The vehicle has no terrain, hence no ground effect: its model is perfect. The ground exists only in
the scans that the controller is given.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from controller.mpc import BasisMpc
from controller.parameters import MpcParameters
from controller.sequencer import PlanSequencer, SequencerParameters
from plant.helicopter import Helicopter, HelicopterModel, HelicopterParameters, ModelParameters
from plant.rotorcraft import STATES

TICK = 0.05  # s
PER_UPDATE = 10  # ticks
CELL = 10.0  # m
STATE = [f"state.{name}" for name in STATES]


def flat(north, east):
    """Return the elevation of flat ground, m."""
    return np.zeros(np.broadcast(north, east).shape)


def hills(north, east):
    """Return the elevation of gentle hills, m."""
    return 6.0 * np.sin(north / 60.0) + 2.0 * np.sin(east / 40.0 + north / 100.0)


def outputs_of(component) -> list[str]:
    """Return the names of a component's outputs."""
    variables = component.describe().modelVariables
    return [variable.name for variable in variables if variable.causality == "output"]


def scan(ground: Callable, north: float, reach_m: float, sequence: int, capacity: int) -> dict:
    """Return one burst: all cells of a strip up to ``reach_m`` ahead of an aircraft flying north."""
    rows = np.arange(np.ceil((north - 100.0) / CELL), (north + reach_m) / CELL) * CELL
    columns = np.arange(-10, 11) * CELL
    n, e = (axis.ravel() for axis in np.meshgrid(rows, columns, indexing="ij"))
    count = sequence * capacity  # the ring is written once around: every cell is new
    fill = np.full(capacity - n.size, np.nan)
    return {
        "scan.sequence": sequence,
        "scan.count": count,
        "scan.stamp": 0.0,
        "scan.cell_size": CELL,
        "scan.north": np.concatenate([n, fill]),
        "scan.east": np.concatenate([e, fill]),
        "scan.elevation": np.concatenate([ground(n, e), fill]),
        "scan.source": np.ones(capacity, np.int64),
    }


class HandFlight:
    """North along the course through the origin, at 30 m/s and 10 m above the ground scanned."""

    def __init__(
        self,
        mpc: Mapping[str, Any] | None = None,
        vehicle: Mapping[str, Any] | None = None,
        *,
        ground: Callable = flat,
        reach_m: float = 400.0,
        latency_s: float = 0.0,
        model: Any = None,
        controller: Callable = BasisMpc,
    ) -> None:
        vehicle = dict(vehicle or {})
        self.ground, self.reach_m = ground, reach_m
        self.late = round(latency_s / TICK)
        self.tick = 0
        self.parameters = MpcParameters(**(mpc or {}))
        form = vehicle.get("command", "attitude")
        preset = vehicle.get("preset", "r50")
        self.model = model or HelicopterModel(ModelParameters(command=form, preset=preset))
        self.vehicle = Helicopter(HelicopterParameters(**vehicle))
        self.mpc = controller(self.parameters, prediction_model=self.model, latency_s=latency_s)
        self.sequencer = PlanSequencer(SequencerParameters(command=form))
        self.outputs = outputs_of(self.mpc)
        self.plan = [name for name in self.outputs if name.startswith("plan.")]
        self.commands = [f"command.{name}" for name in self.model.commands]
        self.pending: list[tuple[int, dict]] = []
        self.vehicle.initialize(start_time=0.0)
        self.measure()
        self.mpc.initialize(start_time=0.0)
        self.sequencer.set(self.mpc.get(self.plan))
        self.sequencer.initialize(start_time=0.0)

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.tick * TICK

    def state(self) -> np.ndarray:
        """Return the vehicle's state, (17,)."""
        return np.array([*self.vehicle.get(STATE).values()])

    def measure(self) -> None:
        """Show the controller the vehicle's state and the ground around it."""
        state = self.vehicle.get(STATE)
        sequence = self.tick // PER_UPDATE + 1
        burst = scan(
            self.ground,
            state["state.north"],
            self.reach_m,
            sequence,
            self.parameters.scan_capacity,
        )
        self.mpc.set({**state, **burst})

    def update(self) -> dict:
        """Let the controller plan; return its outputs."""
        self.mpc.step(self.time, PER_UPDATE * TICK)
        outputs = self.mpc.get(self.outputs)
        self.pending.append((self.tick + self.late, {name: outputs[name] for name in self.plan}))
        return outputs

    def play(self, ticks: int = PER_UPDATE) -> None:
        """Fly on under the plan that is in play."""
        for _ in range(ticks):
            while self.pending and self.pending[0][0] <= self.tick:
                self.sequencer.set(self.pending.pop(0)[1])
            self.sequencer.step(self.time, TICK)
            self.vehicle.set(self.sequencer.get(self.commands))
            self.vehicle.step(self.time, TICK)
            self.tick += 1

    def fly(self, updates: int) -> list[dict]:
        """Fly on for a number of updates; return the controller's outputs at each."""
        log = []
        for _ in range(updates):
            self.measure()
            log.append(self.update())
            self.play()
        return log
