"""Every controller over every course: the table of the README.

    python -m paper.flights                      # fly what is missing, print the table
    python -m paper.flights --again --controller "5 Laguerre" --course ridges

Rows are kept in a CSV file and written after every flight, so that a run that was cut short goes on
where it was: nonlinear optimisation takes minutes per flight. A flight's figures do not depend on the
others'; its CPU time is that of the run loop after a flight of one update, so that nothing is compiled
in it.
"""

import csv
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from orchestrator.errors import ScenarioError
from orchestrator.flight import fly
from orchestrator.scenario.load import installed

ROWS = Path(__file__).parents[1] / "docs" / "paper" / "flights.csv"
COURSES = ("jacksboro", "volcano", "ridges", "fractal")
FIGURES = (
    "outcome", "duration_s", "height_rms_m", "agl_rms_m", "clearance_min_m", "cross_track_rms_m",
    "heading_max_deg", "update_ms_median", "cpu_ms_per_simulated_s",
)  # fmt: skip
"""What is kept of :func:`orchestrator.figures.metrics.flight_metrics`."""
Row = Mapping[str, str]


class Controller(NamedTuple):
    """What takes the place of ``components.mpc`` in a scenario."""

    name: str
    use: str
    parameters: Mapping[str, Any]

    def overrides(self) -> list[str]:
        """Return it as overrides of a scenario."""
        chosen = {f"parameters.{name}": value for name, value in self.parameters.items()}
        return [
            f"components.mpc.{key}={value}" for key, value in {"use": self.use, **chosen}.items()
        ]


def _basis(name: str, family: str, **parameters: Any) -> Controller:
    return Controller(name, "controller.mpc:BasisMpc", {"basis": family, **parameters})


CONTROLLERS = (
    _basis("5 Laguerre polynomials", "laguerre", bases_per_channel=5),
    _basis("8 Laguerre functions", "laguerre_function", bases_per_channel=8, pole_per_s=0.5),
    _basis("10 tents", "tent", bases_per_channel=10),
    _basis(
        "20 learned coefficients", "learned", bases_per_channel=5,
        basis_file="bases/learned_attitude.npz",
    ),
    _basis("full order", "full", identification="recursion"),
    Controller("nonlinear", "controller.nonlinear:NonlinearMpc", {}),
    Controller("LQ preview", "controller.preview:PreviewLq", {}),
    Controller("height follower", "controller.follower:HeightFollower", {}),
)  # fmt: skip


def fly_course(controller: Controller, course: str, overrides: Sequence[str] = ()) -> Row:
    """Fly one controller over one course.

    Raises
    ------
    ScenarioError
        If there is no such controller or course.
    """
    scenario = installed() / f"{course}.yaml"
    chosen = [*controller.overrides(), *overrides]
    fly(scenario, [*chosen, "duration_s=0.5"])
    metrics = fly(scenario, chosen).metrics
    figures = {name: metrics[name] for name in FIGURES}
    kept = {
        name: f"{value:.6g}" if isinstance(value, float) else str(value)
        for name, value in figures.items()
        if value is not None
    }
    return {"controller": controller.name, "course": course, **kept}


def read_rows(file: Path) -> list[Row]:
    """Return the rows kept so far, none if there is no file."""
    if not file.exists():
        return []
    with file.open(encoding="utf-8", newline="") as text:
        return list(csv.DictReader(text))


def write_rows(rows: Sequence[Row], file: Path) -> None:
    """Keep rows, in the order of :data:`CONTROLLERS` and :data:`COURSES`."""
    names = [controller.name for controller in CONTROLLERS]

    def place(row: Row) -> tuple[int, int]:
        return names.index(row["controller"]), COURSES.index(row["course"])

    known = [row for row in rows if row["controller"] in names and row["course"] in COURSES]
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", encoding="utf-8", newline="") as text:
        writer = csv.DictWriter(text, ["controller", "course", *FIGURES], lineterminator="\n")
        writer.writeheader()
        writer.writerows(sorted(known, key=place))


def fly_missing(
    file: Path,
    controllers: Sequence[Controller],
    courses: Sequence[str],
    tell: Callable[[str], None],
    *,
    again: bool = False,
    overrides: Sequence[str] = (),
) -> list[Row]:
    """Fly what is not in the file yet, keep it there, and return all rows.

    A controller that does not exist is left out, and told.
    """
    for controller in controllers:
        for course in courses:
            rows = read_rows(file)
            others = [
                row
                for row in rows
                if (row["controller"], row["course"]) != (controller.name, course)
            ]
            if len(others) < len(rows) and not again:
                continue
            try:
                row = fly_course(controller, course, overrides)
            except ScenarioError as error:
                tell(f"{controller.name}: left out, {str(error).splitlines()[0]}")
                break
            tell(f"{controller.name}, {course}: {_cell(row)}")
            write_rows([*others, row], file)
    return read_rows(file)


def _cell(row: Row) -> str:
    """Return RMS height error / least clearance / CPU of a flight, or how and when it was lost."""
    if row["outcome"] != "flown":
        return f"{row['outcome'].replace('_', ' ')}, {float(row['duration_s']):.0f} s"
    height, clearance, cpu = (
        float(row[name]) if row[name] else float("nan")
        for name in ("height_rms_m", "clearance_min_m", "cpu_ms_per_simulated_s")
    )
    return f"{height:.2g} / {clearance:.2f} / {cpu:.0f}"


def markdown(rows: Sequence[Row]) -> str:
    """Return the table: a line per controller, a column per course."""
    cells = {(row["controller"], row["course"]): _cell(row) for row in rows}
    names = dict.fromkeys(row["controller"] for row in rows)
    lines = [
        f"| controller | {' | '.join(COURSES)} |",
        "|---" * (len(COURSES) + 1) + "|",
        *(
            f"| {name} | {' | '.join(cells.get((name, course), '') for course in COURSES)} |"
            for name in names
        ),
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, keep, print."""
    from argparse import ArgumentParser

    parser = ArgumentParser(
        prog="python -m paper.flights", description="fly every controller over every course"
    )
    names = [controller.name for controller in CONTROLLERS]
    parser.add_argument("--controller", action="append", choices=names)
    parser.add_argument("--course", action="append", choices=COURSES)
    parser.add_argument("--again", action="store_true", help="fly what is there already, too")
    parser.add_argument("--rows", type=Path, default=ROWS, help="the file that keeps the flights")
    asked = parser.parse_args(arguments)
    rows = fly_missing(
        asked.rows,
        [one for one in CONTROLLERS if one.name in (asked.controller or names)],
        asked.course or COURSES,
        lambda line: print(line, file=sys.stderr, flush=True),
        again=asked.again,
    )
    print("RMS height error, m / least clearance, m / CPU ms per simulated second\n")
    print(markdown(rows))


if __name__ == "__main__":
    main()
