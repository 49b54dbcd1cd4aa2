"""Figure 6: what is swept, what is read from it, and the same-span proof."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from paper import least_cost
from paper.attained import BARS, optimum, problem_of
from paper.converge import basis, converge
from paper.least_cost import (
    EXACT,
    LEARNED,
    RAW,
    SPANS,
    STEP_S,
    Least,
    columns_of,
    curve,
    excess,
    mean_excess,
    rises,
    sweep,
)  # fmt: skip
from paper.least_cost_claims import claims
from paper.least_cost_figures import least_costs, promises, step_times
from paper.problem import altitude_step
from paper.regimes import BASES, REGIMES
from paper.same_span import same_span
from paper.study import Table
from paper.style import write_figure

H = 60
CASES = tuple((name, n) for name in (*RAW, *EXACT) for n in (3, 5, 7, 10, 20))


def rows(cost=lambda name, n: 200.0 + 1000.0 / n, times=(STEP_S,)):
    """Return least costs made up by a function of the family and the number."""
    return [
        Least(name, n, t, cost(name, n), 150.0 + 900.0 / n, 1e4, 3e3, 9, 0)
        for name, n in CASES for t in times
    ]  # fmt: skip


def reached():
    """Return the one row of the attained costs that a claim reads."""
    columns = {"problem": ["step"], "family": ["full"], "J": [200.1], "J_linear": [170.0]}
    return Table("attained", "", "", columns)


def verdicts(made):
    """Return the verdicts of all claims on figure 6, by a word of the statement."""
    spans = Table("", "", "", {"columns": ["Legendre"], "relative_difference": [1e-14]})
    words = "settles", "monotone", "rapidly", "equal", "better", "direct"
    apart = 0.0 if all(r.J < 201.0 for r in made) else 50.0
    triples = {name: [1.0] * 7 for name in BASES} | {"regime": list(REGIMES)}
    triples |= {f"{word}apart_percent": [apart] * 7 for word in ("", "functions_")}
    found = claims(made, {STEP_S: 200.0}, spans, reached(), Table("", "", "", triples))
    return {word: next(c.verdict for c in found if word in c.statement) for word in words}


@pytest.mark.parametrize("count", [3, 5, 7, 9])
def test_polynomials_of_one_degree_have_one_optimum(count):
    """Laguerre, Legendre and Chebyshev have the same optimum to 1e-8, in columns conditioned so."""
    table = same_span(altitude_step(), (count,))
    found = dict(zip(table.columns["columns"], table.columns["relative_difference"], strict=True))
    for name in ("orthonormal", "Laguerre, t in s", "Legendre", "Chebyshev"):
        assert abs(found[name]) < 1e-8


@given(st.dictionaries(st.integers(1, 30), st.floats(1.0, 1e4), min_size=1))
def test_only_what_costs_more_than_fewer_functions_rises(costs):
    """A number rises if and only if its cost is above that of the next fewer by the tolerance."""
    counts = sorted(costs)
    up = rises(costs, tolerance=0.1)
    assert counts[0] not in up
    for fewer, n in pairwise(counts):
        assert (n in up) == (costs[n] > 1.1 * costs[fewer])
    assert rises(costs, beyond=20, tolerance=0.1) == [n for n in up if n > 20]


def test_the_mean_is_over_all_times_or_not_at_all():
    """Excesses are relative to each time's own optimum; a number missing at one time has no mean."""
    made = [Least("tents", 5, t, J, 0, 0, 0, 1, 0) for t, J in ((0.0, 110.0), (3.0, 26.0))]
    made.append(Least("boxes", 5, 3.0, 30.0, 0, 0, 0, 1, 0))
    optima = {0.0: 100.0, 3.0: 20.0}
    assert excess(made[0], optima) == pytest.approx(10.0)
    assert mean_excess(made, optima) == {("tents", 5): pytest.approx(20.0)}


