"""A learned control basis: principal directions of optimal moves, all four channels in each.

A file of :mod:`paper.learn` holds the directions at several speeds. The same direction answers the same
references at all of them, so that in between it is interpolated: at a speed in the middle of two that
is as good as directions learned there, where those of the nearest speed cost a tenth more. Outside
they are those of the nearest.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from controller.bases import orthonormalise

Floats = NDArray[np.float64]


class Learned(NamedTuple):
    """Directions ``columns`` (V, 4, H, n) at ``speeds`` (V,), m/s, the first being the principal ones.

    They are of ``commands``, held over ``sample_period`` s.
    """

    speeds: Floats
    columns: Floats
    commands: tuple[str, ...]
    sample_period: float


@cache
def read_basis(file: Path) -> Learned:
    """Return the directions in a file.

    Raises
    ------
    ValueError
        If it is not such a file.
    FileNotFoundError
        If there is none.
    """
    try:
        with np.load(file, allow_pickle=False) as found:
            return Learned(
                found["speeds_mps"].astype(np.float64),
                found["columns"].astype(np.float64),
                tuple(str(name) for name in found["commands"]),
                float(found["sample_period_s"]),
            )
    except (KeyError, ValueError, TypeError, EOFError, BadZipFile) as error:
        raise ValueError(
            f"basis_file: no learned basis, got {file.name!r}, "
            "expected one written by `hedgehop learn-basis`"
        ) from error


def learned_basis(
    learned: Learned,
    horizon: int,
    count: int,
    *,
    speed: float,
    commands: tuple[str, ...],
    sample_period: float,
) -> Floats:
    """Return Phi, (4, H, count): the first directions at a speed, orthonormal over all channels.

    A horizon shorter than what was learned has the beginnings of the directions. Together the columns
    have unit RMS: Phi' Phi, summed over samples and channels, is 4 H I.

    Parameters
    ----------
    horizon, count : int
        H samples, directions.
    speed : float
        m/s.
    commands, sample_period
        Of the model that they are for.

    Raises
    ------
    ValueError
        If they were learned for other commands or samples, or not so many or so long.
    """
    known = learned.columns.shape
    for what, got, expected in (
        ("commands", commands, learned.commands),
        ("sample period", f"{sample_period:g} s", f"{learned.sample_period:g} s"),
    ):
        if got != expected:
            raise ValueError(
                f"basis learned: wrong {what} for this file, got {got}, expected {expected}"
            )
    for what, size, most in (("directions", count, known[3]), ("samples", horizon, known[2])):
        if size > most:
            raise ValueError(f"basis learned: too many {what}, got {size}, expected up to {most}")
    at = np.interp(speed, learned.speeds, np.arange(len(learned.speeds)))
    below = min(int(at), len(learned.speeds) - 2)
    low, high = learned.columns[below : below + 2, :, :horizon, :count]
    columns = low + (at - below) * (high - low)
    Phi, _ = orthonormalise(columns.reshape(-1, count))
    return Phi.reshape(4, horizon, count)
