"""A C2 bicubic spline over a metric grid: its coefficients, height and slope as kernels.

Uniform cubic B-splines, 16 coefficients to a point. Outside the grid, and where a missing post is
among the 16, the kernels return NaN.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.jit import kernel

Floats = NDArray[np.float64]
EDGE = 1e-9  # of a spacing: what rounding puts outside still counts as inside


class TerrainGrid(NamedTuple):
    """What the kernels read: spline coefficients, their south-west post, and the spacing (m).

    Row 0 and column 0 of ``coefficients`` lie one spacing outside the posts, to the south and west.
    """

    coefficients: Floats
    north0: float
    east0: float
    spacing_north: float
    spacing_east: float


@kernel
def weights(t: float) -> tuple[float, float, float, float]:
    """Return the four uniform cubic B-splines at t in [0, 1]."""
    s = 1.0 - t
    return (
        s * s * s / 6.0,
        (4.0 - t * t * (6.0 - 3.0 * t)) / 6.0,
        (4.0 - s * s * (6.0 - 3.0 * s)) / 6.0,
        t * t * t / 6.0,
    )


@kernel
def rates(t: float) -> tuple[float, float, float, float]:
    """Return the derivatives of :func:`weights`."""
    s = 1.0 - t
    return -0.5 * s * s, 0.5 * t * (3.0 * t - 4.0), -0.5 * s * (3.0 * s - 4.0), 0.5 * t * t


@kernel
def _row(c: Floats, i: int, j: int, w: tuple[float, float, float, float]) -> float:
    return w[0] * c[i, j] + w[1] * c[i, j + 1] + w[2] * c[i, j + 2] + w[3] * c[i, j + 3]


@kernel
def height(grid: TerrainGrid, north: float, east: float) -> float:
    """Return the elevation, m; NaN outside the grid and where data are missing."""
    c = grid.coefficients
    y = (north - grid.north0) / grid.spacing_north
    x = (east - grid.east0) / grid.spacing_east
    ny, nx = c.shape[0] - 3, c.shape[1] - 3
    if not (y >= -EDGE and y <= ny + EDGE and x >= -EDGE and x <= nx + EDGE):
        return math.nan
    i, j = min(int(y), ny - 1), min(int(x), nx - 1)
    a, b = weights(y - i), weights(x - j)
    return (
        a[0] * _row(c, i, j, b)
        + a[1] * _row(c, i + 1, j, b)
        + a[2] * _row(c, i + 2, j, b)
        + a[3] * _row(c, i + 3, j, b)
    )


@kernel
def height_and_slope(grid: TerrainGrid, north: float, east: float) -> tuple[float, float, float]:
    """Return (h, dh/dnorth, dh/deast); h is :func:`height` to the last bit."""
    c = grid.coefficients
    y = (north - grid.north0) / grid.spacing_north
    x = (east - grid.east0) / grid.spacing_east
    ny, nx = c.shape[0] - 3, c.shape[1] - 3
    if not (y >= -EDGE and y <= ny + EDGE and x >= -EDGE and x <= nx + EDGE):
        return math.nan, math.nan, math.nan
    i, j = min(int(y), ny - 1), min(int(x), nx - 1)
    a, b = weights(y - i), weights(x - j)
    da, db = rates(y - i), rates(x - j)
    r0, r1 = _row(c, i, j, b), _row(c, i + 1, j, b)
    r2, r3 = _row(c, i + 2, j, b), _row(c, i + 3, j, b)
    h = a[0] * r0 + a[1] * r1 + a[2] * r2 + a[3] * r3
    h_n = da[0] * r0 + da[1] * r1 + da[2] * r2 + da[3] * r3
    h_e = (
        a[0] * _row(c, i, j, db)
        + a[1] * _row(c, i + 1, j, db)
        + a[2] * _row(c, i + 2, j, db)
        + a[3] * _row(c, i + 3, j, db)
    )
    return h, h_n / grid.spacing_north, h_e / grid.spacing_east


@kernel
def evaluate(grid: TerrainGrid, north: Floats, east: Floats, out: Floats) -> None:
    """Fill out (K, 3) with height and slope at K points."""
    for k in range(north.size):
        out[k, 0], out[k, 1], out[k, 2] = height_and_slope(grid, north[k], east[k])


@kernel
def add_heights(grid: TerrainGrid, north: Floats, east: Floats, out: Floats) -> None:
    """Add the elevation at every crossing of north and east to out (len(north), len(east))."""
    for i in range(north.size):
        for j in range(east.size):
            out[i, j] += height(grid, north[i], east[j])


def spline_coefficients(elevation: Floats) -> Floats:
    """Return the (ny + 2, nx + 2) bicubic B-spline coefficients that interpolate (ny, nx) posts.

    Natural ends: no curvature across the edge. Coefficients of missing posts (NaN) are NaN, so that
    no point that leans on one has a height; their neighbours are computed as if the nearest known
    elevation stood in the hole.
    """
    hole = np.isnan(elevation)
    if hole.any():
        from scipy.ndimage import distance_transform_edt

        nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
        elevation = elevation[tuple(nearest)]
    c = _natural(_natural(elevation).T).T
    c[1:-1, 1:-1][hole] = np.nan
    return np.ascontiguousarray(c)


def _natural(values: Floats) -> Floats:
    """Solve (c[i-1] + 4 c[i] + c[i+1]) / 6 = values[i] along axis 0, with c'' = 0 at both ends."""
    from scipy.linalg import solve_banded

    n = len(values)
    c = np.empty((n + 2, values.shape[1]))
    c[1], c[-2] = values[0], values[-1]
    bands = np.ones((3, n - 2))
    bands[1] = 4.0
    right = 6.0 * values[1:-1]
    right[0] -= values[0]
    right[-1] -= values[-1]
    c[2:-2] = solve_banded((1, 1), bands, right, overwrite_b=True, check_finite=False)
    c[0], c[-1] = 2.0 * c[1] - c[2], 2.0 * c[-2] - c[-3]
    return c


def extent(grid: TerrainGrid) -> tuple[float, float, float, float]:
    """Return the southern, northern, western and eastern edge, m."""
    ny, nx = grid.coefficients.shape
    top = grid.north0 + grid.spacing_north * (ny - 3)
    right = grid.east0 + grid.spacing_east * (nx - 3)
    return grid.north0, top, grid.east0, right
