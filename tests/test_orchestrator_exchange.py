"""SSP archives: out to other masters, and in from them."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import small_components
from fmpy.ssp.ssd import read_ssd
from fmus.build import build as build_fmu

from orchestrator.assembly.build import build
from orchestrator.command.app import status
from orchestrator.exchange import ssd
from orchestrator.exchange.ssp import export_ssp, import_ssp, plain_scenario, structure_of
from orchestrator.exchange.structure import Connection, Connector, Element, Parameter, Structure
from orchestrator.flight import fly
from orchestrator.scenario.load import load

PAIR = """\
title: Two integrators
duration_s: 2
components:
  first: {use: first.fmu, rate_hz: 20, parameters: {u: 1.5}}
  second: {use: second.fmu, rate_hz: 10}
connections:
  - {from: first.y, to: second.u, factor: 2.0, offset: 0.25}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a scenario of native components and one of two FMUs."""
    (tmp_path / "glider.yaml").write_text(small_components.SCENARIO)
    (tmp_path / "ground.txt").write_text(small_components.GROUND)
    (tmp_path / "pair.yaml").write_text(PAIR)
    for name in ("first", "second"):
        (tmp_path / f"{name}.fmu").write_bytes(
            build_fmu("integrator", tmp_path, fmi=2).read_bytes()
        )
    monkeypatch.chdir(tmp_path)
    return tmp_path


STRUCTURE = Structure(
    name="A system",
    elements=(
        Element(
            "one",
            "resources/one.fmu",
            (Connector("y[1]", "output", "Real", "m"), Connector("n", "output", "Integer")),
            (
                Parameter("k", "Real", 0.1),
                Parameter("on", "Boolean", True),
                Parameter("s", "String", "a b"),
            ),
            {"rate_hz": 20.0},
            0.05,
        ),
        Element(
            "two",
            "resources/two.fmu",
            (Connector("u", "input"), Connector("m", "input", "Integer")),
        ),
    ),
    connections=(
        Connection(("one", "y[1]"), ("two", "u"), 2.0, -1.0, {"is_final": True}),
        Connection(("one", "n"), ("two", "m"), notes={"is_final": False}),
    ),
    stop_s=10.0,
    step_s=0.05,
    notes={"seed": 3},
)


def test_a_structure_survives_the_way_out_and_in():
    """Elements, connectors, parameters, transformations, times and annotations are the same."""
    assert ssd.read(ssd.write(STRUCTURE)) == STRUCTURE


def test_what_is_written_is_valid_by_the_schema_and_read_by_fmpy(folder):
    """FMPy reads the archive; start values stand inline and as a named set."""
    export_ssp(folder / "pair.yaml", folder / "pair.ssp")
    description = read_ssd(str(folder / "pair.ssp"), validate=True)
    assert [element.name for element in description.system.elements] == ["first", "second"]
    with zipfile.ZipFile(folder / "pair.ssp") as archive:
        assert {"resources/first.fmu", "resources/second.fmu", "resources/first.ssv"} <= set(
            archive.namelist()
        )


def test_an_exported_scenario_comes_back_as_the_same_flight(folder):
    """Rates, start values and transformations are kept: every signal is the same, bit for bit."""
    export_ssp(folder / "pair.yaml", folder / "pair.ssp")
    again = import_ssp(folder / "pair.ssp", folder / "back")
    first, second = fly("pair.yaml").trace, fly(again).trace
    for name in ("first.y", "second.y"):
        assert [list(part) for part in first[name]] == [list(part) for part in second[name]]


@pytest.mark.parametrize("master", ["libcosim", "ecos"])
def test_other_masters_run_the_archive_to_the_same_values(folder, master):
    """Two integrators at one rate, start values included, end where they end here."""
    options = [
        "components.second.rate_hz=20",
        "connections.0.factor=null",
        "connections.0.offset=0",
    ]
    export_ssp(folder / "pair.yaml", folder / "pair.ssp", options)
    script = Path(__file__).parent / "foreign_ssp.py"
    command = [sys.executable, script, master, "pair.ssp", "40", "0.05", "first.y", "second.y"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    trace = fly("pair.yaml", options).trace
    expected = [trace[name][1][-1] for name in ("first.y", "second.y")]
    assert json.loads(done.stdout.splitlines()[-1]) == pytest.approx(expected, rel=1e-12)


def test_native_components_leave_as_fmus_and_fly_the_same(folder):
    """Arrays, events, delays and outcomes come back; the trajectories are the native ones."""
    export_ssp(folder / "glider.yaml", folder / "glider.ssp")
    again = import_ssp(folder / "glider.ssp", folder / "back")
    first, second = fly("glider.yaml").trace, fly(again).trace
    for name in first.names:
        assert [list(map(str, part)) for part in first[name]] == [
            list(map(str, part)) for part in second[name]
        ], name


def test_what_other_masters_do_otherwise_is_told(folder, capsys):
    """A transformation is a note on the terminal, since masters differ on it."""
    assert status(["export-ssp", "pair.yaml", "-o", "pair.ssp"]) == 0
    assert "first.y -> second.u: is transformed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (
            "<ssd:Connections>",
            "<ssd:Connections><x/>",
            "not valid by SystemStructureDescription.xsd",
        ),
        ('version="1.0"', 'version="2.0"', "SSP 2.0, expected 1.0"),
        (
            "</ssd:Elements>",
            '<ssd:System name="inner"/></ssd:Elements>',
            "a system within the system",
        ),
        (
            'startElement="one" startConnector="n"',
            'startConnector="n"',
            "a connector of the system",
        ),
        ("application/x-fmu-sharedlibrary", "application/x-python", "not an FMU"),
    ],
)
def test_what_is_not_supported_is_refused_by_name(old, new, what):
    """One line says what, where and, as far as it has one, its name."""
    files = ssd.write(STRUCTURE)
    text = files["SystemStructure.ssd"].decode()
    assert old in text
    with pytest.raises(ValueError, match=what):
        ssd.read(files | {"SystemStructure.ssd": text.replace(old, new, 1).encode()})


def test_units_that_the_archive_leaves_to_the_master_are_converted():
    """A transformation without suppressUnitConversion is followed by the conversion of units."""
    files = ssd.write(STRUCTURE)
    text = files["SystemStructure.ssd"].decode().replace(' suppressUnitConversion="true"', "")
    units = (
        '<ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>'
        '<ssc:Unit name="ft"><ssc:BaseUnit m="1" factor="0.3048"/></ssc:Unit></ssd:Units>'
        "<ssd:DefaultExperiment"
    )
    text = text.replace("<ssd:DefaultExperiment", units, 1)
    connector = '<ssd:Connector name="u" kind="input">\n            <ssc:Real'
    text = text.replace(connector, f'{connector} unit="ft"')
    assert 'unit="ft"' in text
    plain = plain_scenario(ssd.read(files | {"SystemStructure.ssd": text.encode()}), "x")
    assert plain["connections"][0]["factor"] == pytest.approx(2.0 / 0.3048)
    assert plain["connections"][0]["offset"] == pytest.approx(-1.0 / 0.3048)


def test_a_source_outside_the_archive_is_refused(folder, capsys):
    """Nothing is unpacked that would leave the folder."""
    structure = Structure("x", (Element("a", "../a.fmu"),), (), stop_s=1.0)
    with zipfile.ZipFile("bad.ssp", "w") as archive:
        for name, data in ssd.write(structure).items():
            archive.writestr(name, data)
        archive.writestr("../a.fmu", b"")
    assert status(["import-ssp", "bad.ssp", "-o", "back"]) == 2
    assert (
        "component source: got '../a.fmu', expected an .fmu in the archive"
        in capsys.readouterr().err
    )
    assert not (folder / "a.fmu").exists()


def test_rates_that_only_the_archive_knows_are_taken():
    """A step size hint becomes the rate; without our own annotation arrays stay scalars."""
    structure = Structure(
        "x",
        (
            Element("a b", "a.fmu", (Connector("y[1]", "output"),), step_s=0.1),
            Element("2nd", "b.fmu", (Connector("u[1]", "input"),)),
        ),
        (Connection(("a b", "y[1]"), ("2nd", "u[1]")),),
        stop_s=1.0,
    )
    plain = plain_scenario(structure, "x")
    assert plain["components"]["a_b"] == {"use": "a.fmu", "rate_hz": 10.0, "fmu": {"arrays": False}}
    assert plain["connections"] == ["a_b.y[1] -> nd.u[1]"]


def test_the_structure_of_a_system_says_its_steps(folder):
    """The base step and every component's own are there for masters that read them."""
    structure = structure_of(build(load("pair.yaml")))
    assert structure.step_s == 0.05
    assert [element.step_s for element in structure.elements] == [0.05, 0.1]
