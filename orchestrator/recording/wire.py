"""Protobuf on the wire: laid out once per message type, filled in message by message.

Setting the fields of message objects one by one costs several times as much. The bytes are plain
proto3 (zeros are written out, varints may be longer than they need be; both are legal), so any
protobuf library reads them.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from operator import itemgetter
from struct import calcsize, pack
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Values = Mapping[str, Any]
Buffer = bytes | memoryview | NDArray[Any]

VARINT, FIXED64, LENGTH = 0, 1, 2

# kind -> (struct code, wire type, dtype of arrays); integers are sfixed64 and fixed64 and
# enumerations stretched, so that a message's layout does not depend on its values
FIXED = {
    "double": ("d", FIXED64, "<f8"),
    "sfixed64": ("q", FIXED64, "<i8"),
    "fixed64": ("Q", FIXED64, "<u8"),
    "bool": ("?", VARINT, "?"),
}
ENUM = "5s"  # of what `stretched` returns
SCALARS = {
    **{kind: (code, wire) for kind, (code, wire, _) in FIXED.items()},
    "enum": (ENUM, VARINT),
}
STAMP = "14s"  # of what `timestamp` returns


@dataclass(frozen=True)
class WireField:
    """One field: its number, the key of its value, `double`, `bool`, `enum`, `string`..., shape."""

    number: int
    key: str
    kind: str
    shape: tuple[int, ...] = ()


class Instant(NamedTuple):
    """A log time: in ns, as a message tells it, and as a record does; there both follow."""

    time_ns: int
    stamp: bytes
    times: bytes


class Array(NamedTuple):
    """The place of an array: the key of its value, the type and shape that it must have."""

    key: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Its bytes."""
        return prod(self.shape) * self.dtype.itemsize

    def reader(self) -> Callable[[Values], NDArray[Any]]:
        """Return a function to the array as it is written, row by row; it copies only if it must.

        It raises KeyError if there is none, ValueError if it has another shape, TypeError if
        numbers would lose something.
        """
        key, dtype, shape = self

        def read(values: Values) -> NDArray[Any]:
            array = values[key]
            if array.shape != shape:
                raise ValueError(f"{key}: shape, got {array.shape}, expected {shape}")
            return array.astype(dtype, order="C", casting="same_kind", copy=False)

        return read


Piece = bytes | str | Array


@dataclass(frozen=True)
class Layout:
    """What a kind of message consists of, behind its time stamp.

    Attributes
    ----------
    pieces
        Constants as they are, scalars as codes of `struct`, and arrays, in order.
    keys
        Of the scalars, if they are looked up.
    computed
        Returns the scalars of an instant, if they are not looked up.
    tail
        Returns the rest, whose size is not known before.
    is_stamped
        Whether the message begins with its time stamp, as field 1; if not, `pieces` say where.
    """

    pieces: Sequence[Piece]
    keys: tuple[str, ...] = ()
    computed: Callable[[Instant, Any], Sequence[Any]] | None = None
    tail: Callable[[Instant, Any], bytes] | None = None
    is_stamped: bool = True


def varint(value: int) -> bytes:
    """Return the base-128 encoding of an integer; negative ones as 64-bit two's complement."""
    value &= 0xFFFF_FFFF_FFFF_FFFF
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


@lru_cache(256)
def stretched(value: int) -> bytes:
    """Return the base-128 encoding of the lowest 35 bits of an integer, always in five bytes.

    An int32 or an enumeration comes back whole: readers take its lowest 32 bits.

    >>> stretched(1).hex(" ")
    '81 80 80 80 00'
    """
    return bytes([value >> k & 0x7F | 0x80 for k in (0, 7, 14, 21)] + [value >> 28 & 0x7F])


def tag(number: int, wire_type: int) -> bytes:
    """Return what precedes the value of a field."""
    return varint(number << 3 | wire_type)


def delimited(number: int, data: bytes) -> bytes:
    """Return a field of bytes, text, a message or a packed array."""
    return tag(number, LENGTH) + varint(len(data)) + data


