"""One pass of the control-basis-function optimisation: linearise, solve, search the line.

Everything here is a pure function of the state, the nominal command and the reference.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from controller import qp
from controller.prediction import (
    Floats,
    Identification,
    PredictionModel,
    Response,
    identify,
)
from controller.reference import Path
from controller.solvers import Solution, solve_with_fallback
from controller.terrain_map import TerrainMap, heights
from controller.tracking import Targets, Weights, costs, targets

TRACKED = ("north", "east", "altitude", "heading", "speed", "roll", "pitch")
ACTUATORS = ("actuator_thrust", "actuator_pitch", "actuator_roll", "actuator_tail")
VELOCITY = ("velocity_north", "velocity_east", "velocity_down")
STEPS = (1.0, 0.5, 0.25, 0.1)
"""Step lengths tried besides 0, which is the shifted plan itself."""
ATTITUDE_EVERY = 4  # samples between rows of attitude, heading and clearance


@dataclass(frozen=True)
class Design:
    """What stays the same from update to update, for one horizon.

    Attributes
    ----------
    model : PredictionModel
    Phi : ndarray, shape (4, H, m)
        Orthonormal basis columns of every channel.
    amplitude : ndarray, shape (4,)
        Perturbations for the identification.
    wind : ndarray, shape (3,)
        Known steady wind, m/s, NED.
    backend : str
        Solver of the quadratic programme.
    line_search : bool
        False takes the full step (it departs: for studies only).
    steps : tuple of float
        Lengths that the search tries besides 0.
    identification : {"rollouts", "recursion"}
        How S is found, :func:`controller.prediction.identify`.
    """

    model: PredictionModel
    Phi: Floats
    amplitude: Floats
    wind: Floats
    backend: str = "daqp"
    line_search: bool = True
    steps: tuple[float, ...] = STEPS
    identification: Identification = "rollouts"

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """Rows of the tracked outputs and the actuators among the model's outputs."""
        return np.array([self.model.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])


@dataclass(frozen=True)
class Aim:
    """What one update wants: the reference, and the trims that R and Rc pull to.

    Commands are held within ``reach`` (4,) of the ``commands`` (4, H) that Rc pulls to; infinite
    where only the model's own limits hold. ``height`` above ground is wanted, m. ``elapsed`` s ago, at
    the last update, the planner left ``carry`` in its :class:`Pass`.
    """

    path: Path
    near: float
    heading: float
    actuators: Floats
    commands: Floats
    reach: Floats
    weights: Weights
    terrain_map: TerrainMap
    height: float = 10.0
    elapsed: float = 0.0
    carry: Floats | None = None


@dataclass(frozen=True)
class Pass:
    """Outcome of one pass.

    ``u`` (H, 4) and its rollout ``Y`` (p, H); costs before and after and as the linear model promised;
    ``step`` the accepted length; ``solution`` of the quadratic programme, None if there was none;
    ``carry`` what the planner wants to be given at the next update.
    """

    u: Floats
    Y: Floats
    before: float
    after: float
    linear: float
    step: float
    slack: float
    valid: bool
    solution: Solution | None
    carry: Floats | None = None


class Improve(Protocol):
    """What turns a nominal command into a better one: a planner, ready for one horizon."""

    def __call__(self, state: Floats, u0: Floats, bias: Floats, aim: Aim, /) -> Pass:
        """Return the plan from a state (n,) that improves on ``u0`` (H, 4); see :func:`optimise`."""
        ...


