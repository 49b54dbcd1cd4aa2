"""Ranks of S'QS in every reading of the paper: what of them is tolerance, scale and size.

The paper reports the rank of S_i' Q S_i (20 by 20: five functions on each of four controls) of three
outputs: 9 forward, 13 lateral, 6 yaw for Laguerre; 9, 9, 4 for Legendre. It names neither tolerance
nor scaling nor the size of the perturbations, so all of them are tried.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.prediction import identify, stack_bases
from paper.bases import COUNT, HORIZON, LEGENDRE, PAPERS, SECONDS, UNIT
from paper.problem import Form, level_flight

Floats = NDArray[np.float64]

THEIRS = (9, 13, 6, 9, 9, 4)
"""Forward, lateral and yaw with Laguerre polynomials, then with Legendre."""
AXES = ("forward", "lateral", "yaw")
OUTPUT_SETS: Mapping[str, tuple[str, str, str]] = {
    "positions": ("north", "east", "heading"),
    "speeds": ("velocity_north", "velocity_east", "heading"),
    "rates": ("velocity_north", "velocity_east", "yaw rate"),
}
"""What "forward flight", "lateral velocity" and "yaw response" may mean."""
DEGREE = float(np.radians(1.0))
UNITS: Mapping[tuple[Form, str], Floats] = {
    ("actuator", "G and rad"): np.ones(4),
    ("attitude", "G and rad"): np.ones(4),
    ("actuator", "G and degrees"): np.array([1.0, DEGREE, DEGREE, 1.0]),
    ("attitude", "G and degrees"): np.array([1.0, DEGREE, DEGREE, DEGREE]),
}
"""What a coefficient of 1 is on each control, in G and rad."""
TOLERANCES = 10.0 ** np.arange(-17.0, -1.0, 0.25)
MATLAB = 20 * float(np.finfo(float).eps)
"""Tolerance of MATLAB's ``rank``, relative to the largest singular value of a 20 by 20 matrix."""


class Reading(NamedTuple):
    """One way to read the paper: everything it leaves open but tolerance and family."""

    form: Form
    outputs: str
    unit: str
    amplitude: float
    scaled: bool


def sensitivities(form: Form, B: Floats, unit: Floats, amplitude: float) -> Mapping[str, Floats]:
    """Return S of every output, (H, 4 n), per unit of the coefficients; NaN where a flight ends.

    Level flight at 30 m/s, as the paper: each raw function, times ``amplitude`` units, on each
    control. Zero asks for the limit of small perturbations, by recursion.

    Parameters
    ----------
    B : ndarray, shape (H, n)
        Basis functions, raw.
    unit : ndarray, shape (4,)
        Of the coefficients, in G and rad.
    """
    flight = level_flight(form=form, horizon=len(B))
    found = identify(
        flight.model, flight.state, flight.u0, stack_bases([B] * 4), unit * amplitude,
        flight.wind, flight.bias, by="rollouts" if amplitude > 0.0 else "recursion",
    )  # fmt: skip
    S = found.S * np.repeat(unit, B.shape[1]) if found.valid else np.full_like(found.S, np.nan)
    named = dict(zip(flight.model.outputs, S, strict=True))
    period = flight.model.sample_period
    return {**named, "yaw rate": np.diff(named["heading"], axis=0, prepend=0.0) / period}


def spectrum(S: Floats, *, scaled: bool) -> Floats:
    """Return the singular values of S'S, falling, relative to the largest; as computed, not squared.

    ``scaled`` gives each column of S unit length first.
    """
    if not np.isfinite(S).all():
        return np.full(S.shape[1], np.nan)
    if scaled:
        S = S / np.linalg.norm(S, axis=0)
    values = np.linalg.svd(S.T @ S, compute_uv=False)
    return values / values[0]


def rank(values: Floats, tolerance: float) -> int:
    """Return how many of :func:`spectrum`'s values are above a tolerance."""
    return int(np.sum(values > tolerance))


def scan(
    readings: Sequence[Reading], tolerances: Floats, progress: Callable[[str], None]
) -> dict[str, list[Any]]:
    """Return the ranks of every reading at every tolerance; Laguerre in both of its times.

    Readings whose flights end before 10 s are left out.
    """
    columns: dict[str, list[Any]] = {
        name: [] for name in (*Reading._fields, "laguerre", "tolerance", *rank_names(), "distance")
    }
    for (form, unit, amplitude), group in _grouped(readings):
        if amplitude == readings[0].amplitude:
            progress(f"{form} form, {unit}")
        found = {
            family: sensitivities(form, basis(HORIZON, COUNT), UNITS[form, unit], amplitude)
            for family, basis in PAPERS.items()
        }
        for reading in group:
            spectra = {
                family: [
                    spectrum(S[name], scaled=reading.scaled)
                    for name in OUTPUT_SETS[reading.outputs]
                ]
                for family, S in found.items()
            }
            for laguerre, tolerance in product((UNIT, SECONDS), tolerances):
                values = (*spectra[laguerre], *spectra[LEGENDRE])
                if not np.isfinite(values).all():
                    continue
                ranks = [rank(each, float(tolerance)) for each in values]
                row = (*reading, laguerre, float(tolerance), *ranks, distance(ranks))
                for column, value in zip(columns.values(), row, strict=True):
                    column.append(value)
    return columns


def distance(ranks: Sequence[int]) -> int:
    """Return how far six ranks are from the paper's, summed."""
    return sum(abs(ours - theirs) for ours, theirs in zip(ranks, THEIRS, strict=True))


def nearest(columns: Mapping[str, Sequence[Any]], number: int) -> dict[str, list[Any]]:
    """Return the rows of a scan that are nearest to the paper, each sextuple once."""
    names = rank_names()
    seen: set[tuple[int, ...]] = set()
    rows: list[int] = []
    for row in np.argsort(columns["distance"], kind="stable").tolist():
        ranks = tuple(columns[name][row] for name in names)
        if ranks not in seen:
            seen.add(ranks)
            rows.append(row)
        if len(rows) == number:
            break
    return {name: [column[row] for row in rows] for name, column in columns.items()}


def _grouped(
    readings: Sequence[Reading],
) -> Iterator[tuple[tuple[Form, str, float], list[Reading]]]:
    """Yield the readings that share their rollouts."""
    groups: dict[tuple[Form, str, float], list[Reading]] = {}
    for reading in readings:
        groups.setdefault((reading.form, reading.unit, reading.amplitude), []).append(reading)
    yield from groups.items()


def rank_names() -> list[str]:
    """Return the names of a scan's columns of ranks, in the order of :data:`THEIRS`."""
    return [f"{family}_{axis}" for family in ("laguerre", "legendre") for axis in AXES]
