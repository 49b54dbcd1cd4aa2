"""The report's tables of several recordings, and what it never overwrites."""

from html.parser import HTMLParser

import pytest
from fake_system import flight, helicopter, tell

from orchestrator.command.app import status
from orchestrator.listener import Result
from orchestrator.recording.recorder import Recorder
from orchestrator.report.subject import subjects
from orchestrator.report.words import figures

NAME = "a<b>&'c"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return two recordings of a flight in which a component of an unusual name was at fault."""
    system = helicopter(cells=20, capacity=8, posts=5)
    folder = tmp_path_factory.mktemp("words")
    made = [folder / "a.mcap", folder / "b.html"]
    for path in made:
        result = Result("flown", "", 10**9, {f"out_of_range.{NAME}": 3})
        tell(Recorder(path), system, flight(system, 1.0), result)
    return made


@pytest.mark.parametrize("count", [1, 2])
def test_names_are_escaped_once(recordings, count):
    """What a reader sees of a component's name is the name, in tiles and in a table."""
    seen: list[str] = []
    parser = HTMLParser()
    parser.handle_data = seen.append
    parser.feed(figures(subjects(recordings[:count])).html)
    parser.close()
    assert f"out of range: {NAME}" in "".join(seen)


def test_a_page_never_takes_the_place_of_a_recording(recordings, capsys):
    """Not only of the first one."""
    before = recordings[1].read_bytes()
    assert status(["report", *map(str, recordings), "-o", str(recordings[1])]) == 2
    assert "b.html: is what is read, expected another file" in capsys.readouterr().err
    assert recordings[1].read_bytes() == before
