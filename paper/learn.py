r"""Learn a control basis: principal directions of optimal moves, in the norm that the cost has.

About level flight at a speed v, with the response S of all 4 H commands and the free response O of the
state, a reference r and a change dx of the start make the errors e = y_trim + O dx - r, and the
full-order optimal move and its cost are

    u = -M^{-1} S' W e,     M = S' W S,     J = e' W e + e' W S u,

the actuators and the commands being among the outputs, with the weights R and Rc.

A basis costs more by exactly |u - its best u|^2 in the norm of M = L L'. So with every move divided by
sqrt(J), what a singular value decomposition of L' [u_1 u_2 ..] leaves out is the cost lost *relative
to the optimum*, summed over the training set, and its leading directions are the best basis there is
for that set. A floor is added to J, so that references that cost nearly nothing do not rule.

The moves of all speeds are stacked before the decomposition: a direction is then the answer to one and
the same mixture of references at every speed, and can be interpolated between them.

What a receding horizon asks of a basis is mostly the fourth kind of moves, *update*: corrections of
the last plan, shifted. Polynomials hold their own shifts; learned directions do not, and without such
moves among the training they flew worse than polynomials.

*Departure* from H-POD as prior studies had it (moves of unit norm, one speed): there the terrain, which
a basis can follow at almost no cost, counts as little as a step that nothing can follow.
"""

import hashlib
import json
import platform
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.optimise import ACTUATORS, TRACKED
from controller.parameters import MpcParameters, weights
from controller.recursion import propagate
from paper.problem import SMALL_R, Five, Form
from plant.jit import cache_folder
from plant.prediction import HelicopterModel, ModelParameters

Floats = NDArray[np.float64]

FLOWN: Five = weights(MpcParameters(), attitude_form=True).Q
"""The controller's own weights Q; a basis is for the cost that it was learned for."""
SPEEDS = (15.0, 20.0, 25.0, 30.0, 35.0, 40.0)  # m/s
SAMPLES = 200
UPDATE = 10  # samples between updates
DIRECTIONS = 24  # kept: in single precision just under half a megabyte
PER_KIND = 300
FLOOR = 1.0  # of J; following terrain costs about 5, a step of 10 m hundreds
RC = {"attitude": (0.0, 0.1, 0.1, 0.1), "actuator": (0.0, 0.0, 0.0, 0.0)}
KINDS = {"step": 0.1, "terrain": 0.5, "offset": 0.1, "update": 1.0}
"""Kinds of references, and what each counts."""
START_SIZE = (
    *(8.0,) * 3, *(3.0,) * 3, 0.1, 0.1, 0.2, *(0.1,) * 3, 0.02, 0.02, 0.1, 0.02, 0.02,
)  # fmt: skip
"""Standard deviations of the start's state: m, m/s, rad, rad/s, rad, G, rad."""


class Flight(NamedTuple):
    """Level flight and small changes of it: 13 outputs times the roots of their weights.

    The outputs are five tracked ones, four actuators and the four commands, the roots ``root`` (13,).
    ``long_S`` (13, K, 4, K) is their response to the commands and ``long_O`` (13, K, 17) to the start,
    over K > H samples; ``S`` (13 H, 4 H) and ``O`` (13 H, 17) are those of a horizon, and ``L`` (4 H,
    4 H) is the Cholesky factor of S' S. ``time`` (K,) of the samples' ends, s; ``speed``, m/s.
    """

    speed: float
    time: Floats
    root: Floats
    long_S: Floats
    long_O: Floats
    S: Floats
    O: Floats
    L: Floats


