"""The scene: what viewers draw in 3D, from the roles that a scenario gives to signals.

Drawn from the newest values of several components, unlike ``views.py``. Every message is complete
in itself, so that a viewer may begin anywhere; what does not change is on topics of its own,
written once. Everything is in the frame `map` but the craft, which is in `heli`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from operator import itemgetter
from typing import Any, Literal

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from numpy.typing import NDArray

from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.roles import Filled, beside, filled
from orchestrator.recording.scene_craft import craft, rotor
from orchestrator.recording.scene_marks import TRAIL, marks, paths, sensed
from orchestrator.recording.scene_profile import profile
from orchestrator.recording.scene_terrain import (
    Mesh,
    cloud_of,
    flight_box,
    mesh_entity,
    terrain_mesh,
)
from orchestrator.recording.wire import Layout, Values, timestamp

KNOT_NS = 1_000_000_000  # between points of the trail
NONE = np.arange(0)


@dataclass(frozen=True)
class Part:
    """One topic of the scene.

    Attributes
    ----------
    layout
        Takes, by role, the newest values of the component that fills it; further ``time_ns``,
        ``stamp``, ``trail`` (north, east, down in m (n, 3)), ``fresh`` (indices of cells).
    reads
        Roles that it needs; it is drawn at publishings of the first.
    when
        At which of them: all, the first, those that bring cells, or once a second.
    """

    topic: str
    message: type[Message]
    layout: Layout
    reads: tuple[str, ...]
    when: Literal["always", "once", "fresh", "knot"] = "always"
    units: Mapping[str, str] = field(default_factory=dict[str, str])  # of fields

    @cached_property
    def needs(self) -> frozenset[str]:
        """The same roles, unordered."""
        return frozenset(self.reads)


def parts(system: System) -> list[Part]:
    """Return what there is to draw; nothing if the scenario wants no scene.

    Raises
    ------
    ValueError
        If a role names nothing to draw.
    """
    if not system.scenario.recording.scene:
        return []
    roles = filled(system.scenario.scene, system.ports)
    pose, clearance, wind, scan = (roles.get(k) for k in ("pose", "clearance", "wind", "scan"))
    lines = tuple(role for role in ("path", "reference", "pose") if role in roles)
    made: list[Part] = []
    if pose is not None:
        body = _drawn(lambda values: craft(values["stamp"]), is_stamped=False)
        made += _terrain(system, roles)
        made.append(Part("/scene/craft", SceneUpdate, body, ("pose",), "once"))
        made.append(Part("/scene/rotor", FrameTransform, rotor(), ("pose",)))
        numbers = profile(roles)
        reads = ("reference", "pose") if "reference" in roles else ("pose",)
        reads += tuple(role for role in ("clearance", "velocity") if role in roles)
        when = "knot" if reads[0] == "pose" else "always"
        layout, units = numbers.layout, numbers.units
        made.append(Part("/scene/profile", numbers.message, layout, reads, when, units))
    if pose is not None and (clearance or wind):
        reads = tuple(role for role in ("pose", "clearance", "wind") if role in roles)
        made.append(Part("/scene/marks", SceneUpdate, marks(pose, clearance, wind), reads))
    if lines:
        layout = paths(*(roles.get(role) for role in ("path", "reference", "pose")))
        when = "knot" if lines == ("pose",) else "always"
        made.append(Part("/scene/paths", SceneUpdate, layout, lines, when))
    if scan is not None:
        layout = sensed(scan, beside(scan, "source", system.ports))
        made.append(Part("/scene/sensed", PointCloud, layout, ("scan",), "fresh"))
    return made


class Stage:
    """Hears what components publish, and tells what is to be drawn of it.

    Raises
    ------
    ValueError
        If a role names nothing to draw.
    """

    def __init__(self, system: System) -> None:
        roles = filled(system.scenario.scene, system.ports)
        self._parts: dict[str, list[Part]] = {}  # by the component that their first role is of
        self._roles: dict[str, list[str]] = {}  # by component
        drawn = parts(system)
        for part in drawn:
            self._parts.setdefault(roles[part.reads[0]].component, []).append(part)
        for role in sorted({role for part in drawn for role in part.reads}):
            self._roles.setdefault(roles[role].component, []).append(role)
        self._newest: dict[str, Any] = {}
        self._position = itemgetter(*roles["pose"].names[:3]) if "pose" in roles else None
        self._trail = np.empty((0, 3))
        self._knot_ns = 0
        self._fresh = _fresh_cells(roles["scan"], system) if "scan" in roles else None

    def outputs(
        self, time_ns: int, component: str, values: Mapping[str, Value]
    ) -> list[tuple[str, Values]]:
        """Return the topics that are drawn now, with what their layouts take."""
        roles = self._roles.get(component)
        if roles is None:
            return []
        newest = self._newest
        for role in roles:
            newest[role] = values
        is_knot = "pose" in roles and self._knot(time_ns, values)
        is_fresh = "scan" in roles and self._look(values)
        drawn = [
            part
            for part in self._parts.get(component, ())
            if (part.when != "knot" or is_knot)
            and (part.when != "fresh" or is_fresh)
            and newest.keys() >= part.needs
        ]
        if not drawn:
            return []
        if drawn[0].when == "once":  # these are the first of all parts
            done = [part for part in drawn if part.when == "once"]
            self._parts[component] = [p for p in self._parts[component] if p not in done]
        stamp = timestamp(EPOCH_NS + time_ns)
        moment = {**newest, "time_ns": time_ns, "stamp": stamp, "trail": self._trail}
        return [(part.topic, moment) for part in drawn]

    def _look(self, values: Mapping[str, Value]) -> bool:
        """Tell whether a sensor has brought cells, and keep which."""
        if self._fresh is None:
            return False
        self._newest["fresh"] = fresh = self._fresh(values)
        return fresh.size > 0

    def _knot(self, time_ns: int, values: Mapping[str, Value]) -> bool:
        """Add a point to the trail, if one is due."""
        if time_ns < self._knot_ns or self._position is None:
            return False
        self._knot_ns = time_ns + KNOT_NS
        self._trail = np.vstack([self._trail, self._position(values)])[-TRAIL:]
        return True


def _terrain(system: System, roles: Mapping[str, Filled]) -> list[Part]:
    """Return the ground around the flight, as far as it can be told from its start."""
    name = system.scenario.scene.get("terrain", "").removeprefix("${").removesuffix("}")
    ground: Any = system.resources.get(name)
    if not hasattr(ground, "surface"):
        return []
    mesh_in = lru_cache(1)(partial(terrain_mesh, ground))
    where = itemgetter(*roles["pose"].names[:2])
    speed = itemgetter(*roles["velocity"].names[:2]) if "velocity" in roles else None

    def mesh(values: Values) -> Mesh:
        way = (0.0, 0.0) if speed is None else speed(values["velocity"])
        north, east = (v * system.scenario.duration_s for v in way)
        return mesh_in(flight_box(where(values["pose"]), (north, east)))

    reads = ("pose", "velocity") if speed is not None else ("pose",)
    shape = _drawn(lambda values: mesh_entity(mesh(values), values["stamp"]), is_stamped=False)
    points = _drawn(lambda values: cloud_of(mesh(values)), is_stamped=True)
    return [
        Part("/scene/terrain", SceneUpdate, shape, reads, "once"),
        Part("/scene/terrain_points", PointCloud, points, reads, "once"),
    ]


def _drawn(draw: Callable[[Values], bytes], *, is_stamped: bool) -> Layout:
    return Layout((), lambda _: (), lambda values: [draw(values)], is_stamped)


def _fresh_cells(scan: Filled, system: System) -> Callable[[Values], NDArray[np.int64]]:
    """Return a function from a sensor's values to the indices of cells that came since last time.

    Cells are counted, if a member ``count`` says how many there have been in a ring; otherwise all
    are new when the array is.
    """
    north = scan.names[0]
    counter = beside(scan, "count", system.ports)
    seen: list[Any] = [0]

    def fresh(values: Values) -> NDArray[np.int64]:
        size = len(values[north])
        last = seen[0]
        if counter is None:
            seen[0] = values[north]
            return NONE if seen[0] is last else np.arange(size)
        seen[0] = count = int(values[counter])
        if count == last:
            return NONE
        new = count - last if count >= last else count  # it may have been restarted
        return np.arange(count - min(new, size), count) % size

    return fresh
