"""The command line: what it prints, what it leaves behind, and its exit codes."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from small_components import GROUND, SCENARIO

import orchestrator
from orchestrator.command.app import status
from orchestrator.command.tables import flight_table
from orchestrator.command.terminal import print_table
from orchestrator.flight import fly, recording_metrics

PROMISED = (
    "outcome", "height_rms_m", "height_p95_m", "agl_rms_m", "clearance_min_m", "cross_track_rms_m",
    "speed_rms_mps", "update_ms_median", "update_ms_p99", "cpu_ms_per_simulated_s", "ladder",
    "recording", "heading_max_deg", "load_factor_min", "load_factor_max", "saturation_percent",
    "deadline_misses", "duration_s",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Path("glide.yaml").write_text(SCENARIO)
    Path("ground.txt").write_text(GROUND)


def test_help_imports_nothing_heavy():
    """The help must answer at once: no numpy, pydantic, MCAP or YAML behind it."""
    program = (
        "import sys; from orchestrator.command.app import status; status(['--help']); "
        "print([m for m in ('numpy', 'pydantic', 'mcap', 'yaml', 'fmpy') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert "Fly a scenario" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


def test_run_flies_records_and_prints_the_figures(capsys):
    """The recording is named after the scenario; the table is on stdout, the rest on stderr."""
    assert status(["run", "glide.yaml"]) == 0
    printed = capsys.readouterr()
    assert "minimum clearance" in printed.out
    assert "glide.mcap" in printed.out
    assert printed.err == "compiling flight kernels (first time only) ...\n"
    assert Path("glide.mcap").stat().st_size > 0


def test_run_prints_one_json_object(capsys):
    """It holds every promised figure, null where the scene has no source for it."""
    assert status(["run", "glide.yaml", "--json", "--out", "a.mcap"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(PROMISED) <= set(figures)
    assert figures["outcome"] == "flown"
    assert figures["recording"] == "a.mcap"
    assert figures["clearance_min_m"] == pytest.approx(42.6, abs=0.1)
    assert figures["height_rms_m"] is None
    assert figures["cpu_ms_per_simulated_s"] > 0


def test_metrics_of_the_recording_equal_those_of_the_run(capsys):
    """To the last bit, from the recording alone."""
    status(["run", "glide.yaml", "--json"])
    run = capsys.readouterr().out
    assert status(["metrics", "glide.mcap", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(run)


def test_metrics_have_the_title_of_the_run(capsys):
    """The same table, whatever the file is called."""
    status(["run", "glide.yaml", "--out", "other.mcap"])
    flown = capsys.readouterr().out
    assert status(["metrics", "other.mcap"]) == 0
    assert capsys.readouterr().out == flown


def test_timings_are_null_without_wall_clock(capsys):
    """Nothing measured is told, and two recordings are byte-identical."""
    for name in ("a.mcap", "b.mcap"):
        code = status(
            ["run", "glide.yaml", "--json", "--out", name, "--set", "recording.wall_clock=false"]
        )
        assert code == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[0])
    for name in ("update_ms_median", "update_ms_p99", "cpu_ms_per_simulated_s", "deadline_misses"):
        assert figures[name] is None
    assert Path("a.mcap").read_bytes() == Path("b.mcap").read_bytes()


def test_diff_tells_whether_two_recordings_are_the_same(capsys):
    """Exit code 0 for the same simulated signals, 1 with the first differences otherwise."""
    for number, name in enumerate(("a.mcap", "b.mcap", "c.mcap")):
        climb = "components.pilot.parameters.gain_per_s=" + ("0.25" if number == 2 else "0.5")
        status(["run", "glide.yaml", "--out", name, "--set", climb])
    capsys.readouterr()
    assert status(["diff", "a.mcap", "b.mcap"]) == 0
    assert capsys.readouterr().out.startswith("no difference in ")
    assert status(["diff", "a.mcap", "c.mcap"]) == 1
    assert "glider.state.altitude: value differs" in capsys.readouterr().out


def test_diff_with_a_shorter_flight_is_told_once(capsys):
    """Which is longer, and that up to the other's end all is equal; events in between too."""
    status(["run", "glide.yaml", "--out", "a.mcap"])
    status(["run", "glide.yaml", "--out", "b.mcap", "--set", "duration_s=2"])
    assert "note: 1 event after the end at 2 s never happens\n" in capsys.readouterr().err
    for pair in (["a.mcap", "b.mcap"], ["b.mcap", "a.mcap"]):
        assert status(["diff", *pair]) == 1
        longer, equal = capsys.readouterr().out.splitlines()
        assert longer == "a.mcap is longer: 10 s, b.mcap ends at 2 s"
        assert equal.endswith(" equal up to 2 s, 0 different")


