"""Elevation files: orientation, spacing, holes, and what is said of a broken one."""

import importlib
import struct
import sys

import numpy as np
import pytest

from plant.terrain import Terrain, TerrainParameters
from plant.terrain_files import HGT_VOID, metres_per_degree, read_posts

# rows south to north; the highest post in the north-east
Z = np.arange(20.0).reshape(4, 5)


def write_npz(path, **changes):
    content = {
        "elevation": Z,
        "spacing_north_m": 10.0,
        "spacing_east_m": 20.0,
        "rows": "south to north",
        "attribution": "nobody",
    }
    np.savez_compressed(path, **{k: v for k, v in (content | changes).items() if v is not None})
    return path


ASC = """ncols 5
nrows 4
xllcorner 500000
yllcorner 4000000
cellsize 30
NODATA_value -1
"""


def asc_text(z=Z, header=ASC):
    return header + "\n".join(" ".join(f"{v:g}" for v in row) for row in z[::-1])


def test_jacksboro_is_the_original_with_north_up(scenarios):
    """The vendored Jacksboro model is matplotlib's, row 0 north although its limits are swapped."""
    cbook = pytest.importorskip("matplotlib.cbook")
    sample = cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False)
    with np.load(sample) as original:
        z, ymin, ymax = original["elevation"], float(original["ymin"]), float(original["ymax"])
        degrees = float(original["dy"]), float(original["dx"])
    posts = read_posts(scenarios / "terrain" / "jacksboro.npz")
    assert ymin > ymax
    np.testing.assert_array_equal(posts.elevation, z[::-1])
    assert (np.min(posts.elevation), np.max(posts.elevation)) == (236, 1076)
    per_degree = metres_per_degree(0.5 * (ymin + ymax))
    expected = [d * m for d, m in zip(degrees, per_degree, strict=True)]
    np.testing.assert_allclose((posts.spacing_north, posts.spacing_east), expected, atol=5e-4)


def test_jacksboro_surface(scenarios):
    """The summit stands where row 297 of the file, counted from the north, puts it."""
    terrain = Terrain(TerrainParameters(file=scenarios / "terrain" / "jacksboro.npz"))
    south, top, west, right = terrain.extent
    assert (top - south, right - west) == pytest.approx((343 * 92.475, 402 * 74.573))
    assert (top, right) == pytest.approx((-south, -west))
    north, east = top - 297 * 92.475, west + 219 * 74.573
    assert terrain.elevation(north, east) == pytest.approx(1076.0, abs=1e-6)
    assert "Jacksboro" in terrain.attribution


def test_volcano_faces_as_documented(scenarios):
    """Maunga Whau's crater rim is highest in the west half; its corners are R's corners."""
    posts = read_posts(scenarios / "terrain" / "volcano.npz")
    z = posts.elevation
    assert z.shape == (87, 61)
    assert (posts.spacing_north, posts.spacing_east) == (10.0, 10.0)
    assert (z.min(), z.max()) == (94, 195)
    # R: volcano[1, 1] = 100 south-east, [1, 61] = 103 south-west, [87, 1] = 97 north-east
    assert (z[0, -1], z[0, 0], z[-1, -1], z[-1, 0]) == (100, 103, 97, 94)


def test_npz_row_orders(tmp_path):
    """Rows may be stored either way; in memory they run south to north."""
    up = read_posts(write_npz(tmp_path / "up.npz"))
    down = read_posts(write_npz(tmp_path / "down.npz", elevation=Z[::-1], rows="north to south"))
    np.testing.assert_array_equal(up.elevation, Z)
    np.testing.assert_array_equal(down.elevation, Z)
    assert (up.spacing_north, up.spacing_east, up.attribution) == (10.0, 20.0, "nobody")


def test_asc_in_metres(tmp_path):
    """An ESRI grid starts in the north; its no-data value becomes NaN."""
    file = tmp_path / "grid.asc"
    z = Z.copy()
    z[0, 0] = -1
    file.write_text(asc_text(z))
    posts = read_posts(file)
    assert np.isnan(posts.elevation[0, 0])
    np.testing.assert_array_equal(posts.elevation.ravel()[1:], Z.ravel()[1:])
    assert (posts.spacing_north, posts.spacing_east) == (30.0, 30.0)


def test_asc_in_degrees(tmp_path):
    """A spacing below 0.1 means degrees, mapped to metres at the middle latitude."""
    file = tmp_path / "grid.asc"
    header = ASC.replace("500000", "-84").replace("4000000", "36").replace("30", "0.001")
    file.write_text(asc_text(header=header))
    posts = read_posts(file)
    north, east = metres_per_degree(36.002)
    assert posts.spacing_north == pytest.approx(0.001 * north, abs=1e-9)
    assert posts.spacing_east == pytest.approx(0.001 * east, abs=1e-9)


def test_hgt(tmp_path):
    """An SRTM tile is big-endian with row 0 north; its corner is its name; -32768 is a hole."""
    file = tmp_path / "S37E174.hgt"
    z = np.zeros((1201, 1201), dtype=">i2")
    z[0, 0], z[-1, -1] = 258, HGT_VOID
    file.write_bytes(z.tobytes())
    posts = read_posts(file)
    assert posts.elevation[-1, 0] == 258
    assert np.isnan(posts.elevation[0, -1])
    assert posts.spacing_east == pytest.approx(metres_per_degree(-36.5)[1] / 1200)


