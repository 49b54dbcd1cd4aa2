"""Where a flight was, seen from above, over shaded terrain."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from orchestrator.report.charts import Array, Chart, Line, Mark, Picture, Section
from orchestrator.report.ground import Region, ground
from orchestrator.report.profile import FLOWN, REFERENCE, clearance, profile, shared
from orchestrator.report.shading import contour_interval, relief
from orchestrator.report.subject import Subject

STRIP = 3.2  # a map is at most this much longer than it is high
MARGIN = 0.04
PIXELS = 1000  # along the longer edge of the terrain


@dataclass(frozen=True)
class Frame:
    """A map's axes: x along a heading, y to its left; north up is a heading of 90 deg."""

    heading: float

    def axes(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Return x and y, m."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return c * north + s * east, s * north - c * east

    def ground(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return north and east, m."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        return c * x + s * y, s * x - c * y


def course(subjects: Sequence[Subject]) -> Section | None:
    """Return the map, the height profile and the clearance along it."""
    flown = [each for each in subjects if each.pose is not None]
    if not flown:
        return None
    charts = [_map(flown), profile(flown), clearance(flown)]
    return Section("Course", tuple(chart for chart in charts if chart is not None))


def _map(subjects: Sequence[Subject]) -> Chart:
    frame = _frame(subjects[0])
    lines: list[Line] = []
    marks: list[Mark] = []
    for each in subjects:
        assert each.pose is not None
        time, north = each.pose["north"]
        x, y = frame.axes(north, each.pose["east"][1])
        lines.append(Line("flown", each.number, x, y, time, FLOWN))
        if (off := each.deviation) is not None:
            x, y = frame.axes(off.north, off.east)
            lines.append(Line("reference", each.number, x, y, off.time, REFERENCE, "broad"))
    is_shared = _same(subjects, _waypoints)
    for each in subjects[:1] if is_shared else subjects:
        for k, (north, east) in enumerate(_waypoints(each), start=1):
            x, y = frame.axes(np.array(north), np.array(east))
            who = None if is_shared else each.number
            marks.append(Mark(f"way-point {k}", float(x), float(y), who))
    lines = shared(lines)
    extent = _extent(lines, marks)
    source, picture = _picture(subjects, frame, extent)
    return Chart(
        "Map",
        ("along", "m"),
        ("across", "m"),
        tuple(lines),
        tuple(marks),
        extent=extent,
        picture=picture,
        north_deg=-float(np.degrees(frame.heading)),
        note=source,
        is_wide=True,
    )


def _frame(subject: Subject) -> Frame:
    """Turn a long flight's map so that it runs from left to right; leave others north up."""
    assert subject.pose is not None
    north, east = (subject.pose[name][1] for name in ("north", "east"))
    known = np.flatnonzero(np.isfinite(north + east))
    if len(known) < 2:
        return Frame(np.pi / 2)
    ends = known[[0, -1]]
    along_n, along_e = np.diff(north[ends])[0], np.diff(east[ends])[0]
    is_long = np.hypot(along_n, along_e) > 0.5 * subject.distance[-1] > 0
    return Frame(float(np.arctan2(along_e, along_n)) if is_long else np.pi / 2)


def _waypoints(subject: Subject) -> list[tuple[float, float]]:
    """Return the way-points, m, that the reference's component was given."""
    component = subject.recording.scene.get("reference", "").partition(".")[0]
    entry = subject.recording.scenario.get("components", {}).get(component, {})
    points: Any = entry.get("parameters", {}).get("waypoints_m")
    try:
        array = np.array(points, np.float64)
    except (TypeError, ValueError):
        return []
    if array.ndim != 2 or array.shape[1] < 2 or not np.isfinite(array).all():
        return []
    return [(float(point[0]), float(point[1])) for point in array]


def _extent(lines: Sequence[Line], marks: Sequence[Mark]) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of a map that holds all of this."""
    x = np.concatenate([*(line.x for line in lines), [m.x for m in marks if m.x is not None]])
    y = np.concatenate([*(line.y for line in lines), [m.y for m in marks if m.y is not None]])
    known = np.isfinite(x + y)
    if not known.any():
        return -1.0, 1.0, -1.0, 1.0
    x, y = x[known], y[known]
    width, height = float(np.ptp(x)), float(np.ptp(y))
    middle_x, middle_y = float(x.min()) + width / 2, float(y.min()) + height / 2
    width = max(width, 0.8 * height, 1.0) * (1 + 2 * MARGIN)
    height = max(height * (1 + 2 * MARGIN), width / STRIP)
    return middle_x - width / 2, middle_x + width / 2, middle_y - height / 2, middle_y + height / 2


def _picture(
    subjects: Sequence[Subject], frame: Frame, extent: tuple[float, float, float, float]
) -> tuple[str, Picture | None]:
    """Return the shaded terrain, and what it is."""
    if not _same(subjects, _terrain):
        return "The recordings are of different terrain, which is left out.", None
    found = ground(subjects[0].recording)
    if found is None:
        return "", None
    left, right, bottom, top = extent
    spacing = max(right - left, top - bottom) / PIXELS
    x = np.arange(left + spacing / 2, right, spacing)
    y = np.arange(top - spacing / 2, bottom, -spacing)
    north, east = frame.ground(*np.meshgrid(x, y))
    region: Region = (north.min(), north.max(), east.min(), east.max())
    elevation = found.over(region)(north, east)
    known = elevation[np.isfinite(elevation)]
    if not len(known):
        return "", None
    low, high = known.min(), known.max()
    interval = contour_interval(high - low)
    note = f"Relief: {found.source}, {low:z.0f} to {high:z.0f} m, a contour every {interval:g} m."
    if high - low < interval:
        note = f"Relief: {found.source}, level at {low:z.0f} m."
    return note, Picture(relief(elevation, spacing, interval), left, right, bottom, top)


def _terrain(subject: Subject) -> object:
    """Return what tells one terrain from another."""
    name = subject.recording.scene.get("terrain", "").strip("${}")
    return subject.recording.provenance.get(f"resources.{name}.sha256", name)


def _same(subjects: Sequence[Subject], what: Any) -> bool:
    return all(what(each) == what(subjects[0]) for each in subjects)
