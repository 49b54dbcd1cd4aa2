"""Figure 8: what is read from a response, and what its claims come to."""

import numpy as np
import pytest

from paper import step_response
from paper.altitude_step import claims, verdict
from paper.problem import level_flight
from paper.step_response import (
    AT_S,
    BASES,
    BOXES,
    HEIGHT_M,
    LAGUERRE,
    LOST,
    TENTS,
    Transient,
    histories,
    respond,
    stepping,
    transient,
    wanted,
    ways,
)

TIME = 0.05 * np.arange(1, 641)


def test_a_response_of_known_shape_is_read_exactly():
    """A straight climb from 0 to 12 m and back to 10 m: every figure is known."""
    knots = AT_S + np.array([-1.0, 0.0, 2.0, 3.0])
    altitude = np.interp(TIME, knots, [-0.5, 0.0, 12.0, 10.0])
    altitude[TIME < AT_S - 1.0 + 1e-9] = -0.5
    late = TIME > AT_S + 10.0
    altitude[late] += 0.1 * np.sin(2 * np.pi * (TIME[late] - TIME[0]))
    found = transient(TIME, altitude)
    assert found.rise_s == pytest.approx(8.0 / 6.0, abs=0.1)
    assert found.settle_1m_s == pytest.approx(2.5, abs=0.06)
    assert found.settle_2pct_s == pytest.approx(2.9, abs=0.06)
    assert found.overshoot_m == pytest.approx(2.0, abs=0.05)
    assert found.dip_m == pytest.approx(0.5)
    assert found.excursion_m == pytest.approx(2.5, abs=0.05)
    assert found.ripple_m == pytest.approx(0.2, abs=1e-3)
    assert found.late_error_m == pytest.approx(0.1, abs=1e-3)


def test_the_step_itself_settles_at_once():
    """An altitude that is the reference has no transient at all."""
    found = transient(TIME, wanted(TIME))
    assert found == Transient(pytest.approx(0.05), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_flight_far_off_is_lost():
    """20 m beside the reference is no response to a step of 10 m."""
    altitude = wanted(TIME)
    altitude[300] = 40.0
    assert transient(TIME, altitude) == LOST


def test_preview_is_the_only_difference():
    """Previewed, the horizon holds the step where it will be; else it holds what is wanted now."""
    level = level_flight()
    seen, unseen = (stepping(level, is_previewed=each) for each in (True, False))
    for time in (0.0, 2.0, 5.0, AT_S, 20.0):
        ahead, now = seen(time).reference, unseen(time).reference
        np.testing.assert_array_equal(ahead[[0, 1, 3, 4]], now[[0, 1, 3, 4]])
        np.testing.assert_array_equal(now[2], HEIGHT_M if time >= AT_S else 0.0)
        np.testing.assert_array_equal(ahead[2], wanted(time + 0.05 * np.arange(1, 201)))


def test_a_verdict_is_all_some_or_none():
    """Claims that are true always, sometimes, never."""
    assert verdict([True, True]) == "holds"
    assert verdict([True, False]) == "holds in part"
    assert verdict([False, False]) == "does not hold"


def test_claims_follow_from_the_numbers():
    """Where tents are the better in everything, the paper's sentence on speed holds alone."""
    tents = Transient(1.0, 1.0, 2.0, 0.1, 0.0, 0.0, 0.0)
    laguerre = Transient(2.0, 3.0, 9.0, 0.5, 0.5, 3.0, 2.0)
    boxes = tents._replace(settle_2pct_s=2.1)
    each = dict.fromkeys(BASES, laguerre) | {TENTS: tents, LAGUERRE: laguerre, BOXES: boxes}
    found = {(name, way): one for way in ways(quick=True) for name, one in each.items()}
    verdicts = [claim.verdict for claim in claims(found)]
    assert verdicts == ["does not hold", "holds", *["does not hold"] * 3]


def test_a_lost_flight_ends_in_the_figure(monkeypatch):
    """The curve stops where the aircraft was lost, and does not come back."""
    monkeypatch.setattr(step_response, "DURATION_S", 1.0)
    way = ways(quick=True)[0]
    flown = respond(TENTS, way)
    outputs = flown.outputs.copy()
    outputs[5, 2] = 100.0
    columns = histories({(TENTS, way): flown._replace(outputs=outputs)}, *way[:1], is_searched=True)
    altitude = columns[f"altitude_m, {TENTS}, previewed"]
    assert np.isfinite(altitude[:5]).all()
    assert np.isnan(altitude[5:]).all()


def test_of_equal_order_laguerre_and_legendre_fly_alike(monkeypatch):
    """One space, one controller: five of either fly the same altitudes, to rounding."""
    monkeypatch.setattr(step_response, "DURATION_S", 4.0)
    monkeypatch.setattr(step_response, "AT_S", 2.0)
    monkeypatch.setattr(
        step_response, "BASES", {"a": ("laguerre", 5), "b": ("legendre", 5), "c": ("tent", 5)}
    )
    way = ways(quick=True)[1]
    a, b, c = (respond(name, way).outputs[:, 2] for name in "abc")
    np.testing.assert_allclose(a, b, atol=1e-6)
    assert np.abs(a - c).max() > 1e-3
