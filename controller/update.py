"""One update of the MPC, from what it remembers to what it will remember.

Take in the terrain sensed, carry the reference on, predict to the instant the plan takes effect, shift
the last optimum, improve it, and step down the ladder where that fails.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.course import Course
from controller.optimise import VELOCITY, Aim, Improve, Pass
from controller.parameters import MpcParameters, reference_parameters, weights
from controller.prediction import PredictionModel
from controller.reference import Reference, extend, project, sample, start
from controller.terrain_map import TerrainMap
from controller.tracking import advance, on_branch

Floats = NDArray[np.float64]
LADDER = ("full step", "shorter step", "old tail", "trim")
BIAS_GAIN = 0.5
BIAS_LIMIT = 4.0  # m/s2


class Plan(NamedTuple):
    """Commands (capacity, 4) from ``start`` s on; the first ``horizon`` are optimised, then trim."""

    sequence: int
    start: float
    horizon: int
    commands: Floats


@dataclass(frozen=True)
class Memory:
    """What one update leaves to the next.

    ``committed`` (late, 4) are the commands from the update until ``plan`` takes effect.
    ``expected`` is the velocity, m/s NED, predicted for the next update, which is ``elapsed`` s on;
    ``bias`` the acceleration bias, m/s2 NED; ``station`` where the aircraft is along the reference;
    ``shadow`` the state of a model that takes no measured one, at the last update; ``carry`` what the
    planner left for the next.
    """

    plan: Plan
    bias: Floats
    committed: Floats = field(default_factory=lambda: np.empty((0, 4)))
    terrain_map: TerrainMap | None = None
    reference: Reference | None = None
    station: float = 0.0
    expected: Floats | None = None
    elapsed: float = 0.0
    shadow: bytes | None = None
    carry: Floats | None = None


@dataclass(frozen=True)
class Task:
    """What stays the same: model, course, and for every horizon how a plan is improved."""

    model: PredictionModel
    course: Course
    planner: Callable[[int], Improve]

    @property
    def attitude_form(self) -> bool:
        """Whether the fourth command is a heading."""
        return "heading" in self.model.commands


def trim_commands(task: Task, speed: float, heading: Floats) -> Floats:
    """Return the commands (K, 4) that hold level flight along headings (K,)."""
    command = np.tile(task.model.trim(speed)[1], (len(heading), 1))
    if task.attitude_form:
        command[:, 3] += heading
    return command


def update(
    task: Task,
    p: MpcParameters,
    memory: Memory,
    state: Floats,
    time: float,
    late: int,
    applied: int,
) -> tuple[Memory, Pass | None, int]:
    """Return the new memory, the accepted pass and its rung on the ladder.

    Where the state is not finite there is nothing to plan from: the pass is None and the memory's
    plan goes on.

    Parameters
    ----------
    memory : Memory
        With the terrain map already brought up to date.
    state : (n,)
        Measured at ``time``, s.
    late : int
        Samples until the plan takes effect.
    applied : int
        Samples until the next update.
    """
    period = task.model.sample_period
    nothing = replace(memory, expected=None), None, LADDER.index("old tail")
    if not np.isfinite(state).all():
        return nothing
    memory = replace(
        memory,
        shadow=_shadow(task, p, memory, time),
        bias=_bias(p, memory, velocity(state, task.model.states)),
    )
    begin, committed, on_the_way = _at_effect(task, p, memory, state, time, late)
    if not np.isfinite(begin).all():
        return nothing
    memory = _carry_on(task, p, memory, state)
    H = _horizon(p, memory, period, late)
    elapsed = _flown(task, memory, time) * period
    aim = _aim(task, p, memory, begin, H, elapsed)
    effective = time + late * period
    best, rung = _improve(task, p, memory, begin, effective, H, aim)
    tail = trim_commands(task, p.speed_mps, np.zeros(p.plan_capacity - H))
    if task.attitude_form:
        tail[:, 3] = best.u[-1, 3]
    plan = Plan(memory.plan.sequence + 1, effective, H, np.concatenate([best.u, tail]))
    velocities = np.concatenate([on_the_way, best.Y[_velocity_rows(task)].T])
    memory = replace(
        memory,
        plan=plan,
        committed=committed,
        expected=velocities[applied - 1] if best.valid else None,
        elapsed=applied * period,
        carry=best.carry,
    )
    return memory, best, rung


def _velocity_rows(task: Task) -> list[int]:
    return [task.model.outputs.index(name) for name in VELOCITY]


def _bias(p: MpcParameters, memory: Memory, measured: Floats) -> Floats:
    """Return the acceleration bias, moved by half of what the last prediction missed in velocity."""
    if memory.expected is None or not p.bias_estimate:
        return memory.bias
    miss = measured - memory.expected
    miss[np.abs(miss) < 1e-9] = 0.0  # rounding: a perfect model keeps a bias of exactly zero
    return np.clip(memory.bias + BIAS_GAIN * miss / memory.elapsed, -BIAS_LIMIT, BIAS_LIMIT)


def _at_effect(
    task: Task, p: MpcParameters, memory: Memory, state: Floats, time: float, late: int
) -> tuple[Floats, Floats, Floats]:
    """Return the state when the plan takes effect, the samples (late, 4) and velocities until then.

    Those samples are committed: what was so before the last plan, and then that plan's.
    """
    flown = _flown(task, memory, time)
    committed = _known(memory, flown, flown + late)
    if late == 0 or not p.compensate_latency:
        return state, committed, np.empty((0, 3))
    rollout = task.model.rollout(state, committed[None], np.array(p.wind_mps), memory.bias)
    return rollout.last[0].copy(), committed, rollout.outputs[0][:, _velocity_rows(task)]


def _flown(task: Task, memory: Memory, time: float) -> int:
    """Return how many samples have been flown since the last update."""
    since = round((time - memory.plan.start) / task.model.sample_period)
    return len(memory.committed) + since


def _known(memory: Memory, first: int, end: int) -> Floats:
    """Return the commands of samples since the last update, (end - first, 4)."""
    known = np.concatenate([memory.committed, memory.plan.commands])
    return known[np.clip(np.arange(first, end), 0, len(known) - 1)]


def _shadow(task: Task, p: MpcParameters, memory: Memory, time: float) -> bytes | None:
    """Bring a model that takes no measured state up to now, by what has been flown."""
    follow = getattr(task.model, "follow", None)
    if follow is None:
        return None
    flown = _known(memory, 0, _flown(task, memory, time))
    return follow(memory.shadow, flown, np.array(p.wind_mps), memory.bias)


def _carry_on(task: Task, p: MpcParameters, memory: Memory, state: Floats) -> Memory:
    """Continue the reference over what was sensed; it never moves to the aircraft."""
    north, east, down = state[:3].tolist()
    course, shape = task.course, reference_parameters(p)
    assert memory.terrain_map is not None
    if memory.reference is None:
        nearest = np.argmin(np.hypot(course.north - north, course.east - east))
        station = course.first + float(nearest)
        reference = start(course, memory.terrain_map, shape, altitude=-down, station=station)
    else:
        station = memory.station
        reference = extend(memory.reference, memory.terrain_map, station, shape)
    station = project(reference.path, north, east, station)
    return replace(memory, reference=reference, station=station)


def _horizon(p: MpcParameters, memory: Memory, period: float, late: int) -> int:
    """Return min(longest horizon, sensed range / speed) in samples, quantised."""
    longest = round(p.horizon_s / period)
    if not p.adapt_horizon:
        return longest
    assert memory.reference is not None
    quantum = round(p.horizon_quantum_s / period)
    ahead = (memory.reference.known_until - memory.station) / p.speed_mps - late * period
    return min(max(int(ahead / period / quantum) * quantum, 4 * quantum), longest)


def _aim(
    task: Task, p: MpcParameters, memory: Memory, begin: Floats, H: int, elapsed: float
) -> Aim:
    """Return what the update wants; R pulls to trim, Rc to trim along the reference's heading."""
    assert memory.reference is not None
    assert memory.terrain_map is not None
    path = memory.reference.path
    station = project(path, float(begin[0]), float(begin[1]), memory.station)
    along = advance(path, station, task.model.sample_period, H)
    heading = on_branch(sample(memory.reference, along).heading, float(begin[8]))
    turn = float(np.radians(p.heading_set_point_limit_deg)) if task.attitude_form else np.inf
    return Aim(
        path=path,
        near=station,
        heading=float(begin[8]),
        actuators=task.model.trim(p.speed_mps)[2],
        commands=np.ascontiguousarray(trim_commands(task, p.speed_mps, heading).T),
        reach=np.array([np.inf, np.inf, np.inf, turn]),
        weights=weights(p, attitude_form=task.attitude_form),
        terrain_map=memory.terrain_map,
        height=p.height_agl_m,
        elapsed=elapsed,
        carry=memory.carry,
    )


