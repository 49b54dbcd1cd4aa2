"""The reference: continued over newly sensed terrain, never changed where it is committed."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.course import make_course, position
from controller.reference import ReferenceParameters, extend, project, sample, start
from controller.spline import KNOT_M
from controller.terrain_map import empty_map, update

COURSE = make_course([(0.0, 0.0), (4000.0, 0.0)], 30.0)
BENT = make_course([(0.0, 0.0), (700.0, 0.0), (1300.0, 600.0), (1300.0, 2000.0)], 30.0)
DEFAULT = ReferenceParameters()


def scan(terrain_map, terrain, north, east, heading, sight):
    """Return the map with a forward sector of terrain(north, east) added, +-45 deg."""
    cell = terrain_map.cell_size
    n, e = np.meshgrid(
        np.arange(north // cell - sight // cell, north // cell + sight // cell + 2) * cell,
        np.arange(east // cell - sight // cell, east // cell + sight // cell + 2) * cell,
        indexing="ij",
    )
    ahead = (n - north) * np.cos(heading) + (e - east) * np.sin(heading)
    distance = np.hypot(n - north, e - east)
    near = (distance < sight) & (distance > 2.0) & (ahead >= distance * np.cos(np.pi / 4))
    h = np.broadcast_to(terrain(n, e), n.shape)
    return update(
        terrain_map, n[near], e[near], h[near].astype(float), np.ones(near.sum(), np.int64)
    )


def begin(terrain, course=COURSE, parameters=DEFAULT, sight=400.0):
    """Return the map of a first scan at the start, and the reference over it."""
    north, east = position(course, 0.0, 0.0)
    heading = course.heading[int(-course.first)]
    terrain_map = scan(empty_map(10.0), terrain, north, east, heading, sight)
    altitude = float(terrain(north, east)) + parameters.height_agl_m
    return terrain_map, start(course, terrain_map, parameters, altitude=altitude)


def fly(terrain, until, course=COURSE, parameters=DEFAULT, sight=400.0, stride=15.0):
    """Yield (station, reference, map) of a flight that scans and extends every ``stride`` metres."""
    terrain_map, reference = begin(terrain, course, parameters, sight)
    station = 0.0
    while station < until:
        yield station, reference, terrain_map
        station += stride
        at = sample(reference, [station])
        terrain_map = scan(terrain_map, terrain, at.north[0], at.east[0], at.heading[0], sight)
        reference = extend(reference, terrain_map, station, parameters)


def flown(flight):
    """Return what was flown of a flight: north, east, altitude, heading, speed, slope (6, K)."""
    pieces, last = [], None
    for station, reference, _ in flight:
        if last is not None:
            pieces.append(np.array(sample(last[1], np.arange(last[0], station))))
        last = station, reference
    return np.concatenate(pieces, axis=1)


def flat(_n, _e):
    """Return level ground at 100 m."""
    return np.float64(100.0)


def hills(n, e):
    """Return hills about as rough as the Jacksboro model's."""
    return 10 * np.sin(n / 70) + 3 * np.sin(n / 45 + e / 50) + 10 * np.cos(e / 80)


def ridges(n, _e):
    """Return ridges 40 m high, 200 m apart, the first at 250 m."""
    return 20 * (1 - np.cos(2 * np.pi * np.maximum(n - 150, 0) / 200))


def committed(reference):
    """Return the station that the next planning will leave alone at least."""
    return reference.knot * KNOT_M


def test_flat_ground_gives_exactly_the_set_height():
    """Over flat ground altitude, speed and heading are the set ones, all the way."""
    for _, reference, _ in fly(flat, 300.0):
        np.testing.assert_allclose(reference.path.altitude, 110.0, atol=1e-6)
        np.testing.assert_array_equal(reference.path.heading, 0.0)
        np.testing.assert_allclose(reference.path.east, 0.0, atol=1e-9)
        known = int(reference.known_until - reference.path.start)
        np.testing.assert_array_equal(reference.path.speed[: known + 1], 30.0)
        assert reference.status == "fitted"


@pytest.mark.parametrize("sight", [150.0, 400.0])
def test_hills_are_followed(sight):
    """Smooth terrain is followed within 0.3 m, 0.06 m rms, at 30 m/s, and never below 9.3 m."""
    north, east, altitude, _, speed, _ = flown(fly(hills, 1200.0, sight=sight))
    error = altitude - hills(north, east) - 10.0
    assert np.sqrt(np.mean(error**2)) < 0.06
    assert np.abs(error).max() < 0.3
    np.testing.assert_array_equal(speed, 30.0)


