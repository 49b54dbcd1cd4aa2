"""Recorded messages and the signals in them: a column of values for every field."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from google.protobuf.message import Message
from numpy.typing import NDArray

from orchestrator.recording.descriptors import message_class
from orchestrator.recording.schemas import variable_name

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


def signals(topic: str, messages: Messages) -> list[Signal]:
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


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)
