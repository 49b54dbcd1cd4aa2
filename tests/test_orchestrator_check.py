"""The conformance suite finds what it promises to find."""

import re

import numpy as np
import pytest
from scripted import Row, Scripted, counter, gain, integrator, make_restorable
from small_faults import FaultParameters

from orchestrator.conformance import check
from orchestrator.conformance.check import CONTRACT, check_component
from orchestrator.fmu.component import FmuParameters


def verdicts(factory, **more):
    """Return verdict by clause."""
    return {clause.name: clause.verdict for clause in check_component(factory, **more)}


def details(factory, **more):
    """Return the failed clauses with their details."""
    return {c.name: c.detail for c in check_component(factory, **more) if c.verdict == "failed"}


def broken(make, **members):
    """Return a factory of components with other members."""

    def factory():
        component = make()
        for name, member in members.items():
            setattr(component, name, member(component))
        return component

    return factory


@pytest.mark.parametrize("factory", [integrator, counter, gain], ids=lambda f: f.__name__)
def test_good_components_pass(factory):
    """A component that keeps the contract passes every clause that applies."""
    found = verdicts(factory)
    assert list(found) == list(CONTRACT)
    optional = {found.pop(name) for name in ("step sizes", "snapshot", "state")}
    assert optional == {"not applicable"}
    assert set(found.values()) == {"passed"}


def test_state_continues_in_a_new_process():
    """An advertised state is restored elsewhere to the same last bit."""
    clauses = check_component("scripted:make_restorable", {"start": 2.0})
    assert "failed" not in {clause.verdict for clause in clauses}
    assert clauses[-1].verdict == "passed"
    assert clauses[-1].detail.endswith(" bytes")


def test_an_incomplete_state_is_found():
    """A state without the random generator continues differently."""
    assert details("scripted:make_forgetful") == {
        "state": "canSerializeFMUstate does not hold: outputs after the restored state differ"
    }


def test_state_needs_a_factory_by_name():
    """What cannot be tried is said, not passed."""
    clause = check_component(make_restorable)[-1]
    assert (clause.verdict, clause.detail) == (
        "not applicable", "not tried: the factory must be 'module:attribute'",
    )  # fmt: skip


def test_a_crash_is_a_clause_that_is_not_kept():
    """In a process of its own a component that dies fails that clause; the others are checked."""
    arguments = {"parameters": FaultParameters("crash", at_s=0.1)}
    found = check_component("small_faults:Counter", arguments, timeout_s=60)
    failed = {clause.name: clause.detail for clause in found if clause.verdict == "failed"}
    assert failed["status"] == failed["state"] == "process died, killed by SIGSEGV"
    assert "description" not in failed


@pytest.mark.parametrize(
    ("fmi", "names"),
    [(2, ("get", "set", "terminate")), (3, ("construction", "determinism"))],
)
def test_an_fmu_of_one_instance_per_process_is_never_asked_for_a_second(
    fmu, fmi, names, monkeypatch
):
    """Every clause, and every other instance of a clause, has a process of its own."""
    monkeypatch.setattr(check, "CONTRACT", {name: CONTRACT[name] for name in names})
    arguments = {"parameters": FmuParameters(fmu("decay", fmi=fmi, ONCE=1))}
    found = check_component("orchestrator.fmu.component:FmuComponent", arguments, timeout_s=60)
    assert {c.name: (c.verdict, c.detail) for c in found if c.verdict != "passed"} == {}


def only(component):
    """Return a method that describes a component as one of one instance per process."""
    describe = component.describe

    def described():
        description = describe()
        description.coSimulation.canBeInstantiatedOnlyOncePerProcess = True
        return description

    return described


