"""Figure 6: the least cost over one horizon against the number of basis functions."""

from collections.abc import Callable, Sequence

from paper import attained, same_span
from paper.least_cost import (
    COUNTS,
    EXACT,
    FEW,
    OTHER_STEPS_S,
    RAW,
    STEP_S,
    Least,
    sweep,
    table_of,
)  # fmt: skip
from paper.least_cost_claims import claims
from paper.least_cost_figures import least_costs, promises, step_times
from paper.problem import altitude_step
from paper.regimes import regimes
from paper.study import Study, Table

FIGURES = (6,)

TEXT = """\
One horizon of 10 s (H = 200), level flight at 30 m/s, a 10 m step in altitude known in advance, cost
of eq. 2.1 with Q = 1 and R = (0.1, 1, 1, 1) on actuators minus trim, attitude form. Each point is
linearised and solved again and again until the *true* cost falls no more: the optimum of one linear
model says little, as the second figure shows. The polynomials as the paper writes them are identified
as the paper does, one by one with a finite perturbation (0.02 G and 0.5 deg times the column); the
other families on orthonormal columns and exactly. J* is direct multiple shooting (CasADi, IPOPT) on
the traced dynamics, without bases or linearisation, and re-simulated by our kernels.

Exactly identified spans fall together to J*: beyond some 20 functions the family hardly matters. The
raw Laguerre polynomials do not: their columns are nearly collinear, and what a one-sided finite
perturbation adds to each is amplified until more functions make the plan worse. It is arithmetic, not
the polynomials: the orthonormal columns of the very same span show nothing of it. The learned basis
(at 30 m/s, from optimal moves at 25 and 35 m/s) has the least cost up to seven functions per channel;
it levels off above J* as it was learned from the moves of the linear model. In actuator form the
families order alike, see its table.

What stops linearise-and-solve short of J* is the same, see its table: one-sided perturbations of
practical size give a wrong response where the bases act on actuators, and the line search finds no
descent tens of per cent above the optimum. With the exact response Gauss-Newton and the damped passes
end at the same cost. Stopping after eight passes costs about one per cent more."""
QUICK = "\n\n*Quick run: few numbers of functions, the step at 3 s, attitude form.*"


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return figure 6, the same-span proof, and what linearise-and-solve attains."""
    table, bars = attained.attained(quick, progress)
    by_problem = zip(table.columns["problem"], table.columns["form"], strict=True)
    best = dict(zip(by_problem, table.columns["J_star"], strict=True))
    optima = {STEP_S: best["step", "attitude"]}
    rows: list[Least] = []
    for name in (*RAW, *EXACT):
        progress(f"step at {STEP_S:g} s: {name}")
        rows += sweep([name], FEW if quick else COUNTS, STEP_S)
    others: list[Least] = []
    if not quick:
        for at_s in OTHER_STEPS_S:
            progress(f"step at {at_s:g} s")
            rows += sweep([*RAW[:1], *EXACT], FEW, at_s)
            optima[at_s] = attained.optimum(altitude_step(at_s=at_s))[0]
        progress("actuator form")
        others = sweep([*RAW, *EXACT], FEW, STEP_S, "actuator")
    progress("the same span")
    spans = same_span.same_span(altitude_step())
    triples = regimes(progress)
    return Study(
        title="Figure 6: least cost against the number of basis functions",
        text=TEXT + (QUICK if quick else ""),
        figures=[least_costs(rows, optima[STEP_S]), promises(rows, optima[STEP_S])]
        + ([] if quick else [step_times(rows, optima)]),
        tables=[table, attained.stalls(quick, progress), spans, triples]
        + ([] if quick else [_actuator_form(others, best["step", "actuator"])]),
        claims=[*claims(rows, optima, spans, table, triples), *bars],
    )


def _actuator_form(rows: Sequence[Least], J_star: float) -> Table:
    return Table(
        name="fig6_actuator_form",
        title="The same in actuator form",
        caption=f"The step at 3 s with the bases on the actuators themselves; J* = {J_star:.2f}.",
        columns=table_of(rows),
    )
