"""What viewers draw beside craft and ground: lines ahead and behind, sensed cells, height, wind."""

from collections.abc import Callable
from itertools import accumulate, pairwise
from math import hypot, sqrt
from struct import pack
from typing import Any

import numpy as np

from orchestrator.recording.frames import MAP, ned_to_enu
from orchestrator.recording.roles import Look
from orchestrator.recording.scene_primitives import (
    ARROW,
    Color,
    Floats,
    color,
    cylinder,
    entity,
    line,
    pose,
    xyz,
)
from orchestrator.recording.scene_terrain import cloud, packed_color
from orchestrator.recording.views import QUATERNION, VECTOR, few
from orchestrator.recording.wire import (
    FIXED64,
    Instant,
    Layout,
    columns,
    nested,
    row_size,
    tag,
)

Style = tuple[Color, float]  # and thickness in pixels

PLAN: Style = (0.98, 0.62, 0.10, 1.0), 4.0
REFERENCE: Style = (1.0, 1.0, 1.0, 0.9), 2.0
TRACK: Style = (0.10, 0.45, 0.95, 1.0), 3.0
STICK: Color = (0.95, 0.95, 0.95, 0.9)
SHADOW: Color = (0.05, 0.05, 0.08, 0.45)
WIND: Color = (0.35, 0.85, 0.95, 0.9)
SHADOW_SIZE = xyz(1.4, 1.4, 0.04)
ARROW_SHAPE = b"".join(tag(k, FIXED64) + pack("<d", m) for k, m in ((3, 0.25), (4, 0.9), (5, 0.7)))
SEEN, HIDDEN = packed_color(64, 224, 208), packed_color(168, 92, 196)

Way = Callable[[Any, Floats], None]  # puts a line's points (3, n), in ENU and m, into an array
AHEAD, POINTS = 40, 60  # of a line ahead, and behind
EXACT = 64  # of drawn coordinates in 1/m: short in binary, hence small when compressed
LIFT = 0.4  # m, of sensed cells: else the ground hides half of each
HOVER = 0.25  # m, of the shadow above the ground, which may slope
ABOVE = 3.0  # m, of the wind's arrow above the craft


def paths(plan: Look | None, reference: Look | None, behind: tuple[Look, Look] | None) -> Layout:
    """Return the layout of plan and reference ahead, and of the trail with the craft at its end.

    Each has a fixed number of points, since that is cheap: some of a path, the first of a short
    trail several times.
    """
    ways: list[tuple[str, Style, int, Way]] = []
    if reference is not None:
        ways.append(("reference", REFERENCE, AHEAD, _ahead(reference, 1.0)))
    if plan is not None:
        ways.append(("plan", PLAN, AHEAD, _ahead(plan, -1.0)))
    if behind is not None:
        ways.append(("trail", TRACK, POINTS + 1, _behind(*behind)))
    pack = columns(nested(5, *VECTOR))
    size = row_size(nested(5, *VECTOR))
    pieces = [
        piece
        for name, (rgba, pixels), count, _ in ways
        for piece in entity(MAP, name, *line((f"{size * count}s",), pixels, rgba))
    ]
    ends = list(accumulate((count for _, _, count, _ in ways), initial=0))

    def computed(instant: Instant, values: Any) -> list[bytes]:
        points = np.empty((3, ends[-1]))
        for (i, j), (*_, draw) in zip(pairwise(ends), ways, strict=True):
            draw(values, points[:, i:j])
        data = pack(*_rounded(points))
        return [
            part for i, j in pairwise(ends) for part in (instant.stamp, data[size * i : size * j])
        ]

    return Layout(pieces, computed=computed, is_stamped=False)


def sensed(cells: Look, source: Look | None, fresh: Look) -> Layout:
    """Return the layout of newly sensed cells as a PointCloud; what was hidden is told apart."""

    def tail(_: Instant, values: Any) -> bytes:
        (new,) = fresh(values)
        north, east, elevation = (ring.take(new) for ring in cells(values))
        points = _rounded(np.stack(ned_to_enu(north, east, -elevation - LIFT)))
        is_hidden = source is not None and source(values)[0].take(new) == 2
        return cloud(points, np.where(is_hidden, HIDDEN, SEEN))

    return Layout((), tail=tail)


def marks(position: Look, clearance: Look | None, wind: Look | None) -> Layout:
    """Return the layout of a stick down to the ground with a shadow, and of the wind's arrow."""
    stick = (*nested(5, *VECTOR), *nested(5, *VECTOR))
    shadow = cylinder(VECTOR, SHADOW_SIZE, SHADOW)
    along = (*pose(1, VECTOR, QUATERNION), tag(2, FIXED64), "d", ARROW_SHAPE, color(6, WIND))
    pieces: list[bytes | str] = []
    if clearance is not None:
        pieces += entity(MAP, "clearance", *line(stick, 2.0, STICK), *shadow)
    if wind is not None:
        pieces += entity(MAP, "wind", *nested(ARROW, *along))

    def computed(instant: Instant, values: Any) -> list[Any]:
        north, east, down, *_ = position(values)
        x, y, z = ned_to_enu(north, east, down)
        found: list[Any] = []
        if clearance is not None:
            ground = z - clearance(values)[0]
            found += (instant.stamp, x, y, z, x, y, ground, x, y, ground + HOVER)
        if wind is not None:
            found += (instant.stamp, x, y, z + ABOVE, *_arrow(*ned_to_enu(*wind(values))))
        return found

    return Layout(pieces, computed=computed, is_stamped=False)


def _ahead(path: Look, up: float) -> Way:
    """Return what draws some of the points of a path; the sign of its heights."""

    def draw(values: Any, points: Floats) -> None:
        north, east, height, *_ = path(values)
        some = few(len(north), AHEAD)
        points[:] = east[some], north[some], up * height[some]

    return draw


def _behind(position: Look, trail: Look) -> Way:
    """Return what draws the points of the trail, with the craft at its end."""

    def draw(values: Any, points: Floats) -> None:
        (knots,) = trail(values)
        points[:, : POINTS - len(knots)] = knots[:1].T
        points[:, POINTS - len(knots) : -1] = knots.T
        points[:, -1] = ned_to_enu(*position(values)[:3])

    return draw


def _rounded(points: Floats) -> Floats:
    """Round in place, and return, what is short in binary then."""
    points *= EXACT
    np.rint(points, points)
    points /= EXACT
    return points


def _arrow(x: float, y: float, z: float) -> tuple[float, ...]:
    """Return the quaternion that turns x into a direction, and its length: 1 m for 1 m/s."""
    speed = hypot(x, y, z)
    if speed + x < 1e-9 * max(speed, 1.0):  # no direction, or just against x
        return 0.0, 0.0, 1.0, 0.0, speed
    size = sqrt(2.0 * speed * (speed + x))
    return 0.0, -z / size, y / size, (speed + x) / size, speed
