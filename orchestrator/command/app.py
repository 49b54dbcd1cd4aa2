"""The commands of ``hedgehop``.

Exit codes: 0 flown (or same, or valid); 1 the flight failed (or files differ); 2 bad usage or bad
scenario; 3 a defect; 130 interrupted, 143 terminated.
"""

import os
import sys
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from orchestrator.errors import Problem, ScenarioError

if TYPE_CHECKING:
    from orchestrator.assembly.system import System
    from orchestrator.flight import Flight
    from orchestrator.live.live import Live

# heavy imports happen inside the commands: `hedgehop --help` must answer at once

app = App(
    name="hedgehop",
    help="Fly helicopters nap-of-the-earth: couple components by co-simulation and record them.",
    help_format="plaintext",
    version=lambda: version("hedgehop"),
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)

Overrides = Annotated[list[str] | None, Parameter(name="--set", negative="")]
Json = Annotated[bool, Parameter(name="--json", negative="")]


def status(tokens: Sequence[str]) -> int:
    """Return the exit code of a command; errors become a line on stderr."""
    try:
        code = app(tokens)
        sys.stdout.flush()
    except CycloptsError as error:
        print(f"hedgehop: {error}", file=sys.stderr)
        return 2
    except ScenarioError as error:
        _explain(error)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # as by `hedgehop list | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except Exception as error:  # noqa: BLE001  the last resort
        notes = "".join(f", {note}" for note in getattr(error, "__notes__", ()))
        print(f"hedgehop: internal error, {type(error).__name__}: {error}{notes}", file=sys.stderr)
        if os.environ.get("HEDGEHOP_TRACEBACK") != "1":
            print("set HEDGEHOP_TRACEBACK=1 to see where", file=sys.stderr)
        else:
            traceback.print_exc()
        return 3
    return code or 0


def _explain(error: ScenarioError) -> None:
    print(error, file=sys.stderr)
    if len(error.problems) > 1:
        print(f"{len(error.problems)} problems", file=sys.stderr)
    if os.environ.get("HEDGEHOP_TRACEBACK") == "1":
        traceback.print_exc()


