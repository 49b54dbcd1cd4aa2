"""An FMU's C functions, bound by ctypes from its own library: FMPy's classes cost twice as much.

Arguments are prepared ctypes objects wherever a call is made at every step, and no argument types
are declared: converting plain numbers at every call would take longer than the call.
"""

import ctypes
import os
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from orchestrator.component import Status
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.log import Log

PENDING = 5  # FMI 2 only
NAMES = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")


class Library:
    """The shared library of an FMU.

    It stays loaded until the process ends: threads and exit handlers of an FMU may outlive it.

    Raises
    ------
    ValueError
        If it cannot be loaded.
    """

    def __init__(self, file: Path, name: str) -> None:
        try:
            # where Windows looks for libraries beside the FMU's own
            folder = getattr(os, "add_dll_directory", nullcontext)
            with folder(str(file.parent)):
                self._library = ctypes.CDLL(str(file))
        except OSError as error:
            text = " ".join(str(error).split()).replace(f"{file}: ", "")
            raise ValueError(f"{name}: library {file.name} cannot be loaded, {text}") from error

    def lacks(self, functions: Iterable[str]) -> list[str]:
        """Return which functions are missing."""
        return [name for name in functions if not hasattr(self._library, name)]

    def function(self, name: str, result: Any = ctypes.c_int) -> Any:
        """Return a C function, of its own so that its result type is too."""
        found = self._library[name]
        found.restype = result
        return found


class Calls:
    """The functions of one instance: every status is looked at, and none is called after Fatal.

    Attributes
    ----------
    handle : c_void_p
        The instance; null until it is made.
    is_usable : bool
        False after Fatal and once freed.
    has_failed : bool
        After Error: only freeing and restoring a state are allowed.
    """

    def __init__(self, library: Library, log: Log) -> None:
        self.library = library
        self.log = log
        self.handle = ctypes.c_void_p()
        self.is_usable = True
        self.has_failed = False
        self._functions: dict[str, Any] = {}

    def __call__(self, name: str, *arguments: Any) -> None:
        """Call a function by name.

        Raises
        ------
        FmuError
            If its status is above Warning.
        """
        if not self.is_usable:
            self.refuse(name)
        function = self._functions.get(name)
        if function is None:
            function = self._functions[name] = self.library.function(name)
        if status := function(self.handle, *arguments):
            self.check(name, status)

    def bound(self, name: str, *arguments: Any) -> Callable[[], int]:
        """Return a call with its arguments, made fast: whoever makes it looks at the status."""
        return partial(self.library.function(name), self.handle, *arguments)

    def refuse(self, name: str) -> None:
        """Raise instead of calling."""
        raise FmuError(f"{name} is not called, the FMU can be used no more", Status.FATAL)

    def note(self, status: int) -> None:
        """Remember what a status forbids from now on."""
        if status == Status.FATAL:
            self.is_usable = False
        elif status == Status.ERROR:
            self.has_failed = True

    def check(self, name: str, status: int) -> None:
        """Raise for a status above Warning; a Warning is logged."""
        self.note(status)
        label = NAMES[status] if 0 <= status < len(NAMES) else f"unknown status {status}"
        if status == Status.WARNING:
            self.log.logger.warning("%s answers Warning", name)
            return
        said = f", it says: {self.log.last}" if self.log.last else ""
        raise FmuError(f"{name} is refused ({label}){said}", status)
