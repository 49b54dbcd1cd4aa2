"""Clocks of FMI 3: the interval is the component's rate, in event mode and scheduled."""

import numpy as np
import pytest
from fmu_flights import flown


@pytest.fixture
def clocked(fmu, tmp_path):
    """Return a function that flies the clocked model beside a staircase of 20 steps a second."""

    def fly_clocked(isolation, **keys):
        scheduled = keys.pop("scheduled")
        use = fmu("clocked", fmi=3, SCHEDULED=scheduled)
        components = {
            "source": {"use": fmu("staircase", fmi=3, PERIOD=0.05), "rate_hz": 20},
            "clocked": {"use": use, "isolation": isolation, **keys},
        }
        return flown(tmp_path, components, ["source.y -> clocked.u"], duration_s=2)

    return fly_clocked


@pytest.mark.parametrize("isolation", ["none", "process"])
def test_a_scheduled_partition_runs_at_its_ticks(clocked, isolation):
    """Sampled at the clock's 2 Hz: it sees the source of the same instant, outputs valid at once."""
    recording = clocked(isolation, scheduled=1)
    times, values = recording["clocked.y"]
    np.testing.assert_array_equal(times, [0.0, 0.5, 1.0, 1.5])
    np.testing.assert_array_equal(values, 20 * times)
    np.testing.assert_array_equal(recording["clocked.count"][1], [1, 2, 3, 4])


@pytest.mark.parametrize("isolation", ["none", "process"])
def test_a_clock_of_a_co_simulation_ticks_in_event_mode(clocked, isolation):
    """Continuous at the clock's 2 Hz: the tick at the step's beginning is seen at its end."""
    recording = clocked(isolation, scheduled=0)
    times, values = recording["clocked.y"]
    np.testing.assert_array_equal(times, [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_array_equal(values, 20 * np.maximum(times - 0.5, 0))


def test_between_its_ticks_nothing_changes(clocked):
    """At 20 Hz too the clock ticks twice a second: recorded where it changes, one step later."""
    times, values = clocked("none", scheduled=0, rate_hz=20)["clocked.y"]
    np.testing.assert_allclose(times, [0.0, 0.05, 0.55, 1.05, 1.55])
    np.testing.assert_array_equal(values, [0, 0, 10, 20, 30])
