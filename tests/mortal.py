"""A glider that takes its process along, half a minute into the flight."""

# ruff: noqa: D102  (the methods are the contract's)

import os
import signal

from small_components import Glider


class Mortal(Glider):
    """A glider whose process is killed at t = 30 s."""

    def step(self, time, step_size):
        if time >= 30.0:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(time, step_size)
