"""``use: x.fmu`` in a scenario: planning, options, rates, and what swapping ``use`` alone needs."""

import re
import zipfile

import pytest
from fmu_flights import flown, log, written

from orchestrator.assembly.build import build
from orchestrator.assembly.plans import make_plans
from orchestrator.command.app import status
from orchestrator.errors import ScenarioError
from orchestrator.fmu.component import FmuComponent, FmuParameters
from orchestrator.scenario.load import load


def problem(file):
    """Return the one problem of a scenario."""
    with pytest.raises(ScenarioError) as caught:
        build(load(file))
    assert len(caught.value.problems) == 1, caught.value
    return str(caught.value)


def test_planning_unpacks_nothing_for_good(fmu, tmp_path):
    """A plan pickles into another process: the class and plain parameters, no FMU is loaded."""
    use = fmu("feedthrough", fmi=2)
    one = {"use": use, "parameters": {"gear_ratio": 2}, "fmu": {"arrays": True, "kind": "sampled"}}
    (plan,) = make_plans(load(written(tmp_path, {"a": one})))
    assert plan.factory is FmuComponent
    expected = FmuParameters(use, {"gear_ratio": 2}, arrays=True, kind="sampled")
    assert plan.arguments == {
        "parameters": expected,
        "latency_s": 0.0,
        "instance_name": "a",
    }


def test_a_file_is_looked_up_beside_the_scenario(fmu, tmp_path):
    """Packed or unpacked."""
    with zipfile.ZipFile(fmu("relay")) as archive:
        archive.extractall(tmp_path / "unpacked")
    (tmp_path / "relay.fmu").write_bytes(fmu("relay").read_bytes())
    uses = {"a": {"use": "relay.fmu"}, "b": {"use": "unpacked"}}
    assert list(build(load(written(tmp_path, uses))).instances) == ["a", "b"]
    text = problem(written(tmp_path, {"a": {"use": "relais.fmu"}}))
    assert "file not found, got 'relais.fmu'" in text
    assert "did you mean 'relay.fmu'" in text


@pytest.mark.parametrize(
    ("keys", "key", "says"),
    [
        ({"parameters": {"gear_ration": 1}}, "gear_ration", "did you mean 'gear_ratio'"),
        (
            {"parameters": {"gear_ratio": "x"}},
            "gear_ratio",
            "wrong type, got 'x', expected a number",
        ),
        ({"parameters": {"angle": {"value": 1, "unit": "s"}}}, "angle", "another dimension"),
        ({"parameters": {"vector_in": [1, 2]}}, "vector_in", r"wrong shape, got \(2,\)"),
        ({"fmu": {"array": True}}, "array", "unknown key, got 'array', did you mean 'arrays'"),
        ({"fmu": {"file": "x"}}, "file", "not an option"),
        ({"fmu": {"kind": "sample"}}, "kind", "not a choice"),
    ],
)
def test_mistakes_are_placed_at_their_keys(fmu, tmp_path, keys, key, says):
    """By file, line and column, before the FMU is run."""
    file = written(tmp_path, {"a": {"use": fmu("feedthrough", fmi=3), "rate_hz": 10, **keys}})
    text = problem(file)
    assert re.search(says, text), text
    line = next(n for n, t in enumerate(file.read_text().splitlines(), 1) if f"{key}:" in t)
    assert text.startswith(f"{file}:{line}:"), text


def test_fmu_options_need_an_fmu(tmp_path):
    """They mean nothing for anything else."""
    file = written(tmp_path, {"a": {"use": "plan_sequencer", "fmu": {"log": True}}})
    assert "components.a.fmu: not an FMU, got 'plan_sequencer'" in problem(file)


def test_resources_do_not_enter_an_fmu(fmu, tmp_path):
    """They are left out with a line in the log, so that swapping ``use`` alone is enough."""
    one = {"use": fmu("decay"), "rate_hz": 10, "parameters": {"k": -2.0, "terrain": "${terrain}"}}
    recording = flown(tmp_path, {"a": one})
    assert recording["a.y"][1][-1] == pytest.approx((1 - 0.02) ** 100)
    lines = [text for _, _, text in log(recording)]
    note = "component a: parameter 'terrain' is ignored, resources cannot enter an FMU"
    assert note in lines


@pytest.mark.parametrize(
    ("name", "fmi", "rate_hz"),
    [("decay", 3, 10.0), ("fixedstep", 2, 50.0), ("fixedstep", 3, 50.0), ("clocked", 3, 2.0),
     ("feedthrough", 2, 100.0)],
)  # fmt: skip
def test_the_rate_is_the_fmus_own(fmu, tmp_path, name, fmi, rate_hz):
    """Clock, step size of the experiment, internal step size; 10 Hz where it says nothing."""
    system = build(load(written(tmp_path, {"a": {"use": fmu(name, fmi=fmi)}})))
    assert system.schedule.period_ns["a"] == round(1e9 / rate_hz)


def test_a_step_that_is_no_multiple_of_the_internal_one_is_refused(fmu, tmp_path):
    """At load, with the nearest that would do."""
    file = written(tmp_path, {"a": {"use": fmu("fixedstep", fmi=3), "rate_hz": 20}})
    says = "got 0.05 s, expected a multiple of its internal step of 0.02 s, such as 0.04 s"
    assert says in problem(file)
    assert build(load(file, ["components.a.rate_hz=5"]))


def test_bytes_are_recorded_and_connected(fmu, tmp_path):
    """Binary variables of FMI 3 travel from end to end; a scenario writes them in hexadecimal."""
    use = fmu("feedthrough", fmi=3)
    given = {"Binary_in": "00ff00", "words_in": ["roll", "yaw"]}
    one, two = {"use": use, "rate_hz": 10, "parameters": given}, {"use": use, "rate_hz": 10}
    links = ["a.Binary_out -> b.Binary_in", "a.words_out -> b.words_in"]
    recording = flown(tmp_path, {"a": one, "b": two}, links)
    assert recording["b.Binary_out"][1][-1] == b"\x00\xff\x00"
    assert list(recording["b.words_out"][1][-1]) == ["roll", "yaw"]


def test_parameters_of_an_exported_component_may_stay_in_the_scenario(fmu, tmp_path):
    """What our exporter has fixed in an FMU is no mistake, unless the scenario wants another value."""
    made = tmp_path / "relay.fmu"
    made.write_bytes(fmu("relay").read_bytes())
    with zipfile.ZipFile(made, "a") as archive:
        archive.writestr(
            "resources/component.json", '{"parameters": {"preset": "r50", "mass": 68}}'
        )
    one = {"use": "relay.fmu", "parameters": {"preset": "r50", "mass": 68}}
    assert build(load(written(tmp_path, {"a": one})))
    one["parameters"]["mass"] = 70
    says = "components.a.parameters.mass: is fixed in the FMU, got 70, expected 68"
    assert says in problem(written(tmp_path, {"a": one}))


def test_inspect_shows_variables_and_fixed_parameters(fmu, capsys):
    """Of an FMU by its file alone."""
    assert status(["inspect", str(fmu("feedthrough", fmi=3))]) == 0
    printed = capsys.readouterr().out
    assert "options, under 'fmu' in a scenario" in printed
    for name in ("gear_ratio", "matrix_out", "Binary_in"):
        assert name in printed
