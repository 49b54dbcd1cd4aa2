"""A terrain sensor of finite range that reports in short bursts at its own random times."""

import math
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import NDArray

from plant.scan import SEEN, View, largest_burst, sweep
from plant.terrain import Terrain
from plant.variables import Execution, Variable, model_description, parameter_variables, unknown

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

WINDOW = 0.5  # s, between two looks of the slowest reader that must lose nothing
ROUNDING = 1e-9  # s, of a time given in floating point
MAX_BURST = 100_000  # cells


@dataclass(frozen=True)
class TerrainSensorParameters:
    """What the sensor sees, and when it reports."""

    range_m: Annotated[float, Gt(0), "how far it sees, about the heading"] = 400.0
    field_of_view_deg: Annotated[float, Gt(0), Le(360), "whole angle, about the heading"] = 90.0
    near_m: Annotated[float, Ge(0), "how far it sees all around"] = 60.0
    cell_size_m: Annotated[float, Gt(0), "spacing of the lattice of cells"] = 10.0
    min_interval_s: Annotated[float, Ge(0), "least time between bursts"] = 0.1
    mean_interval_s: Annotated[float, Gt(0), "mean of the random time added to it"] = 0.5
    latency_min_s: Annotated[float, Ge(0), "least time from measurement to delivery"] = 0.02
    latency_max_s: Annotated[float, Ge(0), "greatest time from measurement to delivery"] = 0.1
    drop_out: Annotated[float, Ge(0), Lt(1), "probability that a burst is lost"] = 0.0
    occlusion: Annotated[bool, "ground behind ground is hidden"] = False
    ray_step_m: Annotated[float, Gt(0), "between samples along a line of sight"] = 5.0
    noise_m: Annotated[float, Ge(0), "standard deviation of a seen elevation"] = 0.0
    scan_capacity: Annotated[int, Ge(1), "cells that the ring holds"] = 4500

    def __post_init__(self) -> None:
        if self.latency_max_s < self.latency_min_s:
            raise ValueError(
                f"sensor.latency_max_s: too small, got {self.latency_max_s:g} s, "
                f"expected at least latency_min_s, {self.latency_min_s:g} s"
            )

    @property
    def view(self) -> View:
        """The geometry, for the kernels."""
        return View(
            reach=float(self.range_m),
            half_angle=0.5 * math.radians(self.field_of_view_deg),
            near=float(self.near_m),
            cell=float(self.cell_size_m),
            ray_step=float(self.ray_step_m) if self.occlusion else 0.0,
        )


class _Burst(NamedTuple):
    arrival: float  # s
    stamp: float  # s
    cells: NDArray[np.float64]  # (3, n): north, east, elevation
    source: NDArray[np.int64]  # (n,)