@pytest.mark.parametrize("corridor", [0.0, 100.0])
@pytest.mark.parametrize("terrain", [hills, ridges])
def test_what_is_committed_never_changes(terrain, corridor):
    """After an extension everything up to the commit distance is the same to the last bit."""
    parameters = replace(DEFAULT, corridor_m=corridor)
    last = None
    for station, reference, _ in fly(terrain, 600.0, BENT, parameters):
        if last is not None:
            assert committed(reference) >= station + 2.5 * 30 * 0.6
            both = np.arange(reference.path.start, committed(reference) + 1)
            for before, after in zip(sample(last, both), sample(reference, both), strict=True):
                np.testing.assert_array_equal(before, after)
        last = reference


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=8)
def test_an_extension_continues_smoothly(seed):
    """Offset and altitude keep the coefficients of position, slope and curvature at the joint."""
    rng = np.random.default_rng(seed)
    phase, length = rng.uniform(0, 6, 6), rng.uniform(15, 60, 6)

    def terrain(n, e):
        waves = [
            np.sin(np.cos(a) * n / w + np.sin(a) * e / w)
            for a, w in zip(phase, length, strict=True)
        ]
        return 4.0 * sum(waves)

    parameters = replace(DEFAULT, corridor_m=60.0)
    last = None
    for _, reference, _ in fly(
        terrain, 200.0, parameters=parameters, stride=float(rng.uniform(5, 40))
    ):
        if last is not None:
            now, then = reference.knot - reference.first_span, reference.knot - last.first_span
            for name in ("lateral", "altitude"):
                kept = getattr(reference, name)[: now + 3]
                np.testing.assert_array_equal(kept, getattr(last, name)[then - now : then + 3])
        last = reference
        # the path's own slope agrees with its altitude, so nothing jumps between samples either
        rise = np.gradient(reference.path.altitude)[1:-1]
        np.testing.assert_allclose(rise, reference.path.slope[1:-1], atol=2e-3)


def test_without_news_the_reference_stays():
    """With no new terrain, no new wish and enough left ahead the same object comes back."""
    terrain_map, reference = begin(hills)
    assert extend(reference, terrain_map, 0.0) is reference
    assert extend(reference, terrain_map, 5.0, replace(DEFAULT)) is reference


def test_the_aircraft_only_moves_the_commitment():
    """Seen from two stations the same terrain gives the same plan where neither is committed."""
    terrain_map, reference = begin(hills)
    scanned = scan(terrain_map, hills, 60.0, 0.0, 0.0, 400.0)
    near, far = extend(reference, scanned, 0.0), extend(reference, scanned, 60.0)
    stations = np.arange(200.0, 400.0)
    np.testing.assert_allclose(
        sample(near, stations).altitude, sample(far, stations).altitude, atol=0.02
    )


@pytest.mark.parametrize("sight", [150.0, 400.0])
def test_ridges_are_cleared(sight):
    """Ridges too sharp for the load limits are cleared by the hard margin, at up to 35 deg."""
    north, east, altitude, *_ = flown(fly(ridges, 1200.0, sight=sight))
    assert (altitude - ridges(north, east)).min() >= 9.0 - 0.05


def test_a_late_surprise_slows_the_flight():
    """Where the clearance demands more load than allowed the speed falls, at most at the limit."""
    north, east, altitude, _, speed, slope = flown(fly(ridges, 1200.0, sight=120.0))
    assert speed.min() < 27.0
    assert (np.diff(speed**2) / 2).min() >= -DEFAULT.deceleration_mps2 - 1e-9
    assert (np.diff(speed**2) / 2).max() <= DEFAULT.acceleration_mps2 + 1e-9
    assert np.isfinite(slope).all()
    assert (altitude - ridges(north, east)).min() > 5.0


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=10)
def test_random_terrain_is_cleared_or_the_status_says_so(seed):
    """Over random terrain, seen 400 m ahead, the plan clears all it knows, or is called capped."""
    rng = np.random.default_rng(seed)
    length, phase = rng.uniform(15, 60, 8), rng.uniform(0, 6, 8)

    def terrain(n, e):
        return sum(
            0.15 * w * np.sin((n * np.cos(a) + e * np.sin(a)) / w)
            for w, a in zip(length, phase, strict=True)
        )

    for _, reference, _ in fly(terrain, 150.0, stride=30.0):
        known = np.arange(max(committed(reference), 30.0), reference.known_until)
        at = sample(reference, known)
        assert np.isfinite(at.altitude).all()
        if reference.status in ("fitted", "strained"):
            # the map between cells 10 m apart misses a little of so short waves
            assert (at.altitude - terrain(at.north, at.east)).min() >= 8.5


