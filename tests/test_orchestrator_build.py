"""From a scenario to a system: what is looked up, checked, made and injected, and what refused."""

import re
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import pytest
from small_components import GROUND, SCENARIO, Glider, Pilot

from orchestrator.assembly import make as making
from orchestrator.assembly.build import build
from orchestrator.assembly.discovery import resolve
from orchestrator.assembly.make import make
from orchestrator.assembly.parameters import constructor
from orchestrator.assembly.plans import Plan, make_plans
from orchestrator.errors import ScenarioError
from orchestrator.scenario.load import load


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("glide.yaml").write_text(SCENARIO)
    Path("ground.txt").write_text(GROUND)


def told(*overrides, text=SCENARIO):
    """Return the first line of every problem that building reports."""
    Path("glide.yaml").write_text(text)
    with pytest.raises(ScenarioError) as caught:
        build(load("glide.yaml", overrides))
    return [problem.message.split("\n")[0] for problem in caught.value.problems]


def replaced(old, new):
    """Return the scenario's text with a part replaced."""
    assert old in SCENARIO
    return SCENARIO.replace(old, new)


def test_a_system_is_built_of_what_the_scenario_names():
    """Resources are injected; parameters are the component's own dataclass; rates its own."""
    system = build(load("glide.yaml"))
    glider, pilot = (system.instances[name].component for name in ("glider", "pilot"))
    assert isinstance(glider, Glider)
    assert isinstance(pilot, Pilot)
    assert glider.parameters.altitude_m == 90.0
    assert glider.elevation == 10.0
    assert system.schedule.period_ns == {"glider": 50_000_000, "pilot": 500_000_000}
    assert len(system.links) == 4


def test_a_scenario_made_in_python_is_built_too():
    """Without a file there are no positions, and messages say so."""
    scenario = load("glide.yaml", ["components.glider.parameters.altitude_m=5"])
    plain = type(scenario)(**{**vars(scenario), "origins": {}})
    with pytest.raises(ScenarioError, match=r"^scenario: components.glider.parameters.altitude_m"):
        build(plain)


def test_latency_is_told_to_who_wants_to_know():
    """A constructor with an argument `latency_s` gets the component's."""
    system = build(load("glide.yaml", ["components.pilot.latency_s=0.25"]))
    assert system.instances["pilot"].component.latency_s == 0.25


def test_a_shared_resource_is_made_once():
    """Two components with one `${ground}` get the same object."""
    text = replaced(
        "  pilot:\n",
        "  other: {use: small_components:Keeper, parameters: {ground: '${ground}'}}\n  pilot:\n",
    ).replace("use: small_components:Glider", "use: small_components:Keeper")
    Path("glide.yaml").write_text(text)
    system = build(load("glide.yaml"))
    one, other = (system.instances[name].component.ground for name in ("glider", "other"))
    assert one is other


