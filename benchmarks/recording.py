"""Measure what recording costs per plant step, with the scene for viewers and without, and its size.

The flight is flown once and what a listener hears of it is kept; then a recorder hears it again
and again. CPU time from the second simulated second on: the first has the static scene. Beside it, the
floor of any recorder that hears Python values: their bytes taken out, compressed and written once a
second, without topics, times, index or anything to draw.
"""

import argparse
import struct
import tempfile
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from time import process_time

import machine
import numpy as np
import zstandard

from orchestrator.assembly.build import build
from orchestrator.recording.chunks import LEVEL
from orchestrator.recording.recorder import FLUSH_NS, Recorder
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load

SCENARIO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
FLOOR = "floor, scene off"
VARIANTS = {  # recording options, target in us per plant step
    "scene on": ({}, 60.0),
    "scene off": ({"scene": False}, 25.0),
    FLOOR: ({"scene": False}, None),
    "scene on, no scan": ({"exclude": ("/sensor/scan", "/scene/sensed")}, None),
    "scene off, no scan": ({"scene": False, "exclude": ("/sensor/scan",)}, None),
}
CALLS = ("outputs", "inputs", "parameters", "event", "log")


class Keeper:
    """A listener that keeps what it hears."""

    wants_wall_clock = False

    def __init__(self):
        self.calls, self.result = [], None
        for name in CALLS:
            setattr(self, name, lambda *arguments, name=name: self.calls.append((name, arguments)))

    def open(self, system):
        """Nothing to prepare."""

    def wall_clock(self, *_):
        """Nothing is asked to be measured."""

    def close(self, result):
        """Keep the result."""
        self.result = result


class Floor:
    """A recorder that leaves out all that can be left out; the values come back by the scenario."""

    def __init__(self, path):
        self.path, self.flush_ns, self.kept = path, FLUSH_NS, {}
        self.compress = zstandard.ZstdCompressor(level=LEVEL).compress

    def open(self, system):
        """Prepare one struct for the numbers of each component."""
        self.file = self.path.open("wb")
        self.numbers, self.arrays = {}, {}
        for name, ports in system.ports.items():
            outputs = [p for p in ports.values() if p.causality == "output"]
            numbers = [p.name for p in outputs if not p.shape and p.type != "String"]
            self.numbers[name] = itemgetter(*numbers), struct.Struct(f"{len(numbers)}d").pack
            self.arrays[name] = [p.name for p in outputs if p.shape]
            self.kept[name] = []

    def outputs(self, time_ns, component, values):
        """Keep what is told, and write it once a second."""
        if time_ns > self.flush_ns:
            self.flush()
            self.flush_ns = (time_ns // FLUSH_NS + 1) * FLUSH_NS
        self.kept[component].append(values)

    def flush(self):
        """Write what was kept, arrays only where they are new."""
        parts = []
        for name, kept in self.kept.items():
            find, pack = self.numbers[name]
            parts += [pack(*find(values)) for values in kept]
            for key in self.arrays[name]:
                arrays = {id(values[key]): values[key] for values in kept}
                parts += map(np.ascontiguousarray, arrays.values())
            kept.clear()
        self.file.write(self.compress(b"".join(parts)))
        self.file.flush()

    def close(self, _):
        """Write the rest."""
        self.flush()
        self.file.close()

    def inputs(self, *_):
        """Nothing."""

    parameters = event = log = inputs


def flight(duration_s):
    """Return a system that was not run, and what was heard of one that was."""
    overrides = [f"duration_s={duration_s}", "recording.wall_clock=false"]
    keeper = Keeper()
    simulate(build(load(SCENARIO, overrides)), [keeper])
    return build(load(SCENARIO, overrides)), keeper


def cost_us(system, keeper, options, folder, make=Recorder):
    """Return the CPU time per plant step, us, and the size, MB per minute."""
    recording = replace(system.scenario.recording, **options)
    system = replace(system, scenario=replace(system.scenario, recording=recording))
    path = folder / "flight.mcap"
    recorder = make(path)
    recorder.open(system)
    begin, steps = None, 0
    for name, arguments in keeper.calls:
        if begin is None and arguments[0] > 2 * 10**9:
            begin = process_time()
        if begin is not None and name == "outputs" and arguments[1] == "vehicle":
            steps += 1
        getattr(recorder, name)(*arguments)
    recorder.close(keeper.result)
    spent = process_time() - begin
    minutes = system.schedule.end_ns / 6e10
    return 1e6 * spent / steps, path.stat().st_size / 1e6 / minutes


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=10, help="per variant (10)")
    parser.add_argument("--duration-s", type=float, default=60.0, help="of the flight (60)")
    options = parser.parse_args()
    print(machine.line(), flush=True)
    system, keeper = flight(options.duration_s)
    print(f"\n{'':24}{'us per plant step':>18}{'target':>8}{'MB per minute':>15}")
    with tempfile.TemporaryDirectory() as folder:
        found = {name: [] for name in VARIANTS}
        for _ in range(options.repetitions):
            for name, (recording, _) in VARIANTS.items():
                make = Floor if name == FLOOR else Recorder
                found[name].append(cost_us(system, keeper, recording, Path(folder), make))
    for name, (_, target) in VARIANTS.items():
        least, size = min(found[name])
        print(f"{name:24}{least:18.1f}{target or '':>8}{size:15.2f}")


if __name__ == "__main__":
    main()
