"""The report: any recording gives a page, the page needs nothing else, and loses no peak."""

import json
import re
import struct
import sys
import zlib
from base64 import b64decode

import numpy as np
import pytest
from fake_system import SCENE, TICK_NS, flight, helicopter, make_system, port, tell
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.command.app import status
from orchestrator.listener import Result
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.report.charts import Chart, Line
from orchestrator.report.ground import ground
from orchestrator.report.pack import MOST_POINTS, description, holes, pack, thinned
from orchestrator.report.page import MOST_RECORDINGS, page, write_page
from orchestrator.report.shading import TINTS, contour_interval, png, relief, shade
from orchestrator.report.subject import labels, subjects
from orchestrator.scenario.records import ResourceSpec

WHOLE = helicopter(cells=20, capacity=8, posts=5, wall_clock=True)
KINDS = {
    "Float64": st.floats(),
    "Int64": st.integers(-(2**63), 2**63 - 1),
    "Boolean": st.booleans(),
    "String": st.text(max_size=5),
    "Enumeration": st.sampled_from([1, 2, 9]),
}


def recorded(path, system, calls, result=None):
    tell(Recorder(path), system, calls, result)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the recording of a made-up flight with every role."""
    path = tmp_path_factory.mktemp("report") / "whole.mcap"
    return recorded(path, WHOLE, flight(WHOLE, 5.0))


@st.composite
def anything(draw):
    """Draw a system of any ports, maybe with the roles of an aircraft, and what it published."""
    parts = draw(st.sets(st.sampled_from(["vehicle", "mpc", "sensor"])))
    held = [name for name in WHOLE.ports if name in parts]
    ports = [each for name in held for each in WHOLE.ports[name].values()]
    names = draw(
        st.lists(st.from_regex(r"[a-z]{1,3}(\.[a-z<&]{1,3})?", fullmatch=True), unique=True)
    )
    for name in names:
        kind = draw(st.sampled_from(sorted(KINDS)))
        shape = draw(st.sampled_from([(), (), (1,), (2, 3)])) if kind != "String" else ()
        items = {1: "one", 2: "</script>"} if kind == "Enumeration" else {}
        unit = draw(st.sampled_from(["m", "rad", "1"]))
        changes = draw(st.sampled_from(["continuous", "discrete"]))
        more = {"items": items, "variability": changes if kind == "Float64" else "discrete"}
        ports.append(port("own", name, unit, kind=kind, shape=shape, **more))
    roles = {role: name for role, name in SCENE.items() if name.partition(".")[0] in parts}
    chosen = draw(st.sets(st.sampled_from(sorted(roles)))) if roles else ()
    scene = {role: roles[role] for role in sorted(chosen)}
    system = make_system(ports, scene, wall_clock=draw(st.booleans()))
    calls = []
    values = {p.name: KINDS[p.type] for p in system.ports.get("own", {}).values()}
    for tick in range(draw(st.integers(0, 3))):
        if values:
            told = {
                name: np.array([draw(one) for _ in range(int(np.prod(shape)))]).reshape(shape)
                if (shape := system.ports["own"][name].shape)
                else draw(one)
                for name, one in values.items()
            }
            calls.append(("outputs", (tick * TICK_NS, "own", told)))
    if parts:
        calls += [call for call in flight(system, 0.6) if call[1][1] in (*parts, "")]
    calls.append(("event", (0, "set", "<b>", draw(st.text(max_size=5)))))
    calls.sort(key=lambda call: call[1][0])
    return system, calls


@given(anything(), st.sampled_from(["flown", "interrupted", "collision"]))
@settings(max_examples=40)
def test_any_recording_gives_a_page(tmp_path_factory, made, outcome):
    """Whatever ports, values and roles: a page, on its own and beside a flight."""
    system, calls = made
    path = tmp_path_factory.mktemp("any") / "any.mcap"
    recorded(path, system, calls, Result(outcome, "", TICK_NS, {}, 0.0, 0.0))
    found = subjects([path])
    text = page(found)
    assert text.startswith("<!doctype html>")
    drawn = {chart["title"] for chart in data_of(text)["charts"]}
    numbers = [p.name for p in system.ports.get("own", {}).values() if p.type != "String"]
    published = any(call == "outputs" and arguments[1] == "own" for call, arguments in calls)
    assert drawn >= set(numbers if published else ())


def data_of(text):
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])


def drawn_in(text, title):
    """Return the lines of the first chart of this title, with their numbers."""
    data = data_of(text)
    arrays = [np.frombuffer(b64decode(one), "<f4") for one in data["arrays"]]
    chart = next(chart for chart in data["charts"] if chart["title"] == title)
    numbers = ("x", "y", "t")
    return [
        line | {k: arrays[line[k]] for k in numbers if line[k] is not None}
        for line in chart["lines"]
    ]


def test_a_page_has_what_a_flight_has(whole):
    """Every role of the scene gets its charts, in words, too."""
    text = page(subjects([whole]))
    titles = [chart["title"] for chart in data_of(text)["charts"]]
    for wanted in (
        "Map", "Height profile", "Height above ground", "Height off the reference", "Load factor",
        "Thrust", "Tail", "Ladder", "Update time", "Cost",
    ):  # fmt: skip
        assert wanted in titles
    assert text.count("role='img'") == len(titles) == text.count("aria-label=")
    assert "aria-label='Height profile: altitude, m over distance flown, m; " in text
    for heading in ("Figures", "Events", "Resolved scenario", "Versions and origin"):
        assert f"<h2>{heading}</h2>" in text


def test_a_page_needs_nothing_else(whole):
    """No address of anything outside is in a page, and it is small."""
    text = page(subjects([whole]))
    assert re.findall(r"(?i)\bhttps?:|\bsrc\s*=|@import|url\((?!#)", text) == []
    assert set(re.findall(r"href=['\"]([^'\"]*)", text)) <= {f"#s{k}" for k in range(20)} | {
        "data:,",
        "${spec.picture.href}",
    }
    assert "Content-Security-Policy" in text
    assert len(text) < 2_000_000


def test_what_a_recording_says_is_text(tmp_path):
    """Markup in names, titles and messages is shown, not obeyed."""
    evil = "</script><img src=x onerror=alert(1)>"
    system = make_system([port("a", f"x.{evil}")])
    calls = [
        ("outputs", (0, "a", {f"x.{evil}": 1.0})),
        ("event", (0, "set", evil, evil)),
    ]
    text = page(subjects([recorded(tmp_path / "a.mcap", system, calls)]))
    assert "<img" not in text
    assert text.count("</script>") == 2


def test_recordings_share_what_is_the_same(whole, tmp_path):
    """Two flights have a column each and one reference, and what differs in their scenarios."""
    other = helicopter(cells=20, capacity=8, posts=5, wall_clock=True, seed=7)
    second = recorded(tmp_path / "second.mcap", other, flight(other, 5.0))
    text = page(subjects([whole, second]))
    profile = next(c for c in data_of(text)["charts"] if c["title"] == "Height profile")
    flown = [line["recording"] for line in profile["lines"] if line["name"] == "flown"]
    assert flown == [0, 1]
    assert [line["recording"] for line in profile["lines"] if line["name"] == "set height"] == [
        None
    ]
    row = "<th scope='row'>seed</th><td data-head='whole'>0</td><td data-head='second'>7</td>"
    assert row in text
    assert re.findall(r"<button[^>]* data-recording='(\d)'", text) == ["0", "1"]


@pytest.mark.parametrize(
    ("files", "called"),
    [
        (["x/a.mcap", "x/b.mcap"], ["a", "b"]),
        (["x/1/a.mcap", "x/2/a.mcap", "x/2/b.mcap"], ["1/a", "2/a", "b"]),
        (["1/x/a.mcap", "2/x/a.mcap"], ["1/x/a", "2/x/a"]),
        (["a.mcap", "a.mcap"], ["a (1)", "a (2)"]),
    ],
)
def test_recordings_of_one_name_are_told_apart(files, called, tmp_path):
    """A recording is called by the shortest ending of its path that no other has."""
    assert labels([tmp_path / file for file in files]) == called


def test_more_recordings_than_can_be_told_apart_are_refused(whole, tmp_path, capsys):
    """More recordings than there are looks of a line end with one line and no page."""
    out = tmp_path / "out.html"
    assert run("report", *[whole] * (MOST_RECORDINGS + 1), "-o", out) == 2
    assert capsys.readouterr().err.endswith(f"expected at most {MOST_RECORDINGS}\n")
    assert not out.exists()


def test_what_is_missing_is_a_gap(tmp_path):
    """Where messages were lost a line breaks off; what was only written on change holds."""
    lost = range(2_000_000_000, 4_000_000_000)
    calls = [c for c in flight(WHOLE, 6.0) if c[1][0] not in lost]
    text = page(subjects([recorded(tmp_path / "lost.mcap", WHOLE, calls)]))
    for title, is_broken in (("Load factor", True), ("scan.stamp", False), ("Map", True)):
        for line in drawn_in(text, title):
            assert np.isnan(line["y"]).any() == is_broken
            shown = line["t" if title == "Map" else "x"][np.isfinite(line["y"])]
            assert ((shown < 2.0) | (shown >= 4.0)).all()


@given(st.integers(1, 50), st.integers(2, 9), st.floats(1e-3, 10.0))
def test_a_hole_is_what_a_regular_rate_lacks(before, lacking, period):
    """A hole begins one period after the last point and ends one before the next."""
    times = period * np.delete(np.arange(100), slice(before, before + lacking))
    ends = period * np.array([before, before + lacking - 1])
    assert holes(times) == pytest.approx(ends)


@given(st.integers(1, 98), st.floats(1e-3, 10.0))
def test_one_lost_point_is_no_hole(lost, period):
    """A line goes on over a single message that is missing."""
    assert not len(holes(period * np.delete(np.arange(100), lost)))


@given(st.lists(st.floats(0.0, 9.0), max_size=3), st.integers(0, 100))
def test_without_a_rate_there_is_no_hole(some, count):
    """A few points, points at one instant and points at ever longer steps have no holes."""
    for times in (np.sort(some)[:2], np.zeros(count), 1.3 ** np.arange(count)):
        assert not len(holes(times))


@pytest.mark.parametrize(
    ("low", "high", "unit", "is_log"),
    [(1, 99, "1", False), (1, 101, "1", True), (0, 101, "1", False), (1, 101, "m", False)],
)
def test_decades_have_a_logarithmic_axis(low, high, unit, is_log, tmp_path):
    """Pure numbers that are all positive and span two decades are drawn over a logarithm."""
    system = make_system([port("a", "x", unit)])
    calls = [("outputs", (k * TICK_NS, "a", {"x": float(x)})) for k, x in enumerate((low, high))]
    text = page(subjects([recorded(tmp_path / "a.mcap", system, calls)]))
    assert [chart["log"] for chart in data_of(text)["charts"]] == [is_log]


def test_a_limit_says_which_side_is_beyond_it(whole):
    """A control's bounds are limits, the least from below and the most from above."""
    text = page(subjects([whole]))
    tail = next(chart for chart in data_of(text)["charts"] if chart["title"] == "Tail")
    limits = [(mark["text"], mark["upper"]) for mark in tail["marks"]]
    assert limits == [("at least −28.65", False), ("at most 28.65", True)]


