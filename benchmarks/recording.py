"""Measure what recording costs per plant step, with the scene for viewers and without, and its size.

The flight is flown once and what a listener hears of it is kept; then a recorder hears it again
and again. CPU time from the second simulated second on: the first has the static scene.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from time import process_time

import machine

from orchestrator.assembly.build import build
from orchestrator.recording.recorder import Recorder
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load

SCENARIO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
VARIANTS = {  # recording options, target in us per plant step
    "scene on": ({}, 60.0),
    "scene off": ({"scene": False}, 25.0),
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


def flight(duration_s):
    """Return a system that was not run, and what was heard of one that was."""
    overrides = [f"duration_s={duration_s}", "recording.wall_clock=false"]
    keeper = Keeper()
    simulate(build(load(SCENARIO, overrides)), [keeper])
    return build(load(SCENARIO, overrides)), keeper


def cost_us(system, keeper, options, folder):
    """Return the CPU time per plant step, us, and the size, MB per minute."""
    recording = replace(system.scenario.recording, **options)
    system = replace(system, scenario=replace(system.scenario, recording=recording))
    path = folder / "flight.mcap"
    recorder = Recorder(path)
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
                found[name].append(cost_us(system, keeper, recording, Path(folder)))
    for name, (_, target) in VARIANTS.items():
        least, size = min(found[name])
        print(f"{name:24}{least:18.1f}{target or '':>8}{size:15.2f}")


if __name__ == "__main__":
    main()
