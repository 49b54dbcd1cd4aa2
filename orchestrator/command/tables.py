"""What the command line prints, as rich tables."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from orchestrator.figures.metrics import mb_per_min
from orchestrator.scenario.wording import expected, keys, show, unit_of

if TYPE_CHECKING:
    from orchestrator.conformance.check import Clause

FIGURES = {  # metric: what the closing table calls it, format
    "clearance_min_m": ("minimum clearance", "{:.2f} m"),
    "height_rms_m": ("height error, RMS", "{:.3f} m"),
    "height_p95_m": ("height error, 95 %", "{:.3f} m"),
    "agl_rms_m": ("height above ground error, RMS", "{:.3f} m"),
    "cross_track_rms_m": ("cross-track error, RMS", "{:.3f} m"),
    "speed_rms_mps": ("speed error, RMS", "{:.3f} m/s"),
    "heading_max_deg": ("heading deviation, largest", "{:.1f} deg"),
    "load_factor_min": ("load factor, least", "{:.2f} G"),
    "load_factor_max": ("load factor, largest", "{:.2f} G"),
    "saturation_percent": ("control saturation", "{:.1f} %"),
    "update_ms_median": ("update time, median", "{:.2f} ms"),
    "update_ms_p99": ("update time, 99 %", "{:.2f} ms"),
    "deadline_misses": ("deadline misses", "{}"),
    "cpu_ms_per_simulated_s": ("CPU per simulated second", "{:.1f} ms"),
}


def flight_table(metrics: Mapping[str, Any], recording: Path | None) -> Table:
    """Return the closing table of a run; figures without a source are left out."""
    table = empty_table()
    table.add_column("figure")
    table.add_column("value", justify="right")
    outcome = f"{metrics['outcome']} after {metrics['duration_s']:g} s"
    table.add_row("outcome", outcome)
    if metrics["reason"]:
        table.add_row("reason", metrics["reason"])
    for name, (text, form) in FIGURES.items():
        if metrics.get(name) is not None:
            table.add_row(text, form.format(metrics[name]))
    for rung, count in (metrics.get("ladder") or {}).items():
        table.add_row(f"ladder: {rung}", f"{count}")
    for name, count in (metrics.get("faults") or {}).items():
        table.add_row(fault(name), f"{count}")
    if recording is not None:
        size = recording.stat().st_size
        rate = mb_per_min(size, metrics["duration_s"])
        per_minute = "" if rate is None else f", {rate:.3g} MB per flight minute"
        table.add_row("recording", f"{recording}, {size / 1e6:.3g} MB{per_minute}")
    return table


def fault(name: str) -> str:
    """Return what the table calls a kind of fault of a component.

    >>> fault("out_of_range.mpc")
    'out of range: mpc'
    """
    kind, _, component = name.partition(".")
    return f"{kind.replace('_', ' ')}: {component}"


def parameters_table(schema: Mapping[str, Any]) -> Table:
    """Return a component's parameters, from the JSON Schema of its dataclass."""
    table = empty_table()
    for heading in ("name", "unit", "default", "expected", "meaning"):
        table.add_column(heading, overflow="fold")
    needed = schema.get("required", ())
    for name, one in keys(schema, schema).items():
        table.add_row(
            name,
            unit_of(name) or "",
            show(one["default"]) if "default" in one else "required" if name in needed else "...",
            expected(one, schema),
            one.get("description", ""),
        )
    return table


def components_table(rows: Iterable[tuple[str, str, str]]) -> Table:
    """Return the installed components: name, where they are, what they are."""
    table = empty_table()
    for heading in ("name", "use", "meaning"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def clauses_table(clauses: "Iterable[Clause]") -> Table:
    """Return what became of every clause of the contract."""
    table = empty_table()
    for heading in ("clause", "verdict", "promise", "detail"):
        table.add_column(heading, overflow="fold")
    for clause in clauses:
        style = {"passed": "green", "failed": "bold red"}.get(clause.verdict)
        table.add_row(clause.name, Text(clause.verdict, style or ""), clause.promise, clause.detail)
    return table


def recording_table(info: Mapping[str, Any]) -> Table:
    """Return the topics of a recording."""
    table = empty_table()
    for heading in ("topic", "message", "count", "Hz", "variables"):
        table.add_column(heading, overflow="fold")
    for topic in info["topics"]:
        rate = topic["rate_hz"]
        table.add_row(
            topic["topic"],
            topic["message"],
            f"{topic['count']}",
            "" if rate is None else f"{rate:.3g}",
            f"{len(topic['units'])}",
        )
    return table


def empty_table() -> Table:
    """Return a table without columns, in the style of all that are printed."""
    return Table(box=None, pad_edge=False, header_style="bold")