@given(st.integers(0, 30_000), st.integers(4, 4000), st.integers(0, 2**32 - 1))
def test_thinning_loses_no_peak(n, limit, seed):
    """A thinned line has at most so many points, in order, with its ends and its extremes."""
    rng = np.random.default_rng(seed)
    values = np.where(rng.random(n) < 0.1, np.nan, rng.standard_normal(n))
    kept = thinned(values, limit)
    assert len(kept) <= max(limit, 4)
    assert (np.diff(kept) > 0).all()
    if np.isfinite(values).any():
        assert np.nanmax(values[kept]) == np.nanmax(values)
        assert np.nanmin(values[kept]) == np.nanmin(values)
        assert kept[0] == 0
        assert kept[-1] == n - 1


@pytest.mark.parametrize("lines", [1, 20, 300])
def test_however_much_was_recorded_a_page_is_small(lines):
    """The numbers of one recording stay below 1.5 MB, and one line has at most 4000 points."""
    rng = np.random.default_rng(0)
    x = np.arange(20_000.0)
    charts = [
        Chart("a", ("t", "s"), ("", ""), (Line("a", 0, x, rng.standard_normal(len(x))),))
        for _ in range(lines)
    ]
    packed = pack(charts)
    assert sum(map(len, packed["arrays"])) < 1_500_000
    points = len(packed["arrays"][packed["charts"][0]["lines"][0]["y"]]) * 3 // 16
    assert points <= MOST_POINTS
    assert description(charts[0], ["r"]).startswith("a:  over t, s; a from ")