def timestamp(time_ns: int) -> bytes:
    """Return field 1 of every recorded message: a `google.protobuf.Timestamp`."""
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    return b"\x0a\x0c\x08" + stretched(seconds) + b"\x10" + stretched(nanos)


def row_size(pieces: Sequence[Piece]) -> int:
    """Return the size of a row of pieces."""
    return sum(_size(piece) for piece in pieces)


def constant(pieces: Sequence[bytes | str], *scalars: float) -> bytes:
    """Return pieces with their scalars as they are on the wire."""
    left = iter(scalars)
    return b"".join(p if isinstance(p, bytes) else pack(f"<{p}", next(left)) for p in pieces)


def columns(pieces: Sequence[bytes | str]) -> Callable[..., bytes]:
    """Return a function from arrays (n,), one for each code of `pieces`, to the bytes of n rows."""
    dtype = np.dtype(
        [(f"{k}", f"V{len(p)}" if isinstance(p, bytes) else f"<{p}") for k, p in enumerate(pieces)]
    )
    blank = np.zeros(1, dtype)
    for k, piece in enumerate(pieces):
        if isinstance(piece, bytes):
            blank[f"{k}"] = np.void(piece)
    names = [f"{k}" for k, piece in enumerate(pieces) if isinstance(piece, str)]

    def pack(*arrays: NDArray[Any]) -> bytes:
        rows = np.repeat(blank, len(arrays[0]))
        for name, array in zip(names, arrays, strict=True):
            rows[name] = array
        return rows.tobytes()

    return pack


def nested(number: int, *pieces: bytes | str) -> tuple[bytes | str, ...]:
    """Return the pieces of a message of fixed size in a field."""
    return tag(number, LENGTH) + varint(row_size(pieces)), *pieces


def layout(fields: Sequence[WireField]) -> Layout:
    """Return the layout of a message of `fields`, whose values are looked up by key.

    Scalars come first, then arrays of fixed width, then the rest, field by field. Encoding raises
    KeyError where a value is missing, ValueError where an array has another shape.
    """
    scalars = [field for field in fields if field.kind in SCALARS and not field.shape]
    arrays = [field for field in fields if field.kind in FIXED and field.shape]
    rest = [(f.key, _variable(f)) for f in fields if f not in scalars and f not in arrays]
    pieces: list[Piece] = []
    for field in scalars:
        code, wire_type = SCALARS[field.kind]
        pieces += [tag(field.number, wire_type), code]
    for field in arrays:
        array = Array(field.key, np.dtype(FIXED[field.kind][2]), field.shape)
        pieces += [tag(field.number, LENGTH) + varint(array.size), array]

    def tail(_: Instant, values: Values) -> bytes:
        return b"".join([encode(values[key]) for key, encode in rest])

    keys = tuple(field.key for field in scalars)
    return Layout(pieces, keys, tail=tail if rest else None)


def partial_layout(fields: Sequence[WireField]) -> Callable[[Collection[str]], Layout]:
    """Return the layout of whichever of `fields` there are, as a function of their keys."""
    return lambda keys: layout([field for field in fields if field.key in keys])


def pick(keys: Sequence[str]) -> Callable[[Values], tuple[Any, ...]]:
    """Return a function that looks up several values."""
    if len(keys) > 1:
        return itemgetter(*keys)
    if not keys:
        return lambda _: ()
    (key,) = keys
    return lambda values: (values[key],)


def _size(piece: Piece) -> int:
    if isinstance(piece, str):
        return calcsize(f"<{piece}")
    return len(piece) if isinstance(piece, bytes) else piece.size


def _variable(field: WireField) -> Callable[[Any], bytes]:
    """Return the encoder of a field of text, bytes or an array of those or of enumerations."""
    number = field.number
    if field.kind == "enum":
        return lambda array: delimited(number, b"".join(varint(int(v)) for v in array.flat))
    single = bytes if field.kind == "bytes" else _utf8
    if field.shape:  # text and bytes cannot be packed
        return lambda array: b"".join(delimited(number, single(v)) for v in array.flat)
    return lambda value: delimited(number, single(value))


def _utf8(text: object) -> bytes:
    return str(text).encode(errors="replace")
