"""Units by name: the grammar, the table, and that what cannot be read is an error."""

import math
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchestrator.assembly.unit_names import BASES, NAMED, PREFIXED, read
from orchestrator.assembly.units import Unit, conversion

ALONE = [*BASES, *NAMED, *(prefix + unit for prefix in "kmM" for unit in sorted(PREFIXED))]
symbols = st.sampled_from(ALONE)
exponents = st.sampled_from([*range(-4, 0), *range(1, 5)])
powers = st.lists(st.tuples(symbols, exponents), min_size=1, max_size=4)


def spelt(parts, joint="."):
    """Return a product of powers as a name."""
    return joint.join(f"{symbol}{'' if n == 1 else n}" for symbol, n in parts)


def expected(parts):
    """Return the exponents and the logarithm of the factor of a product of powers."""
    read_ = [(read(symbol), n) for symbol, n in parts]
    dimension = tuple(sum(n * one[0][i] for one, n in read_) for i in range(len(BASES)))
    return dimension, sum(n * math.log(one[1]) for one, n in read_)


@settings(deadline=None)
@given(powers, st.sampled_from(".*"))
def test_a_product_adds_the_exponents_of_its_factors(parts, joint):
    """Exponents add, factors multiply, and a product has no offset."""
    dimension, log_factor = expected(parts)
    got = read(spelt(parts, joint))
    assert got[0] == dimension
    assert math.isclose(math.log(got[1]), log_factor, abs_tol=1e-9)
    assert got[2] == 0.0 or len(parts) == 1


@settings(deadline=None)
@given(powers, powers)
def test_a_quotient_subtracts_the_exponents_below(above, below):
    """What is below the stroke counts against what is above; a product there is in brackets."""
    dimension, log_factor = expected([*above, *((symbol, -n) for symbol, n in below)])
    got = read(f"{spelt(above)}/({spelt(below)})")
    assert got[0] == dimension
    assert math.isclose(math.log(got[1]), log_factor, abs_tol=1e-9)


@settings(deadline=None)
@given(symbols, symbols, st.floats(-1e6, 1e6))
def test_there_and_back(one, other, value):
    """A value converted to another unit of its dimension and back is the value again."""
    source, target = Unit(one, *read(one)), Unit(other, *read(other))
    if source.dimension != target.dimension:
        with pytest.raises(ValueError, match="unit of another dimension"):
            conversion(source, target)
        return
    there, back = conversion(source, target) or (1.0, 0.0), conversion(target, source) or (1.0, 0.0)
    result = (value * there[0] + there[1]) * back[0] + back[1]
    assert math.isclose(result, value, rel_tol=1e-9, abs_tol=1e-6)


@pytest.mark.parametrize(
    ("name", "same", "count"),
    [
        ("N.m", "J", 1.0),
        ("N.m", "kg.m2/s2", 1.0),
        ("V.A", "W", 1.0),
        ("Wb", "V.s", 1.0),
        ("m/s/s", "m/s2", 1.0),
        ("m^2", "m2", 1.0),
        ("s-1", "1/s", 1.0),
        ("J/(kg.K)", "m2/(s2.K)", 1.0),
        ("rpm", "deg/s", 6.0),
        ("km/h", "m/s", 1 / 3.6),
        ("kt", "km/h", 1.852),
        ("bar", "kPa", 100.0),
        ("l/min", "m3/h", 0.06),
        ("psi", "Pa", 6894.757293168361),
        ("kWh", "MJ", 3.6),
        ("rev", "deg", 360.0),
        ("%", "1", 0.01),
    ],
)
def test_units_that_are_so_many_of_another(name, same, count):
    """The table and the prefixes agree with each other and with what is known."""
    factor, offset = conversion(Unit(name, *read(name)), Unit(same, *read(same))) or (1.0, 0.0)
    assert factor == pytest.approx(count, rel=1e-12)
    assert offset == 0.0


@pytest.mark.parametrize(("name", "cold"), [("degC", 0.0), ("degF", 32.0), ("K", 273.15)])
def test_temperatures_have_their_zero(name, cold):
    """Water freezes at 0 degC, 32 degF and 273.15 K."""
    _, factor, offset = read(name)
    assert factor * cold + offset == pytest.approx(273.15, rel=1e-12)


@pytest.mark.parametrize("name", ["degC", "degF"])
def test_a_temperature_has_its_zero_however_it_is_spelt(name):
    """A power of one and brackets change nothing; a product or power is of differences."""
    for same in (f"{name}1", f"{name}^1", f"({name})", f"({name}1)"):
        assert read(same) == read(name)
        assert conversion(Unit(name, *read(name)), Unit(same, *read(same))) in (None, (1.0, 0.0))
    for other in (f"{name}2", f"{name}-1", f"1/{name}", f"{name}.m", f"m/{name}", f"{name}/s"):
        assert read(other)[2] == 0.0


def test_no_prefix_hides_a_named_unit():
    """What could be a prefix and a unit is the named unit: candela, minute, knot, foot, day."""
    for name, same in (("cd", "cd"), ("min", "60 s"), ("kt", "nmi/h"), ("d", "24 h")):
        count, of = same.split() if " " in same else (1, same)
        assert read(name)[0] == read(of)[0]
        assert read(name)[1] == pytest.approx(float(count) * read(of)[1])


@pytest.mark.parametrize(
    "name",
    [
        "", "m/s.kg", "m0", "m10", "12", "1/", "/s", "()", "((m))", "m 2", "m²", "knm", "kkg",
        "m..s", "km9." * 12 + "km9",
    ],
)  # fmt: skip
def test_what_is_no_unit(name):
    """Names outside the grammar, products that are ambiguous and sizes beyond a float are refused."""
    with pytest.raises(ValueError, match="unknown unit, got "):
        read(name)


@pytest.mark.parametrize(
    ("name", "near"), [("Nm", "N.m"), ("hz", "Hz"), ("rmp", "rpm"), ("M/S", "m/s"), ("m3/sec", "m3/s")]
)  # fmt: skip
def test_the_nearest_is_named(name, near):
    """A misspelt unit is told the nearest one, capitals or not."""
    with pytest.raises(ValueError, match=rf"got '{name}', expected .*did you mean '{near}'"):
        read(name)


@given(st.text("mskgN./*()^-12 ", max_size=12))
def test_any_text_is_a_unit_or_a_user_error(text):
    """Nothing but a ValueError comes of a text, and what is read has a factor above zero."""
    with suppress(ValueError):
        dimension, factor, _ = read(text)
        assert len(dimension) == len(BASES)
        assert 0.0 < factor < math.inf
