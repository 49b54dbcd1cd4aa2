"""The reactive height follower: its integral, what it does not know, its state."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hand_flight import HandFlight, flat, hills
from linear_model import aim_at, plane_map, straight_path

from controller import follower
from controller.follower import HeightFollower, follower_planner, set_points
from controller.mpc import Mpc
from controller.parameters import MpcParameters
from controller.terrain_map import empty_map
from orchestrator.command.app import status
from plant.helicopter import HelicopterModel, ModelParameters

P = MpcParameters()
H = 20
STILL = np.zeros(3)


flight = partial(HandFlight, controller=HeightFollower)


def below(height=10.0, **changes):
    """Return a model, its state in trim at a height over a plane at 0 m, and the aim."""
    model = HelicopterModel(ModelParameters())
    state = model.trim(30.0)[0]
    state[2] = -height
    aim = aim_at(straight_path(altitude=10.0), plane_map(), model, H)
    return model, state, replace(aim, **changes)


def test_at_the_set_height_the_set_points_are_trim():
    """Where nothing is wrong nothing is done."""
    model, state, aim = below()
    wanted, integral = set_points(state, model.states, aim)
    np.testing.assert_allclose(wanted, model.trim(30.0)[1], atol=1e-9)
    assert integral == pytest.approx(0.0, abs=1e-12)


def test_every_loop_pulls_the_right_way():
    """Too low: more thrust. Too fast: nose up. To the right of the course: bank left."""
    model, state, aim = below(8.0)
    state[1], state[3] = 2.0, state[3] + 2.0
    thrust, pitch, bank, heading = (
        set_points(state, model.states, aim)[0] - model.trim(30.0)[1]
    ).tolist()
    assert thrust > 0.3
    assert pitch > 0.02
    assert bank < -0.03
    assert heading == 0.0


def test_the_integral_grows_with_what_is_missing_and_with_time():
    """It adds height missing times time elapsed to what it was, and stops at its limit."""
    model, state, aim = below(9.0, elapsed=0.5, carry=np.array([0.1]))
    plan = follower_planner(P, model, H)
    first = plan(state, np.ascontiguousarray(aim.commands.T), STILL, aim)
    assert first.carry == pytest.approx([0.1 + follower.PER_MS * 1.0 * 0.5])
    # a second pass of the same update does not integrate again
    again = plan(state, first.u, STILL, aim)
    np.testing.assert_array_equal(again.carry, first.carry)
    late = plan(state, first.u, STILL, replace(aim, elapsed=1e3))
    assert late.carry == [follower.INTEGRAL_MAX_G]


def test_where_the_ground_below_was_not_sensed_the_height_counts_as_right():
    """Without a measurement it holds level flight, and the integral as it was."""
    model, state, aim = below(3.0, terrain_map=empty_map(10.0), carry=np.array([0.05]), elapsed=0.5)
    wanted, integral = set_points(state, model.states, aim)
    assert integral == 0.05
    assert wanted[0] == pytest.approx(model.trim(30.0)[1][0] + 0.05)


def test_its_plan_holds_the_set_points():
    """Over the whole horizon the plan is one command, within the model's limits."""
    model, state, aim = below(300.0)
    found = follower_planner(P, model, H)(state, np.ascontiguousarray(aim.commands.T), STILL, aim)
    assert np.ptp(found.u, axis=0).tolist() == [0.0] * 4
    assert found.u[0, 0] == model.command_min[0]


def test_what_a_planner_leaves_is_given_back_with_the_time_since():
    """Between two updates the memory keeps it, for any planner and rate; at first there is none."""
    seen = []

    def planner(p, model, horizon):
        improve = follower_planner(p, model, horizon)

        def plan(state, u0, bias, aim):
            seen.append((aim.elapsed, aim.carry))
            return replace(improve(state, u0, bias, aim), carry=np.array([float(len(seen))]))

        return plan

    one = HandFlight()
    mpc = Mpc(replace(P, passes_at_start=1), prediction_model=one.model, planner=planner)
    one.mpc = mpc
    one.measure()
    mpc.initialize(start_time=0.0)
    for time in (0.0, 0.5, 0.55, 2.0):
        mpc.step(time, 0.05)
    elapsed, carried = zip(*seen, strict=True)
    assert elapsed == pytest.approx((0.0, 0.0, 0.5, 0.05, 1.45))
    assert [None if one is None else one.tolist() for one in carried] == [
        None, [1.0], [2.0], [3.0], [4.0],
    ]  # fmt: skip


