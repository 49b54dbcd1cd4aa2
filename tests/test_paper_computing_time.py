"""The clock of figure 7, and what it times."""

import numpy as np
import pytest

from paper.converge import basis
from paper.problem import altitude_step
from paper.programme_solvers import native, slsqp, solvers, through_cvxpy
from paper.update_times import LAGUERRE, TENTS, cpu_s, ratios, sweep, update


@pytest.fixture(scope="module")
def problem():
    return altitude_step(horizon=40, at_s=1.0, height_m=20.0)


def test_solvers_agree(problem):
    """All solvers are given one programme, and find its optimum."""
    found = update(problem, basis("legendre", 2, 40), solvers(), 1)
    J = np.array([times.J_linear for times in found.values()])
    np.testing.assert_allclose(J, J[0], rtol=1e-4)


def test_unsolved_is_said(problem):
    """A solver that is cut short says so."""
    found = update(problem, basis("legendre", 2, 40), {"cut": lambda d: slsqp(d, 1)}, 1)
    assert found["cut"].status != "optimal"


def test_unknown_solver():
    """A solver that cvxpy does not have is an error with a name."""
    with pytest.raises(ImportError, match="'NONE': not installed"):
        through_cvxpy("NONE")


def test_repetitions():
    """Work is done the number of times that is asked for, and its result returned."""
    done = []
    least, result = cpu_s(lambda: done.append(1) or len(done), 3)
    assert result == len(done) == 3
    assert least >= 0


def test_sweep_and_ratio(problem):
    """A row per size and solver; the ratio is that of the rows' times."""
    sizes = [LAGUERRE, TENTS]
    found = sweep([problem], sizes, {"DAQP": native("daqp")}, 1, lambda _: None)
    assert found["bases_per_channel"] == [5, 10]
    parts = ("rollouts_ms", "assembly_ms", "programme_ms", "line_search_ms")
    for row in range(2):
        assert sum(found[part][row] for part in parts) == pytest.approx(found["total_ms"][row])
    assert ratios(found)["ratio"] == [found["total_ms"][1] / found["total_ms"][0]]
