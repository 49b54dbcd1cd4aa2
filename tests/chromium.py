"""Headless Chromium, told what to do over a pipe: what a page logs, asks for, and draws."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

# DevTools on file descriptors 3 (in) and 4 (out); messages end with a zero byte
LAUNCHER = """
import fcntl, os, sys
read, write = (fcntl.fcntl(int(fd), fcntl.F_DUPFD, 10) for fd in sys.argv[1:3])
os.dup2(read, 3)
os.dup2(write, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--remote-debugging-pipe",
)  # fmt: skip


def browser():
    """Return the path of an installed Chromium; without one, an error says how to get it."""
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        raise RuntimeError("chromium: not installed (Debian, Ubuntu: apt-get install chromium)")
    return found


class Tab:
    """A page in a browser of its own; a context manager.

    Attributes
    ----------
    logged : list of str
        Exceptions and everything that was written to the console.
    requested : list of str
        Addresses that were asked for.
    """

    def __init__(self, profile: Path):
        self._to, self._from = os.pipe(), os.pipe()
        fds = (self._to[0], self._from[1])
        command = [sys.executable, "-c", LAUNCHER, *map(str, fds), browser()]
        flags = [*FLAGS, f"--user-data-dir={profile}", "about:blank"]
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen([*command, *flags], pass_fds=fds, stderr=quiet)
        for fd in fds:
            os.close(fd)
        self._answers = os.fdopen(self._from[0], "rb")
        self._number = 0
        self._session = None
        self.logged, self.requested = [], []

    def __enter__(self):
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *_):
        self._session = None
        self.call("Browser.close")
        self._process.wait(timeout=30)
        os.close(self._to[1])
        self._answers.close()

    def show(self, file: Path, *, width: int, scheme: str = "light"):
        """Open a page at a width in CSS pixels, in a colour scheme."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.call("Emulation.setEmulatedMedia", features=[feature])
        self.logged.clear()
        self.requested.clear()
        self.call("Page.navigate", url=file.as_uri())
        self._until("Page.loadEventFired")

    def evaluate(self, expression: str):
        """Return the value of an expression, waited for if it is a promise."""
        options = {"returnByValue": True, "awaitPromise": True}
        answer = self.call("Runtime.evaluate", expression=expression, **options)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def call(self, method: str, **parameters):
        """Return the answer to a command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to[1], json.dumps(message).encode() + b"\0")
        answer = self._until(self._number)
        assert "error" not in answer, (method, answer)
        return answer["result"]

    def _until(self, what):
        """Read messages until the answer with this number or the event of this name."""
        while True:
            message = json.loads(self._read())
            about = message.get("params", {})
            match message.get("method"):
                case "Runtime.consoleAPICalled":
                    self.logged.append(str(about["args"]))
                case "Runtime.exceptionThrown":
                    self.logged.append(str(about["exceptionDetails"]))
                case "Log.entryAdded":
                    self.logged.append(str(about["entry"]["text"]))
                case "Network.requestWillBeSent":
                    self.requested.append(about["request"]["url"])
            if what in (message.get("id"), message.get("method")):
                return message

    def _read(self):
        text = bytearray()
        while (one := self._answers.read(1)) not in (b"\0", b""):
            text += one
        assert text, "chromium: ended"
        return text
