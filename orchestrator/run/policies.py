"""What becomes of a run when a component fails: end, or hold its outputs and go on.

Whatever happens is an event with its time first; nothing here depends on wall-clock time but
``overran``, which is only asked where the scenario sets a deadline.
"""

import traceback
from collections.abc import Callable
from typing import Literal

from orchestrator.component import Instance, Restorable, Status
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

    def answered(self, time_ns: int, status: int) -> bool:
        """Deal with every status but OK; return whether the step's results count."""
        if status == Status.WARNING:
            self._apply(time_ns, "warning", "step is done with a Warning", "log")
            return True
        if status == Status.DISCARD:
            policy = "hold" if self._spec.on_discard == "hold" else "end"
            self._apply(time_ns, "discard", "step is refused (Discard)", policy)
            return False
        self._instance.fail(fatal=status != Status.ERROR)
        if status == Status.ERROR:
            self._apply(time_ns, "error", "step failed (Error)", self._spec.on_error)
        elif status == Status.FATAL:
            self._apply(time_ns, "error", "step failed (Fatal)", "end")
        else:
            what = f"step answered an unknown status, got {status!r}, expected 0 to 4"
            self._apply(time_ns, "error", what, "end")
        return False

    def failed(self, time_ns: int, error: Exception) -> None:
        """Deal with an exception: it counts as Error."""
        self._instance.fail()
        what = f"failed, {type(error).__name__}: {error}"
        self._apply(time_ns, "error", what, self._spec.on_error, error)

    def tried_again(self, time_ns: int, parts: int) -> None:
        """Report that a refused step was tried again in parts."""
        self._apply(time_ns, "retry", f"step is tried again in {parts} parts", "log")

    def found_nonfinite(self, time_ns: int, what: str) -> None:
        """Deal with an output that is NaN or infinite."""
        self._apply(time_ns, "nonfinite", what, self._spec.on_nonfinite)

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
        error: Exception | None = None,
    ) -> None:
        """Report a fault and end the run where the policy says so."""
        reason = f"{at(self._spec.name, time_ns)}: {what}"
        message = f"{reason}, outputs are held" if policy == "hold" else reason
        if error is not None:
            message += "\n" + "".join(traceback.format_exception(error))
        self._report.event(time_ns, kind, self._spec.name, message)
        if policy == "end":
            raise Ended("component error", reason) from error


def retrying(component: Restorable, step: Step, tries: list[int]) -> Step:
    """Return a step that, when refused, goes back and tries again in 2, 4, ... 64 parts.

    The number of parts of every further try is added to ``tries``.
    """

    def step_or_retry(time: float, step_size: float) -> int:
        state = component.get_state()
        status = step(time, step_size)
        for halvings in range(1, MOST_HALVINGS + 1):
            if status != Status.DISCARD:
                break
            parts = 2**halvings
            tries.append(parts)
            component.set_state(state)
            part = step_size / parts
            for i in range(parts):
                status = step(time + i * part, part)
                if status >= Status.DISCARD:
                    break
        return status

    return step_or_retry