def _improve(
    task: Task, p: MpcParameters, memory: Memory, begin: Floats, effective: float, H: int, aim: Aim
) -> tuple[Pass, int]:
    """Improve the last optimum, shifted to now and its end filled with trim.

    The ladder is deterministic work: full step, shorter step, the old plan's tail, and trim where
    not even that flies.
    """
    plan, improve = memory.plan, task.planner(H)
    first = round((effective - plan.start) / task.model.sample_period)
    kept = min(max(plan.horizon - first, 0), H)
    trim = aim.commands.T
    shifted = np.concatenate([plan.commands[first : first + kept], trim[kept:]])
    best = improve(begin, shifted, memory.bias, aim)
    fallen = not best.valid
    if fallen:
        best = improve(begin, trim.copy(), memory.bias, aim)
    if plan.sequence == 0:
        for _ in range(p.passes_at_start - 1):
            if best.valid and best.step > 0:
                best = improve(begin, best.u, memory.bias, aim)
    if best.step > 0:
        return best, 0 if best.step == 1.0 else 1
    return best, 3 if fallen else 2


def velocity(state: Floats, names: tuple[str, ...]) -> Floats:
    """Return the velocity over ground, NED, of a state in body axes (3-2-1 Euler angles)."""
    u, v, w, phi, theta, psi = (
        float(state[names.index(name)]) for name in ("u", "v", "w", "phi", "theta", "psi")
    )
    s_phi, c_phi, s_th, c_th = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    below = s_phi * v + c_phi * w
    ahead, right = c_th * u + s_th * below, c_phi * v - s_phi * w
    return np.array(
        [
            math.cos(psi) * ahead - math.sin(psi) * right,
            math.sin(psi) * ahead + math.cos(psi) * right,
            c_th * below - s_th * u,
        ]
    )