def test_run_can_do_without_a_recording(capsys):
    """With --no-record nothing is left behind."""
    assert status(["run", "glide.yaml", "--no-record", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recording"] is None
    assert not list(Path().glob("*.mcap"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], 'hedgehop: Command "run" parameter SCENARIO requires an argument.'),
        (["glide.yaml", "--oot", "x"], "hedgehop: Unknown option: --oot. Did you mean --out?"),
        (["nowhere.yaml"], "nowhere.yaml: file not found, expected a scenario"),
        (["glide.yaml", "--set", "sed=1"], "--set #1: sed: unknown key, got 'sed', did you mean"),
        (
            ["glide.yaml", "--set", "components.glider.parameters.altitude_m=9"],
            (
                "--set #1: components.glider.parameters.altitude_m: below ground, got 9.0 m, "
                "expected 10.0 m or more"
            ),
        ),
        (
            ["glide.yaml", "--out", "nowhere/a.mcap"],
            "nowhere/a.mcap: cannot be written, no such file or directory",
        ),
        (
            ["glide.yaml", "--out", "glide.yaml"],
            (
                "glide.yaml: not a recording's name, got 'glide.yaml', "
                "expected one that ends in '.mcap'"
            ),
        ),
        (
            ["glide.yaml", "--set", "components.pilot.use=small_components:Refuser"],
            (
                "glide.yaml:12:3: component 'pilot': cannot be initialized, "
                "start outside the terrain, got north 5 m, expected up to 3 m"
            ),
        ),
    ],
)
def test_bad_usage_and_bad_scenarios_end_with_2(capsys, arguments, message):
    """One line that names it, no traceback, and no file left behind."""
    assert status(["run", *arguments]) == 2
    error = capsys.readouterr().err.removeprefix("compiling flight kernels (first time only) ...\n")
    assert error.startswith(message)
    assert "Traceback" not in error
    assert not list(Path().glob("**/*.mcap"))
    assert Path("glide.yaml").read_text() == SCENARIO


def test_a_refused_run_leaves_an_older_recording_alone(capsys):
    """The output is opened for the flight only."""
    status(["run", "glide.yaml"])
    before = Path("glide.mcap").read_bytes()
    assert status(["run", "glide.yaml", "--set", "seed=x"]) == 2
    assert Path("glide.mcap").read_bytes() == before


def test_ctrl_c_ends_the_flight_at_the_next_tick_with_the_recording_finished(capsys):
    """Exit code 130; the recording says how it ended."""
    override = "components.pilot.use=small_components:Interrupter"
    before = signal.getsignal(signal.SIGINT)
    assert status(["run", "glide.yaml", "--json", "--set", override]) == 130
    figures = json.loads(capsys.readouterr().out)
    assert (figures["outcome"], figures["duration_s"]) == ("interrupted", 1.05)
    assert recording_metrics(Path("glide.mcap"))["outcome"] == "interrupted"
    assert signal.getsignal(signal.SIGINT) is before


def test_a_failed_flight_ends_with_1(capsys):
    """The component that failed is named, and the recording is finished."""
    override = "components.pilot.use=small_components:Failing"
    assert status(["run", "glide.yaml", "--set", override]) == 1
    assert "component error after 1 s" in capsys.readouterr().out
    assert recording_metrics(Path("glide.mcap"))["outcome"] == "component error"


