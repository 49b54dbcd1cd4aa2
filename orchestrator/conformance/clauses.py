"""How the clauses of the component contract are tested: one function each, see ``check.py``."""

import random
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from orchestrator.assembly.clock import period_ns
from orchestrator.assembly.description import Port, mismatch, plain
from orchestrator.component import INTERFACE, Status, Value
from orchestrator.conformance.case import Broken, Case, NotApplicable, outputs
from orchestrator.errors import RAISED, CouplingError
from orchestrator.failure import failure
from orchestrator.run.finite import nonfinite

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


def description(case: Case) -> str | None:
    """Validate by FMPy; its check of names is too slow for every start of a run."""
    from fmpy.validation import validate_model_description

    instance = case.new()
    own = case.ports(instance)
    problems = validate_model_description(
        instance.description, validate_variable_names=True, validate_model_structure=True
    )
    _refuse("; ".join(problems))
    return f"{len(own)} variables"


def construction(case: Case) -> None:
    """Make two, and watch the global random generators."""
    shared = (random.getstate(), _bits(np.random.get_state()))  # noqa: NPY002
    first = case.new()
    case.ports(first)
    texts = [_text(first.description), case.beside(first, _described)]
    texts.append(_text(first.component.describe()))
    _refuse("two descriptions differ" if len(set(texts)) > 1 else "")
    now = (random.getstate(), _bits(np.random.get_state()))  # noqa: NPY002
    _refuse("a global random generator was used" if now != shared else "")


def _described(case: Case) -> str:
    return _text(case.new().component.describe())


def execution(case: Case) -> str:
    """Read the record."""
    execution = case.execution(case.new())
    _refuse("" if execution.kind in ("continuous", "sampled") else f"kind {execution.kind!r}")
    _refuse("" if execution.interface == INTERFACE else f"interface {execution.interface!r}")
    period_ns(execution.rate_hz)
    return f"{execution.kind}, {execution.rate_hz:g} Hz"


def outputs_as_described(case: Case) -> None:
    """Compare every output of a run with its port."""
    instance, own = case.started()
    names = outputs(own)
    for values in [case.read(instance, names), *case.run(instance, 0, case.steps)]:
        for name in names:
            port = own[name]
            fault = mismatch(port, plain(port, values[name])) if name in values else "is missing"
            _refuse(f"output {name!r}: {fault}" if fault else "")
        _refuse(nonfinite(own, values) or "")


def get_copies(case: Case) -> None:
    """Overwrite what get returned and read again; compare with one that is read less often."""
    instance, own = case.started()
    names = outputs(own)
    first = case.read(instance, names)
    before = _bits(first)
    for value in first.values():
        if isinstance(value, np.ndarray) and value.flags.writeable:
            value[...] = np.zeros((), value.dtype) if value.dtype.kind != "f" else -1e9
    first.clear()
    _refuse("the second read differs" if _bits(instance.get(names)) != before else "")
    seldom = case.beside(instance, _run)
    often = _bits(case.run(instance, 0, case.steps, reads=3))
    _refuse("reading more often changes outputs" if seldom != often else "")


def _run(case: Case) -> bytes:
    instance, _ = case.started()
    return _bits(case.run(instance, 0, case.steps))


def set_copies(case: Case) -> None:
    """Overwrite what was set, and compare with an instance for which it is kept."""
    changed, own = case.started()
    inputs = case.inputs(own)
    if not inputs:
        raise NotApplicable("there are no inputs")
    values = {n: np.array(v) if isinstance(v, np.ndarray) else v for n, v in inputs.items()}
    changed.set(values)
    for value in values.values():
        if isinstance(value, np.ndarray):
            value[...] = -1e9 if value.dtype.kind == "f" else np.zeros((), value.dtype)
    values.clear()
    same = case.beside(changed, _set_again) == _bits(case.run(changed, 0, 1))
    _refuse("" if same else "outputs follow the caller's mapping or array")


def _set_again(case: Case) -> bytes:
    kept, own = case.started()
    kept.set(case.inputs(own))
    return _bits(case.run(kept, 0, 1))


def set_subsets(case: Case) -> None:
    """Set everything one by one, and compare with an instance for which it is set at once."""
    singly, own = case.started()
    values = _settable(case, own)
    if not values:
        raise NotApplicable("nothing can be set")
    for name, value in values.items():
        try:
            singly.set({name: value})
        except RAISED as error:
            what = failure(error, singly.component, "set")
            raise Broken(f"of {name!r} alone: {what}") from error
    at_once = case.beside(singly, _set_at_once)
    same = _bits(case.run(singly, 0, 1)) == at_once
    _refuse("" if same else "setting one by one gives other outputs than setting all at once")


def _set_at_once(case: Case) -> bytes:
    instance, own = case.started()
    instance.set(_settable(case, own))
    return _bits(case.run(instance, 0, 1))


def _settable(case: Case, own: Mapping[str, Port]) -> dict[str, Value]:
    """Return values of the inputs and tunable parameters."""
    tunable = {
        name: port.start
        for name, port in own.items()
        if port.causality == "parameter" and port.variability == "tunable"
    }
    return case.inputs(own) | {n: value for n, value in tunable.items() if value is not None}


