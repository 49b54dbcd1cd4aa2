"""LQ preview control: one linear model at trim, one law, and the reference ahead fed forward.

The textbook's answer without optimising again and again. About level flight at the design speed a
sample of the prediction model is ``x+ = A x + B u + d``, ``z = E x + F u``, found once by central
differences; z are the tracked outputs, the actuators and the commands. The sum of W (z - target)^2 is
least for ``u = K x + k``: K from a backward Riccati recursion, once; k from a backward recursion of
vectors over the previewed targets and the known disturbances, at every update (B. D. O. Anderson and
J. B. Moore, Optimal Control: Linear Quadratic Methods, 1990).

All is seen from the course, unrolled: along, across, and headings relative to its own, whose turning is
a disturbance that is known ahead. There are no constraints but the commands' limits, at which the law
is clipped, no linearisation where the aircraft is, and no search of the line.

Departure: W is the MPC's but for :data:`CAUTION`. With the weights as they are the law of level flight
does not hold a climb: on a slope of 0.15 its eigenvalues are up to 1.09 per sample.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from controller.jit import kernel
from controller.mpc import Mpc
from controller.optimise import ACTUATORS, ATTITUDE_EVERY, TRACKED, Aim, Improve, Pass
from controller.parameters import MpcParameters
from controller.prediction import Floats, PredictionModel
from controller.tracking import Targets, Weights, advance, costs, targets

STEP = 1e-4  # of the central differences, in every unit
CAUTION = 1000.0
"""How many times the MPC's weight pitch, roll and tail or heading have, actuators and set-points."""


def PreviewLq(
    parameters: MpcParameters, *, prediction_model: PredictionModel, latency_s: float = 0.0
) -> Mpc:
    """LQ preview control behind the interface of :class:`controller.mpc.Mpc`.

    It ignores the parameters of bases, solver, line search, clearance and attitude limits. The weights
    of north and east count along and across the course, half their sum each; a speed set in flight
    moves the reference, not the trim of the model.

    Raises
    ------
    ValueError
        Of :class:`~controller.mpc.Mpc` and :func:`linearise`.
    """
    return Mpc(
        parameters,
        prediction_model=prediction_model,
        planner=preview_planner,
        latency_s=latency_s,
        name="PreviewLq",
        meaning="LQ preview control about trim",
    )


class Linear(NamedTuple):
    """One sample about level flight north: ``state`` (n,) under ``command`` (4,).

    It adds ``moved`` (n,) to that state and gives ``outputs`` (9,): north, east, altitude, heading,
    speed and the actuators. Deviations follow x+ = A x + B u, z = E x + F u with z (13,) the outputs
    and the commands.
    """

    state: Floats
    command: Floats
    moved: Floats
    outputs: Floats
    A: Floats
    B: Floats
    E: Floats
    F: Floats


class Law(NamedTuple):
    """u = K x + k over H samples: gains K (H, 4, n), and what finds k.

    G (H, 4, 4) are the inverse Hessians of the command, P (H, n, n) the costs to go after the sample.
    """

    K: Floats
    G: Floats
    P: Floats


class Ahead(NamedTuple):
    """What lies ahead: deviations from trim along the unrolled course.

    The state ``start`` (n,), targets (H, 13) of z, disturbances ``d`` (H, n) of the state, and ``trim``
    (H, 4), the commands that all is a deviation from.
    """

    start: Floats
    target: Floats
    d: Floats
    trim: Floats


