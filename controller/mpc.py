"""Model predictive control with control basis functions (CBF: control *basis* functions).

Every update: take in the terrain sensed, carry the reference on, predict to the instant the plan takes
effect, shift the last optimum, improve it by :func:`controller.optimise.optimise`, and publish the plan
with everything that says how it came about.
"""

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from controller.bases import span_basis
from controller.course import make_course
from controller.guidance import Guidance
from controller.optimise import VELOCITY, Aim, Design, Pass, optimise
from controller.plan import CHANNELS, PlanForm, plan_variables
from controller.prediction import PredictionModel, stack_bases
from controller.solvers import Backend, Status
from controller.terrain_map import empty_map, read_scan
from controller.tracking import Weights
from controller.variables import (
    Execution,
    Variable,
    model_description,
    parameter_variables,
    unknown,
)

Floats = NDArray[np.float64]
Family = Literal[
    "laguerre",
    "laguerre_function",
    "legendre",
    "chebyshev",
    "tent",
    "ramp",
    "box",
    "bspline",
    "full",
]

LADDER = ("full step", "shorter step", "old tail", "trim")
TUNABLE = (
    "speed_mps",
    "height_agl_m",
    "north_weight",
    "east_weight",
    "altitude_weight",
    "heading_weight",
    "speed_weight",
)
AMPLITUDE = {"thrust": 2e-4, "pitch": 1e-4, "roll": 1e-4, "tail": 1e-5, "heading": 1e-4}  # G, rad


@dataclass(frozen=True)
class MpcParameters:
    """The controller's design."""

    waypoints_m: Annotated[
        tuple[tuple[float, float], ...], "course: north, east of every way-point"
    ] = ((0.0, 0.0), (2000.0, 0.0))
    speed_mps: Annotated[float, Gt(0), "speed to hold, over ground"] = 30.0
    height_agl_m: Annotated[float, Gt(0), "height above ground to hold"] = 10.0
    basis: Annotated[Family, "family of control basis functions"] = "laguerre"
    bases_per_channel: Annotated[int | tuple[int, int, int, int], "functions per channel"] = 5
    laguerre_time: Annotated[
        Literal["seconds", "normalised"], "argument of the Laguerre polynomials"
    ] = "seconds"
    pole_per_s: Annotated[float, Gt(0), "pole of the Laguerre functions"] = 0.5
    horizon_s: Annotated[float, Gt(0), "longest horizon"] = 10.0
    adapt_horizon: Annotated[bool, "shorten the horizon to the terrain sensed"] = True
    horizon_quantum_s: Annotated[float, Gt(0), "horizons are multiples of this"] = 0.5
    north_weight: Annotated[float, Ge(0), "Q on position north"] = 1.0
    east_weight: Annotated[float, Ge(0), "Q on position east"] = 1.0
    altitude_weight: Annotated[float, Ge(0), "omega: Q on altitude"] = 10.0
    heading_weight: Annotated[float, Ge(0), "Q on heading"] = 10.0
    speed_weight: Annotated[float, Ge(0), "Q on speed"] = 1.0
    actuator_weights: Annotated[tuple[float, float, float, float], "R on actuators minus trim"] = (
        0.1,
        1.0,
        1.0,
        1.0,
    )
    command_weights: Annotated[
        tuple[float, float, float, float], "R on set-points minus trim, attitude form"
    ] = (0.0, 0.1, 0.1, 0.1)
    attitude_limit_deg: Annotated[
        float, Interval(gt=0, lt=80), "limit of roll and pitch in a plan"
    ] = 50.0
    clearance_min_m: Annotated[float, Ge(0), "soft limit of the clearance in a plan"] = 5.0
    clearance_penalty: Annotated[
        tuple[float, float], "linear and quadratic weight of the shared slack"
    ] = (2e3, 2e2)
    corridor_m: Annotated[
        float, Ge(0), "half width in which the course may follow the least gradient"
    ] = 0.0
    solver: Annotated[Backend, "solver of the quadratic programme"] = "daqp"
    line_search: Annotated[bool, "search the step length on the nonlinear model"] = True
    passes_at_start: Annotated[int, Ge(1), "passes at the first update, from a cold start"] = 5
    bias_estimate: Annotated[bool, "estimate an acceleration bias (offset-free tracking)"] = True
    compensate_latency: Annotated[bool, "predict to the instant the plan takes effect"] = True
    wind_mps: Annotated[tuple[float, float, float], "known steady wind, north, east, down"] = (
        0.0,
        0.0,
        0.0,
    )
    plan_capacity: Annotated[int, Ge(1), "samples in a plan"] = 200
    scan_capacity: Annotated[int, Ge(1), "cells in a scan's ring"] = 4096


