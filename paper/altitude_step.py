"""Figure 8: a 10 m step in altitude, flown over a receding horizon with six bases.

Previewed: the step comes into the horizon of 10 s as it moves on. Not previewed: every plan takes the
altitude wanted now for the one wanted throughout. Flown in four ways: in attitude and in actuator form,
with the line search and with the full step that the paper takes.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from paper.receding import Flown
from paper.step_response import (
    AT_S,
    BASES,
    BOXES,
    DURATION_S,
    LAGUERRE,
    LITERAL,
    LOST,
    LOST_M,
    SHIPPED,
    TENTS,
    Transient,
    Way,
    column,
    histories,
    read,
    respond,
    wanted,
    ways,
)
from paper.study import Claim, Figure, Study, Table, Verdict
from paper.style import line

FIGURES = (8,)


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Fly every basis every way, read the responses, and judge the paper's sentences on them."""
    flights: dict[tuple[str, Way], Flown] = {}
    for way in ways(quick=quick):
        progress(_told(way))
        flights |= {(name, way): respond(name, way) for name in BASES}
    found = {key: read(flown) for key, flown in flights.items()}
    pictures = {
        case: histories(flights, case[0], is_searched=case[1]) for case in (SHIPPED, LITERAL)
    }
    figures = (
        Figure(
            name="fig8_altitude_step",
            title="Figure 8: a 10 m step, receding horizon",
            caption="R-50 at 30 m/s, attitude form, one pass with line search per update at 2 Hz, "
            "horizon 10 s, Q = 1 on every output, R = (0.1, 1, 1, 1) on the deviation from trim, "
            "identified by recursion. Left: the step is seen coming; right: it is not.",
            table=pictures[SHIPPED],
            draw=partial(_draw, table=pictures[SHIPPED]),
            size_in=(9.0, 6.2),
        ),
        Figure(
            name="fig8_full_step",
            title="Figure 8, literally: actuator form, full step",
            caption="As before, but the bases act on the actuators and every update takes the whole "
            "step that the quadratic programme asks for, as the paper writes. Curves that end are "
            "flights that were lost.",
            table=pictures[LITERAL],
            draw=partial(_draw, table=pictures[LITERAL]),
            size_in=(9.0, 6.2),
        ),
    )
    return Study(
        title="Tracking a step in altitude (figure 8)",
        text=_text(found),
        figures=figures,
        tables=(_table(found, flights),),
        claims=claims(found),
    )


def verdict(cases: Iterable[bool]) -> Verdict:
    """Return what a claim comes to that is true or not in several cases."""
    known = list(cases)
    if all(known):
        return "holds"
    return "holds in part" if any(known) else "does not hold"


def claims(found: Mapping[tuple[str, Way], Transient]) -> tuple[Claim, ...]:
    """Return the paper's sentences about figure 8, judged over all ways flown."""
    flown_ways = list(dict.fromkeys(way for _, way in found))
    shown = [way for way in flown_ways if (way.form, way.is_searched) in (SHIPPED, LITERAL)]
    order = "; ".join(map(_told, shown))

    def numbers(field: str, *names: str) -> str:
        return "; ".join(
            f"{name} {' / '.join(_number(getattr(found[name, way], field)) for way in shown)}"
            for name in names
        )

    def judged(
        where: str,
        statement: str,
        is_true: Callable[[Mapping[str, Transient]], bool],
        ours: str,
        reason: str,
        theirs: str = "",
    ) -> Claim:
        cases = {way: is_true({name: found[name, way] for name in BASES}) for way in flown_ways}
        true = [way for way, case in cases.items() if case]
        false = [way for way, case in cases.items() if not case]
        few, said = (true, "true") if len(true) <= len(false) else (false, "not")
        listed = f" ({said} in {'; '.join(map(_told, few))})" if few else ""
        return Claim(
            where,
            statement,
            verdict(cases.values()),
            theirs,
            f"{ours} [{order}]",
            f"True in {len(true)} of {len(cases)} ways of flying it{listed}. {reason}",
        )

    return (
        judged(
            "IV.B, fig. 8",
            "five Laguerre functions follow with smaller altitude excursions than ten tents",
            lambda each: each[LAGUERRE].excursion_m < each[TENTS].excursion_m,
            f"overshoot and dip, m: {numbers('excursion_m', LAGUERRE, TENTS)}",
            "With the line search they dip before a climb that they see coming, and overshoot it. "
            "Smaller excursions they have where full steps make the tents overshoot, or lose them.",
        ),
        judged(
            "IV.B, fig. 8",
            "tents respond systematically faster and stabilise at the altitude reference",
            lambda each: (
                each[TENTS].settle_2pct_s < each[LAGUERRE].settle_2pct_s
                and each[TENTS].rise_s < each[LAGUERRE].rise_s
                and each[TENTS].late_error_m < 0.05
            ),
            f"s to 2 %: {numbers('settle_2pct_s', TENTS, LAGUERRE)}; "
            f"s from 10 to 90 %: {numbers('rise_s', TENTS, LAGUERRE)}",
            "They settle several times faster and end at rest wherever they are not lost.",
        ),
        judged(
            "IV.B, fig. 8",
            "the Laguerre functions oscillate within less than 1 m of the set altitude",
            lambda each: each[LAGUERRE].late_error_m < 1.0,
            f"largest error later than 10 s, m: {numbers('late_error_m', LAGUERRE, TENTS)}",
            "The oscillation is of the basis, not of the aircraft: ten tents end at rest.",
            "< 1 m",
        ),
        judged(
            "IV.B, fig. 8",
            "boxes converge in the end but show large settling transients",
            lambda each: (
                each[BOXES].excursion_m > 2.0 * each[TENTS].excursion_m
                or each[BOXES].settle_2pct_s > 2.0 * each[TENTS].settle_2pct_s
                or each[BOXES] == LOST
            ),
            f"overshoot and dip, m: {numbers('excursion_m', BOXES, TENTS)}",
            "Large is more than twice the tents' excursion or settling time, or lost. With a line "
            "search boxes settle as tents do; with full steps they are the first to be lost.",
        ),
        judged(
            "fig. 8, caption",
            "the Laguerre functions are quicker to converge",
            lambda each: each[LAGUERRE].settle_2pct_s < each[TENTS].settle_2pct_s,
            f"s to 2 %: {numbers('settle_2pct_s', LAGUERRE, TENTS, BOXES)}",
            "They are the slowest to settle, and quicker only than what is lost.",
        ),
    )


