r"""One horizon of eq. 2.1: what the optimisers of the study are all given.

    J(u) = sum over k of |y_{k+1} - r_{k+1}|^2_Q + |a_k - a_trim|^2_R + |u_k - u_trim|^2_Rc

with outputs y = north, east, altitude, heading, speed at the *end* of a sample, actuators a at its
start and commands u. Here, as in the paper, the reference is a function of time; the controller that
flies compares with a path in space (:mod:`controller.tracking`). Departure: R acts on the deviation
from trim; with ``actuators=0`` it acts on the actuators themselves, as the paper writes.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from controller import qp
from controller.optimise import ACTUATORS, ATTITUDE_EVERY, TRACKED
from controller.parameters import MpcParameters, design
from controller.prediction import PredictionModel, Response, identify
from plant.prediction import HelicopterModel, ModelParameters
from plant.r50 import Preset

Floats = NDArray[np.float64]
Form = Literal["attitude", "actuator"]
Five = tuple[float, float, float, float, float]
Four = tuple[float, float, float, float]

SMALL_R: Four = (0.1, 1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Problem:
    """One horizon of H samples.

    Hard limits are the model's bounds of commands and actuators, and ``attitude_limit``.

    Attributes
    ----------
    model : PredictionModel
    state : ndarray, shape (17,)
        Start.
    u0 : ndarray, shape (H, 4)
        Where optimisers start: trim.
    reference : ndarray, shape (5, H)
        North, east, altitude (m), heading (rad), speed (m/s) at the ends of the samples.
    Q, R, Rc : tuples of 5, 4, 4
        Weights per sample of outputs, actuators and commands.
    actuators : ndarray, shape (4,)
        What R pulls to.
    commands : ndarray, shape (4, H)
        What Rc pulls to.
    wind, bias : ndarray, shape (3,)
        Air velocity, m/s, and unmodelled acceleration, m/s2; NED.
    attitude_limit : float
        Of roll and pitch, rad.
    """

    model: PredictionModel
    state: Floats
    u0: Floats
    reference: Floats
    Q: Five
    R: Four
    Rc: Four
    actuators: Floats
    commands: Floats
    wind: Floats
    bias: Floats
    attitude_limit: float = float(np.radians(50.0))

    @property
    def horizon(self) -> int:
        """Return H."""
        return len(self.u0)

    @property
    def form(self) -> Form:
        """Return what the commands are: actuators, or set-points of the attitude stabiliser."""
        return "attitude" if "heading" in self.model.commands else "actuator"

    @property
    def rows(self) -> NDArray[np.int64]:
        """Return the rows of the outputs, roll, pitch and the actuators among the model's outputs."""
        return np.array([self.model.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])

    @property
    def amplitude(self) -> Floats:
        """Return the controller's own perturbations for an identification, (4,)."""
        return design(MpcParameters(), self.model, self.horizon).amplitude


def level_flight(
    *,
    form: Form = "attitude",
    horizon: int = 200,
    speed_mps: float = 30.0,
    Q: Five = (1.0, 1.0, 1.0, 1.0, 1.0),
    R: Four = SMALL_R,
    preset: Preset = "r50",
) -> Problem:
    """Return the problem of going on in level flight north, whose minimum is trim."""
    model: Any = HelicopterModel(ModelParameters(preset=preset, command=form))
    state, command, actuators = model.trim(speed_mps)
    still = np.zeros(horizon)
    time = model.sample_period * np.arange(1, horizon + 1)
    ahead: Floats = np.stack([speed_mps * time, still, still, still, still + speed_mps])
    return Problem(
        model=model,
        state=state,
        u0=np.tile(command, (horizon, 1)),
        reference=ahead,
        Q=Q,
        R=R,
        Rc=(0.0, 0.1, 0.1, 0.1) if form == "attitude" else (0.0, 0.0, 0.0, 0.0),
        actuators=actuators,
        commands=np.tile(command[:, None], horizon),
        wind=np.zeros(3),
        bias=np.zeros(3),
    )


def altitude_step(*, height_m: float = 10.0, at_s: float = 3.0, **level: Any) -> Problem:
    """Return the paper's worst case: level flight and a step in altitude, known in advance.

    Parameters
    ----------
    height_m : float
        Of the step, up.
    at_s : float
        From when on, s.
    **level
        As :func:`level_flight`.
    """
    problem = level_flight(**level)
    reference = problem.reference.copy()
    ends = np.arange(1, problem.horizon + 1)
    reference[2, ends >= round(at_s / problem.model.sample_period)] = height_m
    return replace(problem, reference=reference)


def rolling_height(x: NDArray[Any]) -> NDArray[Any]:
    """Return the elevation, m, of smooth rolling terrain with a hill and a ledge, at x m along it."""
    hill = 10.0 * np.exp(-(((x - 520.0) / 80.0) ** 2))
    ledge = 8.0 / (1.0 + np.exp(-(x - 250.0) / 20.0))
    return 5.0 * np.sin(x / 90.0) + 1.5 * np.sin(x / 41.0 + 1.0) + hill + ledge


