"""The optimum itself: direct multiple shooting on the nonlinear model, without bases or linearisation.

CasADi (extra ``paper``) states the problem, IPOPT or fatrop solves it.
"""

# pyright: basic
# CasADi has no types

import time
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from controller.prediction import PredictionModel
from controller.shooting_nlp import Layout, Solver, programme
from controller.shooting_sample import Hessian, Sample, differentiated

Floats = NDArray[np.float64]


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
    sample = differentiated(model, hessian)
    layout = Layout(horizon, len(model.states), len(model.commands), len(sample.low))
    solve = programme(sample, layout, solver, iterations, tolerance)
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


def _parameters(goal: Goal, wind: Floats, bias: Floats) -> Floats:
    per_sample = np.vstack([*goal[:10], goal.commands])
    common = goal.actuators, goal.Q, goal.R, goal.Rc, wind, bias
    return np.concatenate([per_sample.T.ravel(), *common])


def _limits(sample: Sample, goal: Goal) -> tuple[Floats, Floats]:
    """Return the bounds of the rows, (3 + path, H) each."""
    deviation = np.array([goal.heading_limit, goal.attitude_limit, goal.attitude_limit])
    H = len(goal.heading)
    low = np.tile(np.concatenate([-deviation, sample.low])[:, None], H)
    high = np.tile(np.concatenate([deviation, sample.high])[:, None], H)
    low[0] += goal.heading
    high[0] += goal.heading
    return low, high
