"""Read a recording back: every signal by its full name, and everything that was said about it."""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from orchestrator.errors import nearest
from orchestrator.listener import Result
from orchestrator.recording.inventory import INVENTORY
from orchestrator.recording.messages import Messages, Signal, column, signals
from orchestrator.recording.topics import EVENTS, WALL_CLOCK


@dataclass(frozen=True)
class Event:
    """Something that happened; the time is simulated, s."""

    time_s: float
    kind: str
    component: str
    message: str


@dataclass(frozen=True)
class Recording:
    """A finished recording; made by :meth:`open`.

    `recording["vehicle.state.u"]` is `(times_s, values)`, as in a trace: simulated seconds (n,) and
    values (n,) or (n, *shape). A variable that was only written where it changed has that many
    samples. ``components`` is what :mod:`orchestrator.recording.inventory` says of each.
    """

    path: Path
    library: str
    topics: Mapping[str, Messages]
    signals: Mapping[str, Signal]
    scenario: Mapping[str, Any]
    components: Mapping[str, Any]
    provenance: Mapping[str, str]
    scene: Mapping[str, str]
    summary: Mapping[str, str]

    @classmethod
    def open(cls, path: Path | str) -> "Recording":
        """Read a file.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is not a whole recording; the message names the file.
        """
        file = Path(path)
        try:
            with file.open("rb") as stream:
                return _read(file, stream)
        except OSError as error:
            raise OSError(f"{file}: cannot be read, {error.strerror}") from error

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of all signals."""
        return tuple(self.signals)

    def __getitem__(self, name: str) -> tuple[NDArray[np.float64], NDArray[Any]]:
        if name not in self.signals:
            near = nearest(name, list(self.signals))
            raise KeyError(f"{self.path}: no such signal, got {name!r}, expected a variable{near}")
        signal = self.signals[name]
        times_ns, values = column(self.topics[signal.topic], signal)
        return times_ns / 1e9, values

    @cached_property
    def result(self) -> Result:
        """How the run ended; its measured times are 0 where the wall clock was not recorded."""
        entries = self.summary
        return Result(
            outcome=entries.get("outcome", ""),
            reason=entries.get("reason", ""),
            time_ns=int(entries.get("end_ns", "0")),
            counts=json.loads(entries.get("counts", "{}")),
            cpu_s=float(entries.get("cpu_s", "0")),
            wall_s=float(entries.get("wall_s", "0")),
        )

    @cached_property
    def events(self) -> list[Event]:
        """Everything that happened, in order."""
        names = ("kind", "component", "message")
        topic = self.topics[EVENTS]
        return [
            Event(time_ns / 1e9, *(getattr(message, name) for name in names))
            for (time_ns, _), message in zip(topic.raw, topic.decoded, strict=True)
        ]

    @cached_property
    def wall_clock(self) -> dict[str, NDArray[np.float64]] | None:
        """Measured duration of every step, s, by component; None if it was not recorded."""
        if WALL_CLOCK not in self.topics:
            return None
        topic = self.topics[WALL_CLOCK]
        steps = {
            component: np.array([getattr(message, component) for message in topic.decoded])
            for component in (name[5:] for name in topic.metadata if name.startswith("unit."))
        }
        return {component: elapsed[elapsed > 0] for component, elapsed in steps.items()}


def _read(path: Path, stream: BinaryIO) -> Recording:
    """Read all records, checking every CRC.

    Raises
    ------
    ValueError
    """
    library = ""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    messages: dict[int, list[tuple[int, bytes]]] = {}
    tables: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    try:
        for record in StreamReader(stream, validate_crcs=True).records:
            match record:
                case Message():
                    messages[record.channel_id].append((record.log_time, record.data))
                case Channel() if record.id not in channels:  # the summary repeats them
                    channels[record.id] = record
                    messages[record.id] = []
                case Schema():
                    schemas[record.id] = record
                case Metadata():
                    tables[record.name] = record.metadata
                case Attachment():
                    attachments[record.name] = record.data
                case Header():
                    library = record.library
                case _:
                    pass
    except (McapError, struct.error, zstandard.ZstdError, ValueError, KeyError) as error:
        what = "is no MCAP file" if stream.tell() <= 8 else "is cut short or damaged"
        raise ValueError(f"{path}: {what}, expected a finished recording") from error
    if "hedgehop.provenance" not in tables or "scenario.json" not in attachments:
        raise ValueError(f"{path}: not recorded by hedgehop, got {library!r}")
    epoch_ns = int(tables["hedgehop.provenance"]["epoch_ns"])
    topics = {
        channel.topic: Messages(
            schemas[channel.schema_id].name,
            schemas[channel.schema_id].data,
            channel.metadata,
            [(time_ns - epoch_ns, data) for time_ns, data in messages[number]],
        )
        for number, channel in channels.items()
    }
    found = [s for name, topic in topics.items() for s in signals(name, topic)]
    return Recording(
        path=path,
        library=library,
        topics=topics,
        signals={signal.name: signal for signal in found},
        scenario=json.loads(attachments["scenario.json"]),
        components=json.loads(attachments.get(INVENTORY, "{}")),
        provenance=tables["hedgehop.provenance"],
        scene=tables["hedgehop.scene"],
        summary=tables.get("hedgehop.summary", {}),
    )
