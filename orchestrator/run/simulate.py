"""Run a system from its start to its end."""

import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from time import perf_counter, process_time

from orchestrator.assembly.clock import SECOND
from orchestrator.assembly.schedule import instants
from orchestrator.assembly.system import Operation, System
from orchestrator.errors import CouplingError
from orchestrator.listener import Listener, Result
from orchestrator.run.events import Change, changes, written
from orchestrator.run.initialize import Participants, announce, initialize
from orchestrator.run.journal import Journal, journal
from orchestrator.run.participant import Participant
from orchestrator.run.report import Ended, Report

Actions = tuple[Callable[[int], None], ...]


def simulate(
    system: System,
    listeners: Sequence[Listener] = (),
    progress: Callable[[int], None] | None = None,
    interrupt: Callable[[], bool] | None = None,
    requests: Callable[[int], Sequence[Change]] | None = None,
) -> Result:
    """Initialize and run a system, once, and return how it ended.

    A component that fails while it runs is dealt with by its policies and never raises. What a
    listener raises ends the run and is raised again, after everything has been closed.

    Parameters
    ----------
    listeners : sequence of Listener
        Told everything; closed on every way out.
    progress : callable, optional
        Called with the simulated time, ns, about 200 times.
    interrupt : callable, optional
        Asked at every instant; true ends the run with the outcome ``interrupted``.
    requests : callable, optional
        Called with the simulated time, ns, at every instant, before anything happens there; it may
        take its time. Returns changes to make now, beside the scenario's events.

    Raises
    ------
    ScenarioError
        If a component cannot be initialized; no listener has been opened then.
    CouplingError
        If the system has been run before.
    """
    used = [name for name, instance in system.instances.items() if instance.state != "created"]
    if used:
        raise CouplingError(f"system: has been run before, got {used[0]!r} in use, expected new")
    cpu, wall = process_time(), perf_counter()
    report = Report(listeners)
    participants = _participants(system, report)
    opened: list[Listener] = []
    outcome, reason = "interrupted", ""
    failure: BaseException | None = None
    with journal(report) as logs:
        try:
            initialize(system, participants)
            cpu, wall = process_time(), perf_counter()
            for listener in listeners:
                opened.append(listener)
                listener.open(system)
            announce(system, participants, report)
            _run(system, participants, report, logs, progress, interrupt, requests)
            outcome = "flown"
        except Ended as end:
            outcome, reason = end.outcome, end.reason
        except BaseException as error:  # noqa: BLE001  (raised again once everything is closed)
            failure, reason = error, f"{type(error).__name__}: {error}"
        time_ns = report.time_ns
        farewells = _terminate(system)
        if opened:
            try:
                logs.tell()
            except Exception as error:  # noqa: BLE001
                failure = failure or error
    report.counts.update(f"errors.{name}" for name in farewells)
    result = Result(
        outcome,
        reason,
        time_ns,
        dict(report.counts),
        process_time() - cpu,
        perf_counter() - wall,
    )
    for listener in opened:
        try:
            for name, text in farewells.items():
                listener.event(time_ns, "error", name, text)
            listener.event(time_ns, "end", "orchestrator", f"{outcome}: {reason}".rstrip(": "))
        except Exception as error:  # noqa: BLE001
            failure = failure or error
        try:
            listener.close(result)
        except Exception as error:  # noqa: BLE001
            failure = failure or error
    if failure is not None:
        raise failure
    return result


def _participants(system: System, report: Report) -> dict[str, Participant]:
    """Return the run-time side of every component, connected."""
    ends = [path.partition(".") for path in system.scenario.end_on]
    participants = {
        spec.name: Participant(
            system.instances[spec.name],
            spec,
            system.ports[spec.name],
            system.schedule,
            system.links,
            report,
            end_on=[name for component, _, name in ends if component == spec.name],
        )
        for spec in system.scenario.components
    }
    for participant in participants.values():
        participant.wire(participants)
    return participants


def _run(
    system: System,
    participants: Participants,
    report: Report,
    logs: Journal,
    progress: Callable[[int], None] | None,
    interrupt: Callable[[], bool] | None,
    requests: Callable[[int], Sequence[Change]] | None,
) -> None:
    """Walk the schedule to its end, or to where something raises ``Ended``."""
    schedule = system.schedule
    end_ns = schedule.end_ns
    due = deque(changes(system.scenario.events, system.ports, system.links, schedule))
    mark = 0
    for time_ns, (actions, last_actions) in instants(schedule, _compile(system, participants)):
        if logs.records:
            logs.tell()
        report.time_ns = time_ns
        wanted = () if requests is None else requests(time_ns)
        if interrupt is not None and interrupt():
            raise Ended("interrupted", f"interrupted at t = {time_ns / SECOND:.3f} s")
        if progress is not None and time_ns >= mark:
            progress(time_ns)
            mark = time_ns + end_ns // 200
        while due and due[0].time_ns <= time_ns:
            _apply(due.popleft(), time_ns, participants, report)
        for change in wanted:
            _apply(change, time_ns, participants, report)
        for action in actions if time_ns < end_ns else last_actions:
            action(time_ns)
    report.time_ns = end_ns
    if progress is not None:
        progress(end_ns)


def _compile(
    system: System, participants: Participants
) -> tuple[tuple[int, tuple[Actions, Actions]], ...]:
    """Return the schedule's table with functions for operations.

    The second part of every entry is what happens if the run ends there: nobody steps any more.
    """
    table = system.schedule.table
    last_read = {o.component: o for o in table[0][1] if o.kind == "read"}
    calls = {
        operation: participants[operation.component].call(
            operation, participants, is_last=operation in last_read.values()
        )
        for _, operations in table
        for operation in operations
    }
    return tuple(
        (
            offset,
            (
                _overlapped(operations, calls, participants),
                tuple(calls[o] for o in operations if o.kind in ("read", "release")),
            ),
        )
        for offset, operations in table
    )


def _overlapped(
    operations: Sequence[Operation],
    calls: Mapping[Operation, Callable[[int], None]],
    participants: Participants,
) -> Actions:
    """Return the calls of an instant's operations, with steps in several processes overlapping.

    Components that advance side by side do not hear of each other before they are read.
    """
    actions: list[Callable[[int], None]] = []
    for is_advance, group in groupby(operations, key=lambda o: o.kind == "advance"):
        together = list(group)
        halves = [participants[o.component].halves() if is_advance else None for o in together]
        if len(together) > 1:
            actions += [both[0] for both in halves if both]
            actions += [
                both[1] if both else calls[o] for o, both in zip(together, halves, strict=True)
            ]
        else:
            actions += [calls[o] for o in together]
    return tuple(actions)


def _apply(change: Change, time_ns: int, participants: Participants, report: Report) -> None:
    """Tell a timed change and make it: told first, it can be repeated even if it ends the run."""
    port, value = change.port, change.value
    for listener in report.listeners:
        tell = listener.inputs if port.causality == "input" else listener.parameters
        tell(time_ns, port.component, {port.name: value})
    report.event(time_ns, "set", port.component, written(change))
    participants[port.component].change(time_ns, port.name, value)


def _terminate(system: System) -> dict[str, str]:
    """Terminate every component; return the tracebacks of those that fail to."""
    failures: dict[str, str] = {}
    for name, instance in system.instances.items():
        try:
            instance.terminate()
        except Exception:  # noqa: BLE001
            failures[name] = f"{name}: failed to terminate\n{traceback.format_exc()}"
    return failures
