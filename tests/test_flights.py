"""Acceptance flights: shipped scenarios and further courses, flown as a user would.

What they show about the controller: how well it holds its height, that it flies through everything
that is shipped, and what it is robust against. Flights are flown once and shared.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from controller import optimise
from controller.qp import QPData, predicted_cost
from controller.solvers import BACKENDS, Status, solve
from orchestrator import fly

ROOT = Path(__file__).parents[1]
SHIPPED = sorted(path.stem for path in (ROOT / "scenarios").glob("*.yaml"))
BASES = {
    "tent": {"bases_per_channel": 10},
    "laguerre": {"bases_per_channel": 5},
    "laguerre_function": {"bases_per_channel": 8, "pole_per_s": 0.5},
}
HEIGHT_RMS_M = {"tent": 0.04, "laguerre": 0.20, "laguerre_function": 0.12}
AGL_RMS_M = {"tent": 0.08, "laguerre": 0.20, "laguerre_function": 0.15}
COURSES = {  # where on the elevation model of the Jacksboro fault: m north and east of its middle
    "main": (0, 0),
    "north-west": (-5000, 3000),
    "east": (8000, 5000),
    "south-west": (-9000, -9000),
}
LOST = ("collision", "departed", "left_terrain")


class Flown(NamedTuple):
    """What is kept of a flight: its figures and, of every update, merits and extreme commands."""

    figures: Mapping[str, Any]
    before: np.ndarray
    after: np.ndarray
    extremes: Mapping[str, tuple[float, float]]


@cache
def flown(scenario: str, basis: str, *overrides: str) -> Flown:
    """Fly a shipped scenario with a basis."""
    chosen = {"basis": basis, **BASES[basis]}
    design = [f"components.mpc.parameters.{name}={value}" for name, value in chosen.items()]
    flight = fly(ROOT / "scenarios" / f"{scenario}.yaml", [*design, *overrides])
    plans = {name: flight.trace[f"mpc.plan.{name}"][1] for name in ("thrust", "pitch", "roll")}
    return Flown(
        flight.metrics,
        flight.trace["mpc.cost.before"][1],
        flight.trace["mpc.cost.after"][1],
        {name: (values.min(), values.max()) for name, values in plans.items()},
    )


def across(course: str, basis: str) -> Flown:
    """Fly the main scenario over another part of the terrain."""
    north, east = COURSES[course]
    origin = {"north": north, "east": east} if course != "main" else {}
    return flown(
        "jacksboro",
        basis,
        *(f"resources.terrain.parameters.origin_{axis}_m={at}" for axis, at in origin.items()),
    )


# -- how well --------------------------------------------------------------------------------------


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("basis", BASES)
def test_holds_its_height_over_real_terrain(basis, course):
    """60 s at 30 m/s, 10 m up: within the bars of its basis, and never below 9 m."""
    figures = across(course, basis).figures
    assert (figures["outcome"], figures["duration_s"]) == ("flown", 60.0)
    assert figures["height_rms_m"] <= HEIGHT_RMS_M[basis]
    assert figures["agl_rms_m"] <= AGL_RMS_M[basis]
    assert figures["clearance_min_m"] >= 9.0


def test_the_order_of_the_bases():
    """Ten tents hold the height better than eight Laguerre functions, these than five polynomials."""
    error = {basis: across("main", basis).figures["height_rms_m"] for basis in BASES}
    assert error["tent"] < error["laguerre_function"] < error["laguerre"]


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("basis", BASES)
def test_no_update_ever_makes_the_shifted_plan_worse(basis, course):
    """At every tick: merit accepted <= merit of the shifted plan, and commands within bounds."""
    flight = across(course, basis)
    assert np.all(flight.after <= flight.before)
    assert flight.figures["ladder"]["trim"] == 0
    assert sum(flight.figures["ladder"].values()) >= 120
    bounds = {"thrust": (0.0, 3.5), "pitch": np.radians([-50, 50]), "roll": np.radians([-50, 50])}
    for name, (low, high) in bounds.items():
        assert low <= flight.extremes[name][0] <= flight.extremes[name][1] <= high


# -- everything that is shipped --------------------------------------------------------------------


@pytest.mark.parametrize("scenario", SHIPPED)
@pytest.mark.parametrize("basis", BASES)
def test_every_shipped_scenario_is_flown(basis, scenario):
    """No collision, no departure, to the end, with each of the three bases."""
    figures = flown(scenario, basis).figures
    assert (figures["outcome"], figures["reason"]) == ("flown", "")
    assert figures["heading_max_deg"] < 45.0
    assert figures["height_rms_m"] < 0.5


# -- latency ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("basis", BASES)
def test_compensated_latency_costs_nothing(basis):
    """Half a second, declared: height error within 10 % of none at all, or within a millimetre."""
    late, prompt = (flown(name, basis).figures for name in ("latency", "jacksboro"))
    assert late["height_rms_m"] <= max(1.1 * prompt["height_rms_m"], prompt["height_rms_m"] + 0.001)
    assert late["clearance_min_m"] >= 9.0


def test_latency_beyond_an_update_period_is_compensated_too():
    """A second: two plans are under way at any time, and what they commit to is predicted."""
    figures = flown("latency", "laguerre", "components.mpc.latency_s=1.0").figures
    assert figures["outcome"] == "flown"
    assert figures["height_rms_m"] <= HEIGHT_RMS_M["laguerre"]


@pytest.mark.parametrize("basis", BASES)
def test_a_stale_plan_is_lost(basis):
    """The same half second, ignored: the flight is lost, or ten times worse."""
    stale = flown("latency", basis, "components.mpc.parameters.compensate_latency=false").figures
    compensated = flown("latency", basis).figures
    assert stale["outcome"] in LOST or stale["height_rms_m"] > 10 * compensated["height_rms_m"]


# -- departures ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("heading_deg", "outcome"), [(40, "flown"), (50, "departed")])
def test_a_heading_45_degrees_off_its_reference_is_a_departure(heading_deg, outcome):
    """Flown to the end or not, and however well the height was held."""
    off = f"components.vehicle.parameters.perturbation.heading_deg={heading_deg}"
    figures = flown("level_flight", "laguerre", off, "duration_s=6").figures
    assert figures["outcome"] == outcome
    assert figures["duration_s"] == 6.0
    assert figures["heading_max_deg"] == pytest.approx(heading_deg, abs=2.0)


@pytest.mark.parametrize("preset", ["r50", "r50_bare"])
@pytest.mark.parametrize(("basis", "late_m"), [("laguerre", 2.5), ("tent", 0.5)])
def test_random_starts_are_recovered(basis, late_m, preset, monkeypatch):
    """The first eight of the study's random starts, in gusts: none departs, and all settle."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import random_starts

    assert random_starts.BARS[basis] == late_m
    cell = random_starts.Cell("attitude", preset, basis)
    runs = [random_starts.fly(cell, seed=1, number=number) for number in range(8)]
    assert {run.outcome for run in runs} == {"flown"}
    assert max(run.late_m for run in runs) <= late_m


# -- solvers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("basis", ["laguerre", "tent"])
def test_solvers_agree_on_every_programme_of_a_flight(basis, monkeypatch):
    """DAQP, PIQP and a cvxpy model reach the same optimum to 1e-6 of its cost, at every update."""
    programmes: list[QPData] = []
    usual = optimise.solve_with_fallback

    def noted(data, backend):
        programmes.append(data)
        return usual(data, backend)

    monkeypatch.setattr(optimise, "solve_with_fallback", noted)
    flown.__wrapped__("jacksboro", basis, "duration_s=10")
    assert len(programmes) > 20
    for data in programmes:
        solutions = {name: solve(data, name) for name in BACKENDS}
        assert {one.status for one in solutions.values()} == {Status.OPTIMAL}
        costs = {name: predicted_cost(data, one.alpha) for name, one in solutions.items()}
        assert max(costs.values()) - min(costs.values()) <= 1e-6 * min(costs.values())
