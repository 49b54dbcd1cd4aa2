"""Linearise and solve until nothing is gained."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_model import LinearModel

from paper.converge import basis, change, converge, within
from paper.problem import altitude_step, costs, respond, terrain

H = 60
SEEDS = st.integers(0, 2**32 - 1).map(np.random.default_rng)
FORMS = ("attitude", "actuator")


def step(form="attitude"):
    """Return a step of 5 m after one of three seconds."""
    return altitude_step(form=form, horizon=H, height_m=5.0, at_s=1.0)


def linear_problem():
    """Return a step for a model that is exactly linear, far from its limits."""
    model = LinearModel()
    state, command, actuators = model.trim(30.0)
    return replace(
        step(),
        model=model,
        state=state,
        u0=np.tile(command, (H, 1)),
        actuators=actuators,
        commands=np.tile(command[:, None], H),
        attitude_limit=1e3,
    )


def test_a_linear_model_is_solved_in_one_pass():
    """Without damping the first pass attains what the linear model promises, and is the last."""
    # outputs are linear but for the speed, which is the forward velocity there
    problem = linear_problem()
    end = converge(problem, basis("tent", 4, H), amplitude=np.full(4, 1e-3), damping=0.0)
    assert end.J_first == pytest.approx(end.J_linear, rel=1e-6)
    assert end.J_full_step == pytest.approx(end.J_linear, rel=1e-6)
    assert pytest.approx(end.J_first, rel=1e-5) == end.J


@pytest.mark.parametrize("form", FORMS)
@given(rng=SEEDS)
@settings(deadline=None, max_examples=5)
def test_the_cost_never_rises_and_is_that_of_the_commands(form, rng):
    """No pass raises the true cost, and what is reported is the cost of the returned commands."""
    family = str(rng.choice(["tent", "box", "legendre", "laguerre_function"]))
    problem = terrain(form=form, horizon=H, along_m=rng.uniform(0.0, 600.0))
    end = converge(problem, basis(family, int(rng.integers(1, 7)), H), passes=6)
    assert (np.diff(end.history) <= 0.0).all()
    assert end.J == end.history[-1] == costs(problem, end.u[None])[0]
    assert len(end.history) == end.passes + 1


@pytest.mark.parametrize("form", FORMS)
def test_commands_stay_in_the_span_and_within_bounds(form):
    """The optimum is trim plus a combination of the columns, and no command is beyond its limit."""
    problem = step(form)
    Phi = basis("tent", 5, H)
    end = converge(problem, Phi)
    flat = Phi.transpose(1, 0, 2).reshape(4 * H, -1)
    off = (end.u - problem.u0).ravel()
    outside = off - flat @ np.linalg.lstsq(flat, off)[0]
    assert np.abs(outside).max() < 1e-6
    assert (end.u >= problem.model.command_min).all()
    assert (end.u <= problem.model.command_max).all()


def test_the_optimum_is_that_of_the_span_not_of_the_columns():
    """Columns mixed by any invertible matrix lead to the same cost."""
    problem, Phi = step(), basis("legendre", 4, H)
    M = np.eye(16) + 0.3 * np.random.default_rng(1).standard_normal((16, 16))
    ends = [converge(problem, columns) for columns in (Phi, Phi @ M)]
    assert ends[0].J_linear == pytest.approx(ends[1].J_linear, rel=1e-8)
    assert pytest.approx(ends[1].J, rel=1e-5) == ends[0].J


def test_a_larger_span_never_costs_more():
    """Tents at nested knots and the full order are ordered in cost."""
    problem = step()
    J = [converge(problem, basis("tent", n, H)).J for n in (2, 3, 5, 9)]
    J.append(converge(problem, basis("full", H, H)).J)
    assert (np.diff(J) <= 1e-4 * J[-1]).all()


def test_damping_shortens_the_change():
    """A larger lambda moves the commands less, and promises no more."""
    problem = step()
    response = respond(problem, basis("tent", 5, H))
    moves, promised = zip(
        *(change(problem, response, problem.u0, damping) for damping in (0.0, 0.1, 10.0)),
        strict=True,
    )
    sizes = [np.linalg.norm(move / (1.0, 0.1, 0.1, 0.1)) for move in moves]
    assert sizes[0] > sizes[1] > sizes[2]
    assert promised[0] < promised[1] < promised[2]


def test_commands_beyond_a_bound_are_cut_but_not_made_worse():
    """Commands are cut at the bounds, except where they were beyond before."""
    problem = step()
    beyond = problem.u0.copy()
    beyond[0, 0] = 4.0
    cut = within(problem, beyond, beyond + 1.0)
    assert cut[0, 0] == 4.0
    assert cut[1:, 0] == pytest.approx(np.minimum(beyond[1:, 0] + 1.0, 3.5))
