"""How near linearise-and-solve comes to the true optimum: bars of this project, and what stops it."""

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from paper.converge import Converged, basis, converge
from paper.problem import Form, Problem, altitude_step, costs, goal_of, terrain
from paper.study import Claim, Table

Floats = NDArray[np.float64]

COARSE = np.array([0.02, *np.radians([0.5, 0.5, 0.5])])
"""Perturbations often met in practice: 0.02 G and 0.5 deg."""
PASSES = {"full": 16}  # at most; 800 columns take 2 s each
ITERATIONS = 100  # of IPOPT, at most
BARS = (
    ("step", "full", 200, 0.02),
    ("step", "tent", 40, 0.02),
    ("step", "tent", 10, 0.25),
    ("terrain", "laguerre_function", 10, 0.05),
)
"""Problem, family, functions per channel, largest excess over J*."""


@lru_cache(maxsize=2)
def _shooter(form: Form, horizon: int) -> Any:
    from controller.shooting import shooter

    return shooter(altitude_step(form=form).model, horizon, iterations=ITERATIONS)


def optimum(problem: Problem, *starts: Floats) -> tuple[float, str]:
    """Return J*, and how it was found: the least of direct shooting from trim and from other starts.

    Its cost is that of the re-simulation by our kernels.
    """
    found: list[tuple[float, str]] = []
    for name, u in (("trim", problem.u0), *(("linearise and solve", u) for u in starts)):
        shot = _shooter(problem.form, problem.horizon)(problem.state, u, goal_of(problem))
        J = float(costs(problem, shot.u[None])[0])
        found.append((J, f"IPOPT from {name}, {shot.iterations} iterations, {shot.status}"))
    return min(found)


def problem_of(name: str, form: Form) -> Problem:
    """Return the altitude step at 3 s, or terrain following; ``small R`` has the step's weights."""
    if name == "step":
        return altitude_step(form=form)
    if name == "terrain, small R":
        return terrain(form=form)
    return terrain(form=form, Q=(1.0, 1.0, 5.0, 20.0, 0.5), R=(1.0, 20.0, 20.0, 5.0))


def attained(quick: bool, progress: Callable[[str], None]) -> tuple[Table, list[Claim]]:
    """Return the excess of every bar's basis over J*, and a claim for each bar."""
    more = (("terrain, small R", "laguerre_function", 10),) if quick else (
        ("step", "tent", 20),
        ("step", "legendre", 10),
        ("terrain", "tent", 10),
        ("terrain", "legendre", 5),
        ("terrain", "legendre", 10),
        *(("terrain", "laguerre_function", n) for n in (5, 8, 15)),
        *(("terrain, small R", "laguerre_function", n) for n in (10, 15, 20)),
    )  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for form in ("attitude",) if quick else ("attitude", "actuator"):
        best: dict[str, tuple[float, str]] = {}
        for name, family, n in (*(bar[:3] for bar in BARS), *more):
            progress(f"{form} form, {name}: {family} {n}")
            problem = problem_of(name, form)
            found = converge(problem, basis(family, n), passes=PASSES.get(family, 60))
            if name not in best:
                best[name] = optimum(problem, *([] if quick else [found.u]))
            J, by = best[name]
            excess = 100.0 * (found.J / J - 1.0)
            rows.append(
                (form, name, family, n, J, found.J, excess, found.J_linear, found.passes, by)
            )
    names = ("form", "problem", "family", "functions", "J_star", "J", "excess_percent", "J_linear",
             "passes", "J_star_by")  # fmt: skip
    table = Table(
        name="attained",
        title="Linearise and solve to convergence against the true optimum",
        caption="10 m step at 3 s with Q = 1, R = (0.1, 1, 1, 1); terrain following with "
        "Q = (1, 1, 5, 20, 0.5), R = (1, 20, 20, 5) or, small R, with the step's weights. H = 200, "
        "30 m/s. J* by direct multiple shooting, re-simulated by our kernels.",
        columns=dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)),
    )
    return table, [_claim(*bar, table) for bar in BARS]


def _claim(name: str, family: str, n: int, bar: float, table: Table) -> Claim:
    what = "full order" if family == "full" else f"{n} {family.replace('_', ' ')}s"
    where = "the step at 3 s" if name == "step" else "terrain following"
    rows = list(zip(*table.columns.values(), strict=True))
    mine = [row for row in rows if row[2:4] == (family, n)]
    found = [
        f"{row[0]} {row[6]:.2f} % (J {row[5]:.2f}, J* {row[4]:.2f})"
        for row in mine
        if row[1] == name
    ]
    over = [row[6] / 100 - bar for row in mine if row[1] == name]
    other = [f"{row[0]} {row[6]:.1f} %" for row in mine if row[1] == f"{name}, small R"]
    met = max(over) <= 0
    reason = f"Exact S, {max(row[8] for row in mine)} passes or fewer." if met else (
        f"Missed by {100 * max(over):.1f} points at worst: the passes have converged, what is left is "
        "the basis."
    )  # fmt: skip
    if other:
        reason += (
            f" With the step's weights, whose R hardly restrains the thrust, {', '.join(other)}: the "
            "optimum is then sharper than so few functions over 10 s."
        )
    return Claim(
        where="ours",
        statement=f"{what}, linearised and solved to convergence, within {bar:.0%} of J* on {where}",
        verdict="holds" if met else "holds in part" if min(over) <= 0 else "does not hold",
        theirs=f"{bar:.0%}",
        ours="; ".join(found),
        reason=reason,
    )


WAYS: Mapping[str, Mapping[str, Any]] = {
    "0.02 G, 0.5 deg; Gauss-Newton, 8 passes": {"amplitude": COARSE, "damping": 0.0, "passes": 8},
    "0.02 G, 0.5 deg; Gauss-Newton": {"amplitude": COARSE, "damping": 0.0},
    "tiny perturbations; Gauss-Newton": {"damping": 0.0},
    "exact S; Gauss-Newton, 8 passes": {"damping": 0.0, "passes": 8},
    "exact S; Gauss-Newton": {"damping": 0.0},
    "exact S; damped": {},
}
"""Ways to converge: how S is identified and how the step is found."""


def stalls(quick: bool, progress: Callable[[str], None]) -> Table:
    """Return where each way of converging ends, beside the best of them."""
    cases = [("attitude", 3.0, "tent", 40), ("actuator", 3.0, "tent", 40)]
    if not quick:
        cases += [("attitude", 0.0, "tent", 40), ("actuator", 0.0, "tent", 40),
                  ("actuator", 0.0, "laguerre_function", 10)]  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for form, at_s, family, n in cases:
        progress(f"{form} form, step at {at_s:g} s, {n} {family}: what stops it")
        problem = altitude_step(form=form, at_s=at_s)
        ends: dict[str, Converged] = {}
        for way, options in WAYS.items():
            tiny = {"amplitude": problem.amplitude} if way.startswith("tiny") else {}
            ends[way] = converge(
                problem, basis(family, n), **cast(Any, {"passes": 80, **options, **tiny})
            )
        least = min(end.J for end in ends.values())
        rows += [
            (form, at_s, family, n, way, end.J, 100 * (end.J / least - 1), end.passes)
            for way, end in ends.items()
        ]
    names = "form", "step_s", "family", "functions", "way", "J", "above_best_percent", "passes"
    return Table(
        name="stalls",
        title="What stops linearise-and-solve above the optimum",
        caption="10 m step, H = 200, true J at the end of the passes; at most 80 of them, or 8.",
        columns=dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)),
    )
