"""Targets along a reference, and the true cost of predicted flights."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_model import LinearModel, T, aim_at, plane_map, straight_path

from controller.bases import span_basis
from controller.course import make_course, position
from controller.optimise import ACTUATORS, ATTITUDE_EVERY, TRACKED, quadratic_programme
from controller.prediction import identify, stack_bases
from controller.qp import predicted_cost
from controller.reference import Path
from controller.terrain_map import empty_map
from controller.tracking import advance, costs, targets

H = 60
ANGLES = st.floats(-3.1, 3.1)
LINEAR = LinearModel()
ROWS = np.array([LINEAR.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])
CALM = np.zeros(3)
PHI = stack_bases([span_basis("tent", H, 4, sample_period=T)[0]] * 4)
NOTHING_SENSED = empty_map(10.0)


def wander(seed=0, offset=3.0):
    """Return positions north, east (H,) of a flight at about 30 m/s that wanders off its line."""
    rng = np.random.default_rng(seed)
    north = 2.0 + np.cumsum(1.5 + 0.2 * rng.normal(size=H))
    return north, offset + np.cumsum(0.3 * rng.normal(size=H))


def level(path, number=1):
    """Return outputs (p, H, number) of a flight north that follows a straight path exactly."""
    Y = np.zeros((len(LINEAR.outputs), H, number))
    s = 30.0 * T * np.arange(1, H + 1)[:, None]
    Y[0], Y[2] = s, path.altitude[100] + path.slope[0] * s  # sample 100 is the origin
    Y[4], Y[7] = path.speed[0], 1.0
    return Y


def cost_of(Y, path, heading=0.0, terrain_map=NOTHING_SENSED, **weights):
    """Return (J, slack, merit) of trim commands that flew Y, with targets from its first flight."""
    aim = aim_at(path, terrain_map, LINEAR, H, **weights)
    target = targets(path, *np.ascontiguousarray(Y[:2, :, 0]), 0.0, T, heading)
    commands = np.tile(aim.commands.T, (Y.shape[2], 1, 1))
    return costs(Y, ROWS, commands, target, aim.actuators, aim.commands, path, aim.weights,
                 terrain_map, ATTITUDE_EVERY)  # fmt: skip


# -- targets ---------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25)
@given(chi=ANGLES, slope=st.floats(-0.5, 0.5), speed=st.floats(5.0, 40.0))
def test_targets_on_a_straight_reference_are_exact(chi, slope, speed):
    """Stations are feet of perpendiculars; the goal starts abeam and moves at the set speed."""
    path = straight_path(chi, altitude=80.0, slope=slope, speed=speed)
    north, east = wander()
    target = targets(path, north, east, 0.0, T, chi)
    along = np.array([np.cos(chi), np.sin(chi)])
    station = along @ [north, east]
    ahead = station[0] + speed * T / np.sqrt(1 + slope**2) * np.arange(H)
    exact = {"rtol": 1e-12, "atol": 1e-9}
    np.testing.assert_allclose(target.station, station, **exact)
    np.testing.assert_allclose([target.north, target.east], along[:, None] * ahead, **exact)
    np.testing.assert_allclose(target.altitude, 80.0 + slope * station, **exact)
    np.testing.assert_allclose(target.slope, slope, **exact)
    np.testing.assert_allclose(target.speed, speed, **exact)
    np.testing.assert_allclose(target.heading, chi, **exact)
    tangent = [target.tangent_north, target.tangent_east]
    np.testing.assert_allclose(tangent, along[:, None] * np.ones(H), **exact)


def test_stations_are_those_of_the_nearest_points():
    """On a bend the station of every sample is that of the path's point nearest to it."""
    course = make_course([(0.0, 0.0), (300.0, 0.0), (500.0, 400.0)], 30.0)
    flat = np.full(course.north.size, 50.0)
    path = Path(course.first, 1.0, course.north, course.east, flat, course.heading, flat, 0 * flat)
    s = 150.0 + 3.0 * np.arange(H)
    north, east = np.transpose([position(course, k, 4.0 * np.sin(k / 30.0)) for k in s])
    target = targets(path, north, east, s[0], T, 0.0)
    away = np.hypot(path.north - north[:, None], path.east - east[:, None])
    np.testing.assert_allclose(target.station, path.start + away.argmin(axis=1), atol=0.51)