def test_nested_parameters_become_nested_dataclasses():
    """Mappings become dataclasses, lists tuples, whole numbers floats where floats belong."""
    system = build(
        load(
            "glide.yaml",
            [
                "components.glider.parameters.wing.span_m=3",
                "components.glider.parameters.waypoints_m=[[0, 1], [2, 3]]",
                "components.glider.parameters.trim_deg=null",
            ],
        )
    )
    parameters = system.instances["glider"].component.parameters
    assert (parameters.wing.span_m, parameters.wing.chord_m) == (3.0, 0.1)
    assert parameters.waypoints_m == ((0.0, 1.0), (2.0, 3.0))
    assert isinstance(parameters.waypoints_m[0][0], float)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("altitude_n=1", "unknown key, got 'altitude_n', did you mean 'altitude_m'"),
        ("altitude_m=high", "wrong type, got 'high', expected a number >= 0 m and <= 1000 m"),
        ("altitude_m=true", "wrong type, got true, expected a number >= 0 m and <= 1000 m"),
        ("altitude_m='9'", "wrong type, got '9', expected a number >= 0 m and <= 1000 m"),
        ("altitude_m=-1", "out of range, got -1 m, expected a number >= 0 m and <= 1000 m"),
        ("speed_mps=44.4 m/s", "wrong type, got '44.4 m/s', expected a number >= 0 m/s"),
        ("crew=1.0", "wrong type, got 1.0, expected a whole number >= 0"),
        ("has_gear=1", "wrong type, got 1, expected true or false"),
        (
            "preset=clubb",
            "not a choice, got 'clubb', expected one of 'club', 'racer', did you mean 'club'",
        ),
        ("start_m=[1]", "wrong number of items, got [1], expected a list of 2"),
        ("start_m=[1, 2, 3]", "wrong number of items, got [1, 2, 3], expected a list of 2"),
        ("trim_deg=x", "wrong type, got 'x', expected a number in deg or null"),
        ("wing=3", "wrong type, got 3, expected a mapping of span_m, chord_m"),
        ("wing.span_m=-1", "out of range, got -1 m, expected a number >= 0 m"),
        ("wing.chord_m=3", "above the span, got 3.0 m, expected up to 2.0 m"),
        ("grund=${ground}", "takes no resource, got '${ground}', did you mean 'ground'"),
        ("ground=ground", "not a resource, got 'ground', expected '${ground}'"),
        ("ground=${grund}", "no resource 'grund', did you mean 'ground'"),
    ],
)
def test_a_wrong_parameter_is_one_line(override, message):
    """Its position is that of the value, its words those of the component's own dataclass."""
    path = f"components.glider.parameters.{override}"
    assert told(path) == [f"--set #1: {path.partition('=')[0]}: {message}"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "small_components:Pilot",
            "small_components:Pilt",
            (
                "13:10: components.pilot.use: no such attribute, got 'small_components:Pilt', "
                "did you mean 'Pilot'"
            ),
        ),
        (
            "small_components:Pilot",
            "nowhere:Pilot",
            "13:10: components.pilot.use: no module 'nowhere', not in",
        ),
        (
            "small_components:Pilot",
            "plnt.helicopter:Helicopter",
            "13:10: components.pilot.use: no module 'plnt', did you mean 'plant', not in",
        ),
        (
            "small_components:Pilot",
            "helicoptr",
            (
                "13:10: components.pilot.use: no component of this name, got 'helicoptr', "
                "expected an installed one or 'module:attribute', did you mean 'helicopter'"
            ),
        ),
        (
            "small_components:Pilot",
            "r50.fmu",
            (
                "13:10: components.pilot.use: file not found, got 'r50.fmu', "
                "expected a file beside the scenario"
            ),
        ),
        (
            "small_components:Pilot",
            "small_components:not_callable",
            (
                "13:10: components.pilot.use: cannot be called, got 'small_components:not_callable', "
                "expected a class or function"
            ),
        ),
        (
            "use: small_components:Pilot",
            "use: small_components:Link",
            "14:5: components.pilot.parameters.other: missing, expected a resource, as '${name}'",
        ),
        (
            "ground.txt}",
            "grund.txt}",
            (
                "4:61: resources.ground.parameters.file: file not found, got 'grund.txt', "
                "expected a file beside the scenario, did you mean 'ground.txt'"
            ),
        ),
        (
            "altitude_m: 90",
            "altitude_m: 9",
            (
                "10:19: components.glider.parameters.altitude_m: below ground, got 9.0 m, "
                "expected 10.0 m or more"
            ),
        ),
        (
            "glider.state -> pilot.state",
            "glider.stat -> pilot.state",
            (
                "16:5: connection glider.stat -> pilot.state: component 'glider' has no variable or "
                "group 'stat', did you mean 'state'"
            ),
        ),
        (
            "glider.state -> pilot.state",
            "glyder.state -> pilot.state",
            (
                "16:5: connection glyder.state -> pilot.state: no component 'glyder', "
                "did you mean 'glider'"
            ),
        ),
        (
            "glider.state -> pilot.state",
            "pilot.command -> glider.state",
            "16:5: connection pilot.command -> glider.state: glider.state has no inputs, got output",
        ),
        (
            "glider.state -> pilot.state",
            "glider.clearance -> glider.state.north",
            (
                "16:5: connection glider.clearance -> glider.state.north: glider.state.north cannot be "
                "a target, got output, expected input"
            ),
        ),
        (
            "glider.state -> pilot.state",
            "glider.clearance -> glider.command.climb",
            (
                "16:5: connection glider.clearance -> glider.command.climb: glider.command.climb: "
                "unit of another dimension, got 'm' (m), expected 'm/s' (m s-1)"
            ),
        ),
        (
            "glider.state -> pilot.state",
            "glider.trail -> pilot.trail",
            (
                "16:5: connection glider.trail -> pilot.trail: pilot.trail: wrong shape, got (3,), "
                "expected (2,)"
            ),
        ),
        (
            "rate_hz: 20",
            "rate_hz: 30",
            (
                "8:14: components.glider.rate_hz: period is not a whole number of nanoseconds, "
                "got 30.0 Hz, expected "
            ),
        ),
        (
            ", delay_s: 0.05}",
            "}",
            "15:1: connections: cycle of direct feed-through",
        ),
        (
            "set: pilot.height_m",
            "set: pilot.gain_per_s",
            "19:20: event pilot.gain_per_s: parameter cannot change, got fixed, expected tunable",
        ),
        (
            "value: 50.0",
            "value: fifty",
            "19:43: event pilot.height_m: wrong type, got 'fifty', expected a number in m",
        ),
        (
            "value: 50.0",
            "value: 5e3",
            (
                "19:43: event pilot.height_m: out of range, got 5000.0 m, "
                "expected a number <= 1000 m"
            ),
        ),
        (
            "clearance: glider.clearance",
            "controls: glider.command",
            (
                "20:19: scene.controls: not an output, got 'glider.command', "
                "expected what feeds it, pilot.command"
            ),
        ),
        (
            "clearance: glider.clearance",
            "clearance: pilot.state.altitude",
            (
                "20:20: scene.clearance: not an output, got 'pilot.state.altitude', "
                "expected what feeds it, glider.state.altitude"
            ),
        ),
        (
            "[glider.outcome]",
            "[glider.clearance]",
            (
                "21:10: end_on glider.clearance: got output of type Float64, "
                "expected an enumeration output"
            ),
        ),
        (
            "clearance: glider.clearance",
            "clearance: glider.state",
            "20:20: scene.clearance: a group, got 'glider.state', expected a variable",
        ),
        (
            "clearance: glider.clearance",
            "pose: glider.state",
            "20:15: scene.pose: 'glider.state' lacks members, expected east, down, phi, theta, psi",
        ),
        (
            "clearance: glider.clearance",
            "terrain: '${grund}'",
            (
                "20:18: scene.terrain: no resource, got '${grund}', expected one of ['${ground}'], "
                "did you mean '${ground}'"
            ),
        ),
    ],
)
def test_a_scenario_that_does_not_fit_is_refused_where_it_says_so(old, new, message):
    """Names, causality, units, shapes, times and files: found before the first step."""
    lines = told(text=replaced(old, new))
    assert [line for line in lines if line.startswith(f"glide.yaml:{message}")]


