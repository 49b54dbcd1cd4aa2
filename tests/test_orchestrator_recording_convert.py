"""Recordings as tables: every value comes back bit by bit, beside its time and its unit."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from fake_system import TICK_NS, flight, helicopter, make_system, port, tell

from orchestrator.command.app import status
from orchestrator.recording.convert import convert
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder

SYSTEM = helicopter(cells=20, capacity=8, posts=5, wall_clock=True)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    tell(Recorder(path), SYSTEM, flight(SYSTEM, 2.0))
    return path


def table(path):
    """Return the columns of a CSV file, by heading."""
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    return dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))


def test_a_csv_file_holds_every_published_number(file, tmp_path):
    """One row per instant, time first; what was recorded comes back exactly, all else is empty."""
    out = tmp_path / "a.csv"
    notes = convert(file, "csv", out, None)
    assert [note.partition(":")[0] for note in notes] == [
        "long arrays left out, --signals takes them in"
    ]
    columns = table(out)
    assert list(columns)[:2] == ["time_s", "vehicle.state.north [m]"]
    assert columns["time_s"] == [repr(k * TICK_NS / 1e9) for k in range(41)]
    recording = Recording.open(file)
    names = {heading.partition(" [")[0]: cells for heading, cells in columns.items()}
    for name, signal in recording.signals.items():
        times, values = recording[name]
        if "sensor.scan." in name and signal.shape:
            assert f"{name}[20]" in notes[0]
            continue
        if recording.topics[signal.topic].metadata["kind"] == "parameters":
            assert name not in names
            continue
        for k in np.ndindex(signal.shape):
            cells = names[name + "".join(f"[{i}]" for i in k)]
            found = {
                time: cell for time, cell in zip(columns["time_s"], cells, strict=True) if cell
            }
            assert list(found) == [repr(time) for time in times.tolist()]
            told = np.array([float(cell) for cell in found.values()])
            assert told.tobytes() == values[(slice(None), *k)].astype(float).tobytes()


def test_headings_carry_units_and_meanings(file, tmp_path):
    """`[m]` behind a name, numbers and texts behind an enumeration's, nothing without a unit."""
    convert(file, "csv", tmp_path / "a.csv", None)
    headings = list(table(tmp_path / "a.csv"))
    assert "vehicle.load_factor [G]" in headings
    assert "vehicle.outcome [0=flying 1=collision 2=departed 3=left_terrain]" in headings
    assert "mpc.cost.after" in headings
    assert "mpc.plan.thrust[7] [rad]" in headings


def test_patterns_choose_the_signals(file, tmp_path):
    """What is named is there, however long, parameters too; an unknown name is answered."""
    out = tmp_path / "a.csv"
    assert convert(file, "csv", out, ["sensor.scan.north", "mpc.height*"]) == []
    columns = table(out)
    north = [f"sensor.scan.north[{k}] [m]" for k in range(20)]
    assert list(columns) == ["time_s", *north, "mpc.height_agl_m [m]"]
    assert columns["mpc.height_agl_m [m]"][0] == "10.0"
    with pytest.raises(ValueError, match=r"got 'vehicle.sate.\*', .*'vehicle.state"):
        convert(file, "csv", out, ["vehicle.sate.*"])


def test_any_kind_of_value_is_written(tmp_path):
    """Text as it is, truth as 1 or 0, bytes in hexadecimal, numbers with all their digits."""
    told = {
        "Float64": (0.1, "0.1"),
        "Int64": (2**62 + 1, str(2**62 + 1)),
        "Boolean": (True, "1"),
        "String": ('a,"b"\nc', 'a,"b"\nc'),
        "Binary": (b"\0\xff", "00ff"),
    }
    ports = [port("c", kind, kind=kind) for kind in told]
    calls = [("outputs", (0, "c", {kind: value for kind, (value, _) in told.items()}))]
    calls += [("outputs", (1, "c", {kind: value for kind, (value, _) in told.items()}))]
    calls[1][1][2]["Float64"] = float("nan")
    tell(Recorder(tmp_path / "a.mcap"), make_system(ports), calls)
    convert(tmp_path / "a.mcap", "csv", tmp_path / "a.csv", None)
    columns = table(tmp_path / "a.csv")
    for kind, (_, text) in told.items():
        assert columns["c.Float64 [m]" if kind == "Float64" else f"c.{kind}"][0] == text
    assert columns["c.Float64 [m]"][1] == "nan"
    assert columns["time_s"] == ["0.0", "1e-09"]


