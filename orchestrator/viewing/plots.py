"""Which plots a flight deserves, from the roles of its scene and what its channels say.

Found once for all viewers: a plot is fields of messages over time, and values that stay.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from google.protobuf.descriptor_pb2 import FieldDescriptorProto

from orchestrator.assembly.system import System
from orchestrator.recording.messages import Messages, Signal, signals
from orchestrator.recording.reader import Recording
from orchestrator.recording.topics import WALL_CLOCK, Topic

PROFILE, REFERENCE = "/scene/profile", "/scene/reference"
NUMBERS = (FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_SFIXED64)
MANY = 12  # fields in a plot, and
HIGH = 6  # plots on a page, beyond which nobody sees anything


@dataclass(frozen=True)
class Contents:
    """What there is to look at.

    Attributes
    ----------
    signals
        Variables of components by full name.
    constant
        Returns the value of a variable that never changes, None for others.
    """

    topics: Mapping[str, Messages]
    signals: Mapping[str, Signal]
    scene: Mapping[str, str]
    constant: Callable[[str], float | None]


@dataclass(frozen=True)
class Field:
    """A field of a topic's messages."""

    topic: str
    message: str
    name: str
    label: str


@dataclass(frozen=True)
class Plot:
    """Fields of one unit over time, and horizontal lines by label."""

    title: str
    unit: str
    fields: tuple[Field, ...]
    lines: Mapping[str, float] = field(default_factory=dict[str, float])


def recorded(recording: Recording) -> Contents:
    """Return what a recording holds."""

    def constant(name: str) -> float | None:
        if name not in recording.signals:
            return None
        _, values = recording[name]
        return float(values[0]) if len(values) and (values == values[0]).all() else None

    return Contents(recording.topics, recording.signals, recording.scene, constant)


def planned(system: System, topics: Iterable[Topic]) -> Contents:
    """Return what a recording of a system will hold."""
    listed = {t.name: Messages(t.message, t.descriptors, t.metadata, []) for t in topics}
    described = {s.name: s for name, topic in listed.items() for s in signals(name, topic)}
    changed = {event.set for event in system.scenario.events}

    def constant(name: str) -> float | None:
        component, _, variable = name.partition(".")
        port = system.ports.get(component, {}).get(variable)
        if port is None or port.causality != "parameter" or name in changed:
            return None
        return float(port.start) if isinstance(port.start, int | float) else None

    return Contents(listed, described, system.scenario.scene, constant)


def scene(contents: Contents) -> list[str]:
    """Return the topics of which there is something to see in 3D."""
    return [
        name
        for name, topic in contents.topics.items()
        if name.startswith("/scene/") and topic.message.startswith("foxglove.")
    ]


def pages(contents: Contents) -> dict[str, list[Plot]]:
    """Return all plots by page: what the roles tell of, components that they leave out, timing.

    A page without plots is left out.
    """
    found = {
        "flight": _flight(contents),
        "controls": _controls(contents),
        "updates": _updates(contents),
    }
    fields = [field for plots in found.values() for plot in plots for field in plot.fields]
    seen = {_component(contents, field.topic) for field in fields}
    for component in dict.fromkeys(_component(contents, name) for name in contents.topics):
        if component and component not in seen:
            found.setdefault(component, []).extend(_outputs(contents, component)[:HIGH])
    found.setdefault("timing", []).extend(_timing(contents))
    shown = {page: [plot for plot in plots if plot.fields] for page, plots in found.items()}
    return {page: plots for page, plots in shown.items() if plots}


def _flight(contents: Contents) -> list[Plot]:
    """Return height, altitude, speed and heading."""
    made = [_height(contents)]
    for name in ("altitude", "speed", "heading"):
        known = [name, *(["ground"] if name == "altitude" else [])]
        flown = _of_topic(contents, PROFILE, name, known)
        wanted = _of_topic(contents, REFERENCE, name, [name], "reference ")
        fields = (*flown.fields[:1], *wanted.fields, *flown.fields[1:])
        made.append(Plot(name, flown.unit or wanted.unit, fields))
    return made


def _controls(contents: Contents) -> list[Plot]:
    """Return the actuators with their limits."""
    group = contents.scene.get("controls")
    found = [s for s in contents.signals.values() if group and s.name.startswith(f"{group}.")]
    return _by_unit("controls", found, contents)


