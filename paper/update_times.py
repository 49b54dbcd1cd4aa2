"""The clock of figure 7: CPU time of one update from trim, by part and by solver."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.optimise import STEPS
from controller.qp import predicted_cost
from paper.converge import basis
from paper.problem import Problem, costs, goal_of, quadratic_programme, respond
from paper.programme_solvers import Solver, native

Floats = NDArray[np.float64]

PARTS = "rollouts", "assembly", "programme", "line_search"
LAGUERRE, TENTS = ("laguerre", 5), ("tent", 10)


class Times(NamedTuple):
    """CPU time of the parts of one update, s, and what came of it.

    S is identified by ``rollouts``, as in the paper, and counts as such; by ``recursion`` beside it.
    """

    rollouts: float
    assembly: float
    programme: float
    line_search: float
    recursion: float
    J_linear: float
    status: str


MOST: Mapping[str, int] = {"Clarabel, cvxpy": 20, "OSQP, cvxpy": 20, "SLSQP, SciPy": 10}
"""Functions per channel beyond which a solver is not asked: it would take minutes."""


def cpu_s(work: Callable[[], Any], repetitions: int) -> tuple[float, Any]:
    """Return the least CPU time of some repetitions, s, and what the work returns.

    What takes long is not repeated beyond a fifth of a second.
    """
    least, spent, result = np.inf, 0.0, None
    while repetitions > 0 and spent < 0.2:
        begun = time.process_time()
        result = work()
        taken = time.process_time() - begun
        least, spent, repetitions = min(least, taken), spent + taken, repetitions - 1
    return least, result


def update(
    problem: Problem, Phi: Floats, chosen: Mapping[str, Solver], repetitions: int
) -> dict[str, Times]:
    """Return the CPU times of one update from trim in the columns Phi (4, H, m), by solver."""
    u0 = problem.u0
    size = problem.amplitude
    first, response = cpu_s(lambda: respond(problem, Phi, amplitude=size), repetitions)
    beside, _ = cpu_s(lambda: respond(problem, Phi), repetitions)
    second, data = cpu_s(lambda: quadratic_programme(problem, response, u0), repetitions)
    model, found = problem.model, {}
    for name, solver in chosen.items():
        third, (alpha, status) = cpu_s(partial(solver, data), repetitions)
        tried = u0 + np.array([0.0, *STEPS])[:, None, None] * (Phi @ alpha).T
        tried = np.clip(tried, model.command_min, model.command_max)
        fourth, _ = cpu_s(partial(costs, problem, tried), repetitions)
        found[name] = Times(
            first, second, third, fourth, beside, predicted_cost(data, alpha), status
        )
    return found


def sweep(
    problems: Sequence[Problem],
    sizes: Sequence[tuple[str, int]],
    chosen: Mapping[str, Solver],
    repetitions: int,
    progress: Callable[[str], None],
) -> dict[str, list[Any]]:
    """Return mean and standard deviation over problems, ms, per family, number and solver.

    ``excess`` is the largest relative excess of the programme's optimum over the first solver's.
    """
    names = ["family", "bases_per_channel", "solver", *(f"{part}_ms" for part in PARTS)]
    names += ["recursion_ms", "total_ms", "total_std_ms", "programme_std_ms", "excess", "statuses"]
    columns: dict[str, list[Any]] = {name: [] for name in names}
    for family, count in sizes:
        progress(f"{family}, {count} per channel")
        Phi = basis(family, count, problems[0].horizon)
        able = {name: solver for name, solver in chosen.items() if count <= MOST.get(name, count)}
        found = [update(problem, Phi, able, repetitions) for problem in problems]
        least = np.array([next(iter(each.values())).J_linear for each in found])
        for name in able:
            times = [each[name] for each in found]
            parts = 1e3 * np.array([each[:5] for each in times])
            total = parts[:, :4].sum(axis=1)
            excess = np.array([each.J_linear for each in times]) / least - 1.0
            statuses = " ".join(sorted({each.status for each in times}))
            numbers = (
                *parts.mean(axis=0),
                total.mean(),
                total.std(),
                parts[:, 2].std(),
                excess.max(),
            )
            row = (family, count, name, *map(float, numbers), statuses)
            for column, value in zip(columns.values(), row, strict=True):
                column.append(value)
    return columns


def ratios(columns: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return 10 tents over 5 Laguerre polynomials, per solver: whole updates, programmes alone."""
    names = "family", "bases_per_channel", "solver", "total_ms", "total_std_ms", "programme_ms"
    rows = {row[:3]: row[3:] for row in zip(*(columns[name] for name in names), strict=True)}
    chosen = list(dict.fromkeys(columns["solver"]))
    ten = [rows[(*TENTS, name)] for name in chosen]
    five = [rows[(*LAGUERRE, name)] for name in chosen]
    return {
        "solver": chosen,
        "tents_10_ms": [row[0] for row in ten],
        "tents_10_std_ms": [row[1] for row in ten],
        "laguerre_5_ms": [row[0] for row in five],
        "laguerre_5_std_ms": [row[1] for row in five],
        "ratio": [a[0] / b[0] for a, b in zip(ten, five, strict=True)],
        "ratio_of_programmes": [a[2] / b[2] for a, b in zip(ten, five, strict=True)],
    }


def identifications(
    problem: Problem, counts: Sequence[int], repetitions: int
) -> dict[str, list[Any]]:
    """Return CPU time, ms, of identifying S by rollouts and by recursion, and how S differs."""
    columns: dict[str, list[Any]] = {
        name: []
        for name in ("bases_per_channel", "rollouts_ms", "recursion_ms", "relative_difference")
    }
    for count in counts:
        Phi = basis("laguerre", count, problem.horizon)
        by_rollouts, flown = cpu_s(
            lambda Phi=Phi: respond(problem, Phi, amplitude=problem.amplitude), repetitions
        )
        by_recursion, exact = cpu_s(lambda Phi=Phi: respond(problem, Phi), repetitions)
        difference = np.linalg.norm(flown.S - exact.S) / np.linalg.norm(exact.S)
        row = count, 1e3 * by_rollouts, 1e3 * by_recursion, float(difference)
        for column, value in zip(columns.values(), row, strict=True):
            column.append(value)
    return columns


def without_bases(
    problem: Problem, *, optimum: bool, progress: Callable[[str], None]
) -> dict[str, list[Any]]:
    """Return time, ms, and J of what does without bases: one full-order pass, the true optimum."""
    columns: dict[str, list[Any]] = {"what": [], "iterations": [], "total_ms": [], "J": []}
    progress("full order, 200 per channel")
    Phi = basis("full", problem.horizon, problem.horizon)
    times = update(problem, Phi, {"DAQP": native("daqp")}, 1)["DAQP"]
    rows: list[Any] = [("full order, DAQP", 1, 1e3 * sum(times[:4]), times.J_linear)]
    if optimum:
        from controller.shooting import shooter

        progress("IPOPT")
        shoot = shooter(problem.model, problem.horizon)
        shot = shoot(problem.state, problem.u0, goal_of(problem))
        rows.append(("nonlinear, IPOPT", shot.iterations, 1e3 * shot.cpu_s, shot.J))
    for row in rows:
        for column, value in zip(columns.values(), row, strict=True):
            column.append(value)
    return columns