@given(turns=st.integers(-3, 3), off=st.floats(-2.0, 2.0), chi=ANGLES)
def test_the_heading_target_is_on_the_branch_of_the_measured_heading(turns, off, chi):
    """Within half a turn of the heading measured, and an angle of the reference."""
    measured = chi + 2 * np.pi * turns + off
    target = targets(straight_path(chi), *wander(), 0.0, T, measured)
    assert abs(target.heading[0] - measured) <= np.pi + 1e-9
    np.testing.assert_allclose(target.heading, chi + 2 * np.pi * turns, atol=1e-9)


def test_advance_is_the_way_flown_at_the_reference_speed():
    """A station moves by the horizontal part of speed times period, also where speed changes."""
    path = straight_path(slope=0.75, speed=20.0)
    np.testing.assert_allclose(advance(path, 3.0, T, 4), 3.0 + 0.8 * np.arange(1, 5), rtol=1e-12)
    slowing = path._replace(speed=np.where(np.arange(path.speed.size) < 103, 20.0, 10.0))
    steps = np.diff(advance(slowing, 2.0, T, 8))
    np.testing.assert_allclose(steps, np.where(np.arange(1, 8) < 2, 0.8, 0.4), rtol=1e-12)


# -- costs -----------------------------------------------------------------------------------------


def test_following_the_reference_in_trim_costs_nothing():
    """On the path, at its speed, in trim: J, slack and merit are zero."""
    path = straight_path()
    np.testing.assert_allclose(cost_of(level(path), path), 0.0, atol=1e-18)


@pytest.mark.parametrize(
    ("row", "weight"),
    [("north", 1.0), ("east", 2.0), ("altitude", 3.0), ("heading", 4.0), ("speed", 5.0),
     *zip(ACTUATORS, (6.0, 7.0, 8.0, 9.0), strict=True)],
)  # fmt: skip
def test_an_error_costs_its_weight_times_its_square(row, weight):
    """Off by 0.1 at every sample costs H w 0.01, whatever the output."""
    path = straight_path()
    Y = level(path, 2)
    Y[LINEAR.outputs.index(row), :, 1] += 0.1
    J, _, merit = cost_of(Y, path, Q=(1.0, 2.0, 3.0, 4.0, 5.0), R=(6.0, 7.0, 8.0, 9.0))
    assert J[1] == merit[1] == pytest.approx(H * weight * 0.01, rel=1e-9)


def test_a_planned_spin_costs():
    """A turn through 360 degrees is not wrapped away: it costs its square all along."""
    path = straight_path()
    Y = level(path, 2)
    spin = np.linspace(0.0, 2 * np.pi, H)
    Y[3, :, 1] = spin
    J, _, _ = cost_of(Y, path)
    assert J[1] == pytest.approx(10.0 * np.sum(spin**2), rel=1e-9)


def test_a_spin_that_has_happened_is_forgiven():
    """A turn more in the heading measured, and in the prediction from there, costs nothing."""
    path = straight_path()
    Y = level(path)
    Y[3] += 2 * np.pi
    J, _, _ = cost_of(Y, path, heading=2 * np.pi + 0.1)
    assert J[0] == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("slope", [0.0, 0.4, -0.3])
def test_the_altitude_error_follows_the_position(slope):
    """A metre further north on a slope is z' metres too low: dJ/dN = 2 Q_n e_n - 2 Q_z e_z z'."""
    path = straight_path(slope=slope, speed=30.0 * np.sqrt(1 + slope**2))
    Y = level(path, 3)
    k, step = 20, 0.05
    Y[0, k] += 0.2  # too far, and 0.3 m too high or low for that
    Y[2, k] += 0.2 * slope + 0.3
    Y[0, k, 1] += step
    Y[0, k, 2] -= step
    nominal = np.ascontiguousarray(Y[:, :, :1])
    aim = aim_at(path, NOTHING_SENSED, LINEAR, H)
    target = targets(path, nominal[0, :, 0], nominal[1, :, 0], 0.0, T, 0.0)
    J, _, _ = cost_of(Y, path)
    e_n, e_z = nominal[0, k, 0] - target.north[k], nominal[2, k, 0] - target.altitude[k]
    assert e_z == pytest.approx(0.3)
    expected = 2 * aim.weights.Q[0] * e_n - 2 * aim.weights.Q[2] * e_z * slope
    assert (J[1] - J[2]) / (2 * step) == pytest.approx(expected, rel=1e-8)