def linearise(model: PredictionModel, speed: float) -> Linear:
    """Return one sample of the model about its trim at ``speed`` m/s, by central differences.

    Raises
    ------
    ValueError
        If a sample does not leave the model in its trim: it takes no measured state, or not the one
        that it returns.
    """
    state, command, _ = model.trim(speed)
    n = len(state)
    change = STEP * np.vstack([np.zeros(n + 4), np.eye(n + 4), -np.eye(n + 4)])
    x, u = state + change[:, :n], command + change[:, n:]
    rollout = model.rollout(x, u[:, None], np.zeros(3), np.zeros(3))
    moved = np.where(np.array(model.states) == "north", speed * model.sample_period, 0.0)
    drift = float(np.max(np.abs(rollout.last[0] - state - moved)))
    if not drift < 1e-6 or getattr(model, "follow", None) is not None:
        raise ValueError(
            f"preview: no linear model, got a trim that one sample changes by {drift:.2g}, expected"
            " a prediction model that starts from the state it is given and returns such states"
        )
    outputs = rollout.outputs[:, 0, _rows(model)]
    found = np.hstack([rollout.last, outputs, u])
    slopes = (found[1 : n + 5] - found[n + 5 :]).T / (2.0 * STEP)
    blocks = slopes[:n, :n], slopes[:n, n:], slopes[n:, :n], slopes[n:, n:]
    return Linear(state, command, moved, outputs[0], *map(np.ascontiguousarray, blocks))


def riccati(linear: Linear, W: Floats, horizon: int) -> Law:
    """Return the law of least cost over a horizon of H samples, W (13,) on the squares of z."""
    A, B, E, F = linear.A, linear.B, linear.E, linear.F
    n = len(A)
    law = Law(np.empty((horizon, 4, n)), np.empty((horizon, 4, 4)), np.empty((horizon, n, n)))
    WE, WF = W[:, None] * E, W[:, None] * F
    P = np.zeros((n, n))
    for i in reversed(range(horizon)):
        law.P[i] = P
        PB = P @ B
        law.G[i] = np.linalg.inv(F.T @ WF + B.T @ PB)
        cross = WF.T @ E + PB.T @ A
        law.K[i] = -law.G[i] @ cross
        P = E.T @ WE + A.T @ P @ A + cross.T @ law.K[i]
        P = 0.5 * (P + P.T)  # or its rounding would grow
    return law


@kernel
def feed_forward(linear: Linear, law: Law, W: Floats, target: Floats, d: Floats) -> Floats:
    """Return k (H, 4) of the law for targets (H, 13) of z and disturbances d (H, n) of the state."""
    k = np.empty((target.shape[0], 4))
    of_state, of_command = (target * W) @ linear.E, (target * W) @ linear.F
    p = np.zeros(d.shape[1])  # half the gradient of the cost to go
    for i in range(target.shape[0] - 1, -1, -1):
        p = p + law.P[i] @ d[i]
        g = p @ linear.B - of_command[i]
        k[i] = -(law.G[i] @ g)
        p = p @ linear.A - of_state[i] + g @ law.K[i]
    return k


@kernel
def predict(
    linear: Linear, law: Law, W: Floats, ahead: Ahead, low: Floats, high: Floats
) -> tuple[Floats, float]:
    """Return the commands (H, 4) of the law on the linear model, within limits, and their cost."""
    u = feed_forward(linear, law, W, ahead.target, ahead.d)
    x, J = ahead.start, 0.0
    for i in range(u.shape[0]):
        wanted = ahead.trim[i] + u[i] + law.K[i] @ x
        u[i] = np.minimum(np.maximum(wanted, low[i]), high[i])
        v = u[i] - ahead.trim[i]
        miss = linear.E @ x + linear.F @ v - ahead.target[i]
        J += np.sum(W * miss * miss)
        x = linear.A @ x + linear.B @ v + ahead.d[i]
    return u, J


