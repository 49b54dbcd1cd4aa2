"""One thread, and what a figure was measured on.

Imported before numpy by every benchmark: more BLAS threads make small problems slower.
"""

import os
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("hedgehop", "numpy", "scipy", "numba", "llvmlite", "daqp", "mcap")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

os.environ.update(dict.fromkeys(THREADS, "1"))


def describe() -> dict[str, str | int]:
    """Return processor, cores, system, date (UTC) and versions as plain data."""
    return {
        "processor": processor(),
        "cores": os.cpu_count() or 0,
        "system": platform.system(),
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }


def line() -> str:
    """Return the same as one line of text."""
    here = describe()
    versions = ", ".join(f"{name} {here[name]}" for name in ("python", *PACKAGES))
    return f"{here['processor']}, {here['cores']} cores, {here['date']}; {versions}"


def processor() -> str:
    """Return the processor's name, with family and model where Linux tells them."""
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.is_file():
        return platform.processor() or platform.machine()
    facts: dict[str, str] = {}
    for entry in cpuinfo.read_text().splitlines():
        key, _, value = entry.partition(":")
        facts.setdefault(key.strip(), value.strip())
    name = facts.get("model name", platform.machine())
    widest = "AVX-512" if "avx512f" in facts.get("flags", "") else "AVX2 or less"
    return f"{name} (family {facts.get('cpu family')}, model {facts.get('model')}, {widest})"
