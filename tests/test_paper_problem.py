"""One horizon of eq. 2.1: its cost, its linear model, its limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.qp import predicted_cost
from paper.converge import basis
from paper.problem import (
    altitude_step,
    costs,
    goal_of,
    level_flight,
    quadratic_programme,
    respond,
    rolling_height,
    terrain,
)

H = 40
FORMS = ("attitude", "actuator")
SEEDS = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@pytest.mark.parametrize("form", FORMS)
def test_level_flight_costs_nothing_at_trim(form):
    """Trim is the minimum of going on in level flight, and its cost is zero."""
    problem = level_flight(form=form, horizon=H)
    assert costs(problem, problem.u0[None])[0] == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize(("at_s", "after"), [(0.0, H), (1.0, H - 19), (1.5, H - 29)])
def test_a_step_costs_its_square_per_sample_from_its_time_on(at_s, after):
    """The sample that ends at the time of the step is the first that wants the new altitude."""
    problem = altitude_step(horizon=H, height_m=3.0, at_s=at_s)
    assert costs(problem, problem.u0[None])[0] == pytest.approx(9.0 * after, rel=1e-12)


def test_the_literal_weight_on_the_control_is_an_option():
    """With ``actuators=0`` trim pays R times its own square at every sample."""
    problem = replace(level_flight(horizon=H), actuators=np.zeros(4))
    _, _, trim = problem.model.trim(30.0)
    expected = H * float(np.square(trim) @ problem.R)
    assert costs(problem, problem.u0[None])[0] == pytest.approx(expected, rel=1e-12)


def test_a_rollout_that_departs_costs_infinity():
    """An invalid flight has an infinite cost, and its neighbours in the batch keep theirs."""
    problem = altitude_step(form="actuator", horizon=200)
    thrown = problem.u0.copy()
    thrown[:, 1] += 0.3
    J = costs(problem, np.stack([problem.u0, thrown]))
    assert J[0] == pytest.approx(14100.0)
    assert np.isinf(J[1])


@pytest.mark.parametrize("form", FORMS)
@given(rng=SEEDS)
@settings(deadline=None, max_examples=10)
def test_the_programme_is_the_cost_to_second_order(form, rng):
    """J_lin is J at the nominal and its error falls with the cube of a small change's size."""
    problem = terrain(form=form, horizon=H)
    response = respond(problem, basis("legendre", 3, H))
    data = quadratic_programme(problem, response, problem.u0)
    assert data.constant == pytest.approx(costs(problem, problem.u0[None])[0], rel=1e-12)
    direction = rng.uniform(-1.0, 1.0, 12) * np.repeat([0.1, 0.02, 0.02, 0.02], 3)
    sizes = np.array([1e-3, 2e-3])
    moved = problem.u0 + np.array([s * (response.Phi @ direction).T for s in sizes])
    promised = np.array([predicted_cost(data, s * direction) for s in sizes])
    off = np.abs(costs(problem, moved) - promised)
    change = np.abs(promised - data.constant)
    assert (off <= 2e-3 * change + 1e-6 * data.constant).all()


@pytest.mark.parametrize("form", FORMS)
def test_exact_and_perturbed_responses_agree(form):
    """Recursion and rollouts give the same S up to the error of one-sided differences."""
    problem = altitude_step(form=form, horizon=H)
    Phi = basis("tent", 4, H)
    exact, perturbed = respond(problem, Phi), respond(problem, Phi, amplitude=problem.amplitude)
    size = np.abs(exact.S).max(axis=(1, 2), keepdims=True)
    assert (np.abs(exact.S - perturbed.S) <= 2e-3 * size + 1e-12).all()


@pytest.mark.parametrize("form", FORMS)
def test_no_change_is_within_the_limits(form):
    """Alpha = 0 satisfies every row, and every bounded command has one per sample and side."""
    problem = altitude_step(form=form, horizon=H)
    data = quadratic_programme(problem, respond(problem, basis("tent", 2, H)), problem.u0)
    assert (data.lower <= 0.0).all()
    assert (data.upper >= 0.0).all()
    bounded = int(np.isfinite(problem.model.command_max).sum())
    clipped = 3 if form == "attitude" else 0
    assert len(data.lower) == H * (bounded + clipped) + 2 * H // 4


def test_terrain_begins_on_its_reference():
    """Without an offset the flight starts 10 m above the terrain; with one it is off by it."""
    on, off = (
        terrain(horizon=H, along_m=100.0),
        terrain(horizon=H, along_m=100.0, offset_m=(1, 25, -8)),
    )
    assert -on.state[2] == pytest.approx(rolling_height(np.array(100.0)) + 10.0)
    assert off.state[:3] - on.state[:3] == pytest.approx((1.0, 25.0, 8.0))
    assert on.reference[:, 0] == pytest.approx(off.reference[:, 0])


def test_the_goal_of_direct_shooting_has_the_same_reference():
    """The true optimum is asked for the same outputs, weights and trims, as functions of time."""
    problem = terrain(horizon=H)
    goal = goal_of(problem)
    asked = np.stack([goal.north, goal.east, goal.altitude, goal.heading, goal.speed])
    assert (asked == problem.reference).all()
    assert not goal.slope.any()
    assert (goal.Q, goal.R, goal.Rc) == (problem.Q, problem.R, problem.Rc)
