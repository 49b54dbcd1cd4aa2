"""The terrain sensor: what is in a burst, when it comes, and that no reader loses one."""

import math

import numpy as np
import pytest
from fmpy.validation import validate_model_description
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.scan import SEEN, SHADOW, largest_burst
from plant.sensor import TerrainSensor, TerrainSensorParameters
from plant.terrain import Terrain, TerrainParameters, height

TICK = 0.05
SCALARS = ("scan.sequence", "scan.count", "scan.stamp", "scan.cell_size")
RING = ("scan.north", "scan.east", "scan.elevation", "scan.source")


@pytest.fixture(scope="module")
def hills():
    return Terrain(TerrainParameters(shape="fractal", extent_m=4000.0, seed=2))


def pose(north=0.0, east=0.0, altitude=60.0, psi=0.0):
    values = {"north": north, "east": east, "down": -altitude, "phi": 0.3, "theta": 0.2, "psi": psi}
    return {f"pose.{name}": value for name, value in values.items()}


def started(terrain, seed=0, at=None, **parameters):
    sensor = TerrainSensor(TerrainSensorParameters(**parameters), terrain=terrain)
    sensor.set(at or pose())
    sensor.initialize(start_time=0.0, seed=seed)
    return sensor


def fly(sensor, ticks, first=0):
    """Step the sensor along north at 30 m/s; return (stamps delivered, times of delivery)."""
    stamps, times, sequence = [], [], sensor.get(SCALARS)["scan.sequence"]
    for k in range(first, first + ticks):
        sensor.set({"pose.north": 30.0 * k * TICK})
        sensor.step(k * TICK, TICK)
        values = sensor.get(SCALARS)
        if values["scan.sequence"] != sequence:
            sequence = values["scan.sequence"]
            stamps.append(values["scan.stamp"])
            times.append(k * TICK)
    return np.array(stamps), np.array(times)


def cells(sensor, since=0):
    """Return what a reader finds that has read ``since`` cells: (n, 4) rows, oldest first."""
    values = sensor.get([*SCALARS, *RING])
    capacity = len(values["scan.north"])
    assert values["scan.count"] - since <= capacity
    index = np.arange(since, values["scan.count"]) % capacity
    return np.column_stack([values[name][index] for name in RING])


@given(
    north=st.floats(-900, 900),
    east=st.floats(-900, 900),
    psi=st.floats(-7, 7),
    view=st.tuples(st.floats(50, 400), st.floats(10, 360), st.floats(0, 100), st.floats(7, 40)),
)
@settings(max_examples=25)
def test_a_burst_is_every_cell_in_view(hills, north, east, psi, view):
    """A burst holds all lattice points of sector and disc, once, with their true elevation."""
    reach, fov, near, cell = view
    sensor = started(
        hills, at=pose(north, east, psi=psi),
        range_m=reach, field_of_view_deg=fov, near_m=near, cell_size_m=cell, scan_capacity=50_000,
    )  # fmt: skip
    k = np.arange(-200, 201) * cell
    n, e = (v.ravel() for v in np.meshgrid(k, k, indexing="ij"))
    r = np.hypot(n - north, e - east)
    bearing = np.arctan2(e - east, n - north) - psi
    off = np.abs((bearing + math.pi) % (2 * math.pi) - math.pi)
    half = math.radians(fov) / 2
    known = (np.abs(n) <= 2000) & (np.abs(e) <= 2000)
    surely = known & ((r < near - 1e-6) | ((r < reach - 1e-6) & (off < half - 1e-6)))
    perhaps = known & ((r <= near + 1e-6) | ((r <= reach + 1e-6) & (off <= half + 1e-6)))
    got = cells(sensor)
    found = {tuple(row) for row in got[:, :2]}
    assert len(found) == len(got) <= largest_burst(TerrainSensorParameters(
        range_m=reach, field_of_view_deg=fov, near_m=near, cell_size_m=cell).view)  # fmt: skip
    assert {*zip(n[surely], e[surely], strict=True)} <= found
    assert found <= {*zip(n[perhaps], e[perhaps], strict=True)}
    np.testing.assert_allclose(got[:, 2], hills.elevation(got[:, 0], got[:, 1]), atol=1e-10)
    assert np.all(got[:, 3] == SEEN)


