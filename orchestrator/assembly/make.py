"""Make what was planned: call the constructors, and say which of them refuse."""

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from threading import Timer
from typing import Any

from orchestrator.assembly.plan import Plan
from orchestrator.errors import RAISED, Problem, ScenarioError
from orchestrator.failure import failure, place
from orchestrator.scenario.marks import KeyPath, dotted

PATIENCE = 1.0  # s, after which a construction is announced
Announce = Callable[[str], None]


def silent(_: str) -> None:
    """Announce nothing."""


def make(
    plans: Iterable[Plan], announce: Announce = silent, made: dict[KeyPath, Any] | None = None
) -> dict[KeyPath, Any]:
    """Return the resources and components of plans, by path; in ``made``, where that is given.

    Raises
    ------
    ScenarioError
        With all that constructors raise, not yet located; its cause is the first of it.
    """
    made = {} if made is None else made
    problems: list[Problem] = []
    cause: BaseException | None = None
    for plan in plans:
        if not all(path in made for path in plan.needs):
            continue  # that one has failed, and is reported
        try:
            with announced(str(plan.path[1]), announce):
                made[plan.path] = plan.factory(**arguments(plan, made))
        except RAISED as error:
            problems.append(problem(plan, error))
            cause = cause or error
    if problems:
        raise ScenarioError(problems) from cause
    return made


def arguments(plan: Plan, made: Mapping[KeyPath, Any]) -> dict[str, Any]:
    """Return what a plan's factory is called with."""
    return {**plan.arguments, **{k: made["resources", name] for k, name in plan.resources.items()}}


def needed(plan: Plan, plans: Sequence[Plan]) -> list[Plan]:
    """Return the plans of the resources that a plan needs, in order of making."""
    paths = set(plan.needs)
    for other in reversed(plans):
        if other.path in paths:
            paths.update(other.needs)
    return [other for other in plans if other.path in paths]


@contextmanager
def announced(name: str, announce: Announce) -> Generator[None]:
    """Tell the name of what takes more than 1 s to make."""
    timer = Timer(PATIENCE, announce, [name])
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def problem(plan: Plan, error: BaseException) -> Problem:
    """Return what a constructor raised; at the parameter that its message begins with, if any.

    It refuses by a ValueError, an OSError or an ImportError; everything else is a mistake in it.
    """
    if not isinstance(error, ValueError | OSError | ImportError):
        what = failure(error, plan.factory, "constructor")
        return Problem(plan.path, f"{dotted(plan.path)}: {what}")
    text = str(error)
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.strerror.lower()}, got {str(error.filename)!r}"
    name, _, what = text.partition(": ")
    if hasattr(plan.arguments.get("parameters"), name):
        path = (*plan.path, "parameters", name)
        return Problem(path, f"{dotted(path)}: {what}")
    return Problem(plan.path, f"{dotted(plan.path)}: {text}{place(error)}")
