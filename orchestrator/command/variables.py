"""What `hedgehop inspect` prints of components, recorded ones too."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from rich.table import Table

from orchestrator.assembly.description import Port
from orchestrator.assembly.parameters import TOLD
from orchestrator.command.tables import empty_table
from orchestrator.component import Value
from orchestrator.recording.reader import Recording


def variables_table(ports: Iterable[Port], *, has_fixed: bool = False) -> Table:
    """Return a component's variables; with its fixed parameters too, if asked for."""
    shown = [
        port
        for port in ports
        if port.causality in ("input", "output")
        or port.variability == "tunable"
        or (has_fixed and port.causality == "parameter")
    ]
    columns = {
        **_columns(shown),
        "start": [_start(port.start) for port in shown],
        "range": [_range(port) for port in shown],
        "meaning": [_meaning(port) for port in shown],
    }
    return _table(columns)


def recorded_table(ports: Iterable[Port], recording: Recording) -> Table:
    """Return the variables of a recorded component, with the number of their messages."""
    signals = recording.signals
    shown = [p for p in ports if p.causality in ("input", "output") or str(p) in signals]
    counts = [
        f"{len(recording.topics[signals[str(port)].topic].raw)}"
        if str(port) in signals
        else ("" if port.causality == "input" else "none")
        for port in shown
    ]
    columns = {**_columns(shown), "messages": counts, "meaning": [_meaning(p) for p in shown]}
    return _table(columns)


def feed_through(ports: Iterable[Port]) -> str:
    """Return which groups of inputs act on which groups of outputs at the same instant.

    Empty where none does.
    """
    passed: dict[tuple[str, ...], list[str]] = {}
    for port in ports:
        if port.causality == "output" and port.depends_on:
            inputs = tuple(sorted({_group(name) for name in port.depends_on}))
            outputs = passed.setdefault(inputs, [])
            if _group(port.name) not in outputs:
                outputs.append(_group(port.name))
    return "; ".join(f"{', '.join(ins)} -> {', '.join(outs)}" for ins, outs in passed.items())


def resources(injected: Mapping[str, bool]) -> str:
    """Return the resources that a constructor takes, as a scenario writes them."""
    return ", ".join(
        f'{name}: "${{...}}"' + ("" if is_required else " (optional)")
        for name, is_required in injected.items()
        if name not in TOLD
    )


def _group(name: str) -> str:
    return name.rpartition(".")[0] or name


def _columns(ports: Sequence[Port]) -> dict[str, list[str]]:
    return {
        "name": [port.name for port in ports],
        "causality": ["tunable" if p.variability == "tunable" else p.causality for p in ports],
        "type": [port.type for port in ports],
        "shape": [" x ".join(map(str, port.shape)) for port in ports],
        "unit": [port.unit.name if port.unit else "" for port in ports],
    }


def _start(value: Value | None) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.flat[0]} ..." if value.size else ""
    return "" if value is None else f"{value}"


def _range(port: Port) -> str:
    if port.min is not None and port.max is not None:
        return f"{port.min:g} to {port.max:g}"
    if port.min is not None:
        return f">= {port.min:g}"
    return "" if port.max is None else f"<= {port.max:g}"


def _meaning(port: Port) -> str:
    items = ", ".join(port.items.values())
    return port.description + (f": {items}" if items else "")


def _table(columns: Mapping[str, Sequence[str]]) -> Table:
    """Return a table of the columns that say something."""
    table = empty_table()
    said = {heading: cells for heading, cells in columns.items() if any(cells)}
    for heading in said:
        table.add_column(heading, overflow="fold")
    for row in zip(*said.values(), strict=True):
        table.add_row(*row)
    return table
