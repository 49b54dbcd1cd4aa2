"""How an exported FMU makes its component again: the calls, as plain data, and the files they name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

from orchestrator.assembly.discovery import Factory
from orchestrator.assembly.plans import Plan
from orchestrator.export.rows import Row, members, sizes
from orchestrator.export.sources import packages, sources
from orchestrator.export.worker.sources import digest


@dataclass
class Recipe:
    """What ``component.json`` will say of the calls, and what has to lie beside it."""

    modules: set[str] = field(default_factory=set[str])
    files: dict[str, bytes] = field(default_factory=dict[str, bytes])
    _places: dict[Path, str] = field(default_factory=dict[Path, str])

    def use(self, factory: Factory | type[Any]) -> str:
        """Return the name by which a class or function is imported.

        Raises
        ------
        ValueError
            If it cannot be.
        """
        name = f"{factory.__module__}:{factory.__qualname__}"
        if "<" in name or factory.__module__ == "__main__":
            raise ValueError(f"{name}: cannot be imported, expected a module's class or function")
        self.modules.add(factory.__module__)
        return name

    def call(self, plan: Plan) -> dict[str, Any]:
        """Return the call that makes one resource or component."""
        plain = {key: self.encode(value, key) for key, value in plan.arguments.items()}
        return {
            "name": plan.path[1],
            "use": self.use(plan.factory),
            "arguments": plain,
            "injected": dict(plan.resources),
        }

    def encode(self, value: Any, name: str) -> Any:
        """Return a parameter as JSON has it; ``worker.instance.decode`` reverses it.

        Raises
        ------
        ValueError
            If it is of a type that parameters do not have.
        """
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, Path):
            return {"$file": self._file(value, name)}
        if isinstance(value, tuple):
            return {"$tuple": [self.encode(one, name) for one in value]}
        if isinstance(value, list):
            return [self.encode(one, name) for one in value]
        if isinstance(value, Mapping):
            return {str(key): self.encode(one, f"{name}.{key}") for key, one in value.items()}
        if is_dataclass(value) and not isinstance(value, type):
            own = members(value)
            plain = {key: self.encode(one, f"{name}.{key}") for key, one in own.items()}
            return {"$record": self.use(type(value))} | plain
        raise ValueError(
            f"{name}: cannot be exported, got {type(value).__name__}, expected a number, text, "
            "file, or a tuple, list, mapping or dataclass of them"
        )

    def _file(self, file: Path, name: str) -> str:
        if file not in self._places:
            if not file.is_file():
                raise ValueError(f"{name}: cannot be exported, got {str(file)!r}, expected a file")
            place = f"files/{len(self._places)}/{file.name}"
            self._places[file] = place
            self.files[place] = file.read_bytes()
        return self._places[file]


def component_json(
    plans: Sequence[Plan], found: Sequence[Row]
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the content of ``component.json`` and the files beside it, by path.

    Parameters
    ----------
    plans : sequence of Plan
        Of the resources, in the order of making, and last of the component.
    found : sequence of Row
        The FMU's variables.
    """
    recipe = Recipe()
    calls = [recipe.call(plan) for plan in plans]
    names = packages(recipe.modules)
    python = sources(names)
    plain = {
        "parameters": _plain(calls[-1]["arguments"].get("parameters", {})),
        "component": calls[-1],
        "resources": calls[:-1],
        "packages": names,
        "digest": digest(python),
        "sizes": sizes(found),
        "variables": [
            {
                "name": row.name,
                "role": row.role,
                "buffer": row.buffer,
                "at": row.at,
                "shape": row.shape,
                "boolean": row.type == "Boolean",
            }
            for row in found
        ],
    }
    return plain, recipe.files | {f"python/{path}": content for path, content in python.items()}


def _plain(value: Any) -> Any:
    """Return an encoded parameter without its types, as a scenario would write it."""
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if not isinstance(value, dict):
        return value
    if "$tuple" in value:
        return _plain(value["$tuple"])
    if "$file" in value:
        return value["$file"]
    return {key: _plain(one) for key, one in value.items() if key != "$record"}
