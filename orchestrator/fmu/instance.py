"""What FMI 2 and FMI 3 instances have in common, as the component and others see them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from orchestrator.fmu.buffers import Buffer, Transfer
from orchestrator.fmu.calls import Calls
from orchestrator.fmu.state import StateFunctions
from orchestrator.fmu.variables import Block

LOOK = -1  # a step whose outcome must be looked at


@dataclass(frozen=True)
class Outcome:
    """How a step went that was not plainly done.

    Attributes
    ----------
    status : int
        FMI status.
    reached : float
        Time to which the FMU has advanced, s.
    needs_event : bool
        Events must be handled before the next step.
    """

    status: int
    reached: float
    needs_event: bool = False


class FmuInstance(Protocol):
    """One instance, driven call by call. All calls raise ``FmuError`` where the FMU refuses.

    In this order: ``set_up``, start values, ``enter_initialization_mode``, inputs,
    ``exit_initialization_mode``, then steps.
    """

    @property
    def calls(self) -> Calls:
        """The C functions."""
        ...

    @property
    def state_functions(self) -> StateFunctions:
        """For :mod:`orchestrator.fmu.state`."""
        ...

    def new_buffer(self, block: Block) -> Buffer:
        """Return memory for a block of variables."""
        ...

    def getter(self, buffer: Buffer) -> Transfer:
        """Return the call that fills a buffer."""
        ...

    def setter(self, buffer: Buffer) -> Transfer:
        """Return the call that hands a buffer over."""
        ...

    def set_up(self, start: float, stop: float | None, tolerance: float | None) -> None:
        """Say for which time the FMU will run; before start values are set."""
        ...

    def enter_initialization_mode(self) -> None:
        """Begin to initialize."""
        ...

    def exit_initialization_mode(self) -> None:
        """Make the outputs valid at the start; FMI 3 with events goes on in event mode."""
        ...

    def do_step(self, time: float, step_size: float) -> int:
        """Step; 0 if that is all there is to say, else ask for the ``outcome``."""
        ...

    def outcome(self, status: int, time: float, step_size: float) -> Outcome:
        """Return how the step went that answered ``status``.

        Raises
        ------
        FmuError
            If the FMU asks to end the simulation.
        """
        ...

    def allow_restoring(self) -> None:
        """Tell it in every step from now on that a state of before may be restored."""
        ...

    def directional(
        self,
        unknowns: tuple[int, ...],
        knowns: tuple[int, ...],
        seed: NDArray[np.float64],
        count: int,
    ) -> NDArray[np.float64]:
        """Return the change of ``count`` unknown values where the knowns change by ``seed``."""
        ...

    def partials(
        self, unknowns: Sequence[int], knowns: Sequence[int], rows: NDArray[np.float64]
    ) -> list[Callable[[], int]]:
        """Return calls made fast, one per known: each writes a row of derivatives by it."""
        ...

    def steps(
        self, times: NDArray[np.float64], step_size: float
    ) -> tuple[list[Callable[[], int]], Callable[[], bool]]:
        """Return steps made fast, from the times that are in the array when they are made.

        And what tells whether one of them had more to say than its status.
        """
        ...

    def reset(self) -> None:
        """Go back to before ``set_up``."""
        ...

    def terminate(self) -> None:
        """End the simulation, if it may be ended; and free the instance."""
        ...


def pointer(values: Any, c_type: Any) -> Any:
    """Return values as a ctypes array."""
    return (c_type * len(values))(*values)