def test_a_second_instance_that_cannot_be_elsewhere_is_not_made():
    """What would need one is said not to have been tried; the rest is checked with one."""
    made = []

    def factory():
        assert not any(one.alive for one in made)
        component = broken(integrator, describe=only)()
        component.alive = True
        component.terminate = lambda: setattr(component, "alive", False)
        made.append(component)
        return component

    found = check_component(factory)
    assert {c.name for c in found if c.detail.startswith("not tried: the factory")} == {
        "construction", "get", "set", "subsets", "determinism", "terminate",
    }  # fmt: skip
    assert {c.verdict for c in found if c.detail.startswith("not tried")} == {"not applicable"}
    assert "failed" not in {c.verdict for c in found}


def remembering(*, forgets):
    """Return a component with snapshots, which may lack something."""

    def factory():
        component = counter(kind="continuous", variable_step=True, is_restorable=True)
        component.snapshot = lambda: {"seen": 0.0} if forgets else dict(component.values)
        component.rewind = lambda kept: component.values.update(kept)
        component.release = lambda kept: None
        return component

    return factory


def test_snapshots_are_believed_when_they_hold():
    """Going back within an instance is tried where the description says that it is possible."""
    assert verdicts(remembering(forgets=False))["snapshot"] == "passed"
    assert details(remembering(forgets=True)) == {
        "snapshot": "canGetAndSetFMUstate does not hold: outputs after going back differ"
    }


def test_variable_steps_are_believed_when_they_hold():
    """Steps of other sizes are tried where the description says that they are possible."""

    def factory():
        component = counter(kind="continuous", variable_step=True)
        component.behave = lambda values, time, step_size: 2 * (step_size < 0.5)
        return component

    assert verdicts(remembering(forgets=False))["step sizes"] == "passed"
    assert details(factory) == {
        "step sizes": "canHandleVariableCommunicationStepSize does not hold: "
        "a step of 0.25 s answered 2"
    }


def noisy():
    """Return a component that draws from the global generator when it is made."""
    np.random.rand()  # noqa: NPY002
    return integrator()


def handing_out():
    """Return a component that hands out its own arrays."""
    component = Scripted("sampled", 2.0, [Row("y", "output", shape=(2,))])
    component.get = lambda names: {"y": component.values["y"]}
    return component


def aliasing():
    """Return a component that keeps the arrays that it is given."""
    component = Scripted(
        "sampled", 2.0, [Row("x", "input", shape=(2,)), Row("y", "output", shape=(2,))]
    )
    component.set = component.values.update
    component.get = lambda names: {"y": component.values["x"]}
    return component


def counting_reads():
    """Return a component whose output rises when it is read."""
    component = integrator()

    def pass_on(values):
        values["y"] += 1.0

    component.pass_on = pass_on
    return component


def tunable():
    """Return a component with two inputs and a tunable parameter."""
    rows = [Row(name, "input", 1.0) for name in ("u", "v")]
    rows += [Row("k", "parameter", 2.0, variability="tunable"), Row("y", "output")]

    def behave(values, time, step_size):
        values["y"] = values["k"] * (values["u"] + values["v"])

    return Scripted("sampled", 2.0, rows, behave)


def greedy():
    """Return a component that expects all of its inputs whenever one is set."""
    component = tunable()
    keep = component.set
    component.set = lambda values: (keep(values), values["u"])
    return component


def forgetful():
    """Return a component that takes what is not set for zero."""
    component = tunable()
    keep = component.set
    component.set = lambda values: keep({"u": 0.0, "v": 0.0, **values})
    return component


CASES = [
    (broken(integrator, misnamed=lambda c: c.rows.append(Row("1y", "output"))), "description"),
    (noisy, "construction"),
    (broken(integrator, kind=lambda c: "sometimes"), "execution"),
    (broken(integrator, rate_hz=lambda c: 3.0), "execution"),
    (broken(integrator, get=lambda c: lambda names: {"y": True}), "outputs"),
    (broken(integrator, get=lambda c: lambda names: {"y": np.ones(1)}), "outputs"),
    (broken(integrator, get=lambda c: lambda names: {"y": float("nan")}), "outputs"),
    (broken(integrator, get=lambda c: lambda names: {}), "outputs"),
    (counting_reads, "get"),
    (handing_out, "get"),
    (aliasing, "set"),
    (broken(integrator, set=lambda c: c.values.update), "names"),
    (broken(integrator, step=lambda c: lambda time, h: 3), "status"),
    (broken(integrator, step=lambda c: lambda time, h: None), "status"),
    (broken(integrator, step=lambda c: lambda time, h: True), "status"),
    (greedy, "subsets"),
    (forgetful, "subsets"),
    (broken(integrator, get=lambda c: lambda names: 1 / 0), "outputs"),
    (broken(gain, behave=lambda c: lambda v, t, h: v.update(z=float(id(c)))), "determinism"),
    (broken(integrator, terminate=lambda c: iter([None]).__next__), "terminate"),
]


