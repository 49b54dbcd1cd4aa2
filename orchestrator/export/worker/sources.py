"""The Python sources that the component in an FMU is made of: which they are, and where."""

import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path


def files_of(package: str) -> dict[str, bytes]:
    """Return the files of a top-level package or module, by path; none if it cannot be found."""
    spec = importlib.util.find_spec(package)
    if spec is None:
        return {}
    if not spec.submodule_search_locations:
        return {} if spec.origin is None else {f"{package}.py": Path(spec.origin).read_bytes()}
    folder = Path(next(iter(spec.submodule_search_locations)))
    return {
        f"{package}/{file.relative_to(folder).as_posix()}": file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and "__pycache__" not in file.parts
    }


def digest(files: Mapping[str, bytes]) -> str:
    """Return a hash of files' paths and contents."""
    found = sha256()
    for path, content in sorted(files.items()):
        found.update(f"{path}\0{len(content)}\0".encode())
        found.update(content)
    return found.hexdigest()


def find_sources(folder: Path, packages: list[str], wanted: str) -> None:
    """Make the FMU's own sources importable, before all others.

    Where the interpreter has the very same ones installed, those are used; otherwise a copy whose
    place depends on the content alone. Compiled kernels are kept by the path of their source, and an
    FMU is unpacked to another path each time.
    """
    installed: dict[str, bytes] = {}
    for package in packages:
        installed |= files_of(package)
    if digest(installed) == wanted:
        return
    sources = folder / "python"
    try:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hedgehop"
        kept = cache / f"fmu-{wanted[:16]}"
        if not kept.is_dir():
            cache.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=cache) as fresh:
                shutil.copytree(sources, Path(fresh) / "python")
                try:
                    (Path(fresh) / "python").rename(kept)
                except OSError:
                    if not kept.is_dir():  # else another instance was faster
                        raise
        sources = kept
    except (OSError, RuntimeError):
        pass  # no place to keep it
    sys.path.insert(0, str(sources))
