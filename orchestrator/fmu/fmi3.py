"""One instance of an FMI 3.0 FMU: co-simulation, with or without events, or scheduled execution."""

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.component import Status
from orchestrator.fmu.buffers import Buffer, Transfer
from orchestrator.fmu.calls import Calls, Library
from orchestrator.fmu.derivatives import directional, partials
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.instance import LOOK, Outcome, pointer
from orchestrator.fmu.log import LOG_MESSAGE3, Log
from orchestrator.fmu.state import FMI3
from orchestrator.fmu.variables import Block

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

REQUIRED = (
    "fmi3FreeInstance",
    "fmi3EnterInitializationMode",
    "fmi3ExitInitializationMode",
    "fmi3Terminate",
)
CO_SIMULATION = ("fmi3InstantiateCoSimulation", "fmi3DoStep")
EVENTS = ("fmi3EnterEventMode", "fmi3UpdateDiscreteStates", "fmi3EnterStepMode")
SCHEDULED = ("fmi3InstantiateScheduledExecution", "fmi3ActivateModelPartition")
MOST_ITERATIONS = 1000  # of discrete states at one instant
NOT_YET_KNOWN = 0  # an interval
QUIET = b"\0\0\0"  # neither event, nor end, nor early return

_CLOCK_UPDATE = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_LOCK = ctypes.CFUNCTYPE(None)
# intervals are asked for after every activation, and nothing preempts
_NOTHING1, _NOTHING0 = _CLOCK_UPDATE(lambda *_: None), _LOCK(lambda: None)


