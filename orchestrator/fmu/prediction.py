"""An FMU as the prediction model of a controller: rollouts, response, trim, a shadow of the flight."""

import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from orchestrator.fmu.description import preferred_rate
from orchestrator.fmu.fmu import Described, Fmu, describe
from orchestrator.fmu.level import level
from orchestrator.fmu.observed import OUTPUTS, Layout, moved, observed, tangent
from orchestrator.fmu.roles import GROUPS, RIGID, Roles, Source, find_roles
from orchestrator.fmu.start import start_values
from orchestrator.fmu.trajectories import Floats, Flown, Origin, Trajectories

if TYPE_CHECKING:
    from orchestrator.isolation.process import Process


@dataclass(frozen=True)
class FmuModelParameters:
    """Which FMU, and what its variables mean; the defaults fit our own vehicle exported as C."""

    file: Annotated[Path, "the FMU, or the folder of an unpacked one"]
    start: Annotated[Mapping[str, Any], "start values by variable"] = field(
        default_factory=dict[str, Any]
    )
    state: Annotated[str, "group of variables that publish the state"] = GROUPS["state"]
    settable: Annotated[
        str, "group that takes a measured state; where there is none a shadow flies along"
    ] = GROUPS["settable"]
    restart: Annotated[str, "flag that makes a step start from it, if one is needed"] = "restart"
    command: Annotated[str, "group of the commands"] = GROUPS["command"]
    velocity: Annotated[str, "group of the velocity over ground"] = GROUPS["velocity"]
    actuator: Annotated[str, "group of the actuators that act in a step"] = GROUPS["actuator"]
    wind: Annotated[str, "group of the velocity of the air"] = GROUPS["wind"]
    bias: Annotated[str, "group of the unmodelled acceleration"] = GROUPS["bias"]
    valid: Annotated[str, "flag that says whether the model is valid"] = "valid"
    names: Annotated[
        Mapping[str, str | Source], "variables that are called otherwise, by part: state.down, ..."
    ] = field(default_factory=dict[str, str | Source])
    states: Annotated[
        tuple[str, ...], "states in order; as the FMU has the group, if empty"
    ] = ()
    commands: Annotated[
        tuple[str, ...], "commands in order; as the FMU has the group, if empty"
    ] = ()
    set_point_limit_deg: Annotated[float, Gt(0), "of pitch and roll set-points"] = 50.0
    trim_altitude_m: Annotated[float, "where level flight is sought, out of ground effect"] = 1e5
    sample_period_s: Annotated[
        Annotated[float, Gt(0)] | None, "over which a command is held; as the FMU says if null"
    ] = None
    derivatives: Annotated[
        bool, "identify by the FMU's directional derivatives instead of by perturbed rollouts"
    ] = False
    processes: Annotated[int, Ge(1), "processes that share the trajectories"] = 1


class Rollout(NamedTuple):
    """Trajectories of a batch: outputs (N, H, 14), valid (N,), the states at the end (N, n)."""

    outputs: Floats
    valid: NDArray[np.bool_]
    last: Floats


