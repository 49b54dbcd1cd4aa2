"""A component with one variable of every kind, which fails when it is told to."""

# ruff: noqa: D102  (the methods are the contract's)

import logging
import os
import pickle
import time as clock
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated

import numpy as np

from plant.variables import Execution, Variable, model_description, parameter_variables, unknown

MODES = ("off", "on", "stuck")
WRONG = {
    "part": {"set_calls": 1.8}, "huge": {"set_calls": 2**63}, "truth": {"total": True},
    "number": {"is_flag": 1}, "digits": {"noise": "1"}, "no text": {"echo": 5},
    "truths": {"counts": np.array([True, False])}, "inexact": {"total": 2**53 + 1},
}  # fmt: skip
ANSWERS = {"answer true": True, "answer part": 0.4, "answer 7": 7, "answer none": None}


@dataclass(frozen=True)
class EverythingParameters:
    """What it does with what it is given."""

    gain: Annotated[float, "of y"] = 2.0
    channels: Annotated[int, "columns of u and y"] = 3
    label: Annotated[str, "begins the echo"] = "said"
    corners_m: Annotated[tuple[tuple[float, float], ...], "of a polygon"] = ((0.0, 1.0), (2.0, 3.5))


class Everything:
    """Continuous: y follows u at once, total integrates it, noise is random."""

    execution = Execution("continuous", 10.0)

    def __init__(self, parameters: EverythingParameters, *, latency_s: float = 0.0) -> None:
        self.parameters = parameters
        self.latency_s = latency_s
        shape = (2, parameters.channels)
        self.inputs = {
            "u": np.zeros(shape), "v": 0.0, "n": 0, "flag": False, "text": "", "mode": 0, "bias": 0.5,
        }  # fmt: skip
        self.total = 0.0
        self.rng = np.random.default_rng(0)
        self.noise = 0.0
        self.start = 0.0
        self.set_by_master = 0

    def describe(self):
        shape = (2, self.parameters.channels)
        description = model_description(
            "Everything", "one of <each> & more", [
                Variable("u", "input", "m", "what y follows", shape=shape),
                Variable("v", "input", "m", "integrated too"),
                Variable("n", "input", "1", "a number", start=0),
                Variable("flag", "input", "1", "a flag", start=False),
                Variable("text", "input", "1", 'what to do: "raise", ...', start=""),
                Variable("mode", "input", "1", "of operation", start=0, items=MODES),
                Variable("bias", "parameter", "m", "added to y", 0.5, variability="tunable"),
                Variable("y", "output", "m", "gain u + bias", shape=shape, depends_on=("u",)),
                Variable("total", "output", "m", "integral of u and v", min=-1e3, max=1e3),
                Variable("noise", "output", "1", "random"),
                Variable("counts", "output", "1", "n, twice", start=0, shape=(2,)),
                Variable("is_flag", "output", "1", "flag", start=False),
                Variable("echo", "output", "1", "text", start=""),
                Variable("state.mode", "output", "1", "mode", start=0, items=MODES),
                Variable("corner", "output", "m", "the sum of corners, latency and start"),
                Variable("set_calls", "local", "1", "how often inputs were set", start=0),
                *parameter_variables(self.parameters),
            ],
            has_state=True,
        )  # fmt: skip
        description.coSimulation.canHandleVariableCommunicationStepSize = True
        return description

    def initialize(self, *, start_time, stop_time, seed):
        if self.inputs["text"] == "refuse":
            raise ValueError("text: refused at the start")
        self.total, self.start = 0.0, start_time
        self.rng = np.random.default_rng(seed)
        self.noise = self.rng.standard_normal()

    def set(self, values):
        for name, value in values.items():
            if name not in self.inputs:
                raise unknown(name, self.inputs)
            self.inputs[name] = np.array(value) if isinstance(value, np.ndarray) else value
            expected = {"u": np.ndarray, "n": int, "flag": bool, "text": str, "mode": int}
            assert type(value) is expected.get(name, float), (name, type(value))
        self.set_by_master += 1

    def get(self, names):
        i = self.inputs
        values = {
            "y": self.parameters.gain * i["u"] + i["bias"],
            "total": self.total,
            "noise": self.noise,
            "counts": np.array([i["n"], 2 * i["n"]]),
            "is_flag": i["flag"],
            "echo": f"{self.parameters.label} {i['text']}",
            "state.mode": i["mode"],
            "corner": float(np.sum(self.parameters.corners_m)) + self.latency_s + self.start,
            "set_calls": self.set_by_master,
        }
        if i["text"] == "shape":
            values["y"] = np.zeros(5)
        values |= WRONG.get(i["text"], {})
        return {name: values[name] for name in names}

    def step(self, time, step_size):
        if self.inputs["text"] in ANSWERS:
            return ANSWERS[self.inputs["text"]]
        match self.inputs["text"]:
            case "raise":
                self.total = 1e9  # lost
                raise RuntimeError("told to\nfail")
            case "discard":
                return 2
            case "warn":
                logging.getLogger(__name__).warning("a %s", "warning")
                return 1
            case "print":
                print("on standard output", flush=True)  # noqa: T201
                os.write(1, b"and on its descriptor\n")
            case "exit":
                os._exit(7)
            case "abort":
                os.abort()
            case "hang":
                clock.sleep(60)
        self.total += step_size * (float(self.inputs["u"].sum()) + self.inputs["v"])
        self.noise = self.rng.standard_normal()
        return 0

    def terminate(self):
        pass

    def get_state(self):
        return pickle.dumps(
            (self.inputs, self.total, self.rng, self.noise, self.start, self.set_by_master)
        )

    def set_state(self, state):
        (self.inputs, self.total, self.rng, self.noise, self.start, self.set_by_master) = (
            pickle.loads(state)
        )


class Missing(Everything):
    """One whose package is not everywhere."""

    def __init__(self, parameters: EverythingParameters) -> None:
        if os.environ.get("SMALL_EXPORTS_MISSING"):
            import_module("a_package_that_nobody_has")
        super().__init__(parameters)