def _updates(contents: Contents) -> list[Plot]:
    """Return how the planning component fares: all that it tells but the plan itself."""
    planner, _, plan = contents.scene.get("plan", "").partition(".")
    but = f"/{planner}/{plan.replace('.', '/')}"
    return _outputs(contents, planner, but) if planner else []


def _timing(contents: Contents) -> list[Plot]:
    """Return the measured times."""
    if WALL_CLOCK not in contents.topics:
        return []
    known = [key[5:] for key in contents.topics[WALL_CLOCK].metadata if key[:5] == "unit."]
    return [_of_topic(contents, WALL_CLOCK, "measured time of a step", known)]


def _outputs(contents: Contents, component: str, but: str = "") -> list[Plot]:
    """Return the outputs of a component by topic and unit, without those of one topic."""
    topics: dict[str, list[Signal]] = {}
    for signal in contents.signals.values():
        is_output = contents.topics[signal.topic].metadata.get("kind") == "outputs"
        if is_output and _component(contents, signal.topic) == component and signal.topic != but:
            topics.setdefault(signal.topic, []).append(signal)
    return [
        plot
        for topic, members in topics.items()
        for plot in _by_unit(topic.rpartition("/")[2], members, contents)
    ]


def _component(contents: Contents, topic: str) -> str:
    return contents.topics[topic].metadata.get("component", "")


def states(contents: Contents) -> list[Field]:
    """Return the enumerations."""
    return [
        _field(signal, contents, signal.name)
        for signal in contents.signals.values()
        if signal.items and not signal.shape
    ]


def _height(contents: Contents) -> Plot:
    """Return the height above ground, with the set height and limits."""
    clearance = contents.signals.get(contents.scene.get("clearance", ""))
    if clearance is None:
        return Plot("", "", ())
    title = "height above ground"
    plot = _plot(title, [clearance], contents)
    name = contents.scene.get("height_agl", "")
    value = contents.constant(name)
    if value is not None:
        return Plot(title, plot.unit, plot.fields, {"set height": value, **plot.lines})
    height = contents.signals.get(name)
    fields = () if height is None else (_field(height, contents, f"set height [{height.unit}]"),)
    return Plot(title, plot.unit, (*plot.fields, *fields), plot.lines)


def _by_unit(title: str, found: Iterable[Signal], contents: Contents) -> list[Plot]:
    """Return plots of signals that are single numbers, one for each unit."""
    units: dict[str, list[Signal]] = {}
    for signal in found:
        kind = contents.topics[signal.topic].types[signal.field_name]
        if not signal.shape and kind in NUMBERS:
            units.setdefault(signal.unit, []).append(signal)
    return [_plot(title, members[:MANY], contents) for members in units.values()]


def _plot(title: str, members: list[Signal], contents: Contents) -> Plot:
    """Return the plot of signals of one unit; bounds that several share are one line."""
    lines: dict[str, float] = {}
    for bound in ("min", "max"):
        for value in dict.fromkeys(getattr(signal, bound) for signal in members):
            if value is not None:
                of = [s.field_name for s in members if getattr(s, bound) == value]
                lines[f"{bound} of {', '.join(of)}"] = value
    unit = members[0].unit
    fields = tuple(_field(s, contents, f"{s.field_name} [{s.unit}]") for s in members)
    return Plot(title, unit, fields, lines)


def _field(signal: Signal, contents: Contents, label: str) -> Field:
    message = contents.topics[signal.topic].message
    return Field(signal.topic, message, signal.field_name, label)


def _of_topic(
    contents: Contents, topic: str, title: str, names: Iterable[str], what: str = ""
) -> Plot:
    """Return the plot of those fields of a topic that there are; labels begin with ``what``."""
    if topic not in contents.topics:
        return Plot("", "", ())
    described = contents.topics[topic]
    units = {name: described.metadata.get(f"unit.{name}") for name in names}
    fields = tuple(
        Field(topic, described.message, name, f"{what}{name.replace('_', ' ')} [{unit}]")
        for name, unit in units.items()
        if unit is not None
    )
    return Plot(title, next((unit for unit in units.values() if unit), ""), fields)
