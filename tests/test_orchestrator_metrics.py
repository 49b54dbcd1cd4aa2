"""Figures of made-up flights whose answers are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from fake_system import LADDER, SCENE, flight, helicopter, tell
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.figures.deviation import deviation, held, project
from orchestrator.figures.logbook import Logbook
from orchestrator.figures.metrics import faults, flight_metrics, timing
from orchestrator.figures.trace import Trace
from orchestrator.flight import recording_metrics
from orchestrator.listener import Result
from orchestrator.recording.messages import Signal
from orchestrator.recording.recorder import Recorder

TIME = np.arange(0, 10.001, 0.05)
N = len(TIME)
FLOWN = Result("flown", "", 10**10, {"overruns.mpc": 2}, cpu_s=0.25)


class Table(dict):
    """Signals as a plain table of name to (times, values)."""

    @property
    def names(self):
        """All of them."""
        return tuple(self)


def straight(*, height=0.5, right=-2.0, speed=31.0, heading=0.1):
    """Return a flight due east at 30 m/s along a reference, a constant amount off it."""
    east = 30.0 * TIME
    ones = np.ones(N)
    posts = np.array([-100.0, 100.0, 500.0])
    t = np.array([0.0, 5.0])
    two = np.ones((2, 1))
    table = {
        "vehicle.pose.north": -right * ones,  # eastwards, right is south
        "vehicle.pose.east": east,
        "vehicle.pose.down": -(50.0 + 0.1 * east + height),
        "vehicle.pose.psi": np.pi / 2 + heading * ones + 4 * np.pi,
        "vehicle.velocity.north": 0.0 * ones,
        "vehicle.velocity.east": speed * ones * 0.8,
        "vehicle.velocity.down": speed * ones * 0.6,
        "vehicle.clearance": 10.0 + height * ones,
        "vehicle.load_factor": ones + 0.01 * TIME,
        "vehicle.actuator.thrust": np.where(TIME < 6, 1.0, 3.5),
        "vehicle.actuator.pitch": np.where(TIME > 9, -0.35, 0.0),
    }
    signals = Table({name: (TIME, values) for name, values in table.items()})
    reference = {"north": 0 * posts, "east": posts, "altitude": 50 + 0.1 * posts}
    reference |= {"heading": np.pi / 2 + 0 * posts, "speed": 30.0 + 0 * posts}
    signals |= {f"mpc.reference.{name}": (t, two * post) for name, post in reference.items()}
    signals["mpc.ladder"] = (np.arange(4.0), np.array([0, 0, 3, 1]))
    signals["mpc.height_agl_m"] = (np.array([0.0]), np.array([10.0]))
    return signals


def variables(signals):
    bounds = {"thrust": (0.0, 3.5), "pitch": (-0.35, 0.35)}
    return {
        name: Signal(
            name, "", "", "1", (), LADDER if name == "mpc.ladder" else {},
            *bounds.get(name.rpartition(".")[2], (None, None)),
        )
        for name in signals.names
    }  # fmt: skip


def figures(signals, result=FLOWN, settle_s=2.0, scene=SCENE, wall_clock=None):
    return flight_metrics(signals, variables(signals), scene, result, settle_s, wall_clock)


def test_a_constant_offset_is_what_every_figure_says():
    """Half a metre high, two metres left, 1 m/s fast, 0.1 rad off: exactly that, on any course."""
    got = figures(straight(), wall_clock={"mpc": np.array([0.001, 0.002, 0.004])})
    assert got.pop("ladder") == {"full step": 2, "shorter step": 1, "old tail": 0, "trim": 1}
    assert (got.pop("outcome"), got.pop("reason")) == ("flown", "")
    assert got.pop("faults") == {"overruns.mpc": 2}
    assert got == pytest.approx(
        {
            "duration_s": 10.0,
            "height_rms_m": 0.5,
            "height_p95_m": 0.5,
            "agl_rms_m": 0.5,
            "clearance_min_m": 10.5,
            "cross_track_rms_m": 2.0,
            "speed_rms_mps": 1.0,
            "heading_max_deg": np.degrees(0.1),
            "load_factor_min": 1.02,
            "load_factor_max": 1.1,
            "saturation_percent": 100 * 81 / 161,
            "update_ms_median": 2.0,
            "update_ms_p99": 3.96,
            "deadline_misses": 2,
            "cpu_ms_per_simulated_s": 25.0,
        },
        rel=1e-12,
    )


def test_every_missed_deadline_counts_whoever_missed_it():
    """Not the planning component's alone; what else went wrong is told by kind and component."""
    counts = {"overruns.mpc": 2, "overruns.hold": 80, "out_of_range.puck": 3}
    result = replace(FLOWN, counts=counts)
    timed = figures(straight(), result, scene={}, wall_clock={})
    assert (timed["deadline_misses"], timed["faults"]) == (82, counts)
    assert figures(straight(), result, scene={})["faults"] == {"out_of_range.puck": 3}


