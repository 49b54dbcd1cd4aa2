"""Compile a kernel with numba, from a cache that cannot be stale and depends on the sources alone.

numba keys its disk cache on the caller's own file, so an edited *callee* goes unnoticed. Here the
cache folder carries a hash of every source file of this package: any edit is a new folder. And what
a function does not say of its arithmetic it inherits from whichever caller happened to compile it
first, relaxed mathematics included, and keeps in the cache: here every kernel says all of it. The
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
_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "no_cfunc_wrapper": True,
    # what numba would take from the first caller
    "fastmath": False,
    "error_model": "numpy",
    "forceinline": False,
}
config: Any = _config  # its attributes are made at run time


def kernel(function: Callable[..., Any]) -> Any:
    """Return the function compiled by ``numba.njit``, cached under the hash of the sources.

    Without the GIL, in strict arithmetic whoever calls it; a division by zero gives an infinity or
    NaN, not an exception.
    """
    users_folder = config.CACHE_DIR
    config.CACHE_DIR = _FOLDER
    try:
        return numba.njit(**_OPTIONS)(function)
    finally:
        config.CACHE_DIR = users_folder
