"""What a run tells, sorted into the topics of a recording: for a file, or for who watches live."""

import logging
from collections.abc import Iterable, Mapping
from typing import Any

from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.recording.choice import chosen
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.rows import Told
from orchestrator.recording.scene import Stage
from orchestrator.recording.streams import Given, Stream
from orchestrator.recording.topics import Topic, topics
from orchestrator.recording.wire import Values

Source = tuple[str, str]  # listener call and component; none where it is for all


class Feed:
    """The calls of a listener, kept until they are taken as records.

    Parameters
    ----------
    wall_clock
        Whether to keep what was measured in wall-clock time. The scenario can switch it off too.

    Attributes
    ----------
    topics : list of Topic
        In order; those that nothing is ever told of too.
    untimed : set of str
        Components whose overruns are not kept.

    Raises
    ------
    ValueError
        If a scene role names nothing to draw.
    """

    def __init__(self, system: System, *, wall_clock: bool) -> None:
        spec = system.scenario.recording
        self.has_wall_clock = wall_clock and spec.wall_clock
        self.untimed: set[str] = set()
        if not self.has_wall_clock:  # an overrun that steers the flight is kept all the same
            components = system.scenario.components
            self.untimed = {each.name for each in components if each.on_overrun == "log"}
        self.topics = chosen(topics(system, wall_clock=self.has_wall_clock), spec)
        self._stage = Stage(system)
        self._streams: list[tuple[Source, Stream]] = []
        self._given: dict[Source, list[Given]] = {}
        self._outputs: dict[str, list[Given]] = {}  # the same lists, by component
        self._parameters: dict[str, dict[str, Value]] = {}  # all current values by component
        self._steps: dict[str, float] = {}  # measured durations at self._steps_ns, by component
        self._steps_ns = -1
        self._unmeasured = dict.fromkeys(system.ports, 0.0)

    def start(self, channels: Iterable[int]) -> None:
        """Begin to keep what is told, for the channels of the topics."""
        rows: dict[object, dict[int, Topic]] = {}
        for channel, topic in zip(channels, self.topics, strict=True):
            rows.setdefault(topic.row_key, {})[channel] = topic
            self._given[topic.source] = []
        self._outputs = {
            name: given for (call, name), given in self._given.items() if call == "outputs"
        }
        for together in rows.values():
            source = next(iter(together.values())).source
            self._streams.append((source, Stream(together)))

    def outputs(self, time_ns: int, component: str, values: Values) -> None:
        """Keep a component's outputs, and what is drawn of them.

        Wholly discrete groups become records where they changed.
        """
        given = self._outputs.get(component)
        if given is not None:
            given.append((EPOCH_NS + time_ns, values))
        if component in self._stage.heard:
            for topic, drawn in self._stage.outputs(time_ns, component, values):
                self._give(time_ns, ("scene", topic), drawn)

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value]) -> None:
        """Keep the given inputs; the others are absent from the message."""
        self._give(time_ns, ("inputs", component), values)

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value]) -> None:
        """Keep all parameters of a component, of which `values` are new."""
        current = self._parameters.get(component, {}) | dict(values)
        self._parameters[component] = current
        self._give(time_ns, ("parameters", component), current)

    def event(self, time_ns: int, kind: str, component: str, message: str) -> None:
        """Keep what happened, unless it is a measurement that nobody asked for."""
        if kind != "overrun" or component not in self.untimed:
            values = {"kind": kind, "component": component, "message": message}
            self._give(time_ns, ("event", ""), values)
            level = logging.INFO if kind in ("set", "end") else logging.WARNING
            self.log(time_ns, level, component, f"{kind}: {message}")  # for viewers

    def log(self, time_ns: int, level: int, name: str, message: str) -> None:
        """Keep a line of text; levels of `logging` are ten times those of `foxglove.Log`."""
        values = {"level": min(max(level // 10, 1), 5), "name": name, "message": message}
        self._give(time_ns, ("log", ""), values)

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float) -> None:
        """Keep the measured duration of a step, if wanted; one message tells all of an instant."""
        if time_ns != self._steps_ns or not self._steps:
            self._give_steps()
            self._steps = dict(self._unmeasured)
            self._steps_ns = time_ns
        self._steps[component] += elapsed_s

    def take(self) -> tuple[list[Told], list[ValueError]]:
        """Return the records of what was told since the last time; and why some cannot be made."""
        self._give_steps()
        told: list[Told] = []
        refusals: list[ValueError] = []
        for source, stream in self._streams:
            if self._given[source]:
                records, why = stream.records(self._given[source])
                told += records
                refusals += why
        for given in self._given.values():
            given.clear()
        return told, refusals

    def stop(self) -> None:
        """Forget what was told, and keep nothing more."""
        self._streams.clear()
        self._given.clear()
        self._outputs.clear()

    def _give_steps(self) -> None:
        if self._steps:
            self._give(self._steps_ns, ("wall_clock", ""), self._steps)
            self._steps = {}

    def _give(self, time_ns: int, source: Source, values: Any) -> None:
        """Keep values until they are taken: nobody changes them."""
        given = self._given.get(source)
        if given is not None:
            given.append((EPOCH_NS + time_ns, values))
