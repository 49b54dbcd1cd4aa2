"""A recording as a component, and a recorded flight flown again."""

import numpy as np
import pytest
import small_components
from fmpy.validation import validate_model_description

from orchestrator.assembly.build import build
from orchestrator.assembly.description import Port, ports
from orchestrator.assembly.units import Unit
from orchestrator.command.app import status
from orchestrator.flight import fly, fly_system
from orchestrator.playback.component import Playback, PlaybackParameters
from orchestrator.playback.description import describe
from orchestrator.recording.reader import Recording
from orchestrator.scenario.load import load

VARIANTS = {
    "no latency": {},
    "latency": {"components.pilot.latency_s": 0.25},
    "latency of more than a period": {"components.pilot.latency_s": 0.65},
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a scenario of a glider and a pilot."""
    (tmp_path / "glider.yaml").write_text(small_components.SCENARIO)
    (tmp_path / "ground.txt").write_text(small_components.GROUND)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def overrides(given):
    return [f"{key}={value}" for key, value in given.items()]


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("played", ["glider", "pilot"])
def test_a_recorded_component_publishes_what_it_published_when_it_did(folder, variant, played):
    """The other component, and every recorded signal, are the same to the last bit."""
    settings = overrides(VARIANTS[variant])
    first = fly("glider.yaml", settings, out="first.mcap")
    again = fly("glider.yaml", [*settings, f"components.{played}.use=first.mcap"])
    for name in first.trace.names:
        (times, values), (times_again, values_again) = first.trace[name], again.trace[name]
        assert np.array_equal(times, times_again), name
        assert np.array_equal(values, values_again), name


def test_a_recorded_component_describes_itself_as_the_component_did(folder):
    """Names, causality, types, shapes, units, bounds, items and feed-through are the same."""
    system = build(load("glider.yaml"))
    fly_system(build(load("glider.yaml")), folder / "first.mcap")
    played = Playback(PlaybackParameters(folder / "first.mcap", "glider"))
    problems = validate_model_description(
        played.describe(), validate_variable_names=True, validate_model_structure=True
    )
    assert problems == []
    again = build(load("glider.yaml", ["components.glider.use=first.mcap"])).ports["glider"]
    for name, port in system.ports["glider"].items():
        if port.causality != "independent":
            assert vars(again[name]) | {"start": None} == vars(port) | {"start": None}


def test_a_recorded_unit_of_no_known_dimension_stays_unknown():
    """What its name would mean for a native component is not read into it."""
    force = Port("c", "force", "output", "continuous", "Float64", unit=Unit("N", None))
    assert ports("c", describe("c", "as recorded", [force]))["force"].unit == Unit("N", None)


def test_a_flight_longer_than_the_recording_is_refused(folder, capsys):
    """What was not recorded cannot be played."""
    fly("glider.yaml", ["duration_s=4", "events=[]"], out="first.mcap")
    assert status(["run", "glider.yaml", "--set", "components.pilot.use=first.mcap"]) == 2
    text = capsys.readouterr().err
    assert "recording 'first.mcap' is too short, got 4 s, expected at least 10 s" in text


def test_a_component_that_was_not_recorded_is_named(folder, capsys):
    """The nearest recorded one is suggested."""
    fly("glider.yaml", out="first.mcap")
    options = ["components.pilot.use=first.mcap", "components.pilot.parameters.component=pilott"]
    assert status(["run", "glider.yaml", *(x for o in options for x in ("--set", o))]) == 2
    text = capsys.readouterr().err
    assert "not in 'first.mcap', got 'pilott', did you mean 'pilot'" in text


def test_a_replay_finds_no_difference_in_an_equal_flight(folder, capsys):
    """The scenario in the recording is all that is needed, but for the files beside it."""
    fly("glider.yaml", ["components.pilot.parameters.gain_per_s=0.3"], out="first.mcap")
    (folder / "glider.yaml").unlink()
    assert status(["replay", "first.mcap", "--trust"]) == 0
    count = len(Recording.open(folder / "first.mcap").signals)
    assert f"no difference in {count} signals" in capsys.readouterr().out


def test_a_replay_without_signals_says_that_there_were_none(folder, capsys):
    """Agreement of nothing with nothing is not told as agreement."""
    fly("glider.yaml", ["recording.include=[/events]"], out="first.mcap")
    assert status(["replay", "first.mcap", "--trust"]) == 0
    assert "in how it ends; no signals were recorded" in capsys.readouterr().out


@pytest.mark.parametrize(
    "command",
    [
        ["replay", "first.mcap", "--trust", "--out", "first.mcap"],
        ["run", "glider.yaml", "--set", "components.pilot.use=first.mcap", "--out", "first.mcap"],
    ],
)
def test_a_recording_that_is_read_is_not_written_over(folder, capsys, command):
    """Neither by its own replay nor by a flight in which it plays a component."""
    fly("glider.yaml", out="first.mcap")
    before = (folder / "first.mcap").read_bytes()
    assert status(command) == 2
    wanted = "first.mcap: is what is read, expected another file to write to"
    assert wanted in capsys.readouterr().err
    assert (folder / "first.mcap").read_bytes() == before


def test_a_replay_tells_the_first_difference_and_what_has_changed_since(folder, capsys):
    """Time, component and variable, and the file that is not the one that was flown over."""
    fly("glider.yaml", out="first.mcap")
    (folder / "ground.txt").write_text("20")
    assert status(["replay", "first.mcap", "--trust"]) == 1
    text = capsys.readouterr().out
    assert (
        "first difference: glider.clearance: value differs at t = 0.000 s, got 80.0 and 70.0"
        in text
    )
    assert "resources.ground.parameters.file.sha256: " in text


def test_an_interrupted_flight_is_replayed_up_to_the_interruption(folder, capsys):
    """What happened before is the same; what would have come after is nobody's difference."""
    flown = []
    system = build(load("glider.yaml"))
    fly_system(system, folder / "first.mcap", None, lambda: flown.append(0) or len(flown) > 90)
    assert Recording.open(folder / "first.mcap").result.outcome == "interrupted"
    assert status(["replay", "first.mcap", "--trust"]) == 0


def test_a_replay_of_strange_code_asks_first(folder, capsys):
    """Without a terminal to ask on it is refused, naming what would be run."""
    fly("glider.yaml", out="first.mcap")
    assert status(["replay", "first.mcap"]) == 2
    text = capsys.readouterr().err
    assert "small_components:Glider" in text
    assert "expected --trust" in text
