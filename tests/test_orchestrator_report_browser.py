"""The report as a browser shows it; needs Chromium, which only ``make check`` asks for."""

import subprocess
import sys
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
    """Return the pages of a flight, of it and another one, and of a system without an aircraft."""
    folder = tmp_path_factory.mktemp("report")
    scenario = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
    flights = [folder / "slow.mcap", folder / "fast.mcap"]
    for file, speed in zip(flights, (20, 30), strict=True):
        more = ["--set", "duration_s=5", "--set", f"components.mpc.parameters.speed_mps={speed}"]
        arguments = ["run", str(scenario), *more, "--out", str(file)]
        subprocess.run([sys.executable, "-m", "orchestrator", *arguments], check=True)
    system = make_system([port("a", "x"), port("b", "y", "rad"), port("b", "on", kind="Boolean")])
    tell(Recorder(folder / "plain.mcap"), system, flight(system))
    made = {"flight": flights[:1], "both": flights, "plain": [folder / "plain.mcap"]}
    for name, recordings in made.items():
        write_page(recordings, folder / f"{name}.html")
    return {name: folder / f"{name}.html" for name in made}


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    """Return a tab of a browser that has never been used."""
    with Tab(tmp_path_factory.mktemp("profile")) as tab:
        yield tab


@pytest.mark.parametrize("width", [1600, 400])
@pytest.mark.parametrize("name", ["flight", "both", "plain"])
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