def test_columns_are_orthonormal_but_the_papers():
    """Exact families have columns of unit RMS and right angles, each on its own; raw ones have not."""
    problem = altitude_step(horizon=H)
    for name in SPANS:
        Phi = columns_of(name, 5, problem)
        gram = np.einsum("chm,chn->mn", Phi, Phi)
        assert gram == pytest.approx(H * np.eye(20), abs=1e-9)
    for name in RAW:
        Phi = columns_of(name, 5, problem)
        assert np.linalg.matrix_rank(Phi[0]) == 5
        assert not np.allclose(np.einsum("chm,chn->mn", Phi, Phi), H * np.eye(20))
    assert columns_of("B-splines", 3, problem) is None


def test_a_learned_basis_has_as_many_coefficients(monkeypatch):
    """N learned functions per channel are 4 n directions, each on all channels at once."""
    monkeypatch.setattr(least_cost, "train", lambda form, *, speeds, number: (
        np.random.default_rng(0).standard_normal((len(speeds), 4, H, number))))  # fmt: skip
    least_cost._learned.cache_clear()
    Phi = columns_of(LEARNED, 3, altitude_step(horizon=H))
    least_cost._learned.cache_clear()
    assert Phi.shape == (4, H, 12)
    assert np.abs(Phi).max(axis=1).min() > 0.0


def test_a_sweep_leaves_out_what_does_not_exist(monkeypatch):
    """Fewer than four B-splines are no basis, and no row."""
    monkeypatch.setattr(
        least_cost, "altitude_step", lambda **options: altitude_step(horizon=H, **options)
    )
    found = sweep(["B-splines", "tents"], (3, 4), 1.0)
    assert [(r.columns, r.functions) for r in found] == [
        ("B-splines", 4),
        ("tents", 3),
        ("tents", 4),
    ]
    assert curve(found, "tents", 1.0)[4].J <= 4100.0
    assert all(r.J_first >= r.J for r in found)


def test_verdicts_follow_the_numbers():
    """Where all families cost the same, the claims of equality hold and those of order do not."""
    same = verdicts(rows(lambda _, n: 200.0 + 1.0 / n))
    assert same["settles"] == same["equal"] == "holds"
    assert same["monotone"] == same["rapidly"] == "does not hold"
    fast = verdicts(rows(lambda name, n: 200.0 + (1.0 if "Laguerre" in name else 500.0) / n))
    assert fast["rapidly"] == "holds"
    assert fast["equal"] == "does not hold"
    rough = verdicts(rows(lambda name, n: 200.0 + (n * n if name in RAW else 1.0 / n)))
    assert rough["monotone"] == "holds in part"


def test_figures_are_drawn_from_their_tables(tmp_path):
    """Each figure writes its picture and a table with one row per point."""
    made = rows(times=(0.0, STEP_S))
    optima = {0.0: 180.0, STEP_S: 190.0}
    for figure in (least_costs(made, 190.0), promises(made, 190.0), step_times(made, optima)):
        write_figure(figure, tmp_path)
        lines = (tmp_path / f"{figure.name}.csv").read_text().splitlines()
        assert len(lines) == 1 + len(figure.table["J"])
        assert (tmp_path / f"{figure.name}.png").stat().st_size > 10_000


def test_full_order_attains_the_true_optimum():
    """Linearise and solve with one function per sample ends within 1e-3 of direct shooting, over it."""
    problem = altitude_step(horizon=30, height_m=2.0, at_s=0.5)
    J, _ = optimum(problem)
    end = converge(problem, basis("full", 30, 30))
    assert J * (1 - 1e-4) <= end.J <= J * (1 + 1e-3)


def test_every_bar_has_a_problem():
    """The bars' problems exist in both forms, with the weights that they state."""
    for name, *_ in BARS:
        for form in ("attitude", "actuator"):
            assert problem_of(name, form).form == form
    assert problem_of("terrain", "attitude").R != problem_of("terrain, small R", "attitude").R
