"""Measure one update of the MPC with an FMU as its prediction model, beside the native model: ms.

Flies 10 s of ``scenarios/jacksboro.yaml`` several times with a timer around every update. Of each
update the least over equal flights; reported is the median of these: CPU time of this process, and wall
time, which is what a second process saves. The FMU is the helicopter as C, without terrain, as the
native model.
"""

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import machine
import numpy as np

import controller.mpc
from orchestrator.assembly.build import build
from orchestrator.export.export import choose, export
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load

SCENARIO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
BASES = {"5 Laguerre": ("laguerre", 5), "10 tents": ("tent", 10), "40 tents": ("tent", 40)}
SECONDS, SETTLE = 10, 4  # the first updates are cold, or have several passes
MODELS = {
    "native": None,
    "FMU": "",
    "FMU, two processes": ", processes: 2",
    "FMU, derivatives": ", derivatives: true",
}


def fly(basis, number, model):
    """Return CPU and wall time of every update of a flight, s, (updates, 2)."""
    overrides = [
        f"duration_s={SECONDS}",
        f"components.mpc.parameters.basis={basis}",
        f"components.mpc.parameters.bases_per_channel={number}",
        *([] if model is None else [f"resources.model={model}"]),
    ]
    system = build(load(SCENARIO, overrides))
    step, spent = controller.mpc.Mpc.step, []

    def timed(*arguments):
        begin = process_time(), perf_counter()
        status = step(*arguments)
        spent.append((process_time() - begin[0], perf_counter() - begin[1]))
        return status

    controller.mpc.Mpc.step = timed
    try:
        result = simulate(system)
    finally:
        controller.mpc.Mpc.step = step
    assert result.outcome == "flown", result
    return np.array(spent[SETTLE:])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=5, help="flights per figure (5)")
    repetitions = parser.parse_args().repetitions
    print(machine.line(), flush=True)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "helicopter.fmu"
        export(choose("plant.helicopter:Helicopter"), file, fmi=3, language="c")
        use = 'use: "orchestrator.fmu.prediction:FmuModel"'
        print(f"\n{'ms per update: CPU, wall':26}" + "".join(f"{name:>18}" for name in BASES))
        for name, more in MODELS.items():
            parameters = f"file: '{file}', preset: null, command: null{more}"
            model = None if more is None else f"{{{use}, parameters: {{{parameters}}}}}"
            figures = []
            for basis, number in BASES.values():
                fly(basis, number, model)  # warms every cache
                flown = [fly(basis, number, model) for _ in range(repetitions)]
                cpu, wall = 1e3 * np.median(np.min(flown, axis=0), axis=0)
                figures.append(f"{cpu:9.2f}{wall:9.2f}")
            print(f"{name:26}" + "".join(figures), flush=True)


if __name__ == "__main__":
    main()
