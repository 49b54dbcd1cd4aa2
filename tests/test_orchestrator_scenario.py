"""Scenario files: what they mean as records, and how everything wrong in one is told."""

from pathlib import Path

import pytest
from small_components import SCENARIO

from orchestrator.errors import ScenarioError
from orchestrator.scenario import layers
from orchestrator.scenario.load import json_schema, load
from orchestrator.scenario.records import ComponentSpec, ConnectionSpec, EventSpec, ResourceSpec

MINIMAL = "title: a\nduration_s: 1\ncomponents: {c: {use: m:C}}\n"


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def written(text, name="glide.yaml"):
    """Return the name of a file that holds a text."""
    Path(name).write_text(text)
    return name


def told(text, *overrides):
    """Return the first line of every problem that loading a text reports."""
    with pytest.raises(ScenarioError) as caught:
        load(written(text), overrides)
    return [problem.message.split("\n")[0] for problem in caught.value.problems]


def test_a_scenario_becomes_frozen_records():
    """Every section of the file is a tuple of records, in the order of the file."""
    scenario = load(written(SCENARIO))
    assert scenario.title == "A glider"
    assert (scenario.duration_s, scenario.settle_s, scenario.seed) == (10.0, 2.0, 0)
    assert scenario.resources == (
        ResourceSpec("ground", "small_components:Ground", {"file": "ground.txt"}),
    )
    assert scenario.components[1] == ComponentSpec(
        "pilot", "small_components:Pilot", None, {"gain_per_s": 0.5}
    )
    assert scenario.connections == (
        ConnectionSpec("glider.state", "pilot.state", 0.0),
        ConnectionSpec("pilot.command", "glider.command", 0.05),
    )
    assert scenario.events == (EventSpec(5.0, "pilot.height_m", 50.0),)
    assert scenario.scene == {"clearance": "glider.clearance", "height_agl": "pilot.height_m"}
    assert scenario.end_on == ("glider.outcome",)
    assert scenario.recording.wall_clock
    assert scenario.folder == Path()


def test_origins_say_where_each_value_was_written():
    """Defaults have no origin; an override's is its number."""
    scenario = load(written(SCENARIO), ["duration_s=20", "components.pilot.rate_hz=4"])
    assert (
        scenario.origins["components", "glider", "parameters", "altitude_m"] == "glide.yaml:10:19"
    )
    assert scenario.origins["duration_s",] == "--set #1"
    assert scenario.origins["components", "pilot", "rate_hz"] == "--set #2"
    assert ("settle_s",) not in scenario.origins
    assert (scenario.duration_s, scenario.components[1].rate_hz) == (20.0, 4.0)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("sed: 1", "4:1: sed: unknown key, got 'sed', did you mean 'seed'"),
        ("sed: x", "4:1: sed: unknown key, got 'sed', did you mean 'seed'"),
        (
            "recording: {clock: true}",
            "4:13: recording.clock: unknown key, got 'clock', did you mean 'wall_clock'",
        ),
        (
            "recording: {walclock: true}",
            "4:13: recording.walclock: unknown key, got 'walclock', did you mean 'wall_clock'",
        ),
        ("seed: 1.5", "4:7: seed: wrong type, got 1.5, expected a whole number >= 0"),
        ("seed: -1", "4:7: seed: out of range, got -1, expected a whole number >= 0"),
        ("settle_s: 2 s", "4:11: settle_s: wrong type, got '2 s', expected a number >= 0 s"),
        ("settle_s: true", "4:11: settle_s: wrong type, got true, expected a number >= 0 s"),
        ("settle_s: .inf", "4:11: settle_s: not finite, got Infinity s, expected a number >= 0 s"),
        ("settle_s: -1", "4:11: settle_s: out of range, got -1 s, expected a number >= 0 s"),
        (
            "recording: {wall_clock: no}",
            "4:25: recording.wall_clock: wrong type, got 'no', expected true or false",
        ),
        ("end_on: a.b", "4:9: end_on: wrong type, got 'a.b', expected a list"),
        (
            "end_on: [b]",
            "4:10: end_on.0: malformed, got 'b', expected text like 'component.variable'",
        ),
        ("resources: 3", "4:12: resources: wrong type, got 3, expected a mapping"),
        ("resources: {r: {}}", "4:13: resources.r.use: missing, expected text"),
        (
            "resources: {r: {us: a:b}}",
            "4:17: resources.r.us: unknown key, got 'us', did you mean 'use'",
        ),
        (
            "resources: {a-b: {use: x}}",
            "4:13: resources.a-b: malformed name, got 'a-b', expected letters, digits and '_'",
        ),
        (
            "connections: [c.x c.y]",
            (
                "4:15: connections.0: not a connection, got 'c.x c.y', "
                "expected 'component.output -> component.input'"
            ),
        ),
        (
            "connections: [{from: c.x, too: c.y}]",
            "4:27: connections.0.too: unknown key, got 'too', did you mean 'to'",
        ),
        (
            "connections: [{from: c.x, to: c.y, delay_s: -0.1}]",
            "4:45: connections.0.delay_s: out of range, got -0.1 s, expected a number >= 0 s",
        ),
        (
            "events: [{at_s: 1, set: c.x}]",
            (
                "4:10: events.0.value: missing, expected a whole number or a number or true or false "
                "or text or a list"
            ),
        ),
        (
            "title: b",
            "4:1: title: key given twice, got glide.yaml:1:1 and glide.yaml:4:1, expected one",
        ),
    ],
)
def test_one_mistake_is_one_line(line, message):
    """It names the place, the key, what is wrong, what was found and what is expected."""
    assert told(MINIMAL + line) == [f"glide.yaml:{message}"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "components: {c: {use: m:C}}\ntitle: a",
            "1:1: duration_s: missing, expected a number > 0 s",
        ),
        ("- a", '1:1: scenario: wrong type, got ["a"], expected a mapping of title, '),
        (
            "title: a\nduration_s: 1\ncomponents: {}",
            "3:1: components: empty, got {}, expected a mapping",
        ),
        (
            "title: a\nduration_s: 1\ncomponents: {c: {use: m:C, on_error: hodl}}",
            (
                "3:38: components.c.on_error: not a choice, got 'hodl', expected one of 'end', 'hold', "
                "'restart', did you mean 'hold'"
            ),
        ),
        (
            'title: a\nduration_s: 1\ncomponents: {c: {use: m:C, rate_hz: "44.4 rad/s"}}',
            (
                "3:37: components.c.rate_hz: wrong type, got '44.4 rad/s', "
                "expected a number > 0 Hz or null"
            ),
        ),
        ("", "scenario: empty, expected keys and values"),
    ],
)
def test_a_wrong_document_is_one_line(text, message):
    """The same for what is missing, and for a document that is no scenario at all."""
    (line,) = told(text)
    assert message in line


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file():
    """Overrides come last; each problem shows its line with a caret."""
    text = MINIMAL.replace("duration_s: 1", "duration_s: -1") + "settle_s: x\nsed: 3\n"
    with pytest.raises(ScenarioError) as caught:
        load(written(text), ["seed=x", "componets.c.use=3"])
    assert str(caught.value) == (
        "glide.yaml:2:13: duration_s: out of range, got -1 s, expected a number > 0 s\n"
        "     2 | duration_s: -1\n"
        "       |             ^^\n"
        "glide.yaml:4:11: settle_s: wrong type, got 'x', expected a number >= 0 s\n"
        "     4 | settle_s: x\n"
        "       |           ^\n"
        "glide.yaml:5:1: sed: unknown key, got 'sed', did you mean 'seed'\n"
        "     5 | sed: 3\n"
        "       | ^^^\n"
        "--set #1: seed: wrong type, got 'x', expected a whole number >= 0\n"
        "       | seed=x\n"
        "       |      ^\n"
        "--set #2: componets.c.use: no key 'componets' in the scenario, did you mean 'components'\n"
        "       | componets.c.use=3\n"
        "       | ^^^^^^^^^^^^^^^"
    )


