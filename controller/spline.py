"""Uniform cubic B-splines over the station: what lateral offset and altitude are made of.

On span i, where the station s is KNOT_M (i + t) with 0 <= t <= 1, the value is
sum_a w_a(t) c[i + a], a = 0..3. Coefficients that are kept keep position, slope and curvature
continuous for whatever is planned after them.
"""

import numpy as np
from numpy.typing import NDArray

from controller.jit import kernel

Array = NDArray[np.float64]
Weights = tuple[float, float, float, float]

KNOT_M = 20.0


@kernel
def weights(t: float) -> Weights:
    """Return the B-spline weights of the four coefficients of a span at t in [0, 1]."""
    r = 1.0 - t
    return (
        r * r * r / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0,
        t * t * t / 6.0,
    )


@kernel
def slope_weights(t: float) -> Weights:
    """Return the weights of the first derivative by s (1/m)."""
    r = 1.0 - t
    k = 0.5 / KNOT_M
    return (-r * r * k, (3.0 * t * t - 4.0 * t) * k, (4.0 * r - 3.0 * r * r) * k, t * t * k)


@kernel
def curvature_weights(t: float) -> Weights:
    """Return the weights of the second derivative by s (1/m^2)."""
    r = 1.0 - t
    k = 1.0 / KNOT_M**2
    return (r * k, (3.0 * t - 2.0) * k, (3.0 * r - 2.0) * k, t * k)


@kernel
def evaluate(coefficients: Array, span: int, w: Weights) -> float:
    """Return sum_a w_a c[span + a]."""
    c = coefficients
    return w[0] * c[span] + w[1] * c[span + 1] + w[2] * c[span + 2] + w[3] * c[span + 3]


@kernel
def normal_equations(
    kept: Array, values: Array, per_span: int, smoothing: float
) -> tuple[Array, Array]:
    """Return H (n, n), f (n,) of min 1/2 c'Hc + f'c: integral of (z - value)^2 + lambda z''^2.

    ``values`` (spans * per_span + 1,) are even samples, NaN where there is nothing to fit;
    ``kept`` (m,) are the first m of the spans + 3 coefficients, c the n others.
    """
    spans = (values.size - 1) // per_span
    H = np.zeros((spans + 3, spans + 3))
    f = np.zeros(spans + 3)
    step = KNOT_M / per_span
    for k in range(values.size):
        if np.isnan(values[k]):
            continue
        i = min(k // per_span, spans - 1)
        w = weights(k / per_span - i)
        for a in range(4):
            f[i + a] -= step * w[a] * values[k]
            for b in range(4):
                H[i + a, i + b] += step * w[a] * w[b]
    # z''^2 is quadratic on a span, so Simpson's rule is exact
    for t, share in ((0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)):
        w = curvature_weights(t)
        for i in range(spans):
            for a in range(4):
                for b in range(4):
                    H[i + a, i + b] += smoothing * KNOT_M * share * w[a] * w[b]
    m = kept.size
    for i in range(m, spans + 3):
        for a in range(m):
            f[i] += H[i, a] * kept[a]
    return H[m:, m:].copy(), f[m:].copy()


@kernel
def hold(coefficients: Array, size: int, low: float, high: float, curvature: float) -> Array:
    """Return coefficients lengthened to ``size``: the slope moves into [low, high] and stays there.

    It changes by at most ``curvature`` (1/m^2) times the distance.
    """
    n = coefficients.size
    out = np.empty(max(n, size))
    for k in range(n):
        out[k] = coefficients[k]
    for k in range(n, size):
        step = out[k - 1] - out[k - 2]
        change = curvature * KNOT_M**2
        target = min(max(step, low * KNOT_M), high * KNOT_M)
        out[k] = out[k - 1] + min(max(target, step - change), step + change)
    return out
