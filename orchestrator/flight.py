"""Fly a scenario: load, build, simulate, record, and take the figures."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from orchestrator.assembly.build import build
from orchestrator.assembly.system import System
from orchestrator.errors import Problem, ScenarioError
from orchestrator.figures.logbook import Logbook
from orchestrator.figures.metrics import flight_metrics
from orchestrator.figures.omissions import thinned
from orchestrator.figures.trace import Trace
from orchestrator.listener import Listener, Result
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.recording.whole import refuse_source
from orchestrator.run.events import Change
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load
from orchestrator.scenario.marks import located


@dataclass(frozen=True)
class Flight:
    """A finished run.

    Attributes
    ----------
    result : Result
        How it ended.
    metrics : mapping
        Its figures; see :func:`orchestrator.figures.metrics.flight_metrics`.
    trace : Trace
        Every output over time: ``trace["vehicle.clearance"]`` is times and values.
    recording : Path or None
        The file, if one was asked for and could be finished.
    """

    result: Result
    metrics: Mapping[str, Any]
    trace: Trace
    recording: Path | None


def fly(
    path: str | os.PathLike[str],
    overrides: Iterable[str] = (),
    out: str | os.PathLike[str] | None = None,
) -> Flight:
    """Fly a scenario file.

    Parameters
    ----------
    path : path
        The scenario.
    overrides : iterable of str
        As ``components.mpc.parameters.basis=tent``.
    out : path, optional
        The MCAP file to record to.

    Raises
    ------
    ScenarioError
        If the scenario cannot be flown, or the file not be written; with every reason.
    """
    if out is not None:
        check_writable(Path(out))
    return fly_system(build(load(path, overrides)), None if out is None else Path(out))


def fly_system(
    system: System,
    out: Path | None = None,
    progress: Callable[[int], None] | None = None,
    interrupt: Callable[[], bool] | None = None,
    listeners: Sequence[Listener] = (),
    requests: Callable[[int], Sequence[Change]] | None = None,
) -> Flight:
    """Run a system that was built and take its figures; see ``simulate`` for the callbacks.

    Raises
    ------
    ScenarioError
        If ``out`` is a file that the scenario reads, or cannot be written; whatever else is wrong.
    """
    scenario = system.scenario
    if out is not None:
        try:
            refuse_source(out, [file for plan in system.plans for file in plan.files])
        except ValueError as error:
            raise ScenarioError([Problem((), str(error))]) from error
    trace = Trace()
    logbook = Logbook(trace)

    def figures(result: Result) -> dict[str, Any]:
        return flight_metrics(
            logbook,
            {str(port): port for ports in system.ports.values() for port in ports.values()},
            scenario.scene,
            result,
            scenario.settle_s,
            logbook.durations if scenario.recording.wall_clock else None,
        )

    recorder = Recorder(out, metrics=figures) if out else None

    def must_end() -> bool:
        is_cut = recorder is not None and recorder.failure is not None
        ends = is_cut and scenario.recording.on_disk_full == "end"
        return ends or (interrupt is not None and interrupt())

    told: list[Listener] = [trace, logbook, *([recorder] if recorder else []), *listeners]
    try:
        result = simulate(system, told, progress, must_end, requests)
    except ScenarioError as error:
        raise located(error, scenario.origins) from error
    except OSError as error:  # only a recorder's: a component's would have been dealt with
        raise ScenarioError([Problem((), str(error))]) from error
    failure = recorder.failure if recorder else None
    if failure and scenario.recording.on_disk_full == "end" and result.outcome == "interrupted":
        result = replace(result, reason=f"{result.reason}, {failure.strerror or failure}")
    return Flight(result, figures(result), trace, None if failure else out)


def recording_metrics(path: Path) -> dict[str, Any]:
    """Return the figures of a recorded flight, from the recording alone.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or is cut short.
    """
    return recorded_figures(Recording.open(path))


def recorded_figures(recording: Recording) -> dict[str, Any]:
    """Return the figures of a flight from its open recording.

    Those that count messages are left out where not all of these were recorded.
    """
    ladder = recording.scene.get("ladder", "")
    uncounted = {"ladder"} if thinned(recording, ladder) > 1 else set[str]()
    return flight_metrics(
        recording,
        recording.signals,
        {role: name for role, name in recording.scene.items() if role not in uncounted},
        recording.result,
        recording.scenario["settle_s"],
        recording.wall_clock,
    )


def check_writable(out: Path) -> None:
    """Refuse an output that cannot be written; a file that is there stays as it is.

    Raises
    ------
    ScenarioError
    """
    what = None
    if out.suffix != ".mcap":
        what = f"not a recording's name, got {out.name!r}, expected one that ends in '.mcap'"
    else:
        is_new = not out.exists()
        try:
            out.open("ab").close()
        except OSError as error:
            what = f"cannot be written, {str(error.strerror).lower()}"
        else:
            if is_new:
                out.unlink()
    if what:
        raise ScenarioError([Problem((), f"{out}: {what}")])
