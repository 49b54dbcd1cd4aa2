"""Start a worker process, and leave nothing of it behind.

It is started afresh, not forked, and does not import the caller's ``__main__`` as
``multiprocessing`` would: a script that flies at its top level needs no guard.
"""

import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping
from typing import Any

from orchestrator.component import Value
from orchestrator.errors import ComponentDied, ComponentTimeout
from orchestrator.failure import Origin
from orchestrator.isolation.channel import Channel, packed

_BOOT = (
    "import signal, sys; [signal.signal(s, signal.SIG_IGN) for s in (signal.SIGINT, signal.SIGTERM)]; "
    "sys.path[:] = sys.argv[2:]; from orchestrator.isolation.worker import main; main(int(sys.argv[1]))"
)
_PATIENCE = 5.0  # s, for a process whose connection is closed to be gone


class Process:
    """A worker with a folder for temporary files of its own; ends with this object at the latest.

    What it is asked are the methods of :class:`orchestrator.isolation.worker.Host`. What it logs is
    logged here.

    Attributes
    ----------
    is_busy : bool
        Whether an answer is due.

    Raises
    ------
    ValueError
        Where processes cannot be connected in this way: on Windows.
    """

    def __init__(self) -> None:
        if os.name != "posix":
            raise ValueError(f"isolation: not possible here, got {os.name!r}, expected 'posix'")
        here, there = socket.socketpair()
        folder = tempfile.mkdtemp(prefix="hedgehop-")
        with there:
            self._popen = subprocess.Popen(  # noqa: S603  (this Python, our own text)
                [sys.executable, "-c", _BOOT, str(there.fileno()), *sys.path],
                stdin=subprocess.DEVNULL,
                pass_fds=[there.fileno()],
                env={**os.environ, "TMPDIR": folder},
                process_group=0,  # Ctrl-C in a terminal is for the run, which ends in order
            )
        self.is_busy = False
        self._limit_s: float | None = None
        self._channel = Channel(here)
        self._finish = weakref.finalize(self, _finish, self._popen, here, folder)

    @property
    def is_open(self) -> bool:
        """Whether it has not been closed."""
        return self._finish.alive

    def close(self) -> None:
        """Kill the process, whatever it does, and remove its folder; may be called twice."""
        self._finish()

    def limit(self, seconds: float | None) -> None:
        """Set how long every further answer may take, s; None waits for ever."""
        self._limit_s = seconds
        self._channel.limit(seconds)

    def ask(self, verb: str, *arguments: object, inputs: Mapping[str, Value] | None = None) -> Any:
        """Make a request and return its answer; see :meth:`request` and :meth:`answer`."""
        self.request(verb, *arguments, inputs=inputs)
        return self.answer()

    def request(
        self, verb: str, *arguments: object, inputs: Mapping[str, Value] | None = None
    ) -> None:
        """Tell the worker what to do, after setting inputs."""
        data = packed((inputs, verb, arguments))
        self.is_busy = True
        try:
            self._channel.write(data)
        except OSError as error:
            raise self._lost(error) from None

    def answer(self) -> Any:
        """Wait for the answer to a request.

        Raises
        ------
        ComponentDied, ComponentTimeout
            If there is none; the process is closed then.
        Exception
            What was raised over there.
        """
        while True:
            try:
                kind, content = self._channel.read()
            except (EOFError, OSError) as error:
                raise self._lost(error) from None
            if kind == "log":
                name, level, text = content
                logging.getLogger(name).log(level, "%s", text)
                continue
            self.is_busy = False
            if kind == "error":
                error, origin = content
                raise error from Origin(*origin)
            return content

    def _lost(self, error: Exception) -> Exception:
        """Close, and return what to raise."""
        if isinstance(error, TimeoutError):
            self.close()
            return ComponentTimeout(f"does not answer, expected within {self._limit_s} s")
        try:
            code = self._popen.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            code = None
        self.close()
        return ComponentDied(f"process died, {_fate(code)}")


def _fate(code: int | None) -> str:
    if code is None:
        return "its connection was closed"
    if code >= 0:
        return f"exit code {code}"
    names = {number.value: number.name for number in signal.Signals}
    return f"killed by {names.get(-code, f'signal {-code}')}"


def _finish(popen: "subprocess.Popen[bytes]", connection: socket.socket, folder: str) -> None:
    popen.kill()
    connection.close()
    popen.wait()
    shutil.rmtree(folder, ignore_errors=True)
