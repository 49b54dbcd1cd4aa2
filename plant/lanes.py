"""Rollouts in lanes: many trajectories advance together, eight to a block.

The loop over the lanes of a block is innermost and its body is the straight-line
:mod:`plant.dynamics`; every operand lies in one flat buffer at a constant offset. That is what LLVM
needs to vectorise it. The vehicle flies one lane of the same kernel as the predictions, so equal
inputs give equal bits.

Plain Python as it stands; :mod:`plant.kernels` compiles it once per plant, with ``derivative`` bound
to that plant's.
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

import numpy as np

from plant.dynamics import (
    FLAP_STOP,
    NO_GROUND,
    actuators,
    clip,
    derivative,
)
from plant.elementary import sincos, sqrt, wide
from plant.terrain import height

STATES = 17
COMMANDS = 4
LANES = 8
OUTPUTS = (
    "north", "east", "altitude", "heading", "speed", "roll", "pitch",
    "velocity_north", "velocity_east", "velocity_down",
    "actuator_thrust", "actuator_pitch", "actuator_roll", "actuator_tail",
)  # fmt: skip
"""Rows of a rollout. The first ten hold at the end of a sample, the actuators at its start."""
ATTITUDE_LIMIT = 1.3962634015954636  # rad, 80 degrees: beyond it a trajectory is invalid

# offsets of the rows in a block's buffer
_S = STATES * LANES  # state at the Runge-Kutta stage; the state itself is at 0
_K = 2 * STATES * LANES  # weighted sum of the stages' rates
_U = 3 * STATES * LANES  # command
_G = _U + COMMANDS * LANES  # ground elevation
_SIZE = _G + LANES


def _state(w, at):
    L = LANES
    return (
        w[at], w[at + L], w[at + 2 * L], w[at + 3 * L], w[at + 4 * L], w[at + 5 * L],
        w[at + 6 * L], w[at + 7 * L], w[at + 8 * L], w[at + 9 * L], w[at + 10 * L],
        w[at + 11 * L], w[at + 12 * L], w[at + 13 * L], w[at + 14 * L], w[at + 15 * L],
        w[at + 16 * L],
    )  # fmt: skip


def _command(w, l):
    return w[_U + l], w[_U + LANES + l], w[_U + 2 * LANES + l], w[_U + 3 * LANES + l]


def _accumulate(w, i, l, rate, step, weight):
    at = i * LANES + l
    w[_K + at] += weight * rate
    w[_S + at] = w[at] + step * rate


def _stage(w, wind, bias, p, step, weight):
    """Do one Runge-Kutta stage for all lanes: K += weight f(S), then S = X + step f(S)."""
    wide()
    for l in range(LANES):
        f = derivative(_state(w, _S + l), _command(w, l), wind, w[_G + l], bias, p)
        _accumulate(w, 0, l, f[0], step, weight)
        _accumulate(w, 1, l, f[1], step, weight)
        _accumulate(w, 2, l, f[2], step, weight)
        _accumulate(w, 3, l, f[3], step, weight)
        _accumulate(w, 4, l, f[4], step, weight)
        _accumulate(w, 5, l, f[5], step, weight)
        _accumulate(w, 6, l, f[6], step, weight)
        _accumulate(w, 7, l, f[7], step, weight)
        _accumulate(w, 8, l, f[8], step, weight)
        _accumulate(w, 9, l, f[9], step, weight)
        _accumulate(w, 10, l, f[10], step, weight)
        _accumulate(w, 11, l, f[11], step, weight)
        _accumulate(w, 12, l, f[12], step, weight)
        _accumulate(w, 13, l, f[13], step, weight)
        _accumulate(w, 14, l, f[14], step, weight)
        _accumulate(w, 15, l, f[15], step, weight)
        _accumulate(w, 16, l, f[16], step, weight)


def advance(w, wind, bias, p, h):
    """Advance the block by one classical Runge-Kutta step of h seconds.

    The flapping angles stop at :data:`FLAP_STOP`: without it they wind up past 90 degrees.
    """
    wide()
    for i in range(STATES * LANES):
        w[_S + i] = w[i]
        w[_K + i] = 0.0
    _stage(w, wind, bias, p, 0.5 * h, 1.0)
    _stage(w, wind, bias, p, 0.5 * h, 2.0)
    _stage(w, wind, bias, p, h, 2.0)
    _stage(w, wind, bias, p, 0.0, 1.0)
    for i in range(STATES * LANES):
        w[i] += h / 6.0 * w[_K + i]
    for i in range(12 * LANES, 14 * LANES):
        w[i] = clip(w[i], -FLAP_STOP, FLAP_STOP)


def _record(w, k, block, out):
    """Write the rows that hold at the end of sample k."""
    wide()
    for l in range(LANES):
        x = _state(w, l)
        s_phi, c_phi = sincos(x[6])
        s_th, c_th = sincos(x[7])
        s_psi, c_psi = sincos(x[8])
        ahead = c_th * x[3] + s_th * (s_phi * x[4] + c_phi * x[5])
        right = c_phi * x[4] - s_phi * x[5]
        n = block + l
        out[0, k, n] = x[0]
        out[1, k, n] = x[1]
        out[2, k, n] = -x[2]
        out[3, k, n] = x[8]
        out[4, k, n] = sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
        out[5, k, n] = x[6]
        out[6, k, n] = x[7]
        out[7, k, n] = c_psi * ahead - s_psi * right
        out[8, k, n] = s_psi * ahead + c_psi * right
        out[9, k, n] = c_th * (s_phi * x[4] + c_phi * x[5]) - s_th * x[3]


def roll(x0, commands, wind, bias, p, h, substeps, ground, terrain, out, last, valid):
    """Roll out N trajectories (a multiple of :data:`LANES`) of H samples.

    Parameters
    ----------
    x0 : (N, 17)
        States at the start.
    commands : (N, H, 4)
        Held over each sample.
    wind, bias : tuples of 3
        As :func:`plant.dynamics.derivative`.
    h, substeps
        Step, s, and steps per sample.
    ground : bool
        Whether ``terrain`` (a :class:`plant.terrain.TerrainGrid`) is below; its elevation is held
        over each sample, and a trajectory that leaves it becomes invalid. Else no ground effect.
    out : (14, H, N)
        Written: rows of :data:`OUTPUTS`.
    last : (N, 17)
        Written: states at the end.
    valid : (N,) bool
        Written: finite, within :data:`ATTITUDE_LIMIT`, over known terrain.
    """
    wide()
    w = np.zeros(_SIZE)
    for block in range(0, x0.shape[0], LANES):
        for l in range(LANES):
            valid[block + l] = True
            w[_G + l] = NO_GROUND
            for i in range(STATES):
                w[i * LANES + l] = x0[block + l, i]
        for k in range(commands.shape[1]):
            for l in range(LANES):
                for i in range(COMMANDS):
                    w[_U + i * LANES + l] = commands[block + l, k, i]
                if ground:
                    z = height(terrain, w[l], w[LANES + l])
                    known = not np.isnan(z)
                    w[_G + l] = z if known else NO_GROUND
                    valid[block + l] &= known
            for l in range(LANES):
                thrust, pitch, roll_, tail = actuators(_state(w, l), _command(w, l), p)
                out[10, k, block + l] = thrust
                out[11, k, block + l] = pitch
                out[12, k, block + l] = roll_
                out[13, k, block + l] = tail
            for _ in range(substeps):
                advance(w, wind, bias, p, h)
            _record(w, k, block, out)
            for l in range(LANES):
                phi = w[6 * LANES + l]
                theta = w[7 * LANES + l]
                north = w[l]
                level = (abs(phi) < ATTITUDE_LIMIT) & (abs(theta) < ATTITUDE_LIMIT)
                valid[block + l] &= level & (abs(north) < 1e9)
        for l in range(LANES):
            for i in range(STATES):
                last[block + l, i] = w[i * LANES + l]
