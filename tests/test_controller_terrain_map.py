"""The map of the sensed terrain."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.terrain_map import (
    SEEN,
    SHADOW_BOUND,
    empty_map,
    height_and_slope,
    heights,
    read_scan,
    update,
)

CELL = 10.0


def lattice(rows, columns):
    """Return north, east (K,) of the cells rows x columns."""
    north, east = np.meshgrid(CELL * np.asarray(rows), CELL * np.asarray(columns), indexing="ij")
    return north.ravel().astype(float), east.ravel().astype(float)


def seen(north, east, elevation, terrain_map=None, source=SEEN):
    """Return a map with cells added."""
    terrain_map = empty_map(CELL, 640.0) if terrain_map is None else terrain_map
    elevation = np.broadcast_to(np.asarray(elevation, float), north.shape).copy()
    return update(terrain_map, north, east, elevation, np.full(north.size, source))


def test_reproduces_quadratics():
    """Where the whole stencil is sensed, any quadratic terrain and its slope are exact."""

    def terrain(n, e):
        return 3 + 0.1 * n - 0.2 * e + 1e-3 * n * n + 2e-3 * n * e - 5e-4 * e * e

    north, east = lattice(range(-6, 7), range(-6, 7))
    terrain_map = seen(north, east, terrain(north, east))
    n, e = np.random.default_rng(1).uniform(-50, 50, (2, 100))
    h, h_n, h_e = heights(terrain_map, n, e)
    np.testing.assert_allclose(h, terrain(n, e), atol=1e-12)
    np.testing.assert_allclose(h_n, 0.1 + 2e-3 * n + 2e-3 * e, atol=1e-12)
    np.testing.assert_allclose(h_e, -0.2 + 2e-3 * n - 1e-3 * e, atol=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=25)
def test_passes_through_its_cells_and_is_continuously_differentiable(seed):
    """Any cells are met exactly, and value and slope agree on both sides of every cell edge."""
    north, east = lattice(range(8), range(8))
    cells = np.random.default_rng(seed).normal(0, 5, north.size)
    terrain_map = seen(north, east, cells)
    inner = (north < 70) & (east < 70)
    np.testing.assert_array_equal(heights(terrain_map, north, east)[0][inner], cells[inner])
    along = np.linspace(10.5, 59.5, 8)
    for edge in (20.0, 30.0, 40.0):
        for before, after in (
            (heights(terrain_map, edge - 1e-9, along), heights(terrain_map, edge + 1e-9, along)),
            (heights(terrain_map, along, edge - 1e-9), heights(terrain_map, along, edge + 1e-9)),
        ):
            np.testing.assert_allclose(before, after, atol=1e-7)


def test_known_up_to_its_last_cell():
    """With only the four enclosing cells sensed a plane is exact; with three, nothing is known."""
    north, east = lattice((4, 5), (7, 8))
    plane = 2 + 0.3 * north - 0.1 * east
    terrain_map = seen(north, east, plane)
    np.testing.assert_allclose(
        height_and_slope(terrain_map, 43.0, 78.0), (2 + 12.9 - 7.8, 0.3, -0.1), atol=1e-12
    )
    assert np.isnan(height_and_slope(terrain_map, 39.9, 78.0)).all()
    assert np.isnan(height_and_slope(seen(north[:3], east[:3], plane[:3]), 43.0, 78.0)).all()


@pytest.mark.parametrize("position", [(np.nan, 0.0), (0.0, np.inf)])
def test_nothing_is_known_nowhere(position):
    """A position that is not finite has no elevation."""
    assert np.isnan(height_and_slope(empty_map(CELL), *position)).all()


def test_which_value_wins():
    """The newest seen value; never a bound over a seen cell; of two bounds the lower."""
    cell = (np.array([20.0]), np.array([30.0]))

    def elevation(terrain_map):
        return terrain_map.elevation[2, 3]

    terrain_map = seen(*cell, 5.0, source=SHADOW_BOUND)
    assert elevation(terrain_map := seen(*cell, 7.0, terrain_map, SHADOW_BOUND)) == 5.0
    assert elevation(terrain_map := seen(*cell, 4.0, terrain_map, SHADOW_BOUND)) == 4.0
    assert elevation(terrain_map := seen(*cell, 6.0, terrain_map)) == 6.0
    assert elevation(terrain_map := seen(*cell, 1.0, terrain_map, SHADOW_BOUND)) == 6.0
    assert elevation(terrain_map := seen(*cell, 2.0, terrain_map)) == 2.0
    assert elevation(seen(*cell, np.nan, terrain_map)) == 2.0


@given(
    st.lists(st.integers(0, 12), max_size=12),
    st.integers(12, 20),
    st.integers(0, 2**32 - 1),
)
@settings(deadline=None, max_examples=50)
def test_a_ring_read_in_time_loses_nothing(bursts, capacity, seed):
    """Reading a ring after every burst gives the map of all cells in the order they were written."""
    rng = np.random.default_rng(seed)
    total = sum(bursts)
    north, east = CELL * rng.integers(-2, 2, (2, total)).astype(float)
    elevation, source = rng.normal(size=total), rng.integers(1, 3, total)
    ring = [np.zeros(capacity), np.zeros(capacity), np.zeros(capacity), np.zeros(capacity, int)]
    terrain_map, count = empty_map(CELL, 640.0), 0
    for burst in bursts:
        cells = slice(count, count + burst)
        at = np.arange(count, count + burst) % capacity
        for array, values in zip(ring, (north, east, elevation, source), strict=True):
            array[at] = values[cells]
        count += burst
        terrain_map = read_scan(terrain_map, count, *ring)
        assert terrain_map.last_count == count
    direct = update(empty_map(CELL, 640.0), north, east, elevation, source)
    for name in ("key", "elevation", "source"):
        np.testing.assert_array_equal(getattr(terrain_map, name), getattr(direct, name))


def test_a_ring_read_late_gives_its_newest_cells():
    """Cells that the ring overwrote before they were read are skipped."""
    north = CELL * np.arange(4.0)
    ring = (np.roll(north, 2), np.zeros(4), np.arange(4.0), np.ones(4, int))
    terrain_map = read_scan(empty_map(CELL, 640.0), 1_000_002, *ring)
    assert terrain_map.last_count == 1_000_002
    assert np.isfinite(terrain_map.elevation).sum() == 4


@given(st.integers(-100_000, 100_000), st.integers(-100_000, 100_000))
@settings(deadline=None, max_examples=50)
def test_the_window_follows(row, column):
    """Cells are found at any extent, and one a window away takes the place of the old one."""
    north, east = lattice((row, row + 1), (column, column + 1))
    terrain_map = seen(north, east, 1.0)
    centre = (CELL * (row + 0.5), CELL * (column + 0.5))
    assert height_and_slope(terrain_map, *centre) == (1.0, 0.0, 0.0)
    span = terrain_map.key.shape[0] * CELL
    assert np.isnan(height_and_slope(terrain_map, centre[0] + span, centre[1])).all()
    terrain_map = seen(north + span, east, 2.0, terrain_map)
    assert height_and_slope(terrain_map, centre[0] + span, centre[1]) == (2.0, 0.0, 0.0)
    assert np.isnan(height_and_slope(terrain_map, *centre)).all()


@pytest.mark.parametrize(("cell", "extent"), [(0.0, 100.0), (-1.0, 100.0), (10.0, 15.0)])
def test_impossible_maps_are_refused(cell, extent):
    """A map needs a positive cell and room for two of them."""
    with pytest.raises(ValueError, match=r"terrain map: .*, got .* m, expected "):
        empty_map(cell, extent)
