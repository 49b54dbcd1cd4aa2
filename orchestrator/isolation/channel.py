"""Messages between two processes: pickled, each preceded by its length, over a socket.

``multiprocessing.Pipe`` takes three times as long for a small message.
"""

import pickle
import socket
from struct import Struct, pack
from typing import Any

_CHUNK = 1 << 16
_LENGTH = 8  # bytes of this:
_pack, _length = Struct("<Q").pack, Struct("<Q").unpack_from


def packed(message: object) -> bytes:
    """Return a message as it is sent; whatever cannot be pickled raises here, before anything is.

    >>> packed(None)[:8].hex()
    '0400000000000000'
    """
    data = pickle.dumps(message, 5)
    return _pack(len(data)) + data


class Channel:
    """One end of a connection."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._rest = b""  # received, but behind the last message

    def write(self, data: bytes) -> None:
        """Send what ``packed`` made.

        Raises
        ------
        TimeoutError
            If the other side takes nothing for as long as ``limit`` allows.
        OSError
            If the other side is gone.
        """
        try:
            self._socket.sendall(data)
        except BlockingIOError:
            raise TimeoutError from None

    def read(self) -> Any:
        """Return the next message.

        Raises
        ------
        TimeoutError
            If nothing comes for as long as ``limit`` allows.
        EOFError, OSError
            If the other side is gone.
        """
        data = self._rest or self._receive(_CHUNK)
        if len(data) < _LENGTH or len(data) - _LENGTH != _length(data)[0]:
            data = self._whole(data)
        else:  # as nearly always
            self._rest = b""
        return pickle.loads(data[_LENGTH:])  # noqa: S301  (of our own process)

    def _whole(self, data: bytes) -> bytes:
        """Return exactly the message that ``data`` begins; keep what follows it."""
        while len(data) < _LENGTH:
            data += self._receive(_CHUNK)
        end = _LENGTH + _length(data)[0]
        parts, missing = [data], end - len(data)
        while missing > 0:
            parts.append(self._receive(missing))
            missing -= len(parts[-1])
        data = b"".join(parts)
        self._rest = data[end:]
        return data[:end]

    def limit(self, seconds: float | None) -> None:
        """Set how long to wait for the other side, s; None waits for ever.

        The kernel keeps this limit: Python's own costs a system call more per message.
        """
        whole, part = divmod(round((seconds or 0.0) * 1e6), 1_000_000)
        limit = pack("@ll", whole, part)  # struct timeval; zero means none
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)

    def _receive(self, most: int) -> bytes:
        try:
            data = self._socket.recv(most)
        except BlockingIOError:
            raise TimeoutError from None
        if not data:
            raise EOFError
        return data
