"""The dynamics as symbolic expressions: the same text, traced by CasADi.

For C code, exact Jacobians and optimal control. CasADi (extra ``fmu``) is imported on first use.
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from plant import dynamics, trim
from plant.elementary import inject
from plant.r50 import Constants


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
            "symbolic dynamics: casadi is missing, got none, expected `pip install hedgehop[fmu]`"
        ) from None


@cache
def traced() -> SimpleNamespace:
    """Return the functions of :mod:`plant.dynamics`, which then take CasADi's SX for any number."""
    ca = casadi()
    return SimpleNamespace(
        **inject(
            dynamics,
            {
                "sincos": lambda x: (ca.sin(x), ca.cos(x)),
                "sqrt": ca.sqrt,
                "select": ca.if_else,
                "nearest": lambda x: x - ca.remainder(x, 1.0),  # IEEE: to the nearest, ties to even
            },
        )
    )


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
