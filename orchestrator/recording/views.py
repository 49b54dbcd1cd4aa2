"""What viewers draw: the scene's roles as well-known Foxglove messages, in ENU and FLU."""

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter
from struct import Struct
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from orchestrator.assembly.description import Port, members
from orchestrator.recording.frames import BODY, MAP, ned_to_enu, orientation
from orchestrator.recording.wire import LENGTH, Encoder, delimited, tag

POSE = ("north", "east", "down", "phi", "theta", "psi")
PATH = ("north", "east", "down")

_VECTOR, _VECTOR_SIZE = "BdBdBd", 27  # foxglove.Vector3 and Point3: fields 1 to 3
_QUATERNION, _QUATERNION_SIZE = "BdBdBdBd", 36
_T1, _T2, _T3, _T4 = 0x09, 0x11, 0x19, 0x21  # tags of doubles in fields 1 to 4
# foxglove.Pose in field 3: position in its field 1, orientation in 2, each with tag and length
_POSE_HEAD = tag(3, LENGTH) + bytes([2 + _VECTOR_SIZE + 2 + _QUATERNION_SIZE])


@dataclass(frozen=True)
class View:
    """A topic made from all outputs of one component, at its publishings."""

    topic: str
    component: str
    message: type[Message]
    encode: Encoder


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


def _transform(names: tuple[str, ...]) -> Encoder:
    head = delimited(2, MAP.encode()) + delimited(3, BODY.encode())
    return _rigid(names, head + tag(4, LENGTH), tag(5, LENGTH))


def _pose(names: tuple[str, ...]) -> Encoder:
    return _rigid(names, delimited(2, MAP.encode()) + _POSE_HEAD + tag(1, LENGTH), tag(2, LENGTH))


def _rigid(names: tuple[str, ...], before_vector: bytes, before_quaternion: bytes) -> Encoder:
    """Return the encoder of a position and an orientation, each behind its tags."""
    head = before_vector + bytes([_VECTOR_SIZE])
    middle = before_quaternion + bytes([_QUATERNION_SIZE])
    pack = Struct(f"<{len(head)}s{_VECTOR}{len(middle)}s{_QUATERNION}").pack
    pick = itemgetter(*names)

    def encode(values: Mapping[str, Any]) -> list[bytes]:
        north, east, down, phi, theta, psi = pick(values)
        x, y, z = ned_to_enu(north, east, down)
        qx, qy, qz, qw = orientation(phi, theta, psi)
        return [pack(head, _T1, x, _T2, y, _T3, z, middle, _T1, qx, _T2, qy, _T3, qz, _T4, qw)]

    return encode


def _poses(names: tuple[str, ...]) -> Encoder:
    """Return the encoder of a path: poses that differ in position only, laid out in one array."""
    head = _POSE_HEAD + tag(1, LENGTH) + bytes([_VECTOR_SIZE])
    upright = delimited(2, Struct(f"<{_QUATERNION}").pack(_T1, 0, _T2, 0, _T3, 0, _T4, 1))
    one = Struct(f"<{len(head)}s{_VECTOR}{len(upright)}s")
    blank = np.frombuffer(one.pack(head, _T1, 0, _T2, 0, _T3, 0, upright), np.uint8)
    start = len(head)
    frame = delimited(2, MAP.encode())
    pick = itemgetter(*names)

    def encode(values: Mapping[str, Any]) -> list[bytes]:
        points = ned_to_enu(*pick(values))
        rows = np.tile(blank, (len(points[0]), 1))
        for axis, coordinate in enumerate(points):
            at = start + 1 + 9 * axis
            rows[:, at : at + 8] = coordinate.astype("<f8").view(np.uint8).reshape(-1, 8)
        return [frame, rows.tobytes()]

    return encode