@app.command
def run(
    scenario: Path,
    /,
    *,
    overrides: Overrides = None,
    out: Path | None = None,
    record: bool = True,
    json: Json = False,
    live: Annotated[bool, Parameter(name="--live", negative="")] = False,
    speed: float | Literal["max"] | None = None,
    port: int | None = None,
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

    file = (out or Path(f"{scenario.stem}.mcap")) if record else None
    if file is not None:
        check_writable(file)
    if not live and (speed, port) != (None, None):
        raise ScenarioError([Problem((), "run: --speed and --port are for --live")])
    system = _built(scenario, overrides)
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
        what = "--live: needs foxglove-sdk, got none, expected `pip install hedgehop[live]`"
        raise ScenarioError([Problem((), what)]) from error
    from orchestrator.command.terminal import status_line

    with status_line() as show:
        with _user_errors():
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

        print(dumps(_with_recording(flight.metrics, flight.recording), allow_nan=False))
    else:
        from orchestrator.command.tables import flight_table
        from orchestrator.command.terminal import print_table

        print_table(system.scenario.title, flight_table(flight.metrics, flight.recording))


def _with_recording(figures: Mapping[str, Any], recording: Path | None) -> dict[str, Any]:
    from orchestrator.figures.metrics import mb_per_min

    if recording is None:
        return {**figures, "recording": None, "recording_mb_per_min": None}
    size = mb_per_min(recording.stat().st_size, figures["duration_s"])
    return {**figures, "recording": str(recording), "recording_mb_per_min": size}


def _built(scenario: Path, overrides: list[str] | None) -> "System":
    from orchestrator.assembly.build import build
    from orchestrator.assembly.discovery import FILES
    from orchestrator.command.terminal import announce
    from orchestrator.scenario.load import load

    loaded = load(scenario, overrides or ())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hedgehop"
    uses = (spec.use for spec in (*loaded.resources, *loaded.components))
    if any(Path(use).suffix[1:] not in FILES for use in uses) and not any(cache.glob("*/**/*.nbi")):
        print("compiling flight kernels (first time only) ...", file=sys.stderr)
    return build(loaded, announce)


@app.command
def validate(scenario: Path, /, *, overrides: Overrides = None) -> None:
    """Check a scenario without flying it.

    Parameters
    ----------
    scenario
        The scenario's YAML file.
    overrides
        A value to change, as components.mpc.parameters.basis=tent; may be repeated.
    """
    system = _built(scenario, overrides)
    base_s = system.schedule.base_ns / 1e9
    count = f"{len(system.instances)} components, {len(system.links)} links"
    print(f"{scenario}: valid, {count}, base tick {base_s:g} s")


@app.command(name="list")
def list_() -> None:
    """List the installed components."""
    from inspect import getdoc

    from orchestrator.assembly.discovery import installed_components, resolve
    from orchestrator.command.tables import components_table
    from orchestrator.command.terminal import print_table

    rows: list[tuple[str, str, str]] = []
    for name, point in installed_components().items():
        try:
            meaning = (getdoc(resolve(point.value)) or "").partition("\n")[0]
        except ValueError as error:
            meaning = f"broken: {error}"
        rows.append((name, point.value, meaning))
    print_table("installed components", components_table(rows))


@app.command
def inspect(use: str, /, *, scenario: Path | None = None) -> None:
    """Show a component's variables and parameters.

    Parameters
    ----------
    use
        An FMU, a recording, the name of an installed component, or module:attribute.
    scenario
        A scenario that holds one, where its defaults are not enough to make one.
    """
    from orchestrator.assembly.description import ports
    from orchestrator.assembly.examples import example, find
    from orchestrator.assembly.parameters import adapter, constructor
    from orchestrator.command.tables import parameters_table, variables_table
    from orchestrator.command.terminal import print_table

    with _user_errors():
        factory = find(use)
        record = constructor(factory).record
        is_fmu = record is not None and "event_mode" in record.__dataclass_fields__
        if record is not None:
            what = "options, under 'fmu' in a scenario" if is_fmu else "parameters"
            print_table(f"{use}: {what}", parameters_table(adapter(record).json_schema()))
        if isinstance(factory, type) and not hasattr(factory, "describe"):
            return  # a resource
        _, arguments, where = example(use, scenario)
        described = ports(use, factory(**arguments).describe())
    table = variables_table(described.values(), has_fixed=is_fmu)
    print_table(f"\n{use}: variables, made with {where}", table)


@app.command
def check(use: str, /, *, scenario: Path | None = None, timeout_s: float = 60.0) -> int:
    """Check that a component keeps the contract; exit code 1 if it does not.

    Parameters
    ----------
    use
        An FMU, the name of an installed component, or module:attribute.
    scenario
        A scenario that holds one, where its defaults are not enough to make one.
    timeout_s
        How long each clause may take, s; the first may have to compile.
    """
    from orchestrator.assembly.examples import example
    from orchestrator.command.tables import clauses_table
    from orchestrator.command.terminal import print_table
    from orchestrator.conformance.check import check_component

    with _user_errors():
        factory, arguments, where = example(use, scenario)
        name = f"{factory.__module__}:{factory.__qualname__}"
        clauses = check_component(name, arguments, timeout_s=timeout_s)
        reasons = {clause.detail if clause.verdict == "failed" else "" for clause in clauses}
        if len(reasons) == 1 and (reason := reasons.pop()):  # there is nothing to check
            raise ValueError(reason.removeprefix("ValueError: "))
    print_table(f"{use}, made with {where}", clauses_table(clauses))
    return int(any(clause.verdict == "failed" for clause in clauses))


@app.command
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from json import dumps

    from orchestrator.scenario.load import json_schema

    print(dumps(json_schema(), indent=2))


@app.command
def info(recording: Path, /, *, json: Json = False) -> None:
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
    from orchestrator.recording import diff as differences

    with _user_errors():
        found = differences.info(recording)
    if json:
        from json import dumps

        print(dumps(found))
    else:
        print_table(f"{found['title']}: {found['outcome']}", recording_table(found))
        if found["recovered"]:
            print(f"recovered, lost: {found['recovered']['reason']}")


@app.command
def diff(a: Path, b: Path, /) -> int:
    """Compare two recordings' simulated signals, bit for bit; exit code 1 if they differ.

    Parameters
    ----------
    a, b
        MCAP files.
    """
    from orchestrator.recording import diff as differences

    with _user_errors():
        found = differences.diff(a, b)
    for difference in found:
        print(difference)
    print(f"{len(found)} signals or events differ" if found else "no difference")
    return int(bool(found))


@app.command
def metrics(recording: Path, /, *, json: Json = False) -> None:
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

    with _user_errors():
        recorded = Recording.open(recording)
        figures = recorded_figures(recorded)
    for line in omissions(recorded):
        print(f"note: {line}", file=sys.stderr)
    if json:
        from json import dumps

        print(dumps(_with_recording(figures, recording), allow_nan=False))
    else:
        from orchestrator.command.tables import flight_table
        from orchestrator.command.terminal import print_table

        print_table(recording.stem, flight_table(figures, recording))


@app.command
def recover(broken: Path, /, *, out: Annotated[Path, Parameter(name=("--out", "-o"))]) -> None:
    """Make a whole recording of a killed, cut or damaged one, and say what was lost.

    Parameters
    ----------
    broken
        An MCAP file; it stays as it is.
    out
        The MCAP file to write.
    """
    from orchestrator.recording.recover import recover as write

    with _user_errors():
        recovery = write(broken, out)
    print(f"{out}: {recovery}")
    for line in recovery.losses or ("nothing",):
        print(f"lost: {line}")


@app.command
def convert(
    recording: Path,
    /,
    *,
    to: Literal["csv", "parquet", "rrd"],
    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None,
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

    with _user_errors():
        file = out or Path(f"{recording.stem}.{to}")
        for line in write(recording, to, file, signals):
            print(f"note: {line}", file=sys.stderr)
    print(f"{file}: written, {file.stat().st_size / 1e6:.3g} MB")


@app.command
def replay(
    recording: Path,
    /,
    *,
    out: Path | None = None,
    trust: Annotated[bool, Parameter(name="--trust", negative="")] = False,
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

    with _user_errors():
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
        print(f"{recording}: flown again, no difference")
        return 0
    for key, (then, now) in found.changes.items():
        print(f"{key}: {then} then, {now} now")
    print(f"first difference: {found.differences[0]}")
    print(f"{len(found.differences)} signals or events differ")
    return 1


@app.command
def export_ssp(
    scenario: Path,
    /,
    *,
    out: Annotated[Path, Parameter(name=("--out", "-o"))],
    overrides: Overrides = None,
) -> None:
    """Write a scenario as an SSP 1.0 archive, its components as FMUs, for other masters.

    Parameters
    ----------
    scenario
        The scenario's YAML file.
    out
        The archive to write, ending in .ssp.
    overrides
        A value to change, as components.mpc.parameters.basis=tent; may be repeated.
    """
    from orchestrator.exchange.ssp import export_ssp as write

    with _user_errors():
        for line in write(scenario, out, overrides or ()):
            print(f"note: {line}", file=sys.stderr)
    print(f"{out}: written")


@app.command
def import_ssp(
    archive: Path,
    /,
    *,
    out: Annotated[Path, Parameter(name=("--out", "-o"))],
    duration_s: float | None = None,
) -> None:
    """Unpack an SSP 1.0 archive and write the scenario that runs it; nothing is run.

    Parameters
    ----------
    archive
        The .ssp file.
    out
        The folder to write to.
    duration_s
        Simulated time, where the archive says none or another is wanted.
    """
    from orchestrator.exchange.ssp import import_ssp as read

    with _user_errors():
        print(f"{read(archive, out, duration_s)}: written")


@app.command
def export(
    component: str,
    /,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    fmi: Literal[2, 3] = 3,
    scenario: Path | None = None,
    overrides: Overrides = None,
    c: Annotated[bool, Parameter(name="--c", negative="")] = False,
) -> None:
    """Write a component as an FMU for co-simulation.

    Parameters
    ----------
    component
        The name of an installed component, module:attribute, or a name in the scenario.
    out
        The FMU to write.
    fmi
        Version of the standard, 2 or 3.
    scenario
        A scenario that holds the component, where its defaults are not enough or not meant.
    overrides
        A value of the scenario to change, as components.vehicle.parameters.speed_mps=20.
    c
        Write C sources in place of Python, if the component has them.
    """
    from orchestrator.export.export import choose
    from orchestrator.export.export import export as write

    with _user_errors():
        chosen = choose(component, scenario, overrides or ())
        write(chosen, out, fmi=fmi, language="c" if c else "python")
    print(f"{out}: FMI {fmi}.0, made with {chosen.origin}")


@app.command
def report(
    *recordings: Path,
    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None,
) -> None:
    """Write one HTML page that shows flights: map, profile, controls, figures; opens offline.

    Parameters
    ----------
    recordings
        MCAP files; several are laid over each other.
    out
        The page to write; named after the first recording, in this folder, if not given.
    """
    with _user_errors():
        if not recordings:
            raise ValueError("report: no recording given, expected at least one MCAP file")
        from orchestrator.report.page import write_page

        file = out or Path(f"{recordings[0].stem}.html")
        write_page(recordings, file)
    print(f"{file}: written, {file.stat().st_size / 1e6:.2g} MB")


@app.command
def layout(
    recording: Path,
    /,
    *,
    out: Annotated[Path | None, Parameter(name=("--out", "-o"))] = None,
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
    from orchestrator.viewing.layout import layout_json
    from orchestrator.viewing.plots import recorded

    with _user_errors():
        file = out or Path(f"{recording.stem}.layout.json")
        file.write_bytes(layout_json(recorded(Recording.open(recording))))
    print(f"{file}: written")


@app.command
def view(
    recording: Path,
    /,
    *,
    serve: Annotated[bool, Parameter(name="--serve", negative="")] = False,
    web: Annotated[bool, Parameter(name="--web", negative="")] = False,
    port: int = 0,
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
        Where to serve; any free port if 0.
    """
    from orchestrator.recording.reader import Recording
    from orchestrator.viewing import view as viewing

    with _user_errors():
        opened = Recording.open(recording)
        if web and not viewing.has_rerun():
            raise ValueError("--web: rerun is not installed, expected pip install hedgehop[rerun]")
        if viewing.has_rerun() and not serve:
            return viewing.show(opened, is_web=web)
        viewing.serve(opened, port, lambda line: print(line, flush=True))
    return 0


@contextmanager
def _user_errors() -> Generator[None]:
    """Take what a file or component that the user named raises as the user's to mend."""
    try:
        yield
    except ScenarioError:
        raise
    except (OSError, ValueError) as error:
        raise ScenarioError([Problem((), str(error))]) from error
