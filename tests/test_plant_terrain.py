"""The terrain surface: what a C2 interpolating spline must be, and where it must refuse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from plant.terrain import Terrain, TerrainGrid, TerrainParameters, height, height_and_slope
from plant.terrain_grid import EDGE, spline_coefficients

SPACING = (7.0, 11.0)


def grid_of(elevation):
    return TerrainGrid(spline_coefficients(elevation), -100.0, 50.0, *SPACING)


def posts(ny, nx):
    return -100.0 + SPACING[0] * np.arange(ny), 50.0 + SPACING[1] * np.arange(nx)


@pytest.fixture(scope="module")
def rough():
    """Return a surface of random posts (20, 24), up to 50 m high, and its posts."""
    z = 50.0 * np.random.default_rng(3).random((20, 24))
    return grid_of(z), z


@pytest.fixture(scope="module")
def hills():
    return Terrain(TerrainParameters(shape="fractal", extent_m=2000.0, seed=5))


inside = st.tuples(st.floats(0, 19 * SPACING[0]), st.floats(0, 23 * SPACING[1]))


def test_interpolates_the_posts(rough):
    """The surface passes through every post, those on the edges included."""
    grid, z = rough
    north, east = posts(*z.shape)
    got = [[height(grid, n, e) for e in east] for n in north]
    np.testing.assert_allclose(got, z, atol=1e-12)


def test_reproduces_cubics():
    """Away from the natural ends a bicubic polynomial is reproduced, value and slope."""
    north, east = posts(81, 81)
    rng = np.random.default_rng(1)
    c = rng.standard_normal((4, 4))
    d = np.array([1.0, 2.0, 3.0])[:, None]

    def scaled(n, e):
        return (n - north[40]) / 100.0, (e - east[40]) / 100.0

    def p(n, e, c):
        y, x = np.broadcast_arrays(*scaled(n, e))
        return np.polynomial.polynomial.polyval2d(y, x, c)

    grid = grid_of(p(north[:, None], east, c))
    for n, e in zip(rng.uniform(150, 210, 50), rng.uniform(450, 530, 50), strict=True):
        h, h_n, h_e = height_and_slope(grid, n, e)
        assert h == pytest.approx(p(n, e, c), abs=1e-9)
        assert h_n == pytest.approx(p(n, e, d * c[1:]) / 100.0, abs=1e-9)
        assert h_e == pytest.approx(p(n, e, d.T * c[:, 1:]) / 100.0, abs=1e-9)


@given(inside)
def test_kernel_is_the_tensor_product_spline(rough, point):
    """A height is the tensor product of two uniform cubic B-splines, as scipy evaluates them."""
    grid, z = rough
    ny, nx = z.shape
    y, x = point[0] / SPACING[0], point[1] / SPACING[1]
    basis_n, basis_e = (
        BSpline.design_matrix([v], np.arange(-3.0, n + 3.0), 3, extrapolate=True).toarray()[0]
        for v, n in ((y, ny), (x, nx))
    )
    expected = basis_n @ grid.coefficients @ basis_e
    assert height(grid, -100.0 + point[0], 50.0 + point[1]) == pytest.approx(expected, abs=1e-9)


@given(inside)
def test_compiled_equals_plain_python(rough, point):
    """Compiled and plain kernels agree to rounding, and so do the two kernels in h."""
    grid, _ = rough
    n, e = -100.0 + point[0], 50.0 + point[1]
    h, h_n, h_e = height_and_slope(grid, n, e)
    assert height(grid, n, e) == pytest.approx(h, rel=1e-13, abs=1e-13)
    plain = height_and_slope.py_func(grid, n, e)
    np.testing.assert_allclose((h, h_n, h_e), plain, rtol=1e-13, atol=1e-13)


@given(inside)
def test_slope_is_the_gradient(rough, point):
    """The analytic slope equals the central difference of the height."""
    grid, _ = rough
    step = 1e-3
    n = min(max(-100.0 + point[0], -100.0 + step), -100.0 + 19 * SPACING[0] - step)
    e = min(max(50.0 + point[1], 50.0 + step), 50.0 + 23 * SPACING[1] - step)
    _, h_n, h_e = height_and_slope(grid, n, e)
    by_n = (height(grid, n + step, e) - height(grid, n - step, e)) / (2 * step)
    by_e = (height(grid, n, e + step) - height(grid, n, e - step)) / (2 * step)
    assert (h_n, h_e) == (pytest.approx(by_n, abs=1e-4), pytest.approx(by_e, abs=1e-4))


@given(st.integers(1, 18), st.floats(1, 22 * SPACING[1]))
def test_curvature_is_continuous_across_posts(rough, i, along):
    """Height, slope and curvature are the same on both sides of a line of posts."""
    grid, _ = rough
    n, e = -100.0 + i * SPACING[0], 50.0 + along
    tiny, step = 1e-7, 1e-3

    def curvature(at, side):
        slopes = [height_and_slope(grid, at + side * k * step, e)[1] for k in (0, 1)]
        return side * (slopes[1] - slopes[0]) / step

    left, right = height_and_slope(grid, n - tiny, e), height_and_slope(grid, n + tiny, e)
    np.testing.assert_allclose(left, right, atol=1e-5)
    assert curvature(n - tiny, -1) == pytest.approx(curvature(n + tiny, 1), abs=2e-2)


@pytest.mark.parametrize("point", [(-101, 60), (34, 60), (0, 49), (0, 304), (math.nan, 60)])
def test_kernels_give_nan_outside(rough, point):
    """Outside the grid the kernels return NaN, never the value at the edge."""
    assert math.isnan(height(rough[0], *map(float, point)))
    assert all(math.isnan(v) for v in height_and_slope(rough[0], *map(float, point)))


def test_rounding_at_the_edge_is_not_outside(rough):
    """A post on the edge computed with rounding errors is still on the surface."""
    assert not math.isnan(height(rough[0], -100.0 - 0.5 * EDGE * SPACING[0], 50.0))


def test_outside_is_an_error(hills):
    """The numpy methods refuse a point outside, naming the point and the extent."""
    with pytest.raises(ValueError, match=r"point outside, got north 1500 m, east 3 m, .*1000 m"):
        hills.elevation([0.0, 1500.0], 3.0)
    with pytest.raises(ValueError, match="point outside"):
        hills.slope(0.0, -1001.0)
    assert hills.contains(0.0, 0.0)
    assert not hills.contains(0.0, -1001.0)


def test_hole_is_an_error_and_nothing_else_is():
    """Near a missing post there is no height; elsewhere the posts are met exactly."""
    z = 50.0 * np.random.default_rng(4).random((20, 24))
    z[10, 12] = np.nan
    grid = grid_of(z)
    north, east = posts(20, 24)
    for i in range(19):
        for j in range(23):
            h = height(grid, north[i] + 1e-6, east[j] + 1e-6)
            near = -2 <= i - 10 <= 1 and -2 <= j - 12 <= 1
            assert math.isnan(h) == near
            assert near or h == pytest.approx(z[i, j], abs=1e-4)


def test_numpy_methods_broadcast(hills):
    """Points broadcast; elevation and slope are the kernel's values."""
    north, east = np.array([[0.0], [20.0]]), np.array([1.0, 2.0, 3.0])
    z, (z_n, z_e) = hills.elevation(north, east), hills.slope(north, east)
    assert z.shape == z_n.shape == z_e.shape == (2, 3)
    assert (z[1, 2], z_n[1, 2], z_e[1, 2]) == height_and_slope(hills.grid, 20.0, 3.0)


