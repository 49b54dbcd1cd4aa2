"""The helicopter as a component that flies, and as a model that predicts."""

import math
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from plant import kernels, lanes
from plant.rotorcraft import (
    COMMANDS,
    ROTOR,
    SET_POINT_LIMIT,
    STATES,
    AirframeParameters,
    Rollout,
    Rotorcraft,
    rotorcraft,
)
from plant.terrain import Terrain
from plant.variables import Execution, Variable, model_description, parameter_variables, unknown

Floats = NDArray[np.float64]
SAMPLE_PERIOD = 0.05  # s, over which a command is held
OUTCOMES = ("flying", "collision", "departed", "left_terrain")

_STATE_UNITS = (
    ("m",) * 3 + ("m/s",) * 3 + ("rad",) * 3 + ("rad/s",) * 3 + ("rad", "rad", "G", "rad", "rad")
)
_STATE_MEANINGS = (
    "position north", "position east", "position down", "velocity forward", "velocity right",
    "velocity down (body)", "roll", "pitch", "heading, unwrapped", "roll rate", "pitch rate",
    "yaw rate", "longitudinal flapping, aft positive", "lateral flapping, right positive",
    "main-rotor thrust", "stabiliser bar, longitudinal", "stabiliser bar, lateral",
)  # fmt: skip


@dataclass(frozen=True)
class Perturbation:
    """What to add to the trimmed start."""

    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float = 0.0
    forward_mps: float = 0.0
    right_mps: float = 0.0
    up_mps: float = 0.0
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    heading_deg: float = 0.0


@dataclass(frozen=True)
class HelicopterParameters(AirframeParameters):
    """Which helicopter, and where it starts."""

    speed_mps: Annotated[float, Ge(0), "speed at the start"] = 30.0
    north_m: Annotated[float, "start position"] = 0.0
    east_m: Annotated[float, "start position"] = 0.0
    heading_deg: Annotated[float, "heading at the start, from north to east"] = 0.0
    height_agl_m: Annotated[float, "height above ground at the start"] = 10.0
    slope_matched: Annotated[bool, "start along the slope of the ground rather than level"] = True
    perturbation: Annotated[Perturbation, "added to the trimmed start"] = Perturbation()