def unknown_names(case: Case) -> None:
    """Ask for a misspelt name."""
    instance, own = case.started()
    calls: list[tuple[str, Callable[[str], object]]] = [
        ("set", lambda name: instance.set({name: 0.0})),
        ("get", lambda name: instance.get([name])),
    ]
    known = [n for n, p in own.items() if p.causality in ("input", "output")]
    for verb, call in calls:
        name = (known or ["x"])[-1] + "x"
        try:
            call(name)
        except KeyError as error:
            _refuse("" if any(n in str(error) for n in known) else f"{verb} says {error}")
        else:
            raise Broken(f"{verb} accepts {name!r}")


def status(case: Case) -> None:
    """Run."""
    instance, _ = case.started()
    case.run(instance, 0, case.steps)


def determinism(case: Case) -> None:
    """Run two instances."""
    instance, _ = case.started()
    other = case.beside(instance, _run)
    same = _bits(case.run(instance, 0, case.steps)) == other
    _refuse("" if same else "two instances differ")


def termination(case: Case) -> None:
    """Terminate at several moments."""
    instance, _ = case.started()
    instance.component.terminate()
    instance.component.terminate()
    case.beside(instance, _terminated_early)


def _terminated_early(case: Case) -> None:
    case.new().component.terminate()


def life_cycle(case: Case) -> None:
    """Try calls out of order."""
    instance = case.new()
    _refuse_order(lambda: instance.step(0.0, 1.0), "step before initialize")
    own = case.start(instance)
    _refuse_order(
        lambda: instance.initialize(start_time=0.0, stop_time=None, seed=0), "initialize twice"
    )
    instance.terminate()
    _refuse_order(lambda: instance.get(outputs(own)), "get after terminate")


def state(case: Case) -> str:
    """Save, go on here and in a new process, and compare."""
    instance, _ = case.started()
    if not instance.is_restorable:
        raise NotApplicable("canSerializeFMUstate is not advertised")
    case.run(instance, 0, case.steps)
    state = instance.get_state()
    here = _bits(case.run(instance, case.steps, case.steps))
    there = case.elsewhere(_continued, state)
    wrong = "canSerializeFMUstate does not hold: outputs after the restored state differ"
    _refuse("" if here == there else wrong)
    return f"{len(state)} bytes"


def _continued(case: Case, state: bytes) -> bytes:
    """Return the outputs of a new component that goes on from a saved state."""
    instance, _ = case.started()
    instance.set_state(state)
    return _bits(case.run(instance, case.steps, case.steps))


def snapshot(case: Case) -> None:
    """Keep a state in the same instance, go on, go back, and compare."""
    instance, _ = case.started()
    component: Any = instance.component
    co_simulation = instance.description.coSimulation
    if not hasattr(component, "snapshot"):
        raise NotApplicable("there is none")
    if co_simulation is None or not co_simulation.canGetAndSetFMUstate:
        raise NotApplicable("canGetAndSetFMUstate is not advertised")
    case.run(instance, 0, case.steps)
    kept = component.snapshot()
    rows: list[bytes] = []
    for _ in range(2):
        rows.append(_bits(case.run(instance, case.steps, case.steps)))
        component.rewind(kept)
    component.release(kept)
    wrong = "canGetAndSetFMUstate does not hold: outputs after going back differ"
    _refuse("" if rows[0] == rows[1] else wrong)


def step_sizes(case: Case) -> None:
    """Take steps of half and of twice the size."""
    instance, own = case.started()
    co_simulation = instance.description.coSimulation
    if co_simulation is None or not co_simulation.canHandleVariableCommunicationStepSize:
        raise NotApplicable("canHandleVariableCommunicationStepSize is not advertised")
    size, time = case.size(instance), 0.0
    for part in (0.5 * size, 0.5 * size, 2.0 * size, size):
        answer = instance.step(time, part)
        wrong = f"does not hold: a step of {part:g} s answered {answer!r}"
        _refuse(
            "" if answer <= Status.WARNING else f"canHandleVariableCommunicationStepSize {wrong}"
        )
        time += part
    _refuse(nonfinite(own, instance.get(outputs(own))) or "")


def _refuse(fault: str) -> None:
    """Raise unless there is nothing to say."""
    if fault:
        raise Broken(fault)


def _refuse_order(call: Callable[[], object], what: str) -> None:
    try:
        call()
    except CouplingError:
        return
    raise Broken(f"{what} is accepted")


def _bits(value: object) -> bytes:
    """Return everything that can be told apart in nested values."""
    if isinstance(value, Mapping):
        mapping = cast(Mapping[str, object], value)
        return b"{%s}" % b",".join(n.encode() + _bits(v) for n, v in sorted(mapping.items()))
    if isinstance(value, list | tuple):
        return b"[%s]" % b",".join(map(_bits, cast(Sequence[object], value)))
    array = np.asarray(value)
    return f"{array.dtype}{array.shape}".encode() + array.tobytes()


def _text(description: "ModelDescription") -> str:
    """Return a description as text that is equal where the content is."""
    from attrs import asdict

    return repr(asdict(description))
