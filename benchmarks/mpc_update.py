"""Measure one update of the MPC in flight: CPU ms, and where they go, beside the floor.

Flies 20 s of ``scenarios/jacksboro.yaml`` several times with timers around the parts of an update.
Flights are equal to the last bit, so the least time of update k over all flights is that of update
k undisturbed; reported are minimum and median of these over the updates. The floor is the lane
kernel alone, on as many trajectories as an update rolls out, measured alike between the flights.
"""

import argparse
from contextlib import contextmanager
from pathlib import Path
from time import process_time

import machine
import numpy as np

import controller.mpc
import controller.optimise
import controller.update
from orchestrator.assembly.build import build
from orchestrator.run.simulate import simulate
from orchestrator.scenario.load import load
from plant import kernels, lanes
from plant.helicopter import ModelParameters
from plant.rotorcraft import rotorcraft

SCENARIO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
CASES = {"5 Laguerre": ("laguerre", 5), "10 tents": ("tent", 10), "40 tents": ("tent", 40)}
SECONDS, SETTLE = 20, 4  # the first updates are cold, or have several passes
SAMPLES = 200

# which calls make up a part; "pass" and "update" hold others
PARTS = {
    "identification": ((controller.optimise, "identify"),),
    "QP assembly": (
        (controller.optimise, "targets"),
        (controller.optimise, "quadratic_programme"),
    ),
    "QP solution": ((controller.optimise, "solve_with_fallback"),),
    "reference": ((controller.update, "extend"), (controller.update, "project")),
    "pass": ((controller.update, "optimise"),),
    "update": ((controller.mpc.Mpc, "step"),),
}
COLUMNS = (
    "whole update", "identification", "QP assembly", "QP solution", "line search", "reference",
    "rest", "floor",
)  # fmt: skip


@contextmanager
def timers():
    """Time the parts while a flight is under way; yields one dict per update so far."""
    updates = [dict.fromkeys(PARTS, 0.0)]
    saved = []

    def install(part, owner, name):
        function = getattr(owner, name)
        saved.append((owner, name, function))

        def timed(*arguments, **keywords):
            begin = process_time()
            try:
                return function(*arguments, **keywords)
            finally:
                updates[-1][part] += process_time() - begin
                if part == "update":
                    updates.append(dict.fromkeys(PARTS, 0.0))

        setattr(owner, name, timed)

    try:
        for part, calls in PARTS.items():
            for owner, name in calls:
                install(part, owner, name)
        yield updates
    finally:
        for owner, name, function in saved:
            setattr(owner, name, function)


def fly(basis, number):
    """Return the times of a flight's updates, s, as an array (updates, parts)."""
    parameters = "components.mpc.parameters"
    overrides = [
        f"duration_s={SECONDS}",
        f"{parameters}.basis={basis}",
        f"{parameters}.bases_per_channel={number}",
    ]
    system = build(load(SCENARIO, overrides))
    with timers() as updates:
        result = simulate(system)
    assert result.outcome == "flown", result
    return np.array([list(one.values()) for one in updates[SETTLE:-1]])


def floor(number):
    """Return what the lane kernel takes for the rollouts of one update, s, twenty times over."""
    craft = rotorcraft(ModelParameters())
    level = craft.trim(30.0)
    command, still = craft.trim_command(level), np.zeros(3)

    def rollout(trajectories):
        N = -(-trajectories // lanes.LANES) * lanes.LANES
        state = np.tile(craft.own_state(level.state), (N, 1))
        commands = np.tile(command, (N, SAMPLES, 1))
        out = np.empty((len(lanes.OUTPUTS), SAMPLES, N))
        last, valid = np.empty((N, len(level.state))), np.empty(N, np.bool_)
        begin = process_time()
        kernels.roll_thrust(
            state, commands, still, still, craft.constants, 0.05 / craft.substeps, craft.substeps,
            craft.over_terrain, craft.grid, out, last, valid,
        )  # fmt: skip
        return process_time() - begin

    columns, lengths = 4 * number, len(controller.optimise.STEPS)
    return [rollout(1 + columns) + rollout(lengths) for _ in range(20)]


def measure(case, repetitions):
    """Return minimum and median of one case's updates as plain data, ms."""
    basis, number = CASES[case]
    fly(basis, number)  # compiles, and warms every cache
    flown, floors = zip(
        *((fly(basis, number), floor(number)) for _ in range(repetitions)), strict=True
    )
    times, alone = 1e3 * np.min(flown, axis=0), 1e3 * np.min(floors, axis=0)
    part = dict(zip(PARTS, times.T, strict=True))
    inside = part["identification"] + part["QP assembly"] + part["QP solution"]
    shares = {
        "whole update": part["update"],
        "identification": part["identification"],
        "QP assembly": part["QP assembly"],
        "QP solution": part["QP solution"],
        "line search": part["pass"] - inside,
        "reference": part["reference"],
        "rest": part["update"] - part["pass"] - part["reference"],
        "floor": alone,
    }
    return {
        "min": {name: float(np.min(values)) for name, values in shares.items()},
        "median": {name: float(np.median(values)) for name, values in shares.items()},
    }


def table(figures):
    """Return the figures as text."""
    lines = [f"{'':19}" + "".join(f"{name:>{len(name) + 2}}" for name in COLUMNS)]
    for case, found in figures.items():
        lines += [
            f"{case:11} {statistic:7}"
            + "".join(f"{values[name]:{len(name) + 2}.2f}" for name in COLUMNS)
            for statistic, values in found.items()
        ]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=5, help="flights per case (5)")
    arguments = parser.parse_args()
    print(machine.line())
    print("CPU ms per update of the MPC, one thread")
    print(table({case: measure(case, arguments.repetitions) for case in CASES}))


if __name__ == "__main__":
    main()
