"""Solve the quadratic program of :mod:`controller.qp` with one of three back ends.

All are told the same scaled problem, in which the slack, if there are soft rows, is one more
unknown, x = [sigma, alpha] / D with D = diag(P)^{-1/2}:

    minimise  1/2 x' P x + q' x    subject to  lower <= G x <= upper

None is asked where the optimum without rows, -H^{-1} f, satisfies them all: that is the optimum, and
in calm flight the rule. No answer is believed for its status alone: it counts as optimal if the solver
says exactly that *and* the optimality conditions hold to :data:`TOLERANCE`. Failure is data, never an
exception. Work is limited in iterations, never in time, so that a flight can be repeated bit for bit.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from enum import Enum
from types import MappingProxyType
from typing import Any, NamedTuple

import daqp
import numpy as np
import piqp
from numpy.typing import NDArray

from controller.qp import QPData, slack

Array = NDArray[np.float64]

TOLERANCE = 1e-6  # largest accepted violation of an optimality condition
DAQP_INFINITY = 1e30
ITERATION_LIMITS: Mapping[str, int] = MappingProxyType({"daqp": 5000, "piqp": 250, "cvxpy": 200})


class Status(Enum):
    """How a solution came to be, or why there is none."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration limit"
    NON_FINITE = "non-finite data"
    INACCURATE = "inaccurate"
    FAILED = "numerical failure"


@dataclass(frozen=True)
class Solution:
    """A solver's answer; with any status but ``OPTIMAL``, alpha = 0.

    Attributes
    ----------
    alpha : ndarray, shape (m,)
        Coefficients.
    sigma : float
        Slack of the soft rows, in their unit.
    status : Status
    backend : str
        Whose answer it is; "none" for the last rung of :func:`solve_with_fallback`.
    iterations : int
        Of the back end; 0 where no row was in the way and it was not asked.
    multiplier_max : float
        Largest multiplier of any row, in size.
    soft_multiplier_sum : float
        Sum of the soft rows' multipliers. Below rho1 the penalty is exact: the solution is that of
        the hard problem. When it is reached, sigma > 0 buys what the rows do not allow.
    reason : str
        What failed before this answer; empty if nothing did.
    """

    alpha: Array
    sigma: float
    status: Status
    backend: str
    iterations: int = 0
    multiplier_max: float = 0.0
    soft_multiplier_sum: float = 0.0
    reason: str = ""


class _Problem(NamedTuple):
    """The scaled problem that every back end is told."""

    P: Array
    q: Array
    G: Array
    lower: Array
    upper: Array


class _Answer(NamedTuple):
    """x, one multiplier per row (> 0 at the upper bound, < 0 at the lower), and how it went."""

    x: Array
    y: Array
    status: Status
    iterations: int


def _with_slack(data: QPData) -> _Problem:
    """Return the problem in [sigma, alpha] if there are soft rows, in alpha if there are none."""
    if len(data.soft_lower) == 0:
        return _Problem(data.H, data.f, data.A, data.lower, data.upper)
    m, r, s = len(data.f), len(data.lower), len(data.soft_lower)
    P = np.zeros((m + 1, m + 1))
    P[0, 0] = data.rho2
    P[1:, 1:] = data.H
    G = np.zeros((r + s + 1, m + 1))
    G[:r, 1:] = data.A
    G[r:-1, 1:] = data.soft_A
    G[r:, 0] = 1.0  # in the soft rows, and sigma >= 0
    lower = np.concatenate([data.lower, data.soft_lower, [0.0]])
    upper = np.concatenate([data.upper, np.full(s + 1, np.inf)])
    return _Problem(P, np.concatenate([[data.rho1], data.f]), G, lower, upper)


def _scaled(problem: _Problem) -> tuple[_Problem, Array]:
    """Return the problem in x / D, whose Hessian has a unit diagonal, and D."""
    P, q, G, lower, upper = problem
    D = np.diag(P) ** -0.5
    return _Problem(P * D * D[:, None], q * D, G * D, lower, upper), D


def _daqp(problem: _Problem, iteration_limit: int) -> _Answer:
    """Solve by a dual active set (one-shot: warm starts buy nothing at this size)."""
    x, _, flag, info = daqp.solve(
        problem.P,
        problem.q,
        problem.G,
        np.minimum(problem.upper, DAQP_INFINITY),
        np.maximum(problem.lower, -DAQP_INFINITY),
        np.zeros(len(problem.lower), dtype=np.intc),
        primal_tol=1e-9,
        iter_limit=iteration_limit,
    )
    flags = {1: Status.OPTIMAL, -1: Status.INFEASIBLE, -4: Status.ITERATION_LIMIT}
    return _Answer(
        np.asarray(x), np.asarray(info["lam"]), flags.get(flag, Status.FAILED), info["iterations"]
    )


