"""A recording as one table, a row for every instant: for spreadsheets, PlotJuggler, data frames."""

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib import import_module
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from orchestrator.errors import nearest
from orchestrator.recording.messages import Signal, column
from orchestrator.recording.reader import Recording
from orchestrator.recording.whole import whole

LONGEST = 16  # elements of an array that become columns of their own without being asked for


@dataclass(frozen=True)
class Series:
    """A signal in a table: what it was at some of its rows, ``values`` (n, *shape) at ``rows``."""

    signal: Signal
    rows: NDArray[np.int64]
    values: NDArray[Any]


def convert(
    path: Path, to: Literal["csv", "parquet", "rrd"], out: Path, patterns: Sequence[str] | None
) -> list[str]:
    """Write a recording to ``out`` in another form, and return notes on what is not in it.

    csv and parquet hold one table. Its first column is ``time_s``; a row is there for every instant
    at which anything was recorded, and what was not recorded then is empty: nothing is filled in.
    An enumeration is its number, its texts are beside its name.

    Parameters
    ----------
    patterns
        Of the signals in a table, as of :mod:`fnmatch`; None: all outputs and inputs, in csv but
        for arrays of more than 16 elements.

    Raises
    ------
    OSError, ValueError
        If the recording cannot be read or ``out`` not be written, a pattern fits no signal, or what
        writes the form is not installed.
    """
    recording = Recording.open(path)
    if to == "rrd":
        if patterns is not None:
            raise ValueError("--signals: not possible with rrd, expected csv or parquet")
        rrd = _needing("rerun-sdk", "orchestrator.viewing.rrd")
        with whole(out, path) as partial:
            rrd.write_rrd(recording, partial)
        return []
    chosen, notes = _chosen(recording, patterns, LONGEST if to == "csv" else None)
    times_ns, table = _table(recording, chosen)
    with whole(out, path) as partial:
        (_write_csv if to == "csv" else _write_parquet)(partial, times_ns, table)
    return notes


def _chosen(
    recording: Recording, patterns: Sequence[str] | None, longest: int | None
) -> tuple[list[Signal], list[str]]:
    """Return the signals of a table, and notes on those left out without being named."""
    if patterns is not None:
        for pattern in patterns:
            if not any(fnmatchcase(name, pattern) for name in recording.names):
                near = nearest(pattern, recording.names)
                raise ValueError(
                    f"--signals: no such signal, got {pattern!r}, expected a pattern that fits{near}"
                )
        fits = (s for s in recording.signals.values() if _fits(s.name, patterns))
        return list(fits), []
    series = [
        signal
        for signal in recording.signals.values()
        if recording.topics[signal.topic].metadata["kind"] != "parameters"
    ]
    long = [s for s in series if longest is not None and prod(s.shape) > longest]
    names = ", ".join(f"{s.name}[{prod(s.shape)}]" for s in long)
    notes = [f"long arrays left out, --signals takes them in: {names}"] if long else []
    return [signal for signal in series if signal not in long], notes


def _fits(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _table(
    recording: Recording, signals: Sequence[Signal]
) -> tuple[NDArray[np.int64], list[Series]]:
    """Return all instants, ns, and every signal at its rows."""
    columns = [column(recording.topics[signal.topic], signal) for signal in signals]
    times = [times for times, _ in columns]
    instants = np.unique(np.concatenate(times)) if times else np.empty(0, np.int64)
    return instants, [
        Series(signal, np.searchsorted(instants, times), values)
        for signal, (times, values) in zip(signals, columns, strict=True)
    ]


def _write_csv(out: Path, times_ns: NDArray[np.int64], table: Sequence[Series]) -> None:
    """Write numbers so that they come back bit by bit, truth as 1 and 0, bytes in hexadecimal."""
    columns = [("time_s", [repr(time / 1e9) for time in times_ns.tolist()])]
    columns += [each for series in table for each in _texts(series, len(times_ns))]
    with out.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([heading for heading, _ in columns])
        writer.writerows(zip(*(cells for _, cells in columns), strict=True))


def _texts(series: Series, n: int) -> Iterator[tuple[str, list[str]]]:
    """Yield the columns of a signal, one for every element: heading, and texts of all rows."""
    signal, rows = series.signal, series.rows.tolist()
    flat = series.values.reshape(len(rows), prod(signal.shape))
    for k, index in enumerate(product(*map(range, signal.shape))):
        cells = [""] * n
        for row, value in zip(rows, flat[:, k].tolist(), strict=True):
            cells[row] = _text(value)
        element = "".join(f"[{i}]" for i in index)
        yield f"{signal.name}{element}{_unit(signal)}", cells


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, bytes):
        return value.hex()
    return repr(value) if isinstance(value, float) else str(value)


def _unit(signal: Signal) -> str:
    """Return what stands behind the name in a heading: the unit, or what the numbers mean."""
    items = " ".join(f"{number}={text}" for number, text in signal.items.items())
    unit = items or ("" if signal.unit == "1" else signal.unit)
    return f" [{unit}]" if unit else ""


def _write_parquet(out: Path, times_ns: NDArray[np.int64], table: Sequence[Series]) -> None:
    """Write arrays as lists of fixed size; unit, shape and items are in the columns' metadata."""
    pa = _needing("pyarrow", "pyarrow")
    parquet = import_module("pyarrow.parquet")
    fields, columns = [pa.field("time_s", pa.float64(), metadata={"unit": "s"})], [times_ns / 1e9]
    for series in table:
        signal = series.signal
        cells: list[Any] = [None] * len(times_ns)
        size = [prod(signal.shape)] if signal.shape else []
        flat = series.values.reshape(len(series.rows), *size)
        for row, value in zip(series.rows.tolist(), flat.tolist(), strict=True):
            cells[row] = value
        kind = _arrow(pa, series.values)
        notes = {"unit": signal.unit}
        if signal.shape:
            kind = pa.list_(kind, *size)
            notes["shape"] = json.dumps(signal.shape)
        if signal.items:
            notes["items"] = json.dumps(dict(signal.items), ensure_ascii=False)
        fields.append(pa.field(signal.name, kind, metadata=notes))
        columns.append(pa.array(cells, kind))
    parquet.write_table(pa.table(columns, schema=pa.schema(fields)), out)


def _arrow(pa: Any, values: NDArray[Any]) -> Any:
    """Return the Arrow type of a signal's values."""
    if values.dtype != object:
        return pa.from_numpy_dtype(values.dtype)
    return pa.binary() if any(isinstance(one, bytes) for one in values.flat) else pa.string()


def _needing(package: str, module: str) -> Any:
    """Return a module that needs a package of an extra.

    Raises
    ------
    ValueError
        If that is not there; the message says how to get it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        if (error.name or "").partition(".")[0] != package.removesuffix("-sdk"):
            raise
        what = f"{package}: not installed, got none, expected `pip install {package}`"
        raise ValueError(what) from None
