"""The problem that every peer gets: terrain following for 10 s at 30 m/s, from two starts."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paper.problem import Problem, costs, terrain

Floats = NDArray[np.float64]
WEIGHTS = {"Q": (1.0, 1.0, 5.0, 20.0, 0.5), "R": (1.0, 20.0, 20.0, 5.0)}
OFFSETS = {"on course": (0.0, 0.0, 0.0), "25 m off": (0.0, 25.0, -8.0)}
"""Starts, north, east and up of the reference, m."""
ITERATIONS = 100  # of a solver, at most
TURN = 3.0
"""rad from the heading to its set-point; at half a turn the stabiliser turns the other way."""


class Answer(NamedTuple):
    """What a peer returns: commands (H, 4), how often it iterated, and its own word for the outcome."""

    u: Floats
    iterations: int
    status: str


Solve = Callable[[Problem, Floats, bool], Answer]
"""Solve a problem from commands (H, 4); the last argument: the rest is left from the answer before."""


class Peer(NamedTuple):
    """Who solves: a name, the packages to print, and how it is built for problems of one shape.

    ``prepare`` raises ImportError where a package is not installed.
    """

    name: str
    packages: tuple[str, ...]
    prepare: Callable[[Problem], Solve]


class Traced(NamedTuple):
    """The plant for peers that build on CasADi: a sample, and residuals of eq. 2.1 as functions.

    ``advance(x, u)`` is the state at the sample's end. ``tracked(x)`` (5) are the outputs that Q
    weighs, ``actuators(x, u)`` (4) what R weighs.
    """

    advance: Any
    tracked: Any
    actuators: Any


def start(name: str, horizon: int) -> Problem:
    """Return the problem from a start of :data:`OFFSETS`."""
    return terrain(offset_m=OFFSETS[name], horizon=horizon, **WEIGHTS)


def traced(problem: Problem) -> Traced:
    """Trace the plant of a problem; wind and bias are zero in all of them."""
    import casadi as ca

    advance, outputs = problem.model.symbolic()
    x, u = ca.SX.sym("x", 17), ca.SX.sym("u", 4)
    y = outputs(x, u, x)[problem.rows.tolist()]
    return Traced(
        ca.Function("advance", [x, u], [advance(x, u, 0.0, 0.0)]),
        ca.Function("tracked", [x], [y[:5]]),
        ca.Function("actuators", [x, u], [y[7:]]),
    )


def states(problem: Problem, plant: Traced, u: Floats) -> Floats:
    """Return the states (H + 1, 17) under commands, where a peer's search starts."""
    X = plant.advance.mapaccum(len(u))(problem.state, u.T).full().T
    return np.vstack([problem.state, X])


def miss(problem: Problem, u: Floats) -> tuple[float, float]:
    """Return how far the flight is from the reference at its end, across and in height, m."""
    y = problem.model.rollout(problem.state, u[None], problem.wind, problem.bias).outputs[0, -1]
    east, up = y[problem.rows[1:3]] - problem.reference[1:3, -1]
    return float(east), float(up)


def cost(problem: Problem, u: Floats) -> float:
    """Return the true J of commands, infinite where the flight is invalid or a bound is exceeded."""
    low, high = problem.model.command_min - 1e-6, problem.model.command_max + 1e-6
    within = bool(((u >= low) & (u <= high)).all())
    return float(costs(problem, u[None])[0]) if within else np.inf
