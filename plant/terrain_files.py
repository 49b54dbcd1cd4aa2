"""Readers of elevation files: npz, ESRI ASCII grid, SRTM tile, GeoTIFF.

Every reader gives :class:`Posts`, a metric grid with north up. A grid in degrees is mapped to the
plane at its middle latitude: one degree of latitude and one of longitude each become a fixed
length, so that east-west distances are off by 0.6 % at the edges of a one-degree tile at 36
degrees.
"""

import math
import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

HGT_VOID = -32768
HGT_POSTS = {2 * n * n: n for n in (1201, 3601)}  # by size in bytes
DEGREE_SPACING = 0.1  # no metric terrain has posts closer than 10 cm: smaller means degrees
ROW_ORDERS = ("south to north", "north to south")


@dataclass(frozen=True)
class Posts:
    """Elevations on a metric grid.

    Attributes
    ----------
    elevation : (ny, nx)
        m, up; rows south to north, columns west to east; NaN where there is no data.
    spacing_north, spacing_east
        Distance between posts, m.
    attribution
        Whose data this is.
    """

    elevation: NDArray[np.float64]
    spacing_north: float
    spacing_east: float
    attribution: str = ""


def read_posts(path: Path) -> Posts:
    """Read a terrain file; the suffix says which kind.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the kind is unknown, the content is not what the kind demands, or a GeoTIFF is asked for
        without rasterio.
    """
    readers = {".npz": _npz, ".asc": _asc, ".hgt": _hgt, ".tif": _tif, ".tiff": _tif}
    if path.suffix.lower() not in readers:
        known = ", ".join(readers)
        raise ValueError(f"{path}: unknown kind of terrain, got {path.suffix!r}, expected {known}")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such terrain file")
    posts = readers[path.suffix.lower()](path)
    _check(path, posts)
    return posts


def metres_per_degree(latitude: float) -> tuple[float, float]:
    """Return the lengths (north, east) of one degree on the WGS 84 ellipsoid, m.

    Parameters
    ----------
    latitude
        Geodetic, degrees.
    """
    a, e2 = 6378137.0, 6.69437999014e-3
    phi = math.radians(latitude)
    w2 = 1.0 - e2 * math.sin(phi) ** 2
    north = a * (1.0 - e2) / w2**1.5
    east = a * math.cos(phi) / math.sqrt(w2)
    return math.radians(north), math.radians(east)


def _check(path: Path, posts: Posts) -> None:
    z = posts.elevation
    if z.ndim != 2 or min(z.shape) < 4:
        raise ValueError(f"{path}: too few posts, got shape {z.shape}, expected at least 4 by 4")
    if np.any(np.isinf(z)):
        raise ValueError(f"{path}: infinite elevation, expected numbers, or NaN for no data")
    if np.all(np.isnan(z)):
        raise ValueError(f"{path}: no data at all, got {z.size} posts without elevation")
    for axis, spacing in (("north", posts.spacing_north), ("east", posts.spacing_east)):
        if not (math.isfinite(spacing) and spacing > 0):
            raise ValueError(f"{path}: wrong spacing {axis}, got {spacing:g} m, expected above 0 m")