def test_surface_is_the_posts(hills):
    """The posts given for pictures are points of the surface."""
    north, east, z = hills.surface()
    np.testing.assert_allclose(hills.elevation(north[:, None], east), z, atol=1e-10)
    assert (north[0], north[-1], east[0], east[-1]) == hills.extent


def test_shapes():
    """Each shape has its foot, its rise and its slope where the parameters say."""

    def made(shape, **kw):
        return Terrain(TerrainParameters(shape=shape, elevation_m=100.0, extent_m=2000.0, **kw))

    assert made("flat").elevation(-77.0, 77.0) == pytest.approx(100.0, abs=1e-9)
    step = made("step", height_m=20.0, start_m=0.0, run_m=200.0)
    np.testing.assert_allclose(step.elevation([-50, 100, 250], 0), [100, 110, 120], atol=1e-3)
    ramp = made("ramp", height_m=100.0, start_m=0.0, slope_deg=20.0, bearing_deg=90.0)
    assert ramp.slope(33.0, 150.0)[1] == pytest.approx(math.tan(math.radians(20.0)), abs=1e-6)
    assert ramp.slope(33.0, 150.0)[0] == pytest.approx(0.0, abs=1e-9)
    ridges = made("cosine_ridges", height_m=40.0, start_m=0.0, wavelength_m=400.0)
    np.testing.assert_allclose(ridges.elevation([-99, 200, 400], 7), [100, 140, 100], atol=0.01)


