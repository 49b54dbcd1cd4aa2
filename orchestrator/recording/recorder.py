"""Write a run to an MCAP file as it happens."""

import json
import logging
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from importlib.metadata import version
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Any

from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.listener import Result
from orchestrator.recording.choice import chosen
from orchestrator.recording.chunks import Batch
from orchestrator.recording.container import Container
from orchestrator.recording.inventory import INVENTORY, inventory
from orchestrator.recording.provenance import EPOCH_NS, document, provenance
from orchestrator.recording.scene import Stage
from orchestrator.recording.streams import Row, Stream, instant
from orchestrator.recording.topics import topics
from orchestrator.scenario.yaml_source import dump

FLUSH_NS = 1_000_000_000

Source = tuple[str, str]  # listener call and component; none where it is for all

_log = logging.getLogger("hedgehop")


class Recorder:
    """A listener that records to one file.

    Parameters
    ----------
    path
        The file; replaced if it exists, when the run opens.
    wall_clock
        Whether to record what was measured in wall-clock time. Without it, equal runs give equal
        bytes. The scenario can switch it off as well.
    metrics
        Called at the end; its answer goes into the summary as JSON.

    Attributes
    ----------
    failure : OSError or None
        What ended the recording in mid-flight. The run goes on; the file ends readable where the
        disk allows.

    Raises
    ------
    OSError
        From `open`, if the file cannot be written.
    ValueError
        From `open`, before the file is touched, if a scene role names nothing to draw. From any
        later call, `close` included, if values told before are not what their description says; all
        others are in the file.
    """

    def __init__(
        self,
        path: Path,
        *,
        wall_clock: bool = True,
        metrics: Callable[[Result], Mapping[str, Any]] | None = None,
    ) -> None:
        self.path = Path(path)
        self.failure: OSError | None = None
        self._wall_clock = wall_clock
        self._metrics = metrics
        self._file: BufferedWriter | None = None
        self._container: Container | None = None
        self._stage: Stage | None = None
        self._whole = 0  # bytes of the file that end with a whole record
        self._streams: list[tuple[Source, Stream]] = []
        self._rows: dict[Source, list[Row]] = {}  # what was told since the last flush
        self._parameters: dict[str, dict[str, Value]] = {}  # all current values by component
        self._untimed: set[str] = set()  # components whose overruns are not recorded
        self._steps: dict[str, float] = {}  # measured durations at self._steps_ns, by component
        self._steps_ns = -1
        self._unmeasured: dict[str, float] = {}
        self._time_ns = -1
        self._instant = b""
        self._flush_ns = FLUSH_NS

    @property
    def wants_wall_clock(self) -> bool:
        """Whether steps should be measured."""
        return self._wall_clock

    def open(self, system: System, /) -> None:
        """Create the file and register every channel, so that a silent topic is listed too."""
        self._wall_clock = self._wall_clock and system.scenario.recording.wall_clock
        if not self._wall_clock:  # an overrun that steers the flight is recorded all the same
            specs = system.scenario.components
            self._untimed = {spec.name for spec in specs if spec.on_overrun == "log"}
        self._unmeasured = dict.fromkeys(system.ports, 0.0)
        spec = system.scenario.recording
        planned = chosen(topics(system, wall_clock=self._wall_clock), spec)
        self._stage = Stage(system)
        try:
            self._file = BufferedWriter(FileIO(self.path, "wb"))
            container = Container(
                self._file,
                f"hedgehop {version('hedgehop')}",
                compression=spec.compression,
                chunk_size=1000 * spec.chunk_kb,
            )
            _describe(container, system)
            for topic in planned:
                channel = container.add_channel(
                    topic.name, topic.message, topic.descriptors, topic.metadata
                )
                source = topic.call, topic.component
                self._streams.append((source, Stream(channel, topic)))
                self._rows[source] = []
            self._flush_file(self._file)
        except OSError as error:
            self._release()
            raise OSError(f"{self.path}: cannot be written, {error.strerror or error}") from error
        self._container = container

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Keep a component's outputs; wholly discrete groups are written where they changed."""
        self._keep(time_ns, ("outputs", component), values)
        if self._stage is not None:
            for topic, drawn in self._stage.outputs(time_ns, component, values):
                self._keep(time_ns, ("scene", topic), drawn)

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Keep the given inputs; the others are absent from the message."""
        self._keep(time_ns, ("inputs", component), values)

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Keep all parameters of a component, of which `values` are new."""
        current = self._parameters.get(component, {}) | dict(values)
        self._parameters[component] = current
        self._keep(time_ns, ("parameters", component), current)

    def event(self, time_ns: int, kind: str, component: str, message: str, /) -> None:
        """Keep what happened, unless it is a measurement that nobody asked to record."""
        if kind != "overrun" or component not in self._untimed:
            values = {"kind": kind, "component": component, "message": message}
            self._keep(time_ns, ("event", ""), values)

    def log(self, time_ns: int, level: int, name: str, message: str, /) -> None:
        """Keep a line of text; levels of `logging` are ten times those of `foxglove.Log`."""
        values = {"level": min(max(level // 10, 1), 5), "name": name, "message": message}
        self._keep(time_ns, ("log", ""), values)

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float, /) -> None:
        """Keep the measured duration of a step, if wanted; one message tells all of an instant."""
        if time_ns != self._steps_ns:
            self._steps = dict(self._unmeasured)
            self._steps_ns = time_ns
            self._keep(time_ns, ("wall_clock", ""), self._steps)
        self._steps[component] += elapsed_s

    def close(self, result: Result, /) -> None:
        """Write the summary and finish the file; again, or without `open`, it does nothing."""
        container = self._container
        if container is None:
            return
        with ExitStack() as last:  # whatever fails, the rest is done
            last.callback(self._release)
            last.callback(self._finish, container, result)
            self._flush()

    def _keep(self, time_ns: int, source: Source, values: Mapping[str, Any]) -> None:
        """Keep values until the next flush: nobody changes them."""
        if time_ns != self._time_ns:
            if time_ns > self._flush_ns:  # a second waits in memory until after its last instant
                self._flush()
                self._flush_ns = (time_ns // FLUSH_NS + 1) * FLUSH_NS
            self._time_ns = time_ns
            self._instant = instant(EPOCH_NS + time_ns)
        rows = self._rows.get(source)
        if rows is not None:
            rows.append((EPOCH_NS + time_ns, self._instant, values))

    def _flush(self) -> None:
        """Write what was kept.

        Raises
        ------
        ValueError
            If some of it cannot be; everything else has been written.
        """
        container, file = self._container, self._file
        if container is None or file is None or self.failure is not None:
            return
        batches: list[Batch] = []
        refusals: list[ValueError] = []
        for source, stream in self._streams:
            if self._rows[source]:
                times, records, refusal = stream.records(self._rows[source])
                if records:
                    batches.append((stream.channel, times, records))
                refusals += [] if refusal is None else [refusal]
        for rows in self._rows.values():
            rows.clear()
        try:
            container.add_messages(batches)
            self._flush_file(file)
        except OSError as error:
            self._fail(error)
        if refusals:
            raise refusals[0]

    def _flush_file(self, file: BufferedWriter) -> None:
        file.flush()
        self._whole = file.tell()

    def _finish(self, container: Container, result: Result) -> None:
        summary: dict[str, str] = {}
        try:
            summary = self._summary(result)
        finally:
            try:
                if self.failure is None:
                    container.add_metadata("hedgehop.summary", summary)
                    container.finish()
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        """Give up recording, and say so where it is still possible: the file is not."""
        if self.failure is None:
            self.failure = error
            self._rows.clear()
            self._streams.clear()
            after = f"after {self._time_ns / 1e9:g} s of simulated time"
            _log.error("%s: recording stopped %s, %s", self.path, after, error.strerror or error)

    def _summary(self, result: Result) -> dict[str, str]:
        unwanted = {f"overruns.{component}" for component in self._untimed}
        counts = {name: n for name, n in result.counts.items() if name not in unwanted}
        entries = {
            "outcome": result.outcome,
            "reason": result.reason,
            "end_ns": f"{result.time_ns}",
        }
        if self._wall_clock:
            entries |= {"cpu_s": repr(result.cpu_s), "wall_s": repr(result.wall_s)}
        entries["counts"] = json.dumps(counts, sort_keys=True)
        if self._metrics is not None:
            entries["metrics"] = json.dumps(self._metrics(result), allow_nan=False)
        return entries

    def _release(self) -> None:
        self._container = None
        self._rows.clear()
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._file = None
            if self.failure is not None:  # what was torn goes; what was flushed stays readable
                with suppress(OSError):
                    os.truncate(self.path, self._whole)


def _describe(container: Container, system: System) -> None:
    """Write what is known before the run: the scenario, where it comes from, what viewers draw."""
    plain = document(system.scenario)
    yaml, media = dump(plain).encode(), "application/yaml"
    container.add_attachment(EPOCH_NS, "scenario.yaml", media, yaml)
    text = json.dumps(plain, indent=2, ensure_ascii=False)
    container.add_attachment(EPOCH_NS, "scenario.json", "application/json", text.encode())
    components = json.dumps(inventory(system), ensure_ascii=False).encode()
    container.add_attachment(EPOCH_NS, INVENTORY, "application/json", components)
    container.add_metadata("hedgehop.provenance", provenance(system))
    container.add_metadata("hedgehop.scene", system.scenario.scene)