def test_first_burst_comes_at_once(hills):
    """Right after initialize with a pose there is a map, whatever latency and drop-out."""
    sensor = started(hills, latency_min_s=0.4, latency_max_s=0.5, drop_out=0.99)
    values = sensor.get(SCALARS)
    assert values["scan.sequence"] == 1
    assert values["scan.stamp"] == 0.0
    assert values["scan.count"] == len(cells(sensor)) > 1000
    sensor.step(0.0, TICK)
    assert sensor.get(SCALARS) == values


def test_first_burst_waits_for_a_pose(hills):
    """Without a pose before initialize, the first burst is taken by the first step."""
    sensor = TerrainSensor(TerrainSensorParameters(), terrain=hills)
    sensor.initialize(start_time=0.0)
    assert sensor.get(["scan.sequence"]) == {"scan.sequence": 0}
    sensor.set(pose(north=200.0))
    sensor.step(0.0, TICK)
    assert sensor.get(["scan.sequence"]) == {"scan.sequence": 1}
    np.testing.assert_array_equal(cells(sensor), cells(started(hills, at=pose(north=200.0))))


def test_timing(hills):
    """Intervals follow min + Gamma(2, mean) and latencies the uniform law, rounded up to ticks."""
    sensor = started(hills, seed=3, range_m=50.0, near_m=0.0)
    stamps, times = fly(sensor, 40000, first=1)
    interval, latency = np.diff(stamps), times - stamps
    assert np.all(interval > 0.1 - TICK)
    assert np.mean(interval) == pytest.approx(0.6, rel=0.03)
    assert np.std(interval) == pytest.approx(math.sqrt(0.5 * 0.5**2 + TICK**2 / 6), rel=0.05)
    assert np.all(latency > TICK - 1e-9)
    assert np.mean(latency > 0.1 + 1e-9) < 0.005  # those that waited for room
    # latency in (0.02, 0.05] is one tick, in (0.05, 0.1] two
    assert np.mean(latency < 0.075) == pytest.approx(0.03 / 0.08, abs=0.03)


def test_drop_out_loses_its_share(hills):
    """A share of the bursts is lost; what is measured, and when, does not change."""
    kept, _ = fly(started(hills, seed=4, range_m=50.0), 20000, first=1)
    left, _ = fly(started(hills, seed=4, range_m=50.0, drop_out=0.25), 20000, first=1)
    assert set(left) <= set(kept)
    assert len(left) / len(kept) == pytest.approx(0.75, abs=0.05)


@given(seed=st.integers(0, 2**32), phase=st.integers(0, 9))
@settings(max_examples=20)
def test_a_2_hz_reader_loses_nothing(hills, seed, phase):
    """Whoever reads every 0.5 s finds all cells of all bursts, even when bursts come thick."""
    law = {
        "min_interval_s": 0.05, "mean_interval_s": 0.25, "latency_max_s": 0.3, "scan_capacity": 600,
    }  # fmt: skip
    sensor, often = (started(hills, seed=seed, range_m=100.0, **law) for _ in range(2))
    read, everything = cells(sensor), [cells(often)]
    for k in range(1, 100):
        now = pose(north=30.0 * k * TICK, psi=0.1 * k)
        before = often.get(["scan.count"])["scan.count"]
        for one in (sensor, often):
            one.set(now)
            one.step(k * TICK, TICK)
        everything.append(cells(often, before))
        if k % 10 == phase:
            read = np.vstack([read, cells(sensor, len(read))])
    np.testing.assert_array_equal(read, np.vstack(everything)[: len(read)])
    assert sensor.get(["scan.sequence"])["scan.sequence"] > 10