def test_an_end_that_the_scenario_names_is_a_failure_too(capsys):
    """The outcome is the enumeration's own text."""
    dive = "events.0.value=-1000.0"
    assert status(["run", "glide.yaml", "--json", "--set", dive]) == 1
    assert json.loads(capsys.readouterr().out)["outcome"] == "collision"


def test_a_defect_is_one_line_with_the_way_to_the_traceback(capsys, monkeypatch):
    """Exit code 3; HEDGEHOP_TRACEBACK=1 shows where."""

    def defective(*_):
        raise RuntimeError("a defect")

    monkeypatch.setattr("orchestrator.command.flights.built", defective)
    arguments = ["validate", "glide.yaml"]
    assert status(arguments) == 3
    error = capsys.readouterr().err
    assert "hedgehop: internal error, RuntimeError: a defect" in error
    assert "Traceback" not in error
    monkeypatch.setenv("HEDGEHOP_TRACEBACK", "1")
    assert status(arguments) == 3
    assert "Traceback" in capsys.readouterr().err


def test_a_mistake_in_a_component_is_the_users(capsys, monkeypatch):
    """Exit code 2 and one line; HEDGEHOP_TRACEBACK=1 shows the rest."""
    arguments = ["validate", "glide.yaml", "--set", "components.pilot.use=small_components:broken"]
    assert status(arguments) == 2
    error = capsys.readouterr().err
    assert "components.pilot: constructor failed, RuntimeError: a defect (small_comp" in error
    assert "Traceback" not in error
    monkeypatch.setenv("HEDGEHOP_TRACEBACK", "1")
    assert status(arguments) == 2
    assert 'raise RuntimeError("a defect")' in capsys.readouterr().err


def test_what_looks_like_markup_is_printed_as_it_is(capsys):
    """A reason may have brackets."""
    print_table("title [a]", flight_table({**REASON, "reason": "u[/x] [red] is wrong"}, None))
    assert "u[/x] [red] is wrong" in capsys.readouterr().out


REASON = {"outcome": "component error", "duration_s": 1.0}


def test_validate_says_what_it_found(capsys):
    """Nothing is flown."""
    assert status(["validate", "glide.yaml"]) == 0
    expected = "glide.yaml: valid, 2 components, 4 links, base tick 0.05 s\n"
    assert capsys.readouterr().out == expected


@pytest.mark.parametrize("command", [["validate"], ["run", "--no-record"]])
def test_a_forgotten_connection_is_a_note(capsys, command):
    """The scenario stays valid: an input may be meant to keep its start value."""
    text = SCENARIO.replace("  - {from: pilot.command, to: glider.command, delay_s: 0.05}\n", "")
    Path("glide.yaml").write_text(text)
    assert status([command[0], "glide.yaml", *command[1:]]) == 0
    note = "note: glider.command.climb (0 m/s): nothing is connected, the start value is kept\n"
    assert capsys.readouterr().err.endswith(note)


def test_a_folder_is_no_scenario(capsys):
    """It is told as such, whatever it holds."""
    Path("scenes").mkdir()
    assert status(["run", "scenes"]) == 2
    assert capsys.readouterr().err == "scenes: is a folder, expected a scenario file\n"


def test_a_layout_of_nothing_names_the_recording_only(capsys):
    """What cannot be read is told, not what is therefore not written."""
    assert status(["layout", "nope.mcap"]) == 2
    assert capsys.readouterr().err.startswith("nope.mcap: cannot be read, ")


def test_list_names_installed_components(capsys):
    """By entry point, with the first line of their docstrings."""
    assert status(["list"]) == 0
    printed = capsys.readouterr().out
    assert "plant.helicopter:Helicopter" in printed
    assert "`" not in printed
    assert ":class:" not in printed
    assert "LQ preview control behind the interface of controller.mpc.Mpc." in printed


