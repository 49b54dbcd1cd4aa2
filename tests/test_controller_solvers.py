"""The three back ends, the statuses of failure, and the claims about bases that need a solver."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from controller import bases, solvers
from controller.qp import QPData, Rows, Term, assemble, bounds, clearance, predicted_cost, slack
from controller.solvers import BACKENDS, Status, solve, solve_with_fallback

H, TS = 200, 0.05
ALL = pytest.mark.parametrize("backend", BACKENDS)


def small(**changes):
    """Return min 1/2 a'a - 2 a0 - 3 a1 with a <= (1, 5), solved by a = (1, 3)."""
    data = QPData(
        H=np.eye(2),
        f=np.array([-2.0, -3.0]),
        A=np.eye(2),
        lower=np.array([-np.inf, -1.0]),
        upper=np.array([1.0, 5.0]),
        soft_A=np.empty((0, 2)),
        soft_lower=np.empty(0),
        rho1=10.0,
        rho2=1.0,
        constant=0.0,
    )
    return replace(data, **changes)


def lagged_plant(B):
    """Return the responses (4, H, m) of positions and of actuators to the columns of B, (H, n).

    Four channels, each a first-order actuator (0.1 s) that drives a double integrator with 9.8
    m/s2 per unit; outputs at the end of a sample, actuators at its start.
    """
    pole = np.exp(-TS / 0.1)
    n = B.shape[1]
    S, Sa = np.zeros((4, H, 4 * n)), np.zeros((4, H, 4 * n))
    actuator, speed, position = np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(H):
        column = actuator.copy()
        actuator = pole * actuator + (1 - pole) * B[k]
        position = position + TS * speed + 0.5 * TS**2 * 9.8 * column
        speed = speed + TS * 9.8 * column
        for c in range(4):
            Sa[c, k, c * n : (c + 1) * n] = column
            S[c, k, c * n : (c + 1) * n] = position
    return S, Sa


def tracking(B, limit, error, minimum_clearance=None, hill=0.0, rho1=2e3):
    """Return a problem of the controller's shape: track, spare the actuators, clear a hill."""
    S, Sa = lagged_plant(B)
    deviation = np.asarray(error)[:, None] * (np.arange(H) > 20)
    nominal = np.zeros((4, H))
    terms = [
        *map(Term, S, deviation, (1.0, 10.0, 1.0, 1.0)),
        *map(Term, Sa, nominal, (0.1, 1.0, 1.0, 1.0)),
    ]
    hard = [
        bounds(Sa, nominal, -limit, limit),
        bounds(0.02 * S[:2], nominal[:2], -0.8, 0.8, every=4),
    ]
    if minimum_clearance is None:
        return assemble(terms, hard)
    k = np.arange(1, H, 2)
    height = 10 - hill * np.exp(-(((k - 120) / 15) ** 2))
    slope = np.full(len(k), 0.1)
    soft = clearance(
        np.stack([S[1], S[2], -S[0]])[:, k], height, slope, 0 * slope, minimum_clearance
    )
    return assemble(terms, hard, soft, rho1=rho1)


def orthonormal(family, count):
    return bases.span_basis(family, H, count, sample_period=TS)[0]


def kkt_residual(data, alpha):
    """Return how far the gradient is from a combination of the active hard rows, relative to f."""
    change = data.A @ alpha
    assert np.all(change <= data.upper + 1e-7)
    assert np.all(change >= data.lower - 1e-7)
    at_upper, at_lower = change > data.upper - 1e-7, change < data.lower + 1e-7
    normals = np.concatenate([data.A[at_upper], -data.A[at_lower]]).T
    gradient = data.H @ alpha + data.f
    rest = nnls(normals, -gradient)[1] if normals.size else np.linalg.norm(gradient)
    return rest / np.linalg.norm(data.f)


@ALL
def test_a_known_optimum(backend):
    """Where one bound binds, its multiplier is the gradient of the cost there."""
    solution = solve(small(), backend)
    assert solution.status is Status.OPTIMAL
    np.testing.assert_allclose(solution.alpha, [1.0, 3.0], rtol=0, atol=1e-7)
    assert solution.multiplier_max == pytest.approx(1.0, abs=1e-7)
    assert solution.sigma == 0.0


