"""Terrain: a C2 bicubic spline over a local metric grid, with its slope.

Frame: north and east in m from the origin, elevation in m up. The surface interpolates the posts
with natural ends. Outside the grid, and within two posts of a hole, there is no elevation: kernels
return NaN, the numpy methods raise.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Lt
from numpy.typing import ArrayLike, NDArray

from plant.terrain_files import read_posts
from plant.terrain_grid import (
    TerrainGrid,
    add_heights,
    evaluate,
    extent,
    height,
    height_and_slope,
    spline_coefficients,
)
from plant.terrain_shapes import Shape, made_ground, roughness

__all__ = ["Terrain", "TerrainGrid", "TerrainParameters", "height", "height_and_slope"]

Floats = NDArray[np.float64]
MAX_POSTS = 16_000_000  # 128 MB of coefficients; an SRTM tile of one arc second has 13 million
SHAPE_EXTENT = 8000.0  # m
ROUGHNESS_SPACING = 5.0  # m, a quarter of the shortest wave


@dataclass(frozen=True)
class TerrainParameters:
    """Which ground: exactly one of ``file`` and ``shape``."""

    file: Annotated[Path | None, "elevation file: .npz, .asc, .hgt or .tif"] = None
    shape: Annotated[Shape | None, "made ground"] = None
    origin_north_m: Annotated[float, "point that becomes north 0, from the middle of the data"] = (
        0.0
    )
    origin_east_m: Annotated[float, "point that becomes east 0, from the middle of the data"] = 0.0
    extent_m: Annotated[
        float | None, Gt(0), "side of the square kept around the origin; all of a file if null"
    ] = None
    elevation_m: Annotated[float, "elevation of a shape's foot (of a fractal: its mean)"] = 0.0
    height_m: Annotated[float, "rise of a shape; a fractal has the rms of ridges that high"] = 30.0
    start_m: Annotated[float, "where step, ramp or ridges begin, along the bearing"] = 200.0
    run_m: Annotated[float, Gt(0), "horizontal length of a step's rise"] = 100.0
    slope_deg: Annotated[float, Gt(0), Lt(80), "of a ramp"] = 15.0
    wavelength_m: Annotated[float, Gt(0), "crest to crest of ridges; longest of a fractal"] = 800.0
    bearing_deg: Annotated[float, "direction in which step, ramp and ridges run"] = 0.0
    spacing_m: Annotated[float, Gt(0), "between the posts of a shape"] = 10.0
    seed: Annotated[int, Ge(0), "of a fractal"] = 0
    roughness_rms_m: Annotated[float, Ge(0), "synthetic sub-grid roughness, 20 to 150 m long"] = 0.0
    roughness_seed: Annotated[int, Ge(0), "of the roughness"] = 0

    def __post_init__(self) -> None:
        if (self.file is None) == (self.shape is None):
            got = "neither" if self.file is None else "both"
            raise ValueError(f"terrain: no clear source, got {got}, expected file or shape")


class Terrain:
    """Known ground, made once and shared by plant, sensor and prediction.

    Attributes
    ----------
    grid : TerrainGrid
        For kernels: ``height(terrain.grid, north, east)``.
    attribution : str
        Whose data this is, and what was added to them.

    Raises
    ------
    ValueError, FileNotFoundError
        If a file is missing or broken, the origin is outside the data, or the grid is too large.
    """

    def __init__(self, parameters: TerrainParameters) -> None:
        grid, self.attribution = _ground(parameters)
        if parameters.roughness_rms_m > 0:
            grid = _roughened(grid, parameters)
            self.attribution += (
                f"; synthetic sub-grid roughness of {parameters.roughness_rms_m:g} m rms "
                f"(seed {parameters.roughness_seed})"
            )
        self.grid = grid

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Southern, northern, western and eastern edge, m."""
        return extent(self.grid)

    def contains(self, north: float, east: float) -> bool:
        """Tell whether there is an elevation at this point."""
        return not math.isnan(height(self.grid, float(north), float(east)))

    def elevation(self, north: ArrayLike, east: ArrayLike) -> Floats:
        """Return the elevation, m, at points given in m (broadcast).

        Raises
        ------
        ValueError
            If a point is outside the grid or has no data.
        """
        return self._at(north, east)[..., 0]

    def slope(self, north: ArrayLike, east: ArrayLike) -> tuple[Floats, Floats]:
        """Return (dh/dnorth, dh/deast) at points given in m (broadcast); raises as `elevation`."""
        values = self._at(north, east)
        return values[..., 1], values[..., 2]

    def surface(self) -> tuple[Floats, Floats, Floats]:
        """Return the posts for pictures: north (ny,), east (nx,), elevation (ny, nx)."""
        g = self.grid
        ny, nx = (n - 2 for n in g.coefficients.shape)
        north = g.north0 + g.spacing_north * np.arange(ny)
        east = g.east0 + g.spacing_east * np.arange(nx)
        c = g.coefficients
        rows = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0
        return north, east, (rows[:, :-2] + 4.0 * rows[:, 1:-1] + rows[:, 2:]) / 6.0

    def _at(self, north: ArrayLike, east: ArrayLike) -> Floats:
        n, e = (np.array(v, np.float64, order="C") for v in np.broadcast_arrays(north, east))
        out = np.empty((n.size, 3))
        evaluate(self.grid, n.ravel(), e.ravel(), out)
        missing = np.flatnonzero(np.isnan(out[:, 0]))
        if missing.size:
            self._refuse(float(n.flat[missing[0]]), float(e.flat[missing[0]]))
        return out.reshape(*n.shape, 3)

    def _refuse(self, north: float, east: float) -> None:
        south, top, west, right = self.extent
        inside = south <= north <= top and west <= east <= right
        what = "no data within two posts" if inside else "point outside"
        raise ValueError(
            f"terrain: {what}, got north {north:g} m, east {east:g} m, expected north "
            f"{south:g} .. {top:g} m, east {west:g} .. {right:g} m"
        )


