"""Units: dimensions are checked, factors and offsets converted."""

import math
from pathlib import Path

import fmpy
import pytest
import small_units
from fmpy import model_description as fmi
from fmpy.validation import validate_fmu
from hypothesis import given
from hypothesis import strategies as st
from scripted import describe
from small_units import Gauge, GaugeParameters

from orchestrator.assembly.couple import couple
from orchestrator.assembly.description import ports
from orchestrator.assembly.unit_names import read
from orchestrator.assembly.units import Unit, conversion, units
from orchestrator.command.app import status
from orchestrator.conformance.check import check_component
from orchestrator.export.export import choose, export
from orchestrator.fmu.component import FmuComponent, FmuParameters
from orchestrator.playback.component import Playback, PlaybackParameters
from orchestrator.scenario.records import ComponentSpec, ConnectionSpec, Scenario

LENGTH = (0, 1, 0, 0, 0, 0, 0, 0)
TEMPERATURE = (0, 0, 0, 0, 1, 0, 0, 0)
METRE, FOOT = Unit("m", LENGTH), Unit("ft", LENGTH, 0.3048)
KELVIN, CELSIUS = Unit("K", TEMPERATURE), Unit("degC", TEMPERATURE, 1.0, 273.15)

factors = st.floats(1e-6, 1e6)
offsets = st.floats(-1e3, 1e3)


def test_factor():
    """1 ft is 0.3048 m."""
    assert conversion(FOOT, METRE) == (0.3048, 0.0)


def test_offset():
    """0 degC is 273.15 K, and back."""
    assert conversion(CELSIUS, KELVIN) == (1.0, 273.15)
    assert conversion(KELVIN, CELSIUS) == (1.0, -273.15)


def test_nothing_to_convert():
    """Equal units, other names of one unit, and missing units need no conversion."""
    assert conversion(METRE, METRE) is None
    assert conversion(Unit("G"), Unit("1")) is None
    assert conversion(None, METRE) is None
    assert conversion(METRE, None) is None


def test_dimensions_differ():
    """Another dimension is refused, naming both units and what they are made of."""
    speed = Unit("m/s", (0, 1, -1, 0, 0, 0, 0, 0))
    with pytest.raises(ValueError, match=r"got 'm/s' \(m s-1\), expected 'G' \(dimensionless\)"):
        conversion(speed, Unit("G"))


def test_radians_are_a_dimension():
    """An angle is not a plain number."""
    with pytest.raises(ValueError, match="unit of another dimension"):
        conversion(Unit("rad", (0, 0, 0, 0, 0, 0, 0, 1)), Unit("1"))


def test_unknown_dimension():
    """A unit without base unit equals itself and converts to nothing else."""
    odd = Unit("furlong", None)
    assert conversion(odd, Unit("furlong", None)) is None
    with pytest.raises(ValueError, match="no base unit"):
        conversion(odd, METRE)


def test_two_unknown_dimensions_are_not_one():
    """Units without base unit that differ by name are not joined: nobody knows their ratio."""
    with pytest.raises(ValueError, match="got 'furlong' .no base unit., expected 'rod'"):
        conversion(Unit("furlong", None), Unit("rod", None))


@given(factors, offsets, factors, offsets, st.floats(-1e6, 1e6))
def test_there_and_back(factor, offset, other_factor, other_offset, value):
    """Converting there and back gives the value again."""
    a, b = Unit("a", LENGTH, factor, offset), Unit("b", LENGTH, other_factor, other_offset)
    there, back = conversion(a, b) or (1.0, 0.0), conversion(b, a) or (1.0, 0.0)
    result = (value * there[0] + there[1]) * back[0] + back[1]
    scale = abs(value) + (abs(offset) + abs(other_offset)) / factor
    assert math.isclose(result, value, rel_tol=1e-9, abs_tol=1e-9 * scale)


def test_units_of_a_description():
    """Every unit of a model description is read with exponents, factor and offset."""
    read = units(describe("x", []))
    assert read["km"] == Unit("km", LENGTH, 1000.0)
    assert read["deg"].dimension[-1] == 1


def test_a_name_alone_is_read():
    """A native component's units are known by their names; what is no unit is left out."""
    description = Gauge(GaugeParameters("kN.mm", "Nm")).describe()
    assert units(description)["kN.mm"] == Unit("kN.mm", (1, 2, -2, 0, 0, 0, 0, 0), 1.0)
    assert "Nm" not in units(description)