def _piqp(problem: _Problem, iteration_limit: int) -> _Answer:
    """Solve by a proximal interior-point method, dense."""
    solver: Any = piqp.DenseSolver()
    settings = solver.settings
    settings.max_iter = iteration_limit
    settings.eps_abs = settings.eps_rel = 1e-10
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = 1e-10
    solver.setup(
        problem.P,
        problem.q,
        G=np.asfortranarray(problem.G),
        h_l=problem.lower,
        h_u=problem.upper,
    )
    statuses = {
        piqp.PIQP_SOLVED: Status.OPTIMAL,
        piqp.PIQP_PRIMAL_INFEASIBLE: Status.INFEASIBLE,
        piqp.PIQP_MAX_ITER_REACHED: Status.ITERATION_LIMIT,
    }
    status = statuses.get(solver.solve(), Status.FAILED)
    result = solver.result
    return _Answer(np.array(result.x), result.z_u - result.z_l, status, result.info.iter)


def _cvxpy(problem: _Problem, iteration_limit: int) -> _Answer:
    """Solve a cvxpy model by Clarabel.

    The model is built anew from the numbers: as cvxpy parameters, matrices of this size cost more
    than the building.
    """
    import warnings

    import cvxpy as cp

    failed = _Answer(np.zeros(len(problem.q)), np.zeros(len(problem.lower)), Status.FAILED, 0)
    try:
        factor = np.linalg.cholesky(problem.P)
    except np.linalg.LinAlgError:
        return failed
    x = cp.Variable(len(problem.q))
    objective = cp.Minimize(0.5 * cp.sum_squares(factor.T @ x) + problem.q @ x)
    above, below = np.isfinite(problem.upper), np.isfinite(problem.lower)
    rows = [
        problem.G[above] @ x <= problem.upper[above],
        problem.G[below] @ x >= problem.lower[below],
    ]
    model = cp.Problem(objective, [row for row in rows if row.size > 0])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "may be inaccurate": the status says so
            model.solve(
                solver=cp.CLARABEL,
                max_iter=iteration_limit,
                tol_gap_abs=1e-10,
                tol_gap_rel=1e-10,
                tol_feas=1e-10,
            )
    except cp.SolverError:
        return failed
    statuses = {
        cp.OPTIMAL: Status.OPTIMAL,
        cp.INFEASIBLE: Status.INFEASIBLE,
        cp.USER_LIMIT: Status.ITERATION_LIMIT,
    }
    status = statuses.get(model.status, Status.FAILED)
    iterations = model.solver_stats.num_iters or 0
    if status is not Status.OPTIMAL:
        return failed._replace(status=status, iterations=iterations)
    y = failed.y.copy()
    for side, row, sign in ((above, rows[0], 1.0), (below, rows[1], -1.0)):
        if row.size > 0:
            y[side] += sign * np.asarray(row.dual_value, dtype=np.float64)
    return _Answer(np.asarray(x.value, dtype=np.float64), y, status, iterations)


BACKENDS: Mapping[str, Callable[[_Problem, int], _Answer]] = MappingProxyType(
    {"daqp": _daqp, "piqp": _piqp, "cvxpy": _cvxpy}
)


def _residual(problem: _Problem, x: Array, y: Array) -> float:
    """Return the largest violation of the optimality conditions of the scaled problem.

    Stationarity relative to q, feasibility in units of the rows, complementarity relative to the
    optimum.
    """
    Gx, Px = problem.G @ x, problem.P @ x
    stationarity = np.abs(Px + problem.q + problem.G.T @ y).max() / (1 + np.abs(problem.q).max())
    violation = np.max(np.maximum(Gx - problem.upper, problem.lower - Gx), initial=0.0)
    room = np.where(y > 0, problem.upper - Gx, Gx - problem.lower)
    active = y != 0
    gap = np.abs(y[active] * room[active]).sum() / (1 + abs(0.5 * x @ Px + problem.q @ x))
    return float(max(stationarity, violation, gap))


