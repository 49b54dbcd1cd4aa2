"""What an FMU says goes to the standard library's logging, under its component's name."""

import ctypes
import logging
from itertools import count
from typing import Any

LEVELS = (logging.INFO, logging.WARNING, logging.WARNING, logging.ERROR, logging.CRITICAL)
_numbers = count(1)
_logs: "dict[int, Log]" = {}


class Log:
    """The log of one instance; ``number`` is the environment that the FMU's callbacks hand back.

    Attributes
    ----------
    last : str
        The newest message, which usually says why a call was refused.
    """

    def __init__(self, name: str) -> None:
        self.number = next(_numbers)
        self.logger = logging.getLogger(f"hedgehop.component.{name}")
        self.last = ""
        _logs[self.number] = self

    def take(self, status: int, category: bytes | None, message: bytes | None) -> None:
        """Pass a message on."""
        text = " ".join((message or b"").decode(errors="replace").split())
        self.last = text
        prefix = f"[{category.decode(errors='replace')}] " if category else ""
        level = LEVELS[status] if 0 <= status < len(LEVELS) else logging.INFO
        self.logger.log(level, "%s%s", prefix, text)

    def close(self) -> None:
        """Hear nothing more."""
        _logs.pop(self.number, None)


def _hear(number: int | None, status: int, category: bytes | None, message: bytes | None) -> None:
    log = _logs.get(number or 0)
    if log is not None:
        log.take(status, category, message)


def _hear2(
    number: int | None, _: bytes | None, status: int, category: bytes | None, message: bytes | None
) -> None:
    _hear(number, status, category, message)


LOG_MESSAGE3 = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p
)(_hear)


def callbacks2(log: Log) -> Any:
    """Return FMI 2's callbacks.

    Its logger takes arguments as ``printf`` does, which Python cannot: FMPy's library formats them.
    That library has one listener per process, so this one sorts by environment, and is made the
    listener anew for every instance in case somebody else has taken its place.
    """
    import fmpy
    from fmpy import fmi2
    from fmpy.logging import addLoggerProxy

    global _logger2  # noqa: PLW0603  (C holds a pointer to it for good)
    if _logger2 is None:
        _logger2 = fmi2.fmi2CallbackLoggerTYPE(_hear2)
    made = fmi2.fmi2CallbackFunctions()
    made.logger = _logger2
    made.allocateMemory = ctypes.cast(fmpy.calloc, fmi2.fmi2CallbackAllocateMemoryTYPE)
    made.freeMemory = ctypes.cast(fmpy.free, fmi2.fmi2CallbackFreeMemoryTYPE)
    made.componentEnvironment = log.number
    addLoggerProxy(ctypes.byref(made))
    return made


_logger2: Any = None
