"""One update: merit, shift, ladder, bias, latency, horizon; as a pure function of its memory."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from hand_flight import flat, hills
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_model import LinearModel, aim_at, straight_path

from controller import optimise
from controller.course import make_course
from controller.parameters import MpcParameters, basis_planner, design
from controller.solvers import Solution, Status
from controller.terrain_map import empty_map
from controller.terrain_map import update as sense
from controller.update import LADDER, Memory, Plan, Task, trim_commands, update
from plant.helicopter import HelicopterModel, ModelParameters

APPLIED = 10  # samples until the next update
P = MpcParameters()
FORMS = ("attitude", "actuator")
RUNG = {name: number for number, name in enumerate(LADDER)}


@cache
def task(form="attitude", parameters=P):
    """Return the task of flying north."""
    model = HelicopterModel(ModelParameters(command=form))
    course = make_course(parameters.waypoints_m, parameters.speed_mps)
    return Task(model, course, cache(partial(basis_planner, parameters, model)))


def trim(form="attitude"):
    """Return the trim command north at 30 m/s, (4,)."""
    return task(form).model.trim(30.0)[1]


def fresh(form="attitude", ground=hills, reach_m=400.0):
    """Return the memory before the first update, of ground sensed ``reach_m`` ahead."""
    n, e = np.meshgrid(np.arange(-100.0, reach_m, 10.0), np.arange(-100.0, 101.0, 10.0))
    sensed = sense(
        empty_map(10.0), n.ravel(), e.ravel(), ground(n, e).ravel(), np.ones(n.size, np.int64)
    )
    commands = trim_commands(task(form), 30.0, np.zeros(P.plan_capacity))
    return Memory(plan=Plan(0, 0.0, 0, commands), bias=np.zeros(3), terrain_map=sensed)


def state_at(form="attitude", ground=hills, **off):
    """Return trimmed flight north at 30 m/s, 10 m above the origin; ``off`` adds to states."""
    model = task(form).model
    state = model.trim(30.0)[0]
    state[2] = -10.0 - float(ground(np.zeros(()), np.zeros(())))
    for name, value in off.items():
        state[model.states.index(name)] += value
    return state


def once(memory, state, form="attitude", parameters=P, late=0, time=0.0):
    """Return the memory, pass and rung of an update."""
    return update(task(form, parameters), parameters, memory, state, time, late, APPLIED)


@cache
def first(form="attitude"):
    """Return the memory after the first update, at time 0."""
    return once(fresh(form), state_at(form), form)[0]


def flown(memory, state, number=APPLIED, form="attitude"):
    """Return the state after the first samples of a plan."""
    commands = memory.plan.commands[None, :number]
    return task(form).model.rollout(state, commands, np.zeros(3), np.zeros(3)).last[0].copy()


@pytest.fixture
def no_solver(monkeypatch):
    """Make every quadratic programme fail."""

    def fail(data, backend):
        return Solution(np.zeros(len(data.f)), 0.0, Status.FAILED, "none")

    monkeypatch.setattr(optimise, "solve_with_fallback", fail)


# -- what is accepted ------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
@settings(deadline=None, max_examples=12)
@given(data=st.data())
def test_an_update_never_makes_the_shifted_plan_worse(form, data):
    """From anywhere: merit after <= merit before, a step of the list, every sample within bounds."""
    angle, speed = st.floats(-0.35, 0.35), st.floats(-3.0, 3.0)
    model = task(form).model
    memory = first(form)
    rungs = set()
    for time in (0.5, 1.0):
        off = {name: data.draw(speed) for name in ("u", "v", "w", "north", "east", "down")}
        off |= {name: data.draw(angle) for name in ("phi", "theta", "psi", "p", "q", "r")}
        memory, best, rung = once(memory, state_at(form, **off), form, time=time)
        rungs.add(rung)
        assert best.after <= best.before
        assert best.step in (0.0, *optimise.STEPS)
        assert np.all(memory.plan.commands >= model.command_min)
        assert np.all(memory.plan.commands <= model.command_max)
        if form == "attitude":  # the course leads north
            assert np.abs(memory.plan.commands[:, 3]).max() <= np.radians(50.0) + 1e-9
        np.testing.assert_array_equal(memory.plan.commands[: memory.plan.horizon], best.u)
    assert rungs <= set(range(4))


def turned(limit_deg, memory=None):
    """Return the pass of an update that starts 0.35 rad off the heading and turns away from it."""
    parameters = replace(P, heading_set_point_limit_deg=limit_deg, passes_at_start=1)
    state = state_at(psi=0.35, r=0.35)
    return once(fresh() if memory is None else memory, state, parameters=parameters, time=0.5)[1]


def test_a_plan_keeps_the_heading_set_point_near_the_course():
    """No sample is off by more than the limit, and the programme knows it: it is no mere clip."""
    limit = np.radians(50.0)
    free, best = turned(179.0), turned(50.0)
    assert np.abs(free.u[:, 3]).max() > 1.2 * limit
    assert np.abs(best.u[:, 3]).max() <= limit + 1e-12
    nominal = np.zeros(200)  # the course leads north
    asked = nominal + design(P, task().model, 200).Phi[3] @ best.solution.alpha
    assert np.abs(asked[3::4]).max() <= limit + 1e-6
    assert best.solution.multiplier_max > 0


def test_a_set_point_beyond_its_limit_may_only_come_back():
    """A shifted plan that is outside leaves the programme feasible, and goes no further out."""
    memory = first()
    commands = memory.plan.commands.copy()
    commands[:, 3] = 1.2
    best = turned(50.0, replace(memory, plan=Plan(3, 0.0, 200, commands)))
    assert best.solution.status is Status.OPTIMAL
    assert best.step > 0
    assert best.u[:, 3].max() <= 1.2
    assert best.u[:, 3].min() >= -np.radians(50.0)


def test_a_step_into_what_does_not_fly_is_never_taken():
    """Of a full step that departs only as much is taken as still flies."""

    class Brittle(LinearModel):
        thrust_off_trim = np.inf

        def rollout(self, state, commands, wind, bias):
            off = np.abs(commands[:, :, 0] - 1.0).max(axis=1)
            flight = super().rollout(state, commands, wind, bias)
            return flight._replace(valid=off < self.thrust_off_trim)

    model = Brittle()
    state, command, _ = model.trim(30.0)
    state[2] = -99.0  # a metre below the reference
    aim = aim_at(straight_path(), empty_map(10.0), model, 200)
    start = design(P, model, 200), state, np.tile(command, (200, 1)), np.zeros(3), aim
    full = optimise.optimise(*start)
    assert full.step == 1.0
    model.thrust_off_trim = 0.6 * np.abs(full.u[:, 0] - 1.0).max()
    assert optimise.optimise(*start).step == 0.5


def test_from_a_cold_start_a_few_passes_are_made():
    """The first update of all passes again while that gains; one pass costs more."""
    costs = {}
    for passes in (1, 5):
        parameters = replace(P, passes_at_start=passes)
        _, best, _ = once(fresh(), state_at(down=-3.0, psi=0.2), parameters=parameters)
        costs[passes] = best.after
    assert costs[5] < costs[1]


# -- shift and tail --------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_solver")
def test_the_nominal_is_the_last_plan_shifted_and_filled_with_trim():
    """Without any correction the plan is its old tail, sample by sample, and trim at the end."""
    bumpy = fresh().plan.commands + 0.02 * np.random.default_rng(2).normal(
        size=(P.plan_capacity, 4)
    )
    memory = replace(fresh(ground=flat), plan=Plan(7, 0.0, 200, bumpy))
    memory, best, rung = once(memory, state_at(ground=flat), time=0.5)
    np.testing.assert_array_equal(best.u[:190], bumpy[10:])
    np.testing.assert_array_equal(best.u[190:], np.tile(trim(), (10, 1)))
    assert (memory.plan.sequence, memory.plan.start) == (8, 0.5)
    assert (rung, best.step) == (RUNG["old tail"], 0.0)


@pytest.mark.usefixtures("no_solver")
def test_only_the_optimised_part_of_a_plan_is_shifted():
    """What lies beyond a plan's horizon is trim already, and trim takes its place."""
    bumpy = fresh().plan.commands + 0.02
    memory = replace(fresh(ground=flat), plan=Plan(7, 0.0, 120, bumpy))
    _, best, _ = once(memory, state_at(ground=flat), time=0.5)
    np.testing.assert_array_equal(best.u[:110], bumpy[10:120])
    np.testing.assert_array_equal(best.u[110:], np.tile(trim(), (90, 1)))