@pytest.mark.parametrize(
    ("factory", "clause"), CASES, ids=[f"{i}-{c[1]}" for i, c in enumerate(CASES)]
)
def test_every_broken_promise_is_found(factory, clause):
    """A component that breaks a clause fails that clause, and says why."""
    assert details(factory)[clause]


def test_inputs_and_steps_can_be_given():
    """Inputs are held at what is given instead of their start values."""
    seen = []

    def factory():
        component = integrator()
        component.behave = lambda values, time, h: seen.append((values["u"], time, h)) or 0
        return component

    verdicts(factory, inputs={"u": 2.5}, step_s=0.5, steps=3)
    assert set(seen) == {(2.5, 0.0, 0.5), (2.5, 0.5, 0.5), (2.5, 1.0, 0.5)}


def test_a_clause_reads_as_a_sentence():
    """Printed clauses give verdict, promise and detail."""
    clause = check_component(integrator)[0]
    assert str(clause) == (
        "        passed  the description is valid by FMPy, names and structure included (3 variables)"
    )


def test_inputs_and_tunable_parameters_are_set_one_by_one():
    """As a run sets them: a component that keeps what is not there passes."""
    assert verdicts(tunable)["subsets"] == "passed"
    assert re.fullmatch(
        r"of 'v' alone: set failed, KeyError: 'u' \(test_orchestrator_check.py:\d+\)",
        details(greedy)["subsets"],
    )


def test_an_int_for_a_float_passes():
    """What a run takes for a float is one here too."""
    assert "failed" not in verdicts(broken(integrator, get=one_or_key_error)).values()


def one_or_key_error(component):
    """Return a ``get`` that answers an int."""
    real = component.get
    return lambda names: {name: int(value) for name, value in real(names).items()}


ONE_CAUSE = [
    (broken(integrator, describe=lambda c: lambda: 1 / 0), "description", "describe failed, Zero"),
    (broken(integrator, describe=lambda c: lambda: None), "description", "describe answered None"),
    (broken(integrator, initialize=lambda c: lambda a, b: None), "outputs", "initialize failed, T"),
    (broken(integrator, step=lambda c: lambda time: 0), "status", "step failed, TypeError: "),
    (broken(integrator, step=lambda c: lambda time, h: None), "status", "step answered None, "),
    (broken(integrator, get=lambda c: lambda names: 1 / 0), "outputs", "get failed, ZeroDivision"),
]


@pytest.mark.parametrize(("factory", "clause", "detail"), ONE_CAUSE)
def test_one_cause_is_told_once(factory, clause, detail):
    """Clauses that it keeps from being tried are not failed as well, and say where to look."""
    found = check_component(factory)
    (told,) = (c for c in found if c.verdict == "failed" and c.name != "names")
    assert told.name == clause
    assert told.detail.startswith(detail)
    skipped = [c.detail for c in found if c.verdict == "not tried"]
    assert len(skipped) >= 5
    assert all(line.endswith(f"failed, see {clause!r}") for line in skipped)


def test_what_cannot_be_made_is_not_checked():
    """The factory's exception is the answer, with its place."""
    place = r"\(test_orchestrator_check.py:\d+\)"
    told = f"cannot be made, constructor failed, ZeroDivisionError: division by zero {place}"
    with pytest.raises(ValueError, match=told):
        check_component(lambda: 1 / 0)