def terrain(
    *,
    along_m: float = 0.0,
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    speed_mps: float = 30.0,
    **level: Any,
) -> Problem:
    """Return terrain following: a winding course 10 m above :func:`rolling_height`.

    Parameters
    ----------
    along_m : float
        Where along the terrain the horizon begins, m.
    offset_m : tuple of 3
        Start's deviation north, east and up from the reference, m; it flies north and level.
    speed_mps : float
        Of the reference, along north.
    **level
        As :func:`level_flight`.
    """
    problem = level_flight(speed_mps=speed_mps, **level)
    time = problem.model.sample_period * np.arange(problem.horizon + 1)
    x = along_m + speed_mps * time
    path = np.stack(
        [
            speed_mps * time,
            8.0 * np.sin(x / 120.0),
            rolling_height(x) + 10.0,
            np.arctan(8.0 / 120.0 * np.cos(x / 120.0)),
            np.full(x.size, speed_mps),
        ]
    )
    state = problem.state.copy()
    state[:3] = (path[:3, 0] + offset_m) * (1.0, 1.0, -1.0)
    return replace(problem, state=state, reference=path[:, 1:])


def respond(
    problem: Problem, Phi: Floats, u0: Floats | None = None, amplitude: Floats | None = None
) -> Response:
    """Return the response to columns Phi (4, H, m) about u0 (H, 4).

    ``S`` has the rows of :attr:`Problem.rows`; ``nominal`` all of the model's outputs. It is by
    rollouts if the perturbations' ``amplitude`` (4,) is given, else exact, by recursion.
    """
    return identify(
        problem.model,
        problem.state,
        problem.u0 if u0 is None else u0,
        Phi,
        problem.amplitude if amplitude is None else amplitude,
        problem.wind,
        problem.bias,
        problem.rows,
        by="recursion" if amplitude is None else "rollouts",
    )


def costs(problem: Problem, u: Floats) -> Floats:
    """Return the true J, (N,), of commands (N, H, 4) by rollouts; infinite where one is invalid."""
    rollout = problem.model.rollout(problem.state, u, problem.wind, problem.bias)
    Y = rollout.outputs[:, :, problem.rows]
    J = np.square(Y[:, :, :5] - problem.reference.T) @ problem.Q
    J += np.square(Y[:, :, 7:] - problem.actuators) @ problem.R
    J += np.square(u - problem.commands.T) @ problem.Rc
    total = J.sum(axis=1)
    return np.where(rollout.valid & np.isfinite(total), total, np.inf)


def quadratic_programme(problem: Problem, response: Response, u0: Floats) -> qp.QPData:
    """Assemble eq. 7 with its limits from a response about u0 (H, 4).

    Hard: commands and actuators at every sample, attitude at every fourth.
    """
    model = problem.model
    y0, S, Phi = response.nominal[problem.rows], response.S, response.Phi
    terms = [
        *map(qp.Term, S[:5], y0[:5] - problem.reference, problem.Q),
        *map(qp.Term, S[7:], y0[7:] - problem.actuators[:, None], problem.R),
        *map(qp.Term, Phi, u0.T - problem.commands, problem.Rc),
    ]
    limit = problem.attitude_limit
    bounded = np.isfinite(model.command_max)
    hard = [
        qp.bounds(
            Phi[bounded], u0.T[bounded], model.command_min[bounded], model.command_max[bounded]
        ),
        qp.bounds(S[5:7], y0[5:7], -limit, limit, ATTITUDE_EVERY),
    ]
    # a command that is an actuator is bounded as a command: where it is clipped the actuator's S is 0
    if problem.form == "attitude":
        hard.append(qp.bounds(S[8:], y0[8:], model.actuator_min[1:], model.actuator_max[1:]))
    return qp.assemble(terms, hard)


def goal_of(problem: Problem) -> Any:
    """Return the problem as :class:`controller.shooting.Goal`, for the true optimum."""
    from controller.shooting import Goal

    H = problem.horizon
    north, east, altitude, heading, speed = problem.reference
    return Goal(
        north=north,
        east=east,
        altitude=altitude,
        slope=np.zeros(H),
        tangent_north=np.zeros(H),
        tangent_east=np.zeros(H),
        nominal_north=np.zeros(H),
        nominal_east=np.zeros(H),
        heading=heading,
        speed=speed,
        actuators=problem.actuators,
        commands=problem.commands,
        Q=problem.Q,
        R=problem.R,
        Rc=problem.Rc,
        attitude_limit=problem.attitude_limit,
        heading_limit=np.inf,
        reach=np.full(4, np.inf),
    )
