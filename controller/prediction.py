"""What the controller asks of a prediction model, and the linear response identified from it."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from controller.jit import kernel
from controller.recursion import propagate

Floats = NDArray[np.float64]
Identification = Literal["rollouts", "recursion"]


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


class Linearisation(Protocol):
    """The tangent of each sample along a nominal trajectory.

    ``nominal`` (p, H): its outputs, equal to a rollout's. ``slopes`` (H, n + p, n + 4): [A B; C D] of
    each sample, by which a change [dx, du] of state and command at its start becomes one of the state
    at its end and of the outputs. ``valid``: the trajectory is.
    """

    @property
    def nominal(self) -> Floats: ...  # noqa: D102
    @property
    def slopes(self) -> Floats: ...  # noqa: D102
    @property
    def valid(self) -> bool: ...  # noqa: D102


class PredictionModel(Protocol):
    """A model that rolls out batches; black box, no derivatives.

    It may have four methods more, or None in their place. ``response(state, u0, Phi, wind, bias)``
    returns nominal, S of all outputs and whether they are valid, as :func:`identify` else finds by
    perturbations. ``linearise(state, commands, wind, bias)`` returns a :class:`Linearisation` under
    commands (H, 4), for identification by recursion. ``follow(before, commands, wind, bias)`` is for
    a model that takes no measured state: it returns its own (bytes) after the commands (K, 4) flown
    since it was ``before`` (None: at the start), and the next rollouts begin there. ``symbolic()``,
    which only optimal control needs, returns CasADi functions of one sample,
    ``advance(x, u, wind, bias) -> x_end`` and ``outputs(x, u, x_end) -> y``.

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

    ``nominal`` (p, H) and ``S`` (r, H, m) of the outputs asked for, columns in the order of the
    channels and their functions; ``Phi`` (4, H, m): the commands' own response, u = u0 + Phi alpha;
    ``valid``: all rollouts were, and all is finite.
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


@kernel
def _differences(Y: Floats, rows: NDArray[np.int64], scale: Floats, S: Floats) -> bool:
    """Write S[i, k, j] = (Y[row i, k, j + 1] - Y[row i, k, 0]) scale[j]; return whether finite."""
    total = 0.0
    for i in range(S.shape[0]):
        for k in range(S.shape[1]):
            nominal = Y[rows[i], k, 0]
            for j in range(S.shape[2]):
                S[i, k, j] = (Y[rows[i], k, j + 1] - nominal) * scale[j]
                total += S[i, k, j]
            total += nominal
    return bool(np.isfinite(total))


def identify(
    model: PredictionModel,
    state: Floats,
    u0: Floats,
    Phi: Floats,
    amplitude: Floats,
    wind: Floats,
    bias: Floats,
    rows: NDArray[np.int64] | None = None,
    *,
    by: Identification = "rollouts",
) -> Response:
    """Identify S, by perturbed rollouts or by recursion along the nominal one.

    By rollouts: one batch, each basis function in turn. One-sided differences of *tiny* perturbations
    along orthonormal columns: their error is below 1e-4 of S, whereas the unit perturbation that the
    paper writes (alpha = [1, 0, 0, 0, 0], 1 G or 1 rad) makes rollouts diverge. A model that knows its
    own response is asked for that instead.

    By recursion: :func:`controller.recursion.propagate` with the model's own tangent.

    Parameters
    ----------
    state : (n,)
        Start.
    u0 : (H, 4)
        Nominal command.
    Phi : (4, H, m)
        Columns of unit RMS, :func:`stack_bases`.
    amplitude : (4,)
        Perturbation per channel, in its unit; a column that acts on several is perturbed along itself,
        by the smallest of theirs.
    wind, bias : (3,)
        Air velocity, m/s, and acceleration bias, m/s2.
    rows : (r,), optional
        Which of the model's outputs S is of; all by default.
    by : {"rollouts", "recursion"}
        Recursion needs a model with ``linearise``.
    """
    rows = np.arange(len(model.outputs)) if rows is None else rows
    if by == "recursion":
        along = linearise_of(model)(state, u0, wind, bias)
        S = propagate(along.slopes, Phi, rows)
        finite = np.isfinite(along.nominal).all() and np.isfinite(S).all()
        return Response(along.nominal, S, Phi, along.valid and bool(finite))
    exact = getattr(model, "response", None)
    if exact is not None:
        nominal, S, valid = exact(state, u0, Phi, wind, bias)
        return Response(nominal, S[rows], Phi, valid)
    size = np.where(Phi.any(axis=1), amplitude[:, None], np.inf).min(axis=0)
    commands = np.concatenate([u0[None], u0[None] + (Phi * size).transpose(2, 1, 0)])
    rollout = model.rollout(state, commands, wind, bias)
    Y = rollout.outputs.transpose(2, 1, 0)
    S = np.empty((len(rows), *Phi.shape[1:]))
    finite = _differences(Y, rows, 1.0 / size, S)
    nominal = np.ascontiguousarray(Y[:, :, 0])
    return Response(nominal, S, Phi, finite and bool(rollout.valid.all()))


def linearise_of(model: PredictionModel) -> Callable[..., Linearisation]:
    """Return the model's ``linearise``.

    Raises
    ------
    ValueError
        If it has none.
    """
    found = getattr(model, "linearise", None)
    if found is None:
        raise ValueError(
            f"identification: a recursion needs the model's tangent, got {type(model).__name__} "
            "without `linearise`, expected identification 'rollouts'"
        )
    return found
