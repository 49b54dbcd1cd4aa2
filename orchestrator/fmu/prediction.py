"""An FMU as the prediction model of a controller: rollouts, response, trim, a shadow of the flight."""

import weakref
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchestrator.fmu.crew import Crew
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.fmu import Described, Fmu, describe
from orchestrator.fmu.level import level
from orchestrator.fmu.observed import OUTPUTS, Layout, moved, observed, tangent
from orchestrator.fmu.prediction_parameters import (
    FmuModelParameters,
    check_abilities,
    limits,
    sample_period,
    start_of,
)
from orchestrator.fmu.roles import AXES, find_roles
from orchestrator.fmu.trajectories import Floats, Origin, Trajectories

__all__ = ["FmuModel", "FmuModelParameters"]


class Rollout(NamedTuple):
    """Trajectories of a batch: outputs (N, H, 14), valid (N,), the states at the end (N, n)."""

    outputs: Floats
    valid: NDArray[np.bool_]
    last: Floats


class FmuModel:
    """An FMU of FMI 2.0 or 3.0 that a controller predicts with.

    A trajectory starts from a state saved after initialization, takes the measured state, and steps.
    Where no measured state can be set, :meth:`shadow` keeps an FMU state in step with the flight, and
    trajectories start from that.

    Attributes
    ----------
    states, commands, outputs : tuple of str
    command_min, command_max, actuator_min, actuator_max : (4,)
    sample_period : float
        s.
    trajectories : Trajectories
        The FMU.
    response : callable or None
        :meth:`differentiated`, if the parameters ask for it.
    follow : callable or None
        :meth:`shadow`, where the FMU takes no measured state.

    Raises
    ------
    ValueError
        In one line: no FMU that can be used here, a name that it does not have, a state that cannot
        be saved.
    """

    outputs = OUTPUTS

    def __init__(self, parameters: FmuModelParameters) -> None:
        self._parameters = parameters
        described = describe(parameters.file, arrays=False)
        try:
            roles = find_roles(described.variables, parameters)
            check_abilities(described, roles, parameters)
            self._is_shadow = not roles.settable.names
            self._has_bias = bool(roles.bias.names)
            self._is_corrected = self._is_shadow or not self._has_bias
            self.sample_period = sample_period(described, parameters)
            self.trajectories = Trajectories(
                Fmu(described), roles, start_of(described, parameters), self.sample_period
            )
        except BaseException:
            described.close()
            raise
        self._finalizer = weakref.finalize(self, _close, self.trajectories, described)
        self._settable = [roles.state.names.index(name) for name in roles.settable.names]
        self.states, self.commands = roles.state.names, roles.command.names
        self._layout = Layout(
            len(self.states), len(roles.velocity.names), len(roles.actuator.names)
        )
        found = limits(described, roles, parameters)
        self.command_min, self.command_max = found.command_min, found.command_max
        self.actuator_min, self.actuator_max = found.actuator_min, found.actuator_max
        self._trims: dict[float, tuple[Floats, Floats, Floats]] = {}
        self._present: bytes | None = None
        self._predicted: tuple[bytes, bytes] | None = None  # a state, and the shadow's there
        self._crew = Crew(parameters) if parameters.processes > 1 else None
        self.response = self.differentiated if parameters.derivatives else None
        if self.response is not None:
            _, values, commands = self.trajectories.initial()
            try:
                self.response(values[: len(self.states)], commands[None], np.zeros((4, 1, 0)),
                              np.zeros(3), np.zeros(3))  # fmt: skip
            except FmuError as error:
                raise ValueError(f"derivatives: {error}, expected 'derivatives: false'") from error
        self.follow = self.shadow if self._is_shadow else None

    def trim(self, speed: float) -> tuple[Floats, Floats, Floats]:
        """Return state (n,), command (4,) and actuators (4,) of level flight north at ``speed`` m/s.

        Found by stepping the FMU; of one that takes no state it is the flight it begins with.

        Raises
        ------
        ValueError
            If there is none.
        """
        if speed not in self._trims:
            self._trims[speed] = self._begun(speed) if self._is_shadow else self._level(speed)
        return self._trims[speed]

    def rollout(self, state: Floats, commands: Floats, wind: Floats, bias: Floats) -> Rollout:
        """Predict N trajectories.

        Parameters
        ----------
        state : (n,) or (N, n)
            At the start.
        commands : (N, H, 4)
            Held over each sample.
        wind, bias : (3,)
            Air velocity, m/s, and unmodelled acceleration, m/s2; NED.
        """
        if state.ndim == 2:
            each = [
                self.rollout(one, own[None], wind, bias)
                for one, own in zip(state, commands, strict=True)
            ]
            return Rollout(*(np.concatenate(parts) for parts in zip(*each, strict=True)))
        origin = self._origin(state)
        if self._crew is None:
            flown = self.trajectories.fly(origin, commands, wind, bias)
        else:
            flown = self._crew.fly(self.trajectories, origin, commands, wind, bias)
        end = self.trajectories.saved() if self._is_shadow and len(commands) == 1 else None
        values = flown.values.transpose(2, 0, 1)
        if self._is_corrected:
            values = self._corrected(origin, state, values, bias)
        last = values[:, : len(state), -1]
        if end is not None:
            self._predicted = last[0].tobytes(), end
        outputs = observed(values, commands.transpose(0, 2, 1), self._layout)
        outputs = np.ascontiguousarray(outputs.transpose(1, 2, 0))  # as controllers take it
        return Rollout(outputs.transpose(2, 1, 0), flown.valid, last)

    def differentiated(
        self, state: Floats, u0: Floats, Phi: Floats, wind: Floats, bias: Floats
    ) -> tuple[Floats, Floats, bool]:
        """Return the nominal (14, H), its derivative by alpha (14, H, m), and whether both are valid.

        The commands are u0 (H, 4) + Phi alpha, with Phi (4, H, m). The derivative is a product of the
        FMU's directional derivatives over the steps: exact where its settable states are all it has.
        """
        flown, steps = self.trajectories.differentiate(state, u0[None], wind, bias)
        moving = np.zeros((len(state), Phi.shape[2]))
        along = np.empty((Phi.shape[2], *flown.values.shape[:2]))
        for k, step in enumerate(steps):
            changed = step.T @ np.concatenate([moving[self._settable], Phi[:, k]])
            moving, along[:, :, k] = changed[: len(state)], changed.T
        values = flown.values[:, :, 0]
        S = tangent(values, along, u0.T, Phi.transpose(2, 0, 1), self._layout).transpose(1, 2, 0)
        is_valid = bool(flown.valid[0]) and bool(np.isfinite(S).all())
        return observed(values, u0.T, self._layout), np.ascontiguousarray(S), is_valid

    def shadow(self, before: bytes | None, commands: Floats, wind: Floats, bias: Floats) -> bytes:
        """Return the FMU's state after commands (K, 4) that the aircraft has flown.

        Trajectories start from it until the next call.

        Parameters
        ----------
        before : bytes or None
            What the last call has returned; None begins anew.
        wind, bias : (3,)
            As of :meth:`rollout`.
        """
        self._predicted = None
        self._present = self.trajectories.initial()[0] if before is None else before
        if len(commands):
            self.trajectories.fly(self._present, commands[None], wind, bias)
            self._present = self.trajectories.saved()
        return self._present

    def _origin(self, state: Floats) -> Origin:
        """Return what the FMU starts from: the state, or the shadow in the present or as predicted."""
        if not self._is_shadow:
            return state
        if self._predicted is not None and self._predicted[0] == state.tobytes():
            return self._predicted[1]
        return self.trajectories.initial()[0] if self._present is None else self._present

    def _corrected(self, origin: Origin, state: Floats, values: Floats, bias: Floats) -> Floats:
        """Return what is read (N, r, H), the states as the measured state and the bias say."""
        is_saved = isinstance(origin, bytes)
        first = self.trajectories.now(origin)[: len(state)] if is_saved else state
        states = values[:, : len(state)]
        now = np.broadcast_to(first[:, None], (len(values), len(state), 1))
        whole = np.concatenate([now, states], axis=2)
        extra = np.zeros(3) if self._has_bias else bias
        found, gained = moved(whole, state - first, extra, self.sample_period)
        rest = values[:, len(state) :].copy()
        if self._layout.velocity:
            rest[:, : len(AXES)] += gained
        return np.concatenate([found, rest], axis=1)

    def _level(self, speed: float) -> tuple[Floats, Floats, Floats]:
        _, values, guess = self.trajectories.initial()
        still = np.zeros(3)

        def one(state: Floats, commands: Floats) -> Floats:
            flown = self.trajectories.fly(state, commands[None, None], still, still)
            return flown.values[:, 0, 0]

        state = values[: len(self.states)].copy()
        if self.commands[3] == "heading":
            guess[3] -= state[8]
        state[2] = -self._parameters.trim_altitude_m
        found = level(one, speed, self.sample_period, (state, guess))
        state, commands = found
        actuators = self._actuators(one(state, commands), commands)
        state[:3] = 0.0
        return state, commands, actuators

    def _begun(self, speed: float) -> tuple[Floats, Floats, Floats]:
        _, values, commands = self.trajectories.initial()
        state = values[: len(self.states)].copy()
        own = float(np.linalg.norm(state[3:6]))
        if abs(own - speed) > 0.01 * max(speed, 1.0):
            raise ValueError(
                "trim: the FMU takes no state and has a trim at the speed that it begins with only, "
                f"got {speed:g} m/s, expected {own:g} m/s"
            )
        if self.commands[3] == "heading":
            commands[3] -= state[8]
        state[:3] = state[8] = 0.0
        return state, commands, self._actuators(values, commands)

    def _actuators(self, values: Floats, commands: Floats) -> Floats:
        found = observed(values[:, None], commands[:, None], self._layout)
        return found[OUTPUTS.index("actuator_thrust") :, 0]


def _close(trajectories: Trajectories, described: Described) -> None:
    try:
        trajectories.close()
    finally:
        described.close()
