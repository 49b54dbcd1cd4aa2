"""The Python inside an exported FMU: makes the component and answers its front end, call by call.

Run as a script from the FMU's resources, where it lies beside ``component.json``; it imports nothing
of Hedgehop but what the component is made of. Messages are those of ``c/process.c``.
"""

import importlib
import importlib.util
import json
import logging
import math
import os
import select
import shutil
import socket
import struct
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

INITIALIZE, STEP, OUTPUTS, GET_STATE, SET_STATE = range(1, 6)  # requests
OK, WARNING, DISCARD, ERROR, FATAL = range(5)  # FMI status
CHANNEL = 3  # file descriptor of the socket
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
MESSAGE = struct.Struct("=iIQ")
TIMES = struct.Struct("=dd")
BUFFERS = ("reals", "integers", "strings")


# -- the sources that the component is made of -----------------------------------------------------


def files_of(package: str) -> dict[str, bytes]:
    """Return the files of a top-level package or module, by path; none if it cannot be found."""
    spec = importlib.util.find_spec(package)
    if spec is None:
        return {}
    if not spec.submodule_search_locations:
        return {} if spec.origin is None else {f"{package}.py": Path(spec.origin).read_bytes()}
    folder = Path(next(iter(spec.submodule_search_locations)))
    return {
        f"{package}/{file.relative_to(folder).as_posix()}": file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and "__pycache__" not in file.parts
    }


def digest(files: Mapping[str, bytes]) -> str:
    """Return a hash of files' paths and contents."""
    found = sha256()
    for path, content in sorted(files.items()):
        found.update(f"{path}\0{len(content)}\0".encode())
        found.update(content)
    return found.hexdigest()


def _find_sources(folder: Path, packages: list[str], wanted: str) -> None:
    """Make the FMU's own sources importable, before all others.

    Where the interpreter has the very same ones installed, those are used; otherwise a copy whose
    place depends on the content alone. Compiled kernels are kept by the path of their source, and an
    FMU is unpacked to another path each time.
    """
    installed: dict[str, bytes] = {}
    for package in packages:
        installed |= files_of(package)
    if digest(installed) == wanted:
        return
    sources = folder / "python"
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hedgehop"
        kept = cache / f"fmu-{wanted[:16]}"
        if not kept.is_dir():
            cache.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=cache) as fresh:
                shutil.copytree(sources, Path(fresh) / "python")
                try:
                    (Path(fresh) / "python").rename(kept)
                except OSError:
                    if not kept.is_dir():  # else another instance was faster
                        raise
        sources = kept
    except (OSError, RuntimeError):
        pass  # no place to keep it
    sys.path.insert(0, str(sources))


# -- the component ---------------------------------------------------------------------------------


def look_up(use: str) -> Any:
    """Return what ``module:attribute`` names."""
    module, _, attribute = use.partition(":")
    found: Any = importlib.import_module(module)
    for part in attribute.split("."):
        found = getattr(found, part)
    return found


def decode(value: Any, folder: Path) -> Any:
    """Return what ``recipe.encode`` has written."""
    if isinstance(value, list):
        return [decode(one, folder) for one in value]
    if not isinstance(value, dict):
        return value
    if "$file" in value:
        return folder / value["$file"]
    if "$tuple" in value:
        return tuple(decode(one, folder) for one in value["$tuple"])
    plain = {key: decode(one, folder) for key, one in value.items() if key != "$record"}
    return look_up(value["$record"])(**plain) if "$record" in value else plain


