"""The variables of the MPC: what it reads, and what it says about every update."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from controller.optimise import Pass
from controller.parameters import MpcParameters
from controller.plan import CHANNELS, plan_variables
from controller.reference import sample
from controller.solvers import Status
from controller.update import LADDER, Memory, Task
from controller.variables import Variable

SOLVER = (*(status.value for status in Status), "none")
SPACING = 2.0  # m, of the published reference
BEHIND = 10.0  # m: where the published reference begins
NO_PASS = {"step_length": 0.0, "solver_status": SOLVER.index("none"), "iterations": 0}
"""What an update says that could not plan."""
_AXES = ("north", "east", "down")
_STATE_UNITS = (
    *("m",) * 3, *("m/s",) * 3, *("rad",) * 3, *("rad/s",) * 3, "rad", "rad", "G", "rad", "rad",
)  # fmt: skip
_FEED = ("state", "scan")


def _discrete(name: str, unit: str, meaning: str, start: Any = 0.0, size: int = 0) -> Variable:
    shape = (size,) if size else ()
    return Variable(name, "input", unit, meaning, start, shape, "discrete")


def channels(task: Task) -> tuple[str, ...]:
    """Return the names of the four commands."""
    return CHANNELS["attitude" if task.attitude_form else "actuator"]


def reference_size(p: MpcParameters) -> int:
    """Return how many points the published reference has: a horizon and a fifth, and what is behind."""
    return round(1.2 * p.horizon_s * p.speed_mps / SPACING) + 20


def inputs(p: MpcParameters, task: Task) -> list[Variable]:
    """Return the rows of the measured state and of the scan's ring."""
    size = p.scan_capacity
    units = zip(task.model.states, _STATE_UNITS, strict=True)
    return [
        *(Variable(f"state.{name}", "input", unit, f"measured {name}") for name, unit in units),
        _discrete("scan.sequence", "1", "bursts so far", 0),
        _discrete("scan.count", "1", "cells written so far", 0),
        _discrete("scan.stamp", "s", "measurement of the newest burst"),
        _discrete("scan.cell_size", "m", "spacing of the lattice", 10.0),
        _discrete("scan.north", "m", "cell position", size=size),
        _discrete("scan.east", "m", "cell position", size=size),
        _discrete("scan.elevation", "m", "elevation, or upper bound", size=size),
        _discrete("scan.source", "1", "1 seen, 2 shadow bound", 0, size),
    ]


def outputs(p: MpcParameters, task: Task) -> list[Variable]:
    """Return the rows of the plan, the predicted path, the reference, and how the update went."""
    size, points = p.plan_capacity, reference_size(p)
    units = {"north": "m", "east": "m", "altitude": "m", "heading": "rad", "speed": "m/s"}
    rows = [
        *(_discrete(f"path.{axis}", "m", f"predicted {axis}", size=size) for axis in _AXES),
        *(
            _discrete(f"reference.{name}", unit, f"{name} along the course", size=points)
            for name, unit in units.items()
        ),
        _discrete("cost.before", "1", "cost of the shifted plan"),
        _discrete("cost.after", "1", "cost of the accepted plan"),
        _discrete("cost.linear", "1", "cost that the linear model promised"),
        _discrete("step_length", "1", "accepted step of the line search"),
        replace(_discrete("ladder", "1", "how the plan came about", 0), items=LADDER),
        replace(
            _discrete("solver_status", "1", "status of the quadratic programme", 0), items=SOLVER
        ),
        _discrete("iterations", "1", "iterations of the solver", 0),
        _discrete("slack", "m", "clearance missing in the plan"),
        *(_discrete(f"bias.{axis}", "m/s2", f"acceleration bias {axis}") for axis in _AXES),
        _discrete("horizon", "s", "horizon of the update"),
    ]
    plan = plan_variables(channels(task), size, "output")
    return [replace(row, causality="output", depends_on=_FEED) for row in (*plan, *rows)]


def published(
    p: MpcParameters, task: Task, memory: Memory, best: Pass | None, rung: int
) -> Mapping[str, Any]:
    """Return the values of all outputs after an update, or before the first if ``best`` is None."""
    plan = memory.plan
    values: dict[str, Any] = {
        "plan.sequence": plan.sequence,
        "plan.start_time": plan.start,
        "plan.sample_period": task.model.sample_period,
    }
    for c, name in enumerate(channels(task)):
        values[f"plan.{name}"] = plan.commands[:, c].copy()
    values |= dict(zip((f"bias.{axis}" for axis in _AXES), memory.bias.tolist(), strict=True))
    values |= {"ladder": rung, "horizon": plan.horizon * task.model.sample_period}
    if best is None or memory.reference is None:
        rest = (row for row in outputs(p, task) if row.name not in values)
        return values | {r.name: np.zeros(r.shape) if r.shape else r.start for r in rest}
    for axis, row, sign in zip(_AXES, ("north", "east", "altitude"), (1, 1, -1), strict=True):
        y = sign * best.Y[task.model.outputs.index(row)]
        values[f"path.{axis}"] = np.concatenate([y, np.full(p.plan_capacity - len(y), y[-1])])
    points = np.floor(memory.station) - BEHIND + SPACING * np.arange(reference_size(p))
    along = sample(memory.reference, points)
    for name in ("north", "east", "altitude", "heading", "speed"):
        values[f"reference.{name}"] = getattr(along, name)
    solution = best.solution
    for name, J in (("before", best.before), ("after", best.after), ("linear", best.linear)):
        values[f"cost.{name}"] = min(J, 1e12)
    return values | {
        "step_length": best.step,
        "solver_status": SOLVER.index("none" if solution is None else solution.status.value),
        "iterations": 0 if solution is None else solution.iterations,
        "slack": best.slack,
    }
