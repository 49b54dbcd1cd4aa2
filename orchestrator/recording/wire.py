"""Protobuf on the wire: laid out once per message type, filled in for many messages at a time.

Setting the fields of message objects one by one costs several times as much. The bytes are plain
proto3 (zeros are written out, varints may be longer than they need be; both are legal), so any
protobuf library reads them.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import starmap
from math import prod
from operator import itemgetter
from struct import Struct, calcsize
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = Mapping[str, Any]
Buffer = bytes | memoryview

VARINT, FIXED64, LENGTH = 0, 1, 2

# kind -> (struct code, wire type, dtype of arrays); integers are sfixed64 and fixed64 and
# enumerations stretched, so that a message's layout does not depend on its values
FIXED = {
    "double": ("d", FIXED64, "<f8"),
    "sfixed64": ("q", FIXED64, "<i8"),
    "fixed64": ("Q", FIXED64, "<u8"),
    "bool": ("?", VARINT, "?"),
}
SCALARS = {
    **{kind: (code, wire) for kind, (code, wire, _) in FIXED.items()},
    "enum": ("5s", VARINT),
}
STAMP = "14s"  # of what `timestamp` returns


@dataclass(frozen=True)
class WireField:
    """One field: its number, the key of its value, `double`, `bool`, `enum`, `string`..., shape."""

    number: int
    key: str
    kind: str
    shape: tuple[int, ...] = ()


@dataclass(frozen=True)
class Layout:
    """What a kind of message consists of behind its time stamp.

    Attributes
    ----------
    pieces
        Constants as they are, values as codes of `struct`, in order.
    scalars
        Returns the values for those codes.
    rest
        Returns what follows, arrays and text, in parts; None where nothing does.
    is_stamped
        Whether the message begins with its time stamp, as field 1; if not, `pieces` say where.
    """

    pieces: Sequence[bytes | str]
    scalars: Callable[[Values], Iterable[Any]]
    rest: Callable[[Values], Sequence[Buffer]] | None = None
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


def row_size(pieces: Sequence[bytes | str]) -> int:
    """Return the size of a row of pieces: constants as they are, values as codes of `struct`."""
    return sum(len(p) if isinstance(p, bytes) else calcsize(f"<{p}") for p in pieces)


def packer(pieces: Sequence[bytes | str]) -> Callable[[Iterable[Iterable[Any]]], bytes]:
    """Return a function from rows of values to bytes, with the constants of `pieces` between them.

    Constants are gaps in a `struct`, filled in all rows at once.
    """
    codes = (f"{len(p)}x" if isinstance(p, bytes) else p for p in pieces)
    row = Struct("<" + "".join(codes))
    blank = (p if isinstance(p, bytes) else bytes(calcsize(f"<{p}")) for p in pieces)
    constants = np.frombuffer(b"".join(blank), np.uint8)

    def pack(rows: Iterable[Iterable[Any]]) -> bytes:
        gaps = np.frombuffer(b"".join(starmap(row.pack, rows)), np.uint8)
        return (gaps.reshape(-1, row.size) | constants).tobytes()

    return pack


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

    Scalars come first, the rest follows, field by field. Encoding raises KeyError where a value is
    missing, ValueError where an array has another shape.
    """
    scalars = [field for field in fields if _is_scalar(field)]
    rest = [(field.key, *_variable(field)) for field in fields if not _is_scalar(field)]
    pieces: list[bytes | str] = []
    for field in scalars:
        code, wire_type = SCALARS[field.kind]
        pieces += [tag(field.number, wire_type), code]
    find = pick([field.key for field in scalars])
    enumerations = [k for k, field in enumerate(scalars) if field.kind == "enum"]

    def find_and_stretch(values: Values) -> list[Any]:
        found = list(find(values))
        for k in enumerations:
            found[k] = stretched(found[k])
        return found

    def rest_parts(values: Values) -> list[Buffer]:
        return [part for key, head, encode in rest for part in (head, encode(values[key]))]

    return Layout(pieces, find_and_stretch if enumerations else find, rest_parts if rest else None)


def partial_layout(fields: Sequence[WireField]) -> Callable[[Collection[str]], Layout]:
    """Return the layout of whichever of `fields` there are, as a function of their keys."""
    return lambda keys: layout([field for field in fields if field.key in keys])


def pick(keys: Sequence[str]) -> Callable[[Values], tuple[Any, ...]]:
    """Return a function that looks up several values."""
    if len(keys) > 1:
        return itemgetter(*keys)
    return lambda values: tuple(values[key] for key in keys)


def _is_scalar(field: WireField) -> bool:
    return field.kind in SCALARS and not field.shape


def _variable(field: WireField) -> tuple[bytes, Callable[[Any], Buffer]]:
    """Return what precedes an array, text or bytes, and the encoder of the rest of it."""
    number = field.number
    if field.kind in FIXED:
        return _packed(field)
    if field.kind == "enum":
        return b"", lambda array: delimited(number, b"".join(varint(int(v)) for v in array.flat))
    single = bytes if field.kind == "bytes" else _utf8
    if field.shape:  # text and bytes cannot be packed
        return b"", lambda array: b"".join(delimited(number, single(v)) for v in array.flat)
    return b"", lambda value: delimited(number, single(value))


def _utf8(text: object) -> bytes:
    return str(text).encode(errors="replace")


def _packed(field: WireField) -> tuple[bytes, Callable[[NDArray[Any]], Buffer]]:
    """Return what precedes an array of fixed width, and the encoder of its values, row by row."""
    dtype, shape = np.dtype(FIXED[field.kind][2]), field.shape

    def values(array: NDArray[Any]) -> memoryview:  # no copy: 36 kB each, some of them
        if array.shape != shape:
            raise ValueError(f"{field.key}: shape, got {array.shape}, expected {shape}")
        return array.astype(dtype, copy=False).ravel().view(np.uint8).data

    return tag(field.number, LENGTH) + varint(prod(shape) * dtype.itemsize), values
