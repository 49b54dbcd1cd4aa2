"""The weight omega and the length of the horizon, over the fractal course, as it is flown.

These flights are the controller's own, by the orchestrator: path reference, sensor and all.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

from orchestrator.flight import fly
from orchestrator.scenario.load import installed
from paper.altitude_step import verdict
from paper.study import Claim, Figure, Study, Table
from paper.style import marked

OMEGAS = (0.1, 1.0, 10.0, 100.0)
HORIZONS_S = (3.0, 5.0, 7.0, 10.0)
OFFSET_M = 10.0
SETTLED_S = 6.0
LAGUERRE, TENTS = "5 Laguerre", "10 tents"
BASES = {LAGUERRE: ("laguerre", 5), TENTS: ("tent", 10)}


class Tracked(NamedTuple):
    """RMS errors of height and across the track, m, outcome, and updates that kept the old plan."""

    height_m: float
    across_m: float
    clearance_m: float
    outcome: str
    rejected: int


def flown(name: str, overrides: Sequence[str]) -> Tracked:
    """Fly the fractal course with a basis; the figures leave out ``settle_s``."""
    family, count = BASES[name]
    basis = [f"basis={family}", f"bases_per_channel={count}"]
    metrics = fly(
        installed() / "fractal.yaml",
        [*(f"components.mpc.parameters.{one}" for one in basis), *overrides],
    ).metrics
    return Tracked(
        metrics["height_rms_m"],
        metrics["cross_track_rms_m"],
        metrics["clearance_min_m"],
        metrics["outcome"],
        metrics["ladder"]["old tail"] + metrics["ladder"]["trim"],
    )


def with_omega(name: str, omega: float, duration_s: float) -> Tracked:
    """Start 10 m beside the course; figures are of the whole flight."""
    return flown(
        name,
        [
            f"components.mpc.parameters.altitude_weight={omega}",
            f"components.vehicle.parameters.perturbation.east_m={OFFSET_M}",
            "settle_s=0",
            f"duration_s={duration_s}",
        ],
    )


def with_horizon(name: str, horizon_s: float, duration_s: float) -> Tracked:
    """Figures leave out the first seconds."""
    return flown(
        name,
        [
            f"components.mpc.parameters.horizon_s={horizon_s}",
            f"settle_s={SETTLED_S}",
            f"duration_s={duration_s}",
        ],
    )


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Fly every omega and every horizon with both bases."""
    duration_s = 20.0 if quick else 60.0
    omegas: dict[tuple[str, float], Tracked] = {}
    for name, omega in product(BASES, OMEGAS):
        progress(f"omega {omega:g}, {name}")
        omegas[name, omega] = with_omega(name, omega, duration_s)
    horizons: dict[tuple[str, float], Tracked] = {}
    for name, horizon_s in product(BASES, HORIZONS_S):
        progress(f"horizon {horizon_s:g} s, {name}")
        horizons[name, horizon_s] = with_horizon(name, horizon_s, duration_s)
    of_omega, of_horizon = _columns(omegas, "omega"), _columns(horizons, "horizon_s")

    def ratio(name: str) -> float:
        return horizons[name, HORIZONS_S[-1]].height_m / horizons[name, HORIZONS_S[0]].height_m

    course = f"Fractal course at 30 m/s, {duration_s:g} s, attitude form, line search"
    return Study(
        title="Weights and horizon",
        text="A large omega holds the height and lets the track wait, a small one the reverse: the "
        "trade-off of the paper is there. It is lopsided: a hundred times the weight costs the track "
        "little, and beyond 10 the height gains nothing more. The horizon is the strongest lever for "
        "few functions: five polynomials over 10 s are too stiff for this ground, over 3 s their "
        f"height error is {ratio(LAGUERRE):.0f} times smaller. Ten tents gain from a short horizon "
        f"too, {ratio(TENTS):.0f} times. Shorter than the sight of the sensor it can be while the "
        "course asks for no more than the aircraft can do.",
        figures=(
            Figure(
                name="omega",
                title="The weight omega",
                caption=f"{course}, start {OFFSET_M:g} m beside it, horizon 10 s; RMS of the whole "
                "flight.",
                table=of_omega,
                draw=partial(_draw, found=omegas, over=OMEGAS, label="omega", both=True),
                size_in=(8.0, 3.8),
            ),
            Figure(
                name="horizon",
                title="The length of the horizon",
                caption=f"{course}, omega 10; RMS after {SETTLED_S:g} s.",
                table=of_horizon,
                draw=partial(
                    _draw, found=horizons, over=HORIZONS_S, label="horizon (s)", both=False
                ),
                size_in=(5.5, 3.8),
            ),
        ),
        tables=(
            Table("omega_flights", "Flights by omega", "RMS of the whole flight.", of_omega),
            Table(
                "horizon_flights", "Flights by horizon", f"RMS after {SETTLED_S:g} s.", of_horizon
            ),
        ),
        claims=(_trade_off(omegas),),
    )


def _trade_off(found: Mapping[tuple[str, float], Tracked]) -> Claim:
    cases: list[bool] = []
    for name in BASES:
        heights = [found[name, omega].height_m for omega in OMEGAS]
        across = [found[name, omega].across_m for omega in OMEGAS]
        cases += [heights[-1] < heights[0], across[-1] > across[0]]

    def numbers(field: str) -> str:
        return "; ".join(
            f"{name} {' / '.join(f'{getattr(found[name, omega], field):.2f}' for omega in OMEGAS)}"
            for name in BASES
        )

    lost = [f"{name}, {omega:g}" for (name, omega), one in found.items() if one.outcome != "flown"]
    return Claim(
        where="III",
        statement="a high omega allows little deviation in altitude and lets the track meander, a "
        "small one emphasises the track",
        verdict=verdict(cases),
        theirs="",
        ours=f"RMS at omega 0.1 / 1 / 10 / 100, m: height {numbers('height_m')}; across the track "
        f"{numbers('across_m')}",
        reason="From 10 m beside the course, both ends compared for both bases. "
        + (f"Lost: {', '.join(lost)}." if lost else "None was lost."),
    )


def _columns(found: Mapping[tuple[str, float], Tracked], varied: str) -> dict[str, list[Any]]:
    columns: dict[str, list[Any]] = {
        "basis": [name for name, _ in found],
        varied: [value for _, value in found],
    }
    for field in Tracked._fields:
        columns[field] = [getattr(one, field) for one in found.values()]
    return columns


def _draw(
    picture: Any,
    found: Mapping[tuple[str, float], Tracked],
    over: Sequence[float],
    label: str,
    *,
    both: bool,
) -> None:
    grid = picture.subplots(1, 2 if both else 1, squeeze=False)[0]
    fields = {"height_m": "RMS height error (m)", "across_m": "RMS error across the track (m)"}
    for axes, (field, title) in zip(grid, fields.items(), strict=False):
        for number, name in enumerate(BASES):
            values = [getattr(found[name, value], field) for value in over]
            axes.plot(over, values, **marked(number), label=name)
        axes.set(xlabel=label, ylabel=title)
        if both:
            axes.set(xscale="log", ylim=(0.0, None))
        else:
            axes.set(yscale="log", xticks=over)
    picture.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
