"""Protobuf schemas made from variables: one channel per component and top-level group.

`state.theta` of `vehicle` becomes the field `theta` of `hedgehop.vehicle.State` on the topic
`/vehicle/state`; variables without a group go to `/vehicle/outputs`. Names that protobuf cannot
spell are changed, and the original kept in the channel's metadata beside units and bounds.
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

from google.protobuf import descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import Message

from orchestrator.description import Port
from orchestrator.wire import WireField

Kind = Literal["outputs", "parameters", "inputs"]

_KINDS = {
    "float": "double",
    "integer": "sfixed64",
    "boolean": "bool",
    "string": "string",
    "enumeration": "enum",
}
_TYPES = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "sfixed64": FieldDescriptorProto.TYPE_SFIXED64,
    "fixed64": FieldDescriptorProto.TYPE_FIXED64,
    "bool": FieldDescriptorProto.TYPE_BOOL,
    "string": FieldDescriptorProto.TYPE_STRING,
    "enum": FieldDescriptorProto.TYPE_ENUM,
}
_GROUPED = re.compile(r"([A-Za-z_]\w*)\.(.+)", re.ASCII | re.DOTALL)
_RESERVED = ("outputs", "parameters", "inputs")


@dataclass(frozen=True)
class Channel:
    """What one topic carries.

    Attributes
    ----------
    topic, component, kind
        Where the values come from; `kind` is `outputs`, `parameters` or `inputs`.
    ports
        The variables, in field order: field number 2 is the first, 1 is the time stamp.
    fields
        The name of each variable's field.
    message : str
        Full name of the message type.
    descriptors : bytes
        Serialised `FileDescriptorSet` of the message and what it imports.
    """

    topic: str
    component: str
    kind: Kind
    ports: tuple[Port, ...]
    fields: tuple[str, ...]
    message: str
    descriptors: bytes

    @property
    def is_discrete(self) -> bool:
        """Whether every variable only changes at events, so that equal values say nothing new."""
        return all(port.variability == "discrete" for port in self.ports)

    @property
    def metadata(self) -> dict[str, str]:
        """Return what the message type cannot say, as strings: `unit.<field>`, `name.<field>`...

        `name.` is there where the variable is not called `<group>.<field>`.
        """
        entries = {"component": self.component, "kind": self.kind}
        group = self.topic.rsplit("/", 1)[1]
        for name, port in zip(self.fields, self.ports, strict=True):
            if port.name != (name if group in _RESERVED else f"{group}.{name}"):
                entries[f"name.{name}"] = port.name
            entries[f"unit.{name}"] = _unit(port)
            if port.shape:
                entries[f"shape.{name}"] = json.dumps(port.shape)
            if port.items:
                entries[f"items.{name}"] = json.dumps(dict(port.items), ensure_ascii=False)
            if port.min is not None:
                entries[f"min.{name}"] = repr(port.min)
            if port.max is not None:
                entries[f"max.{name}"] = repr(port.max)
        return entries

    def wire_fields(self) -> list[WireField]:
        """Return the layout for :func:`orchestrator.wire.encoder`; keys are variable names."""
        return [
            WireField(number, port.name, kind_of(port), port.shape)
            for number, port in enumerate(self.ports, start=2)
        ]


def kind_of(port: Port) -> str:
    """Return the protobuf type of a variable: `double`, `sfixed64`, `bool`, `string`, `enum`...

    Integers are of fixed width on the wire; readers see plain 64-bit integers.
    """
    return "fixed64" if port.type == "UInt64" else _KINDS[port.kind]


def _unit(port: Port) -> str:
    return "1" if port.unit is None else port.unit.name


def identifier(text: str) -> str:
    """Return the nearest legal protobuf identifier.

    >>> identifier("der(x)"), identifier("a.b[1]"), identifier("2nd")
    ('der_x', 'a_b_1', '_2nd')
    """
    name = re.sub(r"[^A-Za-z0-9_]+", "_", text).rstrip("_") or "_"
    return f"_{name}" if name[0].isdigit() else name


def group_of(name: str) -> str:
    """Return the top-level group of a variable, `outputs` where it has none.

    A group that bears the name of one of the fixed topics gets an underscore: `outputs_`.
    """
    match = _GROUPED.fullmatch(name)
    if match is None:
        return "outputs"
    return f"{match[1]}_" if match[1] in _RESERVED else match[1]


def channels(component: str, ports: Iterable[Port]) -> list[Channel]:
    """Return the channels of a component's outputs and parameters, in the order of `ports`."""
    groups: dict[tuple[Kind, str], list[Port]] = {}
    for port in ports:
        if port.causality == "output":
            groups.setdefault(("outputs", group_of(port.name)), []).append(port)
        elif port.causality in ("parameter", "structuralParameter"):
            groups.setdefault(("parameters", "parameters"), []).append(port)
    return [channel(component, kind, group, members) for (kind, group), members in groups.items()]


