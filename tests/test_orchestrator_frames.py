"""Frames: the viewers' quaternion and vectors against the matrices that define them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.recording.frames import ned_to_enu, orientation

ANGLES = st.floats(-10, 10)
NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_TO_FRD = np.diag([1, -1, -1])


def frd_to_ned(phi, theta, psi):
    cr, sr, cp, sp, cy, sy = (f(x) for x in (phi, theta, psi) for f in (np.cos, np.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


def matrix(x, y, z, w):
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


@given(ANGLES, ANGLES, ANGLES)
@settings(deadline=None)
def test_quaternion_is_the_matrix_product(phi, theta, psi):
    """The quaternion is of unit length and turns as NED->ENU times R times FLU->FRD does."""
    quaternion = orientation(phi, theta, psi)
    assert np.linalg.norm(quaternion) == pytest.approx(1, abs=1e-14)
    expected = NED_TO_ENU @ frd_to_ned(phi, theta, psi) @ FLU_TO_FRD
    np.testing.assert_allclose(matrix(*quaternion), expected, atol=1e-14)


@given(st.tuples(*3 * [st.floats(-1e6, 1e6)]))
@settings(deadline=None)
def test_positions_follow_the_matrix(vector):
    """Positions change frames by the constant matrix, exactly."""
    assert ned_to_enu(*vector) == tuple(NED_TO_ENU @ vector)


@pytest.mark.parametrize(
    ("psi", "nose"), [(0, (0, 1, 0)), (np.pi / 2, (1, 0, 0)), (np.pi, (0, -1, 0))]
)
def test_level_flight_points_where_the_compass_says(psi, nose):
    """Heading north the nose points along y of the map, heading east along x; up stays up."""
    turn = matrix(*orientation(0.0, 0.0, psi))
    np.testing.assert_allclose(turn @ (1, 0, 0), nose, atol=1e-15)
    np.testing.assert_allclose(turn @ (0, 0, 1), (0, 0, 1), atol=1e-15)


def test_nose_up_and_right_wing_down_look_so():
    """Positive pitch lifts the nose, positive roll lowers the right side, seen from the map."""
    assert (matrix(*orientation(0.0, 0.1, 0.3)) @ (1, 0, 0))[2] == pytest.approx(np.sin(0.1))
    assert (matrix(*orientation(0.1, 0.0, 0.3)) @ (0, -1, 0))[2] == pytest.approx(-np.sin(0.1))


def test_arrays_of_positions_convert_at_once():
    """A path converts as a whole."""
    path = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(ned_to_enu(*path), NED_TO_ENU @ path)