def solve(data: QPData, backend: str = "daqp", *, iteration_limit: int | None = None) -> Solution:
    """Solve a quadratic program.

    Parameters
    ----------
    data : QPData
    backend : {"daqp", "piqp", "cvxpy"}
        Dual active set; proximal interior point; a cvxpy model solved by Clarabel.
    iteration_limit : int, optional
        Of the back end; :data:`ITERATION_LIMITS` if not given.

    Returns
    -------
    Solution
        Whatever the data: a problem that cannot be solved gives a status.

    Raises
    ------
    KeyError
        If the back end is unknown.
    """
    if backend not in BACKENDS:
        near = get_close_matches(backend, BACKENDS, n=1, cutoff=0.0)[0]
        raise KeyError(f"solver: unknown name, got {backend!r}, expected one such as {near!r}")
    zero = Solution(np.zeros(len(data.f)), 0.0, Status.OPTIMAL, backend)
    if not (np.isfinite(data.H).all() and np.isfinite(data.f).all()):
        return replace(zero, status=Status.NON_FINITE)
    if data.H.diagonal().min() <= 0:
        return replace(zero, status=Status.FAILED)
    # an optimum without rows that satisfies them is the optimum with them, and cheaper
    free = _unconstrained(data)
    if free is not None and _allowed(data, free):
        return replace(zero, alpha=free)
    limit = ITERATION_LIMITS[backend] if iteration_limit is None else iteration_limit
    if len(data.soft_lower) > 0:
        hard_only = replace(data, soft_A=data.soft_A[:0], soft_lower=data.soft_lower[:0])
        solution = _ask(hard_only, backend, limit)
        if solution.status is Status.OPTIMAL and slack(data, solution.alpha) == 0.0:
            return solution
    return _ask(data, backend, limit)


def _unconstrained(data: QPData) -> Array | None:
    """Return -H^{-1} f, or None where that is no minimum to :data:`TOLERANCE`."""
    D = data.H.diagonal() ** -0.5
    P, q = data.H * D * D[:, None], data.f * D
    try:
        np.linalg.cholesky(P)
        x = np.linalg.solve(P, -q)
    except np.linalg.LinAlgError:
        return None
    stationary = np.abs(P @ x + q).max() <= TOLERANCE * (1 + np.abs(q).max())
    return D * x if stationary else None


def _allowed(data: QPData, alpha: Array) -> bool:
    """Return whether alpha satisfies every row, without tolerance."""
    change = data.A @ alpha
    hard = (data.lower <= change).all() and (change <= data.upper).all()
    return bool(hard) and slack(data, alpha) == 0.0


def _ask(data: QPData, backend: str, iteration_limit: int) -> Solution:
    """Return the answer of a back end if it is optimal, else alpha = 0 and why it is not."""
    zero = Solution(np.zeros(len(data.f)), 0.0, Status.OPTIMAL, backend)
    finite = all(np.isfinite(part).all() for part in (data.A, data.soft_A, data.soft_lower))
    if not finite or np.isnan(data.lower).any() or np.isnan(data.upper).any():
        return replace(zero, status=Status.NON_FINITE)
    zero = replace(zero, sigma=slack(data, zero.alpha))
    if np.any(data.lower > data.upper):  # DAQP would call such a problem optimal
        return replace(zero, status=Status.INFEASIBLE)
    problem, D = _scaled(_with_slack(data))
    x, y, status, iterations = BACKENDS[backend](problem, iteration_limit)
    if status is Status.OPTIMAL and not _residual(problem, x, y) <= TOLERANCE:  # a NaN is refused
        status = Status.INACCURATE
    if status is not Status.OPTIMAL:
        return replace(zero, status=status, iterations=iterations)
    hard = len(data.lower)
    alpha = (D * x)[-len(data.f) :]
    return Solution(
        alpha=alpha,
        sigma=slack(data, alpha),
        status=status,
        backend=backend,
        iterations=iterations,
        multiplier_max=float(np.max(np.abs(y), initial=0.0)),
        soft_multiplier_sum=float(np.abs(y[hard : hard + len(data.soft_lower)]).sum()),
    )


def solve_with_fallback(data: QPData, backend: str = "daqp") -> Solution:
    """Solve by a back end, else by PIQP, else answer alpha = 0, which is always allowed.

    ``reason`` tells what failed; the last rung, ``backend == "none"``, has the first status.
    """
    failures: list[Solution] = []
    reason = ""
    for name in dict.fromkeys((backend, "piqp")):
        solution = solve(data, name)
        if solution.status is Status.OPTIMAL:
            return replace(solution, reason=reason)
        failures.append(solution)
        reason = "; ".join(f"{failed.backend}: {failed.status.value}" for failed in failures)
    return replace(failures[0], backend="none", reason=reason)
