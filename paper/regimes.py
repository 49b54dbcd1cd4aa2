"""Where 5 Laguerre, 10 tents and 7 Legendre cost the same: other weights, horizons and times."""

from collections.abc import Callable, Mapping
from typing import Any

from paper.converge import basis, converge
from paper.problem import altitude_step
from paper.study import Claim, Table

AT_ONCE = "R = (10, 10, 10, 10), step at once"
REGIMES: Mapping[str, Mapping[str, Any]] = {
    "R = (0.1, 1, 1, 1), step at 3 s": {},
    "R times 100, step at 3 s": {"R": (10.0, 100.0, 100.0, 100.0)},
    "R = (300, 100, 100, 100), step at 3 s": {"R": (300.0, 100.0, 100.0, 100.0)},
    "R = (3000, 100, 100, 100), step at 3 s": {"R": (3000.0, 100.0, 100.0, 100.0)},
    "R = (0.1, 1, 1, 1), horizon 3 s, step at 1 s": {"horizon": 60, "at_s": 1.0},
    "R = (0.1, 1, 1, 1), step at once": {"at_s": 0.0},
    AT_ONCE: {"R": (10.0,) * 4, "at_s": 0.0},
}
"""Options of :func:`paper.problem.altitude_step`; the first is that of figure 6."""
BASES = {
    "polynomials_5": ("legendre", 5),
    "laguerre_functions_5": ("laguerre_function", 5),
    "tents_10": ("tent", 10),
    "polynomials_7": ("legendre", 7),
    "polynomials_3": ("legendre", 3),
}


def regimes(progress: Callable[[str], None]) -> Table:
    """Return the least costs of the paper's triple in several regimes, and how far they are apart.

    ``apart_percent`` is the largest over the smallest of 5 polynomials, 10 tents and 7 polynomials;
    ``functions_apart_percent`` has 5 Laguerre functions in place of the first.
    """
    columns: dict[str, list[Any]] = {"regime": list(REGIMES), **{name: [] for name in BASES}}
    for regime, options in REGIMES.items():
        progress(f"5, 10 and 7: {regime}")
        problem = altitude_step(**options)
        for name, (family, n) in BASES.items():
            columns[name].append(converge(problem, basis(family, n, problem.horizon)).J)
    for word, first in (("", "polynomials_5"), ("functions_", "laguerre_functions_5")):
        triples = zip(
            *(columns[name] for name in (first, "tents_10", "polynomials_7")), strict=True
        )
        columns[f"{word}apart_percent"] = [100.0 * (max(J) / min(J) - 1.0) for J in triples]
    return Table(
        name="regimes",
        title="5, 10 and 7 in other regimes",
        caption="Least true cost of the 10 m step, attitude form, exact S. Where the polynomials of "
        "third number are as good as well, equality says only that the basis hardly matters there.",
        columns=columns,
    )


def triple(table: Table, over: str) -> Claim:
    """Return what became of the claim of equality; ``over`` tells of other numbers."""
    columns = table.columns
    apart, functions = columns["apart_percent"], columns["functions_apart_percent"]
    near = min(range(1, len(apart)), key=lambda i: apart[i])
    at_once = columns["regime"].index(AT_ONCE)
    return Claim(
        where="abstract; IV.B, fig. 6",
        statement="5 Laguerre polynomials equal 10 tents and Legendre polynomials of 6th order (7)",
        verdict="holds"
        if apart[0] < 5
        else "holds in part"
        if apart[near] < 5
        else "does not hold",
        theirs="equal",
        ours=f"J {columns['polynomials_5'][0]:.0f}, {columns['tents_10'][0]:.0f}, "
        f"{columns['polynomials_7'][0]:.0f}; {over}",
        reason=f"One polynomial is worth about one tent. The three are nearest, {apart[near]:.1f} % "
        f"apart, with {columns['regime'][near]}, where the basis hardly matters: 3 polynomials cost "
        f"{columns['polynomials_3'][near]:.0f}, 10 tents {columns['tents_10'][near]:.0f}. Read as "
        f"Laguerre *functions*, five are within {functions[at_once]:.1f} % of the other two with "
        f"{AT_ONCE}; with other weights and times they are not.",
    )