def test_units_of_a_file_are_its_own(fmu, tmp_path):
    """An FMU's base unit wins over what the name says; without one the unit stays unknown."""
    description = FmuComponent(FmuParameters(fmu("decay"))).describe()
    description.unitDefinitions += [
        fmi.Unit("ft", fmi.BaseUnit(m=1, factor=0.3)),
        fmi.Unit("N"),
    ]
    assert units(description)["ft"].factor == 0.3
    assert units(description)["N"] == Unit("N", None)


def flown(told, shown):
    """Return the outcome of a flight of two gauges, one after the other, and their links."""
    gauges = {
        "a": Gauge(GaugeParameters(shown=shown, start=20.0)),
        "b": Gauge(GaugeParameters(told=told)),
    }
    specs = tuple(ComponentSpec(name, "gauge") for name in gauges)
    joined = (ConnectionSpec("a.y", "b.u"),)
    return couple(Scenario("t", 1.0, components=specs, connections=joined), gauges).links


def test_connected_variables_are_converted_by_their_names():
    """Degrees Celsius arrive as Kelvin, newtons as kilonewtons, knots as km/h."""
    for shown, told, factor, offset in (
        ("degC", "K", 1.0, 273.15),
        ("N", "kN", 1e-3, 0.0),
        ("kt", "km/h", 1.852, 0.0),
    ):
        (link,) = flown(told, shown)
        assert link.factor == pytest.approx(factor)
        assert link.offset == offset


SCENARIO = """\
title: a gauge
duration_s: 1
components:
  gauge: {use: small_units:Gauge, parameters: {shown: SHOWN}}
"""


@pytest.mark.parametrize(
    "command", [["validate", "gauge.yaml"], ["run", "gauge.yaml"], ["inspect", "small_units:Bad"]],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_unit_that_cannot_be_read_is_a_user_error(command, tmp_path, monkeypatch, capsys):
    """It names component, variable, what was given and the nearest unit, and is no traceback."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        small_units, "Bad", lambda: Gauge(GaugeParameters(shown="Nm")), raising=False
    )
    Path("gauge.yaml").write_text(SCENARIO.replace("SHOWN", "Nm"))
    assert status(command) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert f"component '{'small_units:Bad' if command[0] == 'inspect' else 'gauge'}'" in told
    assert "variable 'y': unknown unit, got 'Nm', expected" in told
    assert "did you mean 'N.m'" in told
    assert "internal error" not in told


def test_a_check_says_which_unit_cannot_be_read():
    """The clause about the description fails with the variable, its unit and the nearest."""
    checked = check_component(lambda: Gauge(GaugeParameters(shown="Nm")))
    (detail,) = [one.detail for one in checked if one.name == "description"]
    assert "variable 'y': unknown unit, got 'Nm'" in detail
    assert "did you mean 'N.m'" in detail


def test_a_component_with_any_units_keeps_the_contract():
    """Named, prefixed and multiplied units pass every clause."""
    failed = [c for c in check_component("small_units:Gauge", {"parameters": GaugeParameters()})
              if c.verdict == "failed"]  # fmt: skip
    assert failed == []


@pytest.mark.parametrize("version", [2, 3])
def test_an_exported_fmu_defines_its_units(version, tmp_path):
    """FMPy finds the FMU valid; exponents, factor and offset of every unit are in it."""
    file = tmp_path / "gauge.fmu"
    export(choose("small_units:Gauge"), file, fmi=version)
    assert validate_fmu(str(file)) == []
    described = fmpy.read_model_description(str(file))
    defined = {unit.name: unit.baseUnit for unit in described.unitDefinitions}
    torque, temperature = defined["kN.mm"], defined["degC"]
    assert (int(torque.kg), int(torque.m), int(torque.s)) == (1, 2, -2)
    assert (int(temperature.K), float(temperature.offset)) == (1, 273.15)
    assert units(described) == units(Gauge(GaugeParameters()).describe())


def test_a_recording_keeps_the_unit_as_given(tmp_path, monkeypatch):
    """The name in the metadata is the component's, and playing it back has the same unit."""
    monkeypatch.chdir(tmp_path)
    Path("gauge.yaml").write_text(SCENARIO.replace("SHOWN", "kN.mm"))
    assert status(["run", "gauge.yaml", "--out", "gauge.mcap"]) == 0
    own = ports("g", Playback(PlaybackParameters(Path("gauge.mcap"), "gauge")).describe())
    assert own["y"].unit == Unit("kN.mm", *read("kN.mm"))
