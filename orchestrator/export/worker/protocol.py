"""The worker's end of the socket: requests of an FMU's front end in, replies and log records out.

Messages are those of ``c/process.c``.
"""

import json
import logging
import os
import select
import socket
import struct
import sys
import threading
from pathlib import Path
from typing import Any

from .instance import TIMES, Buffers, Instance  # noqa: TID252  in an FMU the package has another name
from .sources import find_sources  # noqa: TID252

INITIALIZE, STEP, OUTPUTS, GET_STATE, SET_STATE = range(1, 6)  # requests
OK, WARNING, DISCARD, ERROR, FATAL = range(5)  # FMI status
CHANNEL = 3  # file descriptor of the socket
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
MESSAGE = struct.Struct("=iIQ")
BUFFERS = ("reals", "integers", "strings")


class Logs(logging.Handler):
    """Log records on their way to the FMI logger."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.records: list[tuple[int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record until the next reply."""
        status = OK if record.levelno < logging.WARNING else WARNING
        self.records.append((status, record.getMessage()))

    def failure(self, status: int, error: BaseException) -> None:
        """Keep what a failure says, in one line."""
        text = error.args[0] if isinstance(error, KeyError) and error.args else error
        self.records.append((status, f"{type(error).__name__}: {' '.join(str(text).split())}"))


def main(folder: Path, name: str) -> None:
    """Make the component of the FMU in ``folder`` and answer until the socket ends."""
    for variable in THREADS:  # read when numpy is imported; sums depend on it to the last bit
        os.environ.setdefault(variable, "1")
    channel = socket.socket(fileno=CHANNEL)
    channel.set_inheritable(False)
    stream = channel.makefile("rb")
    logs = Logs()
    logging.basicConfig(level=logging.INFO, handlers=[logs])
    logging.captureWarnings(capture=True)
    _end_with(channel)

    def reply(status: int, content: bytes = b"") -> None:
        texts = [(level, text.replace("\0", " ").encode() + b"\0") for level, text in logs.records]
        logs.records.clear()
        head = b"".join(struct.pack("=iI", level, len(t)) + t for level, t in texts)
        size = len(head) + len(content)
        channel.sendall(MESSAGE.pack(status, len(texts), size) + head + content)

    try:
        recipe = json.loads((folder / "component.json").read_text())
        find_sources(folder, recipe["packages"], recipe["digest"])
        instance = Instance(recipe, folder, name)
    except BaseException as error:  # noqa: BLE001  told by the FMI logger, never a traceback
        logs.failure(ERROR, error)
        logs.records.append((ERROR, f"the component cannot be made by {sys.executable}"))
        reply(ERROR)
        return
    reply(OK)
    while len(header := stream.read(MESSAGE.size)) == MESSAGE.size:
        what, _, size = MESSAGE.unpack(header)
        try:
            status, content = _answer(instance, what, stream.read(size))
        except BaseException as error:  # noqa: BLE001
            instance.state = "failed"  # made anew before it is used again
            logs.failure(ERROR, error)
            status, content = ERROR, b""
        try:
            reply(status, content)
        except OSError:
            break  # the host is gone
    if instance.state == "begun":
        instance.component.terminate()


def _answer(instance: Instance, what: int, content: bytes) -> tuple[int, bytes]:
    """Return the status and the content of the reply to a request."""
    if what == GET_STATE:
        return OK, instance.save()
    first = last = 0.0
    at = 0
    if what in (INITIALIZE, STEP):
        first, last = TIMES.unpack_from(content)
        at = TIMES.size
    buffers, at = _take(instance, content, at)
    status = OK
    if what == SET_STATE:
        instance.restore(buffers, content[at:])
        return OK, b""
    if what == INITIALIZE:
        instance.initialize(buffers, first, last)
    elif what == STEP:
        status = instance.step(buffers, first, last)
    else:
        instance.set(buffers)
    if status > WARNING:
        return status, b""
    instance.get(buffers)
    return status, _computed(instance, buffers)


def _take(instance: Instance, content: bytes, at: int) -> tuple[Buffers, int]:
    """Return the buffers of a request, computed values not yet in them, and where they end."""
    import numpy as np

    whole: dict[str, Any] = {}
    for name, kind in (("reals", np.float64), ("integers", np.int64)):
        settable, total = instance.sizes[name]
        whole[name] = np.zeros(total, kind)
        whole[name][:settable] = np.frombuffer(content, kind, settable, at)
        at += 8 * settable
    changed = content[at : at + len(instance.variables)]
    at += len(changed)
    settable, total = instance.sizes["strings"]
    whole["strings"] = np.full(total, "", dtype=object)
    for i in range(settable):
        (length,) = struct.unpack_from("=I", content, at)
        whole["strings"][i] = content[at + 4 : at + 4 + length].decode(errors="replace")
        at += 4 + length
    return Buffers(whole, changed), at


def _computed(instance: Instance, buffers: Buffers) -> bytes:
    reals, integers, strings = (buffers.values[name][instance.sizes[name][0] :] for name in BUFFERS)
    texts = b"".join(str(text).replace("\0", " ").encode() + b"\0" for text in strings)
    return reals.tobytes() + integers.tobytes() + texts


def _end_with(channel: socket.socket) -> None:
    """End the process soon after the host closes the socket, even in the middle of a step."""
    hang_up = getattr(select, "POLLRDHUP", 0)
    if not hang_up:
        return  # the end is read after the step

    def watch() -> None:
        poll = select.poll()
        poll.register(channel, hang_up)
        while not poll.poll():
            pass
        threading.Event().wait(1.0)  # an idle component may terminate first
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