@ALL
def test_without_rows_the_optimum_is_the_closed_form(backend):
    """Alpha = -H^{-1} f."""
    data = tracking(orthonormal("tent", 10), np.inf, (10, -5, 3, 1))
    data = replace(data, A=data.A[:0], lower=data.lower[:0], upper=data.upper[:0])
    solution = solve(data, backend)
    assert solution.status is Status.OPTIMAL
    np.testing.assert_allclose(solution.alpha, -np.linalg.solve(data.H, data.f), rtol=0, atol=1e-8)


@ALL
@pytest.mark.parametrize("limit", [5.0, 0.35, 0.1])
def test_the_optimum_satisfies_the_kkt_conditions(backend, limit):
    """At the optimum the gradient is balanced by rows that bind, pushing inwards only."""
    data = tracking(orthonormal("tent", 10), limit, (10, -5, 3, 1))
    solution = solve(data, backend)
    assert solution.status is Status.OPTIMAL
    assert kkt_residual(data, solution.alpha) < 1e-6
    assert (solution.multiplier_max > 1) == (limit < 5)


def test_backends_agree():
    """DAQP, PIQP and cvxpy give the same cost and the same correction, slack included, to 1e-6."""
    rng = np.random.default_rng(2005)
    binding = violated = 0
    for _ in range(12):
        B = orthonormal(rng.choice(["laguerre", "tent", "laguerre_function"]), rng.integers(4, 9))
        data = tracking(
            B,
            limit=10 ** rng.uniform(-1.3, 0.3),
            error=rng.normal(size=4) * 10 ** rng.uniform(-1, 1.3),
            minimum_clearance=3.0,
            hill=rng.uniform(0, 30),
            rho1=10 ** rng.uniform(1, 4),
        )
        answers = [solve(data, backend) for backend in BACKENDS]
        costs = [predicted_cost(data, answer.alpha) for answer in answers]
        assert {answer.status for answer in answers} == {Status.OPTIMAL}
        assert np.ptp(costs) <= 1e-6 * max(costs)
        assert np.ptp([answer.sigma for answer in answers]) <= 1e-6
        moves = np.stack([answer.alpha for answer in answers])
        assert np.ptp(moves, axis=0).max() <= 1e-5
        binding += answers[0].multiplier_max > 1
        violated += answers[0].sigma > 0
    assert binding >= 6
    assert violated >= 3


@pytest.mark.parametrize("count", range(1, 10))
@pytest.mark.parametrize("limit", [5.0, 0.3])
def test_laguerre_and_legendre_have_the_same_optimum(count, limit):
    """Polynomials of equal degree span the same corrections: same cost and controls to 1e-8."""
    laguerre = bases.laguerre(H, count, sample_period=TS)
    legendre = bases.legendre(H, count)
    found = []
    for Phi in (
        bases.orthonormalise(laguerre)[0],
        bases.orthonormalise(legendre)[0],
        orthonormal("laguerre", count),
    ):
        data = tracking(Phi, limit, (10, -5, 3, 1))
        solution = solve(data)
        assert solution.status is Status.OPTIMAL
        move = np.concatenate([Phi @ part for part in solution.alpha.reshape(4, count)])
        found.append((predicted_cost(data, solution.alpha), move))
    for cost, move in found[1:]:
        assert cost == pytest.approx(found[0][0], rel=1e-8)
        np.testing.assert_allclose(move, found[0][1], rtol=0, atol=1e-8 * np.abs(move).max())


def test_responses_to_raw_columns_map_to_the_same_optimum():
    """S identified on the paper's own Laguerre columns, S_raw to_raw, is S on the orthonormal ones.

    The optimum mapped back, to_raw alpha, makes the same controls from the raw columns.
    """
    B = bases.laguerre(H, 5, sample_period=TS)
    Phi, to_raw = bases.span_basis("laguerre", H, 5, sample_period=TS)
    each = np.kron(np.eye(4), to_raw)
    np.testing.assert_allclose(lagged_plant(B)[0] @ each, lagged_plant(Phi)[0], rtol=0, atol=1e-9)
    alpha = solve(tracking(Phi, 0.3, (10, -5, 3, 1))).alpha.reshape(4, 5)
    np.testing.assert_allclose(
        B @ (alpha @ to_raw.T).T, Phi @ alpha.T, rtol=0, atol=1e-12 * np.abs(alpha).max()
    )


