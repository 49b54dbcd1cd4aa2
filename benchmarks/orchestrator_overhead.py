"""Measure what the orchestrator adds to a plant step: two trivial components at 20 and 2 Hz.

CPU time of a whole run without listeners, minus the same calls of the components in a bare loop,
per step of the plant. Prints one line per case; the best of several repetitions. Then wall-clock
time per communication step of both in processes of their own, each stepping every time.
"""

# ruff: noqa: ARG002, D102  (the contract's members are documented in orchestrator/component.py)

import sys
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from time import perf_counter, process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from scripted import Row, describe

from orchestrator.assembly.couple import couple
from orchestrator.assembly.plan import Plan
from orchestrator.figures.trace import Trace
from orchestrator.isolation.remote import Remote
from orchestrator.run.simulate import simulate
from orchestrator.scenario.records import ComponentSpec, ConnectionSpec, Scenario

SECONDS, REPETITIONS = 1000, 7
NAMES = ("kind", "rate_hz", "inputs", "outputs")


@dataclass(frozen=True)
class Execution:
    """When it runs."""

    kind: str
    rate_hz: float
    interface: int = 1


class Trivial:
    """Take inputs, give outputs, do nothing."""

    def __init__(self, kind, rate_hz, inputs, outputs):
        self.execution = Execution(kind, rate_hz)
        rows = [Row(name, "input") for name in inputs]
        through = tuple(inputs) if kind == "sampled" else ()
        self._rows = rows + [Row(name, "output", through=through) for name in outputs]
        self.values = dict.fromkeys((*inputs, *outputs), 1.0)

    def describe(self):
        return describe("trivial", self._rows)

    def initialize(self, *, start_time, stop_time, seed):
        pass

    def set(self, values):
        self.values.update(values)

    def get(self, names):
        values = self.values
        return {name: values[name] for name in names}

    def step(self, time, step_size):
        return 0

    def terminate(self):
        pass


def ends(width, rate_hz=2.0):
    """Return what plant and controller are made from: ``width`` states and four commands."""
    states = [f"state.x{i}" for i in range(width)]
    commands = [f"command.u{i}" for i in range(4)]
    return ("continuous", 20.0, commands, states), ("sampled", rate_hz, states, commands)


def pair(width):
    """Return plant and controller."""
    return tuple(Trivial(*arguments) for arguments in ends(width))


def coupled(width, *, is_traced):
    """Return the CPU time of a run, s."""
    plant, controller = pair(width)
    scenario = Scenario(
        "overhead",
        float(SECONDS),
        components=(ComponentSpec("plant", ""), ComponentSpec("controller", "")),
        connections=(
            ConnectionSpec("plant.state", "controller.state"),
            ConnectionSpec("controller.command", "plant.command"),
        ),
    )
    system = couple(scenario, {"plant": plant, "controller": controller})
    begin = process_time()
    simulate(system, [Trace()] if is_traced else [])
    return process_time() - begin


def bare(width):
    """Return the CPU time of the components' own calls, s."""
    plant, controller = pair(width)
    states, commands = list(plant.get(plant.values))[4:], list(plant.values)[:4]
    read, given = plant.get(states), controller.get(commands)
    begin = process_time()
    for k in range(20 * SECONDS):
        read = plant.get(states)
        if k % 10 == 0:
            controller.set(read)
            controller.step(k * 0.05, 0.5)
            given = controller.get(commands)
        plant.set(given)
        plant.step(k * 0.05, 0.05)
    return process_time() - begin


def isolated(width):
    """Return wall-clock times of communication steps with both in processes of their own, s."""
    factory = resolve_name("orchestrator_overhead:Trivial")  # not of __main__, which stays here
    plant, controller = (
        Plan(("components", name), factory, dict(zip(NAMES, arguments, strict=True)), {})
        for name, arguments in zip(("plant", "controller"), ends(width, 20.0), strict=True)
    )
    a, b = (Remote([plan], plan.path, timeout_s=10.0) for plan in (plant, controller))
    states, commands = (
        [v.name for v in one.describe().modelVariables if v.causality == "output"] for one in (a, b)
    )
    for one in (a, b):
        one.initialize(start_time=0.0, stop_time=None, seed=0)
    taken = []
    for k in range(20 * SECONDS):
        begin = perf_counter()
        b.set(a.get(states))
        b.step(k * 0.05, 0.05)
        a.set(b.get(commands))
        a.step(k * 0.05, 0.05)
        taken.append(perf_counter() - begin)
    a.terminate()
    b.terminate()
    return np.array(taken)


def main():
    steps = 20 * SECONDS
    for width in (1, 17):
        alone = min(bare(width) for _ in range(REPETITIONS))
        for is_traced in (False, True):
            whole = min(coupled(width, is_traced=is_traced) for _ in range(REPETITIONS))
            listener = "in-memory trace" if is_traced else "no listener"
            print(
                f"{width:3d} states, {listener:15}: {1e6 * (whole - alone) / steps:5.2f} us per "
                f"plant step (whole {1e6 * whole / steps:5.2f}, bare {1e6 * alone / steps:5.2f})"
            )
        taken = 1e6 * isolated(width)
        print(
            f"{width:3d} states, both isolated  : {np.median(taken):5.1f} us per communication step "
            f"(best tenth {np.percentile(taken, 10):5.1f})"
        )


if __name__ == "__main__":
    main()
