"""A recording as a component: what one component published, published again at its times."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from orchestrator.assembly.clock import SECOND
from orchestrator.component import Status, Value
from orchestrator.errors import nearest
from orchestrator.playback.description import describe
from orchestrator.recording.inventory import recorded
from orchestrator.recording.messages import column
from orchestrator.recording.reader import Recording

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


@dataclass(frozen=True)
class PlaybackParameters:
    """What is played."""

    file: Annotated[Path, "the recording"]
    component: Annotated[str, "the recorded component's name"]


class Playback:
    """A recorded component.

    It has the inputs, outputs, parameters and execution that were recorded, so that it takes the
    place of the component itself; what is set has no effect. Between two recorded values the
    earlier one holds.

    Raises
    ------
    OSError, ValueError
        If the recording cannot be read or holds no such component.
    """

    def __init__(self, parameters: PlaybackParameters, *, latency_s: float = 0.0) -> None:
        recording = Recording.open(parameters.file)
        if parameters.component not in recording.components:
            known = list(recording.components)
            near = nearest(parameters.component, known) or f", expected one of {known}"
            raise ValueError(
                f"component: not in {parameters.file.name!r}, got {parameters.component!r}{near}"
            )
        if recording.recovered.get("lost_messages", "0") != "0":
            what = f"recording {parameters.file.name!r} has gaps, got one that was recovered"
            raise ValueError(f"{what}, expected every message")
        self._parameters = parameters
        self._own = recorded(parameters.component, recording.components[parameters.component])
        self._end_ns = recording.result.time_ns
        self._latency_ns = round(latency_s * SECOND)
        self._tracks = _tracks(recording, parameters.component)
        self._now_ns = 0

    @property
    def execution(self) -> Any:
        """As recorded."""
        return self._own

    def describe(self) -> "ModelDescription":
        """Return the recorded variables."""
        file, component = self._parameters.file.name, self._parameters.component
        ports = self._own.ports.values()
        return describe(component, f"{component} as recorded in {file}", ports)

    def initialize(self, *, start_time: float, stop_time: float | None, seed: int) -> None:  # noqa: ARG002
        """Go to the first recorded values.

        Raises
        ------
        ValueError
            If the recording ends before ``stop_time``.
        """
        if stop_time is not None and round(stop_time * SECOND) > self._end_ns:
            raise ValueError(
                f"recording {self._parameters.file.name!r} is too short, "
                f"got {self._end_ns / SECOND:g} s, expected at least {stop_time:g} s"
            )
        self._now_ns = round(start_time * SECOND)

    def set(self, values: Mapping[str, Value], /) -> None:
        """Check the names; nothing else follows from what is set."""
        for name in values:
            if name not in self._own.ports:
                raise KeyError(f"unknown variable {name!r}{nearest(name, list(self._own.ports))}")

    def get(self, names: Sequence[str], /) -> dict[str, Value]:
        """Return the values that were valid at this instant; parameters have their start value."""
        return {name: self._value(name) for name in names}

    def step(self, time: float, step_size: float, /) -> int:
        """Move to the instant at which the outputs of this step became valid."""
        ahead = self._latency_ns if self._own.kind == "sampled" else round(step_size * SECOND)
        self._now_ns = round(time * SECOND) + ahead
        return Status.OK

    def terminate(self) -> None:
        """Do nothing: the file has been closed."""

    def _value(self, name: str) -> Value:
        if name in self._tracks:
            times, values = self._tracks[name]
            return values[max(bisect_right(times, self._now_ns) - 1, 0)]
        if name not in self._own.ports:
            raise KeyError(f"unknown variable {name!r}{nearest(name, list(self._own.ports))}")
        start = self._own.ports[name].start
        if start is None:
            raise KeyError(f"variable {name!r}: was not recorded")
        return start


def _tracks(
    recording: Recording, component: str
) -> dict[str, tuple[Sequence[int], Sequence[Value]]]:
    """Return times, ns, and values of every recorded output of a component."""
    tracks: dict[str, tuple[Sequence[int], Sequence[Value]]] = {}
    for signal in recording.signals.values():
        topic = recording.topics[signal.topic]
        if topic.metadata["component"] != component or topic.metadata["kind"] != "outputs":
            continue
        if "every" in topic.metadata:
            what = f"one message of {topic.metadata['every']} of {signal.topic} was recorded"
            raise ValueError(f"component: {what}, expected all of them")
        times, values = column(topic, signal)
        if not len(times):
            continue
        values.flags.writeable = False
        name = signal.name.removeprefix(f"{component}.")
        rows = list(values) if signal.shape else cast(Sequence[Value], values.tolist())
        tracks[name] = cast(Sequence[int], times.tolist()), cast(Sequence[Value], rows)
    return tracks
