"""Load a scenario: YAML, validated as one typed document, becomes the frozen records."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from orchestrator.assembly.discovery import installed_components, resolve
from orchestrator.assembly.parameters import TOLD, adapter, constructor
from orchestrator.errors import nearest
from orchestrator.scenario.document import Document
from orchestrator.scenario.layers import installed, override, read, read_text
from orchestrator.scenario.marks import Fault, KeyPath, Mark, Node, Origins, scenario_error
from orchestrator.scenario.records import (
    ComponentSpec,
    ConnectionSpec,
    EventSpec,
    RecordingSpec,
    ResourceSpec,
    Scenario,
)
from orchestrator.scenario.validation import validate
from orchestrator.scenario.wording import unit_of

_ADAPTER = TypeAdapter(Document)


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
    return _load(read(file, faults), file, overrides, faults)


def load_text(text: str, file: Path, overrides: Iterable[str] = ()) -> Scenario:
    """Return the scenario in a YAML text that was found in ``file``, say a recording.

    Raises
    ------
    ScenarioError
        As :func:`load`; lines and columns are those of the text.
    """
    faults: list[Fault] = []
    return _load(read_text(text, file, faults), file, overrides, faults)


def _load(root: Node | None, file: Path, overrides: Iterable[str], faults: list[Fault]) -> Scenario:
    """Return the scenario of a tree; ``faults`` are those of reading it."""
    if root is None:
        if not faults:
            faults.append(Fault(Mark(str(file)), "scenario: empty, expected keys and values"))
        raise scenario_error(faults)
    for number, text in enumerate(overrides, start=1):
        root = override(root, text, number, _may_create, faults)
    document = validate(_ADAPTER, root.plain(), faults, root)
    if document is None or faults:
        raise scenario_error(faults)
    return _records(document, file.parent, Origins(root))


def _may_create(path: KeyPath) -> bool:
    """Whether an override may write a mapping that no file holds: a section, or parameters."""
    return "parameters" in path or (len(path) == 1 and path[0] in Document.model_fields)


def _records(document: Document, folder: Path, origins: Origins) -> Scenario:
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


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files, for editors.

    Every key has its unit; ``parameters`` follow from ``use`` for the installed components.
    """
    schema = Document.model_json_schema()
    schema["properties"]["extends"] = {
        "description": "files to start from, relative to this one, or installed scenarios",
        "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}],
    }
    # a file that extends others gives only what it changes
    schema["anyOf"] = [{"required": schema.pop("required")}, {"required": ["extends"]}]
    definitions = schema["$defs"]
    for section in ("Resource", "Component"):
        del definitions[section]["required"]
    choices: list[dict[str, Any]] = []
    for name, point in installed_components().items():
        try:
            takes = constructor(resolve(point.value))
        except ValueError:
            continue  # `hedgehop list` says what is wrong with it
        parameters: dict[str, Any] = {"type": "object"}
        if takes.record is not None:
            parameters = adapter(takes.record).json_schema(ref_template=f"#/$defs/{name}.{{model}}")
            inner = parameters.pop("$defs", {})
            definitions |= {f"{name}.{key}": one for key, one in inner.items()}
            if "$ref" in parameters:
                parameters = definitions[parameters["$ref"].rpartition("/")[2]]
        injected = {key: _REFERENCE for key in takes.injected if key not in TOLD}
        parameters["properties"] = {**parameters.get("properties", {}), **injected}
        choices.append(
            {
                "if": {"properties": {"use": {"enum": [name, point.value]}}},
                "then": {"properties": {"parameters": parameters}},
            }
        )
    definitions["Component"]["allOf"] = choices
    _tidy(schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


_REFERENCE = {"type": "string", "pattern": r"^\$\{.*\}$", "description": "a resource"}


def _tidy(schema: Mapping[str, Any]) -> None:
    """Add the unit that a key names; drop the titles that only repeat it."""
    for key, one in schema.get("properties", {}).items():
        one.pop("title", None)
        if unit := unit_of(key):
            one["unit"] = unit
    for one in schema.values():
        for below in one if isinstance(one, list) else [one]:
            if isinstance(below, dict):
                _tidy(below)
