"""One burst of a terrain sensor: which cells of the world lattice are in view, and how high.

The lattice is fixed to the ground: cell (i, j) is the point (i, j) times the cell size. In view are
the cells of a sector about the heading and of a disc around the aircraft.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.jit import kernel
from plant.terrain import TerrainGrid, height

SEEN, SHADOW = 1, 2


class View(NamedTuple):
    """Geometry of a sensor; m and rad."""

    reach: float  # radius of the sector
    half_angle: float  # of the sector, at most pi
    near: float  # radius of the disc
    cell: float  # lattice spacing
    ray_step: float  # between samples along a line of sight; 0 looks through the ground


def largest_burst(view: View) -> int:
    """Return a bound on the cells of one burst, whatever the position and heading.

    A convex region of area A and perimeter P holds at most ``A/c^2 + P/(sqrt(2) c) + 1`` points of
    a lattice of spacing c: it, widened by one cell, contains a cell for every point. The sector and
    the disc are bounded apart; the whole circle of the reach bounds both.
    """

    def bound(area: float, perimeter: float) -> float:
        return area / view.cell**2 + perimeter / (math.sqrt(2.0) * view.cell) + 1.0

    reach, near, half = view.reach, view.near, view.half_angle
    sector = bound(half * reach**2, 2.0 * reach * (1.0 + half))
    disc = bound(math.pi * near**2, 2.0 * math.pi * near)
    widest = max(reach, near)
    circle = bound(math.pi * widest**2, 2.0 * math.pi * widest)
    # beyond a half circle a sector is not convex
    return int(circle if half > 0.5 * math.pi else min(sector + disc, circle))


@kernel
def line_of_sight(
    grid: TerrainGrid,
    north: float,
    east: float,
    altitude: float,
    to_north: float,
    to_east: float,
    ray_step: float,
) -> float:
    """Return the elevation (m) below which a point is hidden from (north, east, altitude).

    The steepest elevation angle of the ground in between, carried on to the distance of the point.
    A gap in the data hides nothing.
    """
    distance = math.hypot(to_north - north, to_east - east)
    steepest = -math.inf
    for k in range(1, math.ceil(distance / ray_step)):
        r = k * ray_step
        h = height(
            grid,
            north + (to_north - north) * (r / distance),
            east + (to_east - east) * (r / distance),
        )
        if not math.isnan(h):
            steepest = max(steepest, (h - altitude) / r)
    return altitude + distance * steepest


@kernel
def sweep(
    grid: TerrainGrid,
    north: float,
    east: float,
    altitude: float,
    heading: float,
    view: View,
    cells: NDArray[np.float64],
    source: NDArray[np.int64],
) -> int:
    """Measure the cells in view; return how many.

    Parameters
    ----------
    north, east, altitude, heading
        Of the sensor; m and rad.
    cells : (3, C)
        Written: north, east, elevation, m; C at least :func:`largest_burst`.
    source : (C,)
        Written: 1 seen; 2 hidden, and the elevation is an upper bound.
    """
    if not math.isfinite(north + east + altitude + heading):
        return 0
    ahead_north, ahead_east = math.cos(heading), math.sin(heading)
    edge = math.cos(view.half_angle)
    widest = max(view.reach, view.near)
    count = 0
    first, last = math.ceil((east - widest) / view.cell), math.floor((east + widest) / view.cell)
    for i in range(
        math.ceil((north - widest) / view.cell), math.floor((north + widest) / view.cell) + 1
    ):
        for j in range(first, last + 1):
            n, e = i * view.cell, j * view.cell
            r = math.hypot(n - north, e - east)
            ahead = (n - north) * ahead_north + (e - east) * ahead_east
            if not (r <= view.near or (r <= view.reach and ahead >= r * edge)):
                continue
            h = height(grid, n, e)
            if math.isnan(h):
                continue
            hidden_below = -math.inf
            if view.ray_step > 0.0:
                hidden_below = line_of_sight(grid, north, east, altitude, n, e, view.ray_step)
            cells[0, count], cells[1, count] = n, e
            cells[2, count] = max(h, hidden_below)
            source[count] = SHADOW if h < hidden_below else SEEN
            count += 1
    return count