@pytest.mark.parametrize("form", FORMS)
def test_a_plan_ends_in_trim(form):
    """Beyond the horizon, to the capacity: trim, holding the last heading of the plan."""
    memory, best, _ = once(fresh(form, reach_m=200.0), state_at(form), form)
    horizon = memory.plan.horizon
    assert horizon == 120  # 190 m sensed, 6.3 s
    expected = np.tile(trim(form), (P.plan_capacity - horizon, 1))
    if form == "attitude":
        expected[:, 3] = best.u[-1, 3]
    np.testing.assert_array_equal(memory.plan.commands[horizon:], expected)


# -- the ladder ------------------------------------------------------------------------------------


def tumbling(form="actuator"):
    """Return a memory whose plan pitches over: its rollout is invalid."""
    memory = fresh(form)
    commands = memory.plan.commands.copy()
    commands[:, 1] = task(form).model.command_max[1]
    return replace(memory, plan=Plan(3, 0.0, 200, commands))


def test_a_plan_that_does_not_fly_is_replaced_from_trim():
    """Where the shifted plan departs, trim is improved instead, and the plan flies."""
    _, best, _ = once(tumbling(), state_at("actuator"), "actuator", time=0.5)
    assert best.valid
    assert best.after <= best.before < np.inf


@pytest.mark.usefixtures("no_solver")
def test_trim_is_the_last_rung():
    """Where the shifted plan departs and trim cannot be improved, the plan is trim and says so."""
    memory, _, rung = once(tumbling(), state_at("actuator"), "actuator", time=0.5)
    assert rung == RUNG["trim"]
    np.testing.assert_array_equal(memory.plan.commands, np.tile(trim("actuator"), (200, 1)))


