"""Read a recording back: every signal by its full name, and everything that was said about it."""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import zstandard
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Header, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from orchestrator.errors import nearest
from orchestrator.listener import Result
from orchestrator.schemas import message_class, variable_name
from orchestrator.topics import EVENTS, WALL_CLOCK

# an array and a string of bytes look the same on the wire: arrays are read in one piece
PACKED: dict[int, str] = {
    FieldDescriptorProto.TYPE_DOUBLE: "<f8",
    FieldDescriptorProto.TYPE_SFIXED64: "<i8",
    FieldDescriptorProto.TYPE_FIXED64: "<u8",
    FieldDescriptorProto.TYPE_BOOL: "?",
}
DTYPES: dict[int, str] = {**PACKED, FieldDescriptorProto.TYPE_ENUM: "<i8"}


@dataclass(frozen=True)
class Signal:
    """One recorded variable, `component.variable`, and what its channel says about it."""

    name: str
    topic: str
    field_name: str
    unit: str
    shape: tuple[int, ...] = ()
    items: Mapping[int, str] = field(default_factory=dict[int, str])
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class Event:
    """Something that happened; the time is simulated, s."""

    time_s: float
    kind: str
    component: str
    message: str


@dataclass(frozen=True)
class Messages:
    """One topic's messages as they stand in the file: `raw` is (ns from the start, bytes)."""

    message: str
    descriptors: bytes
    metadata: Mapping[str, str]
    raw: list[tuple[int, bytes]]

    @cached_property
    def types(self) -> dict[str, int]:
        """Protobuf type by field."""
        return {each.name: each.type for each in _fields(self._files, self.message)}

    @cached_property
    def decoded(self) -> list[Message]:
        """All messages, in order; their packed arrays are `bytes`."""
        files = self._files
        for each in _fields(files, self.message):
            if each.label == FieldDescriptorProto.LABEL_REPEATED and each.type in PACKED:
                each.type = FieldDescriptorProto.TYPE_BYTES
                each.label = FieldDescriptorProto.LABEL_OPTIONAL
        parse = message_class(self.message, files.SerializeToString()).FromString
        return [parse(data) for _, data in self.raw]

    @property
    def _files(self) -> FileDescriptorSet:
        return FileDescriptorSet.FromString(self.descriptors)


@dataclass(frozen=True)
class Recording:
    """A finished recording; made by :meth:`open`.

    `recording["vehicle.state.u"]` is `(times_s, values)`, as in a trace: simulated seconds (n,) and
    values (n,) or (n, *shape). A variable that was only written where it changed has that many
    samples.
    """

    path: Path
    library: str
    topics: Mapping[str, Messages]
    signals: Mapping[str, Signal]
    scenario: Mapping[str, Any]
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
        steps: dict[str, list[float]] = {}
        for message in self.topics[WALL_CLOCK].decoded:
            component, elapsed = (getattr(message, name) for name in ("component", "elapsed_s"))
            steps.setdefault(component, []).append(elapsed)
        return {component: np.array(elapsed) for component, elapsed in steps.items()}


def column(topic: Messages, signal: Signal) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Return the times, ns from the start, and the values of a signal."""
    times = [time for time, _ in topic.raw]
    decoded = topic.decoded
    name, kind = signal.field_name, topic.types[signal.field_name]
    if topic.metadata["kind"] != "outputs":  # a message need not hold all of them
        has = [_is_set(message, signal) for message in decoded]
        times = [time for time, is_set in zip(times, has, strict=True) if is_set]
        decoded = [message for message, is_set in zip(decoded, has, strict=True) if is_set]
    values = [getattr(message, name) for message in decoded]
    if not signal.shape:
        array = np.array(values, DTYPES.get(kind, object))
    elif kind in PACKED:
        array = np.frombuffer(b"".join(values), PACKED[kind])
    else:
        array = np.array([list(value) for value in values], DTYPES.get(kind, object))
    return np.array(times, dtype=np.int64), array.reshape(len(times), *signal.shape)


def _is_set(message: Message, signal: Signal) -> bool:
    return (
        len(getattr(message, signal.field_name)) > 0
        if signal.shape
        else message.HasField(signal.field_name)
    )


def _fields(files: FileDescriptorSet, message: str) -> list[FieldDescriptorProto]:
    """Return the fields of a top-level message, to be changed in place."""
    return [
        each
        for file in files.file
        for candidate in file.message_type
        if f"{file.package}.{candidate.name}" == message
        for each in candidate.field
    ]


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
                case McapMessage():
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
    signals = [s for name, topic in topics.items() for s in _signals(name, topic)]
    return Recording(
        path=path,
        library=library,
        topics=topics,
        signals={signal.name: signal for signal in signals},
        scenario=json.loads(attachments["scenario.json"]),
        provenance=tables["hedgehop.provenance"],
        scene=tables["hedgehop.scene"],
        summary=tables.get("hedgehop.summary", {}),
    )


def _signals(topic: str, messages: Messages) -> list[Signal]:
    """Return the signals of a topic; none where it is not a component's."""
    notes = messages.metadata
    if "component" not in notes:
        return []
    return [
        Signal(
            name=f"{notes['component']}.{variable_name(topic, name, notes)}",
            topic=topic,
            field_name=name,
            unit=notes[f"unit.{name}"],
            shape=tuple(json.loads(notes.get(f"shape.{name}", "[]"))),
            items={int(k): v for k, v in json.loads(notes.get(f"items.{name}", "{}")).items()},
            min=_number(notes.get(f"min.{name}")),
            max=_number(notes.get(f"max.{name}")),
        )
        for name in messages.types
        if name != "timestamp"
    ]


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)