def test_known_until_is_where_the_sensed_terrain_ends():
    """It is the sensor's range ahead, to a cell, and grows with the flight."""
    _, reference = begin(hills)
    assert 380.0 <= reference.known_until <= 400.0
    stations = [(s, r.known_until) for s, r, _ in fly(hills, 200.0)]
    assert all(360.0 <= known - station <= 400.0 for station, known in stations)


def test_a_gap_ends_the_known_terrain():
    """A stretch without cells longer than the map's own gaps ends what is known; a cell does not."""
    n, e = np.meshgrid(np.arange(0, 400, 10.0), np.arange(-50, 51, 10.0), indexing="ij")
    for missing, known in ((slice(20, 21), 390.0), (slice(20, 24), 190.0)):
        seen = np.ones(n.shape, bool)
        seen[missing] = False
        ones = np.ones(seen.sum(), np.int64)
        terrain_map = update(empty_map(10.0), n[seen], e[seen], hills(n, e)[seen], ones)
        reference = start(COURSE, terrain_map, DEFAULT, altitude=20.0)
        assert reference.known_until == pytest.approx(known, abs=5.0)
        at = sample(reference, np.arange(20.0, known - 20.0))
        assert np.abs(at.altitude - hills(at.north, at.east) - 10.0).max() < 0.6


def test_beyond_the_sensed_terrain_the_path_levels_off_and_slows():
    """Where it was descending it is eased to level; the flight has somewhere to go for 400 m."""
    _, reference = begin(lambda n, _e: -0.3 * n, sight=200.0)
    path, known = reference.path, int(reference.known_until - reference.path.start)
    assert path.start + path.north.size - 1 >= 400.0
    np.testing.assert_allclose(path.slope[100 : known - 20], -0.3, atol=1e-3)
    assert path.slope[-1] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(path.slope)[known:] >= -1e-9).all()
    assert (np.diff(path.speed)[known : known + 100] < 0).all()
    assert path.speed[-1] == DEFAULT.speed_min_mps


def test_blind_it_is_level_and_starts_when_something_is_seen():
    """With nothing sensed it is level and commits to nothing; the first terrain starts it."""
    nothing = empty_map(10.0)
    blind = start(COURSE, nothing, DEFAULT, altitude=26.0)
    assert blind.status == "blind"
    assert blind.known_until == 0.0
    at = sample(blind, np.arange(0, 400.0))
    np.testing.assert_allclose(at.altitude, 26.0)
    np.testing.assert_array_equal(at.speed, 30.0)
    blind = extend(blind, nothing, 15.0)
    assert blind.status == "blind"
    assert blind.altitude[0] == 26.0
    seeing = extend(blind, scan(nothing, hills, 30.0, 0.0, 0.0, 400.0), 30.0)
    assert seeing.status == "fitted"
    at = sample(seeing, np.arange(80.0, 300.0))
    assert np.abs(at.altitude - hills(at.north, at.east) - 10.0).max() < 0.3


def test_an_outage_is_survived():
    """Without scans it goes on level and slower; with terrain again it is continued from there."""
    *_, (station, reference, terrain_map) = fly(hills, 100.0, sight=150.0)
    for _ in range(20):
        station += 15.0
        reference = extend(reference, terrain_map, station)
    assert reference.known_until < station
    assert sample(reference, [station]).speed[0] < 30.0
    flown_so_far = sample(reference, np.arange(station - 50, station))
    for _ in range(20):
        at = sample(reference, [station])
        terrain_map = scan(terrain_map, hills, at.north[0], at.east[0], 0.0, 400.0)
        reference = extend(reference, terrain_map, station)
        station += 15.0
    assert reference.status == "fitted"
    at = sample(reference, np.arange(station, station + 200))
    assert np.abs(at.altitude - hills(at.north, at.east) - 10.0).max() < 0.3
    assert np.isfinite(flown_so_far.altitude).all()