class BasisMpc:
    """Control-basis-function MPC (sampled, 2 Hz).

    Parameters
    ----------
    parameters : MpcParameters
    prediction_model : PredictionModel
        What the response S is identified from.
    latency_s : float
        Between measurement and the plan's effect; compensated by predicting with the samples that are
        committed by then.

    Raises
    ------
    ValueError
        If the horizon exceeds the plan's capacity, the basis does not exist at it, or the way-points
        leave no room for their turns.
    """

    execution = Execution("sampled", 2.0)

    def __init__(
        self,
        parameters: MpcParameters,
        *,
        prediction_model: PredictionModel,
        latency_s: float = 0.0,
    ) -> None:
        self._parameters = parameters
        self._model = prediction_model
        self._period = prediction_model.sample_period
        self._latency = latency_s
        self._late = round(latency_s / self._period)
        self._form: PlanForm = "attitude" if "heading" in prediction_model.commands else "actuator"
        self._channels = CHANNELS[self._form]
        longest = round(parameters.horizon_s / self._period)
        if longest > parameters.plan_capacity:
            raise ValueError(
                f"mpc: horizon longer than a plan, got {parameters.horizon_s:g} s, "
                f"expected up to {parameters.plan_capacity * self._period:g} s"
            )
        self._designs: dict[int, Design] = {}
        self._design(longest)
        self._course = make_course(parameters.waypoints_m, parameters.speed_mps)
        self._path_size = round(parameters.horizon_s * parameters.speed_mps * 0.75) + 40
        self._inputs = {row.name: _start_value(row) for row in self._input_rows()}
        self._reset(0.0)

    # -- contract --------------------------------------------------------------------------------

    def describe(self) -> Any:
        """Return the model description of this instance."""
        rows = [*self._input_rows(), *self._output_rows()]
        rows += parameter_variables(self._parameters, TUNABLE)
        return model_description(
            "BasisMpc",
            "model predictive control with control basis functions",
            rows,
            has_state=True,
        )

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Publish trim; the first plan comes with the first step."""
        del stop_time, seed
        self._reset(start_time)

    def set(self, values: Mapping[str, Any]) -> None:
        """Set inputs and tunable parameters."""
        for name, value in values.items():
            if name in self._inputs:
                self._inputs[name] = np.array(value) if isinstance(value, np.ndarray) else value
            elif name in TUNABLE:
                self._parameters = replace(self._parameters, **{name: float(value)})
            else:
                raise unknown(name, [*self._inputs, *TUNABLE])

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return values of the last update; arrays are copies."""
        found: dict[str, Any] = {}
        for name in names:
            if name in self._outputs:
                value = self._outputs[name]
            elif hasattr(self._parameters, name):
                value = getattr(self._parameters, name)
            else:
                raise unknown(name, self._outputs)
            found[name] = value.copy() if isinstance(value, np.ndarray) else value
        return found

    def step(self, time: float, step_size: float) -> int:
        """Update the plan from the state measured at ``time``; it takes effect a latency later."""
        applied = round(step_size / self._period)
        state = np.array([self._inputs[f"state.{name}"] for name in self._model.states])
        self._sense()
        self._estimate_bias(state)
        start, committed = self._predict_committed(state, time)
        station = self._guidance.locate(state[0], state[1])
        self._guidance.extend(self._map, station, self._parameters)
        H = self._horizon(station)
        u0 = self._shifted(time + self._latency, H, start)
        update, level = self._improve(start, u0, H, state)
        self._publish(time, update, level, station, H)
        velocity = update.Y[[self._model.outputs.index(name) for name in VELOCITY]].T
        self._expected = np.concatenate([committed, velocity])[applied - 1]
        self._elapsed = applied * self._period
        return 0

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next update depends on."""
        return pickle.dumps({name: getattr(self, name) for name in _HIDDEN})

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned."""
        for name, value in pickle.loads(state).items():  # noqa: S301
            setattr(self, name, value)

    # -- one update ------------------------------------------------------------------------------

    def _sense(self) -> None:
        scan = self._inputs
        if self._map is None or self._map.cell_size != scan["scan.cell_size"]:
            self._map = empty_map(scan["scan.cell_size"])
        self._map = read_scan(
            self._map, scan["scan.count"], scan["scan.north"], scan["scan.east"],
            scan["scan.elevation"], scan["scan.source"],
        )  # fmt: skip

    def _estimate_bias(self, state: Floats) -> None:
        """Move the acceleration bias by half of what the last prediction missed in velocity."""
        if self._expected is None or not self._parameters.bias_estimate:
            return
        miss = _velocity(state, self._model.states) - self._expected
        miss[np.abs(miss) < 1e-9] = 0.0  # rounding: a perfect model keeps a bias of exactly zero
        self._bias = np.clip(self._bias + 0.5 * miss / self._elapsed, -4.0, 4.0)

    def _predict_committed(self, state: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the state when the plan takes effect, and the velocities on the way there."""
        if self._late == 0 or not self._parameters.compensate_latency:
            return state, np.empty((0, 3))
        commands = self._plan_from(time, self._late)
        rollout = self._model.rollout(
            state, commands[None], np.array(self._parameters.wind_mps), self._bias
        )
        rows = [self._model.outputs.index(name) for name in VELOCITY]
        return rollout.last[0].copy(), rollout.outputs[0][:, rows]

    def _plan_from(self, time: float, samples: int) -> Floats:
        """Return the samples of the plan in play from an instant on; its last is held."""
        first = round((time - self._plan_start) / self._period)
        index = np.clip(np.arange(first, first + samples), 0, len(self._plan) - 1)
        return self._plan[index]

    def _horizon(self, station: float) -> int:
        parameters = self._parameters
        quantum = round(parameters.horizon_quantum_s / self._period)
        longest = round(parameters.horizon_s / self._period)
        if not parameters.adapt_horizon:
            return longest
        ahead = self._guidance.known_until - station - self._latency * parameters.speed_mps
        samples = int(ahead / parameters.speed_mps / self._period / quantum) * quantum
        return min(max(samples, 4 * quantum), longest)

    def _trim_command(self, heading: Floats) -> Floats:
        """Return the commands (K, 4) that hold level flight along headings (K,)."""
        command = np.tile(self._model.trim(self._parameters.speed_mps)[1], (len(heading), 1))
        if self._form == "attitude":
            command[:, 3] += heading
        return command

    def _shifted(self, start_time: float, H: int, start: Floats) -> Floats:
        """Return the nominal command: the last optimum from now on, its end filled with trim."""
        first = round((start_time - self._plan_start) / self._period)
        kept = max(min(self._plan_horizon - first, H), 0)
        u0 = np.empty((H, 4))
        u0[:kept] = self._plan[first : first + kept]
        turn = self._guidance.headings(start[0], start[1], start[8], H, self._period)
        u0[kept:] = self._trim_command(turn[kept:])
        return u0

    def _improve(self, start: Floats, u0: Floats, H: int, state: Floats) -> tuple[Pass, int]:
        """Return the accepted pass and its rung on the ladder."""
        aim = self._aim(start, H, state)
        passes = self._parameters.passes_at_start if self._sequence == 0 else 1
        design = self._design(H)
        update = optimise(design, start, u0, self._bias, aim)
        fallen = not update.valid
        if fallen:  # the old tail does not fly: start again from trim
            update = optimise(design, start, aim.commands.T.copy(), self._bias, aim)
        for _ in range(passes - 1):
            if update.valid and update.step > 0:
                update = optimise(design, start, update.u, self._bias, aim)
        rung = 0 if update.step == 1.0 else 1 if update.step > 0 else 3 if fallen else 2
        return update, rung

    def _aim(self, start: Floats, H: int, state: Floats) -> Aim:
        parameters = self._parameters
        heading = self._guidance.headings(start[0], start[1], start[8], H, self._period)
        Q = (parameters.north_weight, parameters.east_weight, parameters.altitude_weight,
             parameters.heading_weight, parameters.speed_weight)  # fmt: skip
        Rc = parameters.command_weights if self._form == "attitude" else (0.0, 0.0, 0.0, 0.0)
        return Aim(
            path=self._guidance.path,
            near=self._guidance.locate(start[0], start[1]),
            heading=float(start[8]),
            actuators=self._model.trim(parameters.speed_mps)[2],
            commands=np.ascontiguousarray(self._trim_command(heading).T),
            weights=Weights(Q, parameters.actuator_weights, Rc, np.radians(parameters.attitude_limit_deg),
                            parameters.clearance_min_m, *parameters.clearance_penalty),
            terrain_map=self._map,
        )  # fmt: skip

    def _design(self, H: int) -> Design:
        if H not in self._designs:
            parameters = self._parameters
            counts = parameters.bases_per_channel
            counts = (counts,) * 4 if isinstance(counts, int) else counts
            bases = [
                span_basis(parameters.basis, H, H if parameters.basis == "full" else count,
                           sample_period=self._period, time=parameters.laguerre_time,
                           pole_per_s=parameters.pole_per_s)[0]
                for count in counts
            ]  # fmt: skip
            self._designs[H] = Design(
                model=self._model,
                Phi=stack_bases(bases),
                amplitude=np.array([AMPLITUDE[name] for name in self._channels]),
                wind=np.array(parameters.wind_mps),
                backend=parameters.solver,
                line_search=parameters.line_search,
            )
        return self._designs[H]

    def _publish(self, time: float, update: Pass, rung: int, station: float, H: int) -> None:
        parameters, model = self._parameters, self._model
        tail = self._trim_command(np.full(parameters.plan_capacity - H, 0.0))
        if self._form == "attitude":
            tail[:, 3] = update.u[-1, 3]
        self._plan = np.concatenate([update.u, tail])
        self._plan_start = time + self._latency
        self._plan_horizon = H
        self._sequence += 1
        out = self._outputs
        out["plan.sequence"] = self._sequence
        out["plan.start_time"] = self._plan_start
        for c, name in enumerate(self._channels):
            out[f"plan.{name}"] = self._plan[:, c].copy()
        for name, row, sign in (
            ("north", "north", 1.0),
            ("east", "east", 1.0),
            ("down", "altitude", -1.0),
        ):
            out[f"path.{name}"] = _held(
                sign * update.Y[model.outputs.index(row)], parameters.plan_capacity
            )
        window = self._guidance.window(station - 10.0, self._path_size)
        for name in ("north", "east", "altitude", "heading", "speed"):
            out[f"reference.{name}"] = getattr(window, name)
        solution = update.solution
        out["cost.before"], out["cost.after"], out["cost.linear"] = (
            float(np.nan_to_num(J, posinf=1e12))
            for J in (update.before, update.after, update.linear)
        )
        out["step_length"] = update.step
        out["ladder"] = rung
        out["solver"] = 0 if solution is None else int(solution.status)
        out["iterations"] = 0 if solution is None else solution.iterations
        out["slack"] = update.slack
        out["bias.north"], out["bias.east"], out["bias.down"] = self._bias.tolist()
        out["horizon"] = H * self._period

    # -- variables -------------------------------------------------------------------------------

    def _reset(self, start_time: float) -> None:
        parameters = self._parameters
        self._map: Any = None
        self._guidance = Guidance(self._course)
        self._bias = np.zeros(3)
        self._expected: Floats | None = None
        self._elapsed = 0.0
        self._sequence = 0
        self._plan = self._trim_command(np.full(parameters.plan_capacity, self._course.heading[0]))
        self._plan_start = start_time
        self._plan_horizon = 0
        self._outputs = {row.name: _start_value(row) for row in self._output_rows()}
        for c, name in enumerate(self._channels):
            self._outputs[f"plan.{name}"] = self._plan[:, c].copy()
        self._outputs["plan.start_time"] = start_time
        self._outputs["plan.sample_period"] = self._period

    def _input_rows(self) -> list[Variable]:
        capacity = (self._parameters.scan_capacity,)
        units = dict(zip(self._model.states, _STATE_UNITS, strict=True))
        rows = [Variable(f"state.{n}", "input", u, f"measured {n}") for n, u in units.items()]
        rows += [
            Variable("scan.sequence", "input", "1", "bursts so far", 0, (), "discrete"),
            Variable("scan.count", "input", "1", "cells written so far", 0, (), "discrete"),
            Variable(
                "scan.stamp", "input", "s", "measurement of the newest burst", 0.0, (), "discrete"
            ),
            Variable(
                "scan.cell_size", "input", "m", "spacing of the lattice", 10.0, (), "discrete"
            ),
            Variable("scan.north", "input", "m", "cell position", 0.0, capacity, "discrete"),
            Variable("scan.east", "input", "m", "cell position", 0.0, capacity, "discrete"),
            Variable(
                "scan.elevation",
                "input",
                "m",
                "elevation or upper bound",
                0.0,
                capacity,
                "discrete",
            ),
            Variable(
                "scan.source", "input", "1", "1 seen, 2 shadow bound", 0, capacity, "discrete"
            ),
        ]
        return rows

    def _output_rows(self) -> list[Variable]:
        feed = ("state", "scan")
        capacity, size = (self._parameters.plan_capacity,), (self._path_size,)
        rows = [
            replace(row, depends_on=feed)
            for row in plan_variables(self._channels, capacity[0], "output")
        ]

        def add(name: str, unit: str, meaning: str, shape: tuple[int, ...] = (), start: float = 0.0,
                items: tuple[str, ...] = ()) -> None:  # fmt: skip
            rows.append(
                Variable(
                    name,
                    "output",
                    unit,
                    meaning,
                    start,
                    shape,
                    "discrete",
                    items=items,
                    depends_on=feed,
                )
            )

        for axis in ("north", "east", "down"):
            add(f"path.{axis}", "m", "predicted position", capacity)
        for name, unit in zip(
            ("north", "east", "altitude", "heading", "speed"),
            ("m", "m", "m", "rad", "m/s"),
            strict=True,
        ):
            add(f"reference.{name}", unit, "reference along the course, from a little behind", size)
        for name, meaning in (
            ("before", "of the shifted plan"),
            ("after", "of the accepted plan"),
            ("linear", "as the linear model promised"),
        ):
            add(f"cost.{name}", "1", f"cost {meaning}")
        add("step_length", "1", "accepted step of the line search")
        add("ladder", "1", "how the plan came about", start=0, items=LADDER)
        add(
            "solver",
            "1",
            "status of the quadratic programme",
            start=0,
            items=tuple(s.name.lower() for s in Status),
        )
        add("iterations", "1", "of the solver", start=0)
        add("slack", "m", "clearance missing in the plan")
        for axis in ("north", "east", "down"):
            add(f"bias.{axis}", "m/s2", "estimated acceleration bias")
        add("horizon", "s", "horizon of this update")
        return rows


_STATE_UNITS = (
    ("m",) * 3 + ("m/s",) * 3 + ("rad",) * 3 + ("rad/s",) * 3 + ("rad", "rad", "G", "rad", "rad")
)
_HIDDEN = ("_parameters", "_inputs", "_outputs", "_map", "_guidance", "_bias", "_expected", "_elapsed",
           "_sequence", "_plan", "_plan_start", "_plan_horizon")  # fmt: skip


def _start_value(row: Variable) -> Any:
    return np.full(row.shape, row.start) if row.shape else row.start


def _held(values: Floats, size: int) -> Floats:
    return np.concatenate([values, np.full(size - len(values), values[-1])])


def _velocity(state: Floats, names: Sequence[str]) -> Floats:
    """Return the velocity over ground, NED, of a state in body axes (3-2-1 Euler angles)."""
    u, v, w, phi, theta, psi = (
        float(state[names.index(n)]) for n in ("u", "v", "w", "phi", "theta", "psi")
    )
    s_phi, c_phi, s_th, c_th = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    below = s_phi * v + c_phi * w
    ahead, right = c_th * u + s_th * below, c_phi * v - s_phi * w
    return np.array(
        [
            np.cos(psi) * ahead - np.sin(psi) * right,
            np.sin(psi) * ahead + np.cos(psi) * right,
            c_th * below - s_th * u,
        ]
    )
