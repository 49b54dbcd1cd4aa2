"""Level-flight trim of the helicopter at any speed."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant import dynamics
from plant.r50 import STABILISER_GAINS, Constants

Floats = NDArray[np.float64]
_STILL = (0.0, 0.0, 0.0)


class Trim(NamedTuple):
    """Straight and level flight, heading north at altitude 0.

    ``state`` (17,) as :mod:`plant.dynamics`, rotor slot in G; ``actuators`` (4,) thrust G, pitch rad,
    roll rad, tail G.
    """

    state: tuple[float, ...]
    actuators: tuple[float, ...]


def level(z: Any, speed: Any, p: Constants) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return (state, command in actuator form) of level flight.

    ``z`` holds what is free: thrust, a_c, b_c, tail, phi, theta, a, b.
    """
    thrust, a_c, b_c, tail, phi, theta, a, b = z
    u, v, w = dynamics.body_from_ned(
        (speed, 0.0, 0.0),
        (*dynamics.sincos(phi), *dynamics.sincos(theta), 0.0, 1.0),
    )
    bar = ((1.0 - p.k_a) * a_c / p.A_c, (1.0 - p.k_b) * b_c / p.B_d)
    state = (0.0, 0.0, 0.0, u, v, w, phi, theta, 0.0, 0.0, 0.0, 0.0, a, b, thrust, *bar)
    return state, (thrust, a_c, b_c, tail)


def unbalance(z: Any, speed: Any, p: Constants, ground: Any) -> tuple[Any, ...]:
    """Return the eight accelerations that vanish in trim, in actuator form."""
    free = p._replace(direct=1.0, a_trim=0.0, b_trim=0.0, tail_trim=0.0, K_theta=0.0, K_phi=0.0,
                      K_psi=0.0, K_q=0.0, K_p=0.0, K_r=0.0)  # fmt: skip
    state, u = level(z, speed, free)
    rates = dynamics.derivative(state, u, _STILL, ground, _STILL, free)
    return (*rates[3:6], *rates[9:14])


def first_guess(speed: Any, p: Constants) -> tuple[Any, ...]:
    """Return ``z`` near the trim, where the search begins."""
    theta = -2.5e-4 * speed * speed
    weight = p.mass * p.g / p.weight
    return 1.02 * weight, -3e-5 * speed**2, 0.01, 0.06, 0.05, theta, 0.0, 0.005


@lru_cache(maxsize=256)
def trim(speed: float, p: Constants, ground: float = dynamics.NO_GROUND) -> Trim:
    """Solve for level flight at ``speed`` m/s (0 to 35), at altitude 0 over ground at ``ground`` m.

    Raises
    ------
    ValueError
        If no trim is found within the actuators' bounds.
    """
    from scipy.optimize import root

    def residual(z: Floats) -> Floats:
        return np.array(unbalance(z.tolist(), speed, p, ground))

    found = root(residual, np.array(first_guess(speed, p)), method="hybr", tol=1e-13)
    state, u = level(found.x.tolist(), speed, p)
    if np.max(np.abs(residual(found.x))) > 1e-8:
        raise ValueError(
            f"trim: no level flight found, got speed {speed:g} m/s, expected 0 to 35 m/s"
        )
    return Trim(state, u)


def with_stabiliser(p: Constants, speed: float) -> Constants:
    """Return the constants in attitude form: gains of the attitude loop and its trim at ``speed``."""
    level = trim(speed, p).actuators
    return p._replace(**STABILISER_GAINS, a_trim=level[1], b_trim=level[2], tail_trim=level[3])
