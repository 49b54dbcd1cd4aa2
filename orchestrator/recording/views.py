"""What viewers draw: the scene's roles as well-known Foxglove messages, in ENU and FLU."""

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from orchestrator.assembly.description import Port, members
from orchestrator.recording.frames import BODY, MAP, ned_to_enu, orientation
from orchestrator.recording.wire import LENGTH, Buffer, Layout, Values, delimited, packer, tag

POSE = ("north", "east", "down", "phi", "theta", "psi")
PATH = ("north", "east", "down")

# foxglove.Vector3, Point3 and Quaternion: doubles in the fields 1 to 3 or 4
_VECTOR, _VECTOR_SIZE = (b"\x09", "d", b"\x11", "d", b"\x19", "d"), 27
_QUATERNION, _QUATERNION_SIZE = (*_VECTOR, b"\x21", "d"), 36
# foxglove.Pose in field 3: position in its field 1, orientation in 2, each with tag and length
_POSE_HEAD = tag(3, LENGTH) + bytes([2 + _VECTOR_SIZE + 2 + _QUATERNION_SIZE])


@dataclass(frozen=True)
class View:
    """A topic made from all outputs of one component, at its publishings."""

    topic: str
    component: str
    message: type[Message]
    layout: Layout


def file_descriptors(message: type[Message]) -> bytes:
    """Return the serialised `FileDescriptorSet` of a message class."""
    return build_file_descriptor_set(message).SerializeToString(deterministic=True)


def views(scene: Mapping[str, str], ports: Mapping[str, Mapping[str, Port]]) -> list[View]:
    """Return what the roles `pose` and `path` let viewers draw.

    Raises
    ------
    ValueError
        If a role names a group that is not there or lacks a member.
    """
    made: list[View] = []
    if "pose" in scene:
        component, names = _members(scene, "pose", POSE, ports)
        made.append(View("/tf", component, FrameTransform, _transform(names)))
        made.append(View("/scene/pose", component, PoseInFrame, _pose(names)))
    if "path" in scene:
        component, names = _members(scene, "path", PATH, ports)
        made.append(View("/scene/plan", component, PosesInFrame, _poses(names)))
    return made


def _members(
    scene: Mapping[str, str],
    role: str,
    wanted: tuple[str, ...],
    ports: Mapping[str, Mapping[str, Port]],
) -> tuple[str, tuple[str, ...]]:
    """Return the component of a role and the variables that it takes from it."""
    component, _, group = scene[role].partition(".")
    found = members(ports.get(component, {}), group)
    if any(member not in found or found[member].causality != "output" for member in wanted):
        raise ValueError(
            f"scene.{role}: no such outputs, got {scene[role]!r}, "
            f"expected a group with {', '.join(wanted)}"
        )
    return component, tuple(f"{group}.{member}" for member in wanted)


def _transform(names: tuple[str, ...]) -> Layout:
    head = delimited(2, MAP.encode()) + delimited(3, BODY.encode())
    return _rigid(names, head + tag(4, LENGTH), tag(5, LENGTH))


def _pose(names: tuple[str, ...]) -> Layout:
    return _rigid(names, delimited(2, MAP.encode()) + _POSE_HEAD + tag(1, LENGTH), tag(2, LENGTH))


def _rigid(names: tuple[str, ...], before_vector: bytes, before_quaternion: bytes) -> Layout:
    """Return the layout of a position and an orientation, each behind its tags."""
    pick = itemgetter(*names)

    def scalars(values: Values) -> tuple[float, ...]:
        north, east, down, phi, theta, psi = pick(values)
        return *ned_to_enu(north, east, down), *orientation(phi, theta, psi)

    vector = before_vector + bytes([_VECTOR_SIZE])
    quaternion = before_quaternion + bytes([_QUATERNION_SIZE])
    return Layout((vector, *_VECTOR, quaternion, *_QUATERNION), scalars)


def _poses(names: tuple[str, ...]) -> Layout:
    """Return the layout of a path: poses that differ in position only, laid out in one array."""
    head = _POSE_HEAD + tag(1, LENGTH) + bytes([_VECTOR_SIZE])
    start = len(head)
    upright = packer(_QUATERNION)([(0.0, 0.0, 0.0, 1.0)])
    pack = packer((head, *_VECTOR, delimited(2, upright)))
    blank = np.frombuffer(pack([(0.0, 0.0, 0.0)]), np.uint8)
    pick = itemgetter(*names)

    def rest(values: Values) -> list[Buffer]:
        points = ned_to_enu(*pick(values))
        rows = np.tile(blank, (len(points[0]), 1))
        for axis, coordinate in enumerate(points):
            at = start + 1 + 9 * axis
            rows[:, at : at + 8] = coordinate.astype("<f8").view(np.uint8).reshape(-1, 8)
        return [rows.tobytes()]

    return Layout((delimited(2, MAP.encode()),), lambda _: (), rest)
