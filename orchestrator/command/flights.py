"""Commands that fly, or would."""

import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from orchestrator.command.arguments import Flag, Overrides, Port, user_errors
from orchestrator.command.recordings import with_recording
from orchestrator.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from orchestrator.assembly.system import System
    from orchestrator.flight import Flight
    from orchestrator.live.live import Live


def run(
    scenario: Path,
    /,
    *,
    overrides: Overrides = None,
    out: Path | None = None,
    record: bool = True,
    json: Flag = False,
    live: Flag = False,
    speed: float | Literal["max"] | None = None,
    port: Port | None = None,
) -> int:
    """Fly a scenario, record it, and print its figures.

    Parameters
    ----------
    scenario
        The scenario's YAML file.
    overrides
        A value to change, as components.mpc.parameters.basis=tent; may be repeated.
    out
        The MCAP file to write; named after the scenario, in this folder, if not given.
    record
        Whether to record at all.
    json
        Print one JSON object instead of the table.
    live
        Show the flight in Lichtblick or Foxglove while it lasts, and take changes from there.
    speed
        Of the live view: 1 is real time, 0.25 a quarter of it, max as fast as it goes.
    port
        Of the live view, on loopback; 0 takes a free one.
    """
    from orchestrator.command.terminal import progress_bar, signals
    from orchestrator.flight import check_writable, fly_system

    file = (out or Path(f"{scenario.absolute().stem}.mcap")) if record else None
    if file is not None:
        check_writable(file)
    if not live and (speed, port) != (None, None):
        raise ScenarioError([Problem((), "run: --speed and --port are for --live")])
    system = built(scenario, overrides)
    with signals() as caught:
        if live:
            with _live(system, speed, port, lambda: bool(caught)) as view:
                flight = fly_system(system, file, None, lambda: bool(caught), [view], view.requests)
        else:
            with progress_bar(system.schedule.end_ns) as progress:
                flight = fly_system(system, file, progress, lambda: bool(caught))
    _report(system, flight, as_json=json)
    if file is not None and flight.recording is None:
        print(f"{file}: incomplete, `hedgehop recover` makes it whole", file=sys.stderr)
        return 2
    if caught and flight.result.outcome == "interrupted":
        return 128 + caught[0]
    return int(flight.metrics["outcome"] != "flown")


def validate(scenario: Path, /, *, overrides: Overrides = None) -> None:
    """Check a scenario without flying it.

    Parameters
    ----------
    scenario
        The scenario's YAML file.
    overrides
        A value to change, as components.mpc.parameters.basis=tent; may be repeated.
    """
    system = built(scenario, overrides)
    base_s = system.schedule.base_ns / 1e9
    count = f"{len(system.instances)} components, {len(system.links)} links"
    print(f"{scenario}: valid, {count}, base tick {base_s:g} s")


def replay(
    recording: Path,
    /,
    *,
    out: Path | None = None,
    trust: Flag = False,
) -> int:
    """Fly a recorded flight again and compare every bit; exit code 1 if one differs.

    Parameters
    ----------
    recording
        An MCAP file; what its scenario names is looked up beside it first.
    out
        Keep the second flight's recording here.
    trust
        Run what did not come with Hedgehop without asking.
    """
    from tempfile import TemporaryDirectory

    from orchestrator.command.terminal import agreed, progress_bar, signals
    from orchestrator.flight import check_writable
    from orchestrator.playback.replay import foreign, recorded_scenario
    from orchestrator.playback.replay import replay as fly_again
    from orchestrator.recording.reader import Recording

    with user_errors():
        recorded = Recording.open(recording)
        scenario = recorded_scenario(recorded)
        strangers = foreign(scenario)
        if strangers and not trust and not agreed(f"{recording} runs {', '.join(strangers)}"):
            what = f"runs code that did not come with hedgehop: {', '.join(strangers)}"
            raise ValueError(f"{recording}: {what}, expected --trust")
        if out is not None:
            check_writable(out)
        with TemporaryDirectory() as folder, signals() as caught:
            file = out or Path(folder) / "replay.mcap"
            with progress_bar(round(scenario.duration_s * 1e9)) as progress:
                found = fly_again(recorded, file, progress, lambda: bool(caught))
    if caught:
        return 128 + caught[0]
    if not found.differences:
        count = len(recorded.signals)
        what = f"{count} signals" if count else "how it ends; no signals were recorded"
        print(f"{recording}: flown again, no difference in {what}")
        return 0
    for key, (then, now) in found.changes.items():
        print(f"{key}: {then} then, {now} now")
    print(f"first difference: {found.differences[0]}")
    print(f"{len(found.differences)} signals or events differ")
    return 1


@contextmanager
def _live(
    system: "System", speed: float | str | None, port: int | None, interrupt: Callable[[], bool]
) -> "Generator[Live]":
    """Open a live view and say where; without the package it needs, say so."""
    try:
        from orchestrator.live.live import Live
    except ModuleNotFoundError as error:
        if error.name != "foxglove":
            raise
        what = "--live: needs foxglove-sdk, got none, expected `pip install foxglove-sdk`"
        raise ScenarioError([Problem((), what)]) from error
    from orchestrator.command.terminal import status_line

    with status_line() as show:
        with user_errors():
            pace = 1.0 if speed is None else float("inf") if speed == "max" else float(speed)
            if not pace > 0:
                raise ValueError(f"--speed: got {speed}, expected a number above 0 or 'max'")
            view = Live(
                system,
                port=8765 if port is None else port,
                speed=pace,
                interrupt=interrupt,
                show=show,
            )
        print(f"live: {view.address}, to open in Lichtblick or Foxglove", file=sys.stderr)
        try:
            yield view
        finally:
            view.stop()


def _report(system: "System", flight: "Flight", *, as_json: bool) -> None:
    if as_json:
        from json import dumps

        print(dumps(with_recording(flight.metrics, flight.recording), allow_nan=False))
    else:
        from orchestrator.command.tables import flight_table
        from orchestrator.command.terminal import print_table

        print_table(system.scenario.title, flight_table(flight.metrics, flight.recording))


def built(scenario: Path, overrides: list[str] | None) -> "System":
    """Return the system of a scenario file; what takes long is said."""
    from orchestrator.assembly.build import build
    from orchestrator.assembly.discovery import FILES
    from orchestrator.command.terminal import announce
    from orchestrator.scenario.load import load

    loaded = load(scenario, overrides or ())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hedgehop"
    uses = (spec.use for spec in (*loaded.resources, *loaded.components))
    if any(Path(use).suffix[1:] not in FILES for use in uses) and not any(cache.glob("*/**/*.nbi")):
        print("compiling flight kernels (first time only) ...", file=sys.stderr)
    system = build(loaded, announce)
    for line in system.notes:
        print(f"note: {line}", file=sys.stderr)
    return system
