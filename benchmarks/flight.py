"""Measure a whole flight: CPU ms per simulated second, recording included, and where it goes.

Flies ``scenarios/jacksboro.yaml`` as ``hedgehop run`` does, several times in one process, and times
the run loop alone: no imports, no loading, no first calls, no closing table. Flights are equal to
the last bit, so ``least`` adds up the least time of every stretch of 0.3 s over all of them: the
flight undisturbed. Then twice more with a timer around every call of a component and of a listener;
what is left is the orchestrator's.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from time import process_time

import machine
import numpy as np

from orchestrator.assembly.build import build
from orchestrator.figures.logbook import Logbook
from orchestrator.figures.trace import Trace
from orchestrator.recording.recorder import Recorder
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load

SCENARIO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
CASES = {"5 Laguerre": ("laguerre", 5, 25.0), "10 tents": ("tent", 10, 40.0)}  # target, ms


class Timed:
    """Anything, with the CPU time of its methods added up under one name."""

    def __init__(self, inner, name, spent):
        self._inner, self._name, self._spent = inner, name, spent

    def __getattr__(self, attribute):
        value = getattr(self._inner, attribute)
        if not callable(value):
            return value

        def timed(*arguments, **keywords):
            begin = process_time()
            try:
                return value(*arguments, **keywords)
            finally:
                self._spent[self._name] += process_time() - begin

        return timed


def overrides(case):
    """Return the case as overrides of the scenario."""
    basis, number, _ = CASES[case]
    parameters = "components.mpc.parameters"
    return [f"{parameters}.basis={basis}", f"{parameters}.bases_per_channel={number}"]


def fly(case, folder, *, is_split):
    """Return CPU ms per simulated second of a flight, by stretches (K,), and of its parts."""
    system = build(load(SCENARIO, overrides(case)))
    trace = Trace()
    listeners = {
        "trace": trace,
        "logbook": Logbook(trace),
        "recorder": Recorder(folder / "flight.mcap"),
    }
    spent = Counter()
    if is_split:
        for name, instance in system.instances.items():
            instance.component = Timed(instance.component, name, spent)
        listeners = {name: Timed(one, name, spent) for name, one in listeners.items()}
    marks, totals = [], []

    def mark(_):  # first called before the first step, last after the last one
        marks.append(process_time())
        totals.append(Counter(spent))

    result = simulate(system, list(listeners.values()), mark)
    assert result.outcome == "flown", result
    per_second = 1e3 / (result.time_ns / 1e9)
    stretches = np.diff(marks) * per_second
    parts = {name: (totals[-1][name] - totals[0][name]) * per_second for name in totals[-1]}
    return stretches, {**parts, "orchestrator": stretches.sum() - sum(parts.values())}


def measure(case, repetitions):
    """Return the figures of one case as plain data, ms per simulated second."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fly(case, folder, is_split=False)  # compiles, and warms every cache
        flown = np.array([fly(case, folder, is_split=False)[0] for _ in range(repetitions)])
        split = min((fly(case, folder, is_split=True) for _ in range(2)), key=lambda f: f[0].sum())
    return {
        "least": float(flown.min(axis=0).sum()),
        "median": float(np.median(flown.sum(axis=1))),
        "target": CASES[case][2],
        "split": split[1],
    }


def table(figures):
    """Return the figures as text."""
    parts = list(next(iter(figures.values()))["split"])
    rows = [("", "least", "median", "target", *parts)]
    for case, found in figures.items():
        values = [*(found[key] for key in rows[0][1:4]), *(found["split"][part] for part in parts)]
        rows.append((case, *(f"{value:.2f}" for value in values)))
    return "\n".join(
        f"{row[0]:12}" + "".join(f"{cell:>{max(8, len(rows[0][i + 1]) + 1)}}"
        for i, cell in enumerate(row[1:])) for row in rows
    )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=5)
    arguments = parser.parse_args()
    print(machine.line())
    print(
        "CPU ms per simulated second of the run loop, with recording; split: one flight, with timers"
    )
    print(table({case: measure(case, arguments.repetitions) for case in CASES}))


if __name__ == "__main__":
    main()
