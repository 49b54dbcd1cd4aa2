"""The life cycle: one table, enforced by Instance."""

import re
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import Execution, integrator

from orchestrator.component import LIFE_CYCLE, Instance, Status
from orchestrator.errors import CouplingError

CALLS = {
    "initialize": lambda instance: instance.initialize(start_time=0.0, stop_time=None, seed=0),
    "set": lambda instance: instance.set({"u": 1.0}),
    "get": lambda instance: instance.get(["y"]),
    "step": lambda instance: instance.step(0.0, 0.05),
    "terminate": lambda instance: instance.terminate(),
}


def started(behave):
    """Return an initialized instance with the given step."""
    component = integrator()
    component.behave = behave
    instance = Instance("plant", component)
    CALLS["initialize"](instance)
    return instance


@given(st.lists(st.sampled_from(sorted(CALLS)), max_size=12))
def test_every_sequence_of_calls_follows_the_table(calls):
    """A call that the table lists reaches the component; any other is refused before it."""
    log, state = [], "created"
    instance = Instance("plant", integrator(name="plant", log=log))
    for call in calls:
        before = len(log)
        if call not in LIFE_CYCLE[state]:
            with pytest.raises(
                CouplingError, match=f"{call} is not permitted, got state '{state}'"
            ):
                CALLS[call](instance)
            assert len(log) == before
        else:
            CALLS[call](instance)
            assert len(log) == before + (0 if state == call + "d" == "terminated" else 1)
            state = LIFE_CYCLE[state][call]
        assert instance.state == state


def test_error_leaves_only_terminate():
    """After Error the component can be terminated, and nothing else."""
    instance = started(lambda values, time, h: Status.ERROR)
    assert CALLS["step"](instance) == Status.ERROR
    with pytest.raises(CouplingError, match="expected 'initialized' or 'stepping'"):
        CALLS["step"](instance)
    instance.terminate()
    assert instance.state == "terminated"


def test_fatal_is_never_called_again():
    """After Fatal not even terminate reaches the component."""
    instance = started(lambda values, time, h: Status.FATAL)
    instance.component.log = log = []
    CALLS["step"](instance)
    instance.terminate()
    assert [entry[1] for entry in log] == ["step"]


def test_an_exception_counts_as_error():
    """A step that raises ends the life cycle, and the exception goes on."""
    instance = started(lambda values, time, h: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        CALLS["step"](instance)
    assert instance.state == "error"


def test_a_failed_initialization_counts_as_error():
    """An initialize that raises leaves only terminate."""
    component = integrator()
    component.initialize = lambda **_: 1 / 0
    instance = Instance("plant", component)
    with pytest.raises(ZeroDivisionError):
        CALLS["initialize"](instance)
    assert instance.state == "error"


@pytest.mark.parametrize("answer", [None, True, 5, -1, 0.0, "0"])
def test_step_answers_a_status(answer):
    """A step that answers anything but an integer from 0 to 4 breaks the contract."""
    instance = started(None)
    instance.component.step = lambda time, step_size: answer
    with pytest.raises(CouplingError) as caught:
        CALLS["step"](instance)
    assert str(caught.value) == f"step answered {answer!r}, expected a status 0 to 4"
    assert instance.state == "error"


def test_what_is_no_component_is_refused_by_what_it_lacks():
    """All that is missing at once, and where the class is."""
    with pytest.raises(CouplingError) as caught:
        _ = Instance("plant", Empty()).description
    line = re.search(r"test_orchestrator_component.py:(\d+)", str(caught.value))[1]
    assert str(caught.value) == (
        "component 'plant': no describe, initialize, set, get, step, got Empty "
        f"(test_orchestrator_component.py:{line}), "
        "expected describe, initialize, set, get, step, terminate"
    )


class Empty:
    """No component."""

    def terminate(self):
        """Do nothing."""


def test_a_description_that_fails_or_is_none_is_told():
    """One line names the call, the exception and its place."""
    component = integrator()
    component.describe = lambda: 1 / 0
    place = r"\(test_orchestrator_component.py:\d+\)$"
    told = f"'plant': describe failed, ZeroDivisionError: division by zero {place}"
    with pytest.raises(CouplingError, match=told):
        _ = Instance("plant", component).description
    component.describe = lambda: None
    with pytest.raises(CouplingError, match="describe answered None, expected a ModelDescription"):
        _ = Instance("plant", component).description


@pytest.mark.parametrize("execution", [None, "sampled", Execution("sampled", "20")])
def test_an_execution_says_kind_rate_and_interface(execution):
    """Anything else is refused, with what was found."""
    made = SimpleNamespace(execution=execution)
    with pytest.raises(CouplingError) as caught:
        _ = Instance("plant", made).execution
    assert str(caught.value).startswith(f"component 'plant': wrong execution, got {execution!r},")


def test_step_mode_hands_out_the_component():
    """The run loop checks once and then calls the component itself."""
    instance = started(None)
    assert instance.enter_step_mode() is instance.component
    assert instance.state == "stepping"


def test_the_description_is_asked_for_once():
    """An instance keeps its description."""
    instance = Instance("plant", integrator())
    assert instance.description is instance.description
    assert not instance.is_restorable
