"""The optimum itself: direct multiple shooting on the nonlinear model, without bases or linearisation.

CasADi (extra ``paper``) states the problem, IPOPT or fatrop solves it. Unknowns are the states at all
nodes and the commands, stage by stage, so that derivatives are block banded:

    z_k = (x_k, u_k),  k < H;   x_H
    rows of stage k:  x_{k+1} = advance(z_k);  x_0 = start;  limits of outputs at node k;  of actuators

One sample is differentiated once, symbolically, and mapped over the horizon: left to itself CasADi
would differentiate the whole with seeds, at three times the cost.
"""

# pyright: basic
# CasADi has no types

import time
from collections.abc import Sequence
from functools import lru_cache
from importlib import import_module
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from controller.optimise import ACTUATORS
from controller.prediction import PredictionModel

Floats = NDArray[np.float64]
Solver = Literal["ipopt", "fatrop"]
Hessian = Literal["exact", "gauss_newton"]

_GOAL = 14  # parameters of each sample: the goal's first ten and the commands
_COMMON = 23  # parameters of all: actuators, Q, R, Rc, wind, bias
_HAIR = 1e-7  # inside an actuator's stop, on which the plant's own clip has no slope
_TURN = 3.0  # rad to a heading commanded; at half a turn the stabiliser turns the other way


class Goal(NamedTuple):
    """What a plan of H samples should do, and its limits.

    The first ten are (H,), at the ends of the samples: m, rad, m/s. The altitude aimed at follows the
    position, ``altitude + slope (tangent . (position - nominal))``; see :mod:`controller.tracking`.
    ``actuators`` (4,) and ``commands`` (4, H) are what R and Rc pull to; Q, R, Rc weigh as in
    :class:`controller.tracking.Weights`. Limits: of roll and pitch, of the heading's deviation, rad;
    commands stay within ``reach`` (4,) of ``commands``.
    """

    north: Floats
    east: Floats
    altitude: Floats
    slope: Floats
    tangent_north: Floats
    tangent_east: Floats
    nominal_north: Floats
    nominal_east: Floats
    heading: Floats
    speed: Floats
    actuators: Floats
    commands: Floats
    Q: tuple[float, ...]
    R: tuple[float, ...]
    Rc: tuple[float, ...]
    attitude_limit: float
    heading_limit: float
    reach: Floats


class Shot(NamedTuple):
    """Outcome: commands (H, 4), states at the nodes (H + 1, n), cost, and how it was found.

    ``status`` is the solver's own word; ``cpu_s`` is for tables only.
    """

    u: Floats
    X: Floats
    J: float
    iterations: int
    status: str
    cpu_s: float


class Shoot(Protocol):
    """A problem built for one horizon, solved again and again."""

    def __call__(
        self,
        state: Floats,
        u: Floats,
        goal: Goal,
        /,
        *,
        wind: Floats | None = None,
        bias: Floats | None = None,
    ) -> Shot:
        """Return the optimum from a state (n,), searched from commands u (H, 4)."""
        ...


