"""The least cost of the altitude step by family and number of basis functions."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from controller.learned import Learned, learned_basis
from controller.prediction import stack_bases
from paper import same_span
from paper.attained import COARSE
from paper.converge import Floats, basis, converge
from paper.learn import train
from paper.problem import Form, Problem, altitude_step, level_flight

STEP_S = 3.0
OTHER_STEPS_S = (0.0, 1.5, 5.0)
COUNTS, FEW = tuple(range(1, 31)), (3, 5, 7, 10, 20)
SPAN = "polynomials, orthonormal"
FUNCTIONS = "Laguerre functions"
POLYTOPES = ("tents", "ramps", "boxes")
SPANS: Mapping[str, str] = {
    SPAN: "legendre",
    FUNCTIONS: "laguerre_function",
    "tents": "tent",
    "ramps": "ramp",
    "boxes": "box",
    "B-splines": "bspline",
}
"""Identified exactly, on orthonormal columns."""
LEARNED = "learned, 4 n coupled"
"""Principal directions of optimal moves, each on all channels, at a speed that was not trained on."""
EXACT = (*SPANS, LEARNED)
RAW = tuple(same_span.READINGS)
"""Identified as the paper does: each polynomial in turn, one-sided, by a finite perturbation."""


class Least(NamedTuple):
    """The least cost with n functions of a family per channel; ``paper.converge.Converged``."""

    columns: str
    functions: int
    step_s: float
    J: float
    J_linear: float
    J_full_step: float
    J_first: float
    passes: int
    failures: int


@cache
def _learned(form: Form) -> Learned:
    speeds = 25.0, 35.0
    directions = train(form, speeds=speeds, number=4 * COUNTS[-1])
    model = level_flight(form=form).model
    return Learned(np.array(speeds), directions, tuple(model.commands), model.sample_period)


def columns_of(name: str, n: int, problem: Problem) -> Floats | None:
    """Return a family's columns, (4, H, 4 n), or None where there is no such basis."""
    if name in RAW:
        return stack_bases([same_span.columns(name, n, problem.horizon)] * 4)
    if name == LEARNED:
        known = _learned(problem.form)
        return learned_basis(known, problem.horizon, 4 * n, speed=30.0, commands=known.commands,
                             sample_period=known.sample_period)  # fmt: skip
    return None if name == "B-splines" and n < 4 else basis(SPANS[name], n, problem.horizon)


def least(columns: str, n: int, at_s: float, form: Form = "attitude") -> Least | None:
    """Return the least cost of an altitude step, or None where there is no such basis."""
    problem = altitude_step(at_s=at_s, form=form)
    Phi = columns_of(columns, n, problem)
    if Phi is None:
        return None
    end = converge(problem, Phi, amplitude=COARSE if columns in RAW else None)
    return Least(columns, n, at_s, end.J, end.J_linear, end.J_full_step, end.J_first, end.passes,
                 end.failures)  # fmt: skip


def sweep(
    columns: Iterable[str], counts: Sequence[int], at_s: float, form: Form = "attitude"
) -> list[Least]:
    """Return the least costs of families over the number of functions."""
    found = (least(name, n, at_s, form) for name in columns for n in counts)
    return [each for each in found if each is not None]


def curve(rows: Iterable[Least], columns: str, at_s: float = STEP_S) -> dict[int, Least]:
    """Return a family's least costs by number of functions."""
    return {r.functions: r for r in rows if r.columns == columns and r.step_s == at_s}


def rises(costs: Mapping[int, float], beyond: int = 0, tolerance: float = 0.01) -> list[int]:
    """Return the numbers above ``beyond`` whose cost is more than 1 % above that of the next fewer."""
    counts = sorted(costs)
    return [
        n
        for fewer, n in pairwise(counts)
        if n > beyond and costs[n] > (1 + tolerance) * costs[fewer]
    ]


def table_of(rows: Sequence[Least]) -> dict[str, list[Any]]:
    """Return least costs as columns of a table."""
    return {name: [getattr(row, name) for row in rows] for name in Least._fields}


def excess(r: Least, optima: Mapping[float, float]) -> float:
    """Return how far a cost is above J*, percent; ``optima`` by time of the step."""
    return 100.0 * (r.J / optima[r.step_s] - 1.0)


def mean_excess(
    rows: Sequence[Least], optima: Mapping[float, float]
) -> dict[tuple[str, int], float]:
    """Return the excess over J*, percent, averaged over the times of the step.

    Of those families and numbers that have a cost at every time.
    """
    found: dict[tuple[str, int], list[float]] = {}
    for r in rows:
        found.setdefault((r.columns, r.functions), []).append(excess(r, optima))
    return {key: float(np.mean(each)) for key, each in found.items() if len(each) == len(optima)}
