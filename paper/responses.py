"""Figures 2, 3 and 5: what each basis function, added to one control, does within 10 s."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from paper.bases import COUNT, HORIZON, LEGENDRE, PAPERS, PERIOD, SECONDS, UNIT, within_lines
from paper.problem import Form, level_flight
from paper.study import Claim, Figure, Study, Table
from paper.style import line

Floats = NDArray[np.float64]

FIGURES = (2, 3, 5)
SIZES = {"pitch": float(np.radians(0.01)), "tail": 1e-5, "heading": float(np.radians(0.01))}
"""Of the perturbations: small enough that halving them changes the responses by less than 1 %."""
SPEED, YAW = "speed", "heading"


class Channel(NamedTuple):
    """One control, one output, and the units they are drawn in.

    ``unit`` is the control's unit as a multiple of its SI unit, ``scale`` makes the output's.
    """

    form: Form
    command: str
    output: str
    unit: float
    scale: float
    label: str


DEGREE = float(np.radians(1.0))
PITCH = Channel("actuator", "pitch", SPEED, DEGREE, 1.0, "m/s per °")
TAIL = Channel("actuator", "tail", YAW, 0.01, 1.0 / DEGREE, "° per 0.01 G")
SET_PITCH = Channel("attitude", "pitch", SPEED, DEGREE, 1.0, "m/s per °")
SET_YAW = Channel("attitude", "heading", YAW, DEGREE, 1.0 / DEGREE, "° per °")


def responses(channel: Channel, B: Floats, *, size: float | None = None) -> Floats:
    """Return the response of a channel's output to each basis function, (H, n), per unit of it.

    Central differences about level flight at 30 m/s.

    Parameters
    ----------
    B : ndarray, shape (H, n)
        Basis functions, raw.
    size : float, optional
        Of the largest value of a perturbation, SI; :data:`SIZES` if not given.
    """
    flight = level_flight(form=channel.form, horizon=len(B))
    size = SIZES[channel.command] if size is None else size
    scale = size / np.abs(B).max(axis=0)
    delta = np.zeros((2, B.shape[1], len(B), 4))
    delta[0, :, :, flight.model.commands.index(channel.command)] = (B * scale).T
    delta[1] = -delta[0]
    commands = flight.u0 + delta.reshape(-1, len(B), 4)
    rollout = flight.model.rollout(flight.state, commands, flight.wind, flight.bias)
    y = rollout.outputs[:, :, flight.model.outputs.index(channel.output)]
    up, down = y.reshape(2, B.shape[1], len(B))
    return ((up - down) / (2 * scale[:, None])).T * channel.unit * channel.scale


def largest(y: Floats) -> Floats:
    """Return the largest response to each function relative to that to the constant, (n,)."""
    peak = np.abs(y).max(axis=0)
    return peak / peak[0]


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return the responses to Laguerre and Legendre perturbations and what they claim."""
    del quick
    progress("rollouts")
    drawn = {
        (channel, family): responses(channel, PAPERS[family](HORIZON, COUNT))
        for channel in (PITCH, TAIL, SET_PITCH, SET_YAW)
        for family in (UNIT, SECONDS, LEGENDRE)
    }
    figures = (
        _figure("fig2_speed_laguerre", "Figure 2: speed, Laguerre perturbations of pitch",
                PITCH, (UNIT, SECONDS), drawn),
        _figure("fig3_yaw_laguerre", "Figure 3: heading, Laguerre perturbations of the tail rotor",
                TAIL, (UNIT, SECONDS), drawn),
        _figure("fig5_speed_legendre", "Figure 5: speed and heading, Legendre perturbations",
                (PITCH, TAIL), (LEGENDRE,), drawn),
        _figure("fig2_attitude_form", "The same in the attitude form: through the stabiliser",
                (SET_PITCH, SET_YAW), (UNIT, LEGENDRE), drawn),
    )  # fmt: skip
    gains = {key: largest(y) for key, y in drawn.items()}
    table = Table(
        name="gains",
        title="Largest response within 10 s, relative to that of n = 0",
        caption="Actuator form: the bases act on the rotors directly; attitude form: on set-points.",
        columns={
            "form": [channel.form for channel, _ in gains],
            "control": [channel.command for channel, _ in gains],
            "output": [channel.output for channel, _ in gains],
            "family": [family for _, family in gains],
            **{f"n_{n}": [gain[n] for gain in gains.values()] for n in range(COUNT)},
        },
    )
    share = within_lines(PAPERS[UNIT](HORIZON, COUNT)[:, 2:])
    claims = tuple(_claims(gains, share))
    text = (
        "Level flight at 30 m/s, each of the five functions added to one control in turn. The "
        "perturbations are small and the responses given per unit of the control, so they are the "
        "columns of S. Raw Laguerre functions of higher order move the helicopter more than Legendre "
        "ones, as the paper says, because on [0, 1] they consist mostly of a constant and a straight "
        "line, and in seconds because they grow to 46. It says nothing about what either family can "
        "reach: the spans, and with them the optima, are equal."
    )
    return Study("Responses to the bases", text, figures, (table,), claims)


