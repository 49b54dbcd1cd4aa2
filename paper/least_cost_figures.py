"""Figure 6 and its companions."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from paper.least_cost import (
    EXACT,
    FEW,
    FUNCTIONS,
    RAW,
    SPAN,
    STEP_S,
    Least,
    curve,
    excess,
    mean_excess,
    table_of,
)  # fmt: skip
from paper.study import Figure


def least_costs(rows: Sequence[Least], J_star: float) -> Figure:
    """Return figure 6."""
    at_3 = [r for r in rows if r.step_s == STEP_S]
    return Figure(
        name="fig6_minimum_cost",
        title="Least cost over one horizon against the number of basis functions",
        caption=f"10 m step at 3 s, attitude form, H = 200, 30 m/s; true cost after linearising and "
        f"solving to convergence. Left: polynomials as written, finite perturbations, and the "
        f"orthonormal columns of their span. Right: the others. J* = {J_star:.2f}.",
        table={**table_of(at_3), "J_star": [J_star] * len(at_3)},
        draw=partial(_draw_least, rows=at_3, J_star=J_star),
        size_in=(8.5, 4.8),
    )


def _draw_least(picture: Any, rows: Sequence[Least], J_star: float) -> None:
    from paper.style import marked

    left, right = picture.subplots(1, 2, sharey=True)
    for axes, title, names in (
        (left, "polynomials", (*RAW, SPAN)),
        (right, "others, orthonormal", [name for name in EXACT if name != SPAN]),
    ):
        for number, name in enumerate(names):
            costs = curve(rows, name)
            axes.plot(list(costs), [r.J for r in costs.values()], label=name, **marked(number),
                      markevery=2 if len(costs) > 10 else 1)  # fmt: skip
        axes.axhline(J_star, color="#000000", linewidth=1.0, linestyle=(0, (4, 2)), label="J*")
        axes.set(xlabel="functions per channel", yscale="log", title=title)
        _plain(axes)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    left.set_ylabel("least true cost J")


def _plain(axes: Any) -> None:
    """Write the numbers of a logarithmic scale in full, few of them."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, ScalarFormatter

    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())


def promises(rows: Sequence[Least], J_star: float) -> Figure:
    """Return the linear model's costs beside the true ones."""
    shown = [r for r in rows if r.step_s == STEP_S and r.columns in (SPAN, "tents", FUNCTIONS)]
    return Figure(
        name="fig6_linear_and_true",
        title="What the linear model promises and what is attained",
        caption="The step at 3 s. Below: the optimum of the first linear model, about trim. Middle: "
        "the true cost at convergence. Above: the true cost of the first optimum taken at its word, "
        "without a line search; trim alone costs 14100.",
        table=table_of(shown),
        draw=partial(_draw_promises, rows=shown, J_star=J_star),
        size_in=(7.0, 4.2),
    )


def _draw_promises(picture: Any, rows: Sequence[Least], J_star: float) -> None:
    from paper.style import COLOURS, MARKERS

    axes = picture.subplots()
    for number, name in enumerate((SPAN, "tents", FUNCTIONS)):
        costs = curve(rows, name)
        for what, dashes in (("J", "-"), ("J_linear", "--"), ("J_full_step", ":")):
            axes.plot(list(costs), [getattr(r, what) for r in costs.values()], linestyle=dashes,
                      color=COLOURS[number], marker=MARKERS[number], markersize=3.5,
                      label=name if what == "J" else None)  # fmt: skip
    axes.axhline(J_star, color="#000000", linewidth=1.0, linestyle=(0, (4, 2)), label="J*")
    for what, dashes in (("attained", "-"), ("promised", "--"), ("promise flown", ":")):
        axes.plot([], [], color="#1B1F24", linestyle=dashes, label=what)
    axes.set(xlabel="functions per channel", ylabel="cost J", yscale="log")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=4)


def step_times(rows: Sequence[Least], optima: Mapping[float, float]) -> Figure:
    """Return the mean over times of the step."""
    kept = [r for r in rows if r.functions in FEW and (r.columns in EXACT or r.columns == RAW[0])]
    mean = mean_excess(rows, optima)
    times = ", ".join(f"{J:.1f} at {t:g} s" for t, J in sorted(optima.items()))
    return Figure(
        name="fig6_step_times",
        title="Excess over the true optimum, averaged over the time of the step",
        caption="Steps of 10 m at 0, 1.5, 3 and 5 s, attitude form: a single time flatters whichever "
        "family has a knot there. J* is " + times + ".",
        table={**table_of(kept), "excess_percent": [excess(r, optima) for r in kept],
               "mean_excess_percent": [mean[r.columns, r.functions] for r in kept]},
        draw=partial(_draw_mean, mean=mean),
        size_in=(7.0, 4.4),
    )  # fmt: skip


def _draw_mean(picture: Any, mean: Mapping[tuple[str, int], float]) -> None:
    from paper.style import marked

    axes = picture.subplots()
    for number, name in enumerate(EXACT):
        counts = [n for n in FEW if (name, n) in mean]
        axes.plot(counts, [mean[name, n] for n in counts], label=name, **marked(number))
    axes.set(xlabel="functions per channel", ylabel="mean excess over J* (%)", yscale="log")
    _plain(axes)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
