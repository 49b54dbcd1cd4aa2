"""The scene: what viewers draw in 3D, from the roles that a scenario gives to signals.

Drawn of the newest values of one component or of several. Every message but newly sensed cells is
complete in itself, so that a viewer may begin anywhere; what does not change is on topics of its own,
written once. Everything is in the frame `map` but the craft, which is in `heli`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from operator import itemgetter
from typing import Any, Literal

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from numpy.typing import NDArray

from orchestrator.assembly.system import System
from orchestrator.recording.frames import ned_to_enu
from orchestrator.recording.roles import Filled, Look, beside, filled
from orchestrator.recording.scene_craft import craft, rotor
from orchestrator.recording.scene_marks import POINTS, marks, paths, sensed
from orchestrator.recording.scene_profile import profile, reference_profile
from orchestrator.recording.scene_terrain import (
    Mesh,
    cloud_of,
    flight_box,
    mesh_entity,
    terrain_mesh,
)
from orchestrator.recording.wire import Layout, Values

Roles = Mapping[str, Filled]

KNOT_NS = 1_000_000_000  # between points of the trail
NONE = np.arange(0)
# sources beside the components, which cannot have such names: points behind, indices of cells
TRAIL, FRESH = "/trail", "/fresh"


@dataclass(frozen=True)
class Part:
    """One topic of the scene.

    Attributes
    ----------
    layout
        Takes the values of the only source, or a tuple of those of all.
    sources
        The components whose newest values it shows, and `TRAIL` or `FRESH`; it is drawn at
        publishings of the first.
    when
        At which of them: all, the first, those that bring cells, or once a second.
    """

    topic: str
    message: type[Message]
    layout: Layout
    sources: tuple[str, ...]
    when: Literal["always", "once", "fresh", "knot"] = "always"
    units: Mapping[str, str] = field(default_factory=dict[str, str])  # of fields

    @property
    def is_plain(self) -> bool:
        """Whether everything that is told of one component is all that it takes."""
        return len(self.sources) == 1 and self.when in ("always", "once")


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
    made: list[Part] = []
    if "pose" in roles:
        made += _terrain(system, roles)
        made += [_craft(roles), _rotor(roles), *_profiles(roles)]
        if "clearance" in roles or "wind" in roles:
            made.append(_marks(roles))
    if roles.keys() & {"path", "reference", "pose"}:
        made.append(_paths(roles))
    if "scan" in roles:
        made.append(_sensed(roles["scan"], system))
    return made


class Stage:
    """Hears what components publish, and tells what is to be drawn of several of them.

    Attributes
    ----------
    heard : set of str
        Those that count; of others nothing is drawn.

    Raises
    ------
    ValueError
        If a role names nothing to draw.
    """

    def __init__(self, system: System) -> None:
        roles = filled(system.scenario.scene, system.ports)
        joint = [part for part in parts(system) if not part.is_plain]
        self._parts: dict[str, list[Part]] = {}  # by the component that they follow
        for part in joint:
            self._parts.setdefault(part.sources[0], []).append(part)
        self.heard = {source for part in joint for source in part.sources}
        self._newest: dict[str, Any] = {TRAIL: {TRAIL: np.empty((0, 3))}}
        pose, scan = roles.get("pose"), roles.get("scan")
        self._craft = None if pose is None or TRAIL not in self.heard else pose.component
        self._position = itemgetter(*pose.names[:3]) if pose is not None else None
        self._knot_ns = 0
        self._sensor = None if scan is None or FRESH not in self.heard else scan.component
        self._fresh = _fresh_cells(scan, system) if scan is not None else None

    def outputs(self, time_ns: int, component: str, values: Values) -> Iterable[tuple[str, Any]]:
        """Return the topics that are drawn now, with what their layouts take."""
        newest = self._newest
        newest[component] = values
        is_knot = component == self._craft and self._knot(time_ns, values)
        is_fresh = component == self._sensor and self._look(values)
        return [
            (part.topic, _held([newest[source] for source in part.sources]))
            for part in self._parts.get(component, ())
            if (part.when != "knot" or is_knot)
            and (part.when != "fresh" or is_fresh)
            and all(source in newest for source in part.sources)
        ]

    def _look(self, values: Values) -> bool:
        """Tell whether a sensor has brought cells, and keep which."""
        assert self._fresh is not None
        fresh = self._fresh(values)
        self._newest[FRESH] = {FRESH: fresh}
        return fresh.size > 0

    def _knot(self, time_ns: int, values: Values) -> bool:
        """Add a point to the trail, if one is due."""
        if time_ns < self._knot_ns:
            return False
        assert self._position is not None
        self._knot_ns = time_ns + KNOT_NS
        point = ned_to_enu(*self._position(values))
        trail = np.vstack([self._newest[TRAIL][TRAIL], point])
        self._newest[TRAIL] = {TRAIL: trail[-POINTS:]}
        return True


def _held(values: Sequence[Values]) -> Any:
    return values[0] if len(values) == 1 else values


def _sources(roles: Roles, names: Iterable[str]) -> tuple[str, ...]:
    """Return the components of those roles that are filled, each once."""
    return tuple(dict.fromkeys(roles[name].component for name in names if name in roles))


def _looks(roles: Roles, sources: Sequence[str]) -> dict[str, Look]:
    return {name: r.look(sources) for name, r in roles.items() if r.component in sources}


def _terrain(system: System, roles: Roles) -> list[Part]:
    """Return the ground around the flight, as far as it can be told from its start."""
    name = system.scenario.scene.get("terrain", "").removeprefix("${").removesuffix("}")
    ground: Any = system.resources.get(name)
    if not hasattr(ground, "surface"):
        return []
    mesh_in = lru_cache(1)(partial(terrain_mesh, ground))
    sources = _sources(roles, ("pose", "velocity"))
    look = _looks(roles, sources)

    def mesh(values: Any) -> Mesh:
        north, east, *_ = look["pose"](values)
        way = look["velocity"](values)[:2] if "velocity" in look else (0.0, 0.0)
        to_north, to_east = (v * system.scenario.duration_s for v in way)
        return mesh_in(flight_box((north, east), (to_north, to_east)))

    shape = Layout((), tail=lambda at, v: mesh_entity(mesh(v), at.stamp), is_stamped=False)
    points = Layout((), tail=lambda _, values: cloud_of(mesh(values)))
    return [
        Part("/scene/terrain", SceneUpdate, shape, sources, "once"),
        Part("/scene/terrain_points", PointCloud, points, sources, "once"),
    ]


def _craft(roles: Roles) -> Part:
    body = Layout((), tail=lambda at, _: craft(at.stamp), is_stamped=False)
    return Part("/scene/craft", SceneUpdate, body, _sources(roles, ("pose",)), "once")


def _rotor(roles: Roles) -> Part:
    return Part("/scene/rotor", FrameTransform, rotor(), _sources(roles, ("pose",)))


def _profiles(roles: Roles) -> list[Part]:
    """Return the flight in numbers, and what they should be, each as often as it is told."""
    sources = _sources(roles, ("pose", "clearance", "velocity"))
    flown = profile(_looks(roles, sources))
    made = [Part("/scene/profile", flown.message, flown.layout, sources, units=flown.units)]
    if "reference" in roles:
        sources = _sources(roles, ("reference", "pose"))
        wanted = reference_profile(_looks(roles, sources))
        made.append(
            Part("/scene/reference", wanted.message, wanted.layout, sources, units=wanted.units)
        )
    return made


def _marks(roles: Roles) -> Part:
    sources = _sources(roles, ("pose", "clearance", "wind"))
    look = _looks(roles, sources)
    layout = marks(look["pose"], look.get("clearance"), look.get("wind"))
    return Part("/scene/marks", SceneUpdate, layout, sources)


def _paths(roles: Roles) -> Part:
    """Return the lines, as often as there is a new one ahead, else once a second."""
    trail = Filled(TRAIL, (TRAIL,))
    roles = {**roles, TRAIL: trail} if "pose" in roles else roles
    sources = _sources(roles, ("path", "reference", "pose", TRAIL))
    look = _looks(roles, sources)
    behind = (look["pose"], look[TRAIL]) if "pose" in roles else None
    layout = paths(look.get("path"), look.get("reference"), behind)
    when = "always" if roles.keys() & {"path", "reference"} else "knot"
    return Part("/scene/paths", SceneUpdate, layout, sources, when)


def _sensed(scan: Filled, system: System) -> Part:
    sources = scan.component, FRESH
    source = beside(scan, "source", system.ports)
    fresh = Filled(FRESH, (FRESH,)).look(sources)
    layout = sensed(scan.look(sources), source.look(sources) if source else None, fresh)
    return Part("/scene/sensed", PointCloud, layout, sources, "fresh")


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
        seen[0] = count = int(values[counter.names[0]])
        if count == last:
            return NONE
        new = count - last if count >= last else count  # it may have been restarted
        return np.arange(count - min(new, size), count) % size

    return fresh