def test_a_second_source_is_refused():
    """An input has one source, and the message names both."""
    lines = told("connections.0=pilot.command.climb -> glider.command.climb")
    assert [line for line in lines if "two sources" in line]


def test_a_truncated_file_is_told_at_the_parameter_that_names_it():
    """What a constructor refuses stands at the parameter its message begins with."""
    Path("ground.txt").write_text("1e")
    with pytest.raises(
        ScenarioError, match=r"^glide.yaml:4:61: resources.ground.parameters.file: trunc"
    ):
        build(load("glide.yaml"))


def test_resources_may_need_each_other_but_not_in_a_circle():
    """The cycle is named."""
    text = replaced(
        "components:\n",
        "  a: {use: small_components:Link, parameters: {other: '${b}'}}\n"
        "  b: {use: small_components:Link, parameters: {other: '${a}'}}\ncomponents:\n",
    )
    (line,) = told(text=text)
    assert line.partition("resources: ")[2] in (
        "a cycle, got a -> b -> a, expected none",
        "a cycle, got b -> a -> b, expected none",
    )
    chain = text.replace("'${a}'", "'${ground}'")
    Path("glide.yaml").write_text(chain)
    order = [plan.path[1] for plan in make_plans(load("glide.yaml"))]
    assert order.index("ground") < order.index("b") < order.index("a")


def test_a_constructor_without_parameters_takes_none():
    """Values for a resource that has no parameter dataclass are unknown keys."""
    text = replaced(
        "components:\n",
        "  a: {use: small_components:Link, parameters: {other: '${ground}', x: 1}}\ncomponents:\n",
    )
    assert told(text=text) == [
        "glide.yaml:5:68: resources.a.parameters.x: unknown key, got 'x', expected no parameters"
    ]


