"""Polynomials of equal degree span one space: the same optimum whatever their name, in numbers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.bases import BASES, orthonormalise
from controller.prediction import stack_bases
from controller.qp import predicted_cost
from controller.solvers import solve_with_fallback
from paper.problem import Problem, quadratic_programme, respond
from paper.study import Table

Floats = NDArray[np.float64]

READINGS: dict[str, tuple[str, dict[str, Any]]] = {
    "Laguerre, t in s": ("laguerre", {"sample_period": 0.05, "time": "seconds"}),
    "Laguerre, t on [0, 1]": ("laguerre", {"sample_period": 0.05, "time": "normalised"}),
    "Legendre": ("legendre", {}),
    "Chebyshev": ("chebyshev", {}),
}
"""The polynomials as they are written: family and options."""


def columns(reading: str, count: int, horizon: int = 200) -> Floats:
    """Return a family's own columns, (H, n), of whatever size and angles they are."""
    family, options = READINGS[reading]
    return BASES[family](horizon, count, **options)


def optima(problem: Problem, count: int) -> dict[str, tuple[float, float, float, str]]:
    """Return (J_lin, cond B, cond of the Hessian, solver) of the first quadratic programme.

    It is assembled once, on orthonormal columns from the exact S, and written in each family's own
    coefficients, alpha = M beta. Whatever differs is rounding: in the mapping and in the solver.
    """
    legendre = columns("Legendre", count, problem.horizon)
    Phi, _ = orthonormalise(legendre)
    response = respond(problem, stack_bases([Phi] * 4))
    data = quadratic_programme(problem, response, problem.u0)
    found: dict[str, tuple[float, float, float, str]] = {}
    for name in ("orthonormal", *READINGS):
        B = Phi if name == "orthonormal" else columns(name, count, problem.horizon)
        M = np.kron(np.eye(4), Phi.T @ B / problem.horizon)
        own = replace(data, H=M.T @ data.H @ M, f=M.T @ data.f, A=data.A @ M)
        solution = solve_with_fallback(own)
        J = predicted_cost(data, M @ solution.alpha)
        sizes = float(np.linalg.cond(B)), float(np.linalg.cond(own.H))
        found[name] = (J, *sizes, f"{solution.backend}: {solution.status.value}")
    return found


def same_span(problem: Problem, counts: Sequence[int] = (3, 5, 7, 9)) -> Table:
    """Return the optima by number of functions and family, and how far each is from the first."""
    rows: list[tuple[Any, ...]] = []
    for n in counts:
        found = optima(problem, n)
        best = found["orthonormal"][0]
        rows += [(n, name, J, J / best - 1.0, *others) for name, (J, *others) in found.items()]
    names = (
        "functions", "columns", "J_linear", "relative_difference", "condition_B",
        "condition_Hessian", "solver",
    )  # fmt: skip
    return Table(
        name="same_span",
        title="The same span, the same optimum",
        caption="First quadratic programme of the 10 m step at 3 s, attitude form: assembled once from "
        "the exact S on orthonormal columns, then written in each family's own coefficients. "
        "Polynomials of one degree span one space; only the conditioning differs.",
        columns=dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)),
    )
