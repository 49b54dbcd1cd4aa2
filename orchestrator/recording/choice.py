"""Which topics are recorded, and how often: what the patterns of a scenario choose."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase

from orchestrator.assembly.system import System
from orchestrator.errors import Problem, ScenarioError, nearest
from orchestrator.recording.topics import Topic, topics
from orchestrator.scenario.records import RecordingSpec


def chosen(planned: Iterable[Topic], spec: RecordingSpec) -> list[Topic]:
    """Return the topics that are recorded, in their order; those thinned out say so.

    Of several patterns of ``every`` the first that fits counts.
    """
    return [
        _thinned(topic, spec.every)
        for topic in planned
        if (not spec.include or _fits(topic.name, spec.include))
        and not _fits(topic.name, spec.exclude)
    ]


def check_recording(system: System) -> None:
    """Refuse patterns that choose nothing.

    Raises
    ------
    ScenarioError
        With every such pattern, each at its place in the scenario.
    """
    spec = system.scenario.recording
    patterns = [("include", k, pattern) for k, pattern in enumerate(spec.include)]
    patterns += [("exclude", k, pattern) for k, pattern in enumerate(spec.exclude)]
    patterns += [("every", pattern, pattern) for pattern in spec.every]
    if not patterns:
        return
    # a topic that another option switches off is no mistake
    whole = replace(system, scenario=replace(system.scenario, recording=RecordingSpec()))
    planned = topics(whole, wall_clock=True)
    repeated = [topic.name for topic in planned if topic.is_repeated]
    problems: list[Problem] = []
    for key, place, pattern in patterns:
        known = repeated if key == "every" else [topic.name for topic in planned]
        if not any(fnmatchcase(name, pattern) for name in known):
            groups = dict.fromkeys(f"{name.rpartition('/')[0]}/*" for name in known)
            near = nearest(pattern, [*groups, *known]) or f", expected one of {known}"
            what = f"recording.{key}: no such topic, got {pattern!r}{near}"
            problems.append(Problem(("recording", key, place), what))
    if problems:
        raise ScenarioError(problems)


def _thinned(topic: Topic, every: Mapping[str, int]) -> Topic:
    n = next((n for pattern, n in every.items() if fnmatchcase(topic.name, pattern)), 1)
    if n == 1 or not topic.is_repeated:
        return topic
    return replace(topic, every=n, metadata={**topic.metadata, "every": f"{n}"})


def _fits(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)
