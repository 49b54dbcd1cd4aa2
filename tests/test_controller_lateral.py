"""Uniform cubic B-splines over the station, and the lateral offset of least gradient."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.course import make_course, turn_radius
from controller.lateral import LANE_M, OUTSIDE, UNSENSED, half_width, least_gradient, plan_offsets
from controller.spline import (
    KNOT_M,
    curvature_weights,
    evaluate,
    hold,
    normal_equations,
    slope_weights,
    weights,
)
from controller.terrain_map import empty_map, heights, update

STRAIGHT = make_course([(0, 0), (2000, 0)], 30.0)
TURN_MAX = 1 / turn_radius(30.0, 30.0)


def sensed(terrain, north=(-100, 900), east=(-150, 150)):
    """Return a map of terrain(north, east), cells 10 m apart."""
    n, e = np.meshgrid(np.arange(*north, 10.0), np.arange(*east, 10.0), indexing="ij")
    h = np.broadcast_to(terrain(n, e), n.shape).astype(float)
    return update(
        empty_map(10.0), n.ravel(), e.ravel(), h.ravel().copy(), np.ones(n.size, np.int64)
    )


def valley(n, e):
    """Return flat ground 40 m to the right of a course north over hills."""
    return 15 * (1 - np.cos(n / 30)) * np.minimum(1, ((e - 40) / 40) ** 2)


@given(st.floats(0, 1))
@settings(deadline=None)
def test_weights_are_those_of_a_partition_of_unity(t):
    """Weights are positive and sum to 1; those of the derivatives sum to 0 and differentiate."""
    assert min(weights(t)) >= 0
    assert sum(weights(t)) == pytest.approx(1)
    assert sum(slope_weights(t)) == pytest.approx(0, abs=1e-12)
    assert sum(curvature_weights(t)) == pytest.approx(0, abs=1e-12)
    line, parabola = KNOT_M * np.arange(-1.0, 3.0), (KNOT_M * np.arange(-1.0, 3.0)) ** 2
    assert evaluate(line, 0, weights(t)) == pytest.approx(KNOT_M * t)
    assert evaluate(line, 0, slope_weights(t)) == pytest.approx(1)
    assert evaluate(parabola, 0, slope_weights(t)) == pytest.approx(2 * KNOT_M * t, abs=1e-9)
    assert evaluate(parabola, 0, curvature_weights(t)) == pytest.approx(2)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_splines_are_twice_continuously_differentiable(seed):
    """At a knot, value, slope and curvature agree from both sides, whatever the coefficients."""
    c = np.random.default_rng(seed).normal(0, 10, 5)
    for kind in (weights, slope_weights, curvature_weights):
        assert evaluate(c, 0, kind(1.0)) == pytest.approx(evaluate(c, 1, kind(0.0)), abs=1e-12)


def test_a_fit_without_smoothing_recovers_the_spline():
    """With lambda = 0 the samples of a spline give back its coefficients, some of them kept."""
    c = np.random.default_rng(3).normal(0, 10, 9)
    values = np.array([evaluate(c, i, weights(t)) for i in range(6) for t in (0, 0.25, 0.5, 0.75)])
    values = np.append(values, evaluate(c, 5, weights(1.0)))
    for kept in (0, 3):
        H, f = normal_equations(c[:kept], values, 4, 0.0)
        np.testing.assert_allclose(np.linalg.solve(H, -f), c[kept:], atol=1e-9)


def test_a_fit_with_much_smoothing_is_a_straight_line():
    """With lambda -> infinity the fit has no curvature, and samples that are missing do not matter."""
    values = 3 + 0.5 * np.arange(41.0)
    values[7:12] = np.nan
    H, f = normal_equations(np.empty(0), values, 4, 1e9)
    c = np.linalg.solve(H, -f)
    np.testing.assert_allclose(np.diff(c), 0.5 * 4, atol=1e-5)


def test_hold_eases_the_slope_into_its_range():
    """A falling spline is eased to level at the given curvature; one within the range goes on."""
    falling = hold(np.array([10.0, 0.0, -10.0]), 20, 0.0, np.inf, 0.005)
    np.testing.assert_allclose(np.diff(falling)[:8], [-10, -10, -8, -6, -4, -2, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(np.diff(hold(np.arange(3.0), 9, 0.0, np.inf, 0.005)), np.ones(8))
    assert hold(np.arange(5.0), 4, 0.0, 0.0, 1.0).size == 5


def test_the_corridor_closes_where_the_course_turns():
    """Its half width is 0 in arcs, before the start and beyond the goal, and narrows gently."""
    course = make_course([(0, 0), (1500, 0), (3000, 1500)], 30.0)
    width = half_width(course, 100.0)
    station = course.first + np.arange(width.size)
    assert not width[(course.curvature != 0) | (station <= 0) | (station >= course.goal)].any()
    assert width.max() == 100.0
    assert np.abs(np.diff(width)).max() <= 0.25 + 1e-9
    assert not half_width(course, 0.0).any()


def path_costs(terrain_map, width, station, offsets, w_t, w_l, w_h):
    """Return the costs of paths of offsets (N, K), as the module's docstring has them."""
    stations = station + KNOT_M * np.arange(offsets.shape[1])
    h = heights(terrain_map, stations, offsets)[0]
    dl = np.diff(offsets)
    dd = np.hypot(KNOT_M, dl)
    W = width[(stations - STRAIGHT.first).astype(int)]
    outside = np.maximum(np.abs(offsets) - W, 0) / LANE_M
    datum = np.nan_to_num(h[:, :1])
    here = w_l * (offsets / width.max()) ** 2 + OUTSIDE * outside**2
    here += np.where(np.isnan(h), UNSENSED, w_h * (h - datum))
    gradient = np.nan_to_num(np.diff(h) / dd)
    return (dd * (gradient**2 + w_t * (dl / KNOT_M) ** 2 + here[:, 1:])).sum(axis=1)