def test_bursts_keep_their_order_and_all_arrive(hills):
    """Bursts are delivered in the order of measurement, one after another, and none twice."""
    law = {"latency_min_s": 0.0, "latency_max_s": 2.0, "mean_interval_s": 0.2}
    stamps, times = fly(started(hills, seed=1, range_m=80.0, **law), 4000, first=1)
    assert np.all(np.diff(stamps) > 0)
    assert np.all(times >= stamps)


def test_seed_decides(hills):
    """Equal seeds give equal bursts; another seed gives others."""
    a, b, c = (fly(started(hills, seed=seed, noise_m=0.1), 200, first=1) for seed in (5, 5, 6))
    np.testing.assert_array_equal(a, b)
    assert len(a[0]) != len(c[0]) or np.any(a[0] != c[0])


def test_state_round_trip_is_exact(hills):
    """A sensor restored in the middle continues bit for bit, pending bursts and noise included."""
    law = {"latency_min_s": 2.0, "latency_max_s": 3.0, "noise_m": 0.2, "drop_out": 0.2}
    sensor = started(hills, seed=7, **law)
    fly(sensor, 60, first=1)
    saved = sensor.get_state()
    copy = TerrainSensor(TerrainSensorParameters(**law), terrain=hills)
    copy.set_state(saved)
    assert copy.get_state() == saved
    np.testing.assert_array_equal(fly(sensor, 200, first=61), fly(copy, 200, first=61))
    first, second = sensor.get([*SCALARS, *RING]), copy.get([*SCALARS, *RING])
    for name, value in first.items():
        np.testing.assert_array_equal(value, second[name])
    sensor.set_state(saved)
    assert sensor.get_state() == saved


def sight(terrain, eye, cell, step=0.5):
    """Return the elevation below which a cell is hidden, densely sampled in numpy."""
    r = math.hypot(cell[0] - eye[0], cell[1] - eye[1])
    s = np.arange(step, r, step) / r
    if not s.size:
        return -math.inf
    h = terrain.elevation(eye[0] + s * (cell[0] - eye[0]), eye[1] + s * (cell[1] - eye[1]))
    return eye[2] + r * np.max((h - eye[2]) / (s * r))


