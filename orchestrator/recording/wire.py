"""Protobuf on the wire: encoders laid out once per message type, one `struct` call per message.

Setting the fields of a message object one by one costs several times as much. The bytes are plain
proto3 (zeros are written out, which is legal), so any protobuf library reads them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from operator import itemgetter
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

# to the parts of a message that follow its time stamp: comparing them costs no copy
Encoder = Callable[[Mapping[str, Any]], list[bytes]]

VARINT, FIXED64, LENGTH = 0, 1, 2

# kind -> (struct code, wire type, dtype of arrays); integers are sfixed64 and fixed64, so that a
# message's layout does not depend on its values
FIXED = {
    "double": ("d", FIXED64, "<f8"),
    "sfixed64": ("q", FIXED64, "<i8"),
    "fixed64": ("Q", FIXED64, "<u8"),
    "bool": ("?", VARINT, "?"),
}


@dataclass(frozen=True)
class WireField:
    """One field: its number, the key of its value, `double`, `bool`, `enum`, `string`..., shape."""

    number: int
    key: str
    kind: str
    shape: tuple[int, ...] = ()


def varint(value: int) -> bytes:
    """Return the base-128 encoding of an integer; negative ones as 64-bit two's complement."""
    value &= 0xFFFF_FFFF_FFFF_FFFF
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def tag(number: int, wire_type: int) -> bytes:
    """Return the bytes that precede a field's value."""
    return varint(number << 3 | wire_type)


def delimited(number: int, data: bytes) -> bytes:
    """Return a length-delimited field: a string, a packed array or a message."""
    return tag(number, LENGTH) + varint(len(data)) + data


def timestamp(time_ns: int) -> bytes:
    """Return field 1 of every message here: a `google.protobuf.Timestamp`."""
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    return delimited(1, b"\x08" + varint(seconds) + b"\x10" + varint(nanos))


def _enumeration(number: int) -> Callable[[int], bytes]:
    head = tag(number, VARINT)
    ready = [head + varint(value) for value in range(128)]
    return lambda value: ready[value] if 0 <= value < 128 else head + varint(value)


def _array(field: WireField) -> Callable[[NDArray[Any]], bytes]:
    """Return the encoder of an array, row by row, of text or items: text cannot be packed."""
    number = field.number
    if field.kind == "string":
        return lambda array: b"".join(delimited(number, str(v).encode()) for v in array.flat)
    return lambda array: delimited(number, b"".join(varint(int(v)) for v in array.flat))


def _packed(field: WireField) -> tuple[bytes, Callable[[NDArray[Any]], bytes]]:
    """Return what precedes an array of fixed width, and the encoder of its values, row by row."""
    dtype = np.dtype(FIXED[field.kind][2])
    size = prod(field.shape) * dtype.itemsize

    last: tuple[NDArray[Any] | None, bytes] = None, b""

    def values(array: NDArray[Any]) -> bytes:
        nonlocal last
        if array is last[0]:
            return last[1]
        data = (array if array.dtype == dtype else array.astype(dtype)).tobytes()
        if len(data) != size:
            raise ValueError(f"{field.key}: shape, got {array.shape}, expected {field.shape}")
        if not array.flags.writeable:  # the same array again has the same bytes
            last = array, data
        return data

    return tag(field.number, LENGTH) + varint(size), values


def _variable(field: WireField) -> tuple[bytes, Callable[[Any], bytes]]:
    """Return the two parts of a field whose length varies, or is that of an array."""
    if field.shape and field.kind in FIXED:
        return _packed(field)
    if field.shape:
        return b"", _array(field)
    if field.kind == "enum":
        return b"", _enumeration(field.number)
    return b"", lambda text: delimited(field.number, str(text).encode(errors="replace"))


def encoder(fields: Sequence[WireField]) -> Encoder:
    """Return a function that encodes the values of `fields`, looked up by key.

    Scalars of fixed width come first on the wire, in one `struct`; the rest follows, field by
    field. A value that is missing raises KeyError.
    """
    fixed = [f for f in fields if f.kind in FIXED and not f.shape]
    rest = [(f.key, *_variable(f)) for f in fields if f.kind not in FIXED or f.shape]
    tags = [tag(f.number, FIXED[f.kind][1]) for f in fixed]
    layout = Struct(
        "<" + "".join(f"{len(t)}s{FIXED[f.kind][0]}" for t, f in zip(tags, fixed, strict=True))
    )
    arguments: list[Any] = [b""] * (2 * len(fixed))
    arguments[0::2] = tags
    pack = layout.pack
    keys = [f.key for f in fixed]
    pick = itemgetter(*keys) if len(keys) > 1 else None  # of one key it would return no tuple

    def encode(values: Mapping[str, Any]) -> list[bytes]:
        arguments[1::2] = [values[key] for key in keys] if pick is None else pick(values)
        parts = [pack(*arguments)]
        for key, head, single in rest:
            parts += head, single(values[key])
        return parts

    return encode


def partial_encoder(fields: Sequence[WireField]) -> Encoder:
    """Return a function that encodes whichever of `fields` have a value."""
    made: dict[tuple[str, ...], Encoder] = {}

    def encode(values: Mapping[str, Any]) -> list[bytes]:
        keys = tuple(values)
        if keys not in made:
            made[keys] = encoder([field for field in fields if field.key in values])
        return made[keys](values)

    return encode