def test_what_faces_the_light_is_bright():
    """Level ground is evenly lit; a slope that faces up left is brighter, one away from it darker."""
    level = shade(np.zeros((5, 6)), 10.0)
    assert np.ptp(level) == 0.0
    rows, columns = np.mgrid[0:5, 0:6]
    towards = shade((rows + columns).astype(float), 10.0)  # rises to the lower right
    away = shade(-(rows + columns).astype(float), 10.0)
    assert towards.min() > level.max() > away.max()


def test_relief_is_a_png_of_its_size():
    """The picture holds one palette index per post, and where nothing is known none is drawn."""
    elevation = np.add.outer(np.arange(7.0), np.arange(9.0))
    elevation[2, 3] = np.nan
    data = relief(elevation, 5.0, contour_interval(14.0))
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">2I", data[16:24]) == (9, 7)
    start = data.index(b"IDAT")
    rows = zlib.decompress(
        data[start + 4 : start + 4 + struct.unpack(">I", data[start - 4 : start])[0]]
    )
    index = np.frombuffer(rows, np.uint8).reshape(7, 10)[:, 1:]
    assert np.argwhere(index == 255).tolist() == [[2, 3]]
    assert png(index, np.zeros((256, 3), np.uint8))[:8] == data[:8]


@given(st.floats(0.0, 5000.0))
def test_contours_are_round_and_few(rise):
    """The interval is 1, 2 or 5 times a power of ten, and fewer than ten bands cover the rise."""
    interval = contour_interval(rise)
    assert round(interval / 10 ** np.floor(np.log10(interval * 1.001))) in (1, 2, 5)
    assert rise / interval < TINTS - 1


