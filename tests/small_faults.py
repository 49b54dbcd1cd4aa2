"""Components that fail in every way a process can: see what becomes of them in one of their own."""

# ruff: noqa: D102  (the methods are the contract's)

import logging
import os
import pickle
import signal
import sys
import tempfile
import time as clock
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from plant.variables import Execution, Variable, model_description, parameter_variables, unknown


@dataclass(frozen=True)
class FaultParameters:
    """What happens, and when."""

    fault: Annotated[str, "one of FAULTS, or nothing"] = ""
    at_s: Annotated[float, "in the step from this time on"] = 0.5
    marker: Annotated[str, "file; it happens only while this is not there, and makes it"] = ""
    gain: Annotated[float, "output per step and input"] = 1.0


class NotPicklable(Exception):  # noqa: N818
    """Cannot be made again from its arguments."""

    def __init__(self, *, what) -> None:
        super().__init__(what)


def fatal_error():
    os.kill(os.getpid(), signal.SIGSEGV)


def raise_error():
    raise NotPicklable(what="beyond words")


FAULTS = {
    "exit": lambda: os._exit(3),
    "sys.exit": lambda: sys.exit(4),
    "crash": fatal_error,
    "hang": lambda: clock.sleep(1000),
    "raise": raise_error,
    "error": lambda: 3,
    "fatal": lambda: 4,
}


class Counter:
    """Adds ``gain * u`` to y in every step, keeps a big ring, and fails as it is told."""

    execution = Execution("continuous", 20.0)
    name = "c"

    def __init__(self, parameters: FaultParameters, *, instance_name: str = "c") -> None:
        self.parameters = parameters
        self.log = logging.getLogger(f"hedgehop.component.{instance_name}")
        if parameters.fault == "refuse":
            raise ValueError("fault: impossible, got 'refuse', expected another")
        if parameters.fault == "crash at once":
            fatal_error()
        self.values = {"u": 1.0, "samples": np.zeros(3), "gain": parameters.gain}
        self.y, self.steps, self.pid, self.folder = 0.0, 0, os.getpid(), tempfile.mkdtemp()
        self.ring = self._ring()

    def _ring(self):
        ring = np.full(2000, float(self.steps))
        ring.flags.writeable = False
        return ring

    def describe(self):
        rows = [
            Variable("u", "input", "1", "summed", start=1.0),
            Variable("samples", "input", "1", "summed too", shape=(3,)),
            Variable("y", "output", "1", "sum", max=1e6),
            Variable(
                "ring", "output", "1", "a step's number, renewed in every fifth", shape=(2000,)
            ),
            Variable("pid", "output", "1", "of the process", start=0),
            Variable("temporary", "output", "1", "folder", start=""),
            *parameter_variables(self.parameters, tunable=["gain"]),
        ]
        return model_description("Counter", "counts", rows, has_state=True)

    def initialize(self, *, start_time, stop_time, seed):
        if self.parameters.fault == "hang at first":
            clock.sleep(1000)

    def set(self, values):
        for name in values:
            if name not in self.values:
                raise unknown(name, self.values)
        if values.get("gain", 0.0) < 0.0:
            raise ValueError(f"gain: negative, got {values['gain']}, expected 0 or more")
        self.values |= {n: np.copy(v) if np.ndim(v) else v for n, v in values.items()}

    def get(self, names):
        if self.parameters.fault == "raise in get" and self._is_due(self.steps / 20):
            raise_error()
        known = {
            "y": self.y, "ring": self.ring, "pid": self.pid, "temporary": self.folder,
        }  # fmt: skip
        for name in names:
            if name not in known:
                raise unknown(name, known)
        return {name: known[name] for name in names}

    def step(self, time, step_size):
        if self.parameters.fault in FAULTS and self._is_due(time):
            self.log.warning("about to %s", self.parameters.fault)
            return FAULTS[self.parameters.fault]()
        self.steps += 1
        self.y += self.values["gain"] * (self.values["u"] + float(self.values["samples"].sum()))
        if self.steps % 5 == 0:
            self.ring = self._ring()
        return 0

    def _is_due(self, time):
        marker = self.parameters.marker and Path(self.parameters.marker)
        if time < self.parameters.at_s or (marker and marker.exists()):
            return False
        if marker:
            marker.touch()
        return True

    def terminate(self):
        if self.parameters.fault == "hang at last":
            clock.sleep(1000)

    def get_state(self):
        return pickle.dumps((self.y, self.steps, self.ring))

    def set_state(self, state):
        self.y, self.steps, ring = pickle.loads(state)
        ring.flags.writeable = False
        self.ring = ring
