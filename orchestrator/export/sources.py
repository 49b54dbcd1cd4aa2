"""Collect the Python sources that a component is made of."""

import ast
import sys
import sysconfig
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from orchestrator.export.worker.sources import files_of


def packages(modules: Iterable[str]) -> list[str]:
    """Return the top-level packages of some modules, and those that these import.

    Of the imported ones, only what belongs to no installed distribution: a component's own
    neighbours. Everything else is the interpreter's to provide.
    """
    found: list[str] = []
    waiting = sorted({name.partition(".")[0] for name in modules})
    while waiting:
        package = waiting.pop(0)
        if package in found:
            continue
        found.append(package)
        for path, content in files_of(package).items():
            if path.endswith(".py"):
                waiting += sorted(name for name in _imported(content) if _is_neighbour(name))
    return sorted(found)


def sources(names: Iterable[str]) -> dict[str, bytes]:
    """Return the files of top-level packages by path.

    Raises
    ------
    ValueError
        If one has no files, as the module of an interactive session.
    """
    files: dict[str, bytes] = {}
    for name in names:
        own = files_of(name) if name != "__main__" else {}
        if not own:
            raise ValueError(f"module {name!r}: has no source file, expected an importable module")
        files |= own
    return files


def _imported(content: bytes) -> set[str]:
    """Return the top-level names that a source file imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(content)):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return names


def _is_neighbour(name: str) -> bool:
    if name in sys.stdlib_module_names:
        return False
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        return False
    if spec is None:
        return False
    places = list(spec.submodule_search_locations or ()) or [spec.origin or ""]
    installed = {
        Path(sysconfig.get_path(key)).resolve() for key in ("purelib", "platlib", "stdlib")
    }
    place = Path(places[0]).resolve()
    return place.exists() and not any(place.is_relative_to(folder) for folder in installed)
