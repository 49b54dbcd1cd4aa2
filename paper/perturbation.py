"""The size of the perturbations that identify S, and whose columns are perturbed."""

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.bases import laguerre, legendre, orthonormalise
from controller.prediction import stack_bases
from paper.converge import change, within
from paper.problem import Form, Problem, altitude_step, costs, respond
from paper.study import Claim, Figure, Study, Table
from paper.style import marked

Floats = NDArray[np.float64]

COUNT, HORIZON, PERIOD_S = 5, 200, 0.05
SIZES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.05, 0.2, 1.0)
FORMS: tuple[Form, ...] = ("attitude", "actuator")
ORTHONORMAL = "orthonormal"
COLUMNS: Mapping[str, Floats] = {
    "raw Laguerre, [0, 10]": laguerre(HORIZON, COUNT, sample_period=PERIOD_S, time="seconds"),
    "raw Laguerre, [0, 1]": laguerre(HORIZON, COUNT, sample_period=PERIOD_S, time="normalised"),
    "raw Legendre": legendre(HORIZON, COUNT),
    ORTHONORMAL: orthonormalise(legendre(HORIZON, COUNT))[0],
}
"""One space, four sets of columns."""


class Outcome(NamedTuple):
    """What a perturbation leads to: true cost of the full step, and how far that step is off.

    ``error`` is relative to the change of commands that central differences of 1e-5 along
    orthonormal columns ask for. Both are infinite where a perturbed rollout is invalid.
    """

    J: float
    error: float


def exact_change(problem: Problem) -> Floats:
    """Return the change of commands (H, 4) with S from central differences."""
    Phi = stack_bases([COLUMNS[ORTHONORMAL]] * 4)
    ahead, back = (respond(problem, Phi, amplitude=np.full(4, size)) for size in (1e-5, -1e-5))
    response = ahead._replace(S=0.5 * (ahead.S + back.S))
    return change(problem, response, problem.u0)[0]


def after_one_pass(problem: Problem, columns: str, size: float, exact: Floats) -> Outcome:
    """Return the outcome of a pass from trim with ``alpha = size e_i`` for every coefficient."""
    Phi = stack_bases([COLUMNS[columns]] * 4)
    response = respond(problem, Phi, amplitude=np.full(4, size))
    if not response.valid:
        return Outcome(np.inf, np.inf)
    asked, _ = change(problem, response, problem.u0)
    J = costs(problem, within(problem, problem.u0, problem.u0 + asked)[None])
    return Outcome(float(J[0]), float(np.linalg.norm(asked - exact) / np.linalg.norm(exact)))


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return what one pass is worth for every size and set of columns."""
    del quick
    progress("perturbation size")
    table: dict[str, list[Any]] = {
        name: [] for name in ("form", "columns", "size", *Outcome._fields)
    }
    for form in FORMS:
        problem = altitude_step(form=form, horizon=HORIZON)
        exact = exact_change(problem)
        for columns, size in product(COLUMNS, SIZES):
            row = form, columns, size, *after_one_pass(problem, columns, size, exact)
            for name, value in zip(table, row, strict=True):
                table[name].append(value)
    found = {row[:3]: Outcome(*row[3:]) for row in zip(*table.values(), strict=True)}
    literal = {columns: found["actuator", columns, 1.0].J for columns in COLUMNS}
    safest = max(
        size for size in SIZES if all(found[f, ORTHONORMAL, size].error < 0.1 for f in FORMS)
    )
    raw = max(found[form, "raw Laguerre, [0, 1]", safest].error for form in FORMS)
    return Study(
        title="Perturbation size",
        text="S is a difference quotient, and its error grows with the perturbation. Five Laguerre "
        "polynomials, five Legendre polynomials and an orthonormal set are one space, so with tiny "
        "perturbations one pass asks for the same change from all of them. With larger ones the raw "
        "Laguerre columns fail first: in seconds they reach 45 times their first value. On [0, 1] "
        "they are so nearly collinear that the programme itself is beyond double precision (its "
        "regularisation of 1e-12 decides), and the change is wrong at every size. What looks like a "
        "better or worse family is a larger or smaller perturbation.",
        figures=(
            Figure(
                name="perturbation_size",
                title="Perturbation size",
                caption="Error of the change of commands that one pass from trim asks for; 10 m step "
                "at 3 s, five functions per channel, R-50 at 30 m/s, one-sided differences. "
                "Crosses at the top: a perturbed flight is invalid, and there is no S.",
                table=table,
                draw=partial(_draw, table=table),
                size_in=(9.0, 4.2),
            ),
        ),
        tables=tuple(_costs(form, found) for form in FORMS),
        claims=(
            Claim(
                where="II.B",
                statement="S is identified with alpha = [1, 0, 0, 0, 0], ..., [0, 0, 0, 0, 1]",
                verdict="does not hold" if np.isinf(list(literal.values())).any() else "holds",
                theirs="perturbations of 1",
                ours="true cost after the full step that follows, actuator form: "
                + ", ".join(f"{columns} {_number(J)}" for columns, J in literal.items())
                + f"; after tiny perturbations {found['actuator', ORTHONORMAL, 1e-5].J:.0f}",
                reason="A unit is 1 G or 57 degrees: perturbed flights tumble. Orthonormal columns "
                f"are within 10 % up to {safest:g}, where raw Laguerre columns on [0, 1] are "
                f"{raw:.0%} off.",
            ),
        ),
    )


def _costs(form: Form, found: Mapping[tuple[str, str, float], Outcome]) -> Table:
    columns: dict[str, list[Any]] = {"columns": list(COLUMNS)}
    columns |= {
        f"{size:g}": [_number(found[form, one, size].J) for one in COLUMNS] for size in SIZES
    }
    return Table(
        name=f"perturbation_size_{form}",
        title=f"True cost after one full step, by size of the perturbation ({form} form)",
        caption="G or rad of every coefficient. The cost can also fall by luck: the error, in the "
        "figure, does not.",
        columns=columns,
    )


def _number(J: float) -> str:
    return f"{J:.0f}" if np.isfinite(J) else "invalid"


def _draw(picture: Any, table: Mapping[str, Any]) -> None:
    grid = picture.subplots(1, 2, sharey=True)
    columns, size, error = (np.array(table[name]) for name in ("columns", "size", "error"))
    top = 3.0 * error[np.isfinite(error)].max()
    for axes, form in zip(grid, FORMS, strict=True):
        for number, name in enumerate(COLUMNS):
            chosen = (np.array(table["form"]) == form) & (columns == name)
            x, y = size[chosen], error[chosen]
            axes.loglog(x, np.where(np.isfinite(y), y, np.nan), **marked(number), label=name)
            lost = x[~np.isfinite(y)] * 1.15**number
            axes.plot(lost, np.full(lost.size, top), "x", color=marked(number)["color"])
        axes.set(title=f"{form} form", xlabel="perturbation (G or rad)")
    grid[0].set_ylabel("relative error of the change")
    picture.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