def level_flight(form: Form, speed: float, horizon: int, Q: Five) -> Flight:
    """Return level flight at a speed, m/s, over H samples and an update's more."""
    model = HelicopterModel(ModelParameters(command=form))
    state, command, _ = model.trim(speed)
    still, K = np.zeros(3), horizon + UPDATE
    rows = np.array([model.outputs.index(name) for name in (*TRACKED[:5], *ACTUATORS)])
    slopes = model.linearise(state, np.tile(command, (K, 1)), still, still).slopes
    Phi = np.eye(4 * K).reshape(4, K, 4 * K)
    idle = np.zeros((4, K, len(state)))
    root = np.sqrt([*Q, *SMALL_R, *RC[form]])
    long_S = root[:, None, None] * np.concatenate([propagate(slopes, Phi, rows), Phi])
    long_O = root[:, None, None] * np.concatenate(
        [propagate(slopes, idle, rows, np.eye(len(state))), idle]
    )
    long_S = long_S.reshape(13, K, 4, K)
    S = long_S[:, :horizon, :, :horizon].reshape(13 * horizon, 4 * horizon)
    O = long_O[:, :horizon].reshape(13 * horizon, -1)
    time = np.asarray(model.sample_period * np.arange(1, K + 1), np.float64)
    L = np.asarray(np.linalg.cholesky(S.T @ S), np.float64)
    return Flight(speed, time, root, long_S, long_O, S, O, L)


def errors(kind: str, number: int, flight: Flight, rng: np.random.Generator) -> Floats:
    """Return weighted errors, (N, 13 H); with equal generators the same references at every speed.

    *step*: one in altitude, N(0, 8 m), known in advance, at any time but the last tenth. *terrain*:
    altitude of three sines of N(0, 6 m), periods 4 to 20 s, and a course that winds with N(0, 6 m)
    and 12 to 40 s, its heading along it. *offset*: a start off in all states, :data:`START_SIZE`.
    *update*: what is left to do over such terrain when the optimal plan of one update ago is flown,
    shifted, its end filled with trim.
    """
    K, H = len(flight.time), len(flight.time) - UPDATE
    if kind == "offset":
        return START_SIZE * rng.standard_normal((number, len(START_SIZE))) @ flight.O.T
    e = np.zeros((number, 13, K))
    if kind == "step":
        when, height = rng.uniform(0.0, 0.9, number), rng.normal(0.0, 8.0, number)
        e[:, 2] = -height[:, None] * (flight.time > when[:, None] * flight.time[H - 1])
    else:
        for _ in range(3):
            e[:, 2] -= _sine(number, (4.0, 20.0), flight.time, rng)[0]
        aside, rate = _sine(number, (12.0, 40.0), flight.time, rng)
        e[:, 1], e[:, 3] = -aside, -np.arctan(rate / flight.speed)
    e *= flight.root[:, None]
    return left_over(flight, e) if kind == "update" else e[:, :, :H].reshape(number, -1)


def left_over(flight: Flight, e: Floats) -> Floats:
    """Return weighted errors, (N, 13 H), one update after the optimal plan for e (N, 13, K)."""
    number, _, K = e.shape
    H = K - UPDATE
    now = e[:, :, :H].reshape(number, -1)
    plan = np.zeros((4, K, number))
    plan[:, :H] = optimal(flight, now)[0].reshape(4, H, number)
    moved = flight.long_S.reshape(13 * K, -1) @ plan.reshape(-1, number)
    return (e + moved.T.reshape(e.shape))[:, :, UPDATE:].reshape(number, -1)


