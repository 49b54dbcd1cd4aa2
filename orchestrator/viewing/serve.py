"""Serve a recording and its layout to viewers in a browser, on this machine only.

They read pieces of the file by range requests, from pages of other origins.
"""

import re
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast
from urllib.parse import quote, unquote, urlsplit

HOST = "127.0.0.1"
PIECE = 1 << 16  # bytes
EXPOSED = "Content-Length, Content-Range, Accept-Ranges"
_RANGE = re.compile(r"bytes=(\d*)-(\d*)", re.ASCII)


class File(NamedTuple):
    """What is served under a name: content, or the file that holds it."""

    media_type: str
    content: bytes | Path


class _Handler(BaseHTTPRequestHandler):
    """Answers GET, HEAD and OPTIONS; everything else is refused."""

    protocol_version = "HTTP/1.1"

    def do_OPTIONS(self) -> None:
        self._begin(HTTPStatus.NO_CONTENT, {"Access-Control-Max-Age": "86400"}, 0)

    def do_HEAD(self) -> None:
        self._answer(is_head=True)

    def do_GET(self) -> None:
        self._answer(is_head=False)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Say nothing: the terminal shows addresses, not requests."""

    def _answer(self, *, is_head: bool) -> None:
        files = cast("Server", self.server).files
        file = files.get(unquote(urlsplit(self.path).path).removeprefix("/"))
        if file is None:
            self._begin(HTTPStatus.NOT_FOUND, {}, 0)
            return
        with opened(file.content) as stream:
            size = stream.seek(0, 2)
            part = span(self.headers.get("Range"), size)
            if part is None:
                what = {"Content-Range": f"bytes */{size}"}
                self._begin(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, what, 0)
                return
            headers = {"Content-Type": file.media_type, "Accept-Ranges": "bytes"}
            status = HTTPStatus.OK
            if len(part) < size or "Range" in self.headers:
                status = HTTPStatus.PARTIAL_CONTENT
                headers["Content-Range"] = f"bytes {part.start}-{part.stop - 1}/{size}"
            self._begin(status, headers, len(part))
            if not is_head:
                stream.seek(part.start)
                for start in range(part.start, part.stop, PIECE):
                    self.wfile.write(stream.read(min(PIECE, part.stop - start)))

    def _begin(self, status: HTTPStatus, headers: Mapping[str, str], length: int) -> None:
        self.send_response(status)
        allowed = {
            "Access-Control-Allow-Origin": "*",
            "Access-Control-Allow-Methods": "GET, HEAD, OPTIONS",
            "Access-Control-Allow-Headers": "Range, If-Range, Content-Type",
            "Access-Control-Expose-Headers": EXPOSED,
            # a page from the network may read this machine's loopback, where browsers ask
            "Access-Control-Allow-Private-Network": "true",
            "Content-Length": f"{length}",
        }
        for name, value in {**allowed, **headers}.items():
            self.send_header(name, value)
        self.end_headers()


def span(asked: str | None, size: int) -> range | None:
    """Return which bytes of a file a Range header asks for; None if there are none.

    Several ranges at once, or another unit, are answered with the whole file, as one may.
    """
    match = _RANGE.fullmatch(asked.strip()) if asked is not None else None
    if match is None or match.group(1) == match.group(2) == "":
        return range(size)
    first, last = match.groups()
    start = int(first) if first else max(size - int(last), 0)
    stop = min(int(last) + 1, size) if first and last else size
    return range(start, stop) if start < stop else None


def opened(content: bytes | Path) -> BinaryIO:
    """Return a stream of bytes, or of a file."""
    return BytesIO(content) if isinstance(content, bytes) else content.open("rb")


class Server(ThreadingHTTPServer):
    """A server of a few named files, on loopback; runs in ``serve_forever``.

    Raises
    ------
    OSError
        If the port is taken; 0 takes any. The message names it.
    """

    daemon_threads = True

    def __init__(self, files: Mapping[str, File], port: int = 0) -> None:
        self.files = dict(files)
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise OSError(f"port {port}: cannot be listened on, {error.strerror}") from error

    def address(self, name: str) -> str:
        """Return the address of a file."""
        return f"http://{HOST}:{self.server_port}/{quote(name)}"

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing: viewers break off what they no longer need."""
