"""Altitude and speed over the station."""

import daqp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.profile import (
    GRACE,
    SAMPLE_M,
    SAMPLES,
    TIGHTENING_M,
    Limits,
    plan_altitude,
    plan_speed,
    unhindered_speed,
)
from controller.spline import KNOT_M, curvature_weights, evaluate, slope_weights, weights

LIMITS = Limits(
    speed=30.0, speed_min=5.0, slope=0.7, up=5.9, down=4.9, side=5.7, acceleration=1.5,
    deceleration=2.0,
)  # fmt: skip
LOOSE = LIMITS._replace(slope=1e3, up=1e6, down=1e6)
SPANS = 14
STATION = SAMPLE_M * np.arange(SPANS * SAMPLES + 1)
AGL, LOWEST = 10.0, 9.0


def plan(h, kept=(), old=None, limits=LIMITS, smoothing=2e4, lowest=LOWEST):
    """Return all coefficients and the status of a plan over ground h."""
    kept = np.asarray(kept, float)
    old = np.full(h.size, np.nan) if old is None else old
    speed = np.full((h.size - 1) // SAMPLES + 1, limits.speed)
    new, status = plan_altitude(h + AGL, h + lowest, kept, old, limits, speed, smoothing)
    return np.concatenate((kept, new)), status


def spline(coefficients, station=STATION, kind=weights):
    """Return the values of a spline at stations."""
    span = np.minimum((station // KNOT_M).astype(int), coefficients.size - 4)
    return np.array(
        [
            evaluate(coefficients, i, kind(s / KNOT_M - i))
            for i, s in zip(span, station, strict=True)
        ]
    )


def hills(height, length):
    """Return cosine hills from trough to trough."""
    return height / 2 * (1 - np.cos(2 * np.pi * STATION / length))


def random_ground(seed, rms=12.0, shortest=40.0):
    """Return a sum of waves of up to 400 m length."""
    rng = np.random.default_rng(seed)
    length = np.exp(rng.uniform(np.log(shortest), np.log(400), 12))
    phase = rng.uniform(0, 2 * np.pi, 12)
    waves = length * np.sin(2 * np.pi * STATION[:, None] / length + phase)
    total = waves.sum(axis=1)
    return rms * total / total.std()


def test_flat_ground_is_followed_exactly():
    """Over flat ground the altitude is ground plus set height, from any kept part that is."""
    for kept in ([], [110.0] * 3):
        c, status = plan(np.full(STATION.size, 100.0), kept)
        np.testing.assert_allclose(c, 110.0, atol=1e-7)
        assert status == "fitted"


def test_without_smoothing_the_terrain_is_draped():
    """As lambda -> 0 the altitude follows terrain that the knots can resolve."""
    h = hills(20.0, 150.0)
    assert np.abs(spline(plan(h, limits=LOOSE, smoothing=0.0)[0]) - h - AGL).max() < 0.05
    error = [
        np.abs(spline(plan(h, limits=LOOSE, smoothing=w)[0]) - h - AGL).max() for w in (1, 1e4, 1e5)
    ]
    assert error == sorted(error)


def test_with_much_smoothing_a_straight_line_passes_over():
    """As lambda -> infinity the altitude is straight, and the clearance still holds."""
    h = hills(20.0, 150.0)
    c, _ = plan(h, limits=LOOSE, smoothing=1e12)
    np.testing.assert_allclose(np.diff(c, n=2), 0, atol=1e-3)
    assert (spline(c) - h).min() == pytest.approx(LOWEST + TIGHTENING_M, abs=1e-3)


def test_default_smoothing_takes_little_from_gentle_hills():
    """At lambda = 2e4 m^4 hills as rough as the Jacksboro model's are followed within 0.2 m."""
    h = hills(30.0, 400.0)
    middle = slice(4 * SAMPLES, -4 * SAMPLES)
    c, status = plan(h)
    assert np.abs(spline(c) - h - AGL)[middle].max() < 0.2
    assert status == "fitted"


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 40.0))
@settings(deadline=None, max_examples=100)
def test_clearance_is_hard(seed, rms):
    """Over any ground the clearance holds at every sample, whatever the soft limits say."""
    h = random_ground(seed, rms)
    c, status = plan(h)
    assert (spline(c) - h).min() >= LOWEST + TIGHTENING_M - 1e-5
    assert status in ("fitted", "strained")


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=50)
def test_clearance_holds_between_samples(seed):
    """Where the ground is no sharper than the tightening assumes, every metre is clear."""
    h = random_ground(seed, 10.0, shortest=100.0)
    sharpness = np.pad(np.abs(np.diff(h, n=2)), 1, mode="edge")
    assert sharpness.max() < 8 * TIGHTENING_M
    fine = np.arange(STATION[-1] + 1)
    ground = np.interp(fine, STATION, h) + np.interp(fine, STATION, sharpness) / 8
    assert (spline(plan(h)[0], fine) - ground).min() >= LOWEST - 1e-5


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(deadline=None, max_examples=100)
def test_clearance_holds_when_planned_again(seed, committed):
    """Planned again behind a committed stretch, the same ground is cleared as well as before."""
    h = random_ground(seed)
    c, _ = plan(h)
    rest = slice(committed * SAMPLES, None)
    again, status = plan(h[rest], c[committed : committed + 3], spline(c)[rest])
    np.testing.assert_array_equal(again[:3], c[committed : committed + 3])
    assert (spline(again, STATION[: h[rest].size]) - h[rest]).min() >= LOWEST + TIGHTENING_M - 1e-4
    assert status in ("fitted", "strained")


