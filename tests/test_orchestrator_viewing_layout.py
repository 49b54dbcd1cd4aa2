"""Layouts: every path in them is in the recording, whatever that holds."""

import json
import re
from dataclasses import replace

import pytest
from fake_system import SCENE, flight, helicopter, make_system, port, tell
from mcap.reader import make_reader

from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder
from orchestrator.recording.topics import topics
from orchestrator.scenario.records import EventSpec, RecordingSpec
from orchestrator.viewing.layout import NAME, layout
from orchestrator.viewing.plots import pages, planned, recorded, states

POSE = ("north", "east", "down", "phi", "theta", "psi")


def odd():
    """Return a system whose names no message can spell, with text, arrays and many of a kind."""
    ports = [port("c", f"der(x[{k}])") for k in range(20)]
    ports += [port("c", "plan.text", kind="String"), port("c", "plan.n", kind="Int64")]
    ports += [port("c", "outputs.b", kind="Boolean")]
    ports += [port("c", "mode", kind="Enumeration", items={0: "a b"})]
    ports += [port("c", "plan.many", shape=(3,)), port("c", "state.x", "1")]
    return make_system(ports, {"plan": "c.plan", "controls": "c.state"}, wall_clock=True)


SYSTEMS = {
    "helicopter": helicopter(cells=6, capacity=4, posts=3, wall_clock=True),
    "changed height": helicopter(
        cells=6, capacity=4, posts=3, events=(EventSpec(1.0, "mpc.height_agl_m", 5.0),)
    ),
    "no scene roles": make_system([port("c", "x"), port("c", "y", "rad")]),
    "a craft alone": make_system([port("v", f"pose.{n}") for n in POSE], {"pose": "v.pose"}),
    "odd names": odd(),
    "no outputs": make_system([port("c", "p", causality="parameter")]),
}


def variant(system, **recording):
    """Return the system with other settings of its recording."""
    spec = replace(system.scenario.recording, **recording)
    return replace(system, scenario=replace(system.scenario, recording=spec))


SYSTEMS |= {
    "half left out": variant(SYSTEMS["helicopter"], exclude=("/mpc/*", "/scene/profile")),
    "scene off": variant(SYSTEMS["helicopter"], scene=False),
}