def test_nothing_is_overwritten_by_mistake(file, tmp_path, capsys, monkeypatch):
    """The table is named after the recording; the recording itself is never written to."""
    monkeypatch.chdir(tmp_path)
    copy = Path("a.mcap")
    copy.write_bytes(file.read_bytes())
    assert status(["convert", "a.mcap", "--to", "csv", "-o", "a.mcap"]) == 2
    assert "a.mcap: is what is read, expected another file" in capsys.readouterr().err
    assert copy.read_bytes() == file.read_bytes()
    assert status(["convert", "a.mcap", "--to", "csv", "--signals", "vehicle.*", "gust.*"]) == 0
    assert capsys.readouterr().out.startswith("a.csv: written, ")
    assert len(table(Path("a.csv"))) > 20
    assert status(["convert", "a.mcap", "--to", "csv", "-o", "nowhere/a.csv"]) == 2
    assert "nowhere/a.csv: cannot be written, No such file" in capsys.readouterr().err
    assert status(["convert", "a.mcap", "--to", "rrd", "--signals", "vehicle.*"]) == 2
    assert "--signals: not possible with rrd" in capsys.readouterr().err
    assert {one.name for one in Path().iterdir()} == {"a.mcap", "a.csv"}


@pytest.mark.parametrize(
    ("form", "module", "package"),
    [("parquet", "pyarrow", "pyarrow"), ("rrd", "rerun", "rerun-sdk")],
)
def test_a_missing_package_is_named(file, tmp_path, capsys, monkeypatch, form, module, package):
    """Without it one line says how to install it, and no file is left."""
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, "orchestrator.viewing.rrd", raising=False)
    out = tmp_path / f"a.{form}"
    assert status(["convert", str(file), "--to", form, "-o", str(out)]) == 2
    text = f"{package}: not installed, got none, expected `pip install {package}`\n"
    assert capsys.readouterr().err == text
    assert list(tmp_path.iterdir()) == []


def test_a_recording_without_messages_is_an_empty_table(tmp_path):
    """Headings and no row."""
    tell(Recorder(tmp_path / "a.mcap"), SYSTEM, [("log", (0, 20, "a", "b"))])
    convert(tmp_path / "a.mcap", "csv", tmp_path / "a.csv", None)
    assert (tmp_path / "a.csv").read_text().count("\n") == 1


@pytest.mark.viewers
def test_a_parquet_file_holds_arrays_too(file, tmp_path):
    """Types are kept, arrays are lists of their size, units and meanings are metadata."""
    from pyarrow import parquet, types

    out = tmp_path / "a.parquet"
    assert convert(file, "parquet", out, None) == []
    found, recording = parquet.read_table(out), Recording.open(file)
    assert found.schema.names[0] == "time_s"
    instants = found["time_s"].to_numpy()
    for name in found.schema.names[1:]:
        times, values = recording[name]
        field, signal = found.schema.field(name), recording.signals[name]
        assert field.metadata[b"unit"].decode() == signal.unit
        cells = found[name].to_pylist()
        there = [k for k, cell in enumerate(cells) if cell is not None]
        assert instants[there].tobytes() == times.tobytes()
        told = np.array([cells[k] for k in there], values.dtype).reshape(values.shape)
        assert told.tobytes() == values.tobytes()
        assert types.is_fixed_size_list(field.type) == bool(signal.shape)
    items = json.loads(found.schema.field("mpc.ladder").metadata[b"items"])
    assert items["3"] == "trim"