def test_cross_track_is_positive_to_the_right():
    """The sign says on which side of the course the flight was."""
    for right in (-2.0, 2.0):
        signals = straight(right=right)
        off = deviation(
            *(
                {n.rpartition(".")[2]: s for n, s in signals.items() if f".{group}." in n}
                for group in ("pose", "velocity", "reference")
            )
        )
        np.testing.assert_allclose(off.cross_track, right)


def test_the_first_seconds_are_left_out_but_for_safety():
    """Before settle_s only the least clearance and the largest heading deviation count."""
    signals = straight()
    for name, bad in (
        ("clearance", 1.0),
        ("pose.psi", 0.0),
        ("pose.down", -1e3),
        ("load_factor", 9),
    ):
        values = signals[f"vehicle.{name}"][1].copy()
        values[TIME < 2.0] = bad
        signals[f"vehicle.{name}"] = (TIME, values)
    got = figures(signals)
    assert got["clearance_min_m"] == 1.0
    assert got["heading_max_deg"] == pytest.approx(90.0)
    assert got["height_rms_m"] == pytest.approx(0.5)
    assert got["agl_rms_m"] == pytest.approx(0.5)
    assert got["load_factor_max"] == pytest.approx(1.1)


@pytest.mark.parametrize(
    ("degrees", "outcome"), [(44.9, "flown"), (-45.1, "departed"), (359, "flown")]
)
def test_a_heading_45_deg_off_is_a_departure(degrees, outcome):
    """More than 45 deg from the reference's heading is a departure, full turns not counted."""
    assert figures(straight(heading=np.radians(degrees)))["outcome"] == outcome


def test_a_spin_is_a_departure():
    """A heading that turns once around and comes back has been 180 deg off."""
    signals = straight()
    spin = np.pi / 2 + np.interp(TIME, [4, 6], [0, 2 * np.pi])
    signals["vehicle.pose.psi"] = (TIME, spin)
    got = figures(signals)
    assert (got["outcome"], got["heading_max_deg"]) == ("departed", pytest.approx(180.0))
    crash = Result("collision", "hit", 10**10)
    assert figures(signals, crash)["outcome"] == "collision"


def test_the_newest_reference_counts():
    """From its tick on a new reference replaces the old one, and the new set height the old."""
    signals = straight(height=0.0)
    times, altitude = signals["mpc.reference.altitude"]
    signals["mpc.reference.altitude"] = (times, altitude + np.array([[0.0], [3.0]]))
    signals["mpc.height_agl_m"] = (times, np.array([10.0, 6.0]))
    got = figures(signals, settle_s=0.0)
    late = np.count_nonzero(TIME >= 5.0)
    assert got["height_rms_m"] == pytest.approx(3.0 * np.sqrt(late / N))
    assert got["agl_rms_m"] == pytest.approx(4.0 * np.sqrt(late / N))
    assert got["height_p95_m"] == pytest.approx(3.0)


def test_before_the_first_reference_nothing_is_compared():
    """Ticks without a reference are left out, not counted as on it."""
    signals = straight()
    for name in [n for n in signals.names if n.startswith("mpc.reference.")]:
        signals[name] = (np.array([5.0]), signals[name][1][1:])
    assert figures(signals)["height_rms_m"] == pytest.approx(0.5)
    for name in [n for n in signals.names if n.startswith("mpc.reference.")]:
        signals[name] = (np.array([50.0]), signals[name][1])
    assert figures(signals)["height_rms_m"] is None


def test_what_has_no_role_is_none():
    """Without roles, wall clock or time all figures are None and nothing fails."""
    known = ["outcome", "reason", "duration_s", "faults"]
    got = figures(straight(), scene={})
    assert [k for k, v in got.items() if v is not None] == known
    empty = figures(Table(), Result("component error", "broken"), scene=SCENE)
    assert [k for k, v in empty.items() if v is not None] == known
    assert figures(straight())["update_ms_median"] is None
    assert figures(straight(), wall_clock={})["update_ms_p99"] is None
    assert figures(straight(), settle_s=20.0)["height_rms_m"] is None