def shooter(
    model: PredictionModel,
    horizon: int,
    *,
    solver: Solver = "ipopt",
    hessian: Hessian = "exact",
    iterations: int = 200,
    tolerance: float = 1e-8,
) -> Shoot:
    """Build the problem of a horizon of H samples, once.

    Parameters
    ----------
    model : PredictionModel
        With the optional method ``symbolic``.
    horizon : int
    solver : {"ipopt", "fatrop"}
        Interior points with MUMPS, or with a Riccati recursion.
    hessian : {"exact", "gauss_newton"}
        Gauss-Newton leaves the curvature of the dynamics out: a third of the time per iteration.
    iterations : int
        At most; never a limit in time, which would not be reproducible.
    tolerance : float
        Of the scaled optimality conditions; trajectories are consistent to a thousandth of it.

    Raises
    ------
    ValueError
        If CasADi is missing or the model has no symbolic form.
    """
    ca, sample = _casadi(), _sample(model, hessian)
    layout = _Layout(horizon, len(model.states), len(model.commands), len(sample.low))
    solve = _nlp(ca, sample, layout, solver, iterations, tolerance)
    rollout = sample.advance.mapaccum(horizon)

    def shoot(
        state: Floats,
        u: Floats,
        goal: Goal,
        /,
        *,
        wind: Floats | None = None,
        bias: Floats | None = None,
    ) -> Shot:
        began = time.process_time()
        wind = np.zeros(3) if wind is None else wind
        bias = np.zeros(3) if bias is None else bias
        low = np.maximum(model.command_min, (goal.commands.T - goal.reach))
        high = np.minimum(model.command_max, (goal.commands.T + goal.reach))
        u = np.clip(u, low, high)
        X = np.vstack([state, rollout(state, u.T, wind, bias).full().T])
        parameters = _parameters(goal, wind, bias)
        rows = np.asarray(sample.rows.map(horizon)(X[:-1].T, u.T, X[1:].T).full())
        row_low, row_high = _limits(sample, goal)
        found = solve(
            x0=layout.unknowns(X, u),
            p=parameters,
            lbx=layout.unknowns(np.full_like(X, -np.inf), low),
            ubx=layout.unknowns(np.full_like(X, np.inf), high),
            # as in controller.qp.assemble: what is beyond a limit is never made worse
            lbg=layout.rows(state, np.minimum(row_low, rows)),
            ubg=layout.rows(state, np.maximum(row_high, rows)),
        )
        X, u = layout.nodes(found["x"].full().ravel())
        stats = solve.stats()
        return Shot(
            u=u,
            X=X,
            J=float(found["f"]),
            iterations=int(stats["iter_count"]),
            status=str(stats["return_status"]),
            cpu_s=time.process_time() - began,
        )

    return shoot


def _casadi() -> Any:
    try:
        return import_module("casadi")
    except ModuleNotFoundError:
        raise ValueError(
            "shooting: casadi is missing, got none, expected `pip install hedgehop[paper]`"
        ) from None


