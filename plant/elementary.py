"""Elementary functions for straight-line mathematics, plain and compiled.

The dynamics call ``sincos``, ``sqrt``, ``select`` and ``nearest`` and nothing else. The plain ones
are here under those names; :data:`COMPILED` holds their twins for lane kernels, which contain no
branch and no call, so that LLVM vectorises the loop around them. :func:`wide` says how wide.
"""

import math
from collections.abc import Callable, Mapping
from types import FunctionType, ModuleType
from typing import Any

import numba
from numba.extending import intrinsic

sqrt = math.sqrt
_INLINE: dict[str, Any] = {
    "forceinline": True,
    "fastmath": {"contract", "arcp"},  # multiply-adds fuse; x / constant is x times its reciprocal
    "error_model": "numpy",  # no zero-division branch
    "no_cpython_wrapper": True,  # only kernels call it
    "no_cfunc_wrapper": True,
}
inline = numba.njit(**_INLINE)


def sincos(x: float) -> tuple[float, float]:
    """Return (sin x, cos x)."""
    return math.sin(x), math.cos(x)


def select(condition: bool, yes: float, no: float) -> float:
    """Return ``yes`` where the condition holds, else ``no``; both are evaluated."""
    return yes if condition else no


def nearest(x: float) -> float:
    """Return the nearest integer as a float, ties to even."""
    return float(round(x))


def wide() -> None:
    """Do nothing. Compiled: allow vectors of 512 bits in the function that calls this.

    LLVM prefers 256 bits even where a processor has 512; one without them is not affected.
    """


def inject(
    module: ModuleType,
    elementary: Mapping[str, Callable[..., Any]],
    wrap: Callable[[Callable[..., Any]], Callable[..., Any]] = lambda function: function,
) -> dict[str, Any]:
    """Return a copy of a module's functions that call ``elementary`` in place of the plain ones.

    ``wrap`` is applied to each function (numba's ``njit``, say), in the order of the source.
    """
    namespace: dict[str, Any] = {**vars(module), **elementary}
    for name, function in vars(module).items():
        if isinstance(function, FunctionType) and function.__module__ == module.__name__:
            namespace[name] = wrap(FunctionType(function.__code__, namespace, name))
    return namespace


@inline
def _sqrt(x: float) -> float:
    """Return the square root (an instruction, not a call)."""
    return math.sqrt(x)


@inline
def _nearest(x: float) -> float:
    """Round by adding and subtracting 1.5 * 2**52; exact for |x| < 2**51."""
    return (x + 6755399441055744.0) - 6755399441055744.0


@inline
def _select(condition: bool, yes: float, no: float) -> float:
    return yes if condition else no


# pi/2 in three parts (Cody and Waite): n * PIO2_1 and n * PIO2_2 are exact for |n| < 2**20
_PIO2_1 = 1.57079632673412561417e00
_PIO2_2 = 6.07710050630396597660e-11
_PIO2_3 = 2.02226624879595063154e-21


@inline
def _sincos(x: float) -> tuple[float, float]:
    """Return (sin x, cos x) to about 1 ulp for |x| < 1e6 rad.

    One range reduction to |y| <= pi/4, then the minimax polynomials of degree 13 and 14
    (coefficients: FDLIBM, kernel sine and cosine).
    """
    n = _nearest(x * (2.0 / math.pi))
    y = ((x - n * _PIO2_1) - n * _PIO2_2) - n * _PIO2_3
    z = y * y
    s = y + y * z * (
        -1.66666666666666324348e-01
        + z * (8.33333333332248946124e-03
        + z * (-1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06
        + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))))
    )  # fmt: skip
    c = 1.0 - 0.5 * z + z * z * (
        4.16666666666666019037e-02
        + z * (-1.38888888888741095749e-03
        + z * (2.48015872894767294178e-05
        + z * (-2.75573143513906633035e-07
        + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))))
    )  # fmt: skip
    quarter = n - 4.0 * _nearest(0.25 * n - 0.375)
    swap = (quarter == 1.0) | (quarter == 3.0)
    sine = c if swap else s
    cosine = s if swap else c
    return (
        -sine if quarter >= 2.0 else sine,
        -cosine if (quarter == 1.0) | (quarter == 2.0) else cosine,
    )


@intrinsic
def _wide(typing_context: Any) -> Any:
    """Set the calling function's attribute: unlike LLVM's CPU features it is not of the process."""
    del typing_context

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del signature, arguments
        # llvmlite's own ``add`` knows no attributes with a value
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return numba.types.none(), generate


COMPILED: dict[str, Callable[..., Any]] = {
    "sincos": _sincos,
    "sqrt": _sqrt,
    "select": _select,
    "nearest": _nearest,
    "wide": _wide,
}


def compiled(module: ModuleType) -> dict[str, Any]:
    """Return a module's functions, compiled to be inlined into a kernel."""
    return inject(module, COMPILED, inline)
