"""The response S by recursion along a trajectory, in place of a rollout for every column.

With the tangent of each sample of the nominal trajectory, small changes follow x' = A_k x + B_k u and
y_k = C_k x + D_k u, and the response to a change Phi alpha of the commands is

    X_0 = 0,    X_{k+1} = A_k X_k + B_k Phi_k,    S_k = C_k X_k + D_k Phi_k.

Its cost is that of the tangent, which no basis enters, and of one small product per sample: it hardly
depends on how many columns there are.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def propagate(
    slopes: Floats, Phi: Floats, rows: NDArray[np.int64], start: Floats | None = None
) -> Floats:
    """Return S, (r, H, m), of the columns Phi.

    Parameters
    ----------
    slopes : (H, n + p, n + 4)
        [A_k B_k; C_k D_k] for n states and p outputs.
    Phi : (4, H, m)
        The columns.
    rows : (r,)
        Which outputs.
    start : (n, m), optional
        X_0 in place of 0: the columns also move the state at the start.
    """
    channels, H, m = Phi.shape
    n = slopes.shape[2] - channels
    moved = np.zeros((n + channels, m))  # X_k over Phi_k
    if start is not None:
        moved[:n] = start
    changed = np.empty((slopes.shape[1], m))  # X_{k+1} over S_k
    S = np.empty((len(rows), H, m))
    for k in range(H):
        moved[n:] = Phi[:, k]
        np.dot(slopes[k], moved, out=changed)
        moved[:n] = changed[:n]
        S[:, k] = changed[n + rows]
    return S