class Helicopter:
    """A Yamaha R-50 in flight (continuous, 20 Hz; Runge-Kutta with two substeps).

    Without a terrain the ground is a plane at elevation 0 that gives no ground effect.

    Raises
    ------
    ValueError
        If the start is outside the terrain or below ground.
    """

    execution = Execution("continuous", 20.0)

    def __init__(self, parameters: HelicopterParameters, *, terrain: Terrain | None = None) -> None:
        self._parameters = parameters
        self._terrain = terrain
        self._craft = rotorcraft(parameters, terrain)
        self._form = COMMANDS[parameters.command]
        self._commands = np.zeros((lanes.LANES, 1, lanes.COMMANDS))
        self._start()
        self._variables = _variables(self._craft, self._form, self._values())
        self._inputs = frozenset(v.name for v in self._variables if v.causality == "input")

    def describe(self) -> Any:
        """Return the model description of this instance."""
        rows = [*self._variables, *parameter_variables(self._parameters)]
        return model_description(
            "Helicopter", "Yamaha R-50, nonlinear, 9 DOF", rows, has_state=True
        )

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Put the helicopter at its start. Inputs set before are kept."""
        del start_time, stop_time, seed
        self._start()

    def set(self, values: Mapping[str, Any]) -> None:
        """Set inputs; they hold until set again."""
        for name, value in values.items():
            if name not in self._inputs:
                raise unknown(name, self._inputs)
            group, member = name.split(".")
            if group == "command":
                self._commands[:, 0, self._form.index(member)] = value
            else:
                self._wind[("north", "east", "down").index(member)] = value
        self._cache = None

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return values at the current instant."""
        if self._cache is None:
            self._cache = self._values()
        try:
            return {name: self._cache[name] for name in names}
        except KeyError as error:
            raise unknown(error.args[0], self._cache) from None

    def step(self, time: float, step_size: float) -> int:
        """Advance by one sample of 50 ms; after the end of the flight the helicopter stays put."""
        del time
        if abs(step_size - SAMPLE_PERIOD) > 1e-9:
            raise ValueError(
                f"helicopter: wrong step size, got {step_size:g} s, expected {SAMPLE_PERIOD} s"
            )
        if self._outcome == 0:
            rollout = self._craft.roll(self._lanes, self._commands, self._wind, (0.0, 0.0, 0.0))
            self._lanes = np.ascontiguousarray(rollout.last)
            self._valid = bool(rollout.valid[0])
            self._outcome = self._judge()
            self._cache = None
        return 0

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next step depends on."""
        hidden = (self._lanes, self._commands, self._wind, self._outcome, self._valid)
        return pickle.dumps(hidden)

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned, bit for bit."""
        self._lanes, self._commands, self._wind, self._outcome, self._valid = pickle.loads(state)  # noqa: S301
        self._cache = None

    # -- the flight ------------------------------------------------------------------------------

    def _start(self) -> None:
        parameters, delta = self._parameters, self._parameters.perturbation
        level = self._craft.trim(parameters.speed_mps)
        command = self._craft.trim_command(level)
        heading = math.radians(parameters.heading_deg)
        if self._form[3] == "heading":
            command[3] += heading
        north, east = parameters.north_m + delta.north_m, parameters.east_m + delta.east_m
        ground, climb = self._ground(north, east), 0.0
        if self._terrain is not None and parameters.slope_matched:
            h_n, h_e = self._terrain.slope(north, east)
            climb = math.atan(float(h_n) * math.cos(heading) + float(h_e) * math.sin(heading))
        height = parameters.height_agl_m + delta.up_m
        if height <= 0:
            raise ValueError(
                f"helicopter: start below ground, got height {height:g} m, expected above 0 m"
            )
        state = np.array(level.state)
        state[:3] = north, east, -(ground + height)
        velocity = np.array(
            [
                parameters.speed_mps * math.cos(climb) + delta.forward_mps,
                delta.right_mps,
                -parameters.speed_mps * math.sin(climb) - delta.up_mps,
            ]
        )
        state[6] += math.radians(delta.roll_deg)
        state[7] += math.radians(delta.pitch_deg)
        state[3:6] = _body(velocity, state[6], state[7], math.radians(delta.heading_deg))
        state[8] = heading + math.radians(delta.heading_deg)
        self._lanes = np.tile(self._craft.own_state(state), (lanes.LANES, 1))
        self._commands[:] = command
        self._wind = np.zeros(3)
        self._outcome = 0
        self._valid = True
        self._cache: dict[str, Any] | None = None

    def _ground(self, north: float, east: float) -> float:
        return 0.0 if self._terrain is None else float(self._terrain.elevation(north, east))

    def _clearance(self) -> float:
        north, east, down = (float(value) for value in self._lanes[0, :3])
        if self._terrain is None:
            return -down
        return -down - kernels.height(self._craft.grid, north, east)

    def _judge(self) -> int:
        clearance = self._clearance()
        x = self._lanes[0].tolist()
        level = max(abs(x[6]), abs(x[7])) <= lanes.ATTITUDE_LIMIT
        if not (level and math.isfinite(sum(x))):
            return OUTCOMES.index("departed")
        if math.isnan(clearance):
            return OUTCOMES.index("left_terrain")
        return OUTCOMES.index("collision") if clearance <= 0 else 0

    def _values(self) -> dict[str, Any]:
        craft = self._craft
        x = self._lanes[0].tolist()
        u = self._commands[0, 0].tolist()
        wind = tuple(self._wind.tolist())
        clearance = self._clearance()
        ground = -x[2] - clearance
        thrust, ned, act, load = kernels.readings(
            tuple(x), tuple(u), wind, lanes.NO_GROUND if math.isnan(ground) or self._terrain is None
            else ground, craft.p, craft.collective,
        )  # fmt: skip
        common = [*x[:ROTOR], thrust, *x[ROTOR + 1 :]]
        values = {f"state.{name}": value for name, value in zip(STATES, common, strict=True)}
        values.update(zip(_POSE, (*x[:3], *x[6:9]), strict=True))
        values.update(zip(_VELOCITY, ned, strict=True))
        values.update(zip(_ACTUATOR, act, strict=True))
        values["clearance"] = clearance if not math.isnan(clearance) else -x[2]
        values["load_factor"] = load
        values["outcome"] = self._outcome
        values["valid"] = self._valid
        return values


_POSE = tuple(f"pose.{name}" for name in ("north", "east", "down", "phi", "theta", "psi"))
_VELOCITY = tuple(f"velocity.{name}" for name in ("north", "east", "down"))
_ACTUATOR = tuple(f"actuator.{name}" for name in COMMANDS["actuator"])


