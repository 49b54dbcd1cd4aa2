"""Ways to solve the quadratic programme of an update: ours, and what a user would write."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.qp import QPData
from controller.solvers import solve

Floats = NDArray[np.float64]
Solver = Callable[[QPData], tuple[Floats, str]]
"""Returns the coefficients and a status."""


def native(backend: str) -> Solver:
    """Return a solver of :mod:`controller.solvers`."""

    def solver(data: QPData) -> tuple[Floats, str]:
        solution = solve(data, backend)
        return solution.alpha, solution.status.value

    return solver


def through_cvxpy(name: str, **options: Any) -> Solver:
    """Return a solver told a cvxpy model that is built anew each time, as a user would write it.

    Raises
    ------
    ImportError
        If cvxpy does not know the solver here.
    """
    import cvxpy as cp

    if name not in cp.installed_solvers():
        raise ImportError(
            f"solver {name!r}: not installed, expected one of {cp.installed_solvers()}"
        )

    def solver(data: QPData) -> tuple[Floats, str]:
        import warnings

        D = data.H.diagonal() ** -0.5
        x = cp.Variable(len(data.f))
        factor = np.linalg.cholesky(data.H * D * D[:, None])
        A = data.A * D
        rows: list[Any] = [A @ x >= data.lower, A @ x <= data.upper]
        cost = 0.5 * cp.sum_squares(factor.T @ x) + (data.f * D) @ x
        model = cp.Problem(cp.Minimize(cost), rows)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "may be inaccurate": the status says so
            try:
                model.solve(solver=name, **options)
            except cp.SolverError:
                return np.zeros(len(data.f)), "failed"
        if x.value is None:
            return np.zeros(len(data.f)), str(model.status)
        return D * np.asarray(x.value), str(model.status)

    return solver


def slsqp(data: QPData, iterations: int = 200) -> tuple[Floats, str]:
    """Solve by SciPy's sequential least squares, told the gradient: a plain formulation.

    It stands for the general optimisers of the paper's time.
    """
    from scipy.optimize import LinearConstraint, minimize

    D = data.H.diagonal() ** -0.5
    P, q = data.H * D * D[:, None], data.f * D

    def cost(x: Floats) -> float:
        return float(0.5 * x @ P @ x + q @ x)

    def gradient(x: Floats) -> Floats:
        return P @ x + q

    minimise: Any = minimize  # its stubs want lists of constraints of one kind
    found = minimise(
        cost,
        np.zeros(len(q)),
        jac=gradient,
        method="SLSQP",
        constraints=[LinearConstraint(data.A * D, data.lower, data.upper)],
        options={"maxiter": iterations, "ftol": 1e-9},
    )
    return D * np.asarray(found.x), "optimal" if found.success else str(found.message)


def solvers() -> Mapping[str, Solver]:
    """Return the solvers that are compared."""
    return {
        "DAQP": native("daqp"),
        "PIQP": native("piqp"),
        "Clarabel, cvxpy": through_cvxpy("CLARABEL"),
        "OSQP, cvxpy": through_cvxpy("OSQP", eps_abs=1e-5, eps_rel=1e-5, max_iter=20000),
        "SLSQP, SciPy": slsqp,
    }
