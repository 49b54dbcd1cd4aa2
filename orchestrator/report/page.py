"""Put a page together: sections, data, style and script in one file."""

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from orchestrator.recording.whole import whole
from orchestrator.report.charts import Chart, Section
from orchestrator.report.conduct import controls, optimiser, tracking
from orchestrator.report.course import course
from orchestrator.report.pack import description, pack
from orchestrator.report.signals import signals
from orchestrator.report.subject import Subject, subjects
from orchestrator.report.words import differences, events, figures, scenario, versions

SUMMARY = (figures, differences, course, tracking, controls, optimiser, events)
APPENDIX = (scenario, versions)
MOST_EVENT_LINES = 60
MOST_RECORDINGS = 21  # three kinds of dots in seven colours: charts.js


def write_page(recordings: Sequence[Path], out: Path) -> None:
    """Write the page of recordings.

    Raises
    ------
    OSError
        If a recording cannot be read or the page not be written.
    ValueError
        If a recording is damaged, there are more than can be told apart, or `out` is not a page's
        name.
    """
    if out.suffix not in (".html", ".htm"):
        what = f"not a page's name, got {out.name!r}, expected one that ends in '.html'"
        raise ValueError(f"{out}: {what}")
    if len(recordings) > MOST_RECORDINGS:
        what = f"too many recordings to tell apart, got {len(recordings)}"
        raise ValueError(f"{out}: {what}, expected at most {MOST_RECORDINGS}")
    text = page(subjects(recordings))
    with whole(out, *recordings) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def page(subjects: Sequence[Subject]) -> str:
    """Return the page of recordings as HTML; what a recording lacks is left out."""
    sections = [made for make in SUMMARY if (made := make(subjects)) is not None]
    sections += [*signals(subjects), *(make(subjects) for make in APPENDIX)]
    charts = [chart for section in sections for chart in section.charts]
    data = {
        "recordings": [each.label for each in subjects],
        "events": [
            {"t": event.time_s, "text": f"{event.kind} {event.message}", "recording": each.number}
            for each in subjects
            for event in each.recording.events[:MOST_EVENT_LINES]
            if event.kind != "end"
        ],
        **pack(charts),
    }
    body: list[str] = []
    first = 0
    for k, section in enumerate(sections):
        body.append(_section(section, k, first, [each.label for each in subjects]))
        first += len(section.charts)
    titles = list(dict.fromkeys(str(each.recording.scenario.get("title", "")) for each in subjects))
    here = files("orchestrator.report")
    return Template(here.joinpath("page.html").read_text("utf-8")).substitute(
        title=escape(titles[0] if len(titles) == 1 else f"{len(subjects)} recordings compared"),
        lead=_lead(subjects),
        contents="".join(
            f"<a href='#s{k}'>{escape(section.title)}</a>"
            for k, section in enumerate(sections)
            if not section.is_folded
        ),
        sections="".join(body),
        style=here.joinpath("page.css").read_text("utf-8"),
        script=here.joinpath("charts.js").read_text("utf-8"),
        data=json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
    )


def _lead(subjects: Sequence[Subject]) -> str:
    """Return who is on the page; several can be switched on and off."""
    if len(subjects) == 1:
        recording = subjects[0].recording
        seed, version = (recording.provenance.get(k, "") for k in ("seed", "version.hedgehop"))
        text = f"{recording.path.name} · seed {seed} · hedgehop {version}"
        return f"<p class='lead'>{escape(text)}</p>"
    buttons = "".join(
        f"<button type='button' aria-pressed='true' data-recording='{each.number}'>"
        f"{escape(each.label)}</button>"
        for each in subjects
    )
    return f"<p class='recordings'>{buttons}</p>"


def _section(section: Section, number: int, first: int, labels: Sequence[str]) -> str:
    """Return a section; its charts are numbered from `first`."""
    figures = "".join(
        _figure(chart, first + k, description(chart, labels))
        for k, chart in enumerate(section.charts)
    )
    inside = f"<div class='charts'>{figures}</div>" if figures else ""
    title = escape(section.title)
    if section.is_folded:
        content = f"<details><summary><h2>{title}</h2></summary>{inside}{section.html}</details>"
    else:
        content = f"<h2>{title}</h2>{inside}{section.html}"
    return f"<section id='s{number}'>{content}</section>\n"


def _figure(chart: Chart, number: int, text: str) -> str:
    unit = f" <small>{escape(chart.y[1])}</small>" if chart.y[1] and not chart.categories else ""
    note = f"<p class='note'>{escape(chart.note)}</p>" if chart.note else ""
    wide = " class='wide'" if chart.is_wide else ""
    return (
        f"<figure{wide} data-chart='{number}'><figcaption>{escape(chart.title)}{unit}"
        f"<output></output></figcaption>"
        f"<ul></ul><div class='plot' role='img' tabindex='0' aria-label='{escape(text)}'></div>"
        f"{note}</figure>"
    )
