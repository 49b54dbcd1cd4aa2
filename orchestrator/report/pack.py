"""Charts as plain data for the page's script; numbers as base64 of little-endian float32."""

from base64 import b64encode
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.report.charts import Array, Chart, Line, Mark

MOST_POINTS = 4000  # of a line
FEWEST_POINTS = 64
ALL_POINTS = 120_000  # of a recording's lines: with x and y of 4 bytes, 1.3 MB as base64
HOLE = 2.5  # periods between two points of a regular rate that are more than one late


def pack(charts: Sequence[Chart]) -> dict[str, Any]:
    """Return ``{"charts": [...], "arrays": [...]}``; a chart's numbers are indices of arrays."""
    arrays: dict[str, int] = {}

    def index(values: Array | None) -> int | None:
        if values is None:
            return None
        with np.errstate(over="ignore"):  # what float32 cannot hold is a gap
            text = b64encode(values.astype("<f4").tobytes()).decode()
        return arrays.setdefault(text, len(arrays))

    limits = _limits(line for chart in charts for line in chart.lines)
    packed = [_chart(chart) for chart in charts]
    for plain, chart in zip(packed, charts, strict=True):
        for line in chart.lines:
            is_whole = line.kind == "faint"  # many lines in one, which is short enough
            kept = thinned(line.y, len(line.y) if is_whole else limits[line.recording])
            x, y, time = _broken(line, kept, chart.link == "time")
            plain["lines"].append(
                {
                    "name": line.name,
                    "recording": line.recording,
                    "style": line.style,
                    "kind": line.kind,
                    "x": index(x),
                    "y": index(y),
                    "t": index(time),
                }
            )
    return {"charts": packed, "arrays": list(arrays)}


def thinned(values: Array, limit: int) -> NDArray[np.intp]:
    """Return which samples to keep: at most `limit`, among them the least and largest of each run.

    Every run of ``2 n / limit`` samples keeps its extremes where they are, so that no peak is lost.
    """
    n = len(values)
    if n <= limit:
        return np.arange(n)
    run = -(-n // (limit // 2 - 1))
    starts = np.arange(0, n, run)
    padded = np.full(len(starts) * run, np.nan)
    padded[:n] = values
    rows = padded.reshape(-1, run)
    unknown = np.isnan(rows)
    least = np.argmin(np.where(unknown, np.inf, rows), axis=1)
    largest = np.argmax(np.where(unknown, -np.inf, rows), axis=1)
    return np.unique(np.concatenate([[0], starts + least, starts + largest, [n - 1]]))


def holes(times: Array) -> Array:
    """Return when points of a regular rate begin and cease to be missing, in order.

    Most steps between points of a regular rate are alike, and a hole lacks two points or more.
    """
    steps = np.diff(times)
    if not len(steps):
        return steps
    period = np.median(steps)
    if period <= 0.0 or np.mean(np.abs(steps - period) <= 0.1 * period) < 0.5:
        return np.empty(0)
    last = np.flatnonzero(steps > HOLE * period)
    return np.stack([times[last] + period, times[last + 1] - period], axis=1).ravel()


def description(chart: Chart, labels: Sequence[str]) -> str:
    """Return what a chart shows in words, for those who do not see it."""
    x, y = (f"{name}, {unit}" if unit else name for name, unit in (chart.x, chart.y))
    parts = [f"{chart.title}: {y} over {x}"]
    for line in chart.lines:
        known = line.y[np.isfinite(line.y)]
        if line.kind != "faint" and len(known):
            number = line.recording
            who = "" if number is None or len(labels) == 1 else f"{labels[number]}, "
            parts.append(f"{who}{line.name} from {known.min():.4g} to {known.max():.4g}")
    parts += [mark.text for mark in chart.marks]
    return "; ".join(parts)


def _broken(
    line: Line, kept: NDArray[np.intp], is_timed: bool
) -> tuple[Array, Array, Array | None]:
    """Return x, y and time of the kept points, and points without y around every hole."""
    time = line.x if is_timed else line.time
    missing = holes(time) if line.is_regular and time is not None else np.empty(0)
    x, y = line.x[kept], line.y[kept]
    if time is None or not len(missing):
        return x, y, None if line.time is None else line.time[kept]
    at = np.searchsorted(time[kept], missing)
    x = np.insert(x, at, np.interp(missing, time, line.x))
    y = np.insert(y, at, np.nan)
    return x, y, None if line.time is None else np.insert(line.time[kept], at, missing)


def _limits(lines: Iterable[Line]) -> dict[int | None, int]:
    """Return how many points a line of each recording may have."""
    lengths: dict[int | None, list[int]] = {}
    for line in lines:
        lengths.setdefault(line.recording, []).append(len(line.y))
    limits: dict[int | None, int] = {}
    for recording, each in lengths.items():
        limit = MOST_POINTS
        while limit > FEWEST_POINTS and sum(min(n, limit) for n in each) > ALL_POINTS:
            limit //= 2
        limits[recording] = limit
    return limits


def _chart(chart: Chart) -> dict[str, Any]:
    picture = chart.picture
    return {
        "title": chart.title,
        "x": chart.x,
        "y": chart.y,
        "link": chart.link,
        "categories": chart.categories,
        "extent": chart.extent,
        "north": chart.north_deg,
        "log": chart.is_log,
        "marks": [_mark(mark) for mark in chart.marks],
        "picture": picture
        and {
            "href": "data:image/png;base64," + b64encode(picture.png).decode(),
            "extent": [picture.left, picture.right, picture.bottom, picture.top],
        },
        "lines": [],
    }


def _mark(mark: Mark) -> dict[str, Any]:
    return {
        "text": mark.text,
        "x": mark.x,
        "y": mark.y,
        "recording": mark.recording,
        "upper": mark.is_upper,
    }
