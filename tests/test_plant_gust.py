"""Dryden turbulence: intensities, lengths and spectra of MIL-F-8785C, whatever the step."""

import math

import numpy as np
import pytest
from fmpy.validation import validate_model_description
from hypothesis import given
from hypothesis import strategies as st

from plant.gust import (
    SQRT3,
    DrydenGust,
    DrydenGustParameters,
    first_order,
    second_order,
    transverse,
    turbulence,
)

WIND = ("wind.north", "wind.east", "wind.down")


def blown(seed=0, ticks=0, step=0.05, inputs=None, **parameters):
    """Return the wind (ticks, 3) met by an aircraft flying north at 30 m/s, 10 m up."""
    gust = DrydenGust(DrydenGustParameters(**parameters))
    gust.set({"velocity.north": 30.0, "clearance": 10.0} | (inputs or {}))
    gust.initialize(start_time=0.0, seed=seed)
    wind = np.empty((ticks, 3))
    for k in range(ticks):
        gust.step(k * step, step)
        wind[k] = list(gust.get(WIND).values())
    return wind


def test_intensity_and_length():
    """At 100 ft: sigma_w = W20/10, sigma_u = sigma_w/0.2593^0.4, L_w = h, L_u = h/0.2593^1.2."""
    t = turbulence(30.48, 7.7)
    assert t.sigma_w == pytest.approx(0.77)
    assert t.sigma_u == pytest.approx(0.77 / 0.2593**0.4)
    assert t.L_w == pytest.approx(30.48)
    assert t.L_u == pytest.approx(30.48 / 0.2593**1.2)


def test_held_outside_its_range():
    """Below 10 ft and above 1000 ft the ends hold; at 1000 ft the model is isotropic."""
    assert turbulence(-5.0, 7.7) == turbulence(3.048, 7.7)
    assert turbulence(1e4, 7.7) == turbulence(304.8, 7.7)
    top = turbulence(304.8, 7.7)
    assert (top.sigma_u, top.L_u) == pytest.approx((top.sigma_w, top.L_w))


def covariance(step, d, n):
    """Return the covariance a filter adds in one step, from the unit noises it maps to."""
    columns = np.array([np.atleast_1d(step(unit)) for unit in np.eye(n)]).T
    return columns @ columns.T


@given(st.floats(1e-4, 50.0))
def test_variance_does_not_depend_on_the_step(d):
    """F P F' + Q = P: every step keeps the stationary covariance, and the output variance 1."""
    a = first_order(1.0, d, 0.0)
    assert a**2 + first_order(0.0, d, 1.0) ** 2 == pytest.approx(1.0, rel=1e-12)
    F = np.array([second_order((1.0, 0.0), d, (0.0, 0.0)), second_order((0.0, 1.0), d, (0.0, 0.0))])
    P = np.array([[0.5, 0.25], [0.25, 0.25]])
    Q = covariance(lambda unit: second_order((0.0, 0.0), d, tuple(unit)), d, 2)
    np.testing.assert_allclose(F.T @ P @ F + Q, P, atol=1e-12)
    c = np.array([SQRT3, 1.0 - SQRT3])
    assert c @ P @ c == pytest.approx(1.0)
    assert transverse((1.0, 1.0)) == pytest.approx(1.0)


@given(st.floats(1e-3, 5.0), st.floats(1e-3, 5.0))
def test_two_steps_are_one(d, e):
    """The free motion of two steps is that of one step of their sum."""
    zero = (0.0, 0.0)
    twice = second_order(second_order((0.3, -0.7), d, zero), e, zero)
    assert twice == pytest.approx(second_order((0.3, -0.7), d + e, zero), abs=1e-12)


@pytest.mark.parametrize("step", [0.05, 0.2])
def test_variance_of_a_flight(step):
    """Along a flight the gusts have the intensities of the specification, at any step."""
    wind = blown(seed=1, ticks=40000, step=step)
    t = turbulence(10.0, 7.7)
    expected = (t.sigma_u, t.sigma_u, t.sigma_w)
    np.testing.assert_allclose(np.std(wind, axis=0), expected, rtol=0.06)
    np.testing.assert_allclose(np.mean(wind, axis=0), 0.0, atol=0.25)