def _body(ned: Floats, phi: float, theta: float, psi: float) -> Floats:
    """Return R'(phi, theta, psi) ned."""
    from plant.dynamics import body_from_ned, sincos

    return np.array(body_from_ned(tuple(ned), (*sincos(phi), *sincos(theta), *sincos(psi))))


def _variables(
    craft: Rotorcraft, form: tuple[str, ...], start: Mapping[str, Any]
) -> list[Variable]:
    p = craft.p
    command = craft.trim_command(craft.trim(30.0))
    rows = [
        Variable(f"command.{name}", "input", "G" if name in ("thrust", "tail") else "rad",
                 f"commanded {name}", start=float(value))
        for name, value in zip(form, command, strict=True)
    ]  # fmt: skip
    rows += [
        Variable(f"wind.{axis}", "input", "m/s", f"velocity of the air, {axis}")
        for axis in ("north", "east", "down")
    ]
    rows += [
        Variable(f"state.{name}", "output", unit, meaning)
        for name, unit, meaning in zip(STATES, _STATE_UNITS, _STATE_MEANINGS, strict=True)
    ]
    rows += [
        Variable(n, "output", u, f"{n[5:]} of the body")
        for n, u in zip(_POSE, ("m",) * 3 + ("rad",) * 3, strict=True)
    ]
    rows += [Variable(n, "output", "m/s", f"velocity over ground, {n[9:]}") for n in _VELOCITY]
    limits = (
        (p.thrust_min, p.thrust_max),
        (-p.tilt_max, p.tilt_max),
        (-p.tilt_max, p.tilt_max),
        (-p.tail_max, p.tail_max),
    )
    rows += [
        Variable(name, "output", unit, "actuator after stabiliser and limits", min=low, max=high)
        for name, unit, (low, high) in zip(_ACTUATOR, ("G", "rad", "rad", "G"), limits, strict=True)
    ]
    rows += [
        Variable("clearance", "output", "m", "altitude above the terrain below"),
        Variable("load_factor", "output", "G", "specific force along body up, in g"),
        Variable("outcome", "output", "1", "how the flight stands", start=0, items=OUTCOMES),
        Variable("valid", "output", "1", "the model is within its validity", start=True),
    ]
    assert {row.name for row in rows if row.causality == "output"} == set(start)
    return rows


@dataclass(frozen=True)
class ModelParameters(AirframeParameters):
    """Which helicopter to predict."""


class HelicopterModel:
    """The same helicopter as a prediction model for a controller: batched rollouts.

    With a ``terrain`` the ground effect is predicted and a trajectory that leaves the terrain is
    invalid; without one there is neither.
    """

    states = STATES
    outputs = lanes.OUTPUTS
    sample_period = SAMPLE_PERIOD

    def __init__(self, parameters: ModelParameters, *, terrain: Terrain | None = None) -> None:
        self._craft = rotorcraft(parameters, terrain)
        self.commands = COMMANDS[parameters.command]
        p = self._craft.p
        tilt = SET_POINT_LIMIT if self._craft.attitude else p.tilt_max
        turn = math.inf if self._craft.attitude else p.tail_max
        self.command_min = np.array([p.thrust_min, -tilt, -tilt, -turn])
        self.command_max = np.array([p.thrust_max, tilt, tilt, turn])
        self.actuator_min = np.array([p.thrust_min, -p.tilt_max, -p.tilt_max, -p.tail_max])
        self.actuator_max = np.array([p.thrust_max, p.tilt_max, p.tilt_max, p.tail_max])

    def trim(self, speed: float) -> tuple[Floats, Floats, Floats]:
        """Return (state (17,), command (4,), actuators (4,)) of level flight north at ``speed`` m/s."""
        level = self._craft.trim(speed)
        return np.array(level.state), self._craft.trim_command(level), np.array(level.actuators)

    def rollout(self, state: Floats, commands: Floats, wind: Floats, bias: Floats) -> Rollout:
        """Predict N trajectories.

        Parameters
        ----------
        state : (17,) or (N, 17)
            Common state at the start.
        commands : (N, H, 4)
            Held over each sample of 50 ms.
        wind, bias : (3,)
            Air velocity, m/s, and unmodelled acceleration, m/s2; NED.
        """
        own = self._craft.own_state(np.broadcast_to(state, (len(commands), len(STATES))))
        return self._craft.roll(own, commands, wind, bias)
