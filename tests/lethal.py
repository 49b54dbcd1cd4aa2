"""A native component that kills its own process."""

# ruff: noqa: D102  (the methods are the contract's)

import os
import signal
from dataclasses import dataclass

from small_components import Pilot, PilotParameters


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


class Lethal(Pilot):
    """A pilot who is no more after 0.3 s."""

    def __init__(self, parameters: Nothing) -> None:
        super().__init__(PilotParameters())

    def step(self, time, step_size):
        if time > 0.25:
            os.kill(os.getpid(), signal.SIGKILL)
        return 0
