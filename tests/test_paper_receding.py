"""The receding horizon of the study: it goes on from where it is, and never accepts a worse plan."""

from dataclasses import replace

import numpy as np

from paper.converge import basis
from paper.problem import altitude_step, costs, level_flight
from paper.receding import APPLIED, fly, improve

H = 60
PHI = basis("legendre", 3, H)


def at(problem):
    """Return level flight as a function of time: the point wanted moves on at the speed wanted."""

    def problem_at(time):
        reference = problem.reference.copy()
        reference[0] += time * reference[4]
        return replace(problem, reference=reference)

    return problem_at


def test_one_pass_never_accepts_a_higher_cost():
    """The accepted cost is true, and never above that of the nominal commands."""
    problem = altitude_step(horizon=H, at_s=1.0)
    plan = improve(problem, PHI)
    before, after = costs(problem, np.array([problem.u0, plan.u]))
    assert abs(plan.J - after) <= 1e-12 * after
    assert after < before
    assert plan.step > 0.0


def test_a_full_step_is_taken_whatever_it_does():
    """With a single length the optimum of the linear model is flown, better or worse."""
    problem = altitude_step(horizon=H, at_s=1.0)
    assert improve(problem, PHI, lengths=(1.0,)).step == 1.0


def test_level_flight_stays_level():
    """From trim, with nothing to do, the aircraft stays where the reference is."""
    problem = level_flight(horizon=H)
    flown = fly(at(problem), PHI, 3)
    np.testing.assert_allclose(flown.time, 0.05 * np.arange(1, 3 * APPLIED + 1))
    np.testing.assert_allclose(flown.outputs[:, 0], 30.0 * flown.time, atol=1e-6)
    np.testing.assert_allclose(flown.outputs[:, 2], 0.0, atol=1e-6)
    assert flown.valid


def test_a_flight_is_its_commands_rolled_out():
    """The pieces that are applied join to one trajectory of the model under one command history."""
    problem = level_flight(horizon=H)
    problem = replace(problem, state=problem.state + np.eye(17)[2] * 2.0)  # 2 m low
    flown = fly(at(problem), PHI, 4)
    rollout = problem.model.rollout(problem.state, flown.u[None], problem.wind, problem.bias)
    np.testing.assert_allclose(flown.outputs, rollout.outputs[0], atol=1e-9)
    assert abs(flown.outputs[-1, 2]) < 1.0
