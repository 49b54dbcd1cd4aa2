"""The sensed terrain: cells of the scan's world lattice in a fixed window around the aircraft.

A cell is the point (row * cell_size north, column * cell_size east). It is stored in the slot
(row mod N, column mod N) together with its own address, so that the window follows the aircraft
without ever being moved: a new cell simply takes the slot of one that is N cells away, and an
address that does not match means "not sensed". N cells must span more than twice the sensor range.

Between cells the height is Keys' cubic convolution (R. Keys, IEEE Trans. ASSP 29(6), 1981): it
passes through the cells, is continuously differentiable, and reproduces quadratics.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from controller.jit import kernel

Array = NDArray[np.float64]
SEEN, SHADOW_BOUND = 1, 2
_EMPTY = np.iinfo(np.int64).min


class TerrainMap(NamedTuple):
    """Sensed cells. The arrays are one store that :func:`update` writes in place.

    ``key`` (N, N) int64 holds the address of each slot's cell, ``elevation`` (N, N) metres up,
    ``source`` (N, N) uint8 1 seen or 2 shadow bound; N is a power of two. ``last_count`` is the
    number of scan cells read so far: it grows when and only when there may be new terrain.
    """

    cell_size: float
    key: NDArray[np.int64]
    elevation: Array
    source: NDArray[np.uint8]
    last_count: int


def empty_map(cell_size: float, extent_m: float = 2000.0) -> TerrainMap:
    """Return a map of nothing, of cells ``cell_size`` metres apart over at least ``extent_m``.

    Raises
    ------
    ValueError
        If the cell size is not positive or the extent is below two cells.
    """
    if not cell_size > 0:
        msg = f"terrain map: no cell size, got {cell_size} m, expected more than 0 m"
        raise ValueError(msg)
    if not extent_m >= 2 * cell_size:
        msg = f"terrain map: extent too small, got {extent_m} m, expected {2 * cell_size} m or more"
        raise ValueError(msg)
    n = 1 << int(np.ceil(np.log2(extent_m / cell_size)))
    return TerrainMap(
        cell_size=float(cell_size),
        key=np.full((n, n), _EMPTY, np.int64),
        elevation=np.full((n, n), np.nan),
        source=np.zeros((n, n), np.uint8),
        last_count=0,
    )


def update(
    terrain_map: TerrainMap, north: Array, east: Array, elevation: Array, source: NDArray[np.int64]
) -> TerrainMap:
    """Return the map with cells added: arrays (K,), north, east and elevation in metres.

    The newest seen value of a cell wins. A shadow bound never overwrites a seen cell, and of two
    bounds the lower stays, since both bound the ground from above. Cells with a value that is not
    finite are skipped. The given map's arrays are written, and shared with the result.
    """
    return read_scan(
        terrain_map, terrain_map.last_count + north.size, north, east, elevation, source
    )


def read_scan(
    terrain_map: TerrainMap,
    count: int,
    north: Array,
    east: Array,
    elevation: Array,
    source: NDArray[np.int64],
) -> TerrainMap:
    """Return the map with the scan's cells ``terrain_map.last_count`` to ``count`` added.

    Cell i of the scan is in element i % capacity of the arrays (capacity,); cells that the ring has
    lost by overwriting are skipped. The rules are those of :func:`update`.
    """
    first = max(terrain_map.last_count, count - north.size)
    if first < count:
        _write(terrain_map, first % north.size, count - first, north, east, elevation, source)
    return terrain_map._replace(last_count=count)


def heights(terrain_map: TerrainMap, north: ArrayLike, east: ArrayLike) -> tuple[Array, ...]:
    """Return elevation (m) and slopes dh/dnorth, dh/deast; NaN where not sensed; any shape."""
    n, e = np.broadcast_arrays(np.asarray(north, float), np.asarray(east, float))
    out = np.empty((3, n.size))
    _heights(terrain_map, n.ravel(), e.ravel(), out)
    return tuple(out.reshape(3, *n.shape))


@kernel
def _address(row: int, column: int) -> int:
    return (row << 32) + (column & 0xFFFFFFFF)


@kernel
def _write(
    terrain_map: TerrainMap,
    first: int,
    number: int,
    north: Array,
    east: Array,
    elevation: Array,
    source: NDArray[np.int64],
) -> None:
    mask = terrain_map.key.shape[0] - 1
    for k in range(number):
        c = (first + k) % north.size
        if not np.isfinite(north[c] + east[c] + elevation[c]):
            continue
        row = int(np.floor(north[c] / terrain_map.cell_size + 0.5))
        column = int(np.floor(east[c] / terrain_map.cell_size + 0.5))
        i, j, key = row & mask, column & mask, _address(row, column)
        if source[c] != SEEN and terrain_map.key[i, j] == key:
            bound = elevation[c] >= terrain_map.elevation[i, j]
            if terrain_map.source[i, j] == SEEN or bound:
                continue
        terrain_map.key[i, j] = key
        terrain_map.elevation[i, j] = elevation[c]
        terrain_map.source[i, j] = source[c]


@kernel
def _cell(key: NDArray[np.int64], elevation: Array, row: int, column: int) -> float:
    i, j = row & (key.shape[0] - 1), column & (key.shape[0] - 1)
    return float(elevation[i, j]) if key[i, j] == _address(row, column) else np.nan


@kernel
def _row(
    key: NDArray[np.int64], elevation: Array, row: int, column: int
) -> tuple[float, float, float, float]:
    """Return the four cells of a stencil row, from column - 1; NaN where not sensed."""
    return (
        _cell(key, elevation, row, column - 1),
        _cell(key, elevation, row, column),
        _cell(key, elevation, row, column + 1),
        _cell(key, elevation, row, column + 2),
    )


@kernel
def _beyond(value: float, near: float, far: float) -> float:
    """Return the cell, or where it is not sensed the line through its two inner neighbours."""
    return 2.0 * near - far if np.isnan(value) else value


@kernel
def _convolve(a: float, b: float, c: float, d: float, t: float) -> tuple[float, float]:
    """Return Keys' cubic through b (t = 0) and c (t = 1), and its derivative by t."""
    p1 = 0.5 * (c - a)
    p2 = a - 2.5 * b + 2.0 * c - 0.5 * d
    p3 = 0.5 * (d - a) + 1.5 * (b - c)
    return b + t * (p1 + t * (p2 + t * p3)), p1 + t * (2.0 * p2 + t * 3.0 * p3)


