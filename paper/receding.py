"""Receding horizon, as the paper flies: optimise ten seconds, apply half a second, go on from there."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.optimise import STEPS
from paper.converge import change, within
from paper.problem import Problem, costs, respond

Floats = NDArray[np.float64]
APPLIED = 10  # samples: updates at 2 Hz
COLD_PASSES = 5  # at the first update


class Improved(NamedTuple):
    """Commands ``u`` (H, 4) after one pass, their true cost ``J``, and the step length accepted."""

    u: Floats
    J: float
    step: float


class Flown(NamedTuple):
    """A flight of T samples.

    ``time`` (T,), s, and ``outputs`` (T, p) at the ends of the samples; ``u`` (T, 4); ``steps``: the
    step length accepted at each update, the last pass's at the first; ``valid``: it did not depart.
    """

    time: Floats
    outputs: Floats
    u: Floats
    steps: Floats
    valid: bool


def improve(problem: Problem, Phi: Floats, *, lengths: Sequence[float] = STEPS) -> Improved:
    """Linearise about ``problem.u0``, solve, search the line, as the controller does.

    The first of equally good lengths wins, and 0 is tried first; a single length is taken as it is,
    whatever it does, if its rollout is finite.
    """
    u0 = problem.u0
    response = respond(problem, Phi)
    if not response.valid:
        return Improved(u0, np.inf, 0.0)
    whole, _ = change(problem, response, u0)
    tried = np.array([0.0, *lengths])
    u = within(problem, u0, u0 + np.multiply.outer(tried, whole))
    J = costs(problem, u)
    is_forced = len(lengths) == 1 and np.isfinite(J[1])
    best = 1 if is_forced else int(np.argmin(J))
    return Improved(u[best], float(J[best]), float(tried[best]))


def fly(
    problem_at: Callable[[float], Problem],
    Phi: Floats,
    updates: int,
    *,
    lengths: Sequence[float] = STEPS,
) -> Flown:
    """Fly the first samples of each plan through the model that it was made with.

    An update has one pass; its nominal command is the last plan, shifted, its tail filled with trim.

    Parameters
    ----------
    problem_at : callable
        Returns the horizon that begins at a time, s; of its ``state`` and ``u0`` only the first
        count.
    Phi : ndarray, shape (4, H, m)
        Basis columns.
    updates : int
        At 2 Hz.
    lengths : sequence of float
        Of the step; see :func:`improve`.
    """
    problem = problem_at(0.0)
    period = problem.model.sample_period
    for _ in range(COLD_PASSES - 1):
        problem = replace(problem, u0=improve(problem, Phi, lengths=lengths).u)
    outputs, flown, steps = [], [], []
    valid = True
    while valid and len(steps) < updates:
        plan = improve(problem, Phi, lengths=lengths)
        now = plan.u[:APPLIED]
        rollout = problem.model.rollout(problem.state, now[None], problem.wind, problem.bias)
        valid = bool(rollout.valid[0])
        outputs.append(rollout.outputs[0])
        flown.append(now)
        steps.append(plan.step)
        following = problem_at(len(steps) * APPLIED * period)
        tail = following.commands.T[-APPLIED:]
        problem = replace(
            following, state=rollout.last[0].copy(), u0=np.concatenate([plan.u[APPLIED:], tail])
        )
    time = np.arange(1.0, len(steps) * APPLIED + 1.0)
    return Flown(
        period * time,
        np.concatenate(outputs),
        np.concatenate(flown),
        np.array(steps),
        valid,
    )
