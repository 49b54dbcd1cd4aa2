r"""Linearise and solve, again and again, until nothing is gained: the least cost within a basis.

One pass identifies S about the commands of the last, and minimises the quadratic model

    J_lin(alpha) + lambda sum over k of |Phi_k alpha|^2_W

within the limits. The last term (Levenberg's) keeps the change where the linear response holds; W
measures it in units of 1 G and 0.1 rad. Several lengths of the change are rolled out and the best on
the *true* cost is taken; lambda falls after a pass that gained and grows after one that did not. With
``damping=0`` this is Gauss-Newton with a line search, as the controller does it once per update.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.bases import span_basis
from controller.prediction import Response, stack_bases
from controller.qp import predicted_cost
from controller.solvers import Status, solve_with_fallback
from paper.problem import Problem, costs, quadratic_programme, respond

Floats = NDArray[np.float64]

STEPS = (1.0, 0.5, 0.25, 0.1, 0.03, 0.01)
"""Lengths tried of every change: finer than the controller's, which has the next update."""
EASE, BRAKE = 0.1, 100.0  # of lambda, after a pass that gained and one that did not
LEAST = 1e-4  # lambda that is as good as none, from which patience suffices to get back to 1
UNITS = np.array([1.0, 0.1, 0.1, 0.1])  # G, rad, rad, rad or G: a change of commands worth 1
PATIENCE = 3  # passes in a row that gain less than the tolerance


@dataclass(frozen=True)
class Converged:
    """The end of the passes.

    Attributes
    ----------
    J : float
        True cost of ``u``.
    J_linear : float
        What the linear model about trim promised, without damping: the optimum of the first pass.
    J_full_step : float
        True cost of that promise taken at its word, infinite where the flight is invalid.
    J_first : float
        True cost after the first pass.
    u : ndarray, shape (H, 4)
        Commands.
    passes : int
        How many were made.
    history : tuple of float
        True cost before the first pass and after each.
    failures : int
        Quadratic programmes without an answer.
    """

    J: float
    J_linear: float
    J_full_step: float
    J_first: float
    u: Floats
    passes: int
    history: tuple[float, ...]
    failures: int


def basis(family: str, count: int, horizon: int = 200, **options: Any) -> Floats:
    """Return Phi (4, H, 4 count): orthonormal columns of a family's span, on every channel."""
    one, _ = span_basis(family, horizon, count, sample_period=0.05, **options)
    return stack_bases([one] * 4)


def change(
    problem: Problem, response: Response, u: Floats, damping: float = 0.0, backend: str = "daqp"
) -> tuple[Floats, float]:
    """Return the change of commands (H, 4) at a lambda, and the J_lin that it promises.

    A quadratic programme without an answer gives no change, at an infinite promise.
    """
    data = quadratic_programme(problem, response, u)
    scaled = (response.Phi / UNITS[:, None, None]).reshape(-1, response.Phi.shape[2])
    solution = solve_with_fallback(replace(data, H=data.H + damping * scaled.T @ scaled), backend)
    answered = solution.status is Status.OPTIMAL
    promised = predicted_cost(data, solution.alpha) if answered else np.inf
    return (response.Phi @ solution.alpha).T, promised


def within(problem: Problem, u: Floats, changed: Floats) -> Floats:
    """Return commands cut to the model's bounds, where ``u`` is within them."""
    low, high = problem.model.command_min, problem.model.command_max
    return np.clip(changed, np.minimum(low, u), np.maximum(high, u))


def converge(
    problem: Problem,
    Phi: Floats,
    *,
    amplitude: Floats | None = None,
    passes: int = 40,
    steps: Sequence[float] = STEPS,
    damping: float = 1.0,
    backend: str = "daqp",
    tolerance: float = 1e-6,
    start: Floats | None = None,
) -> Converged:
    """Minimise the true cost over trim plus the span of Phi.

    Parameters
    ----------
    problem : Problem
    Phi : ndarray, shape (4, H, m)
        Columns; orthonormal ones (:func:`basis`), or raw ones to see what becomes of them.
    amplitude : ndarray, shape (4,), optional
        Perturbation per channel of the identification; the controller's own by default.
    passes : int
        At most.
    steps : sequence of float
        Lengths tried of every change.
    damping : float
        The first lambda; 0 is and stays Gauss-Newton.
    backend : str
        Of :mod:`controller.solvers`.
    tolerance : float
        Relative gain below which a pass has gained nothing.
    start : ndarray, shape (H, 4), optional
        Commands of the first pass; the problem's ``u0`` by default.
    """
    u = problem.u0 if start is None else start
    history = [float(costs(problem, u[None])[0])]
    linear = full_step = np.inf
    idle = failures = 0
    for number in range(passes):
        response = respond(problem, Phi, u, amplitude)
        if not response.valid:
            break
        if number == 0:
            whole, linear = change(problem, response, u, 0.0, backend)
            full_step = float(costs(problem, within(problem, u, u + whole)[None])[0])
        du, promised = change(problem, response, u, damping, backend)
        failures += not np.isfinite(promised)
        candidates = within(problem, u, u + np.multiply.outer(steps, du))
        true = costs(problem, candidates)
        best = int(np.argmin(true))
        before = history[-1]
        if true[best] < before:
            u = candidates[best]
            damping = max(EASE * damping, min(damping, LEAST))
        else:
            damping *= BRAKE
        history.append(min(before, float(true[best])))
        idle = idle + 1 if before - history[-1] <= tolerance * before else 0
        if idle == PATIENCE:
            break
    return Converged(
        J=history[-1],
        J_linear=linear,
        J_full_step=full_step,
        J_first=history[min(1, len(history) - 1)],
        u=u,
        passes=len(history) - 1,
        history=tuple(history),
        failures=failures,
    )
