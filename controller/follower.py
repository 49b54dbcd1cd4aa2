"""A reactive height follower: what a range finder that looks straight down can do, and no more.

A PI controller of the measured height above ground, damped by the climb rate, gives the thrust;
proportional laws on the set-points of the attitude stabiliser hold the course and the speed. It knows
neither the terrain ahead nor a model, so that it comes late over every slope. Its plan holds the
present set-points; the prediction model only says where that leads.
"""

import math

import numpy as np

from controller.course import STANDARD_GRAVITY
from controller.mpc import Mpc
from controller.optimise import ACTUATORS, ATTITUDE_EVERY, TRACKED, Aim, Improve, Pass
from controller.parameters import MpcParameters
from controller.prediction import Floats, PredictionModel
from controller.reference import project, sample_path
from controller.terrain_map import heights
from controller.tracking import costs, targets
from controller.update import velocity

# thrust, G, per height missing, sink rate and integral: as stiff as updates every half second allow
# with some damping; with half of that damping it collides over Jacksboro
PER_M, PER_MPS, PER_MS = 0.3, 0.2, 0.1
INTEGRAL_MAX_G = 0.5
PITCH_PER_MPS = 0.02  # rad
BANK_PER_M, BANK_PER_MPS = 0.03, 0.06  # rad
BANK_MAX = math.radians(30.0)


def HeightFollower(
    parameters: MpcParameters, *, prediction_model: PredictionModel, latency_s: float = 0.0
) -> Mpc:
    """Reactive height following behind the interface of :class:`controller.mpc.Mpc`.

    Of the parameters it heeds the course, the speed, the set height, and the capacities.

    Raises
    ------
    ValueError
        If the prediction model is not in attitude form, and of :class:`~controller.mpc.Mpc`.
    """
    if "heading" not in prediction_model.commands:
        raise ValueError(
            f"height follower: no attitude set-points, got commands"
            f" {', '.join(prediction_model.commands)}, expected a prediction model in attitude form"
        )
    return Mpc(
        parameters,
        prediction_model=prediction_model,
        planner=follower_planner,
        latency_s=latency_s,
        name="HeightFollower",
        meaning="reactive follower of the measured height above ground",
    )


def follower_planner(p: MpcParameters, model: PredictionModel, horizon: int) -> Improve:
    """Return how the follower plans: the present set-points, held over a horizon of H samples."""
    wind = np.array(p.wind_mps)
    rows = np.array([model.outputs.index(name) for name in (*TRACKED, *ACTUATORS)])

    def plan(state: Floats, u0: Floats, bias: Floats, aim: Aim) -> Pass:
        wanted, integral = set_points(state, model.states, aim)
        low = np.maximum(model.command_min, aim.commands[:, 0] - aim.reach)
        high = np.minimum(model.command_max, aim.commands[:, 0] + aim.reach)
        flown = np.stack([u0, np.tile(np.clip(wanted, low, high), (horizon, 1))])
        rollout = model.rollout(state, flown, wind, bias)
        Y = rollout.outputs.transpose(2, 1, 0)
        held = np.ascontiguousarray(Y[:, :, 1])
        north, east = held[rows[0]], held[rows[1]]
        target = targets(aim.path, north, east, aim.near, model.sample_period, aim.heading)
        _, slack, merit = costs(Y, rows, flown, target, aim.actuators, aim.commands, aim.path,
                                aim.weights, aim.terrain_map, ATTITUDE_EVERY)  # fmt: skip
        merit[~(rollout.valid & np.isfinite(merit))] = np.inf
        return Pass(
            u=flown[1],
            Y=held,
            before=float(merit[0]),
            after=float(merit[1]),
            linear=float(merit[1]),
            step=1.0,
            slack=float(slack[1]),
            valid=bool(np.isfinite(merit[1])),
            solution=None,
            carry=np.array([integral]),
        )

    return plan


def set_points(state: Floats, states: tuple[str, ...], aim: Aim) -> tuple[Floats, float]:
    """Return the commands (4,) wanted in a state (n,), and the integral (G) to carry on with.

    Where the ground below was not sensed the height counts as right.
    """
    north, east, down = (float(state[states.index(axis)]) for axis in ("north", "east", "down"))
    v_north, v_east, v_down = velocity(state, states).tolist()
    ground = float(heights(aim.terrain_map, north, east)[0])
    low = aim.height - (-down - ground) if math.isfinite(ground) else 0.0
    integral = 0.0 if aim.carry is None else float(aim.carry[0])
    integral = float(
        np.clip(integral + PER_MS * low * aim.elapsed, -INTEGRAL_MAX_G, INTEGRAL_MAX_G)
    )

    station = project(aim.path, north, east, aim.near)
    here = sample_path(aim.path, np.array([station, station + 1.0]))
    sine, cosine = math.sin(here.heading[0]), math.cos(here.heading[0])
    aside = cosine * (east - here.east[0]) - sine * (north - here.north[0])
    drift = cosine * v_east - sine * v_north
    fast = math.hypot(v_north, v_east, v_down) - float(here.speed[0])
    curvature = float(here.heading[1] - here.heading[0])  # over a metre
    turn = math.atan((v_north**2 + v_east**2) * curvature / STANDARD_GRAVITY)
    bank = float(np.clip(turn - BANK_PER_M * aside - BANK_PER_MPS * drift, -BANK_MAX, BANK_MAX))
    thrust = PER_M * low + PER_MPS * v_down + integral
    return aim.commands[:, 0] + [thrust, PITCH_PER_MPS * fast, bank, 0.0], integral
