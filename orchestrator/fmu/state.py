"""FMU states: saved in the FMU's memory, and as bytes. FMI 2 and 3 differ in spelling only."""

import ctypes
from dataclasses import dataclass

from orchestrator.fmu.calls import Calls


@dataclass(frozen=True)
class StateFunctions:
    """Names of the functions."""

    get: str
    set: str
    free: str
    size: str
    serialize: str
    deserialize: str

    @property
    def in_memory(self) -> tuple[str, ...]:
        """What ``canGetAndSetFMUstate`` promises."""
        return (self.get, self.set, self.free)

    @property
    def as_bytes(self) -> tuple[str, ...]:
        """What ``canSerializeFMUstate`` promises beyond."""
        return (self.size, self.serialize, self.deserialize)


FMI2 = StateFunctions(
    "fmi2GetFMUstate",
    "fmi2SetFMUstate",
    "fmi2FreeFMUstate",
    "fmi2SerializedFMUstateSize",
    "fmi2SerializeFMUstate",
    "fmi2DeSerializeFMUstate",
)
FMI3 = StateFunctions(
    "fmi3GetFMUState",
    "fmi3SetFMUState",
    "fmi3FreeFMUState",
    "fmi3SerializedFMUStateSize",
    "fmi3SerializeFMUState",
    "fmi3DeserializeFMUState",
)


def save(calls: Calls, names: StateFunctions) -> ctypes.c_void_p:
    """Return the present state, in the FMU's memory; to be released."""
    state = ctypes.c_void_p()
    calls(names.get, ctypes.byref(state))
    return state


def restore(calls: Calls, names: StateFunctions, state: ctypes.c_void_p) -> None:
    """Go back to a state, also after an Error."""
    calls(names.set, state)
    calls.has_failed = False


def release(calls: Calls, names: StateFunctions, state: ctypes.c_void_p) -> None:
    """Free the memory of a state; does nothing twice."""
    if state and calls.is_usable:
        calls(names.free, ctypes.byref(state))
    state.value = None


def to_bytes(calls: Calls, names: StateFunctions) -> bytes:
    """Return the present state as bytes."""
    state = save(calls, names)
    try:
        size = ctypes.c_size_t()
        calls(names.size, state, ctypes.byref(size))
        memory = ctypes.create_string_buffer(max(1, size.value))
        calls(names.serialize, state, memory, size)
        return memory.raw[: size.value]
    finally:
        release(calls, names, state)


def from_bytes(calls: Calls, names: StateFunctions, data: bytes) -> None:
    """Go back to a state that was saved as bytes, of another process too."""
    state = ctypes.c_void_p()
    memory = ctypes.create_string_buffer(data, max(1, len(data)))
    calls(names.deserialize, memory, ctypes.c_size_t(len(data)), ctypes.byref(state))
    try:
        restore(calls, names, state)
    finally:
        release(calls, names, state)
