"""What the results depend on: identities of the parts, and tiny versions of their flights."""

import numpy as np
import pytest

from controller.prediction import stack_bases
from controller.qp import predicted_cost
from controller.solvers import solve
from paper import literal_weight, sensitivities
from paper.forms import LOST_M, STEP_M, STEP_S, Cell, ended, run, starts
from paper.optimisers import OPTIMISERS, gradient_descent, in_columns, osqp, suboptimality
from paper.perturbation import COLUMNS, ORTHONORMAL, after_one_pass, exact_change
from paper.problem import altitude_step, quadratic_programme, respond
from paper.receding import Flown
from paper.trade_offs import LAGUERRE, with_horizon

RAW = "raw Laguerre, [0, 10]"


@pytest.fixture(scope="module")
def programme():
    """Return the programme of the step at 3 s in orthonormal coefficients, and its optimum."""
    problem = altitude_step()
    response = respond(problem, stack_bases([COLUMNS[ORTHONORMAL]] * 4))
    data = quadratic_programme(problem, response, problem.u0)
    return data, predicted_cost(data, solve(data, "piqp").alpha)


# -- perturbation ------------------------------------------------------------------------------


def test_tiny_perturbations_identify_what_central_differences_do():
    """Orthonormal columns: an error in proportion to the perturbation; of 1 G or 1 rad no S."""
    problem = altitude_step(form="actuator")
    exact = exact_change(problem)
    small, larger = (
        after_one_pass(problem, ORTHONORMAL, size, exact).error for size in (1e-6, 1e-5)
    )
    assert small < 1e-3
    assert small < larger < 100.0 * small
    assert np.isinf(after_one_pass(problem, RAW, 1.0, exact).J)


# -- optimisers --------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [RAW, "raw Legendre"])
def test_a_programme_in_other_columns_has_the_same_optimum(programme, columns):
    """The map between columns of one space is exact: so is the optimum, to rounding."""
    data, optimum = programme
    mapped = in_columns(data, columns)
    assert predicted_cost(mapped, solve(mapped, "piqp").alpha) == pytest.approx(optimum, rel=1e-6)


def test_suboptimality_is_of_what_violates_nothing(programme):
    """Zero at the optimum, J(0)/J* - 1 at rest; beyond a row that binds, only what is before it."""
    data, optimum = programme
    best = solve(data, "piqp").alpha
    assert suboptimality(data, best, optimum) == pytest.approx(0.0, abs=1e-6)
    assert suboptimality(data, 0.0 * best, optimum) == pytest.approx(data.constant / optimum - 1.0)
    assert suboptimality(data, 50.0 * best, optimum) == pytest.approx(0.0, abs=1e-6)


def test_optimisers_left_to_run_arrive(programme):
    """Given iterations enough, the capped ones come closer to the same optimum."""
    data, optimum = programme
    for optimiser, few, many in ((osqp, 25, 4000), (gradient_descent, 100, 10000)):
        early, late = (suboptimality(data, optimiser(data, n), optimum) for n in (few, many))
        assert -1e-6 <= late < early
    assert set(OPTIMISERS) >= {"OSQP, 25 iterations"}


# -- R on the control itself -------------------------------------------------------------------


def test_only_the_literal_weight_moves_the_aircraft(monkeypatch):
    """Level flight is the least cost where R acts on the deviation from trim, and only there."""
    monkeypatch.setattr(literal_weight, "UPDATES", 6)
    monkeypatch.setattr(literal_weight, "LATE_S", 1.0)
    for is_literal in (True, False):
        problem = literal_weight.level(10.0, is_literal=is_literal)
        _, _, bias = literal_weight.drift(problem, "5 Laguerre")
        assert (abs(bias.altitude_m) > 0.1) == is_literal
        assert abs(bias.altitude_m) < 10.0


# -- form and step -----------------------------------------------------------------------------


def test_starts_are_the_same_for_all_cells_and_within_their_spread():
    """Run i starts alike whatever is flown, and however many are."""
    few, more = list(starts(2)), list(starts(4))
    np.testing.assert_array_equal(few, more[:2])
    assert np.all(np.abs(more)[:, 3:6] <= 3.0)
    assert not np.array_equal(more[0], more[1])


def test_a_flight_is_lost_by_departing_or_by_leaving_its_altitude():
    """Invalid, or more than 20 m off; late errors and rejected updates are counted."""
    time = 0.05 * np.arange(1, 301)
    outputs = np.zeros((300, 14))
    outputs[:, 2] = STEP_M * (time >= STEP_S - 1e-9) + 0.5
    flown = Flown(time, outputs, np.zeros((300, 4)), np.array([1.0, 0.0, 0.0]), valid=True)
    assert ended(flown) == (False, pytest.approx(0.5), 2)
    assert ended(flown._replace(valid=False)).is_lost
    outputs[7, 2] = -LOST_M - 1.0
    assert ended(flown).is_lost


def test_the_controller_that_ships_recovers_from_a_start():
    """Attitude form with line search, from the first random start: not lost."""
    assert not run(Cell("attitude", "line search", "5 Laguerre"), next(starts(1)), 6).is_lost


# -- weights and horizon -----------------------------------------------------------------------


def test_a_shorter_horizon_helps_few_functions():
    """Five polynomials hold the height over fractal ground better over 3 s than over 10 s."""
    short, long = (with_horizon(LAGUERRE, horizon_s, 10.0) for horizon_s in (3.0, 10.0))
    assert {short.outcome, long.outcome} == {"flown"}
    assert short.height_m < 0.5 * long.height_m


# -- as one study ------------------------------------------------------------------------------


def test_the_parts_become_one_section(monkeypatch):
    """Every part leaves its figures, tables and claims to one study; names are told apart."""
    parts = [
        part
        for part in sensitivities.PARTS
        if part.__name__.endswith(("perturbation", "optimisers"))
    ]
    monkeypatch.setattr(sensitivities, "PARTS", tuple(parts))
    told = []
    whole = sensitivities.study(True, told.append)
    assert [figure.name for figure in whole.figures] == ["perturbation_size", "optimisers"]
    assert len(whole.claims) == 2
    assert len(told) == 2
    for table in (*whole.tables, *(as_table(figure) for figure in whole.figures)):
        assert len({len(column) for column in table.columns.values()}) == 1


def as_table(figure):
    """Return a figure's data as a table."""
    from paper.study import Table

    return Table(figure.name, figure.title, figure.caption, figure.table)