def test_a_mistake_in_a_parent_file_is_told_there():
    """The position is where the value was written, whichever file that is."""
    written(MINIMAL + "seed: x", "base.yaml")
    assert told("extends: base.yaml\ntitle: b") == [
        "base.yaml:4:7: seed: wrong type, got 'x', expected a whole number >= 0"
    ]


def test_what_is_not_beside_a_file_is_extended_from_the_installed_ones(monkeypatch, tmp_path):
    """The file beside it comes first."""
    shipped = tmp_path / "shipped"
    shipped.mkdir()
    (shipped / "base.yaml").write_text(MINIMAL + "seed: 3")
    monkeypatch.setattr(layers, "installed", lambda: shipped)
    path = written("extends: base.yaml\ntitle: b")
    assert (load(path).title, load(path).seed) == ("b", 3)
    written(MINIMAL + "seed: 4", "base.yaml")
    assert load(path).seed == 4


@pytest.mark.parametrize("parent", ["nothing.yaml", "folder.yaml", "broken.yaml"])
def test_without_a_parent_nothing_else_is_told(parent):
    """What the parent might have held is not missed."""
    Path("folder.yaml").mkdir()
    written("a: [", "broken.yaml")
    (line,) = told(f"extends: {parent}\nseed: 1")
    assert parent in line
    assert "missing" not in line


@pytest.mark.parametrize("name", ["x" * 300, f"{'x' * 300}/a.yaml", "a\\0b", "a\\0/b.yaml"])
def test_a_name_that_no_file_can_have_is_not_found(name):
    """Names too long and with a NUL are told like any other file that is not there."""
    (line,) = told(f'extends: "{name}"\ntitle: a')
    assert line.startswith(
        f"glide.yaml:1:10: extends: file not found, got '{name.replace('0', 'x00')}'"
    )


def test_an_override_may_open_a_section_or_parameters():
    """Sections and parameters that no file holds can be written; a new component cannot."""
    path = written(MINIMAL)
    scenario = load(path, ["scene.clearance=c.x", "components.c.parameters.wing.span_m=2"])
    assert scenario.scene == {"clearance": "c.x"}
    assert scenario.components[0].parameters == {"wing": {"span_m": 2}}
    assert told(MINIMAL, "components.d.use=m:D") == [
        "--set #1: components.d.use: no key 'd' in the scenario"
    ]


def test_a_missing_file_comes_with_the_nearest():
    """Files here and installed scenarios are searched."""
    written(MINIMAL)
    with pytest.raises(ScenarioError) as caught:
        load("glid.yaml")
    message = "glid.yaml: file not found, expected a scenario, did you mean 'glide.yaml'"
    assert str(caught.value).startswith(message)


def test_the_schema_for_editors_has_every_key_with_its_unit():
    """Keys carry descriptions and units; installed components add their parameters."""
    schema = json_schema()
    assert schema["properties"]["duration_s"]["unit"] == "s"
    component = schema["$defs"]["Component"]
    assert component["properties"]["rate_hz"]["unit"] == "Hz"
    assert not component["additionalProperties"]
    keys = [*schema["properties"].items(), *component["properties"].items()]
    assert [name for name, one in keys if "description" not in one] == []
    known = {name for one in component["allOf"] for name in one["if"]["properties"]["use"]["enum"]}
    assert {"helicopter", "plant.helicopter:Helicopter"} <= known
