"""Units by name: SI and what is usual beside it, with prefixes, in products, quotients and powers.

The grammar is Modelica's (specification 3.6, chapter 19), on which FMI's names are modelled:
``N.m``, ``kg.m2``, ``m/s2``, ``J/(kg.K)``. ``*`` is taken for ``.``, and ``m^2`` for ``m2``.
"""

import math
import re

from orchestrator.errors import nearest

BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
NAMED: dict[str, tuple[float, str]] = {  # name: so many of what; G is weight, of no dimension
    "G": (1.0, "1"), "%": (0.01, "1"),
    "g": (1e-3, "kg"), "t": (1e3, "kg"), "lb": (0.45359237, "kg"),
    "min": (60.0, "s"), "h": (3600.0, "s"), "d": (86400.0, "s"), "Hz": (1.0, "1/s"),
    "deg": (math.pi / 180.0, "rad"), "rev": (2.0 * math.pi, "rad"), "rpm": (math.pi / 30.0, "rad/s"),
    "ft": (0.3048, "m"), "in": (0.0254, "m"), "mi": (1609.344, "m"), "nmi": (1852.0, "m"),
    "kn": (1852.0 / 3600.0, "m/s"), "kt": (1852.0 / 3600.0, "m/s"),
    "l": (1e-3, "m3"), "L": (1e-3, "m3"), "degC": (1.0, "K"), "degF": (5.0 / 9.0, "K"),
    "N": (1.0, "kg.m/s2"), "lbf": (4.4482216152605, "N"),
    "Pa": (1.0, "N/m2"), "bar": (1e5, "Pa"), "psi": (4.4482216152605 / 0.0254**2, "Pa"),
    "J": (1.0, "N.m"), "Wh": (3600.0, "J"), "W": (1.0, "J/s"),
    "C": (1.0, "A.s"), "V": (1.0, "W/A"), "Ohm": (1.0, "V/A"), "S": (1.0, "A/V"),
    "F": (1.0, "C/V"), "Wb": (1.0, "V.s"), "T": (1.0, "Wb/m2"), "H": (1.0, "Wb/A"),
}  # fmt: skip
OFFSETS = {"degC": 273.15, "degF": 459.67 * 5.0 / 9.0}  # K; a product is of differences
PREFIXES = {
    "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1,
    "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip
PREFIXED = frozenset(
    "m s A K mol cd rad g l L bar Hz N Pa J Wh W C V Ohm S F Wb T H".split()  # noqa: SIM905
)
USUAL = ("m/s", "m/s2", "rad/s", "km/h", "1/s", "m2", "m3/s", "N.m", "N.s/m", "kg.m2", "kg/m3")
_POWER = re.compile(r"([A-Za-z%]+)(?:\^?(-?[1-9]))?")
_ALONE = re.compile(r"\(?([A-Za-z]+)(?:\^?1)?\)?")

Dimension = tuple[int, ...]


def read(name: str) -> tuple[Dimension, float, float]:
    """Return the exponents of :data:`BASES`, the factor and the offset of a unit.

    ``SI value = factor * value + offset``.

    Raises
    ------
    ValueError
        If it cannot be read; with the nearest names.

    Examples
    --------
    >>> read("N.m")
    ((1, 2, -2, 0, 0, 0, 0, 0), 1.0, 0.0)
    >>> read("degC")
    ((0, 0, 0, 0, 1, 0, 0, 0), 1.0, 273.15)
    """
    try:
        dimension, factor = _quotient(name)
        if not 0.0 < factor < math.inf:
            raise ValueError(name)  # noqa: TRY301
    except (ValueError, OverflowError):
        known = [*BASES, *NAMED, *USUAL]
        same = [one for one in known if one.lower() == name.lower()]
        near = f", did you mean {same[0]!r}" if same else nearest(name, known)
        message = f"unknown unit, got {name!r}, expected one as 'N', 'kg.m2' or 'J/(kg.K)'{near}"
        raise ValueError(message) from None
    alone = _ALONE.fullmatch(name)
    return dimension, factor, OFFSETS.get(alone[1], 0.0) if alone else 0.0


def _quotient(text: str) -> tuple[Dimension, float]:
    over, *under = text.split("/")
    dimension, factor = _product(over)
    for part in under:
        if not part.startswith("(") and re.search("[.*]", part):
            raise ValueError(part)  # of a/b.c, nobody can tell whether c is above or below
        below, divisor = _product(part)
        dimension = tuple(a - b for a, b in zip(dimension, below, strict=True))
        factor /= divisor
    return dimension, factor


def _product(text: str) -> tuple[Dimension, float]:
    inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
    powers = [_power(part) for part in re.split("[.*]", inner)]
    dimensions = zip(*(dimension for dimension, _ in powers), strict=True)
    return tuple(map(sum, dimensions)), math.prod(factor for _, factor in powers)


def _power(text: str) -> tuple[Dimension, float]:
    if text == "1":
        return (0,) * len(BASES), 1.0
    matched = _POWER.fullmatch(text)
    if matched is None:
        raise ValueError(text)
    dimension, factor = _symbol(matched[1])
    exponent = int(matched[2] or 1)
    scale = factor**exponent if exponent > 0 else 1.0 / factor**-exponent
    return tuple(exponent * each for each in dimension), scale


def _symbol(text: str) -> tuple[Dimension, float]:
    if text in BASES:
        return tuple(int(base == text) for base in BASES), 1.0
    if text in NAMED:
        count, of = NAMED[text]
        dimension, factor = _quotient(of)
        return dimension, count * factor
    if text[:1] in PREFIXES and text[1:] in PREFIXED:
        dimension, factor = _symbol(text[1:])
        return dimension, PREFIXES[text[0]] * factor
    raise ValueError(text)