def test_length_of_a_flight():
    """Correlation falls as exp(-x/L) along and as (1 - x/2L) exp(-x/L) across the flight."""
    wind = blown(seed=2, ticks=60000)
    t = turbulence(10.0, 7.7)
    for lag in (2, 5, 10):
        got = [np.mean(w[lag:] * w[:-lag]) / np.mean(w**2) for w in wind.T]
        x_u, x_w = (30.0 * 0.05 * lag / length for length in (t.L_u, t.L_w))
        along = math.exp(-x_u)
        across = [(1.0 - x / 2.0) * math.exp(-x) for x in (x_u, x_w)]
        np.testing.assert_allclose(got, [along, *across], atol=0.04)


def test_starts_stationary():
    """The first gusts, over seeds, have the intensities of all later ones."""
    start = np.array([blown(seed=seed, ticks=1)[0] for seed in range(1500)])
    t = turbulence(10.0, 7.7)
    expected = (t.sigma_u, t.sigma_u, t.sigma_w)
    np.testing.assert_allclose(np.std(start, axis=0), expected, rtol=0.07)


def test_mean_wind():
    """Without turbulence the wind is its mean; with it, the mean is added."""
    mean = {"mean_north_mps": -3.0, "mean_east_mps": 5.0}
    calm = blown(ticks=3, wind_20ft_mps=0.0, **mean)
    np.testing.assert_array_equal(calm, [[-3.0, 5.0, 0.0]] * 3)


def test_axes_follow_the_airspeed():
    """Longitudinal gusts blow along the airspeed; where there is none, along the heading."""
    north = blown(seed=3, ticks=50)
    east = blown(seed=3, ticks=50, inputs={"velocity.north": 0.0, "velocity.east": 30.0})
    np.testing.assert_allclose(east[:, 1], north[:, 0], atol=1e-12)
    np.testing.assert_allclose(east[:, 0], -north[:, 1], atol=1e-12)
    still = {"velocity.north": 0.0}
    ahead = blown(seed=3, ticks=50, inputs=still)
    turned = blown(seed=3, ticks=50, inputs=still | {"pose.psi": math.pi / 2})
    np.testing.assert_allclose(turned[:, 1], ahead[:, 0], atol=1e-12)
    assert np.ptp(ahead[:, 0]) > 0.0


def test_seed_decides():
    """Equal seeds give equal wind; another seed gives another."""
    np.testing.assert_array_equal(blown(seed=9, ticks=20), blown(seed=9, ticks=20))
    assert np.all(blown(seed=9, ticks=20) != blown(seed=10, ticks=20))


def test_first_step_repeats_the_start():
    """The gust at the start time is the one that initialize drew."""
    gust = DrydenGust(DrydenGustParameters())
    gust.set({"velocity.north": 30.0, "clearance": 10.0})
    gust.initialize(start_time=4.0, seed=1)
    before = gust.get(WIND)
    gust.step(4.0, 0.05)
    assert gust.get(WIND) == before


def test_state_round_trip_is_exact():
    """A gust restored in the middle blows on bit for bit."""

    def run(gust, first, last):
        for k in range(first, last):
            gust.step(k * 0.05, 0.05)
        return gust.get(WIND)

    gust = DrydenGust(DrydenGustParameters())
    gust.set({"velocity.north": 20.0, "clearance": 30.0, "pose.psi": 0.3})
    gust.initialize(start_time=0.0, seed=11)
    run(gust, 0, 40)
    saved = gust.get_state()
    copy = DrydenGust(DrydenGustParameters())
    copy.set_state(saved)
    assert copy.get_state() == saved
    assert run(copy, 40, 80) == run(gust, 40, 80)


def test_description():
    """The description is valid FMI 3 and names what the wind depends on at once."""
    gust = DrydenGust(DrydenGustParameters())
    md = gust.describe()
    assert not validate_model_description(md)
    feeds = {u.variable.name: {d.name for d in u.dependencies} for u in md.outputs}
    speed = {f"velocity.{n}" for n in ("north", "east", "down")}
    assert feeds == dict.fromkeys(WIND, speed | {"pose.psi", "clearance"})
    with pytest.raises(KeyError, match=r"did you mean 'clearance'"):
        gust.set({"clearence": 1.0})
    with pytest.raises(KeyError, match="unknown variable 'gust'"):
        gust.get(["gust"])
    gust.terminate()
    gust.terminate()
