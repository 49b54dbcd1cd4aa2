"""What a page says in words and tables: figures, events, the scenario, versions."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import yaml

from orchestrator.command.tables import FIGURES, fault
from orchestrator.figures.omissions import omissions
from orchestrator.report.charts import Section
from orchestrator.report.subject import Subject

MOST_EVENTS = 200


def figures(subjects: Sequence[Subject]) -> Section:
    """Return the closing table, a column for each recording."""
    rows: list[tuple[str, list[str]]] = [
        ("outcome", [_outcome(each.figures) for each in subjects]),
        ("reason", [escape(str(each.figures["reason"])) for each in subjects]),
        ("simulated time", [f"{each.end_s:g} s" for each in subjects]),
    ]
    for name, (text, form) in FIGURES.items():
        rows.append((text, [_figure(each.figures.get(name), form) for each in subjects]))
    rows.append(("optimiser's ladder", [_ladder(each.figures["ladder"]) for each in subjects]))
    faults = [each.figures["faults"] for each in subjects]
    names = dict.fromkeys(name for each in faults for name in each)
    rows += [(fault(n), [f"{each.get(n, 0)}" for each in faults]) for n in names]
    rows = [(text, cells) for text, cells in rows if any(cells)]
    said = [(each, text) for each in subjects for text in omissions(each.recording)]
    notes = "".join(
        f"<p class='note'>{escape(f'{each.label}: ' * (len(subjects) > 1) + text)}</p>"
        for each, text in said
    )
    if len(subjects) == 1:
        tiles = "".join(
            f"<div><dt>{escape(text)}</dt><dd>{cells[0]}</dd></div>" for text, cells in rows
        )
        return Section("Figures", html=f"<dl>{tiles}</dl>{notes}")
    table = _table(["", *(each.label for each in subjects)], rows, subjects)
    return Section("Figures", html=table + notes)


def differences(subjects: Sequence[Subject]) -> Section | None:
    """Return what the scenarios do not have in common."""
    if len(subjects) < 2:
        return None
    flat = [dict(_flat(each.recording.scenario)) for each in subjects]
    keys = list(dict.fromkeys(key for one in flat for key in one))
    rows = [
        (key, [escape(str(one.get(key, "not given"))) for one in flat])
        for key in keys
        if len({str(one.get(key)) for one in flat}) > 1
    ]
    if not rows:
        return Section("Differences", html="<p>All were made from the same scenario.</p>")
    return Section("Differences", html=_table(["", *(s.label for s in subjects)], rows, subjects))


def events(subjects: Sequence[Subject]) -> Section | None:
    """Return what happened, in order of time."""
    happened = sorted(
        ((event, each) for each in subjects for event in each.recording.events),
        key=lambda pair: pair[0].time_s,
    )
    if not happened:
        return None
    several = len(subjects) > 1
    rows = [
        (
            f"{event.time_s:.2f} s",
            [
                *([escape(each.label)] if several else []),
                *(escape(text) for text in (event.kind, event.component, event.message)),
            ],
        )
        for event, each in happened[:MOST_EVENTS]
    ]
    heads = ["time", *(["recording"] if several else []), "kind", "component", "message"]
    more = len(happened) - len(rows)
    note = f"<p class='note'>{more} more are in the recordings.</p>" if more else ""
    return Section("Events", html=_table(heads, rows) + note)


def scenario(subjects: Sequence[Subject]) -> Section:
    """Return the resolved scenarios, folded."""
    parts: list[str] = []
    for each in subjects:
        text = yaml.safe_dump(dict(each.recording.scenario), sort_keys=False, allow_unicode=True)
        head = f"<h3>{escape(each.label)}</h3>" if len(subjects) > 1 else ""
        parts.append(f"{head}<pre>{escape(text)}</pre>")
    return Section("Resolved scenario", html="".join(parts), is_folded=True)


def versions(subjects: Sequence[Subject]) -> Section:
    """Return where the recordings come from, folded."""
    keys = dict.fromkeys(key for each in subjects for key in each.recording.provenance)
    rows = [
        (key, [f"<code>{escape(s.recording.provenance.get(key, ''))}</code>" for s in subjects])
        for key in keys
    ]
    html = _table(["", *(s.label for s in subjects)], rows, subjects)
    return Section("Versions and origin", html=html, is_folded=True)


def _outcome(figures: Mapping[str, Any]) -> str:
    outcome = str(figures["outcome"]) or "unfinished"
    mark, kind = ("✓", "good") if outcome == "flown" else ("✕", "bad")
    return f"<span class='{kind}'>{mark} {escape(outcome)}</span>"


def _ladder(counts: Mapping[str, int] | None) -> str:
    return ", ".join(f"{n} × {escape(rung)}" for rung, n in (counts or {}).items() if n)


def _figure(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value).replace("-", "−")


def _flat(value: Any, path: str = "") -> Iterable[tuple[str, Any]]:
    """Yield the leaves of nested mappings by dotted key; of lists of mappings, what is in them."""
    if isinstance(value, Mapping):
        for key, one in value.items():
            yield from _flat(one, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
        for one in value:
            yield f"{path}: {', '.join(f'{k} {v}' for k, v in one.items() if v)}", "✓"
    else:
        yield path, value


def _table(
    heads: Sequence[str],
    rows: Iterable[tuple[str, Sequence[str]]],
    subjects: Sequence[Subject] = (),
) -> str:
    """Return a table; the cells are HTML. Columns of recordings carry their line.

    Every cell knows its column's head: on a phone it stands beside it.
    """
    several = len(subjects) > 1
    head = "".join(
        f"<th scope='col'{f' data-recording={k - 1}' if several and k else ''}>{escape(text)}</th>"
        for k, text in enumerate(heads)
    )
    body = "".join(
        f"<tr><th scope='row'>{escape(first).replace('.', '.<wbr>')}</th>"
        + "".join(
            f"<td data-head='{escape(text)}'>{cell}</td>"
            for text, cell in zip(heads[1:], cells, strict=True)
        )
        + "</tr>"
        for first, cells in rows
    )
    numbers = " class='numbers'" if subjects else ""
    table = f"<table{numbers}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div class='scroll'>{table}</div>"