def test_the_terrain_is_made_again_only_if_it_is_ours(tmp_path, monkeypatch):
    """A terrain that did not come with hedgehop is not even imported; the sensor's cells serve."""
    (tmp_path / "strange.py").write_text("raise SystemExit('imported')")
    monkeypatch.syspath_prepend(tmp_path)
    system = helicopter(cells=20, capacity=8, posts=5)
    scenario = system.scenario
    for use in ("strange:Terrain", "plant.terrain:Path", "plant.helicopter:HelicopterModel"):
        spec = ResourceSpec("terrain", use, {})
        object.__setattr__(scenario, "resources", (spec,))
        scenario.scene["terrain"] = "${terrain}"
        path = recorded(tmp_path / "strange.mcap", system, flight(system, 1.0))
        found = ground(Recording.open(path))
        assert found is not None
        assert found.source == "cells that the sensor reported"
    assert "strange" not in sys.modules


@pytest.mark.parametrize("damage", [b"", b"no recording", None])
def test_what_is_no_recording_is_one_line(whole, tmp_path, capsys, damage):
    """A damaged file, a wrong name and no file at all end with one line and no page."""
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(whole.read_bytes()[:-200] if damage is None else damage)
    out = tmp_path / "out.html"
    assert run("report", whole, broken, "-o", out) == 2
    error = capsys.readouterr().err
    assert error.startswith(str(broken))
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_recording_is_never_overwritten(whole, capsys):
    """Only a page's name is taken for a page."""
    before = whole.read_bytes()
    assert run("report", whole, "-o", whole) == 2
    assert "expected one that ends in '.html'" in capsys.readouterr().err
    assert whole.read_bytes() == before


def test_a_page_is_named_after_its_recording(whole, tmp_path, monkeypatch, capsys):
    """Without a name, the page lies in this folder under the first recording's."""
    monkeypatch.chdir(tmp_path)
    assert run("report", whole) == 0
    assert (tmp_path / "whole.html").read_text().startswith("<!doctype html>")
    assert "whole.html: written" in capsys.readouterr().out


def test_a_page_depends_on_its_recordings_alone(whole, tmp_path):
    """The same recordings give the same bytes."""
    for name in ("a.html", "b.html"):
        write_page([whole], tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def run(*arguments):
    return status([str(argument) for argument in arguments])
