"""The dynamics as symbolic expressions: the same text, traced by CasADi.

For C code, exact Jacobians and optimal control. CasADi (extra ``fmu``) is imported on first use.
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any, NamedTuple

from plant import dynamics, lanes, trim
from plant.elementary import inject
from plant.r50 import Constants
from plant.rotorcraft import SAMPLE_PERIOD, Rotorcraft


def casadi() -> Any:
    """Return the module casadi.

    Raises
    ------
    ValueError
        If it is not installed.
    """
    try:
        return import_module("casadi")
    except ModuleNotFoundError:
        raise ValueError(
            "symbolic dynamics: casadi is missing, got none, expected `pip install casadi`"
        ) from None


@cache
def _elementary() -> dict[str, Any]:
    ca = casadi()
    return {
        "sincos": lambda x: (ca.sin(x), ca.cos(x)),
        "sqrt": ca.sqrt,
        "select": ca.if_else,
        "nearest": lambda x: x - ca.remainder(x, 1.0),  # IEEE: to the nearest, ties to even
    }


@cache
def traced() -> SimpleNamespace:
    """Return the functions of :mod:`plant.dynamics`, which then take CasADi's SX for any number."""
    return SimpleNamespace(**inject(dynamics, _elementary()))


@cache
def traced_trim() -> SimpleNamespace:
    """Return the functions of :mod:`plant.trim` that take CasADi's SX: ``level`` and ``unbalance``."""
    traced_modules: dict[str, Any] = {"dynamics": traced()}
    return SimpleNamespace(**inject(trim, traced_modules))


def scalars(symbols: Any) -> tuple[Any, ...]:
    """Return the elements of a CasADi column."""
    return tuple(casadi().vertsplit(symbols))


def casadi_derivative(p: Constants, *, collective: bool = False) -> Any:
    """Return the state's rate as a CasADi function, ``f(x, u, wind, ground, bias) -> rate``.

    Arguments and result as :func:`plant.dynamics.derivative` (or ``derivative_collective``): columns
    of 17, 4, 3, 1, 3 and 17. Its ``jacobian()`` and ``forward(n)`` are exact.
    """
    ca = casadi()
    x, u, wind, ground, bias = (
        ca.SX.sym(name, size)
        for name, size in (("x", 17), ("u", 4), ("wind", 3), ("ground", 1), ("bias", 3))
    )
    of = traced().derivative_collective if collective else traced().derivative
    rate = of(scalars(x), scalars(u), scalars(wind), ground, scalars(bias), p)
    names = ["x", "u", "wind", "ground", "bias"]
    return ca.Function(
        "derivative", [x, u, wind, ground, bias], [ca.vertcat(*rate)], names, ["rate"]
    )


class SampleMap(NamedTuple):
    """One sample of a helicopter as two CasADi functions of columns.

    ``advance(x, u, wind, bias)`` is the state at its end; ``outputs(x, u, x_end)`` the rows of
    :data:`plant.lanes.OUTPUTS` of a sample that began at ``x`` under ``u`` and ended at ``x_end``.
    That argument is there so that in multiple shooting an output depends on one node only.
    """

    advance: Any
    outputs: Any


def sample_map(craft: Rotorcraft) -> SampleMap:
    """Return 50 ms of a rollout of :mod:`plant.lanes`, attitude stabiliser included, no ground.

    States are the craft's own: 17, with the induced velocity in a collective rotor.
    """
    ca = casadi()
    x, u, end, wind, bias = (
        ca.SX.sym(name, size)
        for name, size in (("x", 17), ("u", 4), ("x_end", 17), ("wind", 3), ("bias", 3))
    )
    f = traced()
    step, record = _one_lane(f.derivative_collective if craft.collective else f.derivative)
    w = [*scalars(x), *[0.0] * (2 * lanes.STATES), *scalars(u), dynamics.NO_GROUND]
    for _ in range(craft.substeps):
        step(w, scalars(wind), scalars(bias), craft.p, SAMPLE_PERIOD / craft.substeps)
    out: dict[tuple[int, int, int], Any] = {}
    record([*scalars(end)], 0, 0, out)
    readings = [out[row, 0, 0] for row in range(len(out))]
    y = ca.vertcat(*readings, *f.actuators(scalars(x), scalars(u), craft.p))
    return SampleMap(
        ca.Function(
            "advance",
            [x, u, wind, bias],
            [ca.vertcat(*w[: lanes.STATES])],
            ["x", "u", "wind", "bias"],
            ["x_end"],
        ),
        ca.Function("outputs", [x, u, end], [y], ["x", "u", "x_end"], ["y"]),
    )


def _one_lane(derivative: Any) -> tuple[Any, Any]:
    """Return the Runge-Kutta step and the record of :mod:`plant.lanes`, for a block of one lane."""
    f = traced()
    offsets = {name: vars(lanes)[name] // lanes.LANES for name in ("LANES", "_S", "_K", "_U", "_G")}
    of = {"derivative": derivative, "actuators": f.actuators, "clip": f.clip}
    lane = inject(lanes, {**_elementary(), **offsets, **of})
    return lane["advance"], lane["_record"]
