"""The report of studies: Markdown with its files beside it, and one HTML page that holds all."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from paper.page import page
from paper.study import Claim, Study, Table
from paper.style import plain_rows, write_csv, write_figure

OURS = "ours"
LEAD = """\
*Model Predictive Control in Nap-of-Earth Flight using Polynomial Control Basis Functions* by L. Singh
and T. Lapp, run again on Hedgehop's helicopter: every figure, and what became of every claim. Theirs
is the paper's number, here is ours. `hedgehop paper` writes this report."""
NOT_REPRODUCED = """\
What the paper claims and we did not find, or only in part, with the evidence. Its plant, weights,
optimiser and normalisations are known in outline only, so "does not hold" means: not on this plant,
in none of the readings that were tried."""
BARS = """\
What this project asks of itself, beyond the paper. A bar that is missed says by how much and why."""


def write_report(
    studies: Sequence[Study],
    folder: Path,
    *,
    settings: Mapping[str, str],
    versions: Mapping[str, str],
) -> None:
    """Write ``report.md``, ``report.html``, and beside them every figure and table.

    Parameters
    ----------
    studies : sequence of Study
        In the order of the report.
    folder : Path
        Made if it is not there; files of the same names are replaced.
    settings, versions : mapping
        What the numbers depend on; of no machine, so that two runs can be compared.

    Raises
    ------
    ValueError
        If two figures or tables share a name, or columns differ in length.
    OSError
        If a file cannot be written.
    """
    made = [each for study in studies for each in (*study.figures, *study.tables)]
    names = sorted(each.name for each in made)
    twice = [name for name, other in pairwise(names) if name == other]
    if twice:
        raise ValueError(f"report: two figures or tables named {twice[0]!r}, expected one")
    folder.mkdir(parents=True, exist_ok=True)
    for study in studies:
        for figure in study.figures:
            write_figure(figure, folder)
        for table in study.tables:
            write_csv(table.columns, folder / f"{table.name}.csv")
    text = markdown(studies, settings=settings, versions=versions)
    (folder / "report.md").write_text(text, encoding="utf-8", newline="\n")
    drawn = {
        f"{figure.name}.png": (folder / f"{figure.name}.svg").read_text("utf-8")
        for study in studies
        for figure in study.figures
    }
    (folder / "report.html").write_text(page(text, drawn), encoding="utf-8", newline="\n")


def markdown(
    studies: Sequence[Study], *, settings: Mapping[str, str], versions: Mapping[str, str]
) -> str:
    """Return the report as Markdown; pictures and data are links to files beside it."""
    claims = [claim for study in studies for claim in study.claims]
    theirs = [claim for claim in claims if claim.where != OURS]
    ours = [claim for claim in claims if claim.where == OURS]
    failed = [claim for claim in theirs if claim.verdict in ("does not hold", "holds in part")]
    parts = ["# The seed paper, run again", LEAD]
    if theirs:
        parts += ["## The paper's claims", _claims(theirs)]
    if failed:
        parts += ["## What the paper claims and we could not reproduce", NOT_REPRODUCED]
        parts += ["\n".join(_item(claim) for claim in failed)]
    if ours:
        parts += ["## Our own bars", BARS, _bars(ours)]
    for study in studies:
        parts += [f"## {study.title}", study.text.strip(), *_pictures(study)]
        parts += [part for table in study.tables for part in _table(table)]
    parts += ["## What the numbers depend on", _pairs(settings), _pairs(versions)]
    return "\n\n".join(parts) + "\n"


def _claims(claims: Iterable[Claim]) -> str:
    head = "where", "claim", "verdict", "paper", "here", "why"
    rows = [
        (each.where, each.statement, each.verdict, each.theirs, each.ours, each.reason)
        for each in claims
    ]
    return _grid(head, rows)


def _bars(claims: Iterable[Claim]) -> str:
    rows = [(each.statement, each.verdict, each.ours, each.reason) for each in claims]
    return _grid(("bar", "verdict", "here", "why"), rows)


def _item(claim: Claim) -> str:
    numbers = f"Paper: {claim.theirs or 'no number'}. Here: {claim.ours}."
    return f"* **{claim.statement}** ({claim.where}): {claim.verdict}. {numbers} {claim.reason}"


def _pictures(study: Study) -> Iterable[str]:
    for figure in study.figures:
        name = figure.name
        yield f"### {figure.title}"
        yield f"![{_line(figure.title)}]({name}.png)"
        yield f"{figure.caption.strip()} As [SVG]({name}.svg), data as [CSV]({name}.csv)."


def _table(table: Table) -> tuple[str, str, str]:
    rows = [tuple(map(_short, row)) for row in plain_rows(table.columns)]
    caption = f"{table.caption.strip()} As [CSV]({table.name}.csv)."
    head = [name.replace("_", " ") for name in table.columns]
    return f"### {table.title}", _grid(head, rows), caption


def _pairs(pairs: Mapping[str, str]) -> str:
    return _grid(("what", "value"), list(pairs.items()))


def _grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(_line, cells)) + " |" for cells in lines)


def _line(text: str) -> str:
    """Return text that stays within a cell."""
    return " ".join(text.split()).replace("|", "\\|")


def _short(value: Any) -> str:
    """Return a value as a reader wants it; the CSV has all its digits."""
    if value is None:
        return ""
    return f"{value + 0.0:.4g}" if isinstance(value, float) else str(value)  # no -0
