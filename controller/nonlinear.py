"""Direct nonlinear model predictive control: the optimum itself, at seconds of computing per update.

A baseline for :mod:`controller.optimise`, behind the same component. Multiple shooting starts from the
shifted plan; its answer is a change of that plan, whose length is searched on the rollouts like any
other's. So a search that was cut short still counts, and one that failed leaves the shifted plan.
"""

import numpy as np
from numpy.typing import NDArray

from controller.mpc import Mpc
from controller.optimise import Aim, Design, Improve, Pass, search
from controller.parameters import MpcParameters
from controller.prediction import PredictionModel
from controller.shooting import Goal, shooter
from controller.tracking import Targets, targets

Floats = NDArray[np.float64]
ITERATIONS = 10
"""Of the interior-point method, at most. From a shifted plan five of them, without the curvature of the
dynamics, already fly as thirty exact ones do, at a fifth of the time."""


def NonlinearMpc(
    parameters: MpcParameters, *, prediction_model: PredictionModel, latency_s: float = 0.0
) -> Mpc:
    """Model predictive control by multiple shooting with IPOPT (extra ``paper``).

    Of the parameters, the basis, its identification, ``solver`` and ``line_search`` are not needed.
    Clearance is not a row of the problem, only of the merit: the reference keeps it. Ground effect
    is not predicted. Other errors as of :class:`controller.mpc.Mpc`.

    Raises
    ------
    ValueError
        If CasADi is missing or the prediction model has no symbolic form.
    """
    return Mpc(
        parameters,
        prediction_model=prediction_model,
        planner=nonlinear_planner,
        latency_s=latency_s,
        name="NonlinearMpc",
        meaning="model predictive control by direct multiple shooting",
    )


def nonlinear_planner(p: MpcParameters, model: PredictionModel, horizon: int) -> Improve:
    """Return the improvement of a plan by multiple shooting over H samples."""
    shoot = shooter(model, horizon, hessian="gauss_newton", iterations=ITERATIONS, tolerance=1e-3)
    without_basis = Design(
        model=model,
        Phi=np.zeros((4, horizon, 0)),
        amplitude=np.ones(4),
        wind=np.array(p.wind_mps),
    )

    def improve(state: Floats, u0: Floats, bias: Floats, aim: Aim, /) -> Pass:
        nominal = model.rollout(state, u0[None], without_basis.wind, bias)
        Y0 = np.ascontiguousarray(nominal.outputs[0].T)
        if not (nominal.valid[0] and np.isfinite(Y0).all()):
            return Pass(u0, Y0, np.inf, np.inf, np.inf, 0.0, 0.0, False, None)
        north, east = (Y0[row] for row in without_basis.rows[:2])
        target = targets(aim.path, north, east, aim.near, model.sample_period, aim.heading)
        shot = shoot(state, u0, _goal(aim, target), wind=without_basis.wind, bias=bias)
        change = shot.u - u0 if np.isfinite(shot.u).all() else np.zeros_like(u0)
        return search(without_basis, state, u0, change, bias, aim, target)

    return improve


def _goal(aim: Aim, target: Targets) -> Goal:
    weights = aim.weights
    return Goal(
        **{name: getattr(target, name) for name in Goal._fields if name in Targets._fields},
        actuators=aim.actuators,
        commands=aim.commands,
        Q=weights.Q,
        R=weights.R,
        Rc=weights.Rc,
        attitude_limit=weights.attitude_limit,
        heading_limit=weights.heading_limit,
        reach=aim.reach,
    )
