"""Memory that values travel through: one buffer per type and direction, allocated once.

``writer`` and ``reader`` return functions made for one tuple of names; they cost one FMI call per
type and little more. C types follow the FMI headers.
"""

import ctypes
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from orchestrator.component import Value
from orchestrator.fmu.calls import Calls
from orchestrator.fmu.variables import Block, Variable, blocks

# type in the function's name: C type, struct code
NUMBERS: Mapping[str, tuple[Any, str]] = {
    "Real": (ctypes.c_double, "d"),
    "Integer": (ctypes.c_int, "i"),
    "Boolean": (ctypes.c_int, "i"),
    "Float64": (ctypes.c_double, "d"),
    "Float32": (ctypes.c_float, "f"),
    "Int8": (ctypes.c_int8, "b"),
    "UInt8": (ctypes.c_uint8, "B"),
    "Int16": (ctypes.c_int16, "h"),
    "UInt16": (ctypes.c_uint16, "H"),
    "Int32": (ctypes.c_int32, "i"),
    "UInt32": (ctypes.c_uint32, "I"),
    "Int64": (ctypes.c_int64, "q"),
    "UInt64": (ctypes.c_uint64, "Q"),
}
DTYPES = {"float": np.float64, "boolean": np.bool_}  # of arrays outside; all others are int64

Write = Callable[[Mapping[str, Value]], None]
Read = Callable[[], dict[str, Value]]


class Buffer:
    """The memory of one block.

    Attributes
    ----------
    references : ctypes array of unsigned int
    values : ctypes array
        Of the C type; pointers for texts and binaries.
    sizes : ctypes array of size_t or None
        Of binaries.
    view : ndarray or None
        The same memory, flat; None for texts and binaries.
    """

    def __init__(self, block: Block, *, is_byte_boolean: bool) -> None:
        self.block = block
        references = block.references
        self.references = (ctypes.c_uint * len(references))(*references)
        self.sizes = (ctypes.c_size_t * block.size)() if block.kind == "binary" else None
        self.view: NDArray[Any] | None = None
        self.code = ""
        if block.kind == "string":
            self.values: Any = (ctypes.c_char_p * block.size)()
        elif block.kind == "binary":
            self.values = (ctypes.c_void_p * block.size)()
        else:
            c_type, self.code = NUMBERS[block.function]
            if block.kind == "boolean" and is_byte_boolean:
                c_type, self.code = ctypes.c_bool, "?"
            self.values = (c_type * block.size)()
            self.view = np.frombuffer(self.values, np.dtype(self.code))

    def numbers(self, count: int) -> struct.Struct:
        """Return the layout of the first ``count`` numbers."""
        return struct.Struct(f"{count}{self.code}")


@dataclass(frozen=True)
class Transfer:
    """The FMI call that fills a buffer or hands it over.

    Attributes
    ----------
    call : callable
        Returns the FMI status. It must not be called unless ``calls.is_usable``.
    """

    buffer: Buffer
    name: str
    calls: Calls
    call: Callable[[], int]

    def __call__(self) -> None:
        """Transfer; raises ``FmuError`` where the FMU refuses."""
        if not self.calls.is_usable:
            self.calls.refuse(self.name)
        if status := self.call():
            self.calls.check(self.name, status)


class Transferring(Protocol):
    """An instance that gets and sets whole buffers."""

    def new_buffer(self, block: Block) -> Buffer:
        """Return memory for a block."""
        ...

    def getter(self, buffer: Buffer) -> Transfer:
        """Return the call that fills a buffer."""
        ...

    def setter(self, buffer: Buffer) -> Transfer:
        """Return the call that hands a buffer over."""
        ...


def writer(instance: Transferring, variables: Sequence[Variable]) -> Write:
    """Return a function that sets these variables from a mapping which holds their names."""
    parts: list[Write] = []
    for block in blocks(variables):
        buffer = instance.new_buffer(block)
        parts.append(_writer(instance.setter(buffer)))
    if len(parts) == 1:
        return parts[0]

    def write(values: Mapping[str, Value]) -> None:
        for part in parts:
            part(values)

    return write


def reader(instance: Transferring, variables: Sequence[Variable]) -> Read:
    """Return a function that gets these variables as fresh values."""
    parts: list[Read] = []
    for block in blocks(variables):
        buffer = instance.new_buffer(block)
        parts.append(_reader(instance.getter(buffer)))
    if len(parts) == 1:
        return parts[0]

    def read() -> dict[str, Value]:
        values: dict[str, Value] = {}
        for part in parts:
            values |= part()
        return values

    return read


