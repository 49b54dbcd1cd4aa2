"""Every recorded signal, in small charts, by component: what any recording has."""

from collections.abc import Sequence
from html import escape

import numpy as np

from orchestrator.report.charts import Chart, Line, Section
from orchestrator.report.conduct import TIME, chart
from orchestrator.report.subject import Subject

MOST_CHARTS = 200
MOST_ELEMENTS = 4  # of an array that are drawn one by one
MOST_TEXTS = 12  # different texts that make a chart


def signals(subjects: Sequence[Subject]) -> list[Section]:
    """Return a section for every component, folded where there is a flight to see."""
    found: dict[str, list[tuple[Subject, str]]] = {}
    for each in subjects:
        for name, signal in each.recording.signals.items():
            notes = each.recording.topics[signal.topic].metadata
            if notes.get("kind") != "parameters" or len(each.recording[name][0]) > 1:
                found.setdefault(name, []).append((each, name))
    charts: dict[str, list[Chart]] = {}
    left_out: dict[str, list[str]] = {}
    drawn = 0
    for name, rows in found.items():
        component, _, variable = name.partition(".")
        made = _chart(variable, rows) if drawn < MOST_CHARTS else None
        if made is None:
            left_out.setdefault(component, []).append(variable)
            charts.setdefault(component, [])
        else:
            charts.setdefault(component, []).append(made)
            drawn += 1
    is_flight = any(each.pose is not None for each in subjects)
    return [
        Section(
            f"Signals of {component}",
            tuple(made),
            _rest(left_out.get(component, [])),
            is_folded=is_flight,
        )
        for component, made in charts.items()
    ]


def _chart(title: str, rows: Sequence[tuple[Subject, str]]) -> Chart | None:
    """Return the chart of one signal in all recordings that have it; None if it cannot be drawn."""
    subject, name = rows[0]
    kinds = {s.recording[each][1].dtype.kind for s, each in rows}
    shapes = {s.recording.signals[each].shape for s, each in rows}
    if not any(len(s.recording[each][0]) for s, each in rows):
        return None
    if kinds <= set("fiub") and shapes == {()}:
        return chart(title, rows)
    if kinds <= set("fiub"):
        lines = [line for s, each in rows for line in _elements(s, each)]
        unit = subject.unit(name)
        return Chart(title, TIME, ("", unit), tuple(lines), link="time") if lines else None
    if kinds == {"O"} and shapes == {()}:
        return _texts(title, rows)
    return None


def _elements(subject: Subject, name: str) -> list[Line]:
    """Return the elements of an array, or of many the least and the largest."""
    times, values = subject.samples(name)
    is_regular = not subject.is_held(name)
    flat = values.reshape(len(times), -1).astype(np.float64)
    if not flat.size:
        return []
    if flat.shape[1] <= MOST_ELEMENTS:
        columns = {f"[{k}]": flat[:, k] for k in range(flat.shape[1])}
    else:
        some = np.where(np.isnan(flat).all(axis=1, keepdims=True), 0.0, flat)
        nothing = np.isnan(flat).all(axis=1)
        least, largest = np.nanmin(some, axis=1), np.nanmax(some, axis=1)
        columns = {
            f"least of {flat.shape[1]}": np.where(nothing, np.nan, least),
            f"largest of {flat.shape[1]}": np.where(nothing, np.nan, largest),
        }
    return [
        Line(text, subject.number, times, y, style=k, kind="steps", is_regular=is_regular)
        for k, (text, y) in enumerate(columns.items())
    ]


def _texts(title: str, rows: Sequence[tuple[Subject, str]]) -> Chart | None:
    """Return a chart of texts, if they are few."""
    samples = [(subject, name, *subject.samples(name)) for subject, name in rows]
    texts = list(dict.fromkeys(str(text) for *_, values in samples for text in values))
    if len(texts) > MOST_TEXTS:
        return None
    number = {text: float(k) for k, text in enumerate(texts)}
    lines = [
        Line(
            title,
            subject.number,
            times,
            np.array([number[str(one)] for one in values]),
            kind="steps",
            is_regular=not subject.is_held(name),
        )
        for subject, name, times, values in samples
    ]
    return Chart(
        title, TIME, ("", ""), tuple(lines), link="time", categories=dict(enumerate(texts))
    )


def _rest(names: Sequence[str]) -> str:
    if not names:
        return ""
    some = ", ".join(f"<code>{escape(name)}</code>" for name in names[:MOST_CHARTS])
    return f"<p class='note'>Recorded, not drawn: {some}{' ...' * (len(names) > MOST_CHARTS)}</p>"
