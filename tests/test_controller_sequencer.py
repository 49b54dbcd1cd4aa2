"""The sequencer: which sample of which plan is played when."""

import numpy as np
import pytest
from fmpy.validation import validate_model_description
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.sequencer import SOURCES, PlanSequencer, SequencerParameters

CAPACITY = 40
TICK = 0.05
CHANNELS = ("thrust", "pitch", "roll", "heading")


def plan(sequence, start, period=TICK, fill=None):
    """Return a plan; sample k of channel c is 1000 sequence + 100 c + k, so that it tells itself."""
    samples = np.arange(CAPACITY, dtype=float)
    values = {
        f"plan.{name}": 1000.0 * sequence + 100.0 * c + samples if fill is None else samples + fill
        for c, name in enumerate(CHANNELS)
    }
    return values | {
        "plan.sequence": sequence,
        "plan.start_time": start,
        "plan.sample_period": period,
    }


def sequencer(first=None):
    component = PlanSequencer(SequencerParameters(plan_capacity=CAPACITY))
    component.set(first or {})
    component.initialize(start_time=0.0)
    return component


def playing(component):
    """Return (sequence, sample, source) as the commands and outputs tell."""
    outputs = component.get(["playing.sequence", "playing.source"])
    commands = [*component.get([f"command.{name}" for name in CHANNELS]).values()]
    sequence = outputs["playing.sequence"]
    k = commands[0] - 1000.0 * sequence
    np.testing.assert_array_equal(commands, 1000.0 * sequence + 100.0 * np.arange(4) + k)
    return sequence, int(k), SOURCES[outputs["playing.source"]]


def at(component, time, new=None):
    """Return what is playing after the step at a time, s."""
    component.set(new or {})
    assert component.step(time, TICK) == 0
    return playing(component)


def test_plays_sample_k_from_its_time_to_the_next():
    """Sample k is held over [start + k Ts, start + (k + 1) Ts)."""
    component = sequencer(plan(1, 0.0, period=0.2))
    for tick in range(40):
        assert at(component, tick * TICK)[:2] == (1, tick // 4)


@settings(deadline=None, max_examples=60)
@given(start=st.integers(0, 10**6), later=st.integers(0, CAPACITY - 1))
def test_rounding_of_times_never_misses_a_sample(start, later):
    """However long a flight, floating-point times that mean a tick play the sample of that tick."""
    component = sequencer(plan(1, start * TICK))
    assert at(component, (start + later) * TICK)[:2] == (1, later)
    assert at(component, start * TICK + later * TICK)[:2] == (1, later)


def test_plays_at_initialization():
    """Between initialization and the first step the first sample is commanded already."""
    assert playing(sequencer(plan(1, 0.0))) == (1, 0, "plan")


def test_the_newest_plan_takes_over_at_its_start():
    """A plan that begins now is played from its first sample on."""
    component = sequencer(plan(1, 0.0))
    assert at(component, 0.45) == (1, 9, "plan")
    assert at(component, 0.5, plan(2, 0.5)) == (2, 0, "plan")
    assert at(component, 0.55) == (2, 1, "plan")


def test_a_plan_that_arrives_after_its_start_joins_in_the_middle():
    """Half a second late, its samples are still played on their own times."""
    component = sequencer(plan(1, 0.0))
    assert at(component, 0.7) == (1, 14, "tail")
    assert at(component, 0.75, plan(2, 0.5)) == (2, 5, "plan")


def test_a_future_plan_waits():
    """Until its start the old one goes on, sample by sample, tail included."""
    component = sequencer(plan(1, 0.0))
    assert at(component, 0.3, plan(2, 0.6)) == (1, 6, "plan")
    assert at(component, 0.55) == (1, 11, "tail")
    assert at(component, 0.6) == (2, 0, "plan")


def test_without_a_new_plan_the_old_goes_on_to_its_tail_and_then_trim():
    """Plan for an update period, then tail, then the last sample, which is trim, for ever."""
    component = sequencer(plan(1, 0.0))
    played = [at(component, tick * TICK) for tick in range(CAPACITY + 20)]
    assert played[:10] == [(1, k, "plan") for k in range(10)]
    assert played[10:CAPACITY] == [(1, k, "tail") for k in range(10, CAPACITY)]
    assert played[CAPACITY:] == [(1, CAPACITY - 1, "trim")] * 20


def test_a_late_plan_ends_the_tail_and_the_trim():
    """From tail or trim a new plan is taken up at once."""
    component = sequencer(plan(1, 0.0))
    assert at(component, 1.5)[2] == "tail"
    assert at(component, 1.55, plan(2, 1.5)) == (2, 1, "plan")
    assert at(component, 9.0)[2] == "trim"
    assert at(component, 9.05, plan(3, 9.0)) == (3, 1, "plan")


def test_no_plan_yet_is_trim():
    """Sequence 0 is the controller's trim before it has planned."""
    assert at(sequencer(plan(0, 0.0)), 0.1) == (0, 2, "trim")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_plan_that_is_not_finite_is_not_played(bad):
    """The old one goes on, and the next good one is taken up."""
    component = sequencer(plan(1, 0.0))
    assert at(component, 0.5, plan(2, 0.5, fill=bad)) == (1, 10, "tail")
    assert at(component, 0.55) == (1, 11, "tail")
    assert at(component, 1.0, plan(3, 1.0)) == (3, 0, "plan")


def test_what_was_set_is_copied():
    """Arrays that change after they were set do not change what is played."""
    values = plan(1, 0.0)
    component = sequencer(values)
    values["plan.thrust"][:] = -1.0
    assert at(component, 0.1) == (1, 2, "plan")


def test_goes_on_from_a_saved_state():
    """Waiting, playing and held plans survive a round trip, in another sequencer too."""
    component, twin = sequencer(plan(1, 0.0)), sequencer()
    at(component, 0.3, plan(2, 0.6))
    twin.set_state(component.get_state())
    assert playing(twin) == playing(component)
    for tick in range(7, 2 * CAPACITY):
        assert at(twin, tick * TICK) == at(component, tick * TICK)


def test_initializing_again_forgets_what_was_played():
    """A second flight begins with the plan that is set then."""
    component = sequencer(plan(5, 0.0))
    at(component, 1.0)
    component.set(plan(1, 0.0))
    component.initialize(start_time=0.0)
    assert playing(component) == (1, 0, "plan")
    component.terminate()
    component.terminate()


@pytest.mark.parametrize(("form", "fourth"), [("attitude", "heading"), ("actuator", "tail")])
def test_describes_itself(form, fourth):
    """Plan in, command and what is playing out, all fed through from the plan."""
    component = PlanSequencer(SequencerParameters(command=form, plan_capacity=CAPACITY))
    description = component.describe()
    assert validate_model_description(description) == []
    found = {one.name: one for one in description.modelVariables}
    assert found[f"plan.{fourth}"].shape == (CAPACITY,)
    outputs = {name for name, one in found.items() if one.causality == "output"}
    assert outputs == {
        "command.thrust", "command.pitch", "command.roll", f"command.{fourth}",
        "playing.sequence", "playing.source",
    }  # fmt: skip
    for unknown in description.outputs:
        assert {one.name.partition(".")[0] for one in unknown.dependencies} == {"plan"}


def test_an_unknown_name_is_an_error_with_the_nearest():
    """Neither set nor get takes a name that the description lacks."""
    with pytest.raises(KeyError, match=r"'plan\.thrsut'.*'plan\.thrust'"):
        sequencer().set({"plan.thrsut": 0.0})
    with pytest.raises(KeyError, match=r"'command\.tail'"):
        sequencer().get(["command.tail"])
