"""The course through way-points and the path along it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.course import (
    LEAD_IN_M,
    STANDARD_GRAVITY,
    Path,
    make_course,
    position,
    project,
    sample_path,
    turn_radius,
)

BENT = [(0.0, 0.0), (800.0, 0.0), (1400.0, 600.0), (1400.0, 1600.0)]


def as_path(course):
    """Return a path that is the course itself, at altitude 100 m."""
    flat = np.full(course.north.size, 100.0)
    return Path(course.first, 1.0, course.north, course.east, flat, course.heading, flat, 0 * flat)


def test_meets_its_first_and_last_way_point():
    """Station 0 is the first way-point and the goal the last; between them lie legs and arcs."""
    course = make_course(BENT, 30.0)
    np.testing.assert_allclose(position(course, 0.0, 0.0), BENT[0], atol=1e-3)
    np.testing.assert_allclose(position(course, course.goal, 0.0), BENT[-1], atol=1e-3)
    radius = turn_radius(30.0, 30.0)
    turns = np.radians([45.0, 45.0])
    legs = 800.0 + math.hypot(600, 600) + 1000.0
    assert course.goal == pytest.approx(legs + (radius * (turns - 2 * np.tan(turns / 2))).sum())


def test_corners_have_the_radius_of_the_bank():
    """The curvature is 0 or that of a level turn, g tan(bank) / V^2, to the right positive."""
    course = make_course(BENT, 25.0, bank_max_deg=20.0)
    expected = STANDARD_GRAVITY * math.tan(math.radians(20)) / 25**2
    np.testing.assert_allclose(np.unique(course.curvature), [0, expected], rtol=1e-12)
    left = make_course([(0, 0), (500, 0), (500, -500)], 20.0)
    assert left.curvature.min() < 0 == left.curvature.max()


def test_is_sampled_every_metre_with_its_own_heading():
    """Steps are one metre long, and heading is their direction and the integral of curvature."""
    course = make_course(BENT, 30.0)
    north, east = np.diff(course.north), np.diff(course.east)
    np.testing.assert_allclose(np.hypot(north, east), 1.0, atol=1e-5)
    middle = (course.heading[1:] + course.heading[:-1]) / 2
    np.testing.assert_allclose(np.arctan2(east, north), middle, atol=2e-3)
    turned = np.cumsum(course.curvature[:-1])
    np.testing.assert_allclose(course.heading[1:] - course.heading[0], turned, atol=0.02)


def test_heading_is_unwrapped():
    """A course that turns right all the way round ends a whole turn further."""
    square = [(0, 0), (900, 0), (900, 900), (0, 900), (0, 100), (900, 100)]
    assert make_course(square, 20.0).heading[-1] == pytest.approx(2 * np.pi)


def test_continues_straight_at_both_ends():
    """Before the first and beyond the last way-point, sampled or not, the course is straight."""
    course = make_course([(0, 0), (0, 100)], 30.0, beyond_m=1500.0)
    assert course.first == -LEAD_IN_M
    assert course.first + course.north.size - 1 == course.goal + 1500.0
    for station in (-500.0, -50.5, 1000.25, 9000.0):
        np.testing.assert_allclose(position(course, station, 0.0), (0.0, station), atol=1e-9)


def test_offsets_are_to_the_right():
    """Flying north the right is east; flying east it is south."""
    np.testing.assert_allclose(position(make_course([(0, 0), (9, 0)], 30.0), 3.0, 2.0), (3.0, 2.0))
    np.testing.assert_allclose(
        position(make_course([(0, 0), (0, 9)], 30.0), 3.0, 2.0), (-2.0, 3.0), atol=1e-12
    )


@pytest.mark.parametrize(
    ("waypoints", "message"),
    [
        ([(0, 0)], r"way-points: no course, got shape \(1, 2\), expected 2 or more"),
        ([(0, 0), (0, 0)], r"way-point 1: no leg leads to it, got \[0.0, 0.0\] m twice"),
        ([(0, 0), (0, np.nan)], r"way-points: not a position"),
        (
            [(0, 0), (100, 0), (100, 500)],
            r"way-point 1: no room for a turn of 90 deg .* got a leg of 100.0 m .* expected 159 m",
        ),
        ([(0, 0), (500, 0), (0, 0)], r"way-point 1: no room for a turn of 180 deg"),
    ],
)
def test_impossible_courses_are_refused(waypoints, message):
    """Too few, coinciding or too close way-points are errors that name the way-point."""
    with pytest.raises(ValueError, match=message):
        make_course(waypoints, 30.0)


@given(st.floats(-190.0, 3500.0), st.floats(-30.0, 30.0))
@settings(deadline=None, max_examples=100)
def test_projection_undoes_sampling(station, away):
    """A point of the path projects to its own station, searched from up to 30 m away."""
    path = as_path(make_course(BENT, 30.0))
    point = sample_path(path, np.array([station]))
    found = project(path, point.north[0], point.east[0], station + away)
    assert found == pytest.approx(station, abs=1e-6)


@given(st.floats(0.0, 2000.0), st.floats(-100.0, 100.0))
@settings(deadline=None, max_examples=100)
def test_projection_finds_the_nearest_point(station, offset):
    """A point beside the path, within its turn radius, projects square to it."""
    course = make_course(BENT, 30.0)
    north, east = position(course, station, offset)
    assert project(as_path(course), north, east, station) == pytest.approx(station, abs=0.6)


def test_projection_stays_on_its_own_leg():
    """Where the course comes back close by, the search does not jump to the other leg."""
    path = as_path(make_course([(0, 0), (1000, 0), (1000, 400), (0, 400)], 30.0))
    assert project(path, 300.0, 390.0, 280.0) == pytest.approx(300.0)
    assert project(path, 300.0, 10.0, path.start + path.north.size) > 1000.0


@pytest.mark.parametrize("station", [-260.0, 4300.5])
def test_beyond_its_ends_a_path_is_straight(station):
    """Samples beyond the ends go straight on with the last heading, and project back."""
    path = as_path(make_course(BENT, 30.0))
    point = sample_path(path, np.array([station]))
    assert point.heading[0] in (path.heading[0], path.heading[-1])
    assert project(path, point.north[0], point.east[0], station) == pytest.approx(station)