class Variable(NamedTuple):
    """Where a variable is in the buffers, and what its values mean: see ``rows.Row``."""

    name: str
    role: str  # set, field, latency_s, seed, time, get
    buffer: str
    at: int
    shape: tuple[int, ...]
    boolean: bool

    def read(self, buffers: Mapping[str, Any]) -> Any:
        """Return the value, as the component contract has it."""
        if self.shape:
            size = 1
            for length in self.shape:
                size *= length
            values = buffers[self.buffer][self.at : self.at + size]
            return (values.astype(bool) if self.boolean else values).reshape(self.shape)
        value = buffers[self.buffer][self.at]
        if self.boolean:
            return bool(value)
        return str(value) if self.buffer == "strings" else value.item()

    def write(self, buffers: Mapping[str, Any], value: Any) -> None:
        """Put a value in its place.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        import numpy as np

        if not self.shape:
            buffers[self.buffer][self.at] = value
            return
        array = np.asarray(value)
        if array.shape != self.shape:
            raise ValueError(f"{self.name}: wrong shape, got {array.shape}, expected {self.shape}")
        buffers[self.buffer][self.at : self.at + array.size] = array.ravel()


class Buffers(NamedTuple):
    """All values by buffer, and for each variable whether the master set it since the last step."""

    values: dict[str, Any]
    changed: bytes


class Worker:
    """One component of an FMU, and how to make it anew."""

    def __init__(self, recipe: Mapping[str, Any], folder: Path, name: str) -> None:
        self.sizes: dict[str, list[int]] = recipe["sizes"]
        self.variables = [
            Variable(v["name"], v["role"], v["buffer"], v["at"], tuple(v["shape"]), v["boolean"])
            for v in recipe["variables"]
        ]
        self.outputs = [v for v in self.variables if v.role == "get"]
        self.names = [v.name for v in self.outputs]
        self.resources: dict[str, Any] = {}
        for one in recipe["resources"]:
            self.resources[one["name"]] = look_up(one["use"])(**self._arguments(one, folder))
        self.factory = look_up(recipe["component"]["use"])
        self.arguments = self._arguments(recipe["component"], folder)
        if "instance_name" in self.arguments:
            self.arguments["instance_name"] = name
        self.component: Any = self.factory(**self.arguments)
        self.state = "made"  # made, begun, failed
        self.span: tuple[float, float | None] = (0.0, None)  # start and stop time

    def _arguments(self, call: Mapping[str, Any], folder: Path) -> dict[str, Any]:
        plain = {key: decode(value, folder) for key, value in call["arguments"].items()}
        return plain | {key: self.resources[name] for key, name in call["injected"].items()}

    def initialize(self, buffers: Buffers, start: float, stop: float | None) -> None:
        """Start from nothing with these values."""
        self.span = start, stop
        self._make(buffers, usable=("made",))
        self.set(buffers)
        self._begin(buffers)

    def restore(self, buffers: Buffers, state: bytes) -> None:
        """Go on from a state; the values are those of its time."""
        start, stop = TIMES.unpack_from(state)
        self.span = start, None if math.isnan(stop) else stop
        self._make(buffers, usable=("made", "begun"))
        if self.state == "made":
            self._begin(buffers)
        self.component.set_state(state[TIMES.size :])

    def save(self) -> bytes:
        """Return everything that decides the future."""
        start, stop = self.span
        return TIMES.pack(start, math.nan if stop is None else stop) + self.component.get_state()

    def step(self, buffers: Buffers, time: float, step_size: float) -> int:
        """Advance the component with these inputs; its status."""
        self.set(buffers)
        return int(self.component.step(time, step_size))

    def get(self, buffers: Buffers) -> None:
        """Write all computed values."""
        values = self.component.get(self.names)
        for variable in self.outputs:
            variable.write(buffers.values, values[variable.name])

    def set(self, buffers: Buffers) -> None:
        """Set what the master has set since the last step."""
        values = {
            variable.name: variable.read(buffers.values)
            for variable, changed in zip(self.variables, buffers.changed, strict=True)
            if changed and variable.role == "set"
        }
        if values:
            self.component.set(values)

    def _begin(self, buffers: Buffers) -> None:
        self.state = "begun"
        start, stop = self.span
        seed = next(int(v.read(buffers.values)) for v in self.variables if v.role == "seed")
        self.component.initialize(start_time=start, stop_time=stop, seed=seed)

    def _make(self, buffers: Buffers, usable: tuple[str, ...]) -> None:
        """Make a component of the present parameters, unless there is one in a usable state."""
        arguments = dict(self.arguments)
        for variable in self.variables:
            value = (
                variable.read(buffers.values) if variable.role in ("field", "latency_s") else None
            )
            if variable.role == "latency_s":
                arguments["latency_s"] = value
            elif variable.role == "field":
                old = getattr(arguments["parameters"], variable.name)
                value = like(old, value)
                if value != old:
                    record = replace(arguments["parameters"], **{variable.name: value})
                    arguments["parameters"] = record
        if arguments == self.arguments and self.state in usable:
            return
        component = self.factory(**arguments)
        if arguments != self.arguments:
            self._check(component)
        self.component, self.arguments, self.state = component, arguments, "made"

    def _check(self, component: Any) -> None:
        """Refuse parameters that change what the FMU has described."""
        described = {
            v.name: tuple(int(size.start) for size in v.dimensions)
            for v in component.describe().modelVariables
        }
        for variable in self.variables:
            expected = variable.shape if variable.role in ("set", "get") else None
            if expected is not None and described.get(variable.name) != expected:
                raise ValueError(
                    f"{variable.name}: other shape with these parameters, got "
                    f"{described.get(variable.name)}, expected {expected} as at the export"
                )


def like(old: Any, value: Any) -> Any:
    """Return a value in the nested tuples or lists, of the numbers, that the old one has."""
    if isinstance(old, tuple | list):
        return type(old)(like(one, item) for one, item in zip(old, value, strict=True))
    return type(old)(value)


def parameters_of(record: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of a parameter dataclass's fields."""
    if is_dataclass(record):
        for field in fields(record):
            if field.init:
                yield field.name, getattr(record, field.name)


