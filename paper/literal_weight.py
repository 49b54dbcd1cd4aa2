"""The literal R: a weight on the controls themselves, where a helicopter needs 1 G to stay up."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from paper.converge import basis
from paper.problem import Problem, level_flight
from paper.receding import fly
from paper.study import Claim, Figure, Study, Table
from paper.style import line

WEIGHTS = (1.0, 10.0, 100.0)
UPDATES = 80
LATE_S = 20.0  # at the end of a flight: what is left is the bias
BASES = {"5 Laguerre": ("laguerre", 5), "10 tents": ("tent", 10)}
PULLS = {"the control itself (paper)": True, "its deviation from trim": False}


class Bias(NamedTuple):
    """Mean error of altitude, m, and speed, m/s, at the end of a flight meant to be level."""

    altitude_m: float
    speed_mps: float


def level(weight: float, *, is_literal: bool) -> Problem:
    """Return level flight in actuator form with R = ``weight`` on all channels."""
    problem = level_flight(form="actuator", R=(weight, weight, weight, weight))
    return replace(problem, actuators=np.zeros(4)) if is_literal else problem


def drift(problem: Problem, name: str) -> tuple[Any, Any, Bias]:
    """Fly level; return times, s, altitudes, m, and the bias."""

    def problem_at(time: float) -> Problem:
        reference = problem.reference.copy()
        reference[0] += time * reference[4]
        return replace(problem, reference=reference)

    family, count = BASES[name]
    flown = fly(problem_at, basis(family, count, problem.horizon), UPDATES)
    altitude, speed = flown.outputs[:, 2], flown.outputs[:, 4]
    late = flown.time > flown.time[-1] - LATE_S
    wanted = problem.reference[4, 0]
    return (
        flown.time,
        altitude,
        Bias(float(altitude[late].mean()), float(speed[late].mean() - wanted)),
    )


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return the biases for every weight, basis and what R pulls to."""
    progress("R on the control itself")
    names = list(BASES)[:1] if quick else list(BASES)
    columns: dict[str, list[Any]] = {"R acts on": [], "R": [], "basis": []}
    columns |= {field: [] for field in Bias._fields}
    table: dict[str, Any] = {}
    found: dict[tuple[str, float, str], Bias] = {}
    for pull, is_literal in PULLS.items():
        for weight in WEIGHTS:
            for name in names:
                time, altitude, bias = drift(level(weight, is_literal=is_literal), name)
                found[pull, weight, name] = bias
                table |= {"time_s": time, f"altitude_m, R = {weight:g} on {pull}, {name}": altitude}
                row = pull, weight, name, *(round(value, 4) for value in bias)
                for column, value in zip(columns.values(), row, strict=True):
                    column.append(value)
    paper, ours = PULLS
    shown = names[0]
    largest = max(abs(found[ours, weight, name].altitude_m) for weight in WEIGHTS for name in names)
    worst = max(abs(found[paper, weight, name].altitude_m) for weight in WEIGHTS for name in names)
    literal = "; ".join(
        f"{name} {' / '.join(f'{found[paper, w, name].altitude_m:+.2f}' for w in WEIGHTS)}"
        for name in names
    )
    return Study(
        title="R on the control itself",
        text="Eq. 7 weighs u' R u. Level flight needs a thrust of about 1 G, so that cost is least "
        "not in level flight: every plan saves thrust at the end of its horizon, and what is applied "
        "of it leaves the aircraft off its altitude, or wandering about it. On the deviation from trim "
        "R has no such pull, which is why the controller that ships departs from the paper here.",
        figures=(
            Figure(
                name="literal_weight",
                title="R on the control itself",
                caption=f"Altitude, wanted 0 m, in level flight at 30 m/s; {shown}, actuator form, "
                "line search, Q = 1, R on all four channels.",
                table=table,
                draw=partial(_draw, table=table, name=shown),
                size_in=(7.5, 3.8),
            ),
        ),
        tables=(
            Table(
                name="literal_weight_bias",
                title="Bias in level flight",
                caption=f"Mean errors over the last {LATE_S:g} s of {UPDATES // 2} s.",
                columns=columns,
            ),
        ),
        claims=(
            Claim(
                where="2.1, eq. 7",
                statement="R weighs the control u itself, and the reference is tracked",
                verdict="holds in part" if worst > 10.0 * largest + 0.01 else "holds",
                theirs="",
                ours="mean altitude error in level flight, m, for R = 1 / 10 / 100: "
                f"{literal}; on the deviation from trim at most {largest:.3f}",
                reason="It flies, but off its altitude: the cost is not least in level flight. The "
                "fewer the functions, the more of the end of a plan is in its beginning.",
            ),
        ),
    )


def _draw(picture: Any, table: Mapping[str, Any], name: str) -> None:
    axes = picture.subplots()
    paper, ours = PULLS
    for number, weight in enumerate(WEIGHTS):
        for pull, width in ((paper, 1.8), (ours, 0.9)):
            style = line(number) if pull == paper else {"color": line(6)["color"], "linestyle": ":"}
            label = f"R = {weight:g} on u" if pull == paper else None
            altitude = table[f"altitude_m, R = {weight:g} on {pull}, {name}"]
            axes.plot(table["time_s"], altitude, **style, linewidth=width, label=label)
    axes.plot([], [], color=line(6)["color"], linestyle=":", label="on u - trim, all three")
    axes.set(xlabel="time (s)", ylabel="altitude (m)")
    picture.legend(*axes.get_legend_handles_labels(), loc="outside right upper")
