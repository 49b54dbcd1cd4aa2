"""A Foxglove scene in Rerun's terms: entities as meshes, lines, bodies and arrows."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

SOLID = rr.components.FillMode.Solid


def log_scene(stream: rr.RecordingStream, topic: str, message: Any) -> None:
    """Log the entities of a SceneUpdate, each in its frame; one shape of a kind in an entity."""
    for entity in message.entities:
        path = f"{topic}/{entity.id}"
        frame = rr.CoordinateFrame(entity.frame_id)
        for name, shape in _shapes(entity):
            stream.log(f"{path}/{name}", shape, frame)


def _shapes(entity: Any) -> Iterator[tuple[str, Any]]:
    for t in entity.triangles:
        yield (
            "mesh",
            rr.Mesh3D(
                vertex_positions=_points(t.points),
                triangle_indices=np.reshape(t.indices, (-1, 3)),
                vertex_colors=_colors(t.colors),
            ),
        )
    if entity.lines:
        radii = [(-0.5 if line.scale_invariant else 0.5) * line.thickness for line in entity.lines]
        strips = rr.LineStrips3D(
            [_points(line.points) for line in entity.lines],
            radii=radii,  # negative: on the screen
            colors=_colors([line.color for line in entity.lines]),
        )
        yield "lines", strips
    if entity.cubes:
        yield (
            "boxes",
            rr.Boxes3D(
                centers=_points([c.pose.position for c in entity.cubes]),
                half_sizes=0.5 * _points([c.size for c in entity.cubes]),
                quaternions=_turns(entity.cubes),
                colors=_colors([c.color for c in entity.cubes]),
                fill_mode=SOLID,
            ),
        )
    if entity.cylinders:
        yield (
            "discs",
            rr.Cylinders3D(
                centers=_points([c.pose.position for c in entity.cylinders]),
                lengths=[c.size.z for c in entity.cylinders],
                radii=[0.5 * c.size.x for c in entity.cylinders],
                quaternions=_turns(entity.cylinders),
                colors=_colors([c.color for c in entity.cylinders]),
                fill_mode=SOLID,
            ),
        )
    if entity.arrows:
        yield (
            "arrows",
            rr.Arrows3D(
                origins=_points([a.pose.position for a in entity.arrows]),
                vectors=[_along(a.pose.orientation, a.shaft_length) for a in entity.arrows],
                radii=[0.5 * a.shaft_diameter for a in entity.arrows],
                colors=_colors([a.color for a in entity.arrows]),
            ),
        )


def _points(points: Sequence[Any]) -> NDArray[np.float64]:
    return np.array([(p.x, p.y, p.z) for p in points], np.float64).reshape(-1, 3)


def _colors(colors: Sequence[Any]) -> NDArray[np.uint8]:
    rgba = np.array([(c.r, c.g, c.b, c.a) for c in colors], np.float64).reshape(-1, 4)
    return np.round(255.0 * rgba).astype(np.uint8)


def _turns(bodies: Sequence[Any]) -> list[rr.Quaternion]:
    turns = (body.pose.orientation for body in bodies)
    return [rr.Quaternion(xyzw=(q.x, q.y, q.z, q.w)) for q in turns]


def _along(q: Any, length: float) -> tuple[float, float, float]:
    """Return x, turned by a quaternion, with a length."""
    x = 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
    y = 2.0 * (q.x * q.y + q.z * q.w)
    z = 2.0 * (q.x * q.z - q.y * q.w)
    return length * x, length * y, length * z
