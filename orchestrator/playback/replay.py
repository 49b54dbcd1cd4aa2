"""Fly a recorded flight again, from what its recording holds, and compare every bit."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from orchestrator.assembly.build import build
from orchestrator.assembly.discovery import installed_components
from orchestrator.errors import Problem, ScenarioError
from orchestrator.flight import Flight, fly_system
from orchestrator.recording.diff import Difference, diff
from orchestrator.recording.provenance import provenance
from orchestrator.recording.reader import Recording
from orchestrator.recording.topics import EVENTS
from orchestrator.recording.whole import refuse_source
from orchestrator.run.events import read
from orchestrator.scenario.load import load_text
from orchestrator.scenario.records import Scenario


@dataclass(frozen=True)
class Replay:
    """What became of a second flight.

    Attributes
    ----------
    differences : list of Difference
        The first difference of every signal, in order of time; empty if all bits are equal.
    changes : mapping
        What is not as it was when the recording was made: versions, files, and their values then
        and now.
    """

    flight: Flight
    differences: list[Difference]
    changes: Mapping[str, tuple[str, str]]


def recorded_scenario(recording: Recording) -> Scenario:
    """Return the scenario that a recording was made of, as long as the recording is.

    Its events are those that were recorded, of which some may have come from a viewer. Its files
    are looked up beside the recording first.

    Raises
    ------
    ScenarioError
        If it cannot be loaded here, or if nothing was recorded.
    """
    end_s = recording.result.time_ns / 1e9
    if not end_s:
        raise ScenarioError([Problem((), f"{recording.path}: nothing to replay, it ends at 0 s")])
    scenario = load_text(json.dumps(recording.scenario, indent=2), recording.path)
    events = scenario.events
    if EVENTS in recording.topics:
        made = (read(one.time_s, one.message) for one in recording.events if one.kind == "set")
        events = (*made, *(event for event in events if event.at_s > end_s))
    if recording.result.outcome != "interrupted":
        return replace(scenario, events=events)
    events = tuple(event for event in events if event.at_s <= end_s)
    return replace(scenario, duration_s=end_s, events=events)


def foreign(scenario: Scenario) -> list[str]:
    """Return what a scenario would run that did not come with Hedgehop."""
    points = installed_components()
    ours = {name for name, point in points.items() if point.dist and point.dist.name == "hedgehop"}
    packages = {points[name].module.partition(".")[0] for name in ours} | {"orchestrator"}
    uses = [spec.use for spec in (*scenario.resources, *scenario.components)]
    return [
        use
        for use in dict.fromkeys(uses)
        if use not in ours
        and Path(use).suffix != ".mcap"
        and use.partition(":")[0].partition(".")[0] not in packages
    ]


def replay(
    recording: Recording,
    out: Path,
    progress: Callable[[int], None] | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Replay:
    """Fly the scenario of a recording again, record it to ``out``, and compare.

    Runs the code that the scenario names: ask :func:`foreign` first. Of an interrupted flight, what
    happened before the interruption is compared.

    Raises
    ------
    ScenarioError
        If it cannot be flown here.
    ValueError
        If ``out`` is the recording itself.
    """
    refuse_source(out, [recording.path])
    system = build(recorded_scenario(recording))
    then, now = recording.provenance, provenance(system)
    changed = {
        key: (then.get(key, "none"), now.get(key, "none"))
        for key in sorted(then.keys() | now.keys())
        if then.get(key) != now.get(key) and key != "scenario.sha256"
    }
    flight = fly_system(system, out, progress, interrupt)
    found = diff(recording.path, out)
    if recording.result.outcome == "interrupted":
        end_s = recording.result.time_ns / 1e9
        found = [one for one in found if one.time_s is not None and one.time_s < end_s]
    found.sort(key=lambda one: float("inf") if one.time_s is None else one.time_s)
    return Replay(flight, found, changed)
