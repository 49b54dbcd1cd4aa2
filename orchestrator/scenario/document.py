"""The scenario document, key by key: what a file may hold, for validation and for editors.

What a component's ``parameters`` may hold is the component's own affair: see ``parameters.py``.
"""

import re
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PositiveFloat, StringConstraints

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]
Variable = Annotated[
    str,
    StringConstraints(pattern=r"^\s*[A-Za-z_][A-Za-z0-9_]*\.\S+\s*$", strip_whitespace=True),
    Field(examples=["component.variable"]),
]
Use = Annotated[
    str,
    Field(
        description="module:attribute, an installed component's name, an FMU or a recording",
        min_length=1,
    ),
]
Parameters = Annotated[
    dict[str, Any],
    Field(description="values of its parameter dataclass; ${name} injects a resource"),
]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Resource(_Keys):
    """A shared object, made once, referred to as ${name} in components' parameters."""

    use: Use
    parameters: Parameters = {}


class Component(_Keys):
    """One component: what to make, how often it runs, what happens when it fails."""

    use: Use
    rate_hz: Annotated[
        PositiveFloat | None, Field(description="steps per simulated second; default: its own")
    ] = None
    parameters: Parameters = {}
    latency_s: Annotated[
        float, Ge(0), Field(description="from reading the inputs to the outputs' validity")
    ] = 0.0
    deadline_s: Annotated[
        PositiveFloat | None, Field(description="wall-clock time that one step may take")
    ] = None
    on_discard: Annotated[
        Literal["end", "hold", "retry"], Field(description="policy for a refused step")
    ] = "end"
    on_error: Annotated[
        Literal["end", "hold", "restart"], Field(description="policy for a failed step")
    ] = "end"
    on_nonfinite: Annotated[
        Literal["end", "hold"], Field(description="policy for a NaN or infinite output")
    ] = "end"
    on_range: Annotated[
        Literal["log", "hold", "end"],
        Field(description="policy for an output outside its declared min and max"),
    ] = "log"
    on_overrun: Annotated[
        Literal["log", "hold", "end"], Field(description="policy for a missed deadline_s")
    ] = "log"
    isolation: Annotated[
        Literal["none", "process"], Field(description="where it runs: process, in one of its own")
    ] = "none"
    timeout_s: Annotated[
        PositiveFloat | None,
        Field(description="wall-clock time after which an isolated component is given up"),
    ] = None
    fmu: Annotated[
        dict[str, Any], Field(description="how an FMU is taken in: arrays, kind, event_mode, ...")
    ] = {}


class Connection(_Keys):
    """From an output to an input, or from a group to a group: component.variable."""

    start: Annotated[Variable, Field(alias="from", description="an output or a group of them")]
    end: Annotated[Variable, Field(alias="to", description="an input or a group of them")]
    delay_s: Annotated[float, Ge(0), Field(description="delay of the connection")] = 0.0
    factor: Annotated[
        float | None,
        Field(description="end = factor * start + offset, in place of a conversion of units"),
    ] = None
    offset: Annotated[float, Field(description="see factor")] = 0.0


def _split(value: object) -> object:
    """Return ``a.x -> b.y`` as a mapping."""
    if not isinstance(value, str):
        return value
    ends = [end.strip() for end in value.split("->")]
    if len(ends) != 2 or not all(re.fullmatch(r"\w+\.\S+", end) for end in ends):
        raise ValueError(
            f"not a connection, got {value!r}, expected 'component.output -> component.input'"
        )
    return dict(zip(("from", "to"), ends, strict=True))


class Event(_Keys):
    """A timed change of an unconnected input or a tunable parameter."""

    at_s: Annotated[float, Ge(0), Field(description="simulated time of the change")]
    set: Annotated[Variable, Field(description="component.variable")]
    value: Annotated[
        int | float | bool | str | list[Any], Field(description="the new value, in its own unit")
    ]


class Scene(_Keys):
    """What viewers draw and the figures are taken from; every role is optional."""

    pose: Annotated[str, Field(description="group: north east down phi theta psi")] = ""
    velocity: Annotated[str, Field(description="group: north east down")] = ""
    clearance: Annotated[str, Field(description="height above the true terrain")] = ""
    load_factor: Annotated[str, Field(description="load factor, G")] = ""
    controls: Annotated[str, Field(description="group of actuators with min and max")] = ""
    plan: Annotated[str, Field(description="group: the newest plan")] = ""
    path: Annotated[str, Field(description="group: the predicted path")] = ""
    reference: Annotated[str, Field(description="group: the reference course")] = ""
    height_agl: Annotated[str, Field(description="set height above ground")] = ""
    ladder: Annotated[str, Field(description="enumeration: how an update was solved")] = ""
    terrain: Annotated[str, Field(description="${name} of the terrain resource")] = ""
    scan: Annotated[str, Field(description="group: sensed terrain cells")] = ""
    wind: Annotated[str, Field(description="group: velocity of the air, north east down")] = ""


class Recording(_Keys):
    """What a recording holds, and how."""

    wall_clock: Annotated[
        bool, Field(description="measured times too; without, runs are byte-identical")
    ] = True
    scene: Annotated[bool, Field(description="what viewers draw in 3D, too")] = True
    include: Annotated[
        tuple[str, ...], Field(description="patterns of topics to record, as /vehicle/*; none: all")
    ] = ()
    exclude: Annotated[
        tuple[str, ...], Field(description="patterns of topics not to record, as /sensor/*")
    ] = ()
    every: Annotated[
        dict[str, Annotated[int, Ge(1)]],
        Field(description="pattern of topics: record each n-th of their messages"),
    ] = {}
    compression: Annotated[
        Literal["zstd", "lz4", "none"], Field(description="of the chunks of the file")
    ] = "zstd"
    chunk_kb: Annotated[
        int, Ge(1), Field(description="largest chunk, before compression; at most 1 s long")
    ] = 1000
    on_disk_full: Annotated[
        Literal["stop", "end"], Field(description="stop recording and fly on, or end the run")
    ] = "stop"


class Document(_Keys):
    """A Hedgehop scenario."""

    title: Annotated[str, Field(description="one line for people")]
    duration_s: Annotated[float, Gt(0), Field(description="simulated time")]
    settle_s: Annotated[
        float, Ge(0), Field(description="beginning left out of the tracking figures")
    ] = 2.0
    seed: Annotated[int, Ge(0), Field(description="all randomness derives from it")] = 0
    resources: Annotated[
        dict[Name, Resource], Field(description="shared objects, injected by ${name}")
    ] = {}
    components: Annotated[
        dict[Name, Component], Field(description="what is coupled, by name", min_length=1)
    ]
    connections: Annotated[
        list[
            Annotated[Connection, BeforeValidator(_split, json_schema_input_type=str | Connection)]
        ],
        Field(description="component.output -> component.input"),
    ] = []
    events: Annotated[list[Event], Field(description="timed changes")] = []
    scene: Annotated[Scene, Field(description="what viewers draw")] = Scene()
    end_on: Annotated[
        list[Variable], Field(description="enumeration outputs: the run ends where one is not 0")
    ] = []
    recording: Annotated[Recording, Field(description="what is recorded")] = Recording()
