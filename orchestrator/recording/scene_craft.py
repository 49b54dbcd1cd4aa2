"""A Yamaha R-50 as viewers draw it, in its own frame: FLU, m, the origin at the centre of mass.

Light and shade are in the colours of the vertices: not every viewer has a sun.
"""

from collections.abc import Sequence
from itertools import chain
from math import cos, sin, sqrt, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchestrator.recording.frames import BODY
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.scene_primitives import (
    CUBE,
    TURN_Z,
    Color,
    Floats,
    color,
    cylinder,
    entity,
    joined,
    pose,
    triangles,
    xyz,
)
from orchestrator.recording.views import QUATERNION
from orchestrator.recording.wire import Instant, Layout, constant, delimited, nested

ROTOR_RADIUS = 1.535
TURNS_PER_S = 1.3  # not the rotor's 850 per minute: drawn 20 times a second, that looks like noise
MAST = (0.0, 0.0, 0.62)
TAIL = (-1.86, 0.09, 0.2)
TAIL_RADIUS = 0.26

ROTOR = "rotor"  # the frame that turns
SIDEWAYS = (constant(QUATERNION, sqrt(0.5), 0.0, 0.0, sqrt(0.5)),)
AROUND = 16  # points of a section of the fuselage

Point = tuple[float, float, float]
Rgb = tuple[float, float, float]
WHITE, RED = (0.96, 0.96, 0.94), (0.84, 0.20, 0.12)
DARK, METAL = (0.12, 0.13, 0.16), (0.55, 0.57, 0.60)
SHADE: Color = (0.2, 0.22, 0.26, 0.16)


class Solid(NamedTuple):
    """Vertices (n, 3) in m, their colours (n, 3), and triangles (k, 3) as indices of vertices."""

    points: Floats
    rgb: Floats
    corners: NDArray[np.int64]


def craft(stamp: bytes) -> bytes:
    """Return a SceneUpdate with the fuselage, and the blades in a frame of their own."""
    solid = _together([*_body(), *_tail(), *_skids()])
    rgba = np.column_stack([_lit(solid), np.ones(len(solid.points))])
    fuselage = triangles(solid.points, rgba, solid.corners)
    discs = (
        *cylinder((xyz(*MAST),), xyz(2 * ROTOR_RADIUS, 2 * ROTOR_RADIUS, 0.01), SHADE),
        *cylinder((xyz(*TAIL),), xyz(2 * TAIL_RADIUS, 2 * TAIL_RADIUS, 0.01), SHADE, SIDEWAYS),
    )
    blade = color(3, (*DARK, 1.0))
    boxes = (
        (xyz(0.0, 0.0, 0.0), xyz(2 * ROTOR_RADIUS, 0.11, 0.02)),
        (xyz(0.0, 0.0, -0.08), xyz(0.1, 1.0, 0.025)),  # the stabiliser bar
    )
    cubes = (nested(CUBE, *pose(1, (at,)), delimited(2, size), blade) for at, size in boxes)
    return joined(entity(BODY, "fuselage", fuselage, *discs, stamp=stamp)) + joined(
        entity(ROTOR, "rotor", *chain.from_iterable(cubes), stamp=stamp)
    )


def rotor() -> Layout:
    """Return the layout of the rotor's FrameTransform: clockwise seen from above."""
    frames = delimited(2, BODY.encode()) + delimited(3, ROTOR.encode())
    pieces = (frames, *nested(4, xyz(*MAST)), *nested(5, *TURN_Z))

    def computed(instant: Instant, _: object) -> tuple[float, float]:
        half = -0.5 * tau * (TURNS_PER_S * (instant.time_ns - EPOCH_NS) * 1e-9 % 1.0)
        return sin(half), cos(half)

    return Layout(pieces, computed=computed)


def _body() -> list[Solid]:
    """Return the fuselage with its dark nose, and the mast."""
    stations = np.array([
        # x, half width, half height, middle
        [0.98, 0.01, 0.01, -0.12],
        [0.95, 0.07, 0.06, -0.12],
        [0.84, 0.13, 0.12, -0.10],
        [0.62, 0.18, 0.19, -0.05],
        [0.36, 0.20, 0.24, 0.00],
        [0.00, 0.21, 0.27, 0.03],
        [-0.30, 0.20, 0.25, 0.06],
        [-0.54, 0.14, 0.18, 0.10],
        [-0.72, 0.07, 0.09, 0.15],
    ])  # fmt: skip
    hull = _loft(stations, WHITE)
    x, _, z = hull.points.T
    hull.rgb[(x > 0.5) & (z > -0.06)] = DARK
    hull.rgb[z < -0.17] = RED
    mast = _tube([(0, 0, 0.3), (0, 0, 0.6)], 0.035, METAL)
    hub = _tube([(0, 0, 0.58), (0, 0, 0.66)], 0.07, METAL)
    return [hull, mast, hub]