def _ground(p: TerrainParameters) -> tuple[TerrainGrid, str]:
    """Return the spline of the file or the shape, and whose it is."""
    if p.file is not None:
        posts = read_posts(Path(p.file))
        ny, nx = posts.elevation.shape
        i, north0 = _kept("north", posts.spacing_north, ny, p.origin_north_m, p.extent_m)
        j, east0 = _kept("east", posts.spacing_east, nx, p.origin_east_m, p.extent_m)
        z = posts.elevation[i, j]
        _refuse_size(z.size)
        return _grid(z, north0, east0, posts.spacing_north, posts.spacing_east), posts.attribution
    assert p.shape is not None
    half = 0.5 * (p.extent_m or SHAPE_EXTENT)
    _refuse_size((2.0 * half / p.spacing_m) ** 2)
    axis = _multiples(-half, half, p.spacing_m)
    z = p.elevation_m + made_ground(
        p.shape,
        axis + p.origin_north_m,
        axis + p.origin_east_m,
        height=p.height_m,
        start=p.start_m,
        run=p.run_m,
        slope=math.radians(p.slope_deg),
        wavelength=p.wavelength_m,
        bearing=math.radians(p.bearing_deg),
        seed=p.seed,
    )
    return _grid(z, axis[0], axis[0], p.spacing_m, p.spacing_m), f"synthetic terrain, {p.shape}"


def _kept(
    axis: str, spacing: float, count: int, origin: float, extent: float | None
) -> tuple[slice, float]:
    """Return the posts of one axis in the square around the origin, and where the first is, m."""
    half = 0.5 * spacing * (count - 1)
    if abs(origin) > half:
        raise ValueError(
            f"terrain.origin_{axis}_m: outside the data, got {origin:g} m, "
            f"expected {-half:g} .. {half:g} m"
        )
    reach = math.inf if extent is None else 0.5 * extent
    first = math.floor(max(half + origin - reach, 0.0) / spacing)
    last = min(math.ceil(min(half + origin + reach, 2.0 * half) / spacing), count - 1)
    return slice(first, last + 1), spacing * first - half - origin


def _roughened(grid: TerrainGrid, p: TerrainParameters) -> TerrainGrid:
    """Return the surface resampled every 5 m, with synthetic sub-grid roughness added."""
    reach = math.inf if p.extent_m is None else 0.5 * p.extent_m
    south, top, west, right = (min(max(edge, -reach), reach) for edge in extent(grid))
    _refuse_size((top - south) * (right - west) / ROUGHNESS_SPACING**2)
    north = _multiples(south, top, ROUGHNESS_SPACING)
    east = _multiples(west, right, ROUGHNESS_SPACING)
    z = roughness(
        north + p.origin_north_m,
        east + p.origin_east_m,
        rms=p.roughness_rms_m,
        seed=p.roughness_seed,
    )
    add_heights(grid, north, east, z)
    return _grid(z, north[0], east[0], ROUGHNESS_SPACING, ROUGHNESS_SPACING)


def _grid(z: Floats, north0: float, east0: float, dn: float, de: float) -> TerrainGrid:
    if min(z.shape) < 4:
        raise ValueError(f"terrain: too few posts, got {z.shape}, expected at least 4 by 4")
    return TerrainGrid(spline_coefficients(z), float(north0), float(east0), float(dn), float(de))


def _multiples(start: float, end: float, spacing: float) -> Floats:
    """Return the multiples of ``spacing`` from start to end."""
    first, last = math.ceil(start / spacing), math.floor(end / spacing)
    return spacing * np.arange(first, last + 1, dtype=np.float64)


def _refuse_size(posts: float) -> None:
    if posts > MAX_POSTS:
        raise ValueError(
            f"terrain.extent_m: too many posts, got {posts:.0f}, expected at most {MAX_POSTS}, "
            "as from a smaller extent"
        )
