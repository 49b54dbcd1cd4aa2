"""What viewers draw of one component alone: well-known Foxglove messages, in ENU and FLU."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from operator import itemgetter

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from orchestrator.recording.frames import BODY, MAP, ned_to_enu, orientation
from orchestrator.recording.roles import Ports, Scene, filled
from orchestrator.recording.wire import (
    Instant,
    Layout,
    Values,
    columns,
    constant,
    delimited,
    nested,
)

# foxglove.Vector3, Point3 and Quaternion: doubles in the fields 1 to 3 or 4
VECTOR = (b"\x09", "d", b"\x11", "d", b"\x19", "d")
QUATERNION = (*VECTOR, b"\x21", "d")
MAX_POSES = 40  # of a path

Rigid = Callable[[Instant, Values], tuple[float, ...]]  # to position and orientation
UPRIGHT = constant(QUATERNION, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class View:
    """A topic made from all outputs of one component, at its publishings."""

    topic: str
    component: str
    message: type[Message]
    layout: Layout


@lru_cache(16)
def few(length: int, count: int) -> NDArray[np.int64]:
    """Return so many indices of a sequence, evenly spread from the first to the last."""
    return np.linspace(0, length - 1, count).astype(np.int64)


def file_descriptors(message: type[Message]) -> bytes:
    """Return the serialised `FileDescriptorSet` of a message class."""
    return build_file_descriptor_set(message).SerializeToString(deterministic=True)


def views(scene: Scene, ports: Ports) -> list[View]:
    """Return what the roles `pose` and `path` let viewers draw.

    Raises
    ------
    ValueError
        If a role names a group that is not there or lacks a member.
    """
    roles = filled(scene, ports)
    made: list[View] = []
    if "pose" in roles:
        component, names = roles["pose"]
        rigid = _rigid(names)
        made.append(View("/tf", component, FrameTransform, _transform(rigid)))
        made.append(View("/scene/pose", component, PoseInFrame, _pose(rigid)))
    if "path" in roles:
        component, names = roles["path"]
        made.append(View("/scene/plan", component, PosesInFrame, _poses(names)))
    return made


def _transform(rigid: Rigid) -> Layout:
    frames = delimited(2, MAP.encode()) + delimited(3, BODY.encode())
    pieces = (frames, *nested(4, *VECTOR), *nested(5, *QUATERNION))
    return Layout(pieces, computed=rigid)


def _pose(rigid: Rigid) -> Layout:
    pose = nested(3, *nested(1, *VECTOR), *nested(2, *QUATERNION))
    return Layout((delimited(2, MAP.encode()), *pose), computed=rigid)


def _rigid(names: tuple[str, ...]) -> Rigid:
    """Return a function from a component's values to position and orientation."""
    pick = itemgetter(*names)
    last: tuple[Values, tuple[float, ...]] = {}, ()  # several topics ask for the same, in turn

    def rigid(_: Instant, values: Values) -> tuple[float, ...]:
        nonlocal last
        if values is not last[0]:
            north, east, down, phi, theta, psi = pick(values)
            last = values, (*ned_to_enu(north, east, down), *orientation(phi, theta, psi))
        return last[1]

    return rigid


def _poses(names: tuple[str, ...]) -> Layout:
    """Return the layout of some of the points of a path, as upright poses."""
    pack = columns(nested(3, *nested(1, *VECTOR), delimited(2, UPRIGHT)))
    pick = itemgetter(*names)

    def tail(_: Instant, values: Values) -> bytes:
        ned = pick(values)
        some = few(len(ned[0]), min(len(ned[0]), MAX_POSES))
        return pack(*ned_to_enu(*(axis[some] for axis in ned)))

    return Layout((delimited(2, MAP.encode()),), tail=tail)
