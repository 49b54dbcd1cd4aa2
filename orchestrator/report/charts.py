"""What a page shows, as data: sections of charts, and charts of lines."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Kind = Literal["line", "steps", "area", "broad", "faint"]


@dataclass(frozen=True)
class Line:
    """One line of a chart.

    Attributes
    ----------
    name : str
        What it shows, beside other lines of the same recording.
    recording : int or None
        Which of the page's recordings it belongs to; None if it is the same for all.
    x, y : (n,)
        In the units of the axes; NaN is a gap.
    time : (n,) s or None
        Of each point, in order, by which charts share a cursor; None where x is the time, and for
        lines that no cursor reads.
    style : int
        Which of the chart's lines it is, whatever the recording: dash pattern, and colour if the
        page has one recording.
    kind : str
        ``steps`` holds a value until the next, ``area`` is filled down to the axis, ``broad`` can
        lie under another line, ``faint`` is not read by the cursor.
    is_regular : bool
        Whether points come at one rate, so that a hole is a gap; what is only told when it changes
        holds until the next.
    """

    name: str
    recording: int | None
    x: Array
    y: Array
    time: Array | None = None
    style: int = 0
    kind: Kind = "line"
    is_regular: bool = True


@dataclass(frozen=True)
class Mark:
    """A labelled point; without x a limit, and where y is beyond it: above or below."""

    text: str
    x: float | None = None
    y: float | None = None
    recording: int | None = None
    is_upper: bool = True


@dataclass(frozen=True)
class Picture:
    """A PNG image behind a chart's lines, and its edges on the axes."""

    png: bytes
    left: float
    right: float
    bottom: float
    top: float


@dataclass(frozen=True)
class Chart:
    """A chart.

    Attributes
    ----------
    x, y : tuple of str
        Name and unit of each axis.
    link : str
        Charts of the same link zoom together in x.
    categories : mapping
        Text of each value of y, where values are but names.
    extent : (left, right, bottom, top) or None
        Of a map: both axes have the same scale.
    is_log : bool
        Whether the y axis is logarithmic; all values are positive.
    """

    title: str
    x: tuple[str, str]
    y: tuple[str, str]
    lines: tuple[Line, ...]
    marks: tuple[Mark, ...] = ()
    link: str = ""
    categories: Mapping[int, str] = field(default_factory=dict[int, str])
    extent: tuple[float, float, float, float] | None = None
    picture: Picture | None = None
    north_deg: float | None = None
    note: str = ""
    is_wide: bool = False
    is_log: bool = False


@dataclass(frozen=True)
class Section:
    """A headed part of the page: charts, then ready HTML; folded parts open on demand."""

    title: str
    charts: tuple[Chart, ...] = ()
    html: str = ""
    is_folded: bool = False