def test_saturation_needs_a_bound_within_a_millionth_of_the_range():
    """At a bound means within 1e-6 of the range; unbounded controls are never saturated."""
    signals = straight()
    for value, percent in ((1.0, 0), (3.5 - 4e-6, 0), (3.5 - 3e-6, 100), (0.0, 100), (4.0, 100)):
        signals["vehicle.actuator.thrust"] = (TIME, np.full(N, value))
        signals["vehicle.actuator.pitch"] = (TIME, np.zeros(N))
        assert figures(signals)["saturation_percent"] == percent
    signals["vehicle.actuator.thrust"] = (TIME, np.ones(N))
    signals["vehicle.actuator.free"] = (TIME, np.full(N, 1e9))
    assert figures(signals)["saturation_percent"] == 0


POINTS = st.lists(st.tuples(*2 * [st.floats(-100, 100)]), min_size=2, max_size=6)


@given(POINTS, POINTS)
@settings(deadline=None)
def test_projection_is_the_nearest_point(posts, positions):
    """No point of the polyline is nearer than the one found, and its distance is the one told."""
    pn, pe = np.array(posts).T
    n, e = np.array(positions).T
    k, fraction, distance = project(n, e, pn, pe)
    found_n = pn[k] + fraction * (pn[k + 1] - pn[k])
    found_e = pe[k] + fraction * (pe[k + 1] - pe[k])
    np.testing.assert_allclose(np.hypot(n - found_n, e - found_e), np.abs(distance), atol=1e-9)
    for f in np.linspace(0, 1, 11):
        others_n, others_e = pn[:-1] + f * np.diff(pn), pe[:-1] + f * np.diff(pe)
        others = np.hypot(n[:, None] - others_n, e[:, None] - others_e)
        assert (np.abs(distance)[:, None] <= others + 1e-9).all()


def test_posts_that_are_not_known_take_their_segments_away():
    """A NaN in the polyline is no place to be near to."""
    north = np.array([0.0, 1.0, np.nan, 3.0, 4.0])
    k, fraction, distance = project(np.array([2.0]), np.array([0.5]), north, np.zeros(5))
    assert (k[0], fraction[0], distance[0]) == (0, 1.0, pytest.approx(np.hypot(1, 0.5)))


def test_values_hold_until_the_next():
    """Between two samples the older one is valid, before the first there is none."""
    got = held((np.array([1.0, 2.0]), np.array([5.0, 6.0])), np.array([0.0, 1.0, 1.9, 2.0, 9.0]))
    np.testing.assert_array_equal(got, [np.nan, 5.0, 5.0, 6.0, 6.0])


@pytest.mark.parametrize("wall_clock", [True, False])
def test_a_recording_gives_the_figures_of_the_run(tmp_path, wall_clock):
    """Trace and recording give identical numbers, although the recording leaves out repetitions."""
    system = helicopter(cells=2, capacity=8, posts=9, wall_clock=wall_clock)
    calls = flight(system, 6.0)
    trace = Trace()
    logbook = Logbook(trace)
    path = tmp_path / "a.mcap"
    result = Result("flown", "", 6 * 10**9, {"overruns.mpc": 1}, 1.25)
    for listener in (trace, logbook, Recorder(path)):
        tell(listener, system, calls, result)
    ports = {str(p): p for table in system.ports.values() for p in table.values()}
    durations = logbook.durations if wall_clock else None
    run = flight_metrics(logbook, ports, SCENE, result, 2.0, durations)
    assert recording_metrics(path) == run
    timings = {"update_ms_median", "update_ms_p99", "cpu_ms_per_simulated_s", "deadline_misses"}
    assert {k for k, v in run.items() if v is None} == (set() if wall_clock else timings)


def test_overruns_are_what_begins_with_their_name():
    """Faults leave out, without wall clock, what is counted as missed deadlines with it."""
    counts = {"overruns.mpc": 2, "overruns.sensor": 3, "overrunsome.mpc": 5, "late.overruns": 7}
    result = Result("flown", "", 10**9, counts)
    kept = faults(result, has_overruns=False)
    assert kept == {"late.overruns": 7, "overrunsome.mpc": 5}
    missed = timing("mpc", result, {})["deadline_misses"]
    assert missed == sum(faults(result, has_overruns=True).values()) - sum(kept.values()) == 5
