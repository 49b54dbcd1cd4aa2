"""The report as a browser shows it; needs Chromium, which only ``make check`` asks for."""

import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest
from chromium import Tab
from fake_system import flight, make_system, port, tell

from orchestrator.recording.recorder import Recorder
from orchestrator.report.page import write_page

pytestmark = pytest.mark.viewers

OPEN_ALL = """
new Promise(done => {
  document.querySelectorAll("details").forEach(one => { one.open = true; });
  setTimeout(done, 300);
})
"""
DRAWN = """
[...document.querySelectorAll("figure[data-chart]")].map(figure => ({
  title: figure.querySelector("figcaption").textContent,
  lines: [...figure.querySelectorAll(".plot path.line")].some(one => one.getAttribute("d")),
  width: figure.querySelector(".plot svg")?.viewBox.baseVal.width,
  room: figure.querySelector(".plot").clientWidth,
  says: figure.querySelector(".plot").getAttribute("aria-label").length,
}))
"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Return the pages of a flight, of it and another one, and of a system without an aircraft.

    ``many`` has nine recordings of the last.
    """
    folder = tmp_path_factory.mktemp("report")
    scenario = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
    flights = [folder / "slow.mcap", folder / "fast.mcap"]
    for file, speed in zip(flights, (20, 30), strict=True):
        more = ["--set", "duration_s=5", "--set", f"components.mpc.parameters.speed_mps={speed}"]
        arguments = ["run", str(scenario), *more, "--out", str(file)]
        subprocess.run([sys.executable, "-m", "orchestrator", *arguments], check=True)
    system = make_system([port("a", "x"), port("b", "y", "rad"), port("b", "on", kind="Boolean")])
    tell(Recorder(folder / "plain.mcap"), system, flight(system))
    many = [folder / f"{k}.mcap" for k in range(9)]
    for copy in many:
        copy.write_bytes((folder / "plain.mcap").read_bytes())
    made = {"flight": flights[:1], "both": flights, "plain": many[:1], "many": many}
    for name, recordings in made.items():
        write_page(recordings, folder / f"{name}.html")
    return {name: folder / f"{name}.html" for name in made}


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    """Return a tab of a browser that has never been used."""
    with Tab(tmp_path_factory.mktemp("profile")) as tab:
        yield tab


@pytest.mark.parametrize("width", [1600, 400])
@pytest.mark.parametrize("name", ["flight", "both", "plain", "many"])
def test_every_chart_is_drawn(pages, tab, name, width):
    """Nothing is logged or asked for, all charts are there, and the page is as wide as the screen."""
    tab.show(pages[name], width=width, scheme="dark" if width < 600 else "light")
    tab.evaluate(OPEN_ALL)
    charts = tab.evaluate(DRAWN)
    assert len(charts) >= 3
    assert [chart for chart in charts if not chart["lines"] or not chart["says"]] == []
    assert [chart for chart in charts if chart["width"] != chart["room"]] == []
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert tab.logged == []
    asked = [address for address in tab.requested if not address.startswith("data:")]
    assert asked == [pages[name].as_uri()]


def test_the_cursor_reads_every_chart(pages, tab):
    """An arrow key on one chart shows values in all that have one then; Escape takes zoom back."""
    tab.show(pages["flight"], width=1600)
    press = "document.activeElement.dispatchEvent(new KeyboardEvent('keydown', {key: '%s'}))"
    ticks = "document.querySelector('[data-chart=\"4\"] .plot svg').textContent"
    tab.evaluate("document.querySelector('[data-chart=\"3\"] .plot').focus()")
    before = tab.evaluate(ticks)
    tab.evaluate(press % "ArrowRight")
    values = "[...document.querySelectorAll('figure ul b')].map(one => one.textContent)"
    assert sum(text != "" for text in tab.evaluate(values)) > 20
    tab.evaluate(press % "+")
    assert tab.evaluate(ticks) != before
    tab.evaluate(press % "Escape")
    assert tab.evaluate(ticks) == before


@pytest.mark.parametrize("width", [1600, 400])
@pytest.mark.parametrize("name", ["flight", "both", "plain"])
def test_nothing_moves_when_values_are_shown(pages, tab, name, width):
    """The page and every chart stay where they are while a pointer moves over a chart."""
    tab.show(pages[name], width=width)
    tab.evaluate(OPEN_ALL)
    places = "[...document.querySelectorAll('.plot')].map(one => one.getBoundingClientRect().top)"
    before = tab.evaluate(places)
    for part in (0.3, 0.6, 0.9):
        tab.evaluate(f"plots[0].show({{x: plots[0].ranges().x[1] * {part}, y: 0}})")
        assert tab.evaluate("document.querySelector('figure ul b').textContent")
        assert tab.evaluate(places) == before


def test_lines_of_many_recordings_look_different(pages, tab):
    """No two of nine recordings have the same colour, dashes and dots."""
    tab.show(pages["many"], width=1600)
    looks = tab.evaluate("[...document.querySelectorAll('button svg')].map(one => one.innerHTML)")
    assert len(set(looks)) == len(looks) == 9


@pytest.mark.parametrize("name", ["flight", "both", "many"])
def test_a_phone_shows_whole_tables(pages, tab, name):
    """At 400 px no value of a table lies beyond the screen, nor has to be scrolled to."""
    tab.show(pages[name], width=400)
    tab.evaluate(OPEN_ALL)
    ends = "[...document.querySelectorAll('td')].map(one => one.getBoundingClientRect().right)"
    assert max(tab.evaluate(ends)) <= 400
    wide = (
        "[...document.querySelectorAll('.scroll')].some(one => one.scrollWidth > one.clientWidth)"
    )
    assert not tab.evaluate(wide)


@pytest.mark.parametrize("width", [1600, 400])
def test_labels_of_the_map_lie_apart(pages, tab, width):
    """North and the way-points can all be read."""
    tab.show(pages["flight"], width=width)
    edges = """[...document.querySelectorAll("svg.map .label")].map(one => {
      const {left, right, top, bottom} = one.getBoundingClientRect();
      return [left, right, top, bottom];
    })"""
    labels = tab.evaluate(edges)
    assert len(labels) == 3
    for a, b in combinations(labels, 2):
        assert a[1] < b[0] or b[1] < a[0] or a[3] < b[2] or b[3] < a[2]


def test_a_recording_can_be_switched_off(pages, tab):
    """Its button takes a recording's lines out of every chart, and brings them back."""
    tab.show(pages["both"], width=1600)
    count = "document.querySelectorAll('.plot path.line.k1').length"
    click = "document.querySelector('button[data-recording=\"1\"]').click()"
    assert (before := tab.evaluate(count)) > 0
    tab.evaluate(click)
    assert tab.evaluate(count) == 0
    tab.evaluate(click)
    assert tab.evaluate(count) == before