def _sine(
    number: int, periods: tuple[float, float], time: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return sines that begin at zero, (N, K), m, and their rates, m/s."""
    omega, phase, size = (
        part[:, None]
        for part in (
            2.0 * np.pi / rng.uniform(*periods, number),
            rng.uniform(0.0, 2.0 * np.pi, number),
            rng.normal(0.0, 6.0, number),
        )
    )
    angle = omega * time + phase
    return size * (np.sin(angle) - np.sin(phase)), size * omega * np.cos(angle)


def optimal(flight: Flight, e: Floats, basis: Floats | None = None) -> tuple[Floats, Floats]:
    """Return the optimal moves (4 H, N) for weighted errors (N, 13 H), and their costs (N,).

    Parameters
    ----------
    basis : (4 H, m), optional
        Only moves in its span; else all.
    """
    from scipy.linalg import cho_solve

    g = flight.S.T @ e.T
    if basis is None:
        u = -cho_solve((flight.L, True), g)
    else:
        bent = flight.L.T @ basis
        u = -basis @ np.linalg.solve(bent.T @ bent, basis.T @ g)
    return u, np.square(e).sum(axis=1) + np.einsum("in,in->n", g, u)


def principal_directions(
    flights: Sequence[Flight],
    training: Sequence[Sequence[Floats]],
    importance: Sequence[float],
    number: int,
) -> Floats:
    """Return directions (V, 4 H, n) of V flights.

    Parameters
    ----------
    training : per kind and flight, (N, 13 H)
        Weighted errors.
    importance : per kind
        What it counts.
    number : int
        How many directions.
    """
    moves: list[list[Floats]] = [[] for _ in flights]
    for kind, counts in zip(training, importance, strict=True):
        found = [optimal(flight, e) for flight, e in zip(flights, kind, strict=True)]
        J = np.mean([cost for _, cost in found], axis=0)
        for one, (u, _) in zip(moves, found, strict=True):
            one.append(u * (counts / np.sqrt(J + FLOOR)))
    U = [np.concatenate(one, axis=1) for one in moves]
    Z = np.concatenate([flight.L.T @ u for flight, u in zip(flights, U, strict=True)])
    square, V = np.linalg.eigh(Z.T @ Z)
    leading = np.arange(len(square))[::-1][:number]
    V = V[:, leading] / np.sqrt(square[leading])
    columns = np.stack([u @ V for u in U])
    largest = np.abs(columns[0]).argmax(axis=0)
    return columns * np.sign(columns[0, largest, np.arange(number)])


def train(
    form: Form = "attitude",
    seed: int = 0,
    *,
    Q: Five = FLOWN,
    speeds: Sequence[float] = SPEEDS,
    horizon: int = SAMPLES,
    per_kind: int = PER_KIND,
    number: int = DIRECTIONS,
    progress: Callable[[str], None] = lambda _: None,
) -> Floats:
    """Return learned directions, (V, 4, H, n)."""
    flights: list[Flight] = []
    for speed in speeds:
        progress(f"level flight at {speed:g} m/s")
        flights.append(level_flight(form, speed, horizon, Q))
    seeds = dict(zip(KINDS, np.random.SeedSequence(seed).spawn(len(KINDS)), strict=True))
    progress("optimal moves")
    training = [
        [errors(kind, per_kind, flight, np.random.default_rng(own)) for flight in flights]
        for kind, own in seeds.items()
    ]
    found = principal_directions(flights, training, list(KINDS.values()), number)
    return found.reshape(len(speeds), 4, horizon, number)


def write_basis(
    file: Path,
    form: Form = "attitude",
    seed: int = 0,
    *,
    Q: Five = FLOWN,
    progress: Callable[[str], None] = lambda _: None,
) -> None:
    """Learn a basis and write it, with its provenance, to an .npz file.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    model = HelicopterModel(ModelParameters(command=form))
    columns = train(form, seed, Q=Q, progress=progress)
    about = {
        "form": form,
        "seed": seed,
        "speeds_mps": SPEEDS,
        "per_kind": PER_KIND,
        "kinds": KINDS,
        "floor": FLOOR,
        "Q": Q,
        "R": SMALL_R,
        "Rc": RC[form],
        "start_size": START_SIZE,
        "plant": cache_folder().name,
        "training": hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16],
        "python": platform.python_version(),
        **{name: version(name) for name in ("hedgehop", "numpy", "scipy", "numba")},
    }
    with file.open("wb") as stream:
        np.savez(
            stream,
            columns=columns.astype(np.float32),
            speeds_mps=np.array(SPEEDS),
            commands=np.array(model.commands),
            sample_period_s=np.array(model.sample_period),
            provenance=np.array(json.dumps(about)),
        )