@given(st.integers(0, 2**32 - 1), st.floats(0, 60), st.integers(0, 12))
@settings(deadline=None, max_examples=100)
def test_a_wall_just_ahead_is_climbed_as_fast_as_can_be(seed, height, distance):
    """A wall that the kept stretch cannot clear is climbed, tamely, and the status says so."""
    h = np.zeros(STATION.size)
    h[distance:] = height
    h += 0.1 * random_ground(seed, 1.0)
    old = np.full(STATION.size, np.nan)
    c, status = plan(h, [10.0] * 3, old)
    assert status != "envelope"
    clearance = spline(c) - h
    if clearance.min() < LOWEST - 1e-5:
        assert status == "capped"
    # at twice the nominal limits level flight rises 20 m in 55 m, 60 m in 120 m
    assert clearance[30:].min() >= LOWEST
    assert np.diff(c).max() <= 2.2 * LIMITS.slope * KNOT_M
    assert spline(c).max() < height + 80.0


def test_soft_limits_hold_where_the_clearance_allows():
    """Over ridges too sharp to follow, slope and load stay within limits and clearance is kept."""
    h = hills(40.0, 200.0)
    c, status = plan(h)
    knots = KNOT_M * np.arange(SPANS + 1.0)
    bend = spline(c, knots, curvature_weights) * LIMITS.speed**2
    assert status == "fitted"
    assert bend.max() <= LIMITS.up * GRACE
    assert bend.min() >= -LIMITS.down * GRACE
    assert np.abs(spline(c, STATION, slope_weights)).max() <= LIMITS.slope
    assert (spline(c) - h).min() >= LOWEST


def test_unknown_ground_asks_for_nothing():
    """Samples without ground, at the end or before the first, leave the rest as it was."""
    h = hills(20.0, 300.0)
    full, _ = plan(h)
    h[-SAMPLES:] = np.nan
    part, status = plan(h)
    assert status == "fitted"
    assert np.abs(part - full)[:8].max() < 0.02


def test_a_failed_solver_gives_the_envelope(monkeypatch):
    """When the program cannot be solved the altitude is above every target around it."""
    monkeypatch.setattr(daqp, "solve", lambda *a, **k: (np.full(SPANS, np.nan), 0.0, -1, {}))
    h = random_ground(7)
    h[-3:] = np.nan
    c, status = plan(h)
    assert status == "envelope"
    assert np.nanmin(spline(c) - h) >= AGL - 1e-9
    assert plan(h, [50.0] * 3)[0].size == SPANS + 3


def test_the_set_speed_is_approached_at_the_limits():
    """Unhindered, the speed rises or falls to the set speed, and no further."""
    distance = np.array([0.0, 100.0, 1e4])
    np.testing.assert_allclose(
        unhindered_speed(20.0, distance, LIMITS), [20, np.sqrt(400 + 300), 30]
    )
    np.testing.assert_allclose(
        unhindered_speed(40.0, distance, LIMITS), [40, np.sqrt(1600 - 400), 30]
    )


@given(st.integers(0, 2**32 - 1), st.floats(10, 35), st.integers(0, 400))
@settings(deadline=None)
def test_speed_respects_its_limits(seed, start, known):
    """Speed changes within the accelerations, and where it had room to fall the load is in limits."""
    rng = np.random.default_rng(seed)
    bend, turn = rng.normal(0, 0.008, 300), rng.normal(0, 0.008, 300)
    bend[:150] *= 0.5
    slope = np.cumsum(bend) * 0.3
    v = plan_speed(start, known, slope, bend, turn, LIMITS)
    gain = np.diff(v**2) / 2
    assert v[0] == start
    assert gain.max() <= LIMITS.acceleration + 1e-9
    assert gain.min() >= -LIMITS.deceleration - 1e-9
    slow = v <= LIMITS.speed_min + 1e-9
    braking = np.append(True, gain <= -LIMITS.deceleration + 1e-9) | slow
    seen = (np.arange(300) <= known) & ~braking
    assert (v[seen] <= LIMITS.speed + 1e-9).all()
    assert (bend * v**2)[seen].max(initial=0) <= LIMITS.up * GRACE + 1e-9
    assert (bend * v**2)[seen].min(initial=0) >= -LIMITS.down * GRACE - 1e-9
    assert np.abs(turn * v**2)[seen].max(initial=0) <= LIMITS.side * GRACE + 1e-9


def test_nothing_slows_a_gentle_path():
    """Within all limits the set speed is held, and it falls beyond the sensed terrain."""
    still = np.zeros(300)
    v = plan_speed(30.0, 200, still, still, still, LIMITS)
    np.testing.assert_array_equal(v[:201], 30.0)
    assert (np.diff(v[200:]) < 0).all()