class TerrainSensor:
    """Bursts of terrain cells (sampled, 20 Hz).

    Measurement times follow ``t[k+1] = t[k] + min_interval + Gamma(2, mean_interval)`` from the
    start time on; each is taken at the first tick not before it and delivered, in order, at the
    first tick not before its latency has passed. The first burst is neither late nor lost:
    :meth:`initialize` takes it if a pose has been set before, the first step otherwise.

    The outputs are a ring: the i-th cell ever delivered is at index i modulo the capacity. No more
    cells are delivered in any 0.5 s than the ring holds (a further burst waits), so that whoever
    looks every 0.5 s loses none. The sensor is yaw-stabilised: roll and pitch do not matter. Cells
    outside the terrain are left out.

    Parameters
    ----------
    parameters
        What it sees, and when it reports.
    terrain
        The ground, injected.

    Raises
    ------
    ValueError
        If a burst would have more than 100 000 cells.
    """

    execution = Execution("sampled", 20.0)

    def __init__(self, parameters: TerrainSensorParameters, *, terrain: Terrain) -> None:
        self._parameters = parameters
        self._terrain = terrain
        self._view = parameters.view
        burst = largest_burst(self._view)
        if burst > MAX_BURST:
            raise ValueError(
                f"sensor.cell_size_m: too many cells in a burst, got {burst}, "
                f"expected at most {MAX_BURST}, as from larger cells"
            )
        self._burst = np.empty((3, burst)), np.empty(burst, np.int64)
        per_window = math.floor(WINDOW / (parameters.min_interval_s + parameters.mean_interval_s))
        enough = burst * (per_window + 1)
        if parameters.scan_capacity < enough:
            raise ValueError(
                f"sensor.scan_capacity: too small for the bursts that come in {WINDOW:g} s on "
                f"average, got {parameters.scan_capacity} cells, expected at least {enough}"
            )
        self._capacity = parameters.scan_capacity
        self._inputs = {f"pose.{name}": 0.0 for name in _POSE}
        self._posed = False
        self._restart(start_time=0.0, seed=0)

    def describe(self) -> "ModelDescription":
        """Return the model description of this instance."""
        rows = [*_variables(self._capacity), *parameter_variables(self._parameters)]
        return model_description("TerrainSensor", "terrain cells in bursts", rows, has_state=True)

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Start the burst process and, if a pose is known, deliver the first burst."""
        del stop_time
        self._restart(start_time, seed)
        if self._posed:
            self._run(start_time)

    def set(self, values: Mapping[str, Any]) -> None:
        """Set the pose; it holds until set again."""
        for name, value in values.items():
            if name not in self._inputs:
                raise unknown(name, self._inputs)
            self._inputs[name] = float(value)
        self._posed = True

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return values at the current instant."""
        values: dict[str, Any] = {}
        for name in names:
            if name in self._ring:
                values[name] = self._ring[name]  # read-only, replaced at a delivery
            elif name in self._scalars:
                values[name] = self._scalars[name]
            elif name in self._inputs:
                values[name] = self._inputs[name]
            else:
                raise unknown(name, [*self._ring, *self._scalars, *self._inputs])
        return values

    def step(self, time: float, step_size: float) -> int:
        """Measure and deliver what is due at ``time``."""
        del step_size
        self._run(time)
        return 0

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next step depends on."""
        hidden = {name: getattr(self, name) for name in _HIDDEN}
        return pickle.dumps((hidden, self._rng.bit_generator.state))

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned, bit for bit."""
        hidden, generator = pickle.loads(state)  # noqa: S301
        for name in _HIDDEN:
            setattr(self, name, hidden[name])
        self._rng.bit_generator.state = generator

    def _restart(self, start_time: float, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._due = start_time  # of the next measurement
        self._first = True
        self._pending: list[_Burst] = []
        self._recent: list[tuple[float, int]] = []  # (time, cells) of deliveries within WINDOW
        self._scalars: dict[str, float | int] = {
            "scan.sequence": 0,
            "scan.count": 0,
            "scan.stamp": start_time,
            "scan.cell_size": self._parameters.cell_size_m,
        }
        self._ring: dict[str, NDArray[Any]] = {  # read-only arrays: readers need no copy
            "scan.north": np.zeros(self._capacity),
            "scan.east": np.zeros(self._capacity),
            "scan.elevation": np.zeros(self._capacity),
            "scan.source": np.zeros(self._capacity, np.int64),
        }
        for ring in self._ring.values():
            ring.flags.writeable = False

    def _run(self, time: float) -> None:
        p = self._parameters
        if self._due <= time + ROUNDING:
            self._measure(time)
        while self._due <= time + ROUNDING:
            self._due += p.min_interval_s + float(self._rng.gamma(2.0, 0.5 * p.mean_interval_s))
        self._recent = [(t, n) for t, n in self._recent if t > time - WINDOW + ROUNDING]
        used = sum(n for _, n in self._recent)
        while self._pending and self._pending[0].arrival <= time + ROUNDING:
            size = self._pending[0].source.size
            if used + size > self._capacity:
                break
            self._deliver(self._pending.pop(0))
            self._recent.append((time, size))
            used += size

    def _measure(self, time: float) -> None:
        p, pose, (cells, source) = self._parameters, self._inputs, self._burst
        n = sweep(
            self._terrain.grid,
            pose["pose.north"],
            pose["pose.east"],
            -pose["pose.down"],
            pose["pose.psi"],
            self._view,
            cells,
            source,
        )
        # every burst draws the same numbers, lost or not
        latency = float(self._rng.uniform(p.latency_min_s, p.latency_max_s))
        lost = bool(self._rng.random() < p.drop_out)
        burst = _Burst(time + latency, time, cells[:, :n].copy(), source[:n].copy())
        if p.noise_m > 0:
            error = self._rng.normal(0.0, p.noise_m, n)
            burst.cells[2] += np.where(burst.source == SEEN, error, 0.0)
        if self._first:
            self._pending.append(burst._replace(arrival=time))
        elif not lost:
            self._pending.append(burst)
        self._first = False

    def _deliver(self, burst: _Burst) -> None:
        count = int(self._scalars["scan.count"])
        index = (count + np.arange(burst.source.size)) % self._capacity
        for name, values in zip(_CELLS, (*burst.cells, burst.source), strict=True):
            ring = self._ring[name].copy()  # readers hold the old one
            ring[index] = values
            ring.flags.writeable = False
            self._ring[name] = ring
        self._scalars["scan.count"] = count + burst.source.size
        self._scalars["scan.sequence"] += 1
        self._scalars["scan.stamp"] = burst.stamp


_POSE = {
    "north": "m",
    "east": "m",
    "down": "m",
    "phi": "rad",
    "theta": "rad",
    "psi": "rad",
}
_CELLS = ("scan.north", "scan.east", "scan.elevation", "scan.source")
_HIDDEN = (
    "_inputs", "_posed", "_due", "_first", "_pending", "_recent", "_scalars", "_ring",
)  # fmt: skip


def _variables(capacity: int) -> list[Variable]:
    def scan(name: str, unit: str, meaning: str, start: float, shape: tuple[int, ...]) -> Variable:
        depends = () if name == "cell_size" else ("pose",)
        return Variable(
            f"scan.{name}",
            "output",
            unit,
            meaning,
            start=start,
            shape=shape,
            variability="discrete",
            depends_on=depends,
        )

    ring = (capacity,)
    return [
        *(Variable(f"pose.{n}", "input", u, f"{n} of the aircraft") for n, u in _POSE.items()),
        scan("sequence", "1", "bursts delivered so far", 0, ()),
        scan("count", "1", "cells delivered so far; ring index is count modulo capacity", 0, ()),
        scan("stamp", "s", "when the newest burst was measured", 0.0, ()),
        scan("cell_size", "m", "spacing of the lattice", 0.0, ()),
        scan("north", "m", "of the cells", 0.0, ring),
        scan("east", "m", "of the cells", 0.0, ring),
        scan("elevation", "m", "of the cells, up", 0.0, ring),
        scan("source", "1", "0 none yet, 1 seen, 2 hidden: elevation is an upper bound", 0, ring),
    ]
