"""Protobuf schemas made from variables: one channel per component and top-level group.

`state.theta` of `vehicle` becomes the field `theta` of `hedgehop.vehicle.State` on the topic
`/vehicle/state`; variables without a group go to `/vehicle/outputs`. Names that protobuf cannot
spell are changed, and the original kept in the channel's metadata beside units and bounds.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from orchestrator.assembly.description import Port
from orchestrator.recording.descriptors import (
    descriptors,
    identifier,
    kind_of,
    title_of,
    unit_name,
    unused,
)
from orchestrator.recording.wire import WireField

Kind = Literal["outputs", "parameters", "inputs"]

_GROUPED = re.compile(r"([A-Za-z_]\w*)\.(.+)", re.ASCII | re.DOTALL)
_RESERVED = ("outputs", "parameters", "inputs")


@dataclass(frozen=True)
class Channel:
    """What one topic carries.

    Attributes
    ----------
    topic, component, kind
        Where the values come from; `kind` is `outputs`, `parameters` or `inputs`.
    ports
        The variables, in field order: field number 2 is the first, 1 is the time stamp.
    fields
        The name of each variable's field.
    message : str
        Full name of the message type.
    descriptors : bytes
        Serialised `FileDescriptorSet` of the message and what it imports.
    """

    topic: str
    component: str
    kind: Kind
    ports: tuple[Port, ...]
    fields: tuple[str, ...]
    message: str
    descriptors: bytes

    @property
    def is_discrete(self) -> bool:
        """Whether every variable only changes at events, so that equal values say nothing new."""
        return all(port.variability == "discrete" for port in self.ports)

    @property
    def metadata(self) -> dict[str, str]:
        """Return what the message type cannot say, as strings: `unit.<field>`, `name.<field>`...

        `name.` is there where the variable is not called `<group>.<field>`.
        """
        entries = {"component": self.component, "kind": self.kind}
        group = self.topic.rsplit("/", 1)[1]
        for name, port in zip(self.fields, self.ports, strict=True):
            if port.name != (name if group in _RESERVED else f"{group}.{name}"):
                entries[f"name.{name}"] = port.name
            entries[f"unit.{name}"] = unit_name(port)
            if port.shape:
                entries[f"shape.{name}"] = json.dumps(port.shape)
            if port.items:
                entries[f"items.{name}"] = json.dumps(dict(port.items), ensure_ascii=False)
            if port.min is not None:
                entries[f"min.{name}"] = repr(port.min)
            if port.max is not None:
                entries[f"max.{name}"] = repr(port.max)
        return entries

    def wire_fields(self) -> list[WireField]:
        """Return the layout for the encoder in ``wire.py``; keys are variable names."""
        return [
            WireField(number, port.name, kind_of(port), port.shape)
            for number, port in enumerate(self.ports, start=2)
        ]


def group_of(name: str) -> str:
    """Return the top-level group of a variable, `outputs` where it has none.

    A group that bears the name of one of the fixed topics gets an underscore: `outputs_`.
    """
    match = _GROUPED.fullmatch(name)
    if match is None:
        return "outputs"
    return f"{match[1]}_" if match[1] in _RESERVED else match[1]


def channels(component: str, ports: Iterable[Port]) -> list[Channel]:
    """Return the channels of a component's outputs and parameters, in the order of `ports`."""
    groups: dict[tuple[Kind, str], list[Port]] = {}
    for port in ports:
        if port.causality == "output":
            groups.setdefault(("outputs", group_of(port.name)), []).append(port)
        elif port.causality in ("parameter", "structuralParameter"):
            groups.setdefault(("parameters", "parameters"), []).append(port)
    return [channel(component, kind, group, members) for (kind, group), members in groups.items()]


def channel(component: str, kind: Kind, group: str, ports: Iterable[Port]) -> Channel:
    """Return the channel of a group of variables.

    Fields of inputs and parameters have presence (`optional`): a message holds those that are told.
    """
    members = tuple(ports)
    used = {"timestamp"}
    fields = tuple(
        unused(identifier(_member(port.name, group)), used, _spelling) for port in members
    )
    package, title = f"hedgehop.{identifier(component)}", title_of(group)
    return Channel(
        topic=f"/{component}/{group}",
        component=component,
        kind=kind,
        ports=members,
        fields=fields,
        message=f"{package}.{title}",
        descriptors=descriptors(package, title, fields, members, optional=kind != "outputs"),
    )


def variable_name(topic: str, field: str, metadata: Mapping[str, str]) -> str:
    """Return the variable, without its component, that a field of a channel holds."""
    group = topic.rsplit("/", 1)[1]
    return metadata.get(f"name.{field}", field if group in _RESERVED else f"{group}.{field}")


def _member(name: str, group: str) -> str:
    """Return the part of a variable's name that its topic does not say already."""
    match = _GROUPED.fullmatch(name)
    return match[2] if match is not None and group not in _RESERVED else name


def _spelling(name: str) -> str:
    # protobuf forbids two fields that differ in case or underscores only: their JSON names collide
    return name.replace("_", "").lower()
