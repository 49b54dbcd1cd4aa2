"""Load a scenario: YAML, checked against one typed document, becomes the frozen records.

The classes here are that document, key by key; ``hedgehop schema`` prints it for editors. What a
component's ``parameters`` may hold is the component's own affair: see ``parameters.py``.
"""

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    StringConstraints,
    TypeAdapter,
)

from orchestrator.errors import nearest
from orchestrator.layers import override, read
from orchestrator.marks import Fault, KeyPath, Mark, Origins, scenario_error
from orchestrator.records import (
    ComponentSpec,
    ConnectionSpec,
    EventSpec,
    RecordingSpec,
    ResourceSpec,
    Scenario,
)
from orchestrator.validation import validate

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]
Variable = Annotated[
    str, StringConstraints(pattern=r"^\s*[A-Za-z_][A-Za-z0-9_]*\.\S+\s*$", strip_whitespace=True)
]
Use = Annotated[
    str, Field(description="module:attribute, or the name of an installed component", min_length=1)
]
Parameters = Annotated[
    dict[str, Any],
    Field(description="values of its parameter dataclass; ${name} injects a resource"),
]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class _Resource(_Keys):
    """A shared object, made once, referred to as ${name} in components' parameters."""

    use: Use
    parameters: Parameters = {}


class _Component(_Keys):
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
    on_error: Annotated[Literal["end", "hold"], Field(description="policy for a failed step")] = (
        "end"
    )
    on_nonfinite: Annotated[
        Literal["end", "hold"], Field(description="policy for a NaN or infinite output")
    ] = "end"
    on_overrun: Annotated[
        Literal["log", "hold", "end"], Field(description="policy for a missed deadline_s")
    ] = "log"


class _Connection(_Keys):
    """From an output to an input, or from a group to a group: component.variable."""

    start: Annotated[Variable, Field(alias="from", description="an output or a group of them")]
    end: Annotated[Variable, Field(alias="to", description="an input or a group of them")]
    delay_s: Annotated[float, Ge(0), Field(description="delay of the connection")] = 0.0


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


class _Event(_Keys):
    """A timed change of an unconnected input or a tunable parameter."""

    at_s: Annotated[float, Ge(0), Field(description="simulated time of the change")]
    set: Annotated[Variable, Field(description="component.variable")]
    value: Annotated[
        int | float | bool | str | list[Any], Field(description="the new value, in its own unit")
    ]


class _Scene(_Keys):
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


class _Recording(_Keys):
    """What a recording holds beyond the simulated signals."""

    wall_clock: Annotated[
        bool, Field(description="measured times too; without, runs are byte-identical")
    ] = True


class _Scenario(_Keys):
    """A Hedgehop scenario."""

    title: Annotated[str, Field(description="one line for people")]
    duration_s: Annotated[float, Gt(0), Field(description="simulated time")]
    settle_s: Annotated[
        float, Ge(0), Field(description="beginning left out of the tracking figures")
    ] = 2.0
    seed: Annotated[int, Ge(0), Field(description="all randomness derives from it")] = 0
    resources: Annotated[
        dict[Name, _Resource], Field(description="shared objects, injected by ${name}")
    ] = {}
    components: Annotated[
        dict[Name, _Component], Field(description="what is coupled, by name", min_length=1)
    ]
    connections: Annotated[
        list[
            Annotated[
                _Connection, BeforeValidator(_split, json_schema_input_type=str | _Connection)
            ]
        ],
        Field(description="component.output -> component.input"),
    ] = []
    events: Annotated[list[_Event], Field(description="timed changes")] = []
    scene: Annotated[_Scene, Field(description="what viewers draw")] = _Scene()
    end_on: Annotated[
        list[Variable], Field(description="enumeration outputs: the run ends where one is not 0")
    ] = []
    recording: Annotated[_Recording, Field(description="what is recorded")] = _Recording()


_DOCUMENT = TypeAdapter(_Scenario)


def load(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Scenario:
    """Return the scenario in a YAML file, with ``a.b.c=value`` overrides on top.

    Parameters
    ----------
    path : path
        The file; a bare name that is not here is looked up among the installed scenarios.
    overrides : iterable of str
        As ``components.mpc.parameters.basis=tent``; values are YAML.

    Raises
    ------
    ScenarioError
        With everything that is wrong, each by file, line and column.
    """
    file = Path(path)
    if not file.exists() and (installed() / file).is_file():
        file = installed() / file
    if not file.exists():
        known = [one.name for folder in (file.parent, installed()) for one in folder.glob("*.yaml")]
        what = f"file not found, expected a scenario{nearest(file.name, known)}"
        raise scenario_error([Fault(Mark(str(file)), what)])
    faults: list[Fault] = []
    root = read(file, faults)
    if root is None:
        if not faults:
            faults.append(Fault(Mark(str(file)), "scenario: empty, expected keys and values"))
        raise scenario_error(faults)
    for number, text in enumerate(overrides, start=1):
        root = override(root, text, number, _may_create, faults)
    document = validate(_DOCUMENT, root.plain(), faults, root)
    if document is None or faults:
        raise scenario_error(faults)
    return _records(document, file.parent, Origins(root))


def installed() -> Path:
    """Return the folder of the scenarios that came with the installation."""
    packages = Path(__file__).parent
    inside = packages / "scenarios"  # in a wheel
    return inside if inside.is_dir() else packages.parent / "scenarios"


def _may_create(path: KeyPath) -> bool:
    """Whether an override may write a mapping that no file holds: a section, or parameters."""
    return "parameters" in path or (len(path) == 1 and path[0] in _Scenario.model_fields)


def _records(document: _Scenario, folder: Path, origins: Origins) -> Scenario:
    return Scenario(
        title=document.title,
        duration_s=document.duration_s,
        settle_s=document.settle_s,
        seed=document.seed,
        resources=tuple(
            ResourceSpec(name, **dict(one)) for name, one in document.resources.items()
        ),
        components=tuple(
            ComponentSpec(name, **dict(one)) for name, one in document.components.items()
        ),
        connections=tuple(ConnectionSpec(**dict(one)) for one in document.connections),
        events=tuple(EventSpec(**dict(one)) for one in document.events),
        scene={role: name for role, name in document.scene if name},
        end_on=tuple(document.end_on),
        recording=RecordingSpec(**dict(document.recording)),
        folder=folder,
        origins=origins,
    )