@kernel
def height_and_slope(
    terrain_map: TerrainMap, north: float, east: float
) -> tuple[float, float, float]:
    """Return elevation (m), dh/dnorth, dh/deast; NaN where an enclosing cell is not sensed.

    Where only the outer ring of the 4 x 4 stencil is missing it is extrapolated linearly, so that
    the terrain is known up to its last cell.
    """
    if not (np.isfinite(north) and np.isfinite(east)):
        return np.nan, np.nan, np.nan
    key, elevation = terrain_map.key, terrain_map.elevation
    x, y = north / terrain_map.cell_size, east / terrain_map.cell_size
    i, j = int(np.floor(x)), int(np.floor(y))
    b0, b1, b2, b3 = _row(key, elevation, i, j)
    c0, c1, c2, c3 = _row(key, elevation, i + 1, j)
    if np.isnan(b1 + b2 + c1 + c2):
        return np.nan, np.nan, np.nan
    b0, b3, c0, c3 = (
        _beyond(b0, b1, b2),
        _beyond(b3, b2, b1),
        _beyond(c0, c1, c2),
        _beyond(c3, c2, c1),
    )
    a0, a1, a2, a3 = _row(key, elevation, i - 1, j)
    d0, d1, d2, d3 = _row(key, elevation, i + 2, j)
    t = y - j
    a, a_y = _convolve(
        _beyond(a0, b0, c0), _beyond(a1, b1, c1), _beyond(a2, b2, c2), _beyond(a3, b3, c3), t
    )
    b, b_y = _convolve(b0, b1, b2, b3, t)
    c, c_y = _convolve(c0, c1, c2, c3, t)
    d, d_y = _convolve(
        _beyond(d0, c0, b0), _beyond(d1, c1, b1), _beyond(d2, c2, b2), _beyond(d3, c3, b3), t
    )
    h, h_x = _convolve(a, b, c, d, x - i)
    h_y, _ = _convolve(a_y, b_y, c_y, d_y, x - i)
    return h, h_x / terrain_map.cell_size, h_y / terrain_map.cell_size


@kernel
def _heights(terrain_map: TerrainMap, north: Array, east: Array, out: Array) -> None:
    for k in range(north.size):
        out[0, k], out[1, k], out[2, k] = height_and_slope(terrain_map, north[k], east[k])