def _told(way: Way) -> str:
    step = "line search" if way.is_searched else "full step"
    return f"{way.form} form, {step}{'' if way.is_previewed else ', not previewed'}"


def _number(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "lost"


def _table(
    found: Mapping[tuple[str, Way], Transient], flights: Mapping[tuple[str, Way], Flown]
) -> Table:
    columns: dict[str, list[Any]] = {
        "form": [way.form for _, way in found],
        "step": ["line search" if way.is_searched else "full" for _, way in found],
        "previewed": ["yes" if way.is_previewed else "no" for _, way in found],
        "basis": [name for name, _ in found],
    }
    for field in Transient._fields:
        values = [getattr(one, field) for one in found.values()]
        columns[field] = [round(value, 4) if np.isfinite(value) else "lost" for value in values]
    columns["rejected"] = [int((flights[key].steps == 0.0).sum()) for key in found]
    return Table(
        name="fig8_transients",
        title="Responses to the step",
        caption=f"Times from the step on. Lost: departed, or more than {LOST_M:g} m off. Rejected: "
        f"updates of {DURATION_S * 2:g} that kept the old plan, which in steady flight is all there "
        "is to do.",
        columns=columns,
    )


def _text(found: Mapping[tuple[str, Way], Transient]) -> str:
    lost = [f"{name} ({_told(way)})" for (name, way), one in found.items() if one == LOST]
    return (
        "Each update optimises 10 s, half a second is applied, and the next goes on from the shifted "
        "plan. With the line search every basis flies the step, the tents settle fastest and end at "
        "rest, and five polynomials keep oscillating within a bounded band, as the paper says. Its "
        "other sentences, that boxes show large transients and that Laguerre polynomials converge "
        "more quickly, are not found that way; they appear where every update takes the full step "
        "of the linear model, as the paper writes it. There the richer bases are the ones that are "
        f"lost: {'; '.join(lost) if lost else 'none here'}. What five polynomials gain is caution: "
        "they cannot ask for what the linear response mispredicts. Seven Legendre polynomials can, "
        "which may be what the paper calls a failure to converge; of equal order they are the same "
        "controller as Laguerre's."
    )


def _draw(picture: Any, table: Mapping[str, Any]) -> None:
    grid = picture.subplots(2, 2, sharex=True, sharey="row")
    time = table["time_s"]
    for side, is_previewed in enumerate((True, False)):
        above, below = grid[:, side]
        for number, name in enumerate(BASES):
            altitude = table[column(name, is_previewed=is_previewed)]
            above.plot(time - AT_S, altitude, **line(number), label=name)
            below.plot(time - AT_S, altitude - wanted(time), **line(number))
        above.plot(time - AT_S, wanted(time), color="#9AA1A9", linewidth=1.0, zorder=1)
        above.set(title="previewed" if is_previewed else "not previewed", ylim=(-3.0, 15.0))
        below.set(xlabel="time after the step (s)", xlim=(-10.0, 20.0), ylim=(-1.5, 1.5))
    grid[0, 0].set_ylabel("altitude (m)")
    grid[1, 0].set_ylabel("altitude error (m)")
    picture.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
