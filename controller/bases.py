r"""Control basis functions: the shapes whose scaled sum is a correction of the controls.

One control channel over the horizon is corrected by (the paper, eq. 6A)

    delta u = B alpha,      B of shape (H, n_b), one basis function per column.

Sample k = 0 .. H-1 lies at t_k = k Ts, and at s_k = k/(H-1) on [0, 1].

The optimum of the quadratic program depends only on the *span* of the columns, its arithmetic on
their conditioning: five raw Laguerre columns on [0, 1] are nearly collinear. Responses are
therefore identified on orthonormal columns ``Phi`` of the span (:func:`span_basis`), and the
paper's coefficients, where wanted, are ``to_raw @ alpha``, since B to_raw = Phi.

The paper's Rodrigues formulas give the standard polynomials, so numpy's Vandermonde matrices are
the implementation.

Departure: the paper evaluates its Laguerre polynomials on [0, 1] (figure 1) although eq. 6 writes
b_n(k Ts); both are here, seconds by default. Laguerre functions, Chebyshev polynomials and splines
are additions.
"""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.polynomial import chebyshev as chebyshev_series
from numpy.polynomial import laguerre as laguerre_series
from numpy.polynomial import legendre as legendre_series
from numpy.typing import NDArray

Array = NDArray[np.float64]
Time = Literal["seconds", "normalised"]


def _unit_time(horizon: int) -> Array:
    return np.linspace(0.0, 1.0, horizon)


def laguerre(horizon: int, count: int, *, sample_period: float, time: Time = "seconds") -> Array:
    r"""Return the Laguerre polynomials b_0 .. b_{n-1} of eq. 2.4.

    b_n(t) = e^t / n! d^n/dt^n (t^n e^{-t}), so b_0 = 1, b_1 = 1 - t, b_2 = 1 - 2t + t^2/2.

    Parameters
    ----------
    horizon, count : int
        H samples, n_b functions.
    sample_period : float
        Ts, s.
    time : {"seconds", "normalised"}
        Argument of the polynomials: k Ts (eq. 6) or k/(H-1) (figure 1).

    Returns
    -------
    ndarray, shape (H, n_b)
    """
    t = np.arange(horizon) * sample_period if time == "seconds" else _unit_time(horizon)
    return np.asarray(laguerre_series.lagvander(t, count - 1), dtype=np.float64)


def legendre(horizon: int, count: int) -> Array:
    r"""Return the Legendre polynomials of section II.C on [-1, 1], shape (H, n_b).

    b_n(x) = 1/(2^n n!) d^n/dx^n (x^2 - 1)^n at x_k = 2 k/(H-1) - 1.
    """
    x = 2 * _unit_time(horizon) - 1
    return np.asarray(legendre_series.legvander(x, count - 1), dtype=np.float64)


def laguerre_function(
    horizon: int, count: int, *, sample_period: float, pole_per_s: float
) -> Array:
    r"""Return Laguerre functions, polynomial times exponential, shape (H, n_b).

    l_i(t) = sqrt(2p) e^{-p t} L_i(2 p t), orthonormal on [0, inf), sampled at t_k = k Ts.

    Parameters
    ----------
    horizon, count : int
        H samples, n_b functions.
    sample_period : float
        Ts, s.
    pole_per_s : float
        p, 1/s: the time scale is 1/p.
    """
    t = np.arange(horizon)[:, None] * sample_period
    polynomials = laguerre_series.lagvander(2 * pole_per_s * t[:, 0], count - 1)
    return np.sqrt(2 * pole_per_s) * np.exp(-pole_per_s * t) * polynomials


def chebyshev(horizon: int, count: int) -> Array:
    """Return the Chebyshev polynomials T_i(2 s_k - 1), shape (H, n_b)."""
    x = 2 * _unit_time(horizon) - 1
    return np.asarray(chebyshev_series.chebvander(x, count - 1), dtype=np.float64)


def tent(horizon: int, count: int) -> Array:
    """Return overlapping tents max(0, 1 - (n-1) |s_k - c_i|), c_i = i/(n-1), shape (H, n_b).

    The first and the last are half tents; they sum to one. A single tent is the constant.
    """
    if count == 1:
        return np.ones((horizon, 1))
    centres = np.linspace(0.0, 1.0, count)
    distance = np.abs(_unit_time(horizon)[:, None] - centres)
    return np.maximum(0.0, 1.0 - (count - 1) * distance)


def ramp(horizon: int, count: int) -> Array:
    """Return ramps n s_k - i on interval i of n equal intervals and 0 elsewhere, (H, n_b)."""
    return box(horizon, count) * (count * _unit_time(horizon)[:, None] - np.arange(count))


