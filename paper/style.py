"""How figures look, and how they are written: the same numbers give the same bytes."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from paper.study import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""After Okabe and Ito: told apart by everyone, on screen and on paper."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (2, 1)))
"""Beside the colour, so that lines are told apart without it."""
INK, RULE, GROUND = "#1B1F24", "#D9DDE2", "#FFFFFF"

SETTINGS: Mapping[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": GROUND,
    "figure.facecolor": GROUND,
    "figure.dpi": 150.0,
    "grid.color": RULE,
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.0,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "figure.constrained_layout.use": True,
    "svg.fonttype": "path",  # the same on a machine without the font
}


def line(number: int) -> dict[str, Any]:
    """Return colour and dashes of the ``number``-th line of a figure, for ``plot``."""
    return {"color": COLOURS[number % 7], "linestyle": DASHES[number % 7]}


def marked(number: int) -> dict[str, Any]:
    """Return :func:`line` with a marker, for lines through few points."""
    return {**line(number), "marker": MARKERS[number % 7]}


def write_figure(figure: Figure, folder: Path) -> None:
    """Write a figure as PNG and SVG, and its data as CSV.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Picture

    write_csv(figure.table, folder / f"{figure.name}.csv")
    settings: Any = {**mpl.rcParamsDefault, **SETTINGS, "svg.hashsalt": figure.name}
    with mpl.rc_context(settings):
        picture = Picture(figsize=figure.size_in)
        figure.draw(picture)
        png, svg = (folder / f"{figure.name}.{kind}" for kind in ("png", "svg"))
        FigureCanvasAgg(picture).print_png(png, metadata={"Software": None})
        undated = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        FigureCanvasSVG(picture).print_svg(svg, metadata=undated)


def write_csv(columns: Mapping[str, Sequence[Any]], file: Path) -> None:
    """Write columns of equal length under their names; a float is read back as it was.

    Raises
    ------
    ValueError
        If the columns' lengths differ.
    OSError
        If the file cannot be written.
    """
    rows = list(plain_rows(columns))
    with file.open("w", encoding="utf-8", newline="") as text:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def plain_rows(columns: Mapping[str, Sequence[Any]]) -> Iterable[tuple[Any, ...]]:
    """Return the rows of columns as Python's own numbers and words.

    Raises
    ------
    ValueError
        If the columns' lengths differ.
    """
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"table: columns of different lengths, got {lengths}, expected one length")
    return zip(*(map(_plain, column) for column in columns.values()), strict=True)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
