"""The other process: makes a component from its plans, then does with it as it is told.

A request is ``(inputs, verb, arguments)``; inputs are set first. The answer is ``("answer", what)``
or ``("error", (exception, (traceback, call, place)))``, preceded by any number of
``("log", (name, level, text))``.
"""

import logging
import os
import pickle
import resource
import select
import shutil
import socket
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from threading import Lock, Thread
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from orchestrator.assembly.make import make
from orchestrator.assembly.plan import Plan
from orchestrator.component import Component, Instance, Restorable, Status, Value, is_status
from orchestrator.errors import CouplingError, Problem, ScenarioError
from orchestrator.failure import place
from orchestrator.isolation.channel import Channel, packed
from orchestrator.isolation.unchanged import is_new
from orchestrator.run.policies import checkpoints
from orchestrator.scenario.marks import KeyPath

CALLS = (
    "initialize",
    "set",
    "get",
    "step",
    "get_state",
    "set_state",
    "terminate",
)  # of a component
Carried = tuple[Exception, tuple[str, str, str]]  # an exception; what makes its ``Origin``
Results = tuple[Sequence[Value | None] | Carried, bytes | None]  # outputs, state


def main(number: int) -> None:
    """Serve the connection whose file descriptor is ``number`` until the parent has enough."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    connection = socket.socket(fileno=number)
    leaving = Thread(target=_leave_with_parent, args=(connection,), daemon=True)
    leaving.start()
    channel = Channel(connection)
    logger = logging.getLogger("hedgehop.component")
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    lock = Lock()
    logger.addHandler(_Sender(channel, lock))
    host = Host()
    while True:
        try:
            inputs, verb, arguments = channel.read()
        except (EOFError, OSError):
            leaving.join()  # which ends this process
            return
        call = "set"
        try:
            if inputs:
                host.component.set(inputs)
            call = verb
            answer = packed(("answer", getattr(host, verb)(*arguments)))
        except Exception as error:  # noqa: BLE001  (whatever a component raises)
            answer = packed(("error", _carried(error, host.component, call)))
        with lock:
            channel.write(answer)


class Host:
    """The component and what the parent knows of it; its methods are the verbs of requests."""

    def __init__(self) -> None:
        self.component: Component = cast(Any, None)
        self._names: tuple[str, ...] = ()
        self._arrays: list[tuple[int, str]] = []  # those of the names, and where they are
        self._keeps_state = False
        self._sent: dict[str, NDArray[Any]] = {}
        self._checkpoints: dict[int, object] = {}

    def make(self, plans: bytes, path: KeyPath, keeps_state: bool) -> tuple[object, object]:
        """Make the component and the resources it needs; return its execution and description."""
        try:
            needed: list[Plan] = pickle.loads(plans)  # noqa: S301  (of our own process)
        except (ImportError, AttributeError) as error:
            raise ValueError(f"isolation: not found in another process, {error}") from error
        self.component = make(needed)[path]
        self._keeps_state = keeps_state
        instance = Instance(str(path[1]), self.component)
        try:
            return instance.execution, instance.description
        except CouplingError as error:
            raise ScenarioError([Problem(path, str(error))]) from error

    def initialize(
        self,
        names: tuple[str, ...],
        arrays: Sequence[str],
        start_time: float,
        stop_time: float | None,
        seed: int,
    ) -> Results:
        """Initialize and return the first outputs: those called ``names``, some of them arrays."""
        self._names = names
        self._arrays = [(i, name) for i, name in enumerate(names) if name in arrays]
        self.component.initialize(start_time=start_time, stop_time=stop_time, seed=seed)
        return self.read()

    def step(self, time: float, step_size: float) -> tuple[int, Results | None]:
        """Step; outputs follow if the step counts."""
        status = self.component.step(time, step_size)
        is_good = is_status(status) and status <= Status.WARNING
        return status, self.read() if is_good else None

    def read(self) -> Results:
        """Return the outputs, None for arrays that the parent has, and the state if it is kept.

        What a component raises is returned: it is for the parent to raise when it reads.
        """
        state = cast(Restorable, self.component).get_state() if self._keeps_state else None
        try:
            values = self.component.get(self._names)
            found = [values[name] for name in self._names]
        except Exception as error:  # noqa: BLE001
            return _carried(error, self.component, "get"), state
        for i, name in self._arrays:
            value = found[i]
            if isinstance(value, np.ndarray) and not is_new(self._sent, name, value):
                found[i] = cast(Any, None)
        return found, state

    def set(self, values: Mapping[str, Value]) -> None:
        """Set what is not an input."""
        self.component.set(values)

    def get(self, names: Sequence[str]) -> dict[str, Value]:
        """Return what is not an output."""
        return self.component.get(names)

    def get_state(self) -> bytes:
        """Return the state."""
        return cast(Restorable, self.component).get_state()

    def set_state(self, state: bytes) -> None:
        """Go back to a state."""
        cast(Restorable, self.component).set_state(state)

    def snapshot(self) -> int:
        """Keep the state here under a number."""
        number = len(self._checkpoints)
        self._checkpoints[number] = checkpoints(self.component)[0]()
        return number

    def rewind(self, number: int) -> None:
        """Go back to what was kept."""
        checkpoints(self.component)[1](self._checkpoints[number])

    def release(self, number: int) -> None:
        """Forget what was kept."""
        checkpoints(self.component)[2](self._checkpoints.pop(number))

    def call(self, function: Callable[..., Any], *arguments: object) -> object:
        """Return what a function that can be pickled returns here."""
        return function(*arguments)

    def terminate(self) -> None:
        """Terminate the component."""
        self.component.terminate()


class _Sender(logging.Handler):
    """Passes log records on at once: a crash may follow. They may come from any thread."""

    def __init__(self, channel: Channel, lock: Lock) -> None:
        super().__init__()
        self._channel = channel
        self._writing = lock

    def emit(self, record: logging.LogRecord) -> None:
        data = packed(("log", (record.name, record.levelno, record.getMessage())))
        with self._writing:
            self._channel.write(data)


def _carried(error: Exception, component: object, verb: str) -> Carried:
    """Return an exception that can be pickled, and how it came about."""
    call = verb if verb in CALLS else ""
    text = "".join(traceback.format_exception(error))
    origin = text, call, place(error, getattr(component, call, None) if call else None)
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301
    except Exception:  # noqa: BLE001  (of the exception's own making)
        error = RuntimeError(f"{type(error).__name__}: {error}")
    return error, origin


def _leave_with_parent(connection: socket.socket) -> None:
    """End this process, whatever it does, when the other side of the connection is gone."""
    waiting = select.poll()
    waiting.register(connection, 0)  # hanging up is always reported
    waiting.poll()
    shutil.rmtree(tempfile.gettempdir(), ignore_errors=True)  # this process's own, see process.py
    os._exit(1)
