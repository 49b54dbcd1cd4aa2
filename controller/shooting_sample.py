"""One sample of the plant as multiple shooting needs it: errors, limits, and all their derivatives."""

# pyright: basic
# CasADi has no types

from functools import lru_cache
from importlib import import_module
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.optimise import ACTUATORS
from controller.prediction import PredictionModel

Floats = NDArray[np.float64]
Hessian = Literal["exact", "gauss_newton"]

PER_SAMPLE = 14  # parameters of each sample: the first ten of a goal and the commands
COMMON = 23  # parameters of all: actuators, Q, R, Rc, wind, bias
_HAIR = 1e-7  # inside an actuator's stop, on which the plant's own clip has no slope
_TURN = 3.0  # rad to a heading commanded; at half a turn the stabiliser turns the other way


def casadi() -> Any:
    """Return the module casadi, or say how to install it."""
    try:
        return import_module("casadi")
    except ModuleNotFoundError:
        raise ValueError(
            "shooting: casadi is missing, got none, expected `pip install casadi`"
        ) from None


class Sample(NamedTuple):
    """One sample as CasADi functions; ``end`` is the state at its end.

    ``rows`` of limits: heading, roll and pitch at the end; then, between ``low`` and ``high``, the turn
    to a heading commanded, and the actuators that are not a command themselves. Parameters: of the
    sample, and common.
    """

    advance: Any  # (x, u, wind, bias) -> end
    rows: Any  # (x, u, end) -> rows
    cost: Any  # (x, u, end, goal, common) -> J
    slopes: Any  # (x, u, end, common) -> Jacobians: end by z, all rows by z, all rows by end
    curvature: Any  # (x, u, end, goal, common, weight, gap, rows) -> triangles: by z, by end
    low: Floats
    high: Floats


@lru_cache(maxsize=4)
def differentiated(model: PredictionModel, hessian: Hessian) -> Sample:
    """Differentiate one sample, which takes longer than the rest of the building."""
    symbolic = getattr(model, "symbolic", None)
    if symbolic is None:
        raise ValueError(
            f"shooting: the prediction model has no symbolic form, got {type(model).__name__!r}, "
            "expected a model with a method symbolic"
        )
    ca, (advance, outputs) = casadi(), symbolic()
    n, m = len(model.states), len(model.commands)
    x, u, end = (ca.SX.sym(*row) for row in (("x", n), ("u", m), ("end", n)))
    goal, common = ca.SX.sym("goal", PER_SAMPLE), ca.SX.sym("common", COMMON)
    z, y = ca.vertcat(x, u), outputs(x, u, end)
    a = ca.vertcat(*(y[model.outputs.index(name)] for name in ACTUATORS))
    limited = [c for c in range(4) if ca.jacobian(a[c], x).nnz()]
    heading = model.outputs.index("heading")
    tilt = (y[model.outputs.index(name)] for name in ("heading", "roll", "pitch"))
    turns = [u[3] - outputs(x, u, x)[heading]] if "heading" in model.commands else []
    rows = ca.vertcat(*tilt, *turns, a[limited])
    errors, weights = _errors(ca, model, y, a, u, goal, common)
    cost = ca.dot(weights, errors**2)

    multipliers = (("weight", 1), ("gap", n), ("on", rows.numel()))
    weight, gap, on = (ca.SX.sym(*row) for row in multipliers)
    reached = advance(x, u, common[17:20], common[20:23])
    if hessian == "exact":
        lagrangian = weight * cost - ca.dot(gap, reached) + ca.dot(on, rows)
        curvature = [ca.hessian(lagrangian, v)[0] for v in (z, end)]
    else:
        slopes = [ca.jacobian(errors, v) for v in (z, end)]
        curvature = [2.0 * weight * J.T @ ca.diag(weights) @ J for J in slopes]
    inputs = [x, u, end, goal, common]
    shared = {"cse": True}
    return Sample(
        advance=advance,
        rows=ca.Function("rows", [x, u, end], [rows]),
        cost=ca.Function("cost", inputs, [cost]),
        slopes=ca.Function(
            "slopes",
            [x, u, end, common],
            [ca.jacobian(reached, z), ca.jacobian(rows, z), ca.jacobian(rows, end)],
            shared,
        ),
        curvature=ca.Function(
            "curvature", [*inputs, weight, gap, on], [ca.triu(h) for h in curvature], shared
        ),
        low=np.array([-_TURN] * len(turns) + (model.actuator_min[limited] + _HAIR).tolist()),
        high=np.array([_TURN] * len(turns) + (model.actuator_max[limited] - _HAIR).tolist()),
    )


def _errors(
    ca: Any, model: PredictionModel, y: Any, a: Any, u: Any, goal: Any, common: Any
) -> tuple[Any, Any]:
    """Return the 13 errors of a sample and their weights."""
    north, east, altitude, heading, speed = (
        y[model.outputs.index(name)] for name in ("north", "east", "altitude", "heading", "speed")
    )
    to_north, to_east, to_altitude, slope, t_n, t_e, nominal_n, nominal_e, to_heading, to_speed = (
        ca.vertsplit(goal[:10])
    )
    station = t_n * (north - nominal_n) + t_e * (east - nominal_e)
    errors = ca.vertcat(
        north - to_north,
        east - to_east,
        altitude - (to_altitude + slope * station),
        heading - to_heading,
        speed - to_speed,
        a - common[0:4],
        u - goal[10:14],
    )
    return errors, common[4:17]
