"""Find what a scenario's ``use`` names: ``module:attribute``, or an installed component.

A package installs components by entry points in the group ``hedgehop.components``.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from orchestrator.errors import nearest

GROUP = "hedgehop.components"

Factory = Callable[..., Any]


def installed_components() -> dict[str, EntryPoint]:
    """Return the installed components by name; nothing is imported."""
    return {point.name: point for point in sorted(entry_points(group=GROUP))}


def resolve(use: str, folder: Path | None = None) -> Factory:
    """Return the class or function that ``use`` names.

    Modules in ``folder`` can be imported too, after all others.

    Raises
    ------
    ValueError
        If there is no such thing or its module cannot be imported; one line that says why.
    """
    if Path(use).suffix in (".fmu", ".mcap"):
        raise ValueError(f"not supported yet, got {use!r}, expected 'module:attribute'")
    if ":" not in use:
        points = installed_components()
        if use not in points:
            near = nearest(use, list(points)) or f", installed are {', '.join(points) or 'none'}"
            raise ValueError(
                f"no component of this name, got {use!r}, "
                f"expected an installed one or 'module:attribute'{near}"
            )
        return resolve(points[use].value, folder)
    if folder is not None and str(folder.absolute()) not in sys.path:
        sys.path.append(str(folder.absolute()))
    module_name, _, attribute = use.partition(":")
    found: Any = _imported(module_name)
    for part in attribute.split("."):
        if not hasattr(found, part):
            near = nearest(part, [name for name in vars(found) if not name.startswith("_")])
            raise ValueError(f"no such attribute, got {use!r}{near}")
        found = getattr(found, part)
    if not callable(found):
        raise ValueError(  # noqa: TRY004  as everything else that is wrong with `use`
            f"cannot be called, got {use!r}, expected a class or function"
        )
    return found


def _imported(name: str) -> object:
    """Import a module; whatever it raises becomes one line."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(error.name + ".")):
            raise ValueError(f"no module {error.name!r}{_nearest_module(error.name)}") from None
        raise ValueError(f"module {name!r} cannot be imported, {_line(error)}") from error
    except Exception as error:
        raise ValueError(f"module {name!r} cannot be imported, {_line(error)}") from error


def _nearest_module(name: str) -> str:
    """Return the nearest modules among the installed components' and their neighbours."""
    known = {point.module for point in installed_components().values()}
    return nearest(name, sorted(known | {module.partition(".")[0] for module in known}))


def _line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
