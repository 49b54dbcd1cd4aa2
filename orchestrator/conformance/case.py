"""A component under test: made again and again, here or in other processes, and run."""

import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pkgutil import resolve_name
from traceback import walk_tb
from typing import Any, TypeVar

from orchestrator.assembly.clock import SECOND, period_ns
from orchestrator.assembly.description import Port, ports
from orchestrator.component import Component, Execution, Instance, Status, Value
from orchestrator.errors import RAISED, CouplingError
from orchestrator.failure import failure
from orchestrator.isolation.process import Process

SEED = 20050603
T = TypeVar("T")


class NotApplicable(Exception):  # noqa: N818  (a verdict)
    """The clause says nothing about this component."""


class Broken(Exception):  # noqa: N818  (a verdict)
    """The clause is not kept.

    Attributes
    ----------
    stage : str
        What could not be done, where that keeps other clauses from being tried too:
        ``construction``, ``description``, ``execution``, ``initialization``, ``step`` or ``get``.
    """

    def __init__(self, what: str, stage: str = "") -> None:
        super().__init__(what)
        self.stage = stage


@dataclass(frozen=True)
class Case:
    """A component to be made again and again, and how to run it: see ``check_component``."""

    factory: str | Callable[..., Component]
    arguments: Mapping[str, Any]
    step_s: float | None
    steps: int
    given: Mapping[str, Value] | None
    made: list[Instance] = field(default_factory=list[Instance])

    def new(self) -> Instance:
        """Return a new instance."""
        factory = resolve_name(self.factory) if isinstance(self.factory, str) else self.factory
        try:
            instance = Instance("component", factory(**self.arguments))
        except RAISED as error:
            what = failure(error, factory, "constructor")
            raise Broken(what, "construction") from error
        self.made.append(instance)
        return instance

    def ports(self, instance: Instance) -> dict[str, Port]:
        """Return an instance's ports."""
        try:
            return ports(instance.name, instance.description)
        except CouplingError as error:
            raise Broken(_plain(instance, error), "description") from error

    def execution(self, instance: Instance) -> Execution:
        """Return when an instance runs."""
        try:
            return instance.execution
        except CouplingError as error:
            raise Broken(_plain(instance, error), "execution") from error

    def read(self, instance: Instance, names: Sequence[str]) -> dict[str, Value]:
        """Return an instance's outputs."""
        try:
            return dict(instance.get(names))
        except RAISED as error:
            raise Broken(failure(error, instance.component, "get"), "get") from error

    def started(self) -> tuple[Instance, dict[str, Port]]:
        """Return a new instance with its inputs set, initialized, and its ports."""
        instance = self.new()
        return instance, self.start(instance)

    def start(self, instance: Instance) -> dict[str, Port]:
        """Set an instance's inputs, initialize it, and return its ports."""
        own = self.ports(instance)
        inputs, call = self.inputs(own), "set"
        try:
            if inputs:
                instance.set(inputs)
            call = "initialize"
            instance.initialize(start_time=0.0, stop_time=None, seed=SEED)
        except RAISED as error:
            what = failure(error, instance.component, call)
            raise Broken(what, "initialization") from error
        return own

    def unmake(self) -> None:
        """Terminate all that was made."""
        while self.made:
            with suppress(Exception):  # a clause of its own
                self.made.pop().component.terminate()

    def beside(self, instance: Instance, task: "Callable[[Case], T]") -> T:
        """Return what a task finds with an instance of its own, besides one that is here.

        Where that allows no other in its process, the task has a new one.
        """
        return self.elsewhere(task) if is_only(instance) else task(self)

    def elsewhere(self, task: "Callable[..., T]", *arguments: object) -> T:
        """Return what a task finds in a new process.

        Raises
        ------
        NotApplicable
            If the component cannot be made there.
        """
        if not isinstance(self.factory, str):
            raise NotApplicable("not tried: the factory must be 'module:attribute'")
        try:
            pickle.dumps(self.arguments)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise NotApplicable(f"not tried: the arguments cannot be pickled, {error}") from error
        process = Process()
        try:
            return process.ask("call", _alone, task, replace(self, made=[]), *arguments)
        finally:
            process.close()

    def inputs(self, own: Mapping[str, Port]) -> dict[str, Value]:
        """Return the inputs that are held during every check: as given, else the start values."""
        start = {n: p.start for n, p in own.items() if p.causality == "input"}
        known = {n: value for n, value in start.items() if value is not None}
        return {**known, **(self.given or {})}

    def size(self, instance: Instance) -> float:
        """Return the step size, s."""
        return self.step_s or period_ns(self.execution(instance).rate_hz) / SECOND

    def run(
        self, instance: Instance, first: int, count: int, *, reads: int = 1
    ) -> list[dict[str, Value]]:
        """Take ``count`` steps from step ``first`` on and return the outputs after each."""
        size = self.size(instance)
        names = outputs(self.ports(instance))
        rows: list[dict[str, Value]] = []
        for k in range(first, first + count):
            try:
                status = instance.step(k * size, size)
            except CouplingError as error:
                raise Broken(_plain(instance, error), "step") from error
            except RAISED as error:
                raise Broken(failure(error, instance.component, "step"), "step") from error
            if status not in (Status.OK, Status.WARNING, Status.DISCARD):
                raise Broken(f"step at t = {k * size:g} s answered {status!r}", "step")
            rows.append([self.read(instance, names) for _ in range(reads)][-1])
        return rows


def _plain(instance: Instance, error: CouplingError) -> str:
    return str(error).removeprefix(f"component {instance.name!r}: ")


def called(error: BaseException) -> tuple[object, str]:
    """Return the component that raised, and in which call of its ``Instance``, if it was one."""
    frames = [(f.f_locals.get("self"), f.f_code.co_name) for f, _ in walk_tb(error.__traceback__)]
    calls = [(one.component, name) for one, name in frames if isinstance(one, Instance)]
    return calls[-1] if calls else (None, "")


def is_only(instance: Instance) -> bool:
    """Return whether no other can be made in its process."""
    co_simulation = instance.description.coSimulation
    return co_simulation is not None and bool(co_simulation.canBeInstantiatedOnlyOncePerProcess)


def _alone(task: Callable[..., T], case: Case, *arguments: object) -> T:
    """Return what a task finds, with nothing left of it."""
    try:
        return task(case, *arguments)
    finally:
        case.unmake()


def outputs(own: Mapping[str, Port]) -> list[str]:
    """Return the names of the outputs among a component's ports."""
    return [name for name, port in own.items() if port.causality == "output"]
