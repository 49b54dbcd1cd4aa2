"""What the controller asks of a prediction model, and the linear response identified from it."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Rollout(Protocol):
    """Trajectories of a batch of N.

    ``outputs`` (N, H, p), ``valid`` (N,), ``last`` (N, n): the states at the end.
    """

    @property
    def outputs(self) -> Floats: ...  # noqa: D102
    @property
    def valid(self) -> NDArray[np.bool_]: ...  # noqa: D102
    @property
    def last(self) -> Floats: ...  # noqa: D102


class PredictionModel(Protocol):
    """A model that rolls out batches; black box, no derivatives.

    ``outputs`` must contain north, east, altitude (m), heading (unwrapped), roll, pitch (rad), speed
    and velocity_north, _east, _down (m/s), all at the *end* of a sample, and actuator_thrust,
    _pitch, _roll, _tail at its *start*. ``commands`` are thrust, pitch, roll and tail or heading.
    """

    states: tuple[str, ...]
    commands: tuple[str, ...]
    outputs: tuple[str, ...]
    command_min: Floats
    command_max: Floats
    actuator_min: Floats
    actuator_max: Floats
    sample_period: float

    def trim(self, speed: float) -> tuple[Floats, Floats, Floats]:
        """Return state (n,), command (m,) and actuators (4,) of level flight north at a speed, m/s."""
        ...

    def rollout(self, state: Floats, commands: Floats, wind: Floats, bias: Floats) -> Rollout:
        """Predict from (n,) or (N, n) under commands (N, H, m), wind (3,) and bias (3,)."""
        ...


class Response(NamedTuple):
    """The perturbation model y = y0 + S alpha (section II.D).

    ``nominal`` (p, H); ``S`` (p, H, m), in the order of the channels and their functions;
    ``Phi`` (4, H, m): the commands' own response, u = u0 + Phi alpha; ``valid``: the nominal is.
    """

    nominal: Floats
    S: Floats
    Phi: Floats
    valid: bool


def stack_bases(bases: Sequence[Floats]) -> Floats:
    """Return Phi, (channels, H, m): channel c answers its own coefficients only (block diagonal)."""
    H = bases[0].shape[0]
    Phi = np.zeros((len(bases), H, sum(B.shape[1] for B in bases)))
    column = 0
    for channel, B in enumerate(bases):
        Phi[channel, :, column : column + B.shape[1]] = B
        column += B.shape[1]
    return Phi


def identify(
    model: PredictionModel,
    state: Floats,
    u0: Floats,
    Phi: Floats,
    amplitude: Floats,
    wind: Floats,
    bias: Floats,
) -> Response:
    """Identify S by one batch of perturbed rollouts, each basis function on each channel in turn.

    One-sided differences of *tiny* perturbations along orthonormal columns: their error is below
    1e-4 of S, whereas the unit perturbation that the paper writes (alpha = [1, 0, 0, 0, 0], 1 G or
    1 rad) makes rollouts diverge.

    Parameters
    ----------
    state : (n,)
        Start.
    u0 : (H, 4)
        Nominal command.
    Phi : (4, H, m)
        Columns of unit RMS, :func:`stack_bases`.
    amplitude : (4,)
        Perturbation per channel, in its unit.
    wind, bias : (3,)
        Air velocity, m/s, and acceleration bias, m/s2.
    """
    delta = Phi * amplitude[:, None, None]
    commands = np.concatenate([u0[None], u0[None] + delta.transpose(2, 1, 0)])
    rollout = model.rollout(state, commands, wind, bias)
    Y = rollout.outputs.transpose(2, 1, 0)
    scale = 1.0 / (Phi.any(axis=1).T @ amplitude)
    S = (Y[:, :, 1:] - Y[:, :, :1]) * scale
    return Response(np.ascontiguousarray(Y[:, :, 0]), S, Phi, bool(rollout.valid.all()))