def test_a_new_set_height_is_approached_beyond_the_commitment():
    """Changing the height changes nothing committed, keeps the load, and arrives."""
    terrain_map, reference = begin(flat)
    higher = extend(reference, terrain_map, 0.0, replace(DEFAULT, height_agl_m=20.0))
    end = committed(higher)
    assert end >= 75.0
    both = np.arange(0.0, end + 1)
    np.testing.assert_array_equal(sample(higher, both).altitude, sample(reference, both).altitude)
    assert sample(higher, [higher.known_until - 10]).altitude[0] == pytest.approx(120.0, abs=0.1)
    bend = np.diff(higher.path.slope) * 30.0**2
    assert np.abs(bend).max() < 2.5
    lower = extend(higher, terrain_map, 0.0, replace(DEFAULT, height_agl_m=5.0))
    assert sample(lower, [lower.known_until - 10]).altitude[0] == pytest.approx(105.0, abs=0.2)


@pytest.mark.parametrize("speed", [20.0, 35.0])
def test_a_new_set_speed_is_approached_beyond_the_commitment(speed):
    """Changing the speed changes nothing committed and reaches the new one at the set rates."""
    terrain_map, reference = begin(flat)
    changed = extend(reference, terrain_map, 0.0, replace(DEFAULT, speed_mps=speed))
    assert (sample(changed, np.arange(0.0, committed(changed) + 1)).speed == 30.0).all()
    known = int(changed.known_until - changed.path.start)
    assert changed.path.speed[known] == pytest.approx(speed)


def test_the_clearance_can_be_given():
    """A set minimum clearance is what sharp crests are passed at."""
    parameters = replace(DEFAULT, clearance_min_m=6.0, smoothing_m4=1e7)
    north, _, altitude, *_ = flown(fly(ridges, 700.0, parameters=parameters))
    assert (altitude - ridges(north, 0.0)).min() == pytest.approx(6.1, abs=0.1)


def test_the_corridor_lowers_the_gradient():
    """With a corridor the path leaves the course for gentler ground, within turn and corridor."""

    def terrain(n, e):
        return 12 * (1 - np.cos(n / 40)) * np.minimum(1, ((e - 50) / 50) ** 2)

    gradients = []
    for corridor in (0.0, 100.0):
        parameters = replace(DEFAULT, corridor_m=corridor)
        north, east, _, heading, _, _ = flown(fly(terrain, 1500.0, parameters=parameters))
        h = terrain(north, east)
        gradients.append(np.sqrt(np.mean(np.diff(h) ** 2)))
        assert np.abs(east).max() <= corridor + 5.0
        assert np.abs(np.diff(heading)).max() <= 1.2 / 158.9
    assert gradients[1] < 0.6 * gradients[0]


def test_turns_are_flown_on_the_course():
    """With a corridor or without, the path is on the course where the course turns."""
    parameters = replace(DEFAULT, corridor_m=80.0)
    for _, reference, _ in fly(hills, 1000.0, BENT, parameters, sight=300.0):
        path = reference.path
        station = path.start + np.arange(path.north.size)
        k = (station - BENT.first).astype(int)
        offset = np.hypot(path.north - BENT.north[k], path.east - BENT.east[k])
        turning = (BENT.curvature[k] != 0) & (station <= reference.known_until)
        assert offset[turning].max(initial=0.0) < 5.0


def test_projection_undoes_sampling():
    """A point of the reference projects to its own station."""
    *_, (_, reference, _) = fly(hills, 500.0, BENT, replace(DEFAULT, corridor_m=80.0))
    stations = np.linspace(reference.path.start, reference.path.start + 450.0, 200)
    at = sample(reference, stations)
    found = [
        project(reference.path, n, e, s + 20.0)
        for n, e, s in zip(at.north, at.east, stations, strict=True)
    ]
    np.testing.assert_allclose(found, stations, atol=1e-6)


def test_a_restored_reference_goes_on_alike():
    """Pickled and restored, map and reference are continued to the same bits."""
    *_, (station, reference, terrain_map) = fly(hills, 200.0, BENT)
    other, other_map = pickle.loads(pickle.dumps((reference, terrain_map)))
    for name, a_map, a_reference in (("one", terrain_map, reference), ("two", other_map, other)):
        a_map = scan(a_map, hills, station + 50.0, 0.0, 0.0, 400.0)
        result = extend(a_reference, a_map, station + 15.0)
        if name == "one":
            expected = result
    for a, b in zip(expected.path, result.path, strict=True):
        np.testing.assert_array_equal(a, b)