def _writer(transfer: Transfer) -> Write:
    buffer, block, view = transfer.buffer, transfer.buffer.block, transfer.buffer.view
    if view is None:
        fill = _texts if buffer.sizes is None else _binaries

        def write_pointers(values: Mapping[str, Value]) -> None:
            kept = fill(buffer, values)
            transfer()
            del kept  # the memory must outlive the call

        return write_pointers

    names = tuple(one.name for one in block.scalars)
    pack, memory = buffer.numbers(len(names)).pack_into, buffer.values
    pick: Callable[[Any], Any] = itemgetter(*names) if len(names) > 1 else _tuple_of(names)
    targets = [
        (one.name, one.shape, view[at : at + one.size].reshape(one.shape))
        for one, at in zip(block.arrays, block.starts.values(), strict=True)
    ]
    calls, call = transfer.calls, transfer.call

    def write_numbers(values: Mapping[str, Value]) -> None:
        try:
            pack(memory, 0, *pick(values))
        except (struct.error, OverflowError) as error:
            what = f"not a value of {block.function}, {error}"
            raise ValueError(f"{', '.join(names)}: {what}") from error
        for name, shape, target in targets:
            array = np.asarray(values[name])
            if array.shape != shape:
                raise ValueError(f"{name}: wrong shape, got {array.shape}, expected {shape}")
            target[...] = array
        if not calls.is_usable:
            calls.refuse(transfer.name)
        if status := call():  # not by way of transfer(): a call less at every step
            calls.check(transfer.name, status)

    only = names[0] if names else ""

    def write_one(values: Mapping[str, Value]) -> None:
        try:
            pack(memory, 0, values[only])
        except (struct.error, OverflowError) as error:
            raise ValueError(f"{only}: not a value of {block.function}, {error}") from error
        if not calls.is_usable:
            calls.refuse(transfer.name)
        if status := call():
            calls.check(transfer.name, status)

    return write_one if len(names) == 1 and not targets else write_numbers


def _reader(transfer: Transfer) -> Read:
    buffer, block, view = transfer.buffer, transfer.buffer.block, transfer.buffer.view
    if view is None:
        return _pointer_reader(transfer)
    names = tuple(one.name for one in block.scalars)
    unpack, memory = buffer.numbers(len(names)).unpack_from, buffer.values
    is_integer_boolean = block.kind == "boolean" and buffer.code == "i"
    dtype = DTYPES.get(block.kind, np.int64)
    sources = [
        (one.name, view[at : at + one.size].reshape(one.shape))
        for one, at in zip(block.arrays, block.starts.values(), strict=True)
    ]
    calls, call = transfer.calls, transfer.call

    def read_scalars() -> dict[str, Value]:
        if not calls.is_usable:
            calls.refuse(transfer.name)
        if status := call():
            calls.check(transfer.name, status)
        return dict(zip(names, unpack(memory)))  # noqa: B905  (equal by construction, and faster)

    def read() -> dict[str, Value]:
        transfer()
        numbers = unpack(memory)
        if is_integer_boolean:
            numbers = [number != 0 for number in numbers]
        values: dict[str, Value] = dict(zip(names, numbers, strict=True))
        for name, source in sources:
            values[name] = source.astype(dtype)
        return values

    name = names[0] if names else ""

    def read_one() -> dict[str, Value]:
        if not calls.is_usable:
            calls.refuse(transfer.name)
        if status := call():
            calls.check(transfer.name, status)
        return {name: memory[0]}

    if sources or is_integer_boolean:
        return read
    return read_one if len(names) == 1 else read_scalars


def _pointer_reader(transfer: Transfer) -> Read:
    """Return the reader of texts or binaries; what the FMU points at is copied at once."""
    buffer = transfer.buffer
    block, values, sizes = buffer.block, buffer.values, buffer.sizes

    def read() -> dict[str, Value]:
        transfer()
        if sizes is None:
            found: list[Any] = [(text or b"").decode(errors="replace") for text in values]
        else:
            found = [
                ctypes.string_at(pointer, size) if pointer else b""
                for pointer, size in zip(values, sizes, strict=True)
            ]
        made: dict[str, Value] = {
            one.name: value for one, value in zip(block.scalars, found, strict=False)
        }
        for one, at in zip(block.arrays, block.starts.values(), strict=True):
            part = found[at : at + one.size]
            array = np.array(part) if sizes is None else _objects(part)
            made[one.name] = array.reshape(one.shape)
        return made

    return read


def _objects(values: Sequence[bytes]) -> NDArray[Any]:
    """Return bytes as an array: numpy's own byte strings lose zeros at the end."""
    array = np.empty(len(values), object)
    array[:] = values
    return array


def _flat(buffer: Buffer, values: Mapping[str, Value]) -> list[Any]:
    """Return the values of a block one after the other."""
    found: list[Any] = [values[one.name] for one in buffer.block.scalars]
    for one in buffer.block.arrays:
        array = np.asarray(values[one.name])
        if array.shape != one.shape:
            raise ValueError(f"{one.name}: wrong shape, got {array.shape}, expected {one.shape}")
        found += array.ravel().tolist()
    return found


def _texts(buffer: Buffer, values: Mapping[str, Value]) -> object:
    """Point at texts; return what must be kept until the call is over."""
    found = [text.encode() for text in _flat(buffer, values)]
    for text in found:
        if b"\0" in text:
            raise ValueError(f"text with a null character, got {text.decode()!r}")
    buffer.values[:] = found
    return found


def _binaries(buffer: Buffer, values: Mapping[str, Value]) -> object:
    """Point at binaries; return what must be kept until the call is over."""
    kept = [ctypes.create_string_buffer(one, max(1, len(one))) for one in _flat(buffer, values)]
    assert buffer.sizes is not None
    buffer.sizes[:] = [len(one) for one in _flat(buffer, values)]
    buffer.values[:] = [ctypes.addressof(one) for one in kept]
    return kept


def _tuple_of(names: Sequence[str]) -> Callable[[Mapping[str, Value]], Any]:
    """Return what picks one value or none, as ``itemgetter`` picks several."""
    if not names:
        return lambda _: ()
    (name,) = names
    return lambda values: (values[name],)
