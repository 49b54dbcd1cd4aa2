"""Where a flight was, seen from the side: altitude and clearance over the distance flown."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orchestrator.figures.deviation import held
from orchestrator.report.charts import Array, Chart, Line, Mark
from orchestrator.report.subject import Subject

PLANS, PLAN_POINTS = 95, 40  # most that are drawn; together no more than a line has
ALIKE = 1.0  # m, between lines of which one is enough
FLOWN, REFERENCE, SET_HEIGHT, GROUND = range(4)  # styles


def profile(subjects: Sequence[Subject]) -> Chart:
    """Return the chart of altitudes: ground, reference, plans and what was flown."""
    lines: list[Line] = []
    marks: list[Mark] = []
    for each in subjects:
        assert each.pose is not None
        time, down = each.pose["down"]
        x, number = each.distance, each.number
        lines.extend(_plans(each))
        below = _ground_below(each)
        if below is not None:
            lines.append(Line("ground", number, x, below, time, GROUND))
            k = int(np.argmin(np.where(np.isnan(down + below), np.inf, -down - below)))
            text = f"least clearance {-down[k] - below[k]:.2f} m"
            marks.append(Mark(text, float(x[k]), float(-down[k]), number))
        height = each.scalar("height_agl")
        if below is not None and height is not None:
            wanted = below + held(each.samples(height), time)
            lines.append(Line("set height", number, x, wanted, time, SET_HEIGHT))
        if (off := each.deviation) is not None:
            lines.append(Line("reference", number, x, off.altitude, time, REFERENCE))
        lines.append(Line("flown", number, x, -down, time, FLOWN))
    lines = shared(lines)
    if sum(line.style == GROUND for line in lines) == 1:
        lines = [replace(one, kind="area") if one.style == GROUND else one for one in lines]
    has_plans = any(line.kind == "faint" for line in lines)
    return Chart(
        "Height profile",
        ("distance flown", "m"),
        ("altitude", "m"),
        tuple(sorted(lines, key=lambda line: (line.kind != "area", line.kind != "faint"))),
        tuple(mark for mark in marks if mark.y is not None and np.isfinite(mark.y)),
        link="distance",
        note=" ".join(
            text
            for text, is_there in (
                ("Faint: the path that each plan predicted.", has_plans),
                ("Rings: the least clearance.", bool(marks)),
            )
            if is_there
        ),
        is_wide=True,
    )


def shared(lines: Sequence[Line]) -> list[Line]:
    """Return lines without those that repeat an earlier recording's; that one is then all's."""
    kept: list[Line] = []
    for line in lines:
        alike = next((k for k, one in enumerate(kept) if _is_alike(one, line)), None)
        if alike is None:
            kept.append(line)
        else:
            kept[alike] = replace(kept[alike], recording=None)
    return kept


def _is_alike(one: Line, other: Line) -> bool:
    """Whether two lines look alike: 1 m or less apart at every x that they have in common."""
    if one.style != other.style or one.style == FLOWN or not len(one.x) or not len(other.x):
        return False
    if (np.diff(one.x) < 0.0).any():
        return False
    common = (other.x >= one.x[0]) & (other.x <= one.x[-1])
    off = np.abs(np.interp(other.x[common], one.x, one.y) - other.y[common])
    return bool(common.mean() > 0.9 and np.nanmax(off, initial=0.0) <= ALIKE)


def _ground_below(subject: Subject) -> Array | None:
    """Return the elevation of the ground below the craft at each time of the pose, m."""
    clearance = subject.scalar("clearance")
    if subject.pose is None or clearance is None:
        return None
    time, down = subject.pose["down"]
    return -down - held(subject.samples(clearance), time)


def _plans(subject: Subject) -> list[Line]:
    """Return the predicted path of each plan over the distance flown, as one line with gaps."""
    path = subject.group("path", ("north", "east", "down"), 1)
    if path is None or subject.pose is None:
        return []
    times = path["north"][0]
    chosen = np.unique(np.linspace(0, len(times) - 1, min(len(times), PLANS)).round().astype(int))
    points = path["north"][1].shape[1]
    kept = np.unique(np.linspace(0, points - 1, min(points, PLAN_POINTS)).round().astype(int))
    north, east, down = (path[name][1][np.ix_(chosen, kept)] for name in ("north", "east", "down"))
    pose_time = subject.pose["north"][0]
    flown = np.interp(times[chosen], pose_time, subject.distance)
    start_n, start_e = (
        np.interp(times[chosen], pose_time, subject.pose[name][1]) for name in ("north", "east")
    )
    step_n = np.diff(north, axis=1, prepend=start_n[:, None])
    step_e = np.diff(east, axis=1, prepend=start_e[:, None])
    x = flown[:, None] + np.cumsum(np.hypot(step_n, step_e), axis=1)
    gap = np.full((len(chosen), 1), np.nan)
    return [
        Line(
            "plans",
            subject.number,
            np.hstack([x, gap]).ravel(),
            np.hstack([-down, gap]).ravel(),
            kind="faint",
        )
    ]


def clearance(subjects: Sequence[Subject]) -> Chart | None:
    """Return the chart of the height above ground, if it is known."""
    lines: list[Line] = []
    for each in subjects:
        assert each.pose is not None
        time = each.pose["north"][0]
        name, height = each.scalar("clearance"), each.scalar("height_agl")
        if name is None:
            continue
        y = held(each.samples(name), time)
        lines.append(Line("flown", each.number, each.distance, y, time, FLOWN))
        if height is not None:
            y = held(each.samples(height), time)
            lines.append(
                Line("set height", each.number, each.distance, y, time, SET_HEIGHT, "steps")
            )
    if not lines:
        return None
    return Chart(
        "Height above ground",
        ("distance flown", "m"),
        ("clearance", "m"),
        tuple(shared(lines)),
        link="distance",
        is_wide=True,
    )