def _npz(path: Path) -> Posts:
    """Read ``elevation``, ``spacing_north_m``, ``spacing_east_m``, ``rows`` and ``attribution``."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            elevation = np.asarray(file["elevation"], dtype=np.float64)
            north, east = float(file["spacing_north_m"]), float(file["spacing_east_m"])
            rows = str(file["rows"])
            attribution = str(file["attribution"]) if "attribution" in file else ""
    except KeyError as error:
        raise ValueError(
            f"{path}: key missing, got no {error.args[0].split()[0]!r}, "
            "expected elevation, spacing_north_m, spacing_east_m and rows"
        ) from None
    except Exception as error:  # noqa: BLE001 - zipfile, zlib and numpy raise a dozen kinds
        what = " ".join(str(error).split())
        raise ValueError(f"{path}: broken, got {what}, expected a numpy .npz archive") from None
    if rows not in ROW_ORDERS:
        raise ValueError(f"{path}: wrong rows, got {rows!r}, expected one of {ROW_ORDERS}")
    return Posts(elevation if rows == ROW_ORDERS[0] else elevation[::-1], north, east, attribution)


def _asc(path: Path) -> Posts:
    """Read an ESRI ASCII grid, in metres or in degrees (told by the spacing)."""
    words = path.read_text(encoding="ascii", errors="replace").split()
    header: dict[str, float] = {}
    i = 0
    try:
        while i + 1 < len(words) and words[i][0].isalpha() and words[i].lower() != "nan":
            header[words[i].lower()] = float(words[i + 1])
            i += 2
        nx, ny = int(header["ncols"]), int(header["nrows"])
        dx = header.get("dx", header.get("cellsize", math.nan))
        dy = header.get("dy", header.get("cellsize", math.nan))
        south = header["yllcorner"] + 0.5 * dy if "yllcorner" in header else header["yllcenter"]
        z = np.array(words[i:], dtype=np.float64)
    except KeyError as error:
        raise ValueError(
            f"{path}: header incomplete, got no {error.args[0]!r}, expected an ESRI ASCII grid"
        ) from None
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path}: broken, got {error}, expected an ESRI ASCII grid") from None
    if z.size != nx * ny or nx < 1:
        raise ValueError(f"{path}: wrong number of posts, got {z.size}, expected {nx} x {ny}")
    z[z == header.get("nodata_value", -9999.0)] = np.nan
    if dy < DEGREE_SPACING:
        dy, dx = _metric(path, dy, dx, south + 0.5 * (ny - 1) * dy)
    return Posts(z.reshape(ny, nx)[::-1], dy, dx)


def _hgt(path: Path) -> Posts:
    """Read an SRTM tile: big-endian int16, row 0 north, south-west corner in the name."""
    corner = re.fullmatch(r"([NS])(\d\d)[EW]\d{3}", path.stem.upper())
    if corner is None:
        raise ValueError(f"{path}: wrong name, got {path.name!r}, expected one like 'N36W085.hgt'")
    size = path.stat().st_size
    if size not in HGT_POSTS:
        kinds = " or ".join(str(known) for known in HGT_POSTS)
        raise ValueError(f"{path}: wrong size, got {size} bytes, expected {kinds}")
    n = HGT_POSTS[size]
    z = np.fromfile(path, dtype=">i2").reshape(n, n).astype(np.float64)
    z[z == HGT_VOID] = np.nan
    latitude = (1 if corner[1] == "N" else -1) * int(corner[2]) + 0.5
    north, east = _metric(path, 1.0 / (n - 1), 1.0 / (n - 1), latitude)
    return Posts(z[::-1], north, east, "SRTM")


def _tif(path: Path) -> Posts:
    """Read band 1 of a north-up GeoTIFF, in degrees or metres."""
    try:
        rasterio: Any = import_module("rasterio")
    except ModuleNotFoundError:
        raise ValueError(
            f"{path}: GeoTIFF needs rasterio, got none, expected `pip install rasterio`"
        ) from None
    try:
        with rasterio.open(path) as data:
            z = data.read(1, masked=True).astype(np.float64).filled(np.nan)
            t, crs = data.transform, data.crs
    except rasterio.errors.RasterioError as error:
        raise ValueError(f"{path}: broken, got {error}, expected a GeoTIFF") from None
    if t.b != 0 or t.d != 0 or t.e >= 0:
        raise ValueError(f"{path}: turned grid, expected north up and east right")
    if crs is None:
        raise ValueError(f"{path}: no coordinate system, expected one in degrees or metres")
    dy, dx = -t.e, t.a
    if crs.is_geographic:
        dy, dx = _metric(path, dy, dx, t.f - 0.5 * len(z) * dy)
    elif crs.linear_units.lower() not in ("metre", "meter", "m"):
        raise ValueError(f"{path}: wrong unit, got {crs.linear_units!r}, expected metres")
    return Posts(z[::-1], dy, dx)


def _metric(path: Path, dy: float, dx: float, latitude: float) -> tuple[float, float]:
    """Return spacings given in degrees as (north, east) in m."""
    if abs(latitude) > 85.0:
        raise ValueError(
            f"{path}: too near a pole, got latitude {latitude:g} deg, expected at most 85 deg"
        )
    north, east = metres_per_degree(latitude)
    return dy * north, dx * east