def test_a_failed_programme_keeps_the_old_tail(no_solver):
    """A QP without an answer changes nothing: no step, whatever the line search sees."""
    memory = first()
    _, best, rung = once(memory, state_at(), time=0.5)
    assert (rung, best.step, best.after) == (RUNG["old tail"], 0.0, best.before)
    assert best.solution.status is Status.FAILED


def test_a_flight_beyond_rescue_gets_trim_and_is_forgotten():
    """Inverted, nothing flies: the plan is trim, and the next good state is planned from as ever."""
    memory = first()
    lost, best, rung = once(memory, state_at(phi=2.8, p=5.0), time=0.5)
    assert (rung, best.valid, lost.expected) == (RUNG["trim"], False, None)
    assert np.isfinite(lost.plan.commands).all()
    np.testing.assert_array_equal(lost.plan.commands[:, :3], np.tile(trim()[:3], (200, 1)))
    found, best, rung = once(lost, state_at(), time=1.0)
    assert best.valid
    assert rung in (RUNG["full step"], RUNG["shorter step"])
    np.testing.assert_array_equal(found.bias, lost.bias)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("late", [0, 10])
@pytest.mark.parametrize("member", HelicopterModel.states)
def test_a_state_that_is_not_finite_leaves_the_old_plan(member, value, late):
    """There is nothing to plan from: no pass, the plan goes on, and the bias learns nothing."""
    memory = replace(first(), bias=np.array([0.1, 0.2, 0.3]))
    after, best, rung = once(memory, state_at(**{member: value}), late=late, time=0.5)
    assert (best, rung, after.expected) == (None, RUNG["old tail"], None)
    assert after.plan is memory.plan
    assert (after.station, after.reference) == (memory.station, memory.reference)
    np.testing.assert_array_equal(after.bias, memory.bias)


