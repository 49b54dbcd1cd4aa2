"""The ground that viewers draw: fine around the flight, coarser towards the horizon, shaded."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from orchestrator.recording.frames import MAP
from orchestrator.recording.scene_primitives import (
    Color,
    Floats,
    entity,
    joined,
    line,
    points,
    triangles,
)
from orchestrator.recording.wire import delimited

MAX_POSTS = 30_000
FINEST = 8.0  # m
MARGIN = 500.0  # m, around the straight flight
GROWTH = 1.25  # of the spacing, from post to post towards the horizon
HORIZON = 6000.0  # m
EXACT = 32  # of coordinates in 1/m: short in binary, hence small when compressed

NET = 100.0  # m, between the lines on the ground
ABOVE = 0.25  # m, of these lines: in the ground they would come and go
BAND = 10.0  # m, of height in one tone
INK: Color = (0.38, 0.42, 0.31, 0.5)

# low to high: valley, meadow, dry grass, rock, pale rock; red, green, blue
TINTS = np.array(
    [[70, 104, 74], [112, 139, 83], [168, 165, 108], [176, 145, 106], [196, 180, 160]]
) / 255.0  # fmt: skip


class Ground(Protocol):
    """A terrain resource that can be drawn.

    One that also has ``elevation(north, east)``, m, is drawn finer than its posts.
    """

    def surface(self) -> tuple[Floats, Floats, Floats]:
        """Return the posts: north (n,) and east (m,), rising, and elevation (n, m), all m."""
        ...


class Box(NamedTuple):
    """Edges, m."""

    south: float
    north: float
    west: float
    east: float


class Mesh(NamedTuple):
    """Posts of a rectilinear grid in ENU: x (m,), y (n,), z (n, m) in m; rgb (n, m, 3).

    Rows and columns of ``near`` are those around the flight.
    """

    x: Floats
    y: Floats
    z: Floats
    rgb: Floats
    near: tuple[NDArray[np.int64], NDArray[np.int64]]


def flight_box(position: tuple[float, float], way: tuple[float, float]) -> Box:
    """Return where a flight may lead that starts at a position and goes a way, north and east, m."""
    (n, e), (dn, de) = position, way
    return Box(
        min(n, n + dn) - MARGIN, max(n, n + dn) + MARGIN,
        min(e, e + de) - MARGIN, max(e, e + de) + MARGIN,
    )  # fmt: skip


def terrain_mesh(ground: Ground, box: Box) -> Mesh:
    """Return the ground around a box, with at most so many posts; NaN where there is none."""
    posts = ground.surface()
    north, east, z = posts
    limits = Box(float(north[0]), float(north[-1]), float(east[0]), float(east[-1]))
    elevation: Callable[[Floats, Floats], Floats] | None = getattr(ground, "elevation", None)
    if elevation is None or np.isnan(z).any():
        y, x, z = _thinned(posts, box)
    else:
        y, x = _axes(box, limits)
        z = elevation(y[:, None], x[None, :])
    y, x, z = (np.round(EXACT * values) / EXACT for values in (y, x, z))
    near = (
        np.flatnonzero((y >= box.south) & (y <= box.north)),
        np.flatnonzero((x >= box.west) & (x <= box.east)),
    )
    return Mesh(x, y, z, _shaded(x, y, z, z[np.ix_(*near)]), near)


def mesh_entity(mesh: Mesh, stamp: bytes) -> bytes:
    """Return a SceneUpdate with the ground as triangles, counter-clockwise seen from above."""
    count = mesh.z.shape
    number = np.arange(mesh.z.size).reshape(count)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    corners = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    xyz, rgb = _vertices(mesh)
    there = np.isfinite(xyz[:, 2])
    corners = (np.cumsum(there) - 1)[corners[there[corners].all(axis=1)]]
    rgba = np.column_stack([rgb, np.ones(len(rgb))])
    shape = triangles(xyz[there], rgba[there], corners)
    return joined(entity(MAP, "terrain", shape, *_net(mesh), stamp=stamp))


def packed_color(red: Any, green: Any, blue: Any) -> Any:
    """Return colours, 0 to 255, as a PointCloud has them: red in the lowest byte, alpha 255."""
    return red | green << 8 | blue << 16 | 255 << 24


def cloud(points: Floats, rgba: Any) -> bytes:
    """Return a PointCloud, but for its stamp, of points (3, n) with packed colours."""
    table = np.empty((points.shape[1], 4), "<f4")  # of POINT, whose fields are slower to fill
    table[:, :3] = points.T
    table.view("<u4")[:, 3] = rgba
    return CLOUD_HEAD + delimited(6, table.tobytes())


def cloud_of(mesh: Mesh) -> bytes:
    """Return the same ground as a PointCloud."""
    xyz, rgb = _vertices(mesh)
    there = np.isfinite(xyz[:, 2])
    return cloud(xyz[there].T, packed_color(*(255.0 * rgb[there].T).astype(np.uint32)))


def _cloud_head() -> bytes:
    from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

    head = PointCloud(frame_id=MAP, point_stride=16)
    head.pose.position.SetInParent()  # the origin; Rerun takes none for null
    head.pose.orientation.w = 1.0
    for k, name in enumerate("xyz"):
        head.fields.add(name=name, offset=4 * k, type="FLOAT32")
    for k, name in enumerate(("red", "green", "blue", "alpha")):
        head.fields.add(name=name, offset=12 + k, type="UINT8")
    return head.SerializeToString(deterministic=True)


POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgba", "<u4")])
CLOUD_HEAD = _cloud_head()


def _axes(box: Box, limits: Box) -> tuple[Floats, Floats]:
    """Return north and east of a grid as fine in the box as `MAX_POSTS` allows."""
    spacing = FINEST
    while True:
        y = _axis(box.south, box.north, spacing, limits.south, limits.north)
        x = _axis(box.west, box.east, spacing, limits.west, limits.east)
        if y.size * x.size <= MAX_POSTS:
            return y, x
        spacing *= 1.05


def _axis(low: float, high: float, spacing: float, least: float, most: float) -> Floats:
    """Return even posts from low to high and ever wider ones beyond, none outside the limits."""
    inner = np.arange(low, high + 0.5 * spacing, spacing)
    rings = np.ceil(np.log1p(HORIZON * (GROWTH - 1.0) / spacing) / np.log(GROWTH))
    out = spacing * np.cumsum(GROWTH ** np.arange(1.0, rings + 1.0))
    axis = np.concatenate([low - out[::-1], inner, inner[-1] + out])
    first, last = max(least, float(axis[0])), min(most, float(axis[-1]))
    return np.array([first, *axis[(axis > first) & (axis < last)], last])


def _thinned(posts: tuple[Floats, Floats, Floats], box: Box) -> tuple[Floats, Floats, Floats]:
    """Return the posts up to the horizon, so many left out that the rest are few enough."""
    north, east, z = posts
    rows = _within(north, box.south - HORIZON, box.north + HORIZON)
    cols = _within(east, box.west - HORIZON, box.east + HORIZON)
    step = max(1, int(np.ceil(np.sqrt(z[rows, cols].size / MAX_POSTS))))
    rows, cols = (slice(s.start, s.stop, step) for s in (rows, cols))
    return north[rows], east[cols], z[rows, cols]


def _within(axis: Floats, low: float, high: float) -> slice:
    first, last = np.searchsorted(axis, [low, high])
    return slice(max(int(first) - 1, 0), int(last) + 1)


def _net(mesh: Mesh) -> list[bytes]:
    """Return lines on the ground around the flight, about 100 m apart, for an eye to measure by."""
    rows, cols = mesh.near
    if min(len(rows), len(cols)) < 2:
        return []
    x, y, z = mesh.x[cols], mesh.y[rows], mesh.z[np.ix_(rows, cols)] + ABOVE
    every = max(1, round(NET * (len(y) - 1) / float(y[-1] - y[0])))
    along = [np.column_stack([x, np.full_like(x, y[k]), z[k]]) for k in range(0, len(y), every)]
    across = [np.column_stack([np.full_like(y, x[k]), y, z[:, k]]) for k in range(0, len(x), every)]
    ways = (way[np.isfinite(way[:, 2])] for way in along + across)
    return [joined(line((points(5, way),), 1.0, INK)) for way in ways if len(way) > 1]


def _shaded(x: Floats, y: Floats, z: Floats, near: Floats) -> Floats:
    """Return colours by height, in the light of a sun in the north-west, 40 degrees high."""
    if min(z.shape) < 2:
        return np.broadcast_to(TINTS[1], (*z.shape, 3))
    low, high = np.nanpercentile(near if np.isfinite(near).any() else z, [2.0, 98.0])
    band = 1.0 + 0.04 * np.where(np.floor(z / BAND) % 2.0 < 1.0, 1.0, -1.0)
    rank = np.clip((z - low) / max(high - low, 30.0), 0.0, 1.0) * (len(TINTS) - 1)
    tint = np.stack([np.interp(rank, range(len(TINTS)), band) for band in TINTS.T], axis=-1)
    up, right = np.gradient(z, y, x)
    steep = 2.0  # slopes look flatter than they fly
    light = np.array([-0.542, 0.542, 0.643])  # x, y, z
    normal = np.stack([-steep * right, -steep * up, np.ones_like(z)], axis=-1)
    shade = np.clip(normal @ light / np.linalg.norm(normal, axis=-1), 0.0, 1.0) / light[2]
    return np.round(255 * np.clip(tint * (band * (0.45 + 0.55 * shade))[..., None], 0.0, 1.0)) / 256


def _vertices(mesh: Mesh) -> tuple[Floats, Floats]:
    """Return points (n m, 3) and their colours (n m, 3), row by row."""
    x, y = np.meshgrid(mesh.x, mesh.y)
    xyz = np.column_stack([x.ravel(), y.ravel(), mesh.z.ravel()])
    return xyz, mesh.rgb.reshape(-1, 3)
