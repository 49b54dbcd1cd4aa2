"""The discrete map's tangent along a trajectory, sample by sample, in the lanes of the rollouts.

Over one sample ``(x, u) -> (x', y)``, where x' is the state at its end and y its outputs, each at the
instant that :data:`plant.lanes.OUTPUTS` says. At every sample of a nominal trajectory one batch of
one-sample rollouts starts from x and u as they are and with every state and command in turn moved up
and down. The first lane is the nominal trajectory, flown by the same compiled rollout as everything
else: its bits are those of a rollout.

Plain Python as it stands; :mod:`plant.kernels` compiles it once per plant, with ``roll`` bound to that
plant's.
"""

# pyright: basic
# bound to arrays or scalars by the compiler: untyped on purpose

import numpy as np

from plant.lanes import COMMANDS, LANES, OUTPUTS, STATES, roll

MOVED = STATES + COMMANDS
_TAKEN = -(-(1 + 2 * MOVED) // LANES) * LANES
_ROWS = len(OUTPUTS)
CHANGED = STATES + _ROWS
# the differences' own error: a step's square times curvature, and rounding (of 10 km) over the step
_STEP_NORTH_EAST_DOWN = 1e-3  # m
_STEP_VELOCITY = 1e-4  # m/s
_STEP = 1e-5  # rad, rad/s, G, and the induced velocity in m/s


def _step(i):
    if i < 3:
        return _STEP_NORTH_EAST_DOWN
    return _STEP_VELOCITY if i < 6 else _STEP


def walk(x0, commands, wind, bias, p, h, substeps, ground, terrain, nominal, slopes, valid):
    """Write the nominal trajectory's outputs and the tangent at each of its H samples.

    Parameters
    ----------
    x0 : (17,)
        State at the start.
    commands : (H, 4)
        Held over each sample.
    wind, bias, p, h, substeps, ground, terrain
        As ``roll`` takes them.
    nominal : (14, H)
        Written: rows of :data:`plant.lanes.OUTPUTS`.
    slopes : (H, 31, 21)
        Written: derivatives of the 17 states at a sample's end and of its 14 outputs, by the 17 states
        at its start and the 4 commands. Central differences.
    valid : (1,) bool
        Written: whether the nominal trajectory is.
    """
    x = np.empty((_TAKEN, STATES))
    u = np.empty((_TAKEN, 1, COMMANDS))
    out = np.empty((_ROWS, 1, _TAKEN))
    last = np.empty((_TAKEN, STATES))
    flew = np.empty(_TAKEN, np.bool_)
    now = x0.copy()
    valid[0] = True
    for k in range(commands.shape[0]):
        for l in range(_TAKEN):
            x[l] = now
            u[l, 0] = commands[k]
        for i in range(STATES):
            x[1 + 2 * i, i] += _step(i)
            x[2 + 2 * i, i] -= _step(i)
        for i in range(COMMANDS):
            u[1 + 2 * (STATES + i), 0, i] += _STEP
            u[2 + 2 * (STATES + i), 0, i] -= _STEP
        roll(x, u, wind, bias, p, h, substeps, ground, terrain, out, last, flew)
        for j in range(MOVED):
            up, down = 1 + 2 * j, 2 + 2 * j
            step = 2.0 * _STEP
            if j < STATES:  # as the sum was rounded
                step = x[up, j] - x[down, j]
            for i in range(STATES):
                slopes[k, i, j] = (last[up, i] - last[down, i]) / step
            for i in range(_ROWS):
                slopes[k, STATES + i, j] = (out[i, 0, up] - out[i, 0, down]) / step
        for i in range(_ROWS):
            nominal[i, k] = out[i, 0, 0]
        for i in range(STATES):
            now[i] = last[0, i]
        valid[0] &= flew[0]