def quadratic_programme(
    response: Response,
    rows: NDArray[np.int64],
    u0: Floats,
    aim: Aim,
    target: Targets,
    model: PredictionModel,
) -> qp.QPData:
    """Assemble eq. 7 with its limits from an identified response.

    Hard: actuators at every sample; attitude, heading deviation and the commands' reach at every
    fourth. Soft: clearance.
    """
    weights = aim.weights
    y0, S = response.nominal[rows], response.S
    station = target.tangent_north[:, None] * S[0] + target.tangent_east[:, None] * S[1]
    tracked = S[0], S[1], S[2] - target.slope[:, None] * station, S[3], S[4]
    wanted = target.north, target.east, target.altitude, target.heading, target.speed
    off, held = u0.T - aim.commands, np.isfinite(aim.reach)
    terms = [
        *map(qp.Term, tracked, y0[:5] - wanted, weights.Q),
        *map(qp.Term, S[7:], y0[7:] - aim.actuators[:, None], weights.R),
        *map(qp.Term, response.Phi, off, weights.Rc),
    ]
    hard = [
        qp.bounds(S[7:], y0[7:], model.actuator_min, model.actuator_max),
        qp.bounds(S[5:7], y0[5:7], -weights.attitude_limit, weights.attitude_limit, ATTITUDE_EVERY),
        qp.bounds(
            S[3:4],
            y0[3:4] - target.heading,
            -weights.heading_limit,
            weights.heading_limit,
            ATTITUDE_EVERY,
        ),
        qp.bounds(response.Phi[held], off[held], -aim.reach[held], aim.reach[held], ATTITUDE_EVERY),
    ]
    chosen = slice(ATTITUDE_EVERY - 1, None, ATTITUDE_EVERY)
    h, h_n, h_e = heights(aim.terrain_map, y0[0, chosen], y0[1, chosen])
    seen = np.isfinite(h)
    soft = qp.clearance(
        S[:3, chosen][:, seen], (y0[2, chosen] - h)[seen], h_n[seen], h_e[seen], weights.clearance
    )
    return qp.assemble(terms, hard, soft, rho1=weights.rho1, rho2=weights.rho2)


def optimise(design: Design, state: Floats, u0: Floats, bias: Floats, aim: Aim) -> Pass:
    """Improve a nominal command by one linearise-solve-search pass.

    The accepted merit is never above that of ``u0``: the length 0 is among the candidates.

    Parameters
    ----------
    state : (n,)
        Where the plan starts.
    u0 : (H, 4)
        Nominal command: the shifted plan.
    bias : (3,)
        Acceleration bias, m/s2, NED.
    """
    model, rows = design.model, design.rows
    response = identify(model, state, u0, design.Phi, design.amplitude, design.wind, bias, rows,
                        by=design.identification)  # fmt: skip
    Y0 = response.nominal
    if not response.valid:
        return Pass(u0, Y0, np.inf, np.inf, np.inf, 0.0, 0.0, False, None)
    period = model.sample_period
    target = targets(aim.path, Y0[rows[0]], Y0[rows[1]], aim.near, period, aim.heading)
    data = quadratic_programme(response, rows, u0, aim, target, model)
    solution = solve_with_fallback(data, design.backend)
    found = search(design, state, u0, (response.Phi @ solution.alpha).T, bias, aim, target)
    return replace(found, linear=qp.predicted_cost(data, solution.alpha), solution=solution)


def search(
    design: Design,
    state: Floats,
    u0: Floats,
    change: Floats,
    bias: Floats,
    aim: Aim,
    target: Targets,
) -> Pass:
    """Return the best of ``u0`` plus some lengths of a change (H, 4), on the nonlinear model."""
    model, rows = design.model, design.rows
    # the shifted plan comes first, as it is: what gains nothing is no step
    lengths = np.array([0.0, *(design.steps if design.line_search else (1.0,))])
    low = np.maximum(model.command_min, aim.commands.T - aim.reach)
    high = np.minimum(model.command_max, aim.commands.T + aim.reach)
    flown = np.clip(u0 + lengths[:, None, None] * change, np.minimum(low, u0), np.maximum(high, u0))
    rollout = model.rollout(state, flown, design.wind, bias)
    Y = rollout.outputs.transpose(2, 1, 0)
    _, slack, merit = costs(Y, rows, flown, target, aim.actuators, aim.commands, aim.path,
                            aim.weights, aim.terrain_map, ATTITUDE_EVERY)  # fmt: skip
    merit[~(rollout.valid & np.isfinite(merit))] = np.inf
    best = int(np.argmin(merit)) if design.line_search else 1
    return Pass(
        u=flown[best],
        Y=np.ascontiguousarray(Y[:, :, best]),
        before=float(merit[0]),
        after=float(merit[best]),
        linear=float(merit[best]),
        step=float(lengths[best]),
        slack=float(slack[best]),
        valid=bool(np.isfinite(merit[best])),
        solution=None,
    )
