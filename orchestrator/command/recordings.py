"""Commands that read a recording."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from orchestrator.command.arguments import Flag, Out, OutOrDefault, Port, user_errors


def info(recording: Path, /, *, json: Flag = False) -> None:
    """Show what a recording holds.

    Parameters
    ----------
    recording
        An MCAP file.
    json
        Print one JSON object instead of the table.
    """
    from orchestrator.command.tables import recording_table
    from orchestrator.command.terminal import print_table
    from orchestrator.recording.diff import info as sum_up

    with user_errors():
        found = sum_up(recording)
    if json:
        from json import dumps

        print(dumps(found))
    else:
        print_table(f"{found['title']}: {found['outcome']}", recording_table(found))
        if found["recovered"]:
            print(f"recovered, lost: {found['recovered']['reason']}")


def diff(a: Path, b: Path, /) -> int:
    """Compare two recordings' simulated signals, bit for bit; exit code 1 if they differ.

    Parameters
    ----------
    a, b
        MCAP files.
    """
    from orchestrator.recording.comparison import comparison
    from orchestrator.recording.diff import differences
    from orchestrator.recording.reader import Recording

    with user_errors():
        one, two = Recording.open(a), Recording.open(b)
        found = differences(one, two)
    for line in comparison(one, two, found):
        print(line)
    return int(bool(found))


def metrics(recording: Path, /, *, json: Flag = False) -> None:
    """Print a recorded flight's figures, from the recording alone.

    Parameters
    ----------
    recording
        An MCAP file.
    json
        Print one JSON object instead of the table.
    """
    from orchestrator.figures.omissions import omissions
    from orchestrator.flight import recorded_figures
    from orchestrator.recording.reader import Recording

    with user_errors():
        recorded = Recording.open(recording)
        figures = recorded_figures(recorded)
    for line in omissions(recorded):
        print(f"note: {line}", file=sys.stderr)
    if json:
        from json import dumps

        print(dumps(with_recording(figures, recording), allow_nan=False))
    else:
        from orchestrator.command.tables import flight_table
        from orchestrator.command.terminal import print_table

        print_table(recorded.scenario["title"], flight_table(figures, recording))


def report(
    *recordings: Path,
    out: OutOrDefault = None,
) -> None:
    """Write one HTML page that shows flights: map, profile, controls, figures; opens offline.

    Parameters
    ----------
    recordings
        MCAP files; several are laid over each other.
    out
        The page to write; named after the first recording, in this folder, if not given.
    """
    with user_errors():
        if not recordings:
            raise ValueError("report: no recording given, expected at least one MCAP file")
        from orchestrator.report.page import write_page

        file = out or Path(f"{recordings[0].stem}.html")
        write_page(recordings, file)
    print(f"{file}: written, {file.stat().st_size / 1e6:.2g} MB")


def layout(
    recording: Path,
    /,
    *,
    out: OutOrDefault = None,
) -> None:
    """Write the layout that shows a recording in Lichtblick or Foxglove.

    Parameters
    ----------
    recording
        An MCAP file.
    out
        The JSON file to write; named after the recording, in this folder, if not given.
    """
    from orchestrator.recording.reader import Recording
    from orchestrator.recording.whole import whole
    from orchestrator.viewing.layout import layout_json
    from orchestrator.viewing.plots import recorded

    with user_errors():
        file = out or Path(f"{recording.stem}.layout.json")
        text = layout_json(recorded(Recording.open(recording)))
        with whole(file, recording) as partial:
            partial.write_bytes(text)
    print(f"{file}: written")


def view(
    recording: Path,
    /,
    *,
    serve: Flag = False,
    web: Flag = False,
    port: Port = 0,
) -> int:
    """Show a recording: in Rerun if it is installed, or served to Lichtblick and Foxglove.

    Parameters
    ----------
    recording
        An MCAP file.
    serve
        Serve recording and layout on this machine, even if Rerun is installed.
    web
        Rerun's viewer in a browser.
    port
        Where to serve, or Rerun's page; any free port if 0.
    """
    from orchestrator.recording.reader import Recording
    from orchestrator.viewing import view as viewing

    with user_errors():
        opened = Recording.open(recording)
        if web and serve:
            raise ValueError("view: got --serve and --web, expected one of them")
        if web and not viewing.has_rerun():
            raise ValueError("--web: rerun is not installed, expected `pip install rerun-sdk`")
        if viewing.has_rerun() and not serve:
            return viewing.show(opened, web_port=port if web else None)
        if not serve:
            print("note: rerun is not installed, hence for other viewers:", file=sys.stderr)
        viewing.serve(opened, port, lambda line: print(line, flush=True))
    return 0


def convert(
    recording: Path,
    /,
    *,
    to: Literal["csv", "parquet", "rrd"],
    out: OutOrDefault = None,
    signals: Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")] = None,
) -> None:
    """Write a recording for spreadsheets, data frames or Rerun.

    Parameters
    ----------
    recording
        An MCAP file.
    to
        csv or parquet: one table, a row for every instant; rrd: what Rerun shows, with a layout.
    out
        The file to write; named after the recording, in this folder, if not given.
    signals
        Patterns of the signals in a table, as vehicle.state.*; without, all outputs and inputs,
        in csv but for arrays of more than 16 elements.
    """
    from orchestrator.recording.convert import convert as write

    with user_errors():
        file = out or Path(f"{recording.stem}.{to}")
        for line in write(recording, to, file, signals):
            print(f"note: {line}", file=sys.stderr)
    print(f"{file}: written, {file.stat().st_size / 1e6:.3g} MB")


def recover(broken: Path, /, *, out: Out) -> None:
    """Make a whole recording of a killed, cut or damaged one, and say what was lost.

    Parameters
    ----------
    broken
        An MCAP file; it stays as it is.
    out
        The MCAP file to write.
    """
    from orchestrator.recording.recover import recover as write

    with user_errors():
        recovery = write(broken, out)
    print(f"{out}: {recovery}")
    for line in recovery.losses or ("nothing",):
        print(f"lost: {line}")


def with_recording(figures: Mapping[str, Any], recording: Path | None) -> dict[str, Any]:
    """Return a flight's figures with its recording and its size."""
    from orchestrator.figures.metrics import mb_per_min

    if recording is None:
        return {**figures, "recording": None, "recording_mb_per_min": None}
    size = mb_per_min(recording.stat().st_size, figures["duration_s"])
    return {**figures, "recording": str(recording), "recording_mb_per_min": size}