def test_a_degree_of_latitude():
    """WGS 84: 110.574 km at the equator, 111.694 km at the pole; 55.800 km of longitude at 60."""
    assert metres_per_degree(0.0) == pytest.approx((110574.3, 111319.5), abs=0.1)
    assert metres_per_degree(90.0)[0] == pytest.approx(111693.9, abs=0.1)
    assert metres_per_degree(60.0)[1] == pytest.approx(55800.0, abs=1.0)


def test_missing_file(tmp_path):
    """A missing file is reported by name."""
    with pytest.raises(FileNotFoundError, match=r"gone\.npz: no such terrain file"):
        read_posts(tmp_path / "gone.npz")


@pytest.mark.parametrize("keep", [0, 10, 200, -60])
def test_truncated_npz(tmp_path, keep):
    """A truncated archive is one line that names the file and the kind expected."""
    file = write_npz(tmp_path / "cut.npz")
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(ValueError, match=r"cut\.npz: broken, got .*expected a numpy \.npz") as e:
        read_posts(file)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("name", ["grid.npz", "grid.asc", "N36W085.hgt"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff\x80garbage", b"%PDF-1.4 nothing of the kind"])
def test_garbage(tmp_path, name, content):
    """Whatever a file contains, it is read or refused with a ValueError that names it."""
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(ValueError, match=name):
        read_posts(file)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"elevation": None}, "key missing, got no 'elevation'"),
        ({"rows": None}, "key missing, got no 'rows'"),
        ({"rows": "upwards"}, "wrong rows, got 'upwards'"),
        ({"spacing_north_m": -5.0}, "wrong spacing north, got -5 m"),
        ({"elevation": Z[:2]}, r"too few posts, got shape \(2, 5\)"),
        ({"elevation": Z[0]}, r"too few posts, got shape \(5,\)"),
        ({"elevation": np.full((4, 4), np.nan)}, "no data at all"),
        ({"elevation": np.full((4, 4), np.inf)}, "infinite elevation"),
        ({"elevation": np.array([["a"] * 4] * 4)}, "broken, got could not convert"),
    ],
)
def test_wrong_npz(tmp_path, changes, message):
    """Content that is no terrain is refused, with what was found."""
    with pytest.raises(ValueError, match=message):
        read_posts(write_npz(tmp_path / "wrong.npz", **changes))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (asc_text()[:-8], "wrong number of posts, got 16, expected 5 x 4"),
        (asc_text().replace("cellsize", "cells"), "wrong spacing north, got nan m"),
        (asc_text().replace("nrows", "rows"), "header incomplete, got no 'nrows'"),
        (asc_text().replace("17", "seventeen"), "broken, got could not convert"),
        (
            asc_text(header=ASC.replace("4000000", "88").replace("30", "0.01")),
            "too near a pole, got latitude 88.02 deg",
        ),
    ],
)
def test_wrong_asc(tmp_path, text, message):
    """A grid whose header and posts disagree is refused, with what was found."""
    file = tmp_path / "wrong.asc"
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_posts(file)


def test_wrong_hgt(tmp_path):
    """A tile of another size or without its corner in the name is refused."""
    short = tmp_path / "N36W085.hgt"
    short.write_bytes(struct.pack(">1000h", *range(1000)))
    with pytest.raises(
        ValueError, match="wrong size, got 2000 bytes, expected 2884802 or 25934402"
    ):
        read_posts(short)
    nameless = tmp_path / "tile.hgt"
    nameless.write_bytes(bytes(2 * 1201**2))
    with pytest.raises(ValueError, match=r"wrong name, got 'tile\.hgt'"):
        read_posts(nameless)


def test_unknown_kind(tmp_path):
    """A suffix that no reader knows is refused with the known ones."""
    with pytest.raises(ValueError, match=r"unknown kind of terrain, got '\.png', expected \.npz"):
        read_posts(tmp_path / "picture.png")


def test_geotiff_without_rasterio(tmp_path, monkeypatch):
    """Without rasterio the error says how to get it."""
    file = tmp_path / "a.tif"
    file.write_bytes(b"II*\x00")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(ValueError, match=r"expected `pip install rasterio`"):
        read_posts(file)


@pytest.mark.parametrize("crs", ["EPSG:32616", "EPSG:4326"])
def test_geotiff(tmp_path, crs):
    """A GeoTIFF in metres or degrees gives the same posts as its array, north up, holes as NaN."""
    rasterio = pytest.importorskip("rasterio")
    affine = importlib.import_module("affine")
    file, size = tmp_path / "a.tif", 30.0 if crs == "EPSG:32616" else 0.001
    z = Z.copy()
    z[1, 1] = -99
    with rasterio.open(
        file, "w", driver="GTiff", height=4, width=5, count=1, dtype="float32", crs=crs,
        transform=affine.Affine(size, 0.0, -84.0, 0.0, -size, 36.0), nodata=-99,
    ) as data:  # fmt: skip
        data.write(z[::-1].astype("float32"), 1)
    posts = read_posts(file)
    assert np.isnan(posts.elevation[1, 1])
    assert np.nansum(np.abs(posts.elevation - Z)) == 0.0
    expected = (30.0, 30.0) if size == 30.0 else np.multiply(metres_per_degree(35.998), 0.001)
    np.testing.assert_allclose((posts.spacing_north, posts.spacing_east), expected)


def test_broken_geotiff(tmp_path):
    """A GeoTIFF that rasterio cannot open is refused by name."""
    pytest.importorskip("rasterio")
    file = tmp_path / "a.tif"
    file.write_bytes(b"II*\x00garbage")
    with pytest.raises(ValueError, match=r"a\.tif: broken"):
        read_posts(file)
