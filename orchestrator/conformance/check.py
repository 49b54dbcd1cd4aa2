"""Check that a component keeps the contract; for authors of components, in this project or not.

>>> from orchestrator.conformance.check import check_component
>>> clauses = check_component("my_package:make_my_component")  # doctest: +SKIP
>>> print("; ".join(str(clause) for clause in clauses))  # doctest: +SKIP

One clause starts another process; all can be checked in one, for a component that may crash. What can
be instantiated only once per process has a new one for each clause, and for each other instance.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

from orchestrator.component import Component, Value
from orchestrator.conformance import clauses
from orchestrator.conformance.case import Broken, Case, NotApplicable, called, is_only
from orchestrator.errors import RAISED, ComponentDied, ComponentTimeout, CouplingError
from orchestrator.failure import failure
from orchestrator.isolation.process import Process

Verdict = Literal["passed", "failed", "not applicable", "not tried"]

# name: (promise, test); the test returns a detail worth telling, or raises
CONTRACT: dict[str, tuple[str, Callable[[Case], str | None]]] = {
    "description": (
        "the description is valid by FMPy, names and structure included",
        clauses.description,
    ),
    "construction": (
        "constructing and describing depend on the arguments alone and touch nothing shared",
        clauses.construction,
    ),
    "execution": (
        "the execution says continuous or sampled, a usable rate, and this interface",
        clauses.execution,
    ),
    "outputs": (
        "every output has the described type and shape and is finite, from the start on",
        clauses.outputs_as_described,
    ),
    "get": ("reading has no side effect and returns copies", clauses.get_copies),
    "set": (
        "setting takes copies: what the caller changes later has no effect",
        clauses.set_copies,
    ),
    "subsets": (
        "inputs and tunable parameters can be set one by one: what is not there stays",
        clauses.set_subsets,
    ),
    "names": (
        "an unknown name in set or get is a KeyError that says a near one",
        clauses.unknown_names,
    ),
    "status": ("every step answers OK, Warning or Discard", clauses.status),
    "determinism": (
        "equal arguments, seed and inputs give bit-identical outputs",
        clauses.determinism,
    ),
    "terminate": ("terminating twice, or before initializing, does no harm", clauses.termination),
    "life cycle": (
        "calls out of order are refused before they reach the component",
        clauses.life_cycle,
    ),
    "step sizes": (
        "where it says so, steps may be of any size",
        clauses.step_sizes,
    ),
    "snapshot": ("where it says so, it goes back to the same last bit", clauses.snapshot),
    "state": ("a saved state continues in a new process to the same last bit", clauses.state),
}


HOME = {"execution": "execution", "step": "status"}  # of a stage, the clause that is about it


@dataclass(frozen=True)
class Clause:
    """One promise of the contract and what became of it.

    ``stage`` is what failed before the clause itself could: see ``case.Broken``.
    """

    name: str
    promise: str
    verdict: Verdict
    detail: str = ""
    stage: str = ""

    def __str__(self) -> str:
        return f"{self.verdict:>14}  {self.promise}" + (f" ({self.detail})" if self.detail else "")


def check_component(
    factory: str | Callable[..., Component],
    arguments: Mapping[str, Any] | None = None,
    *,
    step_s: float | None = None,
    steps: int = 10,
    inputs: Mapping[str, Value] | None = None,
    timeout_s: float | None = None,
) -> list[Clause]:
    """Check every clause of the contract on components made by ``factory(**arguments)``.

    Parameters
    ----------
    factory : str or callable
        ``module:attribute`` or a callable; what starts another process needs the former.
    step_s : float, optional
        Step size, s; the component's preferred rate otherwise.
    steps : int
        How many steps a run takes.
    inputs : mapping, optional
        Inputs held throughout, instead of their start values.
    timeout_s : float, optional
        Check in another process, which may take so long for every clause, s; a crash or a hang is a
        clause that is not kept. The factory must be given by name. Without it, what can be
        instantiated only once per process is made here again and again, one after the other.

    Raises
    ------
    ValueError
        If the factory raises: there is nothing to check then.
    """
    case = Case(factory, arguments or {}, step_s, steps, inputs)
    if timeout_s is None:
        _make(case)
        return _told_once([_checked(name, case) for name in CONTRACT])
    process = Process()
    checked: list[Clause] = []
    try:
        process.limit(timeout_s)
        only = False
        with suppress(ComponentDied, ComponentTimeout):  # the clauses tell
            only = process.ask("call", _make, case)
        for name, (promise, _) in CONTRACT.items():
            if only:
                process.close()
            if not process.is_open:
                process = Process()
                process.limit(timeout_s)
            try:
                checked.append(process.ask("call", _checked, name, case))
            except (ComponentDied, ComponentTimeout) as error:
                checked.append(Clause(name, promise, "failed", str(error)))
    finally:
        process.close()
    return _told_once(checked)


def _told_once(checked: Sequence[Clause]) -> list[Clause]:
    """Return clauses of which one alone tells a cause that keeps others from being tried.

    That is the clause which is about it, else the first.
    """
    tells: dict[str, str] = {}
    for clause in checked:
        if clause.stage and HOME.get(clause.stage) == clause.name:
            tells[clause.stage] = clause.name
        elif clause.stage:
            tells.setdefault(clause.stage, clause.name)
    told: list[Clause] = []
    for clause in checked:
        if clause.stage and tells[clause.stage] != clause.name:
            detail = f"{clause.stage} failed, see {tells[clause.stage]!r}"
            told.append(replace(clause, verdict="not tried", detail=detail))
        else:
            told.append(clause)
    return told


def _make(case: Case) -> bool:
    """Make the component once, which may be refused; return whether its process takes no other."""
    try:
        instance = case.new()
        with suppress(Exception):  # a clause of its own
            return is_only(instance)
    except Broken as error:
        raise ValueError(f"cannot be made, {error}") from error
    finally:
        case.unmake()
    return False


def _checked(name: str, case: Case) -> Clause:
    """Test one clause, and terminate what it has made."""
    promise, test = CONTRACT[name]
    stage = ""
    try:
        verdict, detail = "passed", test(case) or ""
    except NotApplicable as error:
        verdict, detail = "not applicable", str(error)
    except Broken as error:
        verdict, detail, stage = "failed", str(error), error.stage
    except CouplingError as error:
        verdict, detail = "failed", str(error)
    except RAISED as error:
        verdict, detail = "failed", failure(error, *called(error))
    case.unmake()
    return Clause(name, promise, verdict, detail, stage)