def channel(component: str, kind: Kind, group: str, ports: Iterable[Port]) -> Channel:
    """Return the channel of a group of variables.

    Fields of inputs and parameters have presence (`optional`): a message holds those that are told.
    """
    members = tuple(ports)
    used = {"timestamp"}
    fields = tuple(
        _unused(identifier(_member(port.name, group)), used, _spelling) for port in members
    )
    package, title = f"hedgehop.{identifier(component)}", _title(group)
    return Channel(
        topic=f"/{component}/{group}",
        component=component,
        kind=kind,
        ports=members,
        fields=fields,
        message=f"{package}.{title}",
        descriptors=descriptors(package, title, fields, members, optional=kind != "outputs"),
    )


def descriptors(
    package: str,
    title: str,
    fields: Sequence[str],
    ports: Sequence[Port],
    *,
    optional: bool = False,
) -> bytes:
    """Return the serialised `FileDescriptorSet` of a message with one field per variable."""
    file = FileDescriptorProto(
        name=f"{package.replace('.', '/')}/{title}.proto",
        package=package,
        syntax="proto3",
        dependency=["google/protobuf/timestamp.proto"],
    )
    message = file.message_type.add(name=title)
    message.field.add(
        name="timestamp",
        number=1,
        type=FieldDescriptorProto.TYPE_MESSAGE,
        label=FieldDescriptorProto.LABEL_OPTIONAL,
        type_name=".google.protobuf.Timestamp",
    )
    scope = {"timestamp", *fields}  # fields, enumerations and their items share one scope
    for index, (name, port) in enumerate(zip(fields, ports, strict=True), start=1):
        field = _add_field(message, name, port)
        if port.kind == "enumeration":
            field.type_name = f".{package}.{title}.{_add_enumeration(message, name, port, scope)}"
        if optional and not port.shape:  # presence is a oneof of one, says protobuf
            field.proto3_optional = True
            field.oneof_index = len(message.oneof_decl)
            message.oneof_decl.add(name=_unused(f"_{name}", scope))
        file.source_code_info.location.add(
            path=[4, 0, 2, index], span=[index, 0, 1], leading_comments=_comment(port)
        )
    return FileDescriptorSet(file=[_timestamp_file(), file]).SerializeToString(deterministic=True)


def variable_name(topic: str, field: str, metadata: Mapping[str, str]) -> str:
    """Return the variable, without its component, that a field of a channel holds."""
    group = topic.rsplit("/", 1)[1]
    return metadata.get(f"name.{field}", field if group in _RESERVED else f"{group}.{field}")


def message_class(name: str, descriptors: bytes) -> type[Message]:
    """Return the class of message `name` of a serialised `FileDescriptorSet`.

    Every call has its own pool: the default one refuses a second message of the same name.
    """
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(descriptors).file:
        pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


@cache
def _timestamp_file() -> FileDescriptorProto:
    file = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(file)
    return file


def _member(name: str, group: str) -> str:
    """Return the part of a variable's name that its topic does not say already."""
    match = _GROUPED.fullmatch(name)
    return match[2] if match is not None and group not in _RESERVED else name


def _spelling(name: str) -> str:
    # protobuf forbids two fields that differ in case or underscores only: their JSON names collide
    return name.replace("_", "").lower()


def _unused(name: str, used: set[str], key: Callable[[str], str] = str) -> str:
    """Return `name`, or the first of `name_2`, `name_3`, ... that is free, and mark it used."""
    candidates: Iterator[str] = (f"{name}_{n}" if n > 1 else name for n in range(1, len(used) + 2))
    free = next(c for c in candidates if key(c) not in used)
    used.add(key(free))
    return free


def _title(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_")) or "_"


def _add_field(message: DescriptorProto, name: str, port: Port) -> FieldDescriptorProto:
    field = FieldDescriptorProto
    return message.field.add(
        name=name,
        number=len(message.field) + 1,
        type=_TYPES[kind_of(port)],
        label=field.LABEL_REPEATED if port.shape else field.LABEL_OPTIONAL,
    )


def _add_enumeration(message: DescriptorProto, name: str, port: Port, scope: set[str]) -> str:
    """Nest the enumeration of a variable in its message and return its name."""
    title = _unused(_title(name), scope)
    enumeration = message.enum_type.add(name=title)
    items = {0: f"{name} unset"} | dict(port.items)  # proto3 wants a zero, and wants it first
    for number, item in sorted(items.items(), key=lambda pair: (pair[0] != 0, pair[0])):
        enumeration.value.add(name=_unused(identifier(item).upper(), scope), number=number)
    return title


def _comment(port: Port) -> str:
    bounds = f", {port.min} to {port.max}" if port.min is not None or port.max is not None else ""
    return f" {port.name} [{_unit(port)}{bounds}] {port.description}".rstrip() + "\n"