@given(
    st.integers(0, 2**32 - 1), st.floats(-6, 6), st.floats(-0.3, 0.3), st.sampled_from([0, 0.01])
)
@settings(deadline=None, max_examples=10)
def test_the_path_of_least_gradient_is_optimal(seed, offset, slope, w_h):
    """No path over a small grid costs less, found by trying them all."""
    rng = np.random.default_rng(seed)
    cells = rng.normal(0, 4, (16, 8))
    cells[rng.random(cells.shape) < 0.05] = np.nan
    terrain_map = sensed(lambda n, e: cells, (360, 520), (-40, 40))
    width = half_width(STRAIGHT, 10.0)
    found = least_gradient(
        terrain_map, STRAIGHT, width, 400.0, offset, slope, 0.02, 1e-3, w_h, stations=4
    )
    outermost = LANE_M * (max(10, abs(offset + slope * KNOT_M)) // LANE_M + 1)
    lanes = np.arange(-outermost, outermost + 1, LANE_M)
    paths = lanes[np.indices([lanes.size] * 4).reshape(4, -1).T]
    paths = np.concatenate((np.full((len(paths), 1), offset), paths), axis=1)
    reachable = np.abs(np.diff(paths[:, 1:])).max(axis=1) <= 2 * LANE_M
    paths = paths[reachable & (np.abs(paths[:, 1] - offset - slope * KNOT_M) <= LANE_M)]
    costs = path_costs(terrain_map, width, 400.0, paths, 0.02, 1e-3, w_h)
    rank = np.flatnonzero((paths == found).all(axis=1))
    assert costs[rank] == pytest.approx(costs.min(), rel=1e-9, abs=1e-12)


def test_over_flat_ground_the_path_is_straight():
    """Nothing is gained beside the course, and an offset is given back."""
    width = half_width(STRAIGHT, 100.0)
    flat = sensed(lambda n, e: 0 * n)
    np.testing.assert_array_equal(least_gradient(flat, STRAIGHT, width, 400.0, 0.0, 0.0), 0)
    back = least_gradient(flat, STRAIGHT, width, 400.0, 40.0, 0.0)
    assert back[-1] <= 20.0
    assert (np.diff(back) <= 0).all()


def test_the_path_seeks_the_flat_valley():
    """Hills that end 40 m to the right are passed on the right."""
    offsets = least_gradient(sensed(valley), STRAIGHT, half_width(STRAIGHT, 100.0), 400.0, 0.0, 0.0)
    assert 30 <= offsets[5:20].mean() <= 50


def test_the_path_leaves_sensed_terrain_last():
    """Ground that was not sensed is avoided, and beyond all sensed ground the corridor still holds."""
    width = half_width(STRAIGHT, 100.0)
    right = sensed(valley, east=(-150, 1))
    assert least_gradient(right, STRAIGHT, width, 400.0, 0.0, 0.0)[:24].max() <= 0
    nothing = empty_map(10.0)
    path = least_gradient(nothing, STRAIGHT, width, 1500.0, 80.0, 0.0)
    station = 1500.0 + KNOT_M * np.arange(path.size)
    assert (path <= np.maximum(width[(station - STRAIGHT.first).astype(int)], LANE_M)).all()


@given(st.lists(st.floats(-8, 8), min_size=2, max_size=2))
@settings(deadline=None, max_examples=20)
def test_offsets_continue_what_was_kept_within_the_turn_limit(steps):
    """The kept coefficients stay in front, and the new ones turn no harder than the limit."""
    kept = np.cumsum([0.0, steps[0], np.clip(steps[1], steps[0] - 2, steps[0] + 2)])
    width = half_width(STRAIGHT, 100.0)
    new = plan_offsets(sensed(valley), STRAIGHT, width, 20, kept, TURN_MAX)
    bend = np.diff(np.concatenate((kept[1:], new)), n=2) / KNOT_M**2
    assert np.abs(bend).max() <= TURN_MAX
