r"""The quadratic program of one update (eq. 7), assembled from linear responses.

With a response y = y0 + S alpha of every output (eq. 6A and section II.D) the cost is a sum of
weighted squares

    J(alpha) = sum over outputs and samples of w (e + S alpha)^2
             = J0 + 2 (1/2 alpha' H alpha + f' alpha),    H = S' W S,  f = S' W e,  J0 = e' W e

and the limits are rows that are linear in alpha:

    minimise    1/2 alpha' H alpha + f' alpha + rho1 sigma + 1/2 rho2 sigma^2
    subject to  lower <= A alpha <= upper                        hard
                soft_lower <= soft_A alpha + sigma,  sigma >= 0  soft, one shared slack

A tracked output has e = y0 - r and w = Q; an actuator has e = a0 - a_trim, w = R and the response
Sa; a command has e = u0 - c_ref, w = Rc and the response Phi. All are one kind of term.

Departure: the paper's R acts on the control itself, which biases the altitude; here on its
deviation from trim.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# a diverged rollout is no reason to warn here: a solver answers it with a status
_PASS_NON_FINITE = np.errstate(invalid="ignore", over="ignore")


@dataclass(frozen=True)
class Term:
    """Weighted squares of eq. 7: the sum over p outputs and H samples of w (e + S alpha)^2.

    Attributes
    ----------
    S : ndarray, shape (p, H, m)
        Response of the outputs to the coefficients.
    deviation : ndarray, shape (p, H)
        e, the outputs at alpha = 0 minus what they should be; a heading already wrapped.
    weight : ndarray, shape (p,) or (p, H)
        w >= 0, per output or per output and sample. An output of weight zero costs nothing.
    """

    S: Array
    deviation: Array
    weight: Array


@dataclass(frozen=True)
class Rows:
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


@_PASS_NON_FINITE
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
    low = np.broadcast_to(np.asarray(minimum, float)[..., None], nominal.shape)
    high = np.broadcast_to(np.asarray(maximum, float)[..., None], nominal.shape)
    A = S[:, chosen].reshape(-1, S.shape[2])
    return Rows(A, (low - nominal).ravel(), (high - nominal).ravel())


@_PASS_NON_FINITE
def clearance(
    S_position: Array,
    nominal: Array,
    slope_north: Array,
    slope_east: Array,
    minimum: float,
    every: int = 1,
) -> Rows:
    """Return rows that keep the clearance c = -D - h(N, E) above a minimum.

    Linearised in all three coordinates, c = c0 - (S_D + h_N S_N + h_E S_E) alpha: at speed the
    slope along the track matters as much as the altitude.

    Parameters
    ----------
    S_position : ndarray, shape (3, H, m)
        Response of north, east and down, m.
    nominal : ndarray, shape (H,)
        c0, m.
    slope_north, slope_east : ndarray, shape (H,)
        h_N and h_E below the nominal path.
    minimum : float
        m.
    every : int
        Every which sample has a row, the last included.

    Returns
    -------
    Rows
        r = ceil(H / every) rows with infinite upper bounds.
    """
    chosen = slice((len(nominal) - 1) % every, None, every)
    north, east, down = S_position[:, chosen]
    A = -(down + slope_north[chosen, None] * north + slope_east[chosen, None] * east)
    lower = minimum - nominal[chosen]
    return Rows(A, lower, np.full_like(lower, np.inf))


def _weighted_outputs(term: Term) -> Iterator[tuple[Array, Array, Array]]:
    """Yield S (H, m), deviation (H,) and weight (H,) or (1,) of every output that has a weight."""
    p, horizon, _ = term.S.shape
    if term.deviation.shape != (p, horizon):
        raise ValueError(
            f"term: deviation has the wrong shape, got {term.deviation.shape}, "
            f"expected {(p, horizon)}"
        )
    if term.weight.shape not in ((p,), (p, horizon)):
        raise ValueError(
            f"term: weight has the wrong shape, got {term.weight.shape}, "
            f"expected {(p,)} or {(p, horizon)}"
        )
    if np.any(term.weight < 0):
        raise ValueError(f"term: negative weight, got {np.min(term.weight)}, expected >= 0")
    weight = term.weight[:, None] if term.weight.ndim == 1 else term.weight
    for i in np.flatnonzero(weight.any(axis=1)):
        yield term.S[i], term.deviation[i], weight[i]


def _joined(hard: Sequence[Rows], m: int) -> Rows:
    """Return all hard rows that can bind, their bounds moved to admit alpha = 0."""
    A = np.concatenate([np.empty((0, m)), *(rows.A for rows in hard)])
    lower = np.concatenate([np.empty(0), *(rows.lower for rows in hard)])
    upper = np.concatenate([np.empty(0), *(rows.upper for rows in hard)])
    alive = A.any(axis=1) & ~(np.isneginf(lower) & np.isposinf(upper))
    chosen = slice(None) if alive.all() else alive
    return Rows(A[chosen], np.minimum(lower[chosen], 0.0), np.maximum(upper[chosen], 0.0))


@_PASS_NON_FINITE
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
    nominal path that is beyond a limit is never made worse. Rows without any response (an actuator
    held at its stop) are left out: whatever alpha, they read 0, which is admitted. So are rows
    without a finite bound.

    Numbers that are not finite pass through; a solver answers them with a status.

    Parameters
    ----------
    terms : sequence of Term
        At least one; all in the same m coefficients.
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
    m = terms[0].S.shape[2]
    gram, f, constant = np.zeros((m, m)), np.zeros(m), 0.0
    # one product per output: S and W S stay in the cache, and out of the page allocator
    for S, e, w in chain.from_iterable(map(_weighted_outputs, terms)):
        We = w * e
        gram += (S * w[:, None]).T @ S
        f += We @ S
        constant += float(We @ e)
    H = 0.5 * (gram + gram.T)
    H.flat[:: m + 1] += regularisation * np.trace(H) / m
    rows = _joined(hard, m)
    return QPData(
        H=H,
        f=f,
        A=rows.A,
        lower=rows.lower,
        upper=rows.upper,
        soft_A=np.empty((0, m)) if soft is None else soft.A,
        soft_lower=np.empty(0) if soft is None else soft.lower,
        rho1=rho1,
        rho2=rho2,
        constant=constant,
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