class _Sample(NamedTuple):
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
def _sample(model: PredictionModel, hessian: Hessian) -> _Sample:
    """Differentiate one sample, which takes longer than the rest of the building."""
    symbolic = getattr(model, "symbolic", None)
    if symbolic is None:
        raise ValueError(
            f"shooting: the prediction model has no symbolic form, got {type(model).__name__!r}, "
            "expected a model with a method symbolic"
        )
    ca, (advance, outputs) = _casadi(), symbolic()
    x, u, end = (ca.SX.sym(*row) for row in (("x", advance.size1_in(0)), ("u", 4), ("end", 17)))
    goal, common = ca.SX.sym("goal", _GOAL), ca.SX.sym("common", _COMMON)
    z, y = ca.vertcat(x, u), outputs(x, u, end)
    a = ca.vertcat(*(y[model.outputs.index(name)] for name in ACTUATORS))
    limited = [c for c in range(4) if ca.jacobian(a[c], x).nnz()]
    heading = model.outputs.index("heading")
    tilt = (y[model.outputs.index(name)] for name in ("heading", "roll", "pitch"))
    turns = [u[3] - outputs(x, u, x)[heading]] if "heading" in model.commands else []
    rows = ca.vertcat(*tilt, *turns, a[limited])
    errors, weights = _errors(ca, model, y, a, u, goal, common)
    cost = ca.dot(weights, errors**2)

    weight, gap, on = (
        ca.SX.sym("weight"),
        ca.SX.sym("gap", x.numel()),
        ca.SX.sym("on", rows.numel()),
    )
    reached = advance(x, u, common[17:20], common[20:23])
    if hessian == "exact":
        lagrangian = weight * cost - ca.dot(gap, reached) + ca.dot(on, rows)
        curvature = [ca.hessian(lagrangian, v)[0] for v in (z, end)]
    else:
        slopes = [ca.jacobian(errors, v) for v in (z, end)]
        curvature = [2.0 * weight * J.T @ ca.diag(weights) @ J for J in slopes]
    inputs = [x, u, end, goal, common]
    shared = {"cse": True}
    return _Sample(
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
    wanted = ca.vertsplit(goal)
    station = wanted[4] * (north - wanted[6]) + wanted[5] * (east - wanted[7])
    errors = ca.vertcat(
        north - wanted[0],
        east - wanted[1],
        altitude - (wanted[2] + wanted[3] * station),
        heading - wanted[8],
        speed - wanted[9],
        a - common[0:4],
        u - goal[10:14],
    )
    return errors, common[4:17]


class _Layout(NamedTuple):
    """Where unknowns and rows are: stage by stage, which fatrop asks for and all profit from."""

    H: int
    n: int
    m: int
    path: int  # rows on a stage's own state and command

    def unknowns(self, X: Floats, u: Floats) -> Floats:
        """Return (X, u) as one vector."""
        return np.concatenate([np.hstack([X[:-1], u]).ravel(), X[-1]])

    def nodes(self, w: Floats) -> tuple[Floats, Floats]:
        """Return (X, u) of a vector."""
        z = w[: -self.n].reshape(self.H, -1)
        return np.vstack([z[:, : self.n], w[-self.n :]]), z[:, self.n :].copy()

    @property
    def path_rows(self) -> list[int]:
        """Return how many rows each of the H + 1 stages has besides its gap."""
        return [self.n + self.path, *[3 + self.path] * (self.H - 1), 3]

    @property
    def numbers(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows' numbers: gaps (H, n), start (n,), limits (H, 3 + path)."""
        path = np.array(self.path_rows)
        first = np.cumsum([0, *(self.n + path[:-1])])  # of each stage; the last has no gap
        gaps = first[: self.H, None] + np.arange(self.n)
        tilt = first[1:, None] + self.n + np.arange(3)
        tilt[-1] -= self.n
        last = (first + self.n + path)[: self.H, None]
        actuators = last - self.path + np.arange(self.path)
        return gaps, self.n + np.arange(self.n), np.hstack([tilt, actuators])

    def rows(self, start: Floats, limits: Floats) -> Floats:
        """Return all rows' values or bounds from those of the limits, (3 + path, H)."""
        gaps, begin, at = self.numbers
        out = np.zeros(gaps.size + begin.size + at.size)
        out[begin], out[at] = start, limits.T
        return out


def _parameters(goal: Goal, wind: Floats, bias: Floats) -> Floats:
    per_sample = np.vstack([*goal[:10], goal.commands])
    common = goal.actuators, goal.Q, goal.R, goal.Rc, wind, bias
    return np.concatenate([per_sample.T.ravel(), *common])


def _limits(sample: _Sample, goal: Goal) -> tuple[Floats, Floats]:
    """Return the bounds of the rows, (3 + path, H) each."""
    deviation = np.array([goal.heading_limit, goal.attitude_limit, goal.attitude_limit])
    H = len(goal.heading)
    low = np.tile(np.concatenate([-deviation, sample.low])[:, None], H)
    high = np.tile(np.concatenate([deviation, sample.high])[:, None], H)
    low[0] += goal.heading
    high[0] += goal.heading
    return low, high


def _nlp(
    ca: Any, sample: _Sample, layout: _Layout, solver: Solver, iterations: int, tolerance: float
) -> Any:
    """Return the solver as a CasADi function, with derivatives put together from the samples'."""
    H, n, m = layout.H, layout.n, layout.m
    w = ca.MX.sym("x", H * (n + m) + n)
    p = ca.MX.sym("p", H * _GOAL + _COMMON)
    z = ca.reshape(w[: H * (n + m)], n + m, H)
    x, u, end = z[:n, :], z[n:, :], ca.horzcat(z[:n, 1:], w[H * (n + m) :])
    goal, common = ca.reshape(p[: H * _GOAL], _GOAL, H), p[H * _GOAL :]
    gaps, start, limits = layout.numbers
    of_z = (n + m) * np.arange(H)[:, None] + np.arange(n + m)
    of_end = of_z[:, :n] + n + m

    f = ca.sum2(sample.cost.map(H)(x, u, end, goal, common))
    reached = sample.advance.map(H)(x, u, common[17:20], common[20:23])
    stacked = ca.vertcat(ca.vec(end - reached), x[:, 0], ca.vec(sample.rows.map(H)(x, u, end)))
    order = np.argsort(np.concatenate([gaps.ravel(), start, limits.ravel()]))
    g = stacked[order.tolist()]

    by_z, rows_by_z, rows_by_end = sample.slopes.map(H)(x, u, end, common)
    eye = ca.MX.eye(n)
    jacobian = _placed(ca, g.numel(), w.numel(), [
        (-by_z, gaps, of_z),
        (ca.repmat(eye, 1, H), gaps, of_end),
        (eye, start[None], of_z[:1, :n]),
        (rows_by_z, limits, of_z),
        (rows_by_end, limits, of_end),
    ])  # fmt: skip

    weight, on = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    on_gaps = ca.reshape(on[gaps.ravel().tolist()], n, H)
    on_limits = ca.reshape(on[limits.ravel().tolist()], limits.shape[1], H)
    by_z, by_end = sample.curvature.map(H)(x, u, end, goal, common, weight, on_gaps, on_limits)
    triangle = _placed(ca, w.numel(), w.numel(), [(by_z, of_z, of_z)]) + _placed(
        ca, w.numel(), w.numel(), [(by_end, of_end, of_end)]
    )
    if solver == "ipopt":
        hessian = [triangle], ["triu_hess_gamma_x_x"]
        options = {
            "ipopt": {
                "max_iter": iterations,
                "tol": tolerance,
                "constr_viol_tol": 1e-3 * tolerance,
                "bound_relax_factor": 0.0,
                "linear_solver": "mumps",
                "mu_strategy": "adaptive",
                "print_level": 0,
                "sb": "yes",
            }
        }
    else:
        gradient = ca.gradient(weight * f, w) + jacobian.T @ on
        hessian = [gradient, ca.triu2symm(triangle)], ["grad_gamma_x", "hess_gamma_x_x"]
        options = {
            "structure_detection": "manual",
            "N": H,
            "nx": [n] * (H + 1),
            "nu": [m] * H + [0],
            "ng": layout.path_rows,
            "fatrop": {"max_iter": iterations, "tol": tolerance, "print_level": 0},
        }
    derivatives = {
        "nlp_jac_g": ca.Function("nlp_jac_g", [w, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "nlp_hess_l": ca.Function(
            "nlp_hess_l", [w, p, weight, on], hessian[0], ["x", "p", "lam_f", "lam_g"], hessian[1]
        ),
    }
    problem = {"x": w, "p": p, "f": f, "g": g}
    return ca.nlpsol(
        "shoot", solver, problem, {**options, "cache": derivatives, "print_time": False}
    )


def _placed(
    ca: Any, height: int, width: int, pieces: Sequence[tuple[Any, NDArray[Any], NDArray[Any]]]
) -> Any:
    """Return a sparse matrix of blocks side by side, given the row and column numbers of each.

    A piece is (r, c K) with rows (K, r) and columns (K, c).
    """
    values, rows, columns = [], [], []
    for block, row, column in pieces:
        i, j = (np.array(part, dtype=np.int64) for part in block.sparsity().get_triplet())
        k, j = np.divmod(j, column.shape[1])
        values.append(ca.MX(block.nz[:]))
        rows.append(row[k, i])
        columns.append(column[k, j])
    row, column = np.concatenate(rows), np.concatenate(columns)
    order = np.lexsort((row, column))
    pattern = ca.Sparsity.triplet(height, width, row[order].tolist(), column[order].tolist())
    return ca.MX(pattern, ca.vertcat(*values)[order.tolist()])