class Fmi3:
    """See :class:`orchestrator.fmu.instance.FmuInstance`.

    Parameters
    ----------
    has_events : bool
        Whether to handle its events in event mode.
    is_scheduled : bool
        Whether to make it for scheduled execution.

    Raises
    ------
    FmuError
        If it cannot be instantiated.
    """

    state_functions = FMI3

    def __init__(
        self,
        library: Library,
        description: "ModelDescription",
        folder: Path,
        name: str,
        *,
        is_logging: bool,
        has_events: bool = False,
        is_scheduled: bool = False,
    ) -> None:
        self._log = Log(name)
        self.calls = Calls(library, self._log)
        self.has_events = has_events
        self._is_running = False
        self._interval = (0.0, None, None)
        self.next_event = float("inf")  # s, where the FMU wants to stop for an event of its own
        first = (
            name.encode(),
            str(description.instantiationToken).encode(),
            f"{folder / 'resources'}/".encode(),
            ctypes.c_bool(False),
            ctypes.c_bool(is_logging),
        )
        log = (ctypes.c_void_p(self._log.number), LOG_MESSAGE3)
        if is_scheduled:
            function = "fmi3InstantiateScheduledExecution"
            last: tuple[Any, ...] = (*log, _NOTHING1, _NOTHING0, _NOTHING0)
        else:
            function = "fmi3InstantiateCoSimulation"
            flags = (ctypes.c_bool(has_events), ctypes.c_bool(True))  # early return is allowed
            last = (*flags, None, ctypes.c_size_t(0), *log, None)
        made = library.function(function, ctypes.c_void_p)(*first, *last)
        if not made:
            self._log.close()
            said = f", it says: {self._log.last}" if self._log.last else ""
            raise FmuError(
                "cannot be instantiated, perhaps its binary has another instantiation token than "
                f"its description{said}"
            )
        self.calls.handle.value = made
        self._time, self._size = ctypes.c_double(), ctypes.c_double()
        self._flags = ctypes.create_string_buffer(3)  # event, terminate, early return
        self._last = ctypes.c_double()
        self._status = 0
        self._no_state_set = ctypes.c_bool(True)  # False once a state has been saved
        if not is_scheduled:
            self._do_step = self.calls.bound(
                "fmi3DoStep",
                self._time,
                self._size,
                self._no_state_set,
                *(ctypes.c_void_p(ctypes.addressof(self._flags) + i) for i in range(3)),
                ctypes.byref(self._last),
            )

    def new_buffer(self, block: Block) -> Buffer:
        """Return memory for a block of variables."""
        return Buffer(block, is_byte_boolean=True)

    def getter(self, buffer: Buffer) -> Transfer:
        """Return the call that fills a buffer."""
        return self._transfer(f"fmi3Get{buffer.block.function}", buffer)

    def setter(self, buffer: Buffer) -> Transfer:
        """Return the call that hands a buffer over."""
        return self._transfer(f"fmi3Set{buffer.block.function}", buffer)

    def _transfer(self, name: str, buffer: Buffer) -> Transfer:
        references = (buffer.references, ctypes.c_size_t(len(buffer.references)))
        sizes = () if buffer.sizes is None else (buffer.sizes,)
        count = ctypes.c_size_t(len(buffer.values))
        call = self.calls.bound(name, *references, *sizes, buffer.values, count)
        return Transfer(buffer, name, self.calls, call)

    def set_up(self, start: float, stop: float | None, tolerance: float | None) -> None:
        """Say for which time the FMU will run."""
        self._interval = (start, stop, tolerance)

    def enter_initialization_mode(self) -> None:
        """Begin to initialize."""
        start, stop, tolerance = self._interval
        self.calls(
            "fmi3EnterInitializationMode",
            ctypes.c_bool(tolerance is not None),
            ctypes.c_double(tolerance or 0.0),
            ctypes.c_double(start),
            ctypes.c_bool(stop is not None),
            ctypes.c_double(stop or 0.0),
        )

    def exit_initialization_mode(self) -> None:
        """Make the outputs valid at the start; with events, event mode follows."""
        self.calls("fmi3ExitInitializationMode")
        self._is_running = True

    def enter_event_mode(self) -> None:
        """Begin to handle events."""
        self.calls("fmi3EnterEventMode")

    def update_discrete_states(self) -> None:
        """Iterate the discrete states until they are settled.

        Raises
        ------
        FmuError
            If they do not settle, or the FMU asks to end the simulation.
        """
        flags = ctypes.create_string_buffer(5)  # more, terminate, nominals, states, next event
        when = ctypes.c_double()
        arguments = [ctypes.c_void_p(ctypes.addressof(flags) + i) for i in range(5)]
        for _ in range(MOST_ITERATIONS):
            self.calls("fmi3UpdateDiscreteStates", *arguments, ctypes.byref(when))
            more, ends, _, _, has_next = flags.raw
            if ends:
                raise FmuError("the FMU asks to end the simulation (terminateSimulation)")
            if not more:
                self.next_event = when.value if has_next else float("inf")
                return
        raise FmuError(f"events do not settle, got {MOST_ITERATIONS} updates of discrete states")

    def enter_step_mode(self) -> None:
        """Go on to step."""
        self.calls("fmi3EnterStepMode")

    def tick(self, clocks: Sequence[int]) -> None:
        """Activate clocks, in event mode."""
        ticks = (ctypes.c_bool * len(clocks))(*[True] * len(clocks))
        references = pointer(clocks, ctypes.c_uint)
        self.calls("fmi3SetClock", references, ctypes.c_size_t(len(clocks)), ticks)

    def interval(self, clock: int) -> float | None:
        """Return what the FMU says of a clock's interval, s; None where it is not known yet."""
        interval, qualifier = ctypes.c_double(), ctypes.c_int(NOT_YET_KNOWN)
        self.calls(
            "fmi3GetIntervalDecimal",
            ctypes.byref(ctypes.c_uint(clock)),
            ctypes.c_size_t(1),
            ctypes.byref(interval),
            ctypes.byref(qualifier),
        )
        return None if qualifier.value == NOT_YET_KNOWN else interval.value

    def activate(self, clock: int, time: float) -> None:
        """Run the model partition of a clock, in scheduled execution."""
        self.calls("fmi3ActivateModelPartition", ctypes.c_uint(clock), ctypes.c_double(time))

    def do_step(self, time: float, step_size: float) -> int:
        """Step; 0 if it is done and there are no events."""
        self._time.value = self._last.value = time
        self._size.value = step_size
        status = self._do_step()
        if self._flags.raw == QUIET:
            return status
        self._status = status
        return LOOK

    def outcome(self, status: int, time: float, step_size: float) -> Outcome:
        """Return how a step went; flags are cleared, in case the FMU sets them only when true."""
        if status == LOOK:
            status = self._status
        event, end, early = self._flags.raw
        self._flags.raw = QUIET
        self.calls.note(status)
        if status > Status.WARNING:
            return Outcome(status, time)  # FMI 3: nothing has changed, and outputs mean nothing
        if end:
            raise FmuError("the FMU asks to end the simulation (terminateSimulation)")
        reached = min(max(time, self._last.value), time + step_size) if early else time + step_size
        return Outcome(status, reached, needs_event=bool(event) and self.has_events)

    def allow_restoring(self) -> None:
        """Tell it in every step from now on that a state of before may be restored."""
        self._no_state_set.value = False

    def directional(
        self,
        unknowns: tuple[int, ...],
        knowns: tuple[int, ...],
        seed: NDArray[np.float64],
        count: int,
    ) -> NDArray[np.float64]:
        """Return the change of the unknowns where the knowns change by ``seed``."""
        return directional(self.calls, 3, unknowns, knowns, seed, count)

    def partials(
        self, unknowns: Sequence[int], knowns: Sequence[int], rows: NDArray[np.float64]
    ) -> list[Callable[[], int]]:
        """Return calls made fast, one per known: each writes a row of derivatives by it."""
        return partials(self.calls, 3, unknowns, knowns, rows)

    def steps(
        self, times: NDArray[np.float64], step_size: float
    ) -> tuple[list[Callable[[], int]], Callable[[], bool]]:
        """Return steps made fast, from the times that are in the array when they are made.

        And what tells whether one of them had more to say than its status.
        """
        size, reached = ctypes.c_double(step_size), ctypes.byref(ctypes.c_double())
        flags = ctypes.create_string_buffer(len(QUIET) * len(times))
        quiet = flags.raw
        do = [
            self.calls.bound(
                "fmi3DoStep",
                time,
                size,
                self._no_state_set,
                *(ctypes.byref(flags, len(QUIET) * k + i) for i in range(len(QUIET))),
                reached,
            )
            for k, time in enumerate(map(ctypes.c_double.from_buffer, times[:, None]))
        ]

        def said() -> bool:
            had = flags.raw != quiet
            flags.raw = quiet
            return had

        return do, said

    def reset(self) -> None:
        """Go back to before ``set_up``."""
        self._is_running = False
        self.calls("fmi3Reset")

    def terminate(self) -> None:
        """End the simulation if nothing has failed, and free the instance."""
        if not self.calls.is_usable or not self.calls.handle:
            return
        try:
            if self._is_running and not self.calls.has_failed:
                self.calls("fmi3Terminate")
        finally:
            if self.calls.is_usable:
                self.calls.is_usable = False
                self.calls.library.function("fmi3FreeInstance", None)(self.calls.handle)
            self._log.close()
