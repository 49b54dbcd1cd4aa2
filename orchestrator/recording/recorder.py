"""Write a run to an MCAP file as it happens."""

import json
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from importlib.metadata import version
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Any

from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.listener import Result
from orchestrator.recording.container import Container
from orchestrator.recording.feed import Feed
from orchestrator.recording.inventory import INVENTORY, inventory
from orchestrator.recording.provenance import EPOCH_NS, document, provenance
from orchestrator.recording.topics import Topic
from orchestrator.scenario.yaml_source import dump
from orchestrator.viewing import layout as viewing
from orchestrator.viewing.plots import planned

FLUSH_NS = 1_000_000_000

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
        others told before are in the file.
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
        self._feed: Feed | None = None
        self._whole = 0  # bytes of the file that end with a whole record
        self._flush_ns = FLUSH_NS  # when to write next
        self._written_ns = 0  # up to when everything is in the file

    @property
    def wants_wall_clock(self) -> bool:
        """Whether steps should be measured."""
        return self._wall_clock

    def open(self, system: System, /) -> None:
        """Create the file and register every channel, so that a silent topic is listed too."""
        feed = Feed(system, wall_clock=self._wall_clock)
        spec = system.scenario.recording
        try:
            self._file = BufferedWriter(FileIO(self.path, "wb"))
            container = Container(
                self._file,
                f"hedgehop {version('hedgehop')}",
                compression=spec.compression,
                chunk_size=1000 * spec.chunk_kb,
            )
            _describe(container, system, feed.topics)
            feed.start(
                [
                    container.add_channel(t.name, t.message, t.descriptors, t.metadata)
                    for t in feed.topics
                ]
            )
            self._flush_file(self._file)
        except OSError as error:
            self._release()
            raise OSError(f"{self.path}: cannot be written, {error.strerror or error}") from error
        self._container, self._feed = container, feed

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Record a component's outputs."""
        self._at(time_ns).outputs(time_ns, component, values)

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Record the given inputs."""
        self._at(time_ns).inputs(time_ns, component, values)

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Record all parameters of a component, of which `values` are new."""
        self._at(time_ns).parameters(time_ns, component, values)

    def event(self, time_ns: int, kind: str, component: str, message: str, /) -> None:
        """Record what happened."""
        self._at(time_ns).event(time_ns, kind, component, message)

    def log(self, time_ns: int, level: int, name: str, message: str, /) -> None:
        """Record a line of text."""
        self._at(time_ns).log(time_ns, level, name, message)

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float, /) -> None:
        """Record the measured duration of a step, if wanted."""
        self._at(time_ns).wall_clock(time_ns, component, elapsed_s)

    def close(self, result: Result, /) -> None:
        """Write the summary and finish the file; again, or without `open`, it does nothing."""
        container, feed = self._container, self._feed
        if container is None or feed is None:
            return
        with ExitStack() as last:  # whatever fails, the rest is done
            last.callback(self._release)
            last.callback(self._finish, container, feed, result)
            self._flush()

    def _at(self, time_ns: int) -> Feed:
        """Return what keeps what is told, after writing what has waited long enough."""
        assert self._feed is not None  # `open` comes first
        if time_ns > self._flush_ns:  # a second waits in memory until after its last instant
            self._flush()
            self._flush_ns = (time_ns // FLUSH_NS + 1) * FLUSH_NS
        return self._feed

    def _flush(self) -> None:
        """Write what was kept.

        Raises
        ------
        ValueError
            If some of it cannot be; everything else has been written.
        """
        container, file, feed = self._container, self._file, self._feed
        if container is None or file is None or feed is None or self.failure is not None:
            return
        told, refusals = feed.take()
        try:
            container.add_messages(told)
            self._flush_file(file)
            self._written_ns = self._flush_ns
        except OSError as error:
            self._fail(error)
        if refusals:
            raise refusals[0]

    def _flush_file(self, file: BufferedWriter) -> None:
        file.flush()
        self._whole = file.tell()

    def _finish(self, container: Container, feed: Feed, result: Result) -> None:
        summary: dict[str, str] = {}
        try:
            summary = self._summary(feed, result)
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
            if self._feed is not None:
                self._feed.stop()
            after = f"after {self._written_ns / 1e9:g} s of simulated time"
            _log.error("%s: recording stopped %s, %s", self.path, after, error.strerror or error)

    def _summary(self, feed: Feed, result: Result) -> dict[str, str]:
        unwanted = {f"overruns.{component}" for component in feed.untimed}
        counts = {name: n for name, n in result.counts.items() if name not in unwanted}
        entries = {
            "outcome": result.outcome,
            "reason": result.reason,
            "end_ns": f"{result.time_ns}",
        }
        if feed.has_wall_clock:
            entries |= {"cpu_s": repr(result.cpu_s), "wall_s": repr(result.wall_s)}
        entries["counts"] = json.dumps(counts, sort_keys=True)
        if self._metrics is not None:
            entries["metrics"] = json.dumps(self._metrics(result), allow_nan=False)
        return entries

    def _release(self) -> None:
        self._container = None
        if self._feed is not None:
            self._feed.stop()
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._file = None
            if self.failure is not None:  # what was torn goes; what was flushed stays readable
                with suppress(OSError):
                    os.truncate(self.path, self._whole)


def _describe(container: Container, system: System, recorded: Sequence[Topic]) -> None:
    """Write what is known before the run: the scenario, where it comes from, what viewers draw."""
    plain = document(system.scenario)
    yaml, media = dump(plain).encode(), "application/yaml"
    container.add_attachment(EPOCH_NS, "scenario.yaml", media, yaml)
    text = json.dumps(plain, indent=2, ensure_ascii=False)
    container.add_attachment(EPOCH_NS, "scenario.json", "application/json", text.encode())
    components = json.dumps(inventory(system), ensure_ascii=False).encode()
    container.add_attachment(EPOCH_NS, INVENTORY, "application/json", components)
    if system.scenario.recording.scene:
        layout = viewing.layout_json(planned(system, recorded))
        container.add_attachment(EPOCH_NS, viewing.NAME, "application/json", layout)
    container.add_metadata("hedgehop.provenance", provenance(system))
    container.add_metadata("hedgehop.scene", system.scenario.scene)
