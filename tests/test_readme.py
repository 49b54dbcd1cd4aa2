"""The README's Python runs as it stands."""

import re
import sys
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
TEXT = README.read_text(encoding="utf-8")
COMMANDS = re.findall(r"^hedgehop (\w+)", TEXT, flags=re.MULTILINE)
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)


def test_the_flight(monkeypatch, capsys):
    """The Python example flies and says so."""
    monkeypatch.chdir(README.parent)
    exec(compile(BLOCKS[0], "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("flown 9.")


def test_the_component(monkeypatch, tmp_path):
    """The component of the README keeps every clause of the contract."""
    from orchestrator.conformance.check import check_component

    (tmp_path / "readme_lag.py").write_text(BLOCKS[1], encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    import readme_lag

    clauses = check_component(lambda: readme_lag.Lag(readme_lag.LagParameters()))
    failed = [clause for clause in clauses if clause.verdict == "failed"]
    sys.modules.pop("readme_lag")
    assert not failed, failed


@pytest.mark.parametrize("command", sorted(set(COMMANDS)))
def test_the_commands_exist(command):
    """Every command that the README types exists."""
    from orchestrator.command.app import status

    assert status([command, "--help"]) == 0


def test_every_parameter_is_documented():
    """scenarios/README.md names every key of a scenario and every parameter of what ships."""
    from dataclasses import fields

    from controller.parameters import MpcParameters
    from controller.sequencer import SequencerParameters
    from orchestrator.fmu.prediction_parameters import FmuModelParameters
    from orchestrator.scenario.load import json_schema
    from plant.gust import DrydenGustParameters
    from plant.helicopter import HelicopterParameters, ModelParameters, Perturbation
    from plant.sensor import TerrainSensorParameters
    from plant.terrain import TerrainParameters

    text = (README.parent / "scenarios" / "README.md").read_text(encoding="utf-8")
    records = (
        MpcParameters, SequencerParameters, DrydenGustParameters, HelicopterParameters,
        ModelParameters, Perturbation, TerrainSensorParameters, TerrainParameters,
        FmuModelParameters,
    )  # fmt: skip
    names = {field.name for record in records for field in fields(record)}
    names |= set(json_schema()["properties"])
    assert not [name for name in sorted(names) if f"`{name}" not in text]


def test_every_required_key_is_marked():
    """The table of keys in scenarios/README.md marks the required ones, and no other."""
    from orchestrator.scenario import document

    text = (README.parent / "scenarios" / "README.md").read_text(encoding="utf-8")
    marked = set(re.findall(r"^\| `([\w.]+)` \|.*\| \*required\* \|", text, flags=re.MULTILINE))
    places = {"": "Document", "resources.NAME.": "Resource", "components.NAME.": "Component"}
    required = {
        start + name
        for start, record in places.items()
        for name, field in getattr(document, record).model_fields.items()
        if field.is_required()
    }
    assert "components" in required  # told in words: at least one
    assert marked == required - {"components"}
