"""Foxglove's drawing primitives on the wire: constants where they are, codes where values go.

Every entity and primitive has a pose with an orientation of length one: the default of protobuf,
all zeros, is none.
"""

from struct import pack

import numpy as np
from numpy.typing import NDArray

from orchestrator.recording.views import QUATERNION, UPRIGHT, VECTOR
from orchestrator.recording.wire import (
    FIXED64,
    STAMP,
    VARINT,
    columns,
    constant,
    delimited,
    nested,
    tag,
)

Floats = NDArray[np.float64]
Pieces = tuple[bytes | str, ...]
ORIGIN = constant(VECTOR, 0.0, 0.0, 0.0)
Color = tuple[float, float, float, float]  # red, green, blue, alpha: 0 to 1

ARROW, CUBE, CYLINDER, LINE, TRIANGLES = 7, 8, 10, 11, 12  # fields of foxglove.SceneEntity
TURN_Z = (b"\x09" + bytes(8) + b"\x11" + bytes(8) + b"\x19", "d", b"\x21", "d")
"""A quaternion about z: its last two numbers."""


def entity(frame: str, name: str, *primitives: bytes | str, stamp: bytes | str = STAMP) -> Pieces:
    """Return an entity of a SceneUpdate; its stamp, if not given, is the first code."""
    return nested(
        2, stamp, delimited(2, frame.encode()), delimited(3, name.encode()), b"\x28\x01", *primitives
    )  # fmt: skip


def color(number: int, rgba: Color) -> bytes:
    """Return a colour in a field."""
    return delimited(number, constant(QUATERNION, *rgba))


def xyz(x: float, y: float, z: float) -> bytes:
    """Return what a vector or point consists of."""
    return constant(VECTOR, x, y, z)


def pose(number: int, position: Pieces = (ORIGIN,), turn: Pieces = (UPRIGHT,)) -> Pieces:
    """Return a pose in a field: pieces of its position and quaternion."""
    return nested(number, *nested(1, *position), *nested(2, *turn))


def points(number: int, positions: Floats) -> bytes:
    """Return the points (n, 3) of a primitive."""
    return columns(nested(number, *VECTOR))(*positions.T)


def colors(number: int, rgba: Floats) -> bytes:
    """Return the colours (n, 4) of a primitive's points."""
    return columns(nested(number, *QUATERNION))(*rgba.T)


def line(content: Pieces, pixels: float, rgba: Color) -> Pieces:
    """Return a strip of lines through points, as thick on screen wherever it is."""
    thickness = tag(3, FIXED64) + pack("<d", pixels) + tag(4, VARINT) + b"\x01"
    return nested(LINE, *pose(2), thickness, *content, color(6, rgba))


def triangles(positions: Floats, rgba: Floats, corners: NDArray[np.integer]) -> bytes:
    """Return triangles (k, 3) of points (n, 3) with their colours (n, 4)."""
    indices = delimited(5, corners.astype("<u4").tobytes())
    shape = points(2, positions) + colors(4, rgba) + indices
    return delimited(TRIANGLES, joined(pose(1)) + shape)


def cylinder(at: Pieces, size: bytes, rgba: Color, turn: Pieces = (UPRIGHT,)) -> Pieces:
    """Return a cylinder along z of its pose: pieces of its position and quaternion."""
    ends = tag(3, FIXED64) + pack("<d", 1.0) + tag(4, FIXED64) + pack("<d", 1.0)
    return nested(CYLINDER, *pose(1, at, turn), delimited(2, size), ends, color(5, rgba))


def joined(pieces: Pieces) -> bytes:
    """Return pieces without codes as they are on the wire."""
    return b"".join(piece for piece in pieces if isinstance(piece, bytes))