def box(horizon: int, count: int) -> Array:
    """Return boxes, 1 on interval i of n equal intervals (move blocking), shape (H, n_b)."""
    return np.eye(count)[np.arange(horizon) * count // horizon]


def bspline(horizon: int, count: int) -> Array:
    """Return clamped cubic B-splines on graded knots T_H (j/(n-3))^2, shape (H, n_b).

    Early spans are the short ones: what is applied before the next update can be shaped finely.
    They sum to one.

    Raises
    ------
    ValueError
        If there are fewer than four functions.
    """
    from scipy.interpolate import BSpline

    if count < 4:
        raise ValueError(f"basis bspline: too few functions, got {count}, expected at least 4")
    knots = np.pad(np.linspace(0.0, 1.0, count - 2) ** 2, 3, mode="edge")
    return BSpline.design_matrix(_unit_time(horizon), knots, 3).toarray()


def full(horizon: int, count: int) -> Array:
    """Return the identity: one function per sample, no reduction of order.

    Raises
    ------
    ValueError
        If the count is not the horizon.
    """
    if count != horizon:
        raise ValueError(
            f"basis full: wrong number of functions, got {count}, "
            f"expected one per sample, {horizon}"
        )
    return np.eye(horizon)


BASES: Mapping[str, Callable[..., Array]] = MappingProxyType(
    {
        "laguerre": laguerre,
        "laguerre_function": laguerre_function,
        "legendre": legendre,
        "chebyshev": chebyshev,
        "tent": tent,
        "ramp": ramp,
        "box": box,
        "bspline": bspline,
        "full": full,
    }
)
POLYNOMIAL = frozenset({"laguerre", "legendre", "chebyshev"})


def orthonormalise(B: Array) -> tuple[Array, Array]:
    """Return orthonormal columns of the span of B, and the map to B's own coefficients.

    B = Q R (thin QR, R with a positive diagonal);  Phi = sqrt(H) Q;  to_raw = sqrt(H) R^{-1}.

    Parameters
    ----------
    B : ndarray, shape (H, n_b)
        Basis functions, one per column.

    Returns
    -------
    Phi : ndarray, shape (H, n_b)
        Columns of unit RMS: Phi' Phi = H I.
    to_raw : ndarray, shape (n_b, n_b)
        B to_raw = Phi: a correction Phi alpha is B (to_raw alpha).

    Raises
    ------
    ValueError
        If the columns are linearly dependent in double precision.
    """
    horizon, count = B.shape
    Q, R = np.linalg.qr(B)
    sign = np.where(np.diag(R) < 0, -1.0, 1.0)
    size = np.abs(np.diag(R))
    rank = int(np.sum(size > horizon * np.finfo(float).eps * size.max()))
    if count > horizon or rank < count:
        raise ValueError(
            f"basis: columns are linearly dependent, got rank {rank}, expected {count}"
        )
    scale = np.sqrt(horizon)
    return scale * Q * sign, scale * np.linalg.inv(R) * sign


def span_basis(
    family: str,
    horizon: int,
    count: int,
    *,
    sample_period: float,
    time: Time = "seconds",
    pole_per_s: float = 0.5,
) -> tuple[Array, Array]:
    """Return orthonormal columns of a family's span, and the map to the family's coefficients.

    Polynomials of equal degree span the same space, so their columns are built from Legendre
    polynomials, whatever the family, and those of Laguerre functions from e^{-p t} times these;
    only the map differs. Where the family's own columns are dependent in double precision (beyond
    about 15 Laguerre polynomials) the map is the smallest that least squares allows, and says
    little.

    Parameters
    ----------
    family : str
        A name of :data:`BASES`.
    horizon, count : int
        H samples, n_b functions.
    sample_period : float
        Ts, s.
    time : {"seconds", "normalised"}
        For ``laguerre``: the argument of the polynomials.
    pole_per_s : float
        For ``laguerre_function``: the pole, 1/s.

    Returns
    -------
    Phi : ndarray, shape (H, n_b)
        Columns of unit RMS: Phi' Phi = H I.
    to_raw : ndarray, shape (n_b, n_b)
        The paper's coefficients are ``to_raw @ alpha``.

    Raises
    ------
    KeyError
        If the family is unknown.
    ValueError
        If the count is not in 1..H, or the columns are linearly dependent.
    """
    if family not in BASES:
        near = get_close_matches(family, BASES, n=1, cutoff=0.0)[0]
        raise KeyError(f"basis: unknown name, got {family!r}, expected one such as {near!r}")
    if not 1 <= count <= horizon:
        raise ValueError(
            f"basis {family}: wrong number of functions, got {count}, expected 1 to {horizon}"
        )
    options: dict[str, dict[str, Any]] = {
        "laguerre": {"sample_period": sample_period, "time": time},
        "laguerre_function": {"sample_period": sample_period, "pole_per_s": pole_per_s},
    }
    B = BASES[family](horizon, count, **options.get(family, {}))
    if family in POLYNOMIAL:
        spanning = legendre(horizon, count)
    elif family == "laguerre_function":
        t = np.arange(horizon)[:, None] * sample_period
        spanning = np.exp(-pole_per_s * t) * legendre(horizon, count)
    else:
        return orthonormalise(B)
    Phi, _ = orthonormalise(spanning)
    return Phi, np.asarray(np.linalg.lstsq(B, Phi)[0], dtype=np.float64)
