"""Protobuf message types made from variables at run time, each in a pool of its own."""

import re
from collections.abc import Callable, Sequence
from functools import cache
from itertools import count

from google.protobuf import descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import Message

from orchestrator.assembly.description import Port

_KINDS = {
    "float": "double",
    "integer": "sfixed64",
    "boolean": "bool",
    "string": "string",
    "binary": "bytes",
    "enumeration": "enum",
}
_TYPES = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "sfixed64": FieldDescriptorProto.TYPE_SFIXED64,
    "fixed64": FieldDescriptorProto.TYPE_FIXED64,
    "bool": FieldDescriptorProto.TYPE_BOOL,
    "string": FieldDescriptorProto.TYPE_STRING,
    "bytes": FieldDescriptorProto.TYPE_BYTES,
    "enum": FieldDescriptorProto.TYPE_ENUM,
}


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
            message.oneof_decl.add(name=unused(f"_{name}", scope))
        file.source_code_info.location.add(
            path=[4, 0, 2, index], span=[index, 0, 1], leading_comments=_comment(port)
        )
    return FileDescriptorSet(file=[_timestamp_file(), file]).SerializeToString(deterministic=True)


def message_class(name: str, descriptors: bytes) -> type[Message]:
    """Return the class of message `name` of a serialised `FileDescriptorSet`.

    Every call has its own pool: the default one refuses a second message of the same name.
    """
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(descriptors).file:
        pool.AddSerializedFile(file.SerializeToString())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def kind_of(port: Port) -> str:
    """Return the protobuf type of a variable: `double`, `sfixed64`, `bool`, `string`, `enum`...

    Integers are of fixed width on the wire; readers see plain 64-bit integers.
    """
    return "fixed64" if port.type == "UInt64" else _KINDS[port.kind]


def unit_name(port: Port) -> str:
    """Return a variable's unit, `1` where it has none."""
    return "1" if port.unit is None else port.unit.name


def identifier(text: str) -> str:
    """Return the nearest legal protobuf identifier.

    >>> identifier("der(x)"), identifier("a.b[1]"), identifier("2nd")
    ('der_x', 'a_b_1', '_2nd')
    """
    name = re.sub(r"[^A-Za-z0-9_]+", "_", text).rstrip("_") or "_"
    return f"_{name}" if name[0].isdigit() else name


def unused(name: str, used: set[str], key: Callable[[str], str] = str) -> str:
    """Return `name`, or the first of `name_2`, `name_3`, ... that is free, and mark it used."""
    candidates = (f"{name}_{n}" if n > 1 else name for n in count(1))
    free = next(candidate for candidate in candidates if key(candidate) not in used)
    used.add(key(free))
    return free


def title_of(name: str) -> str:
    """Return a name as message types are written: `terrain_map` as `TerrainMap`."""
    return "".join(part.capitalize() for part in name.split("_")) or "_"


@cache
def _timestamp_file() -> FileDescriptorProto:
    file = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(file)
    return file


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
    title = unused(title_of(name), scope)
    enumeration = message.enum_type.add(name=title)
    items = {0: f"{name} unset"} | dict(port.items)  # proto3 wants a zero, and wants it first
    for number, item in sorted(items.items(), key=lambda pair: (pair[0] != 0, pair[0])):
        enumeration.value.add(name=unused(identifier(item).upper(), scope), number=number)
    return title


def _comment(port: Port) -> str:
    low, high = ("" if bound is None else f"{bound}" for bound in (port.min, port.max))
    bounds = f", {low}..{high}" if low or high else ""
    return f" {port.name} [{unit_name(port)}{bounds}] {port.description}".rstrip() + "\n"