class FmuModel:
    """An FMU of FMI 2.0 or 3.0 that a controller predicts with.

    A trajectory starts from a state saved after initialization, takes the measured state, and steps.
    Where no measured state can be set, :meth:`follow` keeps a shadow in step with the flight, and
    trajectories start from that.

    Attributes
    ----------
    states, commands, outputs : tuple of str
    command_min, command_max, actuator_min, actuator_max : (4,)
        The FMU's own limits; a command without any has those of the actuator of its name.
    sample_period : float
        s.
    response : callable or None
        :meth:`differentiated`, if the parameters ask for it.
    follow : callable or None
        :meth:`shadowed`, where the FMU takes no measured state.

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
            self._roles = roles = find_roles(described.variables, parameters)
            self.sample_period = _period(described, parameters)
            start = _start(described, parameters)
            fmu = Fmu(described)
            _check_abilities(described, roles, parameters)
            self._trajectories = Trajectories(fmu, roles, start, self.sample_period)
        except BaseException:
            described.close()
            raise
        self._finalizer = weakref.finalize(self, _close, self._trajectories, described)
        self.states, self.commands = roles.state.names, roles.command.names
        self._layout = _layout(roles)
        limits = _limits(described, roles, parameters)
        self.command_min, self.command_max, self.actuator_min, self.actuator_max = limits
        self._trims: dict[float, tuple[Floats, Floats, Floats]] = {}
        self._shadow: bytes | None = None
        self._end: tuple[bytes, bytes] | None = None  # a predicted state, and the shadow there
        self.response = self.differentiated if parameters.derivatives else None
        self.follow = None if roles.settable else self.shadowed
        self._others: list[Process] = []

    def trim(self, speed: float) -> tuple[Floats, Floats, Floats]:
        """Return state (n,), command (4,) and actuators (4,) of level flight north at ``speed`` m/s.

        Found by stepping the FMU; of a shadow it is the flight that it is initialized in.

        Raises
        ------
        ValueError
            If there is none.
        """
        if speed not in self._trims:
            self._trims[speed] = self._trim(speed)
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
        if state.ndim == 2 and (state != state[0]).any():
            each = [
                self.rollout(one, own[None], wind, bias)
                for one, own in zip(state, commands, strict=True)
            ]
            return Rollout(*(np.concatenate(parts) for parts in zip(*each, strict=True)))
        state = np.ascontiguousarray(state[0] if state.ndim == 2 else state)
        origin = self._origin(state)
        flown = self._fly(origin, commands, wind, bias)
        values = flown.values.transpose(2, 0, 1)
        if self.follow is not None or not self._roles.bias:
            values = self._corrected(origin, state, values, bias)
        if self.follow is not None and len(commands) == 1:
            last = values[0, : len(self.states), -1].tobytes()
            self._end = last, self._trajectories.saved()
        found = observed(values, commands.transpose(0, 2, 1), self._layout)
        # (14, H, N) in memory, as controllers take it
        outputs = np.ascontiguousarray(found.transpose(1, 2, 0)).transpose(2, 1, 0)
        return Rollout(outputs, flown.valid, values[:, : len(self.states), -1])

    def differentiated(
        self, state: Floats, u0: Floats, Phi: Floats, wind: Floats, bias: Floats
    ) -> tuple[Floats, Floats, bool]:
        """Return the nominal (14, H), its derivative by alpha (14, H, m), and whether it is valid.

        The commands are u0 (H, 4) + Phi alpha, with Phi (4, H, m); the derivative is exact, a product
        of the FMU's directional derivatives over the steps.
        """
        commands = u0[None]
        origin = np.ascontiguousarray(state)
        flown, steps = self._trajectories.differentiate(origin, commands, wind, bias)
        moving = np.zeros((len(self.states), Phi.shape[2]))
        settable = [self.states.index(name) for name in self._roles.settable.names]
        along = np.empty((Phi.shape[2], *flown.values.shape[:2]))
        for k, step in enumerate(steps):
            changed = step.T @ np.concatenate([moving[settable], Phi[:, k]])
            moving = changed[: len(self.states)]
            along[:, :, k] = changed.T
        values, nominal = flown.values[:, :, 0], commands[0].T
        by = Phi.transpose(2, 0, 1)
        S = tangent(values, along, nominal, by, self._layout).transpose(1, 2, 0)
        is_valid = bool(flown.valid[0]) and bool(np.isfinite(S).all())
        return observed(values, nominal, self._layout), np.ascontiguousarray(S), is_valid

    def shadowed(
        self, shadow: bytes | None, commands: Floats, wind: Floats, bias: Floats
    ) -> bytes:
        """Return the FMU's state after commands (K, 4) that the aircraft has flown.

        Trajectories start from it until the next call.

        Parameters
        ----------
        shadow : bytes or None
            What the last call has returned; None starts at the initial state.
        wind, bias : (3,)
            As of :meth:`rollout`.
        """
        trajectories = self._trajectories
        self._end = None
        self._shadow = trajectories.initial()[0] if shadow is None else shadow
        if len(commands):
            trajectories.fly(self._shadow, commands[None], wind, bias)
            self._shadow = trajectories.saved()
        return self._shadow

    def _origin(self, state: Floats) -> Origin:
        """Return where the FMU starts for a state: of a shadow what was predicted, or the present."""
        if self.follow is None:
            return state
        if self._end is not None and self._end[0] == state.tobytes():
            return self._end[1]
        if self._shadow is None:
            self._shadow = self._trajectories.initial()[0]
        return self._shadow

    def _corrected(self, origin: Origin, state: Floats, values: Floats, bias: Floats) -> Floats:
        """Return what is read (N, r, H) with the states as the measured state and the bias say."""
        if isinstance(origin, bytes):
            first = self._trajectories.now(origin)
        else:
            first = np.concatenate([state, np.zeros(values.shape[1] - len(state))])
        offset = state - first[: len(state)]
        bias = np.zeros(3) if self._roles.bias else bias
        corrected = values.copy()
        for one in corrected:
            whole = np.concatenate([first[:, None], one], axis=1)
            one[: len(state)] = moved(whole, offset, bias, self.sample_period, len(state))
        return corrected

    def _trim(self, speed: float) -> tuple[Floats, Floats, Floats]:
        _, values, commands = self._trajectories.initial()
        state, still = values[: len(self.states)].copy(), np.zeros(3)
        if self.commands[3] == "heading":
            commands[3] -= state[8]
        if self._roles.settable:

            def one(x: Floats, u: Floats) -> Floats:
                flown = self._trajectories.fly(x, u[None, None], still, still)
                return flown.values[: len(x), 0, 0]

            state[2] = -self._parameters.trim_altitude_m
            state, commands = level(one, speed, self.sample_period, (state, commands))
            state[:3] = 0.0
        else:
            own = float(np.linalg.norm(state[3:6]))
            if abs(own - speed) > 0.01 * max(speed, 1.0):
                raise ValueError(
                    f"trim: the FMU takes no state and flies at its own speed, got {speed:g} m/s, "
                    f"expected {own:g} m/s"
                )
            state[:3] = state[8] = 0.0
        ...
