"""Figures 1 and 4: the shapes, and that two of the paper's families are one space."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.bases import chebyshev, laguerre, laguerre_function, legendre, orthonormalise, tent
from paper.study import Claim, Figure, Study, Table
from paper.style import line

Floats = NDArray[np.float64]

FIGURES = (1, 4)
HORIZON, PERIOD, COUNT = 200, 0.05, 5
TIME_S = np.arange(HORIZON) * PERIOD

UNIT, SECONDS, LEGENDRE = "Laguerre on [0, 1]", "Laguerre in seconds", "Legendre"
PAPERS: Mapping[str, Callable[[int, int], Floats]] = {
    UNIT: partial(laguerre, sample_period=PERIOD, time="normalised"),
    SECONDS: partial(laguerre, sample_period=PERIOD, time="seconds"),
    LEGENDRE: legendre,
}
"""The polynomials as the paper draws them (figures 1 and 4) and, in seconds, as eq. 6 writes them."""
POLYNOMIALS: Mapping[str, Callable[[int, int], Floats]] = {
    "Chebyshev": chebyshev,
    "orthonormal": lambda horizon, count: orthonormalise(legendre(horizon, count))[0],
}
"""More axes for the same space."""
OTHERS: Mapping[str, Callable[[int, int], Floats]] = {
    "Laguerre functions, 0.5 /s": partial(laguerre_function, sample_period=PERIOD, pole_per_s=0.5),
    "tents": tent,
}


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return the shapes, their condition numbers and the angles between their spans."""
    del quick
    progress("shapes and spans")
    found = spans(COUNT)
    condition = dict(zip(found["family"], found["condition_number"], strict=True))
    sine = dict(zip(found["family"], found["sine_to_legendre"], strict=True))
    overlap = within_lines(PAPERS[UNIT](HORIZON, COUNT)[:, 2:])
    claims = (
        Claim(
            where="II.B, fig. 1",
            statement="Laguerre polynomials of order 0 to 4 are five distinct, characteristic shapes",
            verdict="holds in part",
            theirs="",
            ours=f"condition number of B {condition[UNIT]:.0f} on [0, 1], "
            f"{condition[SECONDS]:.0f} in seconds, {condition[LEGENDRE]:.1f} for Legendre",
            reason="They are independent, but on [0, 1], as drawn, nearly collinear: "
            f"at least {overlap.min():.1%} of the squares of b_2, b_3 and b_4 is a straight line.",
        ),
        Claim(
            where="II.C, V",
            statement="Laguerre and Legendre polynomials of one order are different control spaces",
            verdict="does not hold",
            theirs="Legendre is the smaller one",
            ours=f"sine of the largest angle between the two spans "
            f"{max(sine[UNIT], sine[SECONDS]):.0e}",
            reason="Both span the polynomials of degree 4 or less, to rounding. Whatever differs "
            "between the families is conditioning, scale or where an optimiser stops.",
        ),
    )
    figures = (
        Figure(
            name="fig1_laguerre",
            title="Figure 1: Laguerre polynomials",
            caption="b_0 to b_4 of eq. 2.4, on [0, 1] as the paper draws them, and over the horizon "
            "of 10 s as eq. 6 writes them, b_n(k Ts).",
            table=shapes((UNIT, SECONDS)),
            draw=partial(_draw, families=(UNIT, SECONDS)),
            size_in=(8.0, 3.4),
        ),
        Figure(
            name="fig4_legendre",
            title="Figure 4: Legendre polynomials",
            caption="Order 0 to 4 over the horizon of 10 s, their argument scaled to [-1, 1].",
            table=shapes((LEGENDRE,)),
            draw=partial(_draw, families=(LEGENDRE,)),
            size_in=(6.0, 3.4),
        ),
    )
    spans_table = Table(
        name="spans",
        title="Conditioning and span of five functions",
        caption="200 samples. The sine is that of the largest angle between the family's span and "
        "that of five Legendre polynomials: zero, to rounding, where they are one space.",
        columns=found,
    )
    text = (
        "The paper's two polynomial families (figures 1 and 4) are two sets of axes for one space, "
        "the polynomials of degree 4 or less. A quadratic programme that is solved exactly has the "
        "same optimum in both, so a difference between them can only come from arithmetic. What "
        "does differ is conditioning, and there the raw Laguerre columns are the worse ones."
    )
    return Study("The bases", text, figures, (spans_table,), claims)


def shapes(families: Sequence[str]) -> dict[str, list[float]]:
    """Return the columns of figures 1 and 4: time, and every function of the paper's families."""
    columns = {"time_s": TIME_S.tolist(), "unit_time": np.linspace(0.0, 1.0, HORIZON).tolist()}
    for family in families:
        B = PAPERS[family](HORIZON, COUNT)
        columns |= {f"{family}, n = {n}": B[:, n].tolist() for n in range(COUNT)}
    return columns


def spans(count: int) -> dict[str, list[Any]]:
    """Return condition number and distance from the span of Legendre polynomials, per family."""
    columns: dict[str, list[Any]] = {"family": [], "condition_number": [], "sine_to_legendre": []}
    Phi, _ = np.linalg.qr(legendre(HORIZON, count))
    for family, basis in {**PAPERS, **POLYNOMIALS, **OTHERS}.items():
        B = basis(HORIZON, count)
        Q, _ = np.linalg.qr(B / np.linalg.norm(B, axis=0))
        columns["family"].append(family)
        columns["condition_number"].append(float(np.linalg.cond(B)))
        columns["sine_to_legendre"].append(float(np.linalg.norm(Q - Phi @ (Phi.T @ Q), 2)))
    return columns


def within_lines(B: Floats) -> Floats:
    """Return which part of each column's squares, (n,), is explained by a straight line."""
    Q, _ = np.linalg.qr(legendre(len(B), 2))
    return ((Q.T @ B) ** 2).sum(axis=0) / (B**2).sum(axis=0)


def _draw(picture: Any, families: Sequence[str]) -> None:
    for axes, family in zip(
        np.atleast_1d(picture.subplots(1, len(families))), families, strict=True
    ):
        B = PAPERS[family](HORIZON, COUNT)
        time = np.linspace(0.0, 1.0, HORIZON) if family == UNIT else TIME_S
        for n in range(COUNT):
            axes.plot(time, B[:, n], **line(n), label=f"n = {n}")
        label = "fraction of the horizon" if family == UNIT else "time (s)"
        axes.set(title=family, xlabel=label, ylabel="basis function")
    picture.legend(*picture.axes[0].get_legend_handles_labels(), loc="outside right upper")