def test_the_optimum_does_not_depend_on_the_size_of_the_columns():
    """Scaling coefficients by 1e-4 .. 1e4 scales the answer by the inverse, and nothing else."""
    data = tracking(orthonormal("legendre", 5), 0.3, (10, -5, 3, 1), 3.0, hill=20.0)
    T = np.logspace(-4, 4, 20)
    scaled = replace(
        data, H=data.H * T * T[:, None], f=data.f * T, A=data.A * T, soft_A=data.soft_A * T
    )
    expected = solve(data)
    found = solve(scaled)
    assert found.status is Status.OPTIMAL
    np.testing.assert_allclose(found.alpha * T, expected.alpha, rtol=0, atol=1e-9)


@ALL
def test_the_penalty_is_exact_above_the_sum_of_the_multipliers(backend):
    """With rho1 above the sum the soft rows hold as if hard; below it, slack is bought."""
    B = orthonormal("tent", 6)
    soft = tracking(B, 5.0, (10, -5, 3, 1), 3.0, hill=20.0, rho1=1e5)
    hard = replace(
        soft,
        A=np.concatenate([soft.A, soft.soft_A]),
        lower=np.concatenate([soft.lower, soft.soft_lower]),
        upper=np.concatenate([soft.upper, np.full(len(soft.soft_lower), np.inf)]),
        soft_A=soft.soft_A[:0],
        soft_lower=soft.soft_lower[:0],
    )
    wanted, exact = solve(hard, backend), solve(soft, backend)
    assert 0 < exact.soft_multiplier_sum < soft.rho1
    assert exact.sigma < 1e-8
    np.testing.assert_allclose(exact.alpha, wanted.alpha, rtol=0, atol=1e-6)

    cheap = replace(soft, rho1=0.5 * exact.soft_multiplier_sum)
    bought = solve(cheap, backend)
    assert bought.sigma > 1e-3
    assert bought.soft_multiplier_sum == pytest.approx(
        cheap.rho1 + cheap.rho2 * bought.sigma, rel=1e-6
    )


@ALL
def test_soft_rows_that_hold_anyway_change_nothing(backend):
    """Where the terrain is out of the way the answer is that without terrain, bit for bit."""
    B = orthonormal("laguerre", 5)
    free = solve(tracking(B, 0.35, (1, -0.5, 0.3, 0.1)), backend)
    clear = solve(tracking(B, 0.35, (1, -0.5, 0.3, 0.1), 3.0), backend)
    np.testing.assert_array_equal(clear.alpha, free.alpha)
    assert clear.soft_multiplier_sum == 0.0


@ALL
def test_a_row_that_reads_nothing_changes_nothing(backend):
    """An actuator held at its stop has rows without any response, and no solver minds them."""
    data = tracking(orthonormal("tent", 6), 0.2, (10, -5, 3, 1), 3.0, hill=20.0)
    dead = replace(
        data,
        A=np.concatenate([np.zeros((2, len(data.f))), data.A]),
        lower=np.concatenate([[-1.0, 0.0], data.lower]),
        upper=np.concatenate([[0.0, np.inf], data.upper]),
    )
    expected, found = solve(data, backend), solve(dead, backend)
    assert found.status is Status.OPTIMAL
    np.testing.assert_allclose(found.alpha, expected.alpha, rtol=0, atol=1e-7)


def test_no_solver_is_asked_where_no_row_is_in_the_way(monkeypatch):
    """The optimum without rows is the optimum with rows that it satisfies; else a solver answers."""
    monkeypatch.setattr(solvers, "BACKENDS", {"daqp": fail})
    free = tracking(orthonormal("tent", 6), 5.0, (1, -0.5, 0.3, 0.1), 3.0)
    solution = solve(free)
    assert (solution.status, solution.iterations) == (Status.OPTIMAL, 0)
    np.testing.assert_allclose(free.H @ solution.alpha, -free.f, rtol=0, atol=1e-9)
    for rows in ({"lower": free.lower + 1.0}, {"soft_lower": free.soft_lower + 50.0}):
        assert solve(replace(free, **rows)).status is Status.FAILED


CONTRADICTION = {
    "A": np.array([[1.0, 0.0], [2.0, 0.0]]),
    "lower": np.array([1.0, -9.0]),
    "upper": np.array([9.0, 0.0]),
}


