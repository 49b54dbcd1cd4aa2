"""The nonlinear programme of multiple shooting: unknowns and rows stage by stage, block banded.

    z_k = (x_k, u_k),  k < H;   x_H
    rows of stage k:  x_{k+1} = advance(z_k);  x_0 = start;  limits at node k and of z_k

fatrop asks for that order, and IPOPT's sparse factors do not mind. One sample is differentiated and
mapped over the horizon. CasADi could differentiate the whole by itself (0.74 s per iteration of 200
samples instead of 0.56), but then the curvature of the dynamics could not be left out (0.20 s).
"""

# pyright: basic
# CasADi has no types

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.shooting_sample import COMMON, PER_SAMPLE, Sample, casadi

Floats = NDArray[np.float64]
Solver = Literal["ipopt", "fatrop"]


class Layout(NamedTuple):
    """Where unknowns and rows are: stage by stage, which fatrop asks for and all profit from."""

    H: int
    n: int
    m: int
    path: int  # rows on a stage's own state and command

    def unknowns(self, X: Floats, u: Floats) -> Floats:
        """Return (X, u) as one vector."""
        return np.concatenate([np.hstack([X[:-1], u]).ravel(), X[-1]])

    def nodes(self, w: Floats) -> tuple[Floats, Floats]:
        """Return (X, u) of a vector."""
        z = w[: -self.n].reshape(self.H, -1)
        return np.vstack([z[:, : self.n], w[-self.n :]]), z[:, self.n :].copy()

    @property
    def path_rows(self) -> list[int]:
        """Return how many rows each of the H + 1 stages has besides its gap."""
        return [self.n + self.path, *[3 + self.path] * (self.H - 1), 3]

    @property
    def numbers(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows' numbers: gaps (H, n), start (n,), limits (H, 3 + path)."""
        path = np.array(self.path_rows)
        first = np.cumsum([0, *(self.n + path[:-1])])  # of each stage; the last has no gap
        gaps = first[: self.H, None] + np.arange(self.n)
        tilt = first[1:, None] + self.n + np.arange(3)
        tilt[-1] -= self.n
        last = (first + self.n + path)[: self.H, None]
        actuators = last - self.path + np.arange(self.path)
        return gaps, self.n + np.arange(self.n), np.hstack([tilt, actuators])

    def rows(self, start: Floats, limits: Floats) -> Floats:
        """Return all rows' values or bounds from those of the limits, (3 + path, H)."""
        gaps, begin, at = self.numbers
        out = np.zeros(gaps.size + begin.size + at.size)
        out[begin], out[at] = start, limits.T
        return out


def programme(
    sample: Sample, layout: Layout, solver: Solver, iterations: int, tolerance: float
) -> Any:
    """Return the solver as a CasADi function, with derivatives put together from the samples'."""
    ca = casadi()
    H, n, m = layout.H, layout.n, layout.m
    w = ca.MX.sym("x", H * (n + m) + n)
    p = ca.MX.sym("p", H * PER_SAMPLE + COMMON)
    z = ca.reshape(w[: H * (n + m)], n + m, H)
    x, u, end = z[:n, :], z[n:, :], ca.horzcat(z[:n, 1:], w[H * (n + m) :])
    goal, common = ca.reshape(p[: H * PER_SAMPLE], PER_SAMPLE, H), p[H * PER_SAMPLE :]
    gaps, start, limits = layout.numbers
    of_z = (n + m) * np.arange(H)[:, None] + np.arange(n + m)
    of_end = of_z[:, :n] + n + m

    f = ca.sum2(sample.cost.map(H)(x, u, end, goal, common))
    reached = sample.advance.map(H)(x, u, common[17:20], common[20:23])
    stacked = ca.vertcat(ca.vec(end - reached), x[:, 0], ca.vec(sample.rows.map(H)(x, u, end)))
    order = np.argsort(np.concatenate([gaps.ravel(), start, limits.ravel()]))
    g = stacked[order.tolist()]

    by_z, rows_by_z, rows_by_end = sample.slopes.map(H)(x, u, end, common)
    eye = ca.MX.eye(n)
    jacobian = _placed(ca, g.numel(), w.numel(), [
        (-by_z, gaps, of_z),
        (ca.repmat(eye, 1, H), gaps, of_end),
        (eye, start[None], of_z[:1, :n]),
        (rows_by_z, limits, of_z),
        (rows_by_end, limits, of_end),
    ])  # fmt: skip

    weight, on = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    on_gaps = ca.reshape(on[gaps.ravel().tolist()], n, H)
    on_limits = ca.reshape(on[limits.ravel().tolist()], limits.shape[1], H)
    by_z, by_end = sample.curvature.map(H)(x, u, end, goal, common, weight, on_gaps, on_limits)
    triangle = _placed(ca, w.numel(), w.numel(), [(by_z, of_z, of_z)]) + _placed(
        ca, w.numel(), w.numel(), [(by_end, of_end, of_end)]
    )
    if solver == "ipopt":
        hessian = [triangle], ["triu_hess_gamma_x_x"]
        options = {
            "ipopt": {
                "max_iter": iterations,
                "tol": tolerance,
                "constr_viol_tol": 1e-3 * tolerance,
                "bound_relax_factor": 0.0,
                "linear_solver": "mumps",
                "mu_strategy": "adaptive",
                "print_level": 0,
                "sb": "yes",
            }
        }
    else:
        gradient = ca.gradient(weight * f, w) + jacobian.T @ on
        hessian = [gradient, ca.triu2symm(triangle)], ["grad_gamma_x", "hess_gamma_x_x"]
        options = {
            "structure_detection": "manual",
            "N": H,
            "nx": [n] * (H + 1),
            "nu": [m] * H + [0],
            "ng": layout.path_rows,
            "fatrop": {"max_iter": iterations, "tol": tolerance, "print_level": 0},
        }
    derivatives = {
        "nlp_jac_g": ca.Function("nlp_jac_g", [w, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "nlp_hess_l": ca.Function(
            "nlp_hess_l", [w, p, weight, on], hessian[0], ["x", "p", "lam_f", "lam_g"], hessian[1]
        ),
    }
    problem = {"x": w, "p": p, "f": f, "g": g}
    return ca.nlpsol(
        "shoot", solver, problem, {**options, "cache": derivatives, "print_time": False}
    )


def _placed(
    ca: Any, height: int, width: int, pieces: Sequence[tuple[Any, NDArray[Any], NDArray[Any]]]
) -> Any:
    """Return a sparse matrix of blocks side by side, given the row and column numbers of each.

    A piece is (r, c K) with rows (K, r) and columns (K, c).
    """
    values, rows, columns = [], [], []
    for block, row, column in pieces:
        i, j = (np.array(part, dtype=np.int64) for part in block.sparsity().get_triplet())
        k, j = np.divmod(j, column.shape[1])
        values.append(ca.MX(block.nz[:]))
        rows.append(row[k, i])
        columns.append(column[k, j])
    row, column = np.concatenate(rows), np.concatenate(columns)
    order = np.lexsort((row, column))
    pattern = ca.Sparsity.triplet(height, width, row[order].tolist(), column[order].tolist())
    return ca.MX(pattern, ca.vertcat(*values)[order.tolist()])