def look_ahead(
    model: PredictionModel,
    linear: Linear,
    state: Floats,
    now: Targets,
    wind: Floats,
    bias: Floats,
    aim: Aim,
) -> Ahead:
    """Return what lies ahead of a state (n,); ``now`` are the targets (H + 1,) from there on."""
    horizon = len(now.heading) - 1
    north, east, down, psi = (model.states.index(x) for x in ("north", "east", "down", "psi"))
    turn = np.diff(now.heading)
    aside = 0.5 * turn * linear.moved[north]  # of the course from its tangent
    c, s = np.cos(now.heading[0]), np.sin(now.heading[0])
    to_course = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    pushed = model.rollout(
        linear.state, linear.command[None, None], to_course @ wind, to_course @ bias
    )
    start = state - linear.state
    start[[north, east]] = to_course[:2, :2] @ (
        state[[north, east]] - np.array([now.north[0], now.east[0]])
    )
    start[down], start[psi] = 0.0, state[psi] - now.heading[0]
    d = np.tile(pushed.last[0] - linear.state - linear.moved, (horizon, 1))
    d[:, east] -= aside
    d[:, psi] -= turn
    trim = np.tile(linear.command, (horizon, 1))
    if "heading" in model.commands:
        trim[:, 3] += now.heading[:-1]
    station = advance(aim.path, now.station[0], model.sample_period, horizon)
    wanted = (
        station - now.station[0] - linear.moved[north] * np.arange(horizon),
        aside,
        now.altitude[1:] + state[down],
        turn,
        now.speed[1:],
        *np.tile(aim.actuators[:, None], horizon),
    )
    outputs = np.stack(wanted, axis=1) - pushed.outputs[0, 0, _rows(model)]
    return Ahead(start, np.hstack([outputs, aim.commands.T - trim]), d, trim)


def preview_planner(p: MpcParameters, model: PredictionModel, horizon: int) -> Improve:
    """Return how LQ preview control plans a horizon of H samples; ``u0`` only places its targets.

    The altitude to come is that of the path where the aircraft will be under ``u0``, as in
    :func:`controller.tracking.targets`; that it would follow a change of the plan is neglected.

    Raises
    ------
    ValueError
        Of :func:`linearise`.
    """
    linear, wind = linearise(model, p.speed_mps), np.array(p.wind_mps)
    rows = np.array([model.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])

    @cache
    def law_for(weights: Weights) -> tuple[Floats, Law]:
        W = weighing(weights)
        return W, riccati(linear, W, horizon)

    def plan(state: Floats, u0: Floats, bias: Floats, aim: Aim) -> Pass:
        nominal = model.rollout(state, u0[None], wind, bias)
        Y0 = np.ascontiguousarray(nominal.outputs[0].T)
        if not nominal.valid[0]:
            return Pass(u0, Y0, np.inf, np.inf, np.inf, 0.0, 0.0, False, None)
        north, east = (
            np.concatenate([state[[model.states.index(axis)]], Y0[model.outputs.index(axis)]])
            for axis in ("north", "east")
        )
        now = targets(aim.path, north, east, aim.near, model.sample_period, aim.heading)
        ahead = look_ahead(model, linear, state, now, wind, bias, aim)
        low = np.maximum(model.command_min, aim.commands.T - aim.reach)
        high = np.minimum(model.command_max, aim.commands.T + aim.reach)
        W, law = law_for(aim.weights)
        u, linear_cost = predict(linear, law, W, ahead, low, high)
        flown = np.stack([u0, u])
        rollout = model.rollout(state, flown, wind, bias)
        Y = rollout.outputs.transpose(2, 1, 0)
        _, slack, merit = costs(Y, rows, flown, Targets(*(each[1:] for each in now)), aim.actuators,
                                aim.commands, aim.path, aim.weights, aim.terrain_map,
                                ATTITUDE_EVERY)  # fmt: skip
        merit[~(rollout.valid & np.isfinite(merit))] = np.inf
        return Pass(
            u=u,
            Y=np.ascontiguousarray(Y[:, :, 1]),
            before=float(merit[0]),
            after=float(merit[1]),
            linear=linear_cost,
            step=1.0,
            slack=float(slack[1]),
            valid=bool(np.isfinite(merit[1])),
            solution=None,
        )

    return plan


def weighing(weights: Weights) -> Floats:
    """Return the weights W (13,) of z: the MPC's, along and across alike, and :data:`CAUTION`."""
    q = 0.5 * (weights.Q[0] + weights.Q[1])
    careful = np.array([1.0, CAUTION, CAUTION, CAUTION])
    R, Rc = careful * weights.R, careful * weights.Rc
    return np.array([q, q, *weights.Q[2:], *R, *Rc])


def _rows(model: PredictionModel) -> list[int]:
    return [model.outputs.index(name) for name in (*TRACKED[:5], *ACTUATORS)]