def test_the_integral_removes_the_offset_of_a_heavier_helicopter(monkeypatch):
    """Over flat ground with 10 % more mass the height error goes to zero; without the integral not."""
    heavy = {"mass_kg": 74.8}
    one = flight({"bias_estimate": False}, heavy)
    one.fly(80)
    assert one.state()[2] == pytest.approx(-10.0, abs=0.02)
    monkeypatch.setattr(follower, "PER_MS", 0.0)
    other = flight({"bias_estimate": False}, heavy)
    other.fly(80)
    assert -other.state()[2] < 9.8


def test_it_knows_nothing_of_the_terrain_ahead():
    """Two worlds alike but for a cliff ahead get the same thrust until it is below."""

    def cliffs(north, east):
        return flat(north, east) + np.where(north >= 300.0, 15.0, 0.0)

    alike, cliffy = flight(ground=flat), flight(ground=cliffs)
    while alike.state()[0] < 260.0:
        left, right = alike.fly(1)[0], cliffy.fly(1)[0]
        np.testing.assert_array_equal(left["plan.thrust"][:1], right["plan.thrust"][:1])
    assert np.abs(left["reference.altitude"] - right["reference.altitude"]).max() > 5.0


def test_holds_a_course_with_a_heading():
    """Along 14 degrees, begun eight metres beside the course, it comes nearer, at the set height."""
    c, s = np.cos(np.radians(14.0)), np.sin(np.radians(14.0))
    one = flight(
        {"waypoints_m": ((0.0, 0.0), (1000.0 * c, 1000.0 * s))},
        {"heading_deg": 14.0, "north_m": -8.0 * s, "east_m": 8.0 * c},
    )
    one.fly(18)
    north, east, down = one.state()[:3]
    assert abs(c * east - s * north) < 4.0
    assert c * north + s * east == pytest.approx(9.0 * 30.0, abs=10.0)
    assert down == pytest.approx(-10.0, abs=0.5)


def test_a_set_height_changed_in_flight_is_flown():
    """The tunable set height acts: five metres more are held at the end."""
    one = flight()
    one.fly(4)
    one.mpc.set({"height_agl_m": 15.0})
    one.fly(40)
    assert one.state()[2] == pytest.approx(-15.0, abs=0.3)


def test_a_flight_goes_on_from_a_saved_state_bit_for_bit():
    """Saved in mid-flight, integral included, and restored into new components, all is the same."""
    heavy = {"mass_kg": 74.8}
    one, other = flight(vehicle=heavy, ground=hills), flight(vehicle=heavy, ground=hills)
    one.fly(6)
    for name in ("vehicle", "mpc", "sequencer"):
        getattr(other, name).set_state(getattr(one, name).get_state())
    other.tick = one.tick
    for left, right in zip(one.fly(4), other.fly(4), strict=True):
        for name, value in left.items():
            np.testing.assert_array_equal(value, right[name], err_msg=name)


def test_the_actuator_form_is_refused():
    """Without an attitude stabiliser it cannot fly, and says so at construction."""
    model = HelicopterModel(ModelParameters(command="actuator"))
    with pytest.raises(ValueError, match=r"got commands thrust, pitch, roll, tail"):
        HeightFollower(P, prediction_model=model)


def test_keeps_the_contract(scenarios, capsys):
    """`hedgehop check` passes with the scenario of the controller whose place it takes."""
    use = "controller.follower:HeightFollower"
    assert status(["check", use, "--scenario", str(scenarios / "jacksboro.yaml")]) == 0
    assert "mpc of" in capsys.readouterr().out
