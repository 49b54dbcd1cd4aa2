"""Fly from many random starts, in gusts, with a 10 m step of the set height on the way.

    python benchmarks/random_starts.py                      # the study: 8 cells of 100 flights
    python benchmarks/random_starts.py --runs 10 --form attitude --basis tent

A cell is a command form, a preset and a basis; run i starts alike in all of them. The ground is flat
and 40 m below (``random_starts.yaml``): a flight that fails has departed or flown into the ground
by itself. A heading 45 degrees off its reference counts as a departure, even where the flight goes on
and its late height error is counted.

The result depends on the seed and the number of runs alone, not on the number of processes.
"""

import argparse
import json
import multiprocessing
import sys
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import machine
import numpy as np

SCENARIO = Path(__file__).with_suffix(".yaml")
FORMS, PRESETS = ("attitude", "actuator"), ("r50", "r50_bare")
BASES = {"laguerre": 5, "tent": 10}  # functions per channel
BARS = {"laguerre": 2.5, "tent": 0.5}  # m, late height error in attitude form
LATE = 3.0  # s at the end of a flight
SPREAD = {
    "north_m": 5.0, "east_m": 5.0, "up_m": 5.0,
    "forward_mps": 3.0, "right_mps": 3.0, "up_mps": 3.0,
    "roll_deg": 20.0, "pitch_deg": 20.0, "heading_deg": 15.0,
}  # fmt: skip
"""Half widths of the uniform distributions of the start."""


@dataclass(frozen=True)
class Cell:
    """What is flown many times."""

    form: str
    preset: str
    basis: str

    @property
    def title(self) -> str:
        """Name in tables."""
        return f"{self.form}, {self.preset}, {BASES[self.basis]} {self.basis}"


@dataclass(frozen=True)
class Run:
    """How one flight went.

    ``late_m`` is the largest height error of the last 3 s, if it got there; ``heading_deg`` the
    largest deviation of the heading from the reference's.
    """

    number: int
    outcome: str
    end_s: float
    late_m: float | None
    heading_deg: float
    ladder: Mapping[str, int]


def start(seed: int, number: int) -> dict[str, float]:
    """Return the perturbation of run ``number``."""
    rng = np.random.default_rng((seed, number))
    return {name: float(rng.uniform(-half, half)) for name, half in SPREAD.items()}


def overrides(cell: Cell, seed: int, number: int) -> list[str]:
    """Return what run ``number`` of a cell changes in the scenario."""
    return [
        f"seed={1000 * seed + number}",
        f"resources.model.parameters.preset={cell.preset}",
        f"resources.model.parameters.command={cell.form}",
        f"components.vehicle.parameters.preset={cell.preset}",
        f"components.vehicle.parameters.command={cell.form}",
        f"components.sequencer.parameters.command={cell.form}",
        f"components.mpc.parameters.basis={cell.basis}",
        f"components.mpc.parameters.bases_per_channel={BASES[cell.basis]}",
        *(
            f"components.vehicle.parameters.perturbation.{name}={value!r}"
            for name, value in start(seed, number).items()
        ),
    ]


def fly(cell: Cell, seed: int, number: int) -> Run:
    """Fly run ``number`` of a cell."""
    from orchestrator.figures.deviation import POSE, REFERENCE, VELOCITY, deviation
    from orchestrator.flight import fly as fly_scenario

    flight = fly_scenario(SCENARIO, overrides(cell, seed, number))
    trace = flight.trace
    off = deviation(
        {name: trace[f"vehicle.pose.{name}"] for name in POSE},
        {name: trace[f"vehicle.velocity.{name}"] for name in VELOCITY},
        {name: trace[f"mpc.reference.{name}"] for name in REFERENCE},
    )
    end = flight.metrics["duration_s"]
    arrived = flight.result.outcome == "flown"
    late = float(np.abs(off.height[off.time >= end - LATE - 1e-9]).max()) if arrived else None
    return Run(
        number=number,
        outcome=flight.metrics["outcome"],
        end_s=end,
        late_m=late,
        heading_deg=flight.metrics["heading_max_deg"],
        ladder=flight.metrics["ladder"],
    )


def _fly(task: tuple[Cell, int, int]) -> tuple[Cell, Run]:
    cell, seed, number = task
    return cell, fly(cell, seed, number)


