"""Level flight of a black box: the state and commands that one sample leaves as they are."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from orchestrator.fmu.roles import RIGID

Floats = NDArray[np.float64]
_HIDDEN = len(RIGID)  # rotor, stabiliser bar, whatever else there is
_BALANCED = [3, 4, 5, 9, 10, 11]  # body velocity and rates
WORST = 1e-8  # m/s2, rad/s2, 1/s


def level(
    one: Callable[[Floats, Floats], Floats],
    speed: float,
    period: float,
    guess: tuple[Floats, Floats],
) -> tuple[Floats, Floats]:
    """Return the state (n,) and the commands (4,) of level flight north at ``speed`` m/s.

    The unknowns are roll, pitch, the states beyond the rigid body and the commands; as many rates
    vanish: of body velocity, body rates and those states. Sideslip over ground is none.

    Parameters
    ----------
    one : callable
        What is read after one sample, the state first, from a state under commands.
    period : float
        Sample period, s.
    guess : (n,), (4,)
        Near it; the position is kept.

    Raises
    ------
    ValueError
        If none is found.
    """
    from scipy.optimize import root

    state, commands = guess
    hidden = range(_HIDDEN, len(state))
    free = [6, 7, *hidden]

    def flight(z: Floats) -> Floats:
        x = np.zeros(len(state))
        x[:3] = state[:3]
        x[free] = z[:-4]
        phi, theta = x[6], x[7]
        x[3] = speed * math.cos(theta)
        x[4] = speed * math.sin(phi) * math.sin(theta)
        x[5] = speed * math.cos(phi) * math.sin(theta)
        return x

    def unbalance(z: Floats) -> Floats:
        before = flight(z)
        return (one(before, z[-4:])[: len(before)] - before)[[*_BALANCED, *hidden]] / period

    found = root(unbalance, np.concatenate([state[free], commands]), method="hybr", tol=1e-13)
    if not np.max(np.abs(unbalance(found.x))) <= WORST:
        raise ValueError(f"trim: no level flight found, got speed {speed:g} m/s")
    return flight(found.x), found.x[-4:]
