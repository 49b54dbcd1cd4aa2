"""One instance of an FMI 2.0 co-simulation FMU."""

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from orchestrator.component import Status
from orchestrator.fmu.buffers import Buffer, Transfer
from orchestrator.fmu.calls import PENDING, Calls, Library
from orchestrator.fmu.derivatives import directional, partials
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.instance import Outcome
from orchestrator.fmu.log import Log, callbacks2
from orchestrator.fmu.state import FMI2
from orchestrator.fmu.variables import Block

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

REQUIRED = (
    "fmi2Instantiate",
    "fmi2FreeInstance",
    "fmi2SetupExperiment",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2Terminate",
    "fmi2DoStep",
)
CO_SIMULATION = 1
LAST_SUCCESSFUL_TIME, TERMINATED = 2, 3  # kinds of fmi2Get...Status


class Fmi2:
    """See :class:`orchestrator.fmu.instance.FmuInstance`.

    Raises
    ------
    FmuError
        If it cannot be instantiated.
    """

    state_functions = FMI2

    def __init__(
        self,
        library: Library,
        description: "ModelDescription",
        folder: Path,
        name: str,
        *,
        is_logging: bool,
    ) -> None:
        self._log = Log(name)
        self.calls = Calls(library, self._log)
        self._callbacks = callbacks2(self._log)  # the FMU keeps a pointer
        self._is_running = False
        made = library.function("fmi2Instantiate", ctypes.c_void_p)(
            name.encode(),
            CO_SIMULATION,
            str(description.guid).encode(),
            (folder / "resources").as_uri().encode(),
            ctypes.byref(self._callbacks),
            0,
            int(is_logging),
        )
        if not made:
            self._log.close()
            said = f", it says: {self._log.last}" if self._log.last else ""
            raise FmuError(
                f"cannot be instantiated, perhaps its binary has another GUID than its "
                f"description{said}"
            )
        self.calls.handle.value = made
        self._time, self._size = ctypes.c_double(), ctypes.c_double()
        self._no_state_set = ctypes.c_int(1)  # 0 once a state has been saved: it may be restored
        self._do_step = self.calls.bound("fmi2DoStep", self._time, self._size, self._no_state_set)

    def new_buffer(self, block: Block) -> Buffer:
        """Return memory for a block of variables."""
        return Buffer(block, is_byte_boolean=False)

    def getter(self, buffer: Buffer) -> Transfer:
        """Return the call that fills a buffer."""
        return self._transfer(f"fmi2Get{buffer.block.function}", buffer)

    def setter(self, buffer: Buffer) -> Transfer:
        """Return the call that hands a buffer over."""
        return self._transfer(f"fmi2Set{buffer.block.function}", buffer)

    def _transfer(self, name: str, buffer: Buffer) -> Transfer:
        count = ctypes.c_size_t(len(buffer.references))
        call = self.calls.bound(name, buffer.references, count, buffer.values)
        return Transfer(buffer, name, self.calls, call)

    def set_up(self, start: float, stop: float | None, tolerance: float | None) -> None:
        """Say for which time the FMU will run."""
        self.calls(
            "fmi2SetupExperiment",
            int(tolerance is not None),
            ctypes.c_double(tolerance or 0.0),
            ctypes.c_double(start),
            int(stop is not None),
            ctypes.c_double(stop or 0.0),
        )

    def enter_initialization_mode(self) -> None:
        """Begin to initialize."""
        self.calls("fmi2EnterInitializationMode")

    def exit_initialization_mode(self) -> None:
        """Make the outputs valid at the start."""
        self.calls("fmi2ExitInitializationMode")
        self._is_running = True

    def do_step(self, time: float, step_size: float) -> int:
        """Step; 0 if it is done."""
        self._time.value = time
        self._size.value = step_size
        return self._do_step()

    def outcome(self, status: int, time: float, step_size: float) -> Outcome:
        """Return how a step went; where it was refused the FMU may have gone part of the way."""
        self.calls.note(status)
        if status == PENDING:
            raise FmuError("fmi2DoStep answers Pending, asynchronous steps are not supported")
        if status != Status.DISCARD:
            return Outcome(status, time + step_size if status < Status.DISCARD else time)
        if self._asked("fmi2GetBooleanStatus", TERMINATED, ctypes.c_int(0)):
            raise FmuError("the FMU asks to end the simulation (fmi2Terminated)")
        last = self._asked("fmi2GetRealStatus", LAST_SUCCESSFUL_TIME, ctypes.c_double(time))
        return Outcome(status, min(max(time, last), time + step_size))

    def _asked(self, name: str, kind: int, answer: "ctypes.c_int | ctypes.c_double") -> float:
        """Return what the FMU says of its refusal; ``answer`` as it is where it says nothing."""
        before = answer.value
        if self.calls.library.lacks([name]):
            return before
        status = self.calls.library.function(name)(self.calls.handle, kind, ctypes.byref(answer))
        if status == Status.FATAL:
            self.calls.check(name, status)
        return answer.value if status <= Status.WARNING else before

    def allow_restoring(self) -> None:
        """Tell it in every step from now on that a state of before may be restored."""
        self._no_state_set.value = 0

    def directional(
        self,
        unknowns: tuple[int, ...],
        knowns: tuple[int, ...],
        seed: NDArray[np.float64],
        count: int,
    ) -> NDArray[np.float64]:
        """Return the change of the unknowns where the knowns change by ``seed``."""
        return directional(self.calls, 2, unknowns, knowns, seed, count)

    def partials(
        self, unknowns: Sequence[int], knowns: Sequence[int], rows: NDArray[np.float64]
    ) -> list[Callable[[], int]]:
        """Return calls made fast, one per known: each writes a row of derivatives by it."""
        return partials(self.calls, 2, unknowns, knowns, rows)

    def steps(
        self, times: NDArray[np.float64], step_size: float
    ) -> tuple[list[Callable[[], int]], Callable[[], bool]]:
        """Return steps made fast, from the times that are in the array when they are made.

        And what tells whether one of them had more to say than its status.
        """
        size = ctypes.c_double(step_size)
        do = [
            self.calls.bound("fmi2DoStep", time, size, self._no_state_set)
            for time in map(ctypes.c_double.from_buffer, times[:, None])
        ]
        return do, lambda: False

    def reset(self) -> None:
        """Go back to before ``set_up``."""
        self._is_running = False
        self.calls("fmi2Reset")

    def terminate(self) -> None:
        """End the simulation if nothing has failed, and free the instance."""
        if not self.calls.is_usable or not self.calls.handle:
            return
        try:
            if self._is_running and not self.calls.has_failed:
                self.calls("fmi2Terminate")
        finally:
            if self.calls.is_usable:
                self.calls.is_usable = False
                self.calls.library.function("fmi2FreeInstance", None)(self.calls.handle)
            self._log.close()
