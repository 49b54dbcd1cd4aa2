"""What viewers draw beside craft and ground: lines ahead and behind, sensed cells, height, wind."""

from collections.abc import Callable
from itertools import accumulate, pairwise
from math import hypot, sqrt
from operator import itemgetter
from struct import pack
from typing import Any

import numpy as np

from orchestrator.recording.frames import MAP, ned_to_enu
from orchestrator.recording.roles import Filled
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
    Buffer,
    Layout,
    Values,
    columns,
    nested,
    row_size,
    tag,
)

Look = tuple[Color, float]  # and thickness in pixels

PLAN: Look = (0.98, 0.62, 0.10, 1.0), 4.0
REFERENCE: Look = (1.0, 1.0, 1.0, 0.9), 2.0
TRACK: Look = (0.10, 0.45, 0.95, 1.0), 3.0
STICK: Color = (0.95, 0.95, 0.95, 0.9)
SHADOW: Color = (0.05, 0.05, 0.08, 0.45)
WIND: Color = (0.35, 0.85, 0.95, 0.9)
SHADOW_SIZE = xyz(1.4, 1.4, 0.04)
ARROW_SHAPE = b"".join(tag(k, FIXED64) + pack("<d", m) for k, m in ((3, 0.25), (4, 0.9), (5, 0.7)))
SEEN, HIDDEN = packed_color(64, 224, 208), packed_color(168, 92, 196)

Ned = tuple[Floats, Floats, Floats] | Floats
AHEAD, TRAIL = 40, 60  # points of a line ahead, and behind
EXACT = 64  # of drawn coordinates in 1/m: short in binary, hence small when compressed
LIFT = 0.4  # m, of sensed cells: else the ground hides half of each
HOVER = 0.25  # m, of the shadow above the ground, which may slope
ABOVE = 3.0  # m, of the wind's arrow above the craft


def paths(plan: Filled | None, reference: Filled | None, position: Filled | None) -> Layout:
    """Return the layout of plan and reference ahead, and of the trail behind.

    Each has a fixed number of points, since that is cheap: some of a path, the first of a short
    trail several times.
    """
    ways: list[tuple[str, Look, int, Callable[[Values], Ned]]] = []
    if reference is not None:
        ways.append(("reference", REFERENCE, AHEAD, _ahead("reference", reference, -1.0)))
    if plan is not None:
        ways.append(("plan", PLAN, AHEAD, _ahead("path", plan, 1.0)))
    if position is not None:
        ways.append(("trail", TRACK, TRAIL + 1, _behind(position)))
    pack = columns(nested(5, *VECTOR))
    size = row_size(nested(5, *VECTOR))
    pieces = [
        piece
        for name, (rgba, pixels), count, _ in ways
        for piece in entity(MAP, name, *line((f"{size * count}s",), pixels, rgba))
    ]
    ends = [size * end for end in accumulate((count for _, _, count, _ in ways), initial=0)]

    def scalars(values: Values) -> list[bytes]:
        north, east, down = np.concatenate([way(values) for *_, way in ways], axis=1)
        data = pack(*_rounded(ned_to_enu(north, east, down)))
        stamp = values["stamp"]
        return [part for i, j in pairwise(ends) for part in (stamp, data[i:j])]

    return Layout(pieces, scalars, is_stamped=False)


def sensed(cells: Filled, source: str | None) -> Layout:
    """Return the layout of newly sensed cells as a PointCloud; what was hidden is told apart."""
    pick = itemgetter(*cells.names)

    def rest(values: Values) -> list[Buffer]:
        scan, fresh = values["scan"], values["fresh"]
        north, east, elevation = (ring[fresh] for ring in pick(scan))
        x, y, z = _rounded(ned_to_enu(north, east, -elevation - LIFT))
        rgb = SEEN if source is None else np.where(scan[source][fresh] == 2, HIDDEN, SEEN)
        return [cloud(x, y, z, rgb)]

    return Layout((), lambda _: (), rest)


def marks(position: Filled, clearance: Filled | None, wind: Filled | None) -> Layout:
    """Return the layout of a stick down to the ground with a shadow, and of the wind's arrow."""
    stick = (*nested(5, *VECTOR), *nested(5, *VECTOR))
    shadow = cylinder(VECTOR, SHADOW_SIZE, SHADOW)
    along = (*pose(1, VECTOR, QUATERNION), tag(2, FIXED64), "d", ARROW_SHAPE, color(6, WIND))
    pieces: list[bytes | str] = []
    if clearance is not None:
        pieces += entity(MAP, "clearance", *line(stick, 2.0, STICK), *shadow)
    if wind is not None:
        pieces += entity(MAP, "wind", *nested(ARROW, *along))
    find = itemgetter(*position.names[:3])
    height = None if clearance is None else clearance.names[0]
    air = None if wind is None else itemgetter(*wind.names)

    def scalars(values: Values) -> list[Any]:
        stamp = values["stamp"]
        x, y, z = ned_to_enu(*find(values["pose"]))
        found: list[Any] = []
        if height is not None:
            ground = z - values["clearance"][height]
            found += [stamp, x, y, z, x, y, ground, x, y, ground + HOVER]
        if air is not None:
            found += [stamp, x, y, z + ABOVE, *_arrow(*ned_to_enu(*air(values["wind"])))]
        return found

    return Layout(pieces, scalars, is_stamped=False)


def _ahead(role: str, filled: Filled, down: float) -> Callable[[Values], Ned]:
    """Return a function to some of the points of a path."""
    pick = itemgetter(*filled.names)

    def way(values: Values) -> Ned:
        north, east, last, *_ = pick(values[role])
        some = few(len(north), AHEAD)
        return north[some], east[some], down * last[some]

    return way


def _behind(position: Filled) -> Callable[[Values], Ned]:
    """Return a function to the points of the trail, with the craft at its end."""
    pick = itemgetter(*position.names[:3])

    def way(values: Values) -> Ned:
        trail = values["trail"]
        made = np.empty((3, TRAIL + 1))
        made[:, : TRAIL - len(trail)] = trail[:1].T
        made[:, TRAIL - len(trail) : -1] = trail.T
        made[:, -1] = pick(values["pose"])
        return made

    return way


def _rounded(at: tuple[Floats, Floats, Floats]) -> Floats:
    return np.round(EXACT * np.stack(at)) / EXACT


def _arrow(x: float, y: float, z: float) -> tuple[float, ...]:
    """Return the quaternion that turns x into a direction, and its length: 1 m for 1 m/s."""
    speed = hypot(x, y, z)
    if speed + x < 1e-9 * max(speed, 1.0):  # no direction, or just against x
        return 0.0, 0.0, 1.0, 0.0, speed
    size = sqrt(2.0 * speed * (speed + x))
    return 0.0, -z / size, y / size, (speed + x) / size, speed
