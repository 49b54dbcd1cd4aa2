"""Units: dimensions are checked, factors and offsets converted."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import describe

from orchestrator.assembly.units import Unit, conversion, units

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
