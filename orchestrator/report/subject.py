"""One recording as a page sees it: its signals by the scene's roles, in the units of people."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.figures.deviation import POSE, REFERENCE, VELOCITY, Deviation, deviation
from orchestrator.flight import recorded_figures
from orchestrator.recording.messages import Signal
from orchestrator.recording.reader import Recording

Samples = tuple[NDArray[np.float64], NDArray[Any]]  # times, s, and values
DEGREES = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}


@dataclass(frozen=True)
class Subject:
    """A recording, its place on the page and what it is called there."""

    number: int
    label: str
    recording: Recording

    @cached_property
    def figures(self) -> Mapping[str, Any]:
        """The closing table; see :func:`orchestrator.figures.metrics.flight_metrics`."""
        return recorded_figures(self.recording)

    @cached_property
    def end_s(self) -> float:
        """When the recording ends, s."""
        last = (topic.raw[-1][0] for topic in self.recording.topics.values() if topic.raw)
        return max(self.recording.result.time_ns, *last, 0) / 1e9

    def samples(self, name: str) -> Samples:
        """Return a signal in degrees where it is in radians; what holds, holds until the end."""
        times, values = self.recording[name]
        signal = self.recording.signals[name]
        if signal.unit in DEGREES:
            values = np.degrees(values)
        if self.is_held(name) and len(times) and times[-1] < self.end_s:
            times, values = np.append(times, self.end_s), np.concatenate([values, values[-1:]])
        return times, values

    def is_held(self, name: str) -> bool:
        """Whether a signal keeps its value until the next, as far as the recording tells."""
        notes = self.recording.topics[self.recording.signals[name].topic].metadata
        return notes.get("written") == "on change" or notes.get("kind") != "outputs"

    def unit(self, name: str) -> str:
        """Return the unit in which :meth:`samples` are; nothing for a pure number."""
        unit = self.recording.signals[name].unit
        return "" if unit == "1" else DEGREES.get(unit, unit)

    def limits(self, name: str) -> list[tuple[str, float]]:
        """Return what a signal is at least and at most, if told, in the unit of its samples."""
        signal = self.recording.signals[name]
        factor = 180.0 / np.pi if signal.unit in DEGREES else 1.0
        bounds = {"least": signal.min, "most": signal.max}
        return [(end, factor * each) for end, each in bounds.items() if each is not None]

    def scalar(self, role: str) -> str | None:
        """Return the name of a number that plays a role, if there is one."""
        name = self.recording.scene.get(role, "")
        return name if self._is_number(name, 0) else None

    def group(
        self, role: str, members: Iterable[str], dimensions: int
    ) -> dict[str, Samples] | None:
        """Return the members of a group that plays a role, if all are there and of equal times."""
        names = {each: f"{self.recording.scene.get(role, '')}.{each}" for each in members}
        if not all(self._is_number(name, dimensions) for name in names.values()):
            return None
        found = {member: self.recording[name] for member, name in names.items()}
        shapes = {(times.tobytes(), values.shape) for times, values in found.values()}
        return (
            found if len(shapes) == 1 and all(len(times) for times, _ in found.values()) else None
        )

    def members(self, role: str) -> list[Signal]:
        """Return the numbers in the group that plays a role."""
        group = self.recording.scene.get(role)
        return [
            signal
            for name, signal in self.recording.signals.items()
            if group and name.startswith(f"{group}.") and self._is_number(name, 0)
        ]

    @cached_property
    def pose(self) -> dict[str, Samples] | None:
        """The role of that name."""
        return self.group("pose", POSE, 0)

    @cached_property
    def deviation(self) -> Deviation | None:
        """How far the flight was from its reference; None where a role for it is missing."""
        reference = self.group("reference", REFERENCE, 1)
        velocity = self.group("velocity", VELOCITY, 0)
        if self.pose is None or velocity is None or reference is None:
            return None
        if reference["north"][1].shape[1] < 2:
            return None
        return deviation(self.pose, velocity, reference)

    @cached_property
    def distance(self) -> NDArray[np.float64]:
        """Horizontal distance flown at each time of the pose, m."""
        assert self.pose is not None
        step = np.hypot(np.diff(self.pose["north"][1]), np.diff(self.pose["east"][1]))
        return np.concatenate([[0.0], np.cumsum(np.nan_to_num(step))])

    def _is_number(self, name: str, dimensions: int) -> bool:
        signal = self.recording.signals.get(name)
        if signal is None or len(signal.shape) != dimensions or signal.items:
            return False
        return self.recording[name][1].dtype.kind in "fiu"


def subjects(paths: Iterable[Path]) -> list[Subject]:
    """Read recordings.

    Raises
    ------
    OSError, ValueError
        If one cannot be read; see :meth:`Recording.open`.
    """
    files = list(paths)
    return [
        Subject(number, label, Recording.open(file))
        for number, (label, file) in enumerate(zip(labels(files), files, strict=True))
    ]


def labels(files: Sequence[Path]) -> list[str]:
    """Return what files are called: the shortest ending of each path that no other has.

    What has no such ending, since a file is given twice, is called by its place.
    """
    paths = [file.absolute().with_suffix("").parts for file in files]

    def label(k: int) -> str:
        for n in range(1, len(paths[k]) + 1):
            if sum(parts[-n:] == paths[k][-n:] for parts in paths) == 1:
                return "/".join(paths[k][-n:])
        return f"{paths[k][-1]} ({k + 1})"

    return [label(k) for k in range(len(paths))]
