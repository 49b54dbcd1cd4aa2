"""Measure what identifying the response S costs, by rollouts and by recursion, CPU ms.

One horizon of 200 samples about level flight at 30 m/s, attitude form, for several numbers of columns;
the least of many calls, the two ways in turn. Also how far the two are apart, relative to the largest
response of each output: that is the error of the rollouts' one-sided differences.
"""

import argparse
from time import process_time

import machine
import numpy as np

from controller.parameters import MpcParameters, design
from controller.prediction import identify
from plant.prediction import HelicopterModel, ModelParameters

CASES = {
    "5 Laguerre": ("laguerre", 5),
    "10 tents": ("tent", 10),
    "40 tents": ("tent", 40),
    "full order": ("full", 200),
}
WAYS = ("rollouts", "recursion")
SAMPLES = 200


def measure(repetitions):
    """Return rows of (case, columns, ms by rollouts, ms by recursion, largest difference)."""
    model = HelicopterModel(ModelParameters())
    state, command, _ = model.trim(30.0)
    u0, still = np.tile(command, (SAMPLES, 1)), np.zeros(3)
    rows = []
    for case, (basis, number) in CASES.items():
        shape = design(MpcParameters(basis=basis, bases_per_channel=number), model, SAMPLES)
        found, least = {}, dict.fromkeys(WAYS, np.inf)
        for _ in range(repetitions if basis != "full" else 1 + repetitions // 10):
            for way in WAYS:
                begin = process_time()
                found[way] = identify(model, state, u0, shape.Phi, shape.amplitude, still, still,
                                      shape.rows, by=way)  # fmt: skip
                least[way] = min(least[way], 1e3 * (process_time() - begin))
        size = np.abs(found["recursion"].S).max(axis=(1, 2), keepdims=True)
        apart = np.abs((found["rollouts"].S - found["recursion"].S) / size).max()
        rows.append((case, shape.Phi.shape[2], least["rollouts"], least["recursion"], apart))
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=60, help="calls of each (60)")
    arguments = parser.parse_args()
    print(machine.line())
    print("CPU ms of one identification, one thread, least of many")
    print(f"{'':12}{'columns':>9}{'rollouts':>10}{'recursion':>11}{'apart':>10}")
    rows = measure(arguments.repetitions)
    for case, columns, *figures in rows:
        print("{:12}{:9d}{:10.2f}{:11.2f}{:10.1e}".format(case, columns, *figures))
    by_case = {row[0]: row[3] for row in rows}
    ratio = by_case["40 tents"] / by_case["5 Laguerre"]
    print(f"recursion at 40 functions per channel over 5: {ratio:.2f}")


if __name__ == "__main__":
    main()