@given(north=st.floats(-900, 900), psi=st.floats(0, 6.3), above=st.floats(1, 30))
@settings(max_examples=20)
def test_shadow_bound_is_an_upper_bound(hills, north, psi, above):
    """A hidden cell's bound is above its ground and on the line of sight; a seen one is exact."""
    altitude = float(hills.elevation(north, 0.0)) + above
    at = pose(north, 0.0, altitude, psi)
    got = cells(started(hills, at=at, occlusion=True))
    hidden, seen = got[got[:, 3] == SHADOW], got[got[:, 3] == SEEN]
    every = cells(started(hills, at=at))
    np.testing.assert_array_equal(got[:, :2], every[:, :2])
    assert np.all(hidden[:, 2] > hills.elevation(hidden[:, 0], hidden[:, 1]))
    np.testing.assert_array_equal(seen[:, 2], every[got[:, 3] == SEEN, 2])
    for cell in got[:: max(len(got) // 20, 1)]:
        below = sight(hills, (north, 0.0, altitude), cell)
        # samples 5 m apart miss a crest by little
        assert cell[2] <= max(below, height(hills.grid, cell[0], cell[1])) + 1e-9
        if cell[3] == SHADOW:
            assert cell[2] == pytest.approx(below, abs=2.0)


def test_a_wall_hides_what_is_behind():
    """Behind a step seen from below, the ground is bounded by the line over its edge."""
    wall = Terrain(
        TerrainParameters(
            shape="step", extent_m=1500.0, height_m=40.0, start_m=100.0, run_m=20.0, spacing_m=5.0
        )
    )
    got = cells(started(wall, at=pose(altitude=10.0), occlusion=True, field_of_view_deg=30.0))
    ahead = got[(got[:, 1] == 0.0) & (got[:, 0] > 0.0)]
    assert np.all(ahead[ahead[:, 0] <= 100.0, 3] == SEEN)
    behind = ahead[ahead[:, 0] >= 140.0]
    assert np.all(behind[:, 3] == SHADOW)
    np.testing.assert_allclose(behind[:, 2], 10.0 + behind[:, 0] * 0.25, rtol=0.03)


def test_noise_is_on_seen_cells(hills):
    """Noise has the stated deviation and is added to what is seen."""
    at = pose(altitude=200.0)
    noise = cells(started(hills, at=at, noise_m=0.5))[:, 2] - cells(started(hills, at=at))[:, 2]
    assert np.std(noise) == pytest.approx(0.5, rel=0.1)
    assert abs(np.mean(noise)) < 0.05


def test_ground_outside_is_left_out(hills):
    """At the edge of the terrain only what is known is delivered; beyond it, nothing."""
    edge = cells(started(hills, at=pose(north=1990.0)))
    assert len(edge) > 0
    assert np.max(edge[:, 0]) <= 2000.0
    assert len(cells(started(hills, at=pose(north=9000.0)))) == 0
    assert len(cells(started(hills, at=pose(north=math.nan)))) == 0


def test_a_ring_once_got_never_changes(hills):
    """Arrays that were got are read-only, and later deliveries leave them as they were."""
    sensor = started(hills)
    first = sensor.get(["scan.north"])["scan.north"]
    before = first.copy()
    assert not first.flags.writeable
    for k in range(1, 60):
        sensor.set(pose(north=30.0 * k * TICK))
        sensor.step(k * TICK, TICK)
    assert not np.array_equal(sensor.get(["scan.north"])["scan.north"], before)
    np.testing.assert_array_equal(first, before)


def test_description(hills):
    """The description is valid FMI 3; the ring's shape and type and the feed-through are in it."""
    sensor = TerrainSensor(TerrainSensorParameters(), terrain=hills)
    md = sensor.describe()
    assert not validate_model_description(md)
    by_name = {v.name: v for v in md.modelVariables}
    capacity = TerrainSensorParameters().scan_capacity
    assert [by_name[n].dimensions[0].start for n in RING] == [str(capacity)] * 4
    assert [by_name[n].type for n in RING] == ["Float64"] * 3 + ["Int64"]
    feeds = {u.variable.name: {d.name for d in u.dependencies} for u in md.outputs}
    assert feeds["scan.north"] == set(pose())
    values = sensor.get([u.variable.name for u in md.outputs])
    assert values["scan.source"].dtype == np.int64
    assert len(values["scan.north"]) == capacity


def test_errors(hills):
    """Unknown names, impossible latencies and endless bursts are refused by name."""
    sensor = TerrainSensor(TerrainSensorParameters(), terrain=hills)
    with pytest.raises(KeyError, match=r"did you mean 'pose.north'"):
        sensor.set({"pose.nort": 1.0})
    with pytest.raises(KeyError, match=r"did you mean 'scan.count'"):
        sensor.get(["scan.counts"])
    with pytest.raises(ValueError, match=r"sensor.latency_max_s: too small, got 0.1 s"):
        TerrainSensorParameters(latency_min_s=0.2)
    with pytest.raises(ValueError, match=r"sensor.scan_capacity: too small .* got 2000 cells"):
        TerrainSensor(
            TerrainSensorParameters(scan_capacity=2000, mean_interval_s=0.1), terrain=hills
        )
    with pytest.raises(ValueError, match=r"sensor.cell_size_m: too many cells in a burst"):
        TerrainSensor(TerrainSensorParameters(cell_size_m=0.5), terrain=hills)
