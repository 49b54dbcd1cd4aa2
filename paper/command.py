"""The commands ``hedgehop paper`` and ``hedgehop learn-basis``."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

from cyclopts import Parameter

from orchestrator.errors import Problem, ScenarioError
from paper.study import Study

MODULES = (
    "bases", "responses", "ranks", "minimum_cost", "computing_time", "altitude_step",
    "sensitivities", "learned_basis",
)  # fmt: skip
"""The studies in the order of the paper; each has ``FIGURES`` and ``study``."""
NEEDED = {"matplotlib": "matplotlib", "casadi": "casadi", "markdown_it": "markdown-it-py"}
VERSIONS = (
    "hedgehop", "numpy", "scipy", "numba", "cvxpy", "daqp", "piqp", "clarabel", "osqp", "casadi",
    "matplotlib",
)  # fmt: skip


def paper(
    *,
    figure: Annotated[int | None, Parameter(name="--figure")] = None,
    quick: Annotated[bool, Parameter(name="--quick", negative="")] = False,
    out: Annotated[Path, Parameter(name=("--out", "-o"))] = Path("paper-report"),
) -> None:
    """Run the seed paper's studies again and write a report: every figure, every claim.

    Parameters
    ----------
    figure
        Only the study of this figure of the paper, 1 to 8; the report then holds only that.
    quick
        Fewer points: minutes in place of half an hour.
    out
        The folder to write to: report.html, report.md, figures as PNG and SVG, data as CSV.
    """
    missing = [name for module, name in NEEDED.items() if find_spec(module) is None]
    if missing:
        how = f"`pip install {' '.join(missing)}`"
        what = f"paper: got no {' and no '.join(missing)}, expected {how}"
        raise ScenarioError([Problem((), what)])
    modules = [import_module(f"paper.{name}") for name in MODULES]
    if figure is not None:
        chosen = [module for module in modules if figure in module.FIGURES]
        if not chosen:
            known = sorted({number for module in modules for number in module.FIGURES})
            what = f"--figure: not of the paper, got {figure}, expected one of {known}"
            raise ScenarioError([Problem((), what)])
        modules = chosen
    with _writing(out):
        out.mkdir(parents=True, exist_ok=True)
    _run(modules, out, quick=quick)
    print(f"{out / 'report.html'}: written")


def learn_basis(
    *,
    out: Annotated[Path, Parameter(name=("--out", "-o"))],
    form: Literal["attitude", "actuator"] = "attitude",
    seed: int = 0,
    altitude_weight: float | None = None,
    heading_weight: float | None = None,
) -> None:
    """Learn a control basis from optimal moves, for `basis: learned` of the controller.

    Parameters
    ----------
    out
        The file to write, .npz.
    form
        Of the commands: set-points of the attitude stabiliser, or actuators.
    seed
        Of the training set.
    altitude_weight, heading_weight
        Of the cost; the controller's own, if not given.
    """
    from paper.learn import FLOWN, write_basis

    given = (None, None, altitude_weight, heading_weight, None)
    x, y, z, heading, speed = (w if g is None else g for w, g in zip(FLOWN, given, strict=True))
    with _writing(out):
        write_basis(out, form, seed, Q=(x, y, z, heading, speed), progress=_progress(f"{out}"))
    print(f"{out}: written")


def _run(modules: list[ModuleType], out: Path, *, quick: bool) -> None:
    """Run studies and write their report, also if one of them fails: nothing is lost."""
    from paper.report import write_report

    settings = {
        "studies": "quick: fewer points" if quick else "full",
        "helicopter": "Yamaha R-50, 17 states, Runge-Kutta with 2 substeps per 50 ms sample",
        "threads": "one; times are of the CPU",
    }
    versions = _versions()
    studies: list[Study] = []
    try:
        for number, module in enumerate(modules, 1):
            name = module.__name__.rpartition(".")[2]
            show = _progress(f"{number}/{len(modules)} {name.replace('_', ' ')}")
            show("begun")
            studies.append(module.study(quick, show))
    finally:
        if studies:
            with _writing(out):
                write_report(studies, out, settings=settings, versions=versions)


@contextmanager
def _writing(out: Path) -> Generator[None]:
    """Take what cannot be written as the user's to mend."""
    try:
        yield
    except OSError as error:
        what = f"{out}: cannot be written, {error.strerror or error}"
        raise ScenarioError([Problem((), what)]) from error


def _progress(study: str) -> Callable[[str], None]:
    """Return what tells of a step on stderr."""
    return lambda what: print(f"{study}: {what}", file=sys.stderr, flush=True)


def _versions() -> dict[str, str]:
    numbers = sys.version_info
    return {
        "python": f"{numbers.major}.{numbers.minor}",
        **{name: version(name) for name in VERSIONS},
    }