@ALL
@pytest.mark.parametrize(
    ("changes", "status"),
    [
        (CONTRADICTION, Status.INFEASIBLE),
        ({"lower": np.array([2.0, 0.0])}, Status.INFEASIBLE),
        ({"f": np.array([np.nan, 0.0])}, Status.NON_FINITE),
        ({"H": np.diag([np.inf, 1.0])}, Status.NON_FINITE),
        ({"upper": np.array([np.nan, 1.0])}, Status.NON_FINITE),
        ({"soft_A": np.eye(2), "soft_lower": np.full(2, np.nan)}, Status.NON_FINITE),
        ({"H": np.zeros((2, 2))}, Status.FAILED),
    ],
)
def test_a_problem_without_a_solution_gives_a_status(backend, changes, status):
    """Infeasible, non-finite or degenerate data is answered by a status and alpha = 0."""
    solution = solve(small(**changes), backend)
    assert solution.status is status
    np.testing.assert_array_equal(solution.alpha, [0.0, 0.0])


@ALL
def test_an_iteration_limit_gives_a_status(backend):
    """A solver that runs out of iterations says so; its unfinished iterate is not used."""
    data = tracking(orthonormal("tent", 10), 0.1, (10, -5, 3, 1))
    solution = solve(data, backend, iteration_limit=2)
    assert solution.status is Status.ITERATION_LIMIT
    assert not solution.alpha.any()


@ALL
def test_a_solver_is_repeatable_and_leaves_the_data_alone(backend):
    """The same data, even read-only, gives the same bits."""
    data = tracking(orthonormal("tent", 6), 0.2, (10, -5, 3, 1), 3.0, hill=20.0)
    for part in vars(data).values():
        if isinstance(part, np.ndarray):
            part.setflags(write=False)
    first, second = solve(data, backend), solve(data, backend)
    assert first.status is Status.OPTIMAL
    assert first.alpha.tobytes() == second.alpha.tobytes()


def fail(problem, _limit):
    return solvers._Answer(problem.q, np.zeros(len(problem.lower)), Status.FAILED, 1)


def boast(problem, _limit):
    return solvers._Answer(problem.q, np.zeros(len(problem.lower)), Status.OPTIMAL, 1)


def test_an_answer_that_is_not_optimal_is_not_believed(monkeypatch):
    """A solver that calls a wrong answer optimal is found out by the optimality conditions."""
    monkeypatch.setattr(solvers, "BACKENDS", {"daqp": boast})
    solution = solve(small())
    assert solution.status is Status.INACCURATE
    assert not solution.alpha.any()


def test_the_fallback_answers_when_the_first_solver_fails(monkeypatch):
    """PIQP takes over, and the reason names who failed and how."""
    monkeypatch.setattr(solvers, "BACKENDS", {**BACKENDS, "daqp": fail})
    solution = solve_with_fallback(small())
    assert (solution.backend, solution.status) == ("piqp", Status.OPTIMAL)
    assert solution.reason == "daqp: numerical failure"
    np.testing.assert_allclose(solution.alpha, [1.0, 3.0], rtol=0, atol=1e-7)


def test_the_last_rung_is_no_correction():
    """When all fail the answer is alpha = 0 with its slack, the first status and all reasons."""
    soft = Rows(np.eye(2), np.full(2, 4.0), np.full(2, np.inf))
    data = small(**CONTRADICTION, soft_A=soft.A, soft_lower=soft.lower)
    solution = solve_with_fallback(data)
    assert (solution.backend, solution.status) == ("none", Status.INFEASIBLE)
    assert solution.reason == "daqp: infeasible; piqp: infeasible"
    assert not solution.alpha.any()
    assert solution.sigma == slack(data, solution.alpha) == 4.0


def test_the_first_solver_has_no_reason():
    """Where nothing fails nothing is explained."""
    solution = solve_with_fallback(small())
    assert (solution.backend, solution.reason) == ("daqp", "")


def test_an_unknown_solver_is_refused_with_the_nearest_name():
    """A misspelt name is answered with the nearest one."""
    with pytest.raises(KeyError, match="got 'dapq', expected one such as 'daqp'"):
        solve(small(), "dapq")
