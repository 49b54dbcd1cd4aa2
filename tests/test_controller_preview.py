"""LQ preview control: the law against its textbook, and the flights that it can and cannot make."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from hand_flight import HandFlight, hills
from linear_model import LinearModel, aim_at, plane_map, straight_path
from scipy.linalg import solve_discrete_are

from controller import preview
from controller.optimise import optimise
from controller.parameters import MpcParameters, design
from controller.preview import (
    Ahead,
    PreviewLq,
    feed_forward,
    linearise,
    predict,
    preview_planner,
    riccati,
    weighing,
)
from orchestrator.command.app import status
from plant.helicopter import HelicopterModel, ModelParameters

P = MpcParameters()
H = 40
RNG = np.random.default_rng(5)
STILL = np.zeros(3)


@cache
def helicopter(form="attitude"):
    """Return the model, its linearisation at 30 m/s and the weights of its outputs."""
    model = HelicopterModel(ModelParameters(command=form))
    aim = aim_at(straight_path(), plane_map(), model, H)
    return model, linearise(model, 30.0), weighing(aim.weights)


flight = partial(HandFlight, controller=PreviewLq)


# -- the law ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["attitude", "actuator"])
def test_the_linear_model_is_the_tangent_of_one_sample(form):
    """For a small deviation it predicts states and outputs to the second order."""
    model, linear, _ = helicopter(form)
    x, u = 1e-4 * RNG.standard_normal(17), 1e-4 * RNG.standard_normal(4)
    rollout = model.rollout(linear.state + x, (linear.command + u)[None, None], STILL, STILL)
    moved = linear.state + linear.moved + linear.A @ x + linear.B @ u
    np.testing.assert_allclose(rollout.last[0], moved, atol=1e-6)
    z = linear.E @ x + linear.F @ u
    rows = [0, 1, 2, 3, 4, 10, 11, 12, 13]
    np.testing.assert_allclose(rollout.outputs[0, 0, rows], linear.outputs + z[:9], atol=1e-6)
    np.testing.assert_allclose(z[9:], u, atol=1e-12)


@pytest.mark.parametrize("form", ["attitude", "actuator"])
def test_far_from_the_end_the_gain_is_that_of_the_algebraic_riccati_equation(form):
    """Over a long horizon the first gain solves the discrete algebraic Riccati equation."""
    _, linear, W = helicopter(form)
    A, B, E, F = linear.A, linear.B, linear.E, linear.F
    Q, R, cross = E.T @ (W[:, None] * E), F.T @ (W[:, None] * F), E.T @ (W[:, None] * F)
    X = solve_discrete_are(A, B, Q, R, s=cross)
    K = -np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A + cross.T)
    law = riccati(linear, W, 1500)
    np.testing.assert_allclose(law.K[0], K, atol=1e-5 * np.abs(K).max())
    assert np.abs(np.linalg.eigvals(A + B @ law.K[0])).max() < 0.99


def test_the_law_is_the_least_of_all_command_sequences():
    """Within wide limits its cost is that of the dense least-squares problem, for any preview."""
    _, linear, W = helicopter()
    A, B, E, F = linear.A, linear.B, linear.E, linear.F
    ahead = Ahead(
        start=0.1 * RNG.standard_normal(17),
        target=RNG.standard_normal((H, 13)),
        d=0.01 * RNG.standard_normal((H, 17)),
        trim=np.tile(linear.command, (H, 1)),
    )
    wide = np.full((H, 4), np.inf)
    law = riccati(linear, W, H)
    u, J = predict(linear, law, W, ahead, -wide, wide)

    def missed(v):
        x, z = ahead.start, []
        for k in range(H):
            z.append(E @ x + F @ v[k] - ahead.target[k])
            x = A @ x + B @ v[k] + ahead.d[k]
        return (np.sqrt(W) * z).ravel()

    offset = missed(np.zeros((H, 4)))
    columns = [missed(one.reshape(H, 4)) - offset for one in np.eye(4 * H)]
    v, *_ = np.linalg.lstsq(np.array(columns).T, -offset, rcond=None)
    least = float(np.sum(missed(v.reshape(H, 4)) ** 2))
    assert pytest.approx(least, rel=1e-7) == J
    assert float(np.sum(missed(u - ahead.trim) ** 2)) == pytest.approx(J, rel=1e-9)


def test_without_anything_ahead_nothing_is_fed_forward():
    """Zero targets and disturbances leave the feedback alone."""
    _, linear, W = helicopter()
    law = riccati(linear, W, H)
    assert not feed_forward(linear, law, W, np.zeros((H, 13)), np.zeros((H, 17))).any()


def test_on_a_linear_model_it_is_full_order_mpc(monkeypatch):
    """With equal weights it costs what the quadratic programme over all commands costs, and does it."""
    monkeypatch.setattr(preview, "CAUTION", 1.0)
    model = LinearModel()
    aim = aim_at(straight_path(), plane_map(-500.0), model, H)
    state, command, _ = model.trim(30.0)
    state += [0.0, 2.0, -103.0, 0.0, 0.3, -0.2, 0.02, 0.01, 0.05]
    u0 = np.tile(command, (H, 1))
    law = preview_planner(P, model, H)(state, u0, STILL, aim)
    full = optimise(design(replace(P, basis="full"), model, H), state, u0, STILL, aim)
    assert full.step == law.step == 1.0
    assert law.after == pytest.approx(full.after, rel=1e-6)
    assert law.linear == pytest.approx(law.after, rel=1e-6)
    assert law.before == pytest.approx(full.before, rel=1e-6)
    np.testing.assert_allclose(law.u, full.u, atol=2e-4)


# -- the plan --------------------------------------------------------------------------------------


def aimed(form, heading):
    """Return a model, its state in trim along a level path at a heading, trim commands, the aim."""
    model = helicopter(form)[0]
    aim = aim_at(straight_path(heading=heading), plane_map(), model, H)
    state = model.trim(30.0)[0]
    state[model.states.index("psi")] += heading
    state[model.states.index("down")] = -100.0
    if form == "attitude":
        aim.commands[3] += heading
    return model, state, aim


@pytest.mark.parametrize("form", ["attitude", "actuator"])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_on_the_path_in_trim_the_plan_is_trim(form, heading):
    """Where nothing is wrong and nothing comes nothing is done, along any course."""
    model, state, aim = aimed(form, heading)
    trim = np.ascontiguousarray(aim.commands.T)
    found = preview_planner(P, model, H)(state, trim, STILL, aim)
    assert found.valid
    np.testing.assert_allclose(found.u, trim, atol=1e-5)
    assert found.after < 1e-4


def test_a_turned_world_gives_a_turned_plan():
    """Errors seen from the course give the same plan along any course, the heading turned with it."""
    plans = []
    for heading in (0.0, -1.1):
        model, state, aim = aimed("attitude", heading)
        c, s = np.cos(heading), np.sin(heading)
        state[0] += c * 1.0 - s * 3.0
        state[1] += s * 1.0 + c * 3.0
        state[2] -= 2.0
        state[8] += 0.05
        trim = np.ascontiguousarray(aim.commands.T)
        found = preview_planner(P, model, H)(state, trim, STILL, aim)
        plans.append(found.u - heading * np.array([0.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(plans[0], plans[1], atol=1e-6)
    assert np.abs(plans[0] - helicopter()[0].trim(30.0)[1]).max() > 0.05


def test_a_known_bias_is_met_before_it_shows():
    """A constant downward acceleration is answered at once; the height stays until near the horizon."""
    model, state, aim = aimed("attitude", 0.0)
    trim, bias = np.ascontiguousarray(aim.commands.T), np.array([0.0, 0.0, 0.5])
    found = preview_planner(P, model, H)(state, trim, bias, aim)
    altitude = found.Y[model.outputs.index("altitude")]
    assert np.abs(altitude[:30] - 100.0).max() < 0.005
    more = found.u[5:25, 0] - trim[5:25, 0]
    assert more.mean() == pytest.approx(0.5 / 9.80665, rel=0.1)


def test_it_acts_before_a_climb_begins():
    """Thrust rises ahead of a slope that is still level under the aircraft, and not without one."""
    model, state, aim = aimed("attitude", 0.0)
    path = aim.path
    s = path.start + np.arange(path.north.size)
    climb = np.maximum(s - 30.0, 0.0)
    hill = path._replace(altitude=path.altitude + 0.2 * climb, slope=0.2 * (climb > 0.0))
    trim = np.ascontiguousarray(aim.commands.T)
    plan = preview_planner(P, model, H)
    level, ahead = (plan(state, trim, STILL, replace(aim, path=one)).u for one in (path, hill))
    assert ahead[10, 0] > level[10, 0] + 0.02
    assert 10 * 0.05 * 30.0 < 30.0  # sample 10 is flown before the slope


def test_commands_stay_within_limits():
    """Far off its path the law is clipped: to the model's limits and to the heading's reach."""
    model, state, aim = aimed("attitude", 0.0)
    state[:3] += [0.0, 300.0, 200.0]
    reach = np.array([np.inf, np.inf, np.inf, 0.3])
    trim = np.ascontiguousarray(aim.commands.T)
    u = preview_planner(P, model, H)(state, trim, STILL, replace(aim, reach=reach)).u
    assert np.all((u >= model.command_min) & (u <= model.command_max))
    assert np.abs(u[:, 3] - trim[:, 3]).max() <= 0.3 + 1e-12
    assert u[:, 0].max() == model.command_max[0]


def test_a_model_that_takes_no_measured_state_is_refused():
    """What cannot be linearised about a state is a ValueError at construction."""

    class Shadowed(LinearModel):
        def follow(self, before, commands, wind, bias):
            """Return nothing."""

    with pytest.raises(ValueError, match="preview: no linear model"):
        PreviewLq(P, prediction_model=Shadowed())


# -- the flight ------------------------------------------------------------------------------------


def test_flies_over_hills():
    """Over gentle hills it keeps the height to a decimetre."""
    one = flight(ground=hills)
    one.fly(4)
    errors = []
    for _ in range(16):
        one.fly(1)
        north, east, down = one.state()[:3]
        errors.append(-down - 10.0 - float(hills(np.array(north), np.array(east))))
    assert np.abs(errors).max() < 0.5
    assert np.sqrt(np.mean(np.square(errors))) < 0.3


def test_flies_a_corner():
    """A turn of 30 degrees is seen coming: it is flown without leaving the course by three metres."""
    corner = ((0.0, 0.0), (150.0, 0.0), (410.0, 150.0))
    one = flight({"waypoints_m": corner, "speed_mps": 15.0}, {"speed_mps": 15.0})
    course = one.mpc._task.course
    for _ in range(36):
        one.fly(1)
        north, east, _ = one.state()[:3]
        assert np.hypot(course.north - north, course.east - east).min() < 3.0
    assert np.degrees(one.state()[8]) == pytest.approx(30.0, abs=2.0)


def test_keeps_the_contract(scenarios, capsys):
    """`hedgehop check` passes with the scenario of the controller whose place it takes."""
    use = "controller.preview:PreviewLq"
    assert status(["check", use, "--scenario", str(scenarios / "jacksboro.yaml")]) == 0
    assert "mpc of" in capsys.readouterr().out
