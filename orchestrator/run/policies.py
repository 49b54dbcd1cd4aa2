"""What becomes of a run when a component fails: end, or hold its outputs and go on.

Whatever happens is an event with its time first; nothing here depends on wall-clock time but
``overran``, which is only asked where the scenario sets a deadline.
"""

import traceback
from collections.abc import Callable, Iterable
from typing import Any, Literal

from orchestrator.assembly.description import Port
from orchestrator.component import Instance, Status, Value, is_status
from orchestrator.errors import RAISED, ComponentDied, ComponentTimeout, CouplingError
from orchestrator.failure import failure, show
from orchestrator.run.ranges import excess
from orchestrator.run.report import Ended, Report, at
from orchestrator.scenario.records import ComponentSpec

Step = Callable[[float, float], int]

MOST_HALVINGS = 6  # a refused step is tried in at most 64 parts


class Policies:
    """One component's policies; each method reports and returns only if the run goes on."""

    def __init__(self, instance: Instance, spec: ComponentSpec, report: Report) -> None:
        self._instance = instance
        self._spec = spec
        self._report = report
        self._on_error: Literal["hold", "end"] = "hold" if spec.on_error == "hold" else "end"
        self._told: set[str] = set()  # outputs that have been reported out of range

    def answered(self, time_ns: int, status: int) -> bool:
        """Deal with what a step answered; return whether its results count."""
        known = Status(status) if is_status(status) else None
        match known:
            case Status.OK:
                return True
            case Status.WARNING:
                self._apply(time_ns, "warning", self._said("step is done with a Warning"), "log")
                return True
            case Status.DISCARD:
                policy = "hold" if self._spec.on_discard == "hold" else "end"
                self._apply(time_ns, "discard", self._said("step is refused (Discard)"), policy)
            case _:
                self._instance.fail(fatal=known == Status.FATAL)
                policy = "end" if known == Status.FATAL else self._on_error
                self._apply(time_ns, *self._fault("step", status), policy)
        return False

    def failed(self, time_ns: int, call: str, error: BaseException) -> None:
        """Deal with an exception of a call: it counts as Error."""
        self._instance.fail()
        self._apply(time_ns, *self._fault(call, error), self._on_error, error)

    def restarted(self, call: str, found: int | BaseException) -> None:
        """Report a failure after which a new process goes on."""
        time_ns = self._report.time_ns
        error = found if isinstance(found, BaseException) else None
        self._apply(time_ns, *self._fault(call, found), "log", error)
        self._apply(
            time_ns, "restart", "goes on in a new process, from the last saved state", "log"
        )

    def tried_again(self, time_ns: int, parts: int) -> None:
        """Report that a refused step was tried again in parts."""
        self._apply(time_ns, "retry", f"step is tried again in {parts} parts", "log")

    def found_nonfinite(self, time_ns: int, what: str) -> None:
        """Deal with an output that is NaN or infinite."""
        self._apply(time_ns, "nonfinite", what, self._spec.on_nonfinite)

    def found_out_of_range(self, time_ns: int, found: Iterable[tuple[Port, Value]]) -> bool:
        """Deal with outputs beyond their bounds, each told once; return whether results count."""
        for port, value in found:
            if port.name not in self._told:
                self._told.add(port.name)
                self._apply(time_ns, "range", excess(port, value), self._spec.on_range)
        return self._spec.on_range == "log"

    def overran(self, time_ns: int, elapsed_s: float) -> bool:
        """Deal with a step that took longer than its deadline; return whether its results count."""
        what = f"step took {elapsed_s:.3f} s, expected at most {self._spec.deadline_s} s"
        self._apply(time_ns, "overrun", what, self._spec.on_overrun)
        return self._spec.on_overrun == "log"

    def _apply(
        self,
        time_ns: int,
        kind: str,
        what: str,
        policy: Literal["log", "hold", "end"],
        error: BaseException | None = None,
    ) -> None:
        """Report a fault and end the run where the policy says so."""
        reason = f"{at(self._spec.name, time_ns)}: {what}"
        message = f"{reason}, outputs are held" if policy == "hold" else reason
        if error is not None and kind == "error":
            message += "\n" + "".join(traceback.format_exception(error))
            show(error)
        self._report.event(time_ns, kind, self._spec.name, message)
        if policy == "end":
            raise Ended("component error", reason) from error

    def _fault(self, call: str, found: int | BaseException) -> tuple[str, str]:
        """Return kind and text of the event for a status or an exception that counts as Error."""
        if isinstance(found, ComponentDied):
            return "died", str(found)
        if isinstance(found, ComponentTimeout):
            return "timeout", str(found)
        if isinstance(found, CouplingError):
            return "error", str(found)
        if isinstance(found, BaseException):
            return "error", failure(found, self._instance.component, call)
        if is_status(found):
            return "error", self._said(f"step failed ({Status(found).name.capitalize()})")
        return "error", f"step answered {found!r}, expected a status 0 to 4"

    def _said(self, what: str) -> str:
        """Return what happened, with what the component has logged last at this instant."""
        said = self._report.said(self._spec.name)
        return f"{what}, it says: {said}" if said else what


def checkpoints(
    component: Any,
) -> tuple[Callable[[], Any], Callable[[Any], None], Callable[[Any], None]]:
    """Return how to keep, restore and forget a component's state within its process."""
    if hasattr(component, "snapshot"):
        return component.snapshot, component.rewind, component.release
    return component.get_state, component.set_state, lambda _: None


def retrying(component: Any, step: Step, tries: list[int]) -> Step:
    """Return a step that, when refused, goes back and tries again in 2, 4, ... 64 parts.

    The number of parts of every further try is added to ``tries``.
    """
    save, restore, release = checkpoints(component)

    def step_or_retry(time: float, step_size: float) -> int:
        checkpoint = save()
        status = step(time, step_size)
        for halvings in range(1, MOST_HALVINGS + 1):
            if status != Status.DISCARD:
                break
            parts = 2**halvings
            tries.append(parts)
            restore(checkpoint)
            part = step_size / parts
            for i in range(parts):
                status = step(time + i * part, part)
                if status not in (Status.OK, Status.WARNING):
                    break
        if status != Status.FATAL:
            release(checkpoint)
        return status

    return step_or_retry


def restarting(
    call: Callable[..., Any],
    restart: Callable[[], None],
    tell: Callable[[str, int | BaseException], None],
) -> Callable[..., Any]:
    """Return a call that is made once more, in a new process, when it fails; `step` by its status."""
    answers_status = call.__name__ == "step"

    def call_or_restart(*arguments: object) -> Any:
        try:
            answer = call(*arguments)
        except RAISED as error:
            found = error
        else:
            if not answers_status or (is_status(answer) and answer < Status.ERROR):
                return answer
            found = answer
        tell(call.__name__, found)
        restart()
        return call(*arguments)

    return call_or_restart
