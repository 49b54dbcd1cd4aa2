"""Optimisers that stop early: the same quadratic programme in four sets of coordinates."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.prediction import stack_bases
from controller.qp import QPData, predicted_cost
from controller.solvers import solve
from paper.perturbation import COLUMNS, ORTHONORMAL
from paper.problem import altitude_step, quadratic_programme, respond
from paper.study import Claim, Figure, Study, Table
from paper.style import marked

Floats = NDArray[np.float64]

LEGENDRE = "raw Legendre"


def in_columns(data: QPData, columns: str) -> QPData:
    """Return a programme in orthonormal coefficients as one in those of other columns.

    With B = Phi C, a change Phi alpha is B beta for alpha = C beta: S, and with it the programme, is
    mapped exactly, so that only the coordinates differ.
    """
    Phi = COLUMNS[ORTHONORMAL]
    C = np.kron(np.eye(4), Phi.T @ COLUMNS[columns] / len(Phi))
    return replace(data, H=C.T @ data.H @ C, f=data.f @ C, A=data.A @ C)


def osqp(data: QPData, iterations: int = 25) -> Floats:
    """Return where OSQP's splitting method is after some iterations."""
    from osqp import OSQP
    from scipy.sparse import csc_matrix

    solver = OSQP()
    solver.setup(
        csc_matrix(data.H), data.f, csc_matrix(data.A), data.lower, data.upper,
        max_iter=iterations, check_termination=0, adaptive_rho_interval=25, verbose=False,
    )  # fmt: skip
    return np.asarray(solver.solve(raise_error=False).x, dtype=np.float64)


def gradient_descent(data: QPData, iterations: int = 1000) -> Floats:
    """Return the end of steepest descent with the largest constant step that always descends.

    Rows are left to :func:`suboptimality`.
    """
    step = 1.0 / np.linalg.eigvalsh(data.H)[-1]
    alpha = np.zeros(len(data.f))
    for _ in range(iterations):
        alpha -= step * (data.H @ alpha + data.f)
    return alpha


def slsqp(data: QPData, iterations: int = 40) -> Floats:
    """Return the end of sequential quadratic programming with finite-difference gradients.

    SciPy's SLSQP to 1e-4 of the nominal cost: a general optimiser of the paper's time.
    """
    from scipy.optimize import LinearConstraint, minimize

    def cost(alpha: Floats) -> float:
        return predicted_cost(data, alpha) / data.constant

    found = minimize(
        cost,
        np.zeros(len(data.f)),
        method="SLSQP",
        constraints=LinearConstraint(data.A, data.lower, data.upper),
        options={"maxiter": iterations, "ftol": 1e-4},
    )
    return np.asarray(found.x, dtype=np.float64)


OPTIMISERS: Mapping[str, Callable[[QPData], Floats]] = {
    "OSQP, 25 iterations": osqp,
    "gradient descent, 1000 iterations": gradient_descent,
    "SLSQP, finite differences, 40 iterations": slsqp,
}


def suboptimality(data: QPData, alpha: Floats, optimum: float) -> float:
    """Return (J - J*)/J* of the longest part of alpha that violates no row; alpha = 0 never does."""
    change = data.A @ alpha
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(change > 0, data.upper, data.lower) / change
    part = float(np.min(room[change != 0], initial=1.0))
    return predicted_cost(data, part * alpha) / optimum - 1.0


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return how far from the optimum each optimiser stops, in each set of coordinates."""
    del quick
    progress("capped and first-order optimisers")
    problem = altitude_step()
    response = respond(problem, stack_bases([COLUMNS[ORTHONORMAL]] * 4))
    data = quadratic_programme(problem, response, problem.u0)
    optimum = predicted_cost(data, solve(data, "piqp").alpha)
    programmes = {columns: in_columns(data, columns) for columns in COLUMNS}
    found = {
        optimiser: {
            columns: suboptimality(one, run(one), optimum) for columns, one in programmes.items()
        }
        for optimiser, run in OPTIMISERS.items()
    }
    condition = {columns: np.linalg.cond(one.H) for columns, one in programmes.items()}
    table: dict[str, list[Any]] = {
        "columns": list(COLUMNS),
        "condition_number_of_H": [condition[columns] for columns in COLUMNS],
        **{name: [each[columns] for columns in COLUMNS] for name, each in found.items()},
    }
    raw = [columns for columns in COLUMNS if columns not in (LEGENDRE, ORTHONORMAL)]
    better = [each[LEGENDRE] < each[columns] for each in found.values() for columns in raw]
    return Study(
        title="Optimisers that stop early",
        text="One programme, four sets of coordinates for the same space: an exact solver finds one "
        "optimum. An optimiser that is stopped, or follows gradients, gets less far the worse the "
        "condition number. This is a way in which the choice between Laguerre and Legendre "
        "polynomials can matter, and it speaks for Legendre against Laguerre on [0, 1]; in seconds "
        "the two are much alike, and orthonormal columns are the safe choice.",
        figures=(
            Figure(
                name="optimisers",
                title="Optimisers that stop early",
                caption=f"(J - J*)/J* of the linear model; 10 m step at 3 s, five functions per "
                f"channel, attitude form, J* = {optimum:.1f}, J = {data.constant:.0f} at trim. Exact "
                "S, mapped from orthonormal columns. What violates a limit is shortened to it.",
                table=table,
                draw=partial(_draw, table=table),
                size_in=(8.0, 4.2),
            ),
        ),
        tables=(
            Table(
                name="optimisers_suboptimality",
                title="Relative suboptimality by optimiser and columns",
                caption="(J - J*)/J*; 0 is the optimum.",
                columns={
                    name: [
                        f"{value:.2g}" if isinstance(value, float) else value for value in column
                    ]
                    for name, column in table.items()
                },
            ),
        ),
        claims=(
            Claim(
                where="IV.B",
                statement="with Legendre polynomials the optimiser has trouble computing feasible "
                "controls and fails to converge, with Laguerre polynomials it does not",
                verdict="does not hold" if sum(better) > len(better) / 2 else "holds in part",
                theirs="Legendre eliminated",
                ours="; ".join(
                    f"{name}: " + ", ".join(f"{one} {each[one]:.2g}" for one in COLUMNS)
                    for name, each in found.items()
                ),
                reason="Of equal order both span one space, with one optimum. Stopped early, "
                f"optimisers are closer to it with Legendre columns in {sum(better)} of "
                f"{len(better)} comparisons, as the condition of H says: "
                + ", ".join(f"{one} {value:.0e}" for one, value in condition.items())
                + ".",
            ),
        ),
    )


def _draw(picture: Any, table: Mapping[str, Any]) -> None:
    axes = picture.subplots()
    for number, columns in enumerate(table["columns"]):
        at = np.arange(len(OPTIMISERS)) + (number - 1.5) * 0.12
        style = {**marked(number), "linestyle": "none", "markersize": 9.0}
        axes.semilogy(at, [table[name][number] for name in OPTIMISERS], **style, label=columns)
    names = [name.replace(", ", "\n") for name in OPTIMISERS]
    axes.set_xticks(range(len(OPTIMISERS)), names)
    axes.set(ylabel="(J - J*)/J*")
    axes.grid(visible=False, axis="x")
    picture.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
