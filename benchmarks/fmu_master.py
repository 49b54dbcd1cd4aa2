"""Measure what a master costs per communication step: two FMUs that pass one number to each other.

The FMUs of all masters are the same files, which do next to nothing, so that a step is the master's
work and six FMI calls. Time of many steps by number, the least of several repetitions, CPU (of the
master's process) and wall. Masters that are not installed are left out, which is said.
"""

import argparse
import ctypes
import json
import os
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, process_time

import machine

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from fmus.build import build

from orchestrator.assembly.build import build as assemble
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load_text

RATE_HZ = 1000
TARGETS_US = {
    ("Hedgehop", 2): 10.0,
    ("Hedgehop, isolated", 2): 60.0,
    ("Hedgehop, isolated", 3): 60.0,
}
U, Y = 1, 2  # value references of the relay


class Stopwatch:
    """Take the CPU and wall time of a block, s."""

    def __enter__(self):
        self.cpu, self.wall = process_time(), perf_counter()
        return self

    def __exit__(self, *_):
        self.cpu, self.wall = process_time() - self.cpu, perf_counter() - self.wall


@contextmanager
def silence():
    """Send what C libraries print nowhere."""
    sys.stdout.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, copy in enumerate(kept, start=1):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


def hedgehop(fmu, steps, isolation="none"):
    """Return the times of a whole run without listeners."""
    text = f"""
title: two relays
duration_s: {steps / RATE_HZ}
components:
  a: {{use: {json.dumps(str(fmu))}, rate_hz: {RATE_HZ}, isolation: {isolation}}}
  b: {{use: {json.dumps(str(fmu))}, rate_hz: {RATE_HZ}, isolation: {isolation}}}
connections: [a.y -> b.u, b.y -> a.u]
"""
    system = assemble(load_text(text, fmu))
    with Stopwatch() as watch:
        result = simulate(system)
    if result.outcome != "flown":
        raise RuntimeError(result.reason)
    return watch


def fmpy_classes(fmu, steps):
    """Return the times of a loop over the methods of FMPy's classes."""
    from fmpy import extract, instantiate_fmu, read_model_description

    description = read_model_description(str(fmu), validate=False)
    folder = extract(str(fmu), str(fmu.with_suffix("")))
    pair = [instantiate_fmu(folder, description, "CoSimulation") for _ in range(2)]
    is_fmi2 = description.fmiVersion == "2.0"
    for one in pair:
        if is_fmi2:
            one.setupExperiment(startTime=0.0)
        one.enterInitializationMode()
        one.exitInitializationMode()
    a, b = pair
    read_a, write_a = (a.getReal, a.setReal) if is_fmi2 else (a.getFloat64, a.setFloat64)
    read_b, write_b = (b.getReal, b.setReal) if is_fmi2 else (b.getFloat64, b.setFloat64)
    h = 1 / RATE_HZ
    with Stopwatch() as watch:
        for k in range(steps):
            ya, yb = read_a([Y]), read_b([Y])
            write_a([U], yb)
            write_b([U], ya)
            a.doStep(k * h, h)
            b.doStep(k * h, h)
    for one in pair:
        one.terminate()
        one.freeInstance()
    return watch


def cosim(fmu, steps, *, is_bulk):
    """Return the times of libcosim, stepped one by one from Python or all at once."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)

    execution = CosimExecution.from_step_size(step_size=int(1e9 / RATE_HZ))
    a, b = (
        execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name=name))
        for name in "ab"
    )
    execution.connect_real_variables(a, Y, b, U)
    execution.connect_real_variables(b, Y, a, U)
    execution.step()  # initializes
    with Stopwatch() as watch:
        if is_bulk:
            execution.step(step_count=steps)
        else:
            for _ in range(steps):
                execution.step()
    return watch


def ecos(fmu, steps, *, is_bulk):
    """Return the times of Ecos, in the same two ways."""
    ctypes.CDLL(
        str(Path(sys.prefix) / "lib/libtbb.so.12"), ctypes.RTLD_GLOBAL
    )  # of the package tbb
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        for name in "ab":
            structure.add_model(name, str(fmu))
        structure.make_real_connection("a::y", "b::u")
        structure.make_real_connection("b::y", "a::u")
        with EcosSimulation(structure=structure, step_size=1 / RATE_HZ) as simulation:
            if not simulation.init():
                raise RuntimeError("ecospy: cannot be initialized")
            simulation.step()
            with Stopwatch() as watch:
                if is_bulk:
                    simulation.step(steps)
                else:
                    for _ in range(steps):
                        simulation.step()
            simulation.terminate()
    return watch


MASTERS = {  # name: (versions of FMI, function of an FMU and a number of steps)
    "Hedgehop": ((2, 3), hedgehop),
    "Hedgehop, isolated": ((2, 3), lambda f, n: hedgehop(f, n, "process")),
    "FMPy, methods of its classes": ((2, 3), fmpy_classes),
    "libcosimpy, step by step": ((2,), lambda f, n: cosim(f, n, is_bulk=False)),
    "libcosimpy, all at once": ((2,), lambda f, n: cosim(f, n, is_bulk=True)),
    "ecospy, step by step": ((2, 3), lambda f, n: ecos(f, n, is_bulk=False)),
    "ecospy, all at once": ((2, 3), lambda f, n: ecos(f, n, is_bulk=True)),
}


def measure(steps, repetitions, folder):
    """Return CPU and wall time per step, us, by master and version; text where it cannot run.

    The masters take turns, so that a busy minute hits all of them.
    """
    fmus = {fmi: build("relay", folder, fmi=fmi) for fmi in (2, 3)}
    found = {}
    for _ in range(repetitions):
        for name, (versions, run) in MASTERS.items():
            for fmi in versions:
                if isinstance(found.get((name, fmi)), str):
                    continue
                try:
                    watch = run(fmus[fmi], steps)
                except (ImportError, OSError) as error:
                    found[name, fmi] = f"not run: {error}"
                    continue
                best = found.setdefault((name, fmi), {"cpu": float("inf"), "wall": float("inf")})
                for clock in best:
                    best[clock] = min(best[clock], 1e6 * getattr(watch, clock) / steps)
    return found


def table(found):
    """Return the figures as lines of text."""
    lines = [f"{'us per communication step':32}{'FMI':>4}{'CPU':>9}{'wall':>9}{'target':>9}"]
    for (name, fmi), figures in found.items():
        if isinstance(figures, str):
            lines.append(f"{name:32}{fmi:4d}  {figures}")
            continue
        target = TARGETS_US.get((name, fmi))
        lines.append(
            f"{name:32}{fmi:4d}{figures['cpu']:9.2f}{figures['wall']:9.2f}"
            + (f"{target:9.0f}" if target else "")
        )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000, help="per repetition (20000)")
    parser.add_argument("--repetitions", type=int, default=7, help="of which the least counts (7)")
    arguments = parser.parse_args()
    print(machine.line(), flush=True)
    with tempfile.TemporaryDirectory() as folder, silence():
        found = measure(arguments.steps, arguments.repetitions, Path(folder))
    print(table(found))


if __name__ == "__main__":
    main()