def study(cells: list[Cell], seed: int, runs: int, processes: int) -> dict[Cell, list[Run]]:
    """Fly all runs of all cells, with a line of progress on stderr."""
    tasks = [(cell, seed, number) for number in range(runs) for cell in cells]
    flown: dict[Cell, list[Run]] = {cell: [] for cell in cells}
    failed = Counter()
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        for done, (cell, run) in enumerate(pool.map(_fly, tasks), start=1):
            flown[cell].append(run)
            failed[cell.form] += run.outcome != "flown"
            lost = ", ".join(f"{form} {failed[form]}" for form in sorted({c.form for c in cells}))
            print(
                f"\r{done}/{len(tasks)} flown, lost: {lost} ", end="", file=sys.stderr, flush=True
            )
    print(file=sys.stderr)
    return flown


def summary(cell: Cell, runs: list[Run]) -> dict:
    """Return the figures of a cell as plain data."""
    late = np.array([run.late_m for run in runs if run.late_m is not None])
    outcomes = Counter(run.outcome for run in runs)
    heading = sum(run.outcome == "departed" and run.late_m is not None for run in runs)
    ladder = sum((Counter(run.ladder) for run in runs), Counter())
    rejected = [run.ladder["old tail"] + run.ladder["trim"] for run in runs]
    turned = np.array([run.heading_deg for run in runs])
    lost = [run for run in runs if run.outcome != "flown"]
    worst = sorted((run for run in runs if run.late_m is not None), key=lambda run: -run.late_m)
    found = {
        **asdict(cell),
        "functions_per_channel": BASES[cell.basis],
        "runs": len(runs),
        "outcomes": dict(outcomes),
        "departed_by_heading_alone": heading,
        "late_height_error_m": None
        if not late.size
        else {
            "median": float(np.median(late)),
            "p95": float(np.percentile(late, 95)),
            "max": float(late.max()),
        },
        "updates": {
            rung: ladder[rung] for rung in ("full step", "shorter step", "old tail", "trim")
        },
        "rejected_steps_max": max(rejected),
        "heading_off_deg": {"median": float(np.median(turned)), "max": float(turned.max())},
        "lost": {
            run.number: f"{run.outcome} ({run.heading_deg:.0f} deg, {run.end_s:g} s)"
            for run in lost
        },
        "worst": {run.number: run.late_m for run in worst[:3]},
    }
    if cell.form == "attitude":
        bar = BARS[cell.basis]
        found["bar_m"] = bar
        found["bar_met"] = outcomes["flown"] == len(runs) and bool(late.max() <= bar)
    return found


def table(cells: list[dict]) -> str:
    """Return summaries as a Markdown table."""
    rows = [
        (
            "form, preset, basis",
            "departed (by heading alone) / collided / other, of",
            "late height error, median / 95 % / max (m)",
            "bar",
            "heading off, median / max (deg)",
            "updates: full / shorter / no step",
            "most without a step",
        ),
        ("---",) * 7,
    ]
    for found in cells:
        outcomes, late, steps = found["outcomes"], found["late_height_error_m"], found["updates"]
        other = found["runs"] - sum(outcomes.get(k, 0) for k in ("flown", "departed", "collision"))
        departed = f"{outcomes.get('departed', 0)} ({found['departed_by_heading_alone']})"
        verdict = {True: "met", False: "**not met**", None: ""}[found.get("bar_met")]
        heading = found["heading_off_deg"]
        rows.append(
            (
                Cell(found["form"], found["preset"], found["basis"]).title,
                f"{departed} / {outcomes.get('collision', 0)} / {other}, {found['runs']}",
                " / ".join(f"{value:.2f}" for value in late.values()) if late else "",
                f"{found['bar_m']:g} m: {verdict}" if verdict else "",
                f"{heading['median']:.0f} / {heading['max']:.0f}",
                f"{steps['full step']} / {steps['shorter step']} / "
                + str(steps["old tail"] + steps["trim"]),
                str(found["rejected_steps_max"]),
            )
        )
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100, help="flights per cell (100)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--form", choices=FORMS, help="one command form only")
    parser.add_argument("--preset", choices=PRESETS, help="one preset only")
    parser.add_argument("--basis", choices=tuple(BASES), help="one basis only")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="5 flights per cell")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result here too")
    chosen = parser.parse_args()
    cells = [
        Cell(*names)
        for names in product(
            (chosen.form,) if chosen.form else FORMS,
            (chosen.preset,) if chosen.preset else PRESETS,
            (chosen.basis,) if chosen.basis else BASES,
        )
    ]
    runs = 5 if chosen.quick else chosen.runs
    flown = study(cells, chosen.seed, runs, chosen.processes)
    found = [summary(cell, flown[cell]) for cell in cells]
    print(machine.line(), table(found), sep="\n\n")
    if chosen.json:
        result = {"seed": chosen.seed, "machine": machine.describe(), "cells": found}
        chosen.json.write_text(json.dumps(result, indent=2) + "\n")
    sys.exit(any(cell.get("bar_met") is False for cell in found))


if __name__ == "__main__":
    main()