@pytest.mark.parametrize("late", [0, 10])
def test_a_state_that_overflows_is_no_better(late):
    """A prediction that overflows on the way leaves a plan that is finite."""
    memory = first()
    after, best, rung = once(memory, state_at(u=1e200), late=late, time=0.5)
    assert best is None or not best.valid
    assert rung in (RUNG["old tail"], RUNG["trim"])
    assert np.isfinite(after.plan.commands).all()


# -- bias ------------------------------------------------------------------------------------------


def test_the_bias_moves_by_half_of_what_was_missed():
    """A velocity that is 0.1 m/s north of the prediction after 0.5 s adds 0.1 m/s2 north."""
    memory = first()
    state = flown(memory, state_at())
    exact, _, _ = once(memory, state, time=0.5)
    np.testing.assert_array_equal(exact.bias, 0.0)
    memory = replace(memory, expected=memory.expected - [0.1, 0.0, -0.02])
    moved, _, _ = once(memory, state, time=0.5)
    np.testing.assert_allclose(moved.bias, [0.1, 0.0, -0.02], atol=1e-8)
    off = replace(P, bias_estimate=False)
    still, _, _ = once(memory, state, parameters=off, time=0.5)
    np.testing.assert_array_equal(still.bias, 0.0)


def test_the_bias_is_limited():
    """However wrong a prediction was, the bias stays within 4 m/s2."""
    memory = first()
    memory = replace(memory, expected=memory.expected + np.array([90.0, -90.0, 0.0]))
    after, _, _ = once(memory, flown(memory, state_at()), time=0.5)
    np.testing.assert_allclose(after.bias[:2], [-4.0, 4.0])


# -- latency ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [3, 10, 14, 25])
def test_committed_samples_are_those_that_will_be_played(late):
    """Until a plan takes effect its forerunners are played, however many those are."""
    played = np.full((400, 4), np.nan)  # by sample, whatever plan is newest then
    memory = first()
    played[:200] = memory.plan.commands
    for k in range(0, 60, APPLIED):
        state = state_at(down=-0.1 * k, psi=0.002 * k)
        memory, _, _ = once(memory, state, late=late, time=k * 0.05)
        np.testing.assert_array_equal(memory.committed, played[k : k + late])
        assert memory.plan.start == pytest.approx((k + late) * 0.05)
        played[k + late : k + late + 200] = memory.plan.commands


def test_uncompensated_nothing_is_predicted():
    """Without compensation a plan starts from the state measured, though it takes effect later."""
    naive = replace(P, compensate_latency=False)
    memory, best, _ = once(fresh(), state_at(), parameters=naive, late=10)
    assert memory.plan.start == 0.5
    assert memory.committed.shape == (10, 4)
    assert best.Y[0, 0] == pytest.approx(1.5, abs=0.01)


# -- horizon ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0, 10])
@pytest.mark.parametrize("reach", [20.0, 75.0, 145.0, 205.0, 300.0, 500.0])
def test_the_horizon_ends_where_the_terrain_sensed_does(reach, late):
    """It is the time to there, in whole half seconds, from 2 s to 10 s."""
    memory, _, _ = once(fresh(reach_m=reach), state_at(), late=late)
    last_cell = 10.0 * np.ceil(reach / 10.0 - 1.0)
    ahead = last_cell / 30.0 - 0.05 * late
    assert memory.plan.horizon == 10 * np.clip(np.floor(ahead / 0.5 + 1e-9), 4, 20)


def test_a_fixed_horizon_does_not_adapt():
    """Switched off, the horizon is the longest one whatever is sensed."""
    fixed = replace(P, adapt_horizon=False, horizon_s=7.0)
    memory, _, _ = once(fresh(reach_m=75.0), state_at(), parameters=fixed)
    assert memory.plan.horizon == 140
