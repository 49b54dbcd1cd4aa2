"""Measure the vehicle as C: CPU us per step of 50 ms, beside the native vehicle; and how far apart.

Both fly 10 s of ``jacksboro.yaml`` open loop, with a step of the command, again and again from the
start. A step of the FMU is what a master does by raw calls into its library: set the command, step,
get all outputs. The least of several flights; then what a directional derivative costs, and an export.
"""

import argparse
import ctypes
from os import times
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import machine
import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description

from orchestrator.assembly.make import arguments, make
from orchestrator.export.export import choose, export

SCENARIO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
PERIOD, STEPS = 0.05, 200
NUDGE = (0.03, 0.02, 0.02, 0.05)  # of the command, from 1 s on
OTHER = ("outcome", "valid", "applied")  # of the outputs, what is no float or the FMU's alone


class Raw:
    """An FMU's functions, called with buffers made once, at its start again after ``rewind``."""

    def __init__(self, file, folder):
        description = read_model_description(file)
        rows = {v.name: v.valueReference for v in description.modelVariables}
        self.commands = [n for n in rows if n.startswith("command.")]
        self.trim = np.array(
            [float(v.start) for v in description.modelVariables if v.name in self.commands]
        )
        names = [unknown.variable.name for unknown in description.outputs]
        self.outputs = [name for name in names if name.partition(".")[0] not in OTHER]
        self._known, self._unknown = ([rows[n] for n in g] for g in (self.commands, self.outputs))
        fmi = int(description.fmiVersion[0])
        self.fmu = instantiate_fmu(extract(file, folder), description, "CoSimulation")
        if fmi == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self._start = self.fmu.getFMUState()
        n, m = len(self.commands), len(self.outputs)
        self._u, self.y = (ctypes.c_double * n)(), (ctypes.c_double * m)()
        kind, sizes = ("Real", ((), ())) if fmi == 2 else ("Float64", ((n,), (m,)))
        call = self.fmu._functions  # noqa: SLF001  the only raw functions FMPy has
        self._do = call[f"fmi{fmi}DoStep"]
        self._set, self._get = call[f"fmi{fmi}Set{kind}"], call[f"fmi{fmi}Get{kind}"]
        self._inputs = ((ctypes.c_uint * n)(*self._known), n, self._u, *sizes[0])
        self._results = ((ctypes.c_uint * m)(*self._unknown), m, self.y, *sizes[1])
        flags, self._reached = [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
        self._flags = [ctypes.byref(x) for x in (*flags, self._reached)] if fmi == 3 else []

    def rewind(self):
        """Go back to the start."""
        self.fmu.setFMUState(self._start)

    def step(self, time, command):
        """Set, step and get."""
        self._u[:] = command
        instance = self.fmu.component
        status = self._set(instance, *self._inputs)
        status |= self._do(instance, time, PERIOD, 1, *self._flags)
        status |= self._get(instance, *self._results)
        if status:
            raise SystemExit(f"vehicle FMU: a call failed, status {status}")
        return self.y

    def derivative(self):
        """Return the derivative of the last step along the nudge."""
        return self.fmu.getDirectionalDerivative(self._unknown, self._known, list(NUDGE))


class Native:
    """The scenario's vehicle itself, by the verbs of the component contract."""

    def __init__(self, commands, outputs):
        chosen = choose("vehicle", SCENARIO)
        given = arguments(chosen.plan, make(list(chosen.resources)))
        self._vehicle = chosen.plan.factory(**given)
        self._vehicle.initialize(start_time=0.0, stop_time=None, seed=0)
        self._start = self._vehicle.get_state()
        self._commands, self._outputs = commands, outputs

    def rewind(self):
        """Go back to the start."""
        self._vehicle.set_state(self._start)

    def step(self, time, command):
        """Set, step and get."""
        self._vehicle.set(dict(zip(self._commands, command, strict=True)))
        self._vehicle.step(time, PERIOD)
        return self._vehicle.get(self._outputs).values()


def flight_us(vehicle, trim, repetitions):
    """Return the least CPU time of a step, us."""
    commands = [(trim + (np.array(NUDGE) if k >= 20 else 0.0)).tolist() for k in range(STEPS)]
    spent = []
    for _ in range(repetitions):
        vehicle.rewind()
        begin = process_time()
        for k, command in enumerate(commands):
            vehicle.step(k * PERIOD, command)
        spent.append(process_time() - begin)
    return 1e6 * min(spent) / STEPS


def largest_difference(raw, native):
    """Return the largest difference of any output over the flight."""
    far = 0.0
    for vehicle in (raw, native):
        vehicle.rewind()
    for k in range(STEPS):
        command = (raw.trim + (np.array(NUDGE) if k >= 20 else 0.0)).tolist()
        both = [np.array(list(v.step(k * PERIOD, command))) for v in (raw, native)]
        far = max(far, float(np.max(np.abs(both[0] - both[1]))))
    return far


def measure(fmi, folder, repetitions):
    """Return the figures of one version of FMI."""
    file = folder / f"vehicle{fmi}.fmu"
    begin = times()
    export(choose("vehicle", SCENARIO), file, fmi=fmi, language="c")
    exporting = sum(times()[:4]) - sum(begin[:4])  # the compiler's included
    raw = Raw(file, folder / f"fmi{fmi}")
    native = Native(raw.commands, raw.outputs)
    found = {
        "native: set, step, get, us": flight_us(native, raw.trim, repetitions),
        "C: set, step, get, us": flight_us(raw, raw.trim, repetitions),
        "largest difference of an output in 10 s": largest_difference(raw, native),
    }
    begin = process_time()
    for _ in range(1000):
        raw.derivative()
    found["C: directional derivative of a step by FMPy's method, us"] = 1e3 * (
        process_time() - begin
    )
    raw.fmu.terminate()
    raw.fmu.freeInstance()
    return found | {"export, CPU s": exporting, "FMU, kB": file.stat().st_size / 1e3}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=20, help="flights per figure (20)")
    repetitions = parser.parse_args().repetitions
    print(machine.line(), flush=True)
    with TemporaryDirectory() as folder:
        found = {fmi: measure(fmi, Path(folder), repetitions) for fmi in (2, 3)}
    print(f"\n{'':58}{'FMI 2':>10}{'FMI 3':>10}")
    for name in found[2]:
        print(f"{name:58}{found[2][name]:10.4g}{found[3][name]:10.4g}")


if __name__ == "__main__":
    main()
