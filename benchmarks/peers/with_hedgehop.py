"""Hedgehop: linearise and solve in a basis; IPOPT and fatrop on the same multiple shooting."""

from problems import ITERATIONS, Answer, Floats, Peer, Solve

from controller.shooting import Solver, shooter
from paper.converge import basis, converge
from paper.problem import Problem, goal_of


def _in_basis(family: str, count: int) -> Peer:
    def prepare(problem: Problem) -> Solve:
        Phi = basis(family, min(count, problem.horizon), problem.horizon)

        def solve(problem: Problem, u: Floats, again: bool) -> Answer:
            # a controller makes one pass per update, from its last plan
            found = converge(problem, Phi, start=u, passes=1 if again else 40)
            return Answer(found.u, found.passes, "one pass" if again else "converged")

        solve(problem, problem.u0, True)  # compiles
        return solve

    name = "full order" if family == "full" else f"{family.replace('_', ' ')} {count}"
    return Peer(f"Hedgehop, {name}", ("hedgehop", "daqp"), prepare)


def _shooting(solver: Solver) -> Peer:
    def prepare(problem: Problem) -> Solve:
        shoot = shooter(problem.model, problem.horizon, solver=solver, iterations=ITERATIONS)

        def solve(problem: Problem, u: Floats, again: bool) -> Answer:
            del again  # the states follow from the commands
            shot = shoot(problem.state, u, goal_of(problem))
            return Answer(shot.u, shot.iterations, shot.status)

        return solve

    return Peer(f"CasADi + {solver}", ("casadi",), prepare)


PEERS = (
    _in_basis("tent", 10),
    _in_basis("laguerre_function", 10),
    _in_basis("laguerre", 5),
    _in_basis("full", 200),
    _shooting("ipopt"),
    _shooting("fatrop"),
)