def _tail() -> list[Solid]:
    """Return boom, fins and stabiliser."""
    upper = [(-1.62, 0, 0.2), (-1.9, 0, 0.2), (-2.08, 0, 0.6), (-1.92, 0, 0.6)]
    lower = [(-1.7, 0, 0.2), (-1.95, 0, -0.12), (-1.86, 0, -0.12), (-1.55, 0, 0.18)]
    across = [(-1.1, -0.36, 0.18), (-1.1, 0.36, 0.18), (-1.26, 0.36, 0.18), (-1.26, -0.36, 0.18)]
    return [
        _tube([(-0.6, 0, 0.16), (-1.88, 0, 0.2)], 0.06, WHITE, 0.035),
        _tube([(-1.5, 0, 0.19), (-1.72, 0, 0.195)], 0.05, RED, 0.044),
        _plate(upper, (0, 0.015, 0), RED),
        _plate(lower, (0, 0.015, 0), RED),
        _plate(across, (0, 0, 0.012), WHITE),
    ]


def _skids() -> list[Solid]:
    """Return two runners on four struts."""
    made: list[Solid] = []
    for side in (-1.0, 1.0):
        bent = ((-0.6, -0.55), (0.5, -0.55), (0.64, -0.52), (0.72, -0.45))
        runner = [(x, side * 0.36, z) for x, z in bent]
        made.append(_tube(runner, 0.022, METAL))
        made += [
            _tube([(x, side * 0.12, -0.2), (x, side * 0.36, -0.55)], 0.018, METAL)
            for x in (0.3, -0.3)
        ]
    return made


def _loft(stations: Floats, rgb: Rgb) -> Solid:
    """Return a skin over superelliptic sections, rows of x, half width, half height, middle."""
    angle = tau * np.arange(AROUND) / AROUND
    y, z = (np.sign(c) * np.abs(c) ** 0.8 for c in (np.cos(angle), np.sin(angle)))
    x, width, height, middle = (column[:, None] for column in stations.T)
    return _skin(np.stack([x + 0 * y, width * y, middle + height * z], axis=-1), rgb)


def _tube(way: Sequence[Point], radius: float, rgb: Rgb, end: float = 0.0) -> Solid:
    """Return a round bar along a way, of another radius at its end if one is given."""
    at = np.array(way, float)
    along = np.gradient(at, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    side = np.cross(along, np.where(abs(along[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]))
    side /= np.linalg.norm(side, axis=1)[:, None]
    other = np.cross(along, side)
    angle = tau * np.arange(8) / 8
    ring = side[:, None] * np.cos(angle)[:, None] + other[:, None] * np.sin(angle)[:, None]
    radii = np.linspace(radius, end or radius, len(at))
    return _skin(at[:, None] + radii[:, None, None] * ring, rgb)


def _skin(rings: Floats, rgb: Rgb) -> Solid:
    """Return the surface through rings (m, n, 3) of points, closed at both ends."""
    m, n = rings.shape[:2]
    i, j = np.meshgrid(np.arange(m - 1), np.arange(n), indexing="ij")
    a, b = i * n + j, i * n + (j + 1) % n
    sides = np.stack([a, b, b + n, a, b + n, a + n], axis=-1).reshape(-1, 3)
    fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=-1)
    corners = np.concatenate([sides, fan[:, ::-1], fan + (m - 1) * n])
    return Solid(rings.reshape(-1, 3), np.tile(rgb, (m * n, 1)), corners)


def _plate(outline: Sequence[Point], half: Point, rgb: Rgb) -> Solid:
    """Return a thin slab with a convex outline."""
    at = np.array(outline, float)
    return _skin(np.stack([at - half, at + half]), rgb)


def _together(solids: list[Solid]) -> Solid:
    """Return several solids as one."""
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)])
    return Solid(
        np.concatenate([solid.points for solid in solids]),
        np.concatenate([solid.rgb for solid in solids]),
        np.concatenate([s.corners + start for s, start in zip(solids, starts, strict=False)]),
    )


def _lit(solid: Solid) -> Floats:
    """Return the colours under a bright sky."""
    a, b, c = (solid.points[solid.corners[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(solid.points)
    for k in range(3):
        np.add.at(normals, solid.corners[:, k], faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    light = 0.78 + 0.30 * (normals @ np.array([0.3, 0.3, 0.906]))
    return np.round(255 * np.clip(solid.rgb * light[:, None], 0.0, 1.0)) / 256
