"""Compile a kernel with numba, from a cache that cannot be stale.

numba keys its disk cache on the caller's own file, so an edited *callee* goes unnoticed. Here the
cache folder carries a hash of every source file of this package: any edit is a new folder. The
user's own numba settings are left alone.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import config as _config


def cache_folder() -> Path:
    """Return the compile cache of the present sources, below $XDG_CACHE_HOME/hedgehop."""
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(source.relative_to(package).as_posix().encode())
        digest.update(source.read_bytes())
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "hedgehop" / f"{package.name}-{digest.hexdigest()[:16]}"


_FOLDER = str(cache_folder())
config: Any = _config  # its attributes are made at run time


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator: ``numba.njit`` without the GIL, cached under the hash of the sources."""

    def compile_cached(function: Callable[..., Any]) -> Any:
        users_folder = config.CACHE_DIR
        config.CACHE_DIR = _FOLDER
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        finally:
            config.CACHE_DIR = users_folder

    return compile_cached