def test_fractal_is_its_seed(hills):
    """A fractal has the stated rms, is a function of seed and place, and differs with the seed."""
    wide = Terrain(TerrainParameters(shape="fractal", seed=5))
    assert np.std(wide.surface()[2]) == pytest.approx(30.0 / math.sqrt(8.0), rel=0.1)
    moved = Terrain(TerrainParameters(shape="fractal", seed=5, origin_north_m=100.0))
    assert moved.elevation(0.0, 0.0) == pytest.approx(hills.elevation(100.0, 0.0), abs=1e-9)
    other = Terrain(TerrainParameters(shape="fractal", extent_m=2000.0, seed=6))
    assert abs(other.elevation(0.0, 0.0) - hills.elevation(0.0, 0.0)) > 0.1


def test_roughness_is_added_and_labelled(scenarios):
    """Synthetic roughness has the stated rms over the ground it is laid on, and is named."""
    file = scenarios / "terrain" / "jacksboro.npz"
    smooth = Terrain(TerrainParameters(file=file, extent_m=3000.0))
    rough = Terrain(TerrainParameters(file=file, extent_m=3000.0, roughness_rms_m=1.5))
    north, east, z = rough.surface()
    added = z - smooth.elevation(north[:, None], east)
    assert np.sqrt(np.mean(added**2)) == pytest.approx(1.5, rel=0.05)
    assert "synthetic sub-grid roughness of 1.5 m rms" in rough.attribution
    assert "synthetic" not in smooth.attribution


def test_extent_keeps_the_same_ground(scenarios):
    """A crop around another origin is the same surface, away from its own edges."""
    file = scenarios / "terrain" / "jacksboro.npz"
    whole = Terrain(TerrainParameters(file=file))
    place = {"origin_north_m": 2000.0, "origin_east_m": -3000.0}
    crop = Terrain(TerrainParameters(file=file, extent_m=4000.0, **place))
    assert crop.elevation(10.0, 20.0) == pytest.approx(whole.elevation(2010.0, -2980.0), abs=1e-3)
    south, top, west, right = crop.extent
    assert south <= -2000 <= 2000 <= top
    assert west <= -2000 <= 2000 <= right
    assert top - south < 4300


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "got neither, expected file or shape"),
        ({"shape": "flat", "file": "x.npz"}, "got both, expected file or shape"),
    ],
)
def test_exactly_one_source(values, message):
    """A terrain comes from a file or from a shape."""
    with pytest.raises(ValueError, match=message):
        TerrainParameters(**values)


def test_refused_sizes_and_origins(scenarios):
    """Too many posts, too few posts and an origin outside the data are refused by key."""
    file = scenarios / "terrain" / "jacksboro.npz"
    with pytest.raises(ValueError, match=r"terrain.extent_m: too many posts, got .* at most"):
        Terrain(TerrainParameters(file=file, roughness_rms_m=1.0))
    with pytest.raises(ValueError, match=r"terrain.extent_m: too many posts"):
        Terrain(TerrainParameters(shape="flat", extent_m=1e6))
    with pytest.raises(ValueError, match="too few posts"):
        Terrain(TerrainParameters(shape="flat", extent_m=20.0))
    with pytest.raises(ValueError, match=r"terrain.origin_east_m: outside the data, got 20000 m"):
        Terrain(TerrainParameters(file=file, origin_east_m=20000.0))