def _claims(gains: dict[tuple[Channel, str], Floats], share: Floats) -> Iterator[Claim]:
    """Return what the paper says of Legendre n = 2:4; "small" is read as a quarter of n = 0."""
    speed = (
        "True of raw columns, and a matter of scale: a Legendre polynomial of order 2 or more has no "
        "mean and no slope, and speed, which integrates, answers to those; "
        f"{share.min():.0%} or more of a Laguerre polynomial on [0, 1] is mean and slope."
    )
    yaw = (
        "Our heading overshoots within half a second of a push of the tail rotor, because of its fin, "
        "so it follows a perturbation of any shape; the families hardly differ."
    )
    for channel, where, statement, reason in (
        (PITCH, "II.C, fig. 5", "Speed answers little to Legendre n = 2:4 in pitch", speed),
        (TAIL, "II.C", "Yaw answers little to Legendre n = 2:4 in the tail rotor", yaw),
    ):
        small, large = gains[channel, LEGENDRE][2:], gains[channel, UNIT][2:]
        pairs = zip((2, 3, 4), small, large, strict=True)
        numbers = ", ".join(f"n = {n} {a:.2f} against {b:.2f}" for n, a, b in pairs)
        yield Claim(
            where=where,
            statement=statement,
            verdict="holds" if small.max() < 0.25 else "does not hold",
            theirs="curves only",
            ours=f"largest response over that to n = 0, Legendre against Laguerre on [0, 1]: {numbers}",
            reason=reason,
        )


def _figure(
    name: str,
    title: str,
    channels: Channel | tuple[Channel, ...],
    families: Sequence[str],
    drawn: dict[tuple[Channel, str], Floats],
) -> Figure:
    channels = (channels,) if isinstance(channels, Channel) else channels
    panels = [(channel, family) for family in families for channel in channels]
    columns: dict[str, list[float]] = {"time_s": ((np.arange(HORIZON) + 1) * PERIOD).tolist()}
    for channel, family in panels:
        for n in range(COUNT):
            column = f"{channel.output} ({channel.label}), {family}, n = {n}"
            columns[column] = drawn[channel, family][:, n].tolist()
    return Figure(
        name=name,
        title=title,
        caption="R-50 in level flight at 30 m/s, "
        f"{channels[0].form} form, central differences of small perturbations, per unit of control.",
        table=columns,
        draw=partial(
            _draw, panels=panels, drawn=drawn, across=len(panels) if len(panels) < 4 else 2
        ),
        size_in=(8.0, 3.4 if len(panels) < 4 else 6.0),
    )


def _draw(
    picture: Any,
    panels: Sequence[tuple[Channel, str]],
    drawn: dict[tuple[Channel, str], Floats],
    across: int,
) -> None:
    time = (np.arange(HORIZON) + 1) * PERIOD
    every = np.atleast_1d(picture.subplots(len(panels) // across, across)).ravel()
    for axes, (channel, family) in zip(every, panels, strict=True):
        for n in range(COUNT):
            axes.plot(time, drawn[channel, family][:, n], **line(n), label=f"n = {n}")
        axes.set(
            title=f"{channel.command}, {family}",
            xlabel="time (s)",
            ylabel=f"{channel.output} ({channel.label})",
        )
    picture.legend(*every[0].get_legend_handles_labels(), loc="outside right upper")