# -- the front end's calls -------------------------------------------------------------------------


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
        _find_sources(folder, recipe["packages"], recipe["digest"])
        worker = Worker(recipe, folder, name)
    except BaseException as error:  # noqa: BLE001  told by the FMI logger, never a traceback
        logs.failure(ERROR, error)
        logs.records.append((ERROR, f"the component cannot be made by {sys.executable}"))
        reply(ERROR)
        return
    reply(OK)
    while len(header := stream.read(MESSAGE.size)) == MESSAGE.size:
        what, _, size = MESSAGE.unpack(header)
        try:
            status, content = _answer(worker, what, stream.read(size))
        except BaseException as error:  # noqa: BLE001
            worker.state = "failed"  # made anew before it is used again
            logs.failure(ERROR, error)
            status, content = ERROR, b""
        try:
            reply(status, content)
        except OSError:
            break  # the host is gone
    if worker.state == "begun":
        worker.component.terminate()


def _answer(worker: Worker, what: int, content: bytes) -> tuple[int, bytes]:
    """Return the status and the content of the reply to a request."""
    if what == GET_STATE:
        return OK, worker.save()
    first = last = 0.0
    at = 0
    if what in (INITIALIZE, STEP):
        first, last = TIMES.unpack_from(content)
        at = TIMES.size
    buffers, at = _take(worker, content, at)
    status = OK
    if what == SET_STATE:
        worker.restore(buffers, content[at:])
        return OK, b""
    if what == INITIALIZE:
        worker.initialize(buffers, first, None if math.isnan(last) else last)
    elif what == STEP:
        status = worker.step(buffers, first, last)
    else:
        worker.set(buffers)
    if status > WARNING:
        return status, b""
    worker.get(buffers)
    return status, _computed(worker, buffers)


def _take(worker: Worker, content: bytes, at: int) -> tuple[Buffers, int]:
    """Return the buffers of a request, computed values not yet in them, and where they end."""
    import numpy as np

    whole: dict[str, Any] = {}
    for name, kind in (("reals", np.float64), ("integers", np.int64)):
        settable, total = worker.sizes[name]
        whole[name] = np.zeros(total, kind)
        whole[name][:settable] = np.frombuffer(content, kind, settable, at)
        at += 8 * settable
    changed = content[at : at + len(worker.variables)]
    at += len(changed)
    settable, total = worker.sizes["strings"]
    whole["strings"] = np.full(total, "", dtype=object)
    for i in range(settable):
        (length,) = struct.unpack_from("=I", content, at)
        whole["strings"][i] = content[at + 4 : at + 4 + length].decode(errors="replace")
        at += 4 + length
    return Buffers(whole, changed), at


def _computed(worker: Worker, buffers: Buffers) -> bytes:
    reals, integers, strings = (buffers.values[name][worker.sizes[name][0] :] for name in BUFFERS)
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


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
