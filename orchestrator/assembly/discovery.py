"""Find what a scenario's ``use`` names: a file, ``module:attribute``, or an installed component.

A package installs components by entry points in the group ``hedgehop.components``. The files are
FMUs, packed or unpacked, and recordings.
"""

import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from orchestrator.errors import RAISED, nearest
from orchestrator.failure import place

GROUP = "hedgehop.components"
FILES = {  # what stands for a file
    "fmu": "orchestrator.fmu.component:FmuComponent",
    "mcap": "orchestrator.playback.component:Playback",
}

Factory = Callable[..., Any]


def installed_components() -> dict[str, EntryPoint]:
    """Return the installed components by name; nothing is imported."""
    return {point.name: point for point in sorted(entry_points(group=GROUP))}


def find_file(use: str, folders: Iterable[Path]) -> tuple[str, Path] | None:
    """Return the kind of file, ``fmu`` or ``mcap``, that ``use`` names, and where it is.

    That is the first of the folders that has it. None of what is no file's name.

    Raises
    ------
    ValueError
        If there is no such file.
    """
    kind = Path(use).suffix.lower().removeprefix(".")
    places = [folder / use for folder in folders]
    for file in places:
        if (file / "modelDescription.xml").is_file():
            return "fmu", file
    if kind not in FILES:
        return None
    for file in places:
        if file.exists():
            return kind, file
    known = [one.name for one in places[0].parent.glob("*")] if places else []
    raise ValueError(
        f"file not found, got {use!r}, expected a file beside the scenario"
        f"{nearest(Path(use).name, known)}"
    )


def resolve(use: str, *folders: Path) -> Factory:
    """Return the class or function that ``use`` names; of a file, the one that stands for its kind.

    Modules in ``folders`` can be imported too, after all others.

    Raises
    ------
    ValueError
        If there is no such thing or its module cannot be imported; one line that says why.
    """
    if found_file := find_file(use, folders or (Path(),)):
        return resolve(FILES[found_file[0]])
    if ":" not in use:
        points = installed_components()
        if use not in points:
            near = nearest(use, list(points)) or f", installed are {', '.join(points) or 'none'}"
            raise ValueError(
                f"no component of this name, got {use!r}, "
                f"expected an installed one or 'module:attribute'{near}"
            )
        return resolve(points[use].value, *folders)
    for folder in dict.fromkeys(str(folder.absolute()) for folder in folders):
        if folder not in sys.path:
            sys.path.append(folder)
    module_name, _, attribute = use.partition(":")
    found: Any = _imported(module_name, folders)
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


def _imported(name: str, folders: Iterable[Path]) -> object:
    """Import a module; whatever it raises becomes one line. ``folders`` are told as looked in."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name and (name == error.name or name.startswith(error.name + ".")):
            looked = " or ".join(dict.fromkeys(repr(str(one.absolute())) for one in folders))
            raise ValueError(
                f"no module {error.name!r}{_nearest_module(error.name)}"
                f"{looked and f', not in {looked}'}, nor where Python looks: "
                "a package of one's own is found with PYTHONPATH or 'pip install -e'"
            ) from None
        raise ValueError(f"module {name!r} cannot be imported, {_line(error)}") from error
    except RAISED as error:
        line = f"{_line(error)}{place(error)}"
        raise ValueError(f"module {name!r} cannot be imported, {line}") from error


def _nearest_module(name: str) -> str:
    """Return the nearest modules among the installed components' and their neighbours."""
    known = {point.module for point in installed_components().values()}
    return nearest(name, sorted(known | {module.partition(".")[0] for module in known}))


def _line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
