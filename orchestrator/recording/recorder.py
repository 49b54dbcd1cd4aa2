"""Write a run to an MCAP file as it happens."""

import json
import logging
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.listener import Result
from orchestrator.recording.provenance import EPOCH_NS, document, provenance
from orchestrator.recording.topics import topics
from orchestrator.recording.wire import Encoder, timestamp
from orchestrator.scenario.records import Scenario
from orchestrator.scenario.yaml_source import dump

FLUSH_NS = 1_000_000_000
CHUNK_BYTES = 1 << 24  # never reached within a second: the flush decides

_log = logging.getLogger("hedgehop")


@dataclass(slots=True)
class _Stream:
    """An open channel; where only changes are written, `last` is what the next is compared to."""

    channel: int
    encode: Encoder
    on_change: bool
    last: list[bytes] | None = None
    sequence: int = 0


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
        From `open`, before the file is touched, if a scene role names nothing to draw.
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
        self._writer: Writer | None = None
        self._whole = 0  # bytes of the file that end with a whole record
        self._streams: dict[tuple[str, str], list[_Stream]] = {}  # by listener call and component
        self._parameters: dict[str, dict[str, Value]] = {}  # all current values by component
        self._untimed: set[str] = set()  # components whose overruns are not recorded
        self._components: tuple[str, ...] = ()
        self._steps: dict[str, float] = {}  # measured at self._steps_ns, by component
        self._steps_ns = -1
        self._time_ns = -1
        self._stamp = b""
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
        self._components = tuple(system.ports)
        planned = topics(system, wall_clock=self._wall_clock)
        try:
            self._file = BufferedWriter(FileIO(self.path, "wb"))
            self._writer = writer = Writer(
                self._file,
                chunk_size=CHUNK_BYTES,
                compression=CompressionType.ZSTD,
                enable_data_crcs=True,
            )
            writer.start(profile="", library=f"hedgehop {version('hedgehop')}")
            _describe(writer, system.scenario)
            for topic in planned:
                schema = writer.register_schema(topic.message, "protobuf", topic.descriptors)
                channel = writer.register_channel(
                    topic.name, "protobuf", schema, dict(topic.metadata)
                )
                streams = self._streams.setdefault((topic.call, topic.component), [])
                streams.append(_Stream(channel, topic.encode, topic.on_change))
            self._flush(writer)
        except OSError as error:
            self._release()
            raise OSError(f"{self.path}: cannot be written, {error.strerror or error}") from error

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Write the groups of a component; wholly discrete ones only where something changed."""
        self._write(time_ns, ("outputs", component), values)

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Write the given inputs; the others are absent from the message."""
        self._write(time_ns, ("inputs", component), values)

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Write all parameters of a component, of which `values` are new."""
        current = self._parameters.setdefault(component, {})
        current.update(values)
        self._write(time_ns, ("parameters", component), current)

    def event(self, time_ns: int, kind: str, component: str, message: str, /) -> None:
        """Write what happened, unless it is a measurement that nobody asked to record."""
        if kind != "overrun" or component not in self._untimed:
            values = {"kind": kind, "component": component, "message": message}
            self._write(time_ns, ("event", ""), values)

    def log(self, time_ns: int, level: int, name: str, message: str, /) -> None:
        """Write a line of text; levels of `logging` are ten times those of `foxglove.Log`."""
        values = {"level": min(max(level // 10, 1), 5), "name": name, "message": message}
        self._write(time_ns, ("log", ""), values)

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float, /) -> None:
        """Keep the measured duration of a step, if wanted; one message tells all of an instant."""
        if time_ns != self._steps_ns:
            self._write_steps()
            self._steps_ns = time_ns
        self._steps[component] = self._steps.get(component, 0.0) + elapsed_s

    def _write_steps(self) -> None:
        if self._steps:
            values = dict.fromkeys(self._components, 0.0) | self._steps
            self._write(self._steps_ns, ("wall_clock", ""), values)
            self._steps = {}

    def close(self, result: Result, /) -> None:
        """Write the summary and finish the file; again, or without `open`, it does nothing."""
        writer = self._writer
        if writer is None:
            return
        summary: dict[str, str] = {}
        try:
            summary = self._summary(result)
        finally:
            try:
                if self.failure is None:
                    self._write_steps()
                    self._flush(writer)
                    writer.add_metadata("hedgehop.summary", summary)
                    writer.finish()
            except OSError as error:
                self._fail(error)
            self._release()

    def _write(self, time_ns: int, source: tuple[str, str], values: Mapping[str, Any]) -> None:
        writer = self._writer
        if writer is None or self.failure is not None:
            return
        if time_ns != self._time_ns:
            self._advance(writer, time_ns)
        now_ns, stamp = EPOCH_NS + time_ns, self._stamp
        for stream in self._streams.get(source, ()):
            parts = stream.encode(values)
            if stream.on_change:
                if parts == stream.last:
                    continue
                stream.last = parts
            stream.sequence += 1
            data = b"".join((stamp, *parts))
            writer.add_message(stream.channel, now_ns, data, now_ns, stream.sequence)

    def _advance(self, writer: Writer, time_ns: int) -> None:
        """Move on to another instant; at most one simulated second waits in memory."""
        self._time_ns = time_ns
        self._stamp = timestamp(EPOCH_NS + time_ns)
        if time_ns >= self._flush_ns:
            self._flush_ns = (time_ns // FLUSH_NS + 1) * FLUSH_NS
            try:
                self._flush(writer)
            except OSError as error:
                self._fail(error)

    def _flush(self, writer: Writer) -> None:
        writer.flush()
        if self._file is not None:
            self._whole = self._file.tell()

    def _fail(self, error: OSError) -> None:
        """Give up recording, and say so where it is still possible: the file is not."""
        if self.failure is None:
            self.failure = error
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
        if self.failure is not None:
            entries["recording"] = f"stopped at {self._time_ns / 1e9} s: {self.failure.strerror}"
        if self._metrics is not None:
            entries["metrics"] = json.dumps(self._metrics(result), allow_nan=False)
        return entries

    def _release(self) -> None:
        self._writer = None
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._file = None
            if self.failure is not None:  # what was torn goes; what was flushed stays readable
                with suppress(OSError):
                    os.truncate(self.path, self._whole)


def _describe(writer: Writer, scenario: Scenario) -> None:
    """Write what is known before the run: the scenario, where it comes from, what viewers draw."""
    plain = document(scenario)
    yaml, media = dump(plain).encode(), "application/yaml"
    writer.add_attachment(EPOCH_NS, EPOCH_NS, "scenario.yaml", media, yaml)
    text = json.dumps(plain, indent=2, ensure_ascii=False)
    writer.add_attachment(EPOCH_NS, EPOCH_NS, "scenario.json", "application/json", text.encode())
    writer.add_metadata("hedgehop.provenance", provenance(scenario))
    writer.add_metadata("hedgehop.scene", dict(scenario.scene))
