"""What a recording of a system consists of: every topic, its message type and who feeds it."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace

from foxglove_schemas_protobuf.Log_pb2 import Log

from orchestrator.assembly.description import Port
from orchestrator.assembly.system import System
from orchestrator.assembly.units import Unit
from orchestrator.recording.descriptors import descriptors
from orchestrator.recording.scene import Part, parts
from orchestrator.recording.schemas import Channel, channel, channels
from orchestrator.recording.views import View, file_descriptors, views
from orchestrator.recording.wire import Layout, WireField, layout, partial_layout

# roles whose every publishing counts in the metrics, whether or not a value is new
COUNTED = ("pose", "velocity", "clearance", "load_factor", "controls", "ladder")

REPEATED = ("outputs", "scene", "wall_clock")  # calls; all others tell something each time

EVENTS, LOG, WALL_CLOCK = "/events", "/log", "/wall_clock"


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes
    ----------
    call, component
        The listener call that feeds it, and for which component; no component means any. What is
        drawn of several components has the call `scene`, of a `Stage`, and its own name here.
    message, descriptors
        Full name of the message type, and its serialised `FileDescriptorSet`.
    layout
        Of a message, by the names of the values that are told.
    is_partial
        Whether a call need not tell all values.
    watched
        Where these variables make a message equal to the last one, it is left out; empty: none is.
    every
        Of how many calls one is recorded.
    is_once
        Whether only the first call is recorded.
    is_increment
        Whether a message tells only what has come since the last one.
    """

    name: str
    call: str
    component: str
    message: str
    descriptors: bytes
    layout: Callable[[Collection[str]], Layout]
    metadata: Mapping[str, str] = field(default_factory=dict[str, str])
    is_partial: bool = False
    watched: tuple[str, ...] = ()
    every: int = 1
    is_once: bool = False
    is_increment: bool = False

    @property
    def source(self) -> tuple[str, str]:
        """Return the call and the component that it hears."""
        return self.call, self.component

    @property
    def is_repeated(self) -> bool:
        """Whether messages come again and again, so that some may be left out."""
        return self.call in REPEATED and not self.is_once and not self.is_increment

    @property
    def row_key(self) -> tuple[object, ...]:
        """Return the same for topics whose records are written at the same instants, side by side."""
        alone = self.is_partial or self.watched or self.is_once or self.layout(()).tail
        return (self.name,) if alone else (self.source, self.every)


def topics(system: System, *, wall_clock: bool) -> list[Topic]:
    """Return every topic of a recording, in a fixed order.

    Raises
    ------
    ValueError
        If a scene role names nothing to draw.
    """
    made = [
        signals(each, system.scenario.scene)
        for component, ports in system.ports.items()
        for each in channels(component, ports.values())
    ]
    made += [signals(each, system.scenario.scene) for each in _changed_inputs(system)]
    if system.scenario.recording.scene:
        for view in views(system.scenario.scene, system.ports):
            made.append(_drawn("outputs", view.component, view, {}))
        for part in parts(system):
            is_once = part.when == "once"
            metadata = {"written": "once"} if is_once else {}
            metadata |= {f"unit.{name}": unit for name, unit in part.units.items()}
            source = ("outputs", part.sources[0]) if part.is_plain else ("scene", part.topic)
            topic = _drawn(*source, part, metadata)
            made.append(replace(topic, is_once=is_once, is_increment=part.when == "fresh"))
    log = [
        WireField(2, "level", "enum"),
        WireField(3, "message", "string"),
        WireField(4, "name", "string"),
    ]
    made.append(Topic(LOG, "log", "", "foxglove.Log", file_descriptors(Log), _always(layout(log))))
    made.append(
        _own(EVENTS, "event", "Event", [_text("kind"), _text("component"), _text("message")])
    )
    if wall_clock:
        second = Unit("s")
        steps = [Port("", c, "output", "discrete", "Float64", unit=second) for c in system.ports]
        made.append(_own(WALL_CLOCK, "wall_clock", "WallClock", steps))
    return made


def signals(each: Channel, scene: Mapping[str, str]) -> Topic:
    """Return the topic of a channel of component variables; the scene's roles say what counts."""
    names = [str(port) for port in each.ports]
    counted = any(
        name == scene.get(role) or name.startswith(f"{scene.get(role)}.")
        for role in COUNTED
        for name in names
    )
    on_change = each.kind == "outputs" and each.is_discrete and not counted
    is_partial = each.kind != "outputs"
    fields = each.wire_fields()
    return Topic(
        name=each.topic,
        call=each.kind,
        component=each.component,
        message=each.message,
        descriptors=each.descriptors,
        layout=partial_layout(fields) if is_partial else _always(layout(fields)),
        metadata=each.metadata | ({"written": "on change"} if on_change else {}),
        is_partial=is_partial,
        watched=tuple(port.name for port in each.ports) if on_change else (),
    )


def _drawn(call: str, source: str, drawn: View | Part, metadata: Mapping[str, str]) -> Topic:
    """Return the topic of a well-known message, which viewers draw."""
    name, data = drawn.message.DESCRIPTOR.full_name, file_descriptors(drawn.message)
    return Topic(drawn.topic, call, source, name, data, _always(drawn.layout), metadata)


def _changed_inputs(system: System) -> Iterator[Channel]:
    """Yield a channel for the inputs of each component that can differ from their sources."""
    changed = {str(link.target) for link in system.links if not link.is_plain}
    changed |= {event.set for event in system.scenario.events}
    for component, ports in system.ports.items():
        inputs = [p for p in ports.values() if p.causality == "input" and str(p) in changed]
        if inputs:
            yield channel(component, "inputs", "inputs", inputs)


def _text(name: str) -> Port:
    return Port("", name, "output", "discrete", "String")


def _own(name: str, call: str, title: str, ports: list[Port]) -> Topic:
    """Return a topic of the recording itself, fed by one listener call."""
    each = Channel(
        topic=name,
        component="",
        kind="outputs",
        ports=tuple(ports),
        fields=tuple(port.name for port in ports),
        message=f"hedgehop.{title}",
        descriptors=descriptors("hedgehop", title, [port.name for port in ports], ports),
    )
    units = {f"unit.{p.name}": p.unit.name for p in ports if p.unit is not None}
    laid_out = _always(layout(each.wire_fields()))
    return Topic(name, call, "", each.message, each.descriptors, laid_out, units)


def _always(one: Layout) -> Callable[[Collection[str]], Layout]:
    return lambda _: one