def test_what_is_wrong_in_several_components_is_told_together():
    """One run of the loader shows all there is to mend."""
    lines = told(
        "components.glider.parameters.crew=x",
        "components.pilot.parameters.gain_per_s=-1",
        "resources.ground.parameters.file=no.txt",
    )
    assert [line.split(":")[0] for line in lines] == ["--set #1", "--set #2", "--set #3"]


def test_a_broken_module_is_one_line(tmp_path):
    """Whatever importing raises; modules are also found beside the scenario."""
    Path("broken_plugin.py").write_text("import nothing_of_this_name")
    message = (
        "module 'broken_plugin' cannot be imported, ModuleNotFoundError: "
        "No module named 'nothing_of_this_name'"
    )
    with pytest.raises(ValueError, match="broken_plugin") as caught:
        resolve("broken_plugin:Thing", tmp_path)
    assert str(caught.value) == message


MISTAKES = {
    "NoComponent": "component 'pilot': no describe, initialize, set, get, step, terminate, got "
    "NoComponent (small_mistakes.py:N), expected describe, initialize, set, get, step, terminate",
    "NoExecution": "component 'pilot': wrong execution, got None, expected one with kind, rate_hz "
    "(a number) and interface",
    "Constructor": "components.pilot: constructor failed, KeyError: 'a' (small_mistakes.py:N)",
    "Arguments": "components.pilot: constructor failed, TypeError: Arguments._take() missing 1 "
    "required positional argument: 'b' (small_mistakes.py:N)",
    "Refusal": "components.pilot: no such thing, got 1 (small_mistakes.py:N)",
    "Described": "component 'pilot': describe failed, KeyError: 'x' (small_mistakes.py:N)",
    "Twice": "component 'pilot': describe failed, ValueError: variable 'u': described twice, "
    "expected once (small_mistakes.py:N)",
    "Dependent": "component 'pilot': describe failed, ValueError: variable 'y': depends_on: no "
    "input, got 'v' (small_mistakes.py:N)",
}


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_a_component_is_one_line_at_its_place(name, isolation):
    """Where the scenario names it: what was called, what was raised, and where in its code."""
    text = (
        "title: x\nduration_s: 1\ncomponents:\n  pilot: {{use: small_mistakes:{}, isolation: {}}}\n"
    )
    Path("mistake.yaml").write_text(text.format(name, isolation))
    with pytest.raises(ScenarioError) as caught:
        build(load("mistake.yaml"))
    (problem,) = caught.value.problems
    line = problem.message.partition("\n")[0]
    assert re.sub(r"\.py:\d+\)", ".py:N)", line) == f"mistake.yaml:4:3: {MISTAKES[name]}"
    assert caught.value.__cause__ is not None


def test_a_module_of_ones_own_is_found_with_pythonpath(tmp_path):
    """Where was looked is told, and what to do."""
    line = told("components.pilot.use=flightlab.pid:Pid")[0]
    assert line.startswith("--set #1: components.pilot.use: no module 'flightlab', not in ")
    assert repr(str(Path().absolute())) in line
    assert line.endswith("a package of one's own is found with PYTHONPATH or 'pip install -e'")


def test_an_annotation_that_cannot_be_read_is_told():
    """One line says which name is unknown."""

    def make(parameters: "Nowhere"):  # noqa: F821
        pass

    with pytest.raises(ValueError, match="annotations cannot be read, NameError: name 'Nowhere'"):
        constructor(make)


def test_parameters_must_be_a_dataclass():
    """The annotation of the constructor's argument says what the parameters are."""

    class Odd:
        def __init__(self, parameters: int) -> None: ...

    with pytest.raises(ValueError, match="wrong annotation of 'parameters', got <class 'int'>"):
        constructor(Odd)


def test_field_names_cannot_hide_pydantics_own():
    """A parameter may be called `copy` or `schema`."""

    @dataclass(frozen=True)
    class Parameters:
        copy: int = 1
        schema: int = 2

    from orchestrator.assembly.parameters import adapter

    assert adapter(Parameters).validate_json('{"copy": 3}') == Parameters(3, 2)


def test_a_long_construction_is_announced(monkeypatch):
    """Who waits is told for what, while it is being made."""
    heard = Event()
    monkeypatch.setattr(making, "PATIENCE", 0.0)
    plan = Plan(("components", "slow"), lambda: heard.wait(10), {}, {})
    assert make([plan], lambda name: heard.set() if name == "slow" else None) == {plan.path: True}
