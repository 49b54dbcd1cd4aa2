"""How a flight was flown: how far off its reference, with which controls, at what cost."""

from collections.abc import Mapping, Sequence

import numpy as np

from orchestrator.recording.messages import Signal
from orchestrator.recording.topics import WALL_CLOCK
from orchestrator.report.charts import Array, Chart, Line, Mark, Section
from orchestrator.report.subject import Samples, Subject

TIME = ("time", "s")
TRUTH = {0: "false", 1: "true"}
DECADES = 100.0  # between values that one linear axis cannot show
NARROW = 12  # lines of a chart whose legend needs no more room


def tracking(subjects: Sequence[Subject]) -> Section | None:
    """Return how far each flight was from its reference, and its load factor."""
    rows: Mapping[str, tuple[str, str, str]] = {
        "height": ("Height off the reference", "above", "m"),
        "cross_track": ("Cross-track", "to the right", "m"),
        "speed": ("Speed off the reference", "faster", "m/s"),
        "heading": ("Heading off the reference", "to the right", "deg"),
    }
    known = [(each, each.deviation) for each in subjects if each.deviation is not None]
    charts: list[Chart] = []
    for field, (title, axis, unit) in rows.items():
        lines: list[Line] = []
        for each, off in known:
            values: Array = getattr(off, field)
            y = np.degrees(values) if unit == "deg" else values
            lines.append(Line(title.lower(), each.number, off.time, y))
        if lines:
            charts.append(Chart(title, TIME, (axis, unit), tuple(lines), link="time"))
    loads = [(each, name) for each in subjects if (name := each.scalar("load_factor"))]
    if loads:
        lines = [Line("load factor", each.number, *each.samples(name)) for each, name in loads]
        charts.append(Chart("Load factor", TIME, ("", "G"), tuple(lines), link="time"))
    return Section("Tracking", tuple(charts)) if charts else None


def controls(subjects: Sequence[Subject]) -> Section | None:
    """Return the controls with their limits."""
    found: dict[str, list[tuple[Subject, str]]] = {}
    for each in subjects:
        for signal in each.members("controls"):
            member = signal.name.removeprefix(f"{each.recording.scene['controls']}.")
            found.setdefault(member, []).append((each, signal.name))
    charts = [chart(member.capitalize(), rows) for member, rows in found.items()]
    return Section("Controls", tuple(charts)) if charts else None


def optimiser(subjects: Sequence[Subject]) -> Section | None:
    """Return what the component that plans publishes about itself, and how long it took."""
    charts: list[Chart] = []
    took = [(s, _durations(s)) for s in subjects]
    lines = [Line("update", s.number, x, y) for s, (x, y) in took if len(x)]
    if lines:
        charts.append(Chart("Update time", TIME, ("wall clock", "ms"), tuple(lines), link="time"))
    groups: dict[str, list[tuple[Subject, str]]] = {}
    for each in subjects:
        for signal in _about_itself(each):
            variable = signal.name.partition(".")[2]
            groups.setdefault(variable.partition(".")[0], []).append((each, signal.name))
    charts += [chart(group.replace("_", " ").capitalize(), rows) for group, rows in groups.items()]
    charts.sort(key=lambda one: (not one.categories, one.title != "Update time"))
    return Section("Optimiser", tuple(charts)) if charts else None


def chart(title: str, rows: Sequence[tuple[Subject, str]]) -> Chart:
    """Return the chart of signals over time, by recording and name; those of one name alike."""
    first, name = rows[0]
    members = list(dict.fromkeys(name.rpartition(".")[2] for _, name in rows))
    lines: list[Line] = []
    for subject, each in rows:
        times, values = subject.samples(each)
        member = each.rpartition(".")[2]
        is_held = subject.is_held(each)
        is_smooth = values.dtype.kind == "f" and not is_held
        lines.append(
            Line(
                member,
                subject.number,
                times,
                values.astype(np.float64),
                style=members.index(member),
                kind="line" if is_smooth else "steps",
                is_regular=not is_held,
            )
        )
    limits = dict.fromkeys(limit for s, each in rows for limit in s.limits(each))
    marks = [
        Mark(f"at {end} {limit:.4g}".replace("-", "−"), y=limit, is_upper=end == "most")
        for end, limit in limits
    ]
    signal = first.recording.signals[name]
    unit = first.unit(name)
    is_log = not (unit or marks or signal.items) and _spans_decades(lines)
    is_truth = all(s.recording[each][1].dtype.kind == "b" for s, each in rows)
    return Chart(
        title,
        TIME,
        ("logarithmic" if is_log else "", unit),
        tuple(lines),
        tuple(marks) if not signal.items else (),
        link="time",
        categories=signal.items or (TRUTH if is_truth else {}),
        is_wide=len(lines) > NARROW,
        is_log=is_log,
    )


def _spans_decades(lines: Sequence[Line]) -> bool:
    """Whether all values are positive, and the largest is more than two decades above the least."""
    values = np.concatenate([line.y[np.isfinite(line.y)] for line in lines])
    return len(values) > 0 and bool(0.0 < DECADES * values.min() < values.max())


def _about_itself(subject: Subject) -> list[Signal]:
    """Return the numbers that the plan's component publishes beside plan, path and reference."""
    scene, signals = subject.recording.scene, subject.recording.signals
    component = scene.get("plan", "").partition(".")[0]
    drawn = tuple(f"{scene[role]}." for role in ("plan", "path", "reference") if role in scene)
    return [
        signal
        for name, signal in signals.items()
        if component
        and name.startswith(f"{component}.")
        and not name.startswith(drawn)
        and not signal.shape
        and subject.recording.topics[signal.topic].metadata.get("kind") == "outputs"
        and subject.recording[name][1].dtype.kind in "fiub"
    ]


def _durations(subject: Subject) -> Samples:
    """Return when the plan's component stepped, s, and how long each step took, ms."""
    component = subject.recording.scene.get("plan", "").partition(".")[0]
    topic = subject.recording.topics.get(WALL_CLOCK)
    if topic is None or component not in topic.types:
        return np.empty(0), np.empty(0)
    times = np.array([time_ns for time_ns, _ in topic.raw]) / 1e9
    elapsed = np.array([getattr(message, component) for message in topic.decoded])
    ran = elapsed > 0
    return times[ran], 1e3 * elapsed[ran]