@pytest.fixture(scope="module", params=SYSTEMS)
def recording(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("layout") / "a.mcap"
    system = SYSTEMS[request.param]
    calls = flight(system, 0.5) if request.param != "no outputs" else [("log", (0, 20, "x", "y"))]
    calls = [call for call in calls if call[0] != "parameters" or "mpc" in system.ports]
    tell(Recorder(path), system, calls)
    return Recording.open(path)


def attached(recording):
    """Return the layout in the file, or None."""
    with recording.path.open("rb") as stream:
        found = {a.name: a.data for a in make_reader(stream).iter_attachments()}
    return json.loads(found[NAME]) if NAME in found else None


def paths(made):
    """Yield every path of every panel."""
    for panel in made["configById"].values():
        for path in panel.get("paths", []):
            yield path["value"]


def panels(tree):
    """Yield the panels of a layout tree."""
    if isinstance(tree, str):
        yield tree
    else:
        yield from panels(tree["first"])
        yield from panels(tree["second"])
        assert tree["direction"] in ("row", "column")
        assert 0 < tree["splitPercentage"] < 100


def test_every_path_exists(recording):
    """A path is a number, or a topic and a field of its messages that a plot can show."""
    made = [layout(recorded(recording)), *filter(None, [attached(recording)])]
    for path in (path for one in made for path in paths(one)):
        if re.fullmatch(r"-?[\d.e+-]+", path):
            continue
        topic, _, field = path.rpartition(".")
        assert field in recording.topics[topic].types
        assert re.fullmatch(r"(/\w+)+", topic)


def test_every_topic_of_a_layout_exists(recording):
    """So do the topics that the 3D panel and the log panel show."""
    made = layout(recorded(recording))
    shown = made["configById"].get("3D!scene", {"topics": {}})
    assert set(shown["topics"]) <= set(recording.topics)
    assert made["configById"]["RosOut!log"]["topicToRender"] in recording.topics


def test_the_form_is_a_layout(recording):
    """Every panel is placed once and set up, on a tab or beside them."""
    made = layout(recorded(recording))
    assert set(made) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    placed = list(panels(made["layout"]))
    tabs = made["configById"].get("Tab!plots", {"tabs": []})["tabs"]
    placed += [name for tab in tabs for name in panels(tab["layout"])]
    assert sorted(placed) == sorted(made["configById"])
    kinds = {"3D", "Plot", "RosOut", "StateTransitions", "Tab"}
    assert {name.partition("!")[0] for name in placed} <= kinds


def test_every_series_has_its_unit_and_every_plot_one(recording):
    """Labels end in the unit; no viewer shows it otherwise."""
    for plots in pages(recorded(recording)).values():
        for plot in plots:
            assert plot.fields
            for field in plot.fields:
                unit = recording.topics[field.topic].metadata[f"unit.{field.name}"]
                assert field.label.endswith(f"[{unit}]")
                assert unit == plot.unit


def test_the_scene_is_visible(tmp_path):
    """All that is drawn is shown without a click, but what another topic draws better."""
    made = layout(recorded(flown(tmp_path, SYSTEMS["helicopter"])))
    shown = made["configById"]["3D!scene"]
    hidden = {topic for topic, one in shown["topics"].items() if not one["visible"]}
    assert hidden == {"/scene/pose", "/scene/plan"}
    assert {"/scene/craft", "/scene/rotor", "/scene/marks", "/scene/paths"} <= set(shown["topics"])
    assert shown["followTf"] == "heli"


def test_plots_show_heights_limits_and_states(tmp_path):
    """Set height and actuator limits are lines, enumerations are states, times are plotted."""
    contents = recorded(flown(tmp_path, SYSTEMS["helicopter"]))
    found = pages(contents)
    assert list(found)[:3] == ["flight", "controls", "updates"]
    assert list(found)[-1] == "timing"
    assert found["flight"][0].lines == {"set height": 10.0}
    assert found["controls"][0].lines["max of thrust"] == 3.5
    assert "ladder" in {field.name for field in states(contents)}
    assert "/mpc/cost" in {f.topic for p in found["updates"] for f in p.fields}
    assert {f.topic for p in found["timing"] for f in p.fields} == {"/wall_clock"}


def test_what_no_role_tells_of_is_plotted_by_component(tmp_path):
    """Without roles the plots of all outputs take the scene's place, a page for each component."""
    ports = [
        port("a", "x", "m"),
        port("a", "y", "rad"),
        port("b", "z"),
        port("b", "t", kind="String"),
    ]
    contents = recorded(flown(tmp_path, make_system(ports)))
    found = {page: [p.unit for p in plots] for page, plots in pages(contents).items()}
    assert found == {"a": ["m", "rad"], "b": ["m"]}
    made = layout(contents)
    assert "3D!scene" not in made["configById"]
    assert made["layout"]["first"] == "Tab!plots"


def test_a_height_that_changes_is_a_series(tmp_path):
    """A line would be wrong: the parameter's own values are plotted."""
    system = SYSTEMS["changed height"]
    path = tmp_path / "a.mcap"
    later = ("parameters", (25 * 10**7, "mpc", {"height_agl_m": 5.0}))
    tell(Recorder(path), system, [*flight(system, 0.5), later])
    for contents in (recorded(Recording.open(path)),):
        height = pages(contents)["flight"][0]
        assert height.lines == {}
        assert [f.topic for f in height.fields] == ["/vehicle/outputs", "/mpc/parameters"]


def test_a_height_that_an_event_will_change_is_planned_as_a_series():
    """The layout is made before the flight: what the parameter starts at is no line then either."""
    height = port("c", "h", causality="parameter", variability="tunable", start=10.0)
    roles = {"clearance": "c.clearance", "height_agl": "c.h"}
    lines = []
    for events in ((), (EventSpec(1.0, "c.h", 5.0),)):
        system = make_system([port("c", "clearance"), height], roles, events=events)
        plots = pages(planned(system, topics(system, wall_clock=False)))["flight"]
        lines.append(plots[0].lines)
    assert lines == [{"set height": 10.0}, {}]


def test_a_recording_without_scene_has_no_layout_attached(tmp_path):
    """It is what viewers need, and nothing else in it is for them."""
    assert attached(flown(tmp_path, SYSTEMS["scene off"])) is None
    assert RecordingSpec().scene
    assert SCENE


def flown(folder, system):
    """Return the recording of a made-up flight."""
    tell(Recorder(folder / "b.mcap"), system, flight(system, 0.5))
    return Recording.open(folder / "b.mcap")


def test_the_command_writes_the_layout(tmp_path, capsys, monkeypatch):
    """`hedgehop layout` writes it beside where one is, or where one says."""
    from orchestrator.command.app import status

    path = flown(tmp_path, SYSTEMS["helicopter"]).path
    monkeypatch.chdir(tmp_path)
    assert status(["layout", str(path)]) == 0
    assert status(["layout", str(path), "-o", "x.json"]) == 0
    written = [
        (tmp_path / name).read_text(encoding="utf-8") for name in ("b.layout.json", "x.json")
    ]
    assert (
        json.loads(written[0]) == json.loads(written[1]) == layout(recorded(Recording.open(path)))
    )
    assert status(["layout", str(tmp_path / "none.mcap")]) == 2
    assert "none.mcap" in capsys.readouterr().err
