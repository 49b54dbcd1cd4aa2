r"""The quadratic program of one update (eq. 7), assembled from linear responses.

With a response y = y0 + S alpha of every output (eq. 6A and section II.D) the cost is a sum of
weighted squares

    J(alpha) = sum over outputs of w |e + S alpha|^2  =  |x + X alpha|^2
             = J0 + 2 (1/2 alpha' H alpha + f' alpha),    H = X' X,  f = X' x,  J0 = x' x

and the limits are rows that are linear in alpha:

    minimise    1/2 alpha' H alpha + f' alpha + rho1 sigma + 1/2 rho2 sigma^2
    subject to  lower <= A alpha <= upper                        hard
                soft_lower <= soft_A alpha + sigma,  sigma >= 0  soft, one shared slack

A tracked output has e = y0 - r and w = Q; an actuator has e = a0 - a_trim, w = R and the response
Sa; a command has e = u0 - c_ref, w = Rc and the response Phi. All are one kind of term; X and x are
those with a weight, times sqrt(w), one below the other.

Departure: the paper's R acts on the control itself, which biases the altitude; here on its
deviation from trim.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Term(NamedTuple):
    """The weighted squares of one output: w |e + S alpha|^2, summed over H samples.

    Attributes
    ----------
    S : ndarray, shape (H, m)
        Response of the output to the coefficients.
    e : ndarray, shape (H,)
        The output at alpha = 0 minus what it should be; a heading already wrapped.
    w : float
        Weight >= 0. An output of weight zero costs nothing.
    """

    S: Array
    e: Array
    w: float


class Rows(NamedTuple):
    """Limits lower <= A alpha <= upper; A has shape (r, m), the bounds (r,), perhaps infinite."""

    A: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class QPData:
    """One quadratic program in m coefficients: all that a solver is told (see the module).

    Attributes
    ----------
    H : ndarray, shape (m, m)
        Positive definite.
    f : ndarray, shape (m,)
        Gradient of half the cost at alpha = 0.
    A : ndarray, shape (r, m)
        Hard rows.
    lower, upper : ndarray, shape (r,)
        Their bounds, perhaps infinite.
    soft_A : ndarray, shape (s, m)
        Soft rows.
    soft_lower : ndarray, shape (s,)
        Their lower bounds.
    rho1, rho2 : float
        Linear and quadratic weight of the slack, both > 0. The penalty is exact, so that no row is
        violated without need, while rho1 exceeds the *sum* of the soft rows' multipliers.
    constant : float
        J0, the cost at alpha = 0 without penalty.
    """

    H: Array
    f: Array
    A: Array
    lower: Array
    upper: Array
    soft_A: Array
    soft_lower: Array
    rho1: float
    rho2: float
    constant: float


def bounds(
    S: Array, nominal: Array, minimum: ArrayLike, maximum: ArrayLike, every: int = 1
) -> Rows:
    """Return rows that keep outputs between limits at every ``every``-th sample, the last included.

    Parameters
    ----------
    S : ndarray, shape (p, H, m)
        Response of the outputs.
    nominal : ndarray, shape (p, H)
        The outputs at alpha = 0.
    minimum, maximum : array_like, shape (p,) or ()
        Their limits.
    every : int
        1 takes all samples.

    Returns
    -------
    Rows
        r = p ceil(H / every) rows, output by output.
    """
    chosen = slice((nominal.shape[1] - 1) % every, None, every)
    nominal = nominal[:, chosen]
    lower = np.asarray(minimum)[..., None] - nominal
    upper = np.asarray(maximum)[..., None] - nominal
    return Rows(S[:, chosen].reshape(-1, S.shape[2]), lower.ravel(), upper.ravel())


def clearance(
    S: Array, nominal: Array, slope_north: Array, slope_east: Array, minimum: float
) -> Rows:
    """Return rows that keep the clearance c = altitude - h(north, east) above a minimum.

    Linearised in all three coordinates, c = c0 + (S_z - h_N S_N - h_E S_E) alpha: at speed the
    slope along the track matters as much as the altitude.

    Parameters
    ----------
    S : ndarray, shape (3, r, m)
        Response of north, east and altitude, m, at r samples.
    nominal : ndarray, shape (r,)
        c0, m.
    slope_north, slope_east : ndarray, shape (r,)
        h_N and h_E below the nominal path.
    minimum : float
        m.

    Returns
    -------
    Rows
        r rows with infinite upper bounds.
    """
    north, east, altitude = S
    A = altitude - slope_north[:, None] * north - slope_east[:, None] * east
    lower = minimum - nominal
    return Rows(A, lower, np.full_like(lower, np.inf))


def _stacked(terms: Sequence[Term]) -> tuple[Array, Array]:
    """Return X (n, m) and x (n,) of |x + X alpha|^2."""
    for S, e, w in terms:
        if e.shape != S.shape[:1]:
            raise ValueError(f"term: e has the wrong shape, got {e.shape}, expected {S.shape[:1]}")
        if w < 0:
            raise ValueError(f"term: negative weight, got {w}, expected >= 0")
    terms = [term for term in terms if term.w > 0]
    root = np.sqrt([w for _, _, w in terms])[:, None]
    X = np.concatenate([S for S, _, _ in terms])
    x = np.concatenate([e for _, e, _ in terms])
    for part in (X, x):
        by_term = part.reshape(len(terms), -1)
        by_term *= root
    return X, x


def assemble(
    terms: Sequence[Term],
    hard: Sequence[Rows],
    soft: Rows | None = None,
    *,
    rho1: float = 2e3,
    rho2: float = 2e2,
    regularisation: float = 1e-12,
) -> QPData:
    """Return the quadratic program of the terms and rows.

    alpha = 0 satisfies every hard row: bounds are moved to admit it, lower <- min(lower, 0), so a
    nominal path that is beyond a limit is never made worse.

    Parameters
    ----------
    terms : sequence of Term
        At least one with a weight; all in the same m coefficients.
    hard : sequence of Rows
        Limits that alpha may not make worse.
    soft : Rows, optional
        Lower limits that may be violated at the price of the shared slack.
    rho1, rho2 : float
        Weights of the slack, see :class:`QPData`.
    regularisation : float
        Added to the diagonal of H, relative to its mean.

    Raises
    ------
    ValueError
        If shapes do not agree, or a weight is negative or both rho are not positive.
    """
    if rho1 <= 0 or rho2 <= 0:
        raise ValueError(f"slack: weights must be positive, got rho1 {rho1} and rho2 {rho2}")
    X, x = _stacked(terms)
    m = X.shape[1]
    H = X.T @ X
    diagonal = H.reshape(-1)[:: m + 1]
    diagonal += regularisation * diagonal.sum() / m
    none = Rows(np.empty((0, m)), np.empty(0), np.empty(0))
    soft = none if soft is None else soft
    A, lower, upper = (np.concatenate(parts) for parts in zip(none, *hard, strict=True))
    return QPData(
        H=H,
        f=x @ X,
        A=A,
        lower=np.minimum(lower, 0.0),
        upper=np.maximum(upper, 0.0),
        soft_A=soft.A,
        soft_lower=soft.lower,
        rho1=rho1,
        rho2=rho2,
        constant=float(x @ x),
    )


def slack(data: QPData, alpha: Array) -> float:
    """Return the least sigma >= 0 that satisfies the soft rows at alpha."""
    return float(np.max(data.soft_lower - data.soft_A @ alpha, initial=0.0))


def penalty(sigma: float, rho1: float, rho2: float) -> float:
    """Return the price of a slack in units of the cost J: twice rho1 sigma + 1/2 rho2 sigma^2."""
    return 2.0 * rho1 * sigma + rho2 * sigma**2


def predicted_cost(data: QPData, alpha: Array) -> float:
    """Return J at alpha as the linear responses predict it, the slack's penalty included."""
    quadratic = 0.5 * alpha @ data.H @ alpha + data.f @ alpha
    return (
        data.constant + 2.0 * float(quadratic) + penalty(slack(data, alpha), data.rho1, data.rho2)
    )
