"""Open a recording in whatever viewer there is."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import urlencode

from orchestrator.recording.reader import Recording
from orchestrator.viewing.layout import NAME, layout_json
from orchestrator.viewing.plots import recorded
from orchestrator.viewing.serve import File, Server

PAGE = ("--serve-web", "--bind", "127.0.0.1", "--port", "auto", "--web-viewer-port")
LICHTBLICK = "http://localhost:8080/"  # where its web application serves itself


def has_rerun() -> bool:
    """Tell whether Rerun is installed."""
    return find_spec("rerun") is not None


def show(recording: Recording, web_port: int | None) -> int:
    """Show a recording in Rerun until its window is closed; return the viewer's exit code.

    With a port it is a page in a browser.

    Raises
    ------
    OSError
        If the viewer cannot be started.
    ValueError
        If there is no display for a window.
    """
    if web_port is None and not _has_display():
        raise ValueError("view: no display for a window, expected one, --web or --serve")
    from orchestrator.viewing.rrd import write_rrd

    with TemporaryDirectory(prefix="hedgehop-") as folder:
        file = Path(folder) / f"{recording.path.stem}.rrd"
        write_rrd(recording, file)
        options = [] if web_port is None else [*PAGE, f"{web_port}"]
        command = [*_viewer(), *options, str(file)]
        return subprocess.run(command, check=False).returncode  # noqa: S603


def _has_display() -> bool:
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def _viewer() -> list[str]:
    beside = Path(sys.executable).with_name("rerun")
    return [str(beside)] if beside.exists() else [shutil.which("rerun") or "rerun"]


def serve(recording: Recording, port: int, say: Callable[[str], None]) -> None:
    """Serve a recording and its layout until interrupted, and say where they are."""
    name = recording.path.name
    files = {
        name: File("application/octet-stream", recording.path),
        NAME: File("application/json", layout_json(recorded(recording))),
    }
    with Server(files, port) as server:
        for line in addresses(server.address(name), server.address(NAME)):
            say(line)
        with suppress(KeyboardInterrupt):
            server.serve_forever()


def addresses(recording: str, layout: str) -> list[str]:
    """Return what to tell people who want to see what is served."""
    inner = urlencode({"ds": "remote-file", "ds.url": recording, "layoutUrl": layout})
    return [
        f"recording   {recording}",
        f"layout      {layout}",
        f"Lichtblick  {LICHTBLICK}?{inner}",
        "            (wherever else it is: its address, and the part from ? on)",
        "Foxglove    open the recording's address as a remote file, and import the layout",
        "Ctrl-C ends",
    ]
