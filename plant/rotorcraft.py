"""A configured helicopter: its constants, its compiled rollout, its trim in terms of commands.

Shared by the vehicle that flies and the model that predicts, which is what makes them agree to the
last bit.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from plant import dynamics, kernels, lanes, tangent
from plant.r50 import Bounds, CommandForm, Constants, Preset, constants
from plant.terrain import Terrain, TerrainGrid
from plant.trim import Trim, trim, with_stabiliser

Floats = NDArray[np.float64]

STATES = (
    "north", "east", "down", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r", "a", "b", "thrust",
    "c", "d",
)  # fmt: skip
"""The common state that every plant publishes; the rotor is given by its thrust in G."""
ROTOR = STATES.index("thrust")
COMMANDS: dict[CommandForm, tuple[str, ...]] = {
    "actuator": ("thrust", "pitch", "roll", "tail"),
    "attitude": ("thrust", "pitch", "roll", "heading"),
}
SAMPLE_PERIOD = 0.05  # s, over which a command is held
SET_POINT_LIMIT = np.radians(50.0)  # of pitch and roll set-points

_NO_TERRAIN = TerrainGrid(np.zeros((4, 4)), 0.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True)
class AirframeParameters:
    """Which helicopter."""

    preset: Annotated[Preset, "airframe variant"] = "r50"
    command: Annotated[
        CommandForm, "actuator: the paper, literal; attitude: set-points of the stabiliser"
    ] = "attitude"
    rotor: Annotated[
        Literal["thrust", "collective"],
        "thrust: the input is the thrust itself; collective: blades behind an allocation",
    ] = "thrust"
    bounds: Annotated[Bounds, "actuator limits"] = "paper"
    mass_kg: Annotated[float, Gt(0), "mass; 1 G of command stays the nominal 68 kg weight"] = 68.0
    stabiliser_speed_mps: Annotated[
        float, Ge(0), "speed whose trim the stabiliser holds at zero error"
    ] = 30.0
    torque_feedforward: Annotated[bool, "tail thrust follows main-rotor torque"] = False
    substeps: Annotated[int, Ge(1), "Runge-Kutta steps per 50 ms sample"] = 2


class Rollout(NamedTuple):
    """Trajectories of a batch.

    ``outputs`` (N, H, p): rows named by :data:`plant.lanes.OUTPUTS`; stored so that
    ``outputs.transpose(2, 1, 0)`` is contiguous. ``valid`` (N,). ``last`` (N, 17): the common state
    at the end.
    """

    outputs: Floats
    valid: NDArray[np.bool_]
    last: Floats


class Linearisation(NamedTuple):
    """The tangent of the map over one sample, along a trajectory of H samples.

    ``nominal`` (p, H): the outputs, as a rollout has them. ``slopes`` (H, 17 + p, 21): at each sample
    the block matrix [A B; C D], by which a change [dx, du] of state and command at its start becomes
    one of the state at its end and of the outputs. The states are the plant's own: the collective
    plant has the induced velocity in place of the thrust. ``valid``: the trajectory is.
    """

    nominal: Floats
    slopes: Floats
    valid: bool


class Rotorcraft(NamedTuple):
    """A helicopter ready to roll out; ``constants`` is ``p`` as an array, for the kernels."""

    p: Constants
    constants: Floats
    collective: bool
    attitude: bool
    substeps: int
    grid: TerrainGrid
    over_terrain: bool

    def trim(self, speed: float) -> Trim:
        """Return level flight at ``speed`` m/s heading north: common state, actuators."""
        return trim(speed, self.p)

    def trim_command(self, level: Trim) -> Floats:
        """Return the command, (4,), that holds a trim heading north."""
        thrust, a_c, b_c, tail = level.actuators
        if not self.attitude:
            return np.array([thrust, a_c, b_c, tail])
        p = self.p
        return np.array(
            [
                thrust,
                level.state[7] + (a_c - p.a_trim) / p.K_theta,
                level.state[6] + (b_c - p.b_trim) / p.K_phi,
                (tail - p.tail_trim) / p.K_psi,
            ]
        )

    def own_state(self, common: Floats) -> Floats:
        """Return the plant's own state from the common one: thrust becomes steady induced velocity."""
        own = np.array(common, dtype=np.float64)
        if self.collective:
            p = self.p
            for row in np.atleast_2d(own):
                x = tuple(row.tolist())
                flow = dynamics.hub_flow(x, x[3:6], p)
                row[ROTOR] = dynamics.inflow(p.weight * max(x[ROTOR], 0.0), flow[7], flow[6], p)
        return own

    def common_state(self, own: Floats, commands: Floats, wind: Floats) -> Floats:
        """Return the common states of own ones (N, 17) under commands (N, 4): the rotor's thrust, G."""
        common = own.copy()
        air = np.ascontiguousarray(wind, dtype=np.float64)
        for x, u in zip(common, commands, strict=True):
            x[ROTOR] = kernels.readings(
                x, u, air, self.over_terrain, self.grid, self.constants, self.collective
            )[1]
        return common

    def roll(self, own: Floats, commands: Floats, wind: Floats, bias: Floats) -> Rollout:
        """Roll out own states (N, 17) under commands (N, H, 4); ``last`` holds own states.

        The kernel is one, of one type of arrays, so that equal inputs give equal bits.
        """
        N, H, _ = commands.shape
        lanes_used = -(-N // lanes.LANES) * lanes.LANES
        if lanes_used != N:
            filled = np.minimum(np.arange(lanes_used), N - 1)  # copies of the last
            own, commands = own[filled], commands[filled]
        out = np.empty((len(lanes.OUTPUTS), H, lanes_used))
        last = np.empty((lanes_used, len(STATES)))
        valid = np.empty(lanes_used, dtype=np.bool_)
        kernel = kernels.roll_collective if self.collective else kernels.roll_thrust
        kernel(
            np.ascontiguousarray(own, dtype=np.float64),
            np.ascontiguousarray(commands, dtype=np.float64),
            np.ascontiguousarray(wind, dtype=np.float64),
            np.ascontiguousarray(bias, dtype=np.float64),
            self.constants,
            SAMPLE_PERIOD / self.substeps,
            self.substeps,
            self.over_terrain,
            self.grid,
            out,
            last,
            valid,
        )
        return Rollout(out.transpose(2, 1, 0)[:N], valid[:N], last[:N])

    def linearise(self, own: Floats, commands: Floats, wind: Floats, bias: Floats) -> Linearisation:
        """Return the tangent along the trajectory from an own state (17,) under commands (H, 4)."""
        nominal = np.empty((len(lanes.OUTPUTS), len(commands)))
        slopes = np.empty((len(commands), tangent.CHANGED, tangent.MOVED))
        valid = np.empty(1, dtype=np.bool_)
        kernel = kernels.walk_collective if self.collective else kernels.walk_thrust
        kernel(
            np.ascontiguousarray(own, dtype=np.float64),
            np.ascontiguousarray(commands, dtype=np.float64),
            np.ascontiguousarray(wind, dtype=np.float64),
            np.ascontiguousarray(bias, dtype=np.float64),
            self.constants,
            SAMPLE_PERIOD / self.substeps,
            self.substeps,
            self.over_terrain,
            self.grid,
            nominal,
            slopes,
            valid,
        )
        return Linearisation(nominal, slopes, bool(valid[0]))


def rotorcraft(parameters: AirframeParameters, terrain: Terrain | None = None) -> Rotorcraft:
    """Return the helicopter that the parameters describe, over a terrain or over none."""
    nominal = _nominal(parameters.preset, parameters.bounds, parameters.command,
                       parameters.stabiliser_speed_mps)  # fmt: skip
    p = nominal._replace(mass=parameters.mass_kg, TQFF=float(parameters.torque_feedforward))
    if parameters.rotor == "collective":
        p = p._replace(CT_sigma_max=min(p.CT_sigma_max, 0.16))
    return Rotorcraft(
        p,
        constants=np.array(p),
        collective=parameters.rotor == "collective",
        attitude=parameters.command == "attitude",
        substeps=parameters.substeps,
        grid=_NO_TERRAIN if terrain is None else terrain.grid,
        over_terrain=terrain is not None,
    )


@lru_cache(maxsize=64)
def _nominal(preset: Preset, bounds: Bounds, command: CommandForm, speed: float) -> Constants:
    p = constants(preset, bounds)
    return with_stabiliser(p, speed) if command == "attitude" else p