def test_missing_clearance_is_one_slack_with_an_exact_penalty():
    """The least clearance below the limit is the slack; merit adds 2 rho1 slack + rho2 slack^2."""
    path = straight_path(altitude=100.0)
    Y = level(path, 2)
    Y[2, 39, 1] = 93.0  # a sample that is looked at; 3 m above the ground
    J, sigma, merit = cost_of(
        Y, path, terrain_map=plane_map(90.0), clearance=5.0, rho1=7.0, rho2=3.0
    )
    np.testing.assert_allclose(sigma, [0.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(merit - J, [0.0, 2 * 7.0 * 2.0 + 3.0 * 4.0], atol=1e-8)


def test_ground_that_was_not_sensed_asks_for_no_clearance():
    """Below ground that nobody saw there is no slack: the reference ends there anyway."""
    path = straight_path(altitude=-50.0)
    _, sigma, _ = cost_of(level(path), path, terrain_map=empty_map(10.0))
    assert sigma[0] == 0.0


def test_attitude_beyond_the_limit_costs_ten_thousand_per_radian():
    """The merit, not J, has the largest excess of roll or pitch."""
    path = straight_path()
    Y = level(path, 2)
    Y[5, 3, 1], Y[6, 9, 1] = -0.9, 0.8
    J, _, merit = cost_of(Y, path, attitude_limit=0.7, heading_limit=9.0)
    np.testing.assert_allclose(merit - J, [0.0, 1e4 * 0.2], rtol=1e-9)


# -- against the quadratic programme ---------------------------------------------------------------


def programme(path, terrain_map, state, u0, Phi=PHI, **weights):
    """Return the QP about a nominal of the linear model, with its response, target and aim."""
    response = identify(LINEAR, state, u0, Phi, np.ones(4), CALM, CALM, ROWS)
    aim = aim_at(path, terrain_map, LINEAR, H, **weights)
    target = targets(path, *response.nominal[:2], aim.near, T, aim.heading)
    data = quadratic_programme(response, ROWS, u0, aim, target, LINEAR)
    return data, response, target, aim


def merit_of(u, state, target, aim):
    """Return (J, slack, merit) of a true rollout of the linear model."""
    Y = np.ascontiguousarray(LINEAR.rollout(state, u[None], CALM, CALM).outputs.transpose(2, 1, 0))
    return costs(Y, ROWS, u[None], target, aim.actuators, aim.commands, aim.path, aim.weights,
                 aim.terrain_map, ATTITUDE_EVERY)[:, 0]  # fmt: skip


def start(rng):
    """Return a state off the reference, and commands off trim."""
    state, command, _ = LINEAR.trim(30.0)
    state[:3] = rng.normal(size=3) - [0.0, 0.0, 100.0]
    state[3:6] += 0.5 * rng.normal(size=3)
    return state, command + 0.03 * rng.normal(size=(H, 4))


def test_the_cost_of_the_nominal_is_the_constant_of_the_programme():
    """J0 of the QP and the true cost at alpha = 0 are one number, on a curved reference too."""
    s = np.arange(-100.0, 400.0)
    path = Path(-100.0, 1.0, s, 5 * np.sin(s / 40), 100 + 4 * np.cos(s / 30),
                np.cos(s / 40) / 8, 30 + s / 100, -4 / 30 * np.sin(s / 30))  # fmt: skip
    state, u0 = start(np.random.default_rng(3))
    data, _, target, aim = programme(path, NOTHING_SENSED, state, u0)
    J, _, merit = merit_of(u0, state, target, aim)
    assert J == merit == pytest.approx(data.constant, rel=1e-12)


@settings(deadline=None, max_examples=25)
@given(
    rng=st.integers(0, 2**32 - 1).map(np.random.default_rng),
    chi=st.floats(-1.0, 1.0),
    slope=st.floats(-0.4, 0.4),
    size=st.floats(0.0, 0.1),
)
def test_the_predicted_cost_of_a_linear_model_is_its_true_cost(rng, chi, slope, size):
    """Over a plane, along a straight slope, J_lin(alpha) and the merit agree for any alpha.

    Slack included: the plane lies so that clearance is missing for some coefficients.
    """
    path = straight_path(chi, slope=slope)
    ground = plane_map(94.0, slope * np.cos(chi), slope * np.sin(chi))
    state, u0 = start(rng)
    data, response, target, aim = programme(
        path, ground, state, u0, attitude_limit=9.0, heading_limit=9.0
    )
    alpha = size * rng.normal(size=len(data.f))
    u = u0 + (response.Phi @ alpha).T
    assert predicted_cost(data, alpha) == pytest.approx(
        merit_of(u, state, target, aim)[2], rel=1e-7
    )