def test_inspect_shows_variables_and_parameters_with_units(capsys):
    """Made from its defaults, or as a given scenario makes it."""
    assert status(["inspect", "small_components:Glider"]) == 0
    printed = capsys.readouterr().out
    assert "made with defaults" in printed
    lines = [" ".join(line.split()) for line in printed.splitlines()]
    assert "command.climb input Float64 m/s 0.0 rate of climb" in lines
    assert "altitude_m m 100.0 a number >= 0 and <= 1000 at the start" in lines
    assert 'takes ground: "${...}" (optional)' in lines
    assert "at the same instant: command -> state" in lines
    (title,) = (line for line in lines if "made with defaults" in line)
    assert "continuous, 20 Hz" in title
    keeper = ["inspect", "small_components:Keeper"]
    assert status(keeper) == 2
    text = SCENARIO.replace("small_components:Glider", "small_components:Keeper")
    Path("glide.yaml").write_text(text)
    assert status([*keeper, "--scenario", "glide.yaml"]) == 0
    assert "made with glider of glide.yaml" in capsys.readouterr().out


def test_inspect_shows_the_components_of_a_recording(capsys):
    """Their variables with causality, unit and how often each was recorded."""
    status(["run", "glide.yaml"])
    capsys.readouterr()
    assert status(["inspect", "glide.mcap"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == "glide.mcap: A glider"
    assert {"glider: continuous, 20 Hz", "pilot: sampled, 2 Hz"} < set(lines)
    assert "clearance output Float64 m 201 above ground" in lines
    assert "height_m tunable Float64 m 2 altitude to hold" in lines


def test_check_tells_every_clause(capsys):
    """Exit code 0 if the component keeps the contract."""
    assert status(["check", "small_components:Glider"]) == 0
    assert "passed" in capsys.readouterr().out


def test_schema_is_json(capsys):
    """For editors."""
    assert status(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["$schema"].startswith("https://json-schema.org")


def test_info_lists_the_topics_of_a_recording(capsys):
    """With counts; a file that is no recording is refused."""
    status(["run", "glide.yaml"])
    capsys.readouterr()
    assert status(["info", "glide.mcap"]) == 0
    assert "/glider/state" in capsys.readouterr().out
    assert status(["info", "glide.mcap", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "A glider"
    assert status(["info", "glide.yaml"]) == 2
    assert status(["metrics", "nowhere.mcap"]) == 2


def test_fly_is_the_same_from_python():
    """Twelve lines suffice: a flight has its result, figures, signals and recording."""
    flight = orchestrator.fly("glide.yaml", ["duration_s=5"], "a.mcap")
    assert flight.result.outcome == "flown"
    assert flight.metrics["duration_s"] == 5.0
    times, clearance = flight.trace["glider.clearance"]
    assert clearance.min() == flight.metrics["clearance_min_m"]
    assert times[-1] == 5.0
    assert flight.recording == Path("a.mcap")
    assert orchestrator.load("glide.yaml").title == "A glider"
    assert fly("glide.yaml").recording is None
    assert not hasattr(orchestrator, "nothing")


def test_one_thread_for_linear_algebra():
    """`main` says so before numpy is imported."""
    program = (
        "import os, sys; sys.argv = ['hedgehop', '--version']; "
        "from orchestrator.__main__ import main\n"
        "try: main()\n"
        "finally: print(os.environ['OMP_NUM_THREADS'])"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "4"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    assert done.stdout.split()[-1] == "1"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_told_and_ends_with_2(capsys):
    """A recording that cannot be written is bad usage, whenever that turns out."""
    Path("full.mcap").symlink_to("/dev/full")
    assert status(["run", "glide.yaml", "--out", "full.mcap"]) == 2
    assert "full.mcap: cannot be written, No space left on device\n" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "kind", "what"),
    [
        ("export", "Constructor", "constructor failed, KeyError: 'a' (small_mistakes.py:"),
        ("export", "NoComponent", "no describe, initialize, set, get, step, terminate, got No"),
        ("export", "Described", "describe failed, KeyError: 'x' (small_mistakes.py:"),
        ("inspect", "Described", "describe failed, KeyError: 'x' (small_mistakes.py:"),
    ],
)
def test_a_component_that_cannot_be_looked_at_is_one_line(capsys, command, kind, what):
    """Whatever is its own mistake is told with its place."""
    options = ["-o", "x.fmu"] if command == "export" else []
    assert status([command, f"small_mistakes:{kind}", *options]) == 2
    text = capsys.readouterr().err
    assert what in text
    assert text.count("\n") == 1
