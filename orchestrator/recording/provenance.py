"""Where a recording comes from: versions, seed, and hashes of everything the scenario names."""

import hashlib
import json
import platform
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from orchestrator.assembly.plans import Plan
from orchestrator.assembly.system import System
from orchestrator.component import INTERFACE
from orchestrator.recording.frames import CONVENTION
from orchestrator.scenario.marks import KeyPath, dotted
from orchestrator.scenario.records import Scenario

PACKAGES = (
    "hedgehop", "numpy", "scipy", "numba", "cvxpy", "daqp", "piqp", "fmpy", "mcap", "protobuf",
)  # fmt: skip
EPOCH_NS = 1_767_225_600_000_000_000  # 2026-01-01T00:00:00Z


def provenance(system: System) -> dict[str, str]:
    """Return what a reader needs to repeat the run, as strings; nothing of it is measured.

    Everything that the scenario makes has a hash under its path, `resources.terrain.sha256`, and so
    has every file: `resources.terrain.parameters.file.sha256`.
    """
    scenario = system.scenario
    entries = {f"version.{name}": _version(name) for name in PACKAGES}
    entries |= {
        "python": platform.python_version(),
        "interface": str(INTERFACE),
        "seed": str(scenario.seed),
        "epoch_ns": str(EPOCH_NS),
        "time_base": "simulated",
        "frame_convention": CONVENTION,
        "scenario.sha256": _canonical_hash(document(scenario)),
    }
    hashes = specification_hashes(system.plans)
    return entries | {f"{dotted(path)}.sha256": digest for path, digest in hashes.items()}


def specification_hashes(plans: Sequence[Plan]) -> dict[KeyPath, str]:
    """Return the SHA-256 of everything that determines each thing made, and of each file, by path.

    That is the constructor, its arguments with all defaults, the content of the files among them
    and the resources it is given, but no file's name or place. `plans` are in the order of making.
    """
    hashes: dict[KeyPath, str] = {}
    for plan in plans:
        arguments = dict(plan.arguments)
        if "parameters" in arguments:
            arguments["parameters"] = asdict(arguments["parameters"])
        plain = {
            "use": f"{plan.factory.__module__}:{plan.factory.__qualname__}",
            "arguments": _contents(arguments, plan.path, hashes),
            "resources": {key: hashes["resources", name] for key, name in plan.resources.items()},
        }
        hashes[plan.path] = _canonical_hash(plain)
    return hashes


def document(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as the plain data of a scenario file, with every default written out."""
    plain = asdict(replace(scenario, origins={}))  # not to copy them
    del plain["folder"], plain["origins"]  # where it lay says nothing about the run
    for section in ("resources", "components"):
        plain[section] = {entry.pop("name"): entry for entry in plain[section]}
    plain["connections"] = [
        {"from": link.pop("start"), "to": link.pop("end"), **link} for link in plain["connections"]
    ]
    return json.loads(json.dumps(plain, default=str))


def _canonical_hash(plain: object) -> str:
    """Return the SHA-256 of plain data, which depends on its content only."""
    return _sha256(json.dumps(plain, sort_keys=True, separators=(",", ":"), default=str).encode())


def _contents(value: object, path: KeyPath, hashes: dict[KeyPath, str]) -> object:
    """Return plain data with the hash of a file in its place; it is noted by its path, too."""
    if isinstance(value, Path):
        hashes[path] = _content_hash(value)
        return {"sha256": hashes[path]}
    if isinstance(value, dict):
        return {str(key): _contents(one, (*path, str(key)), hashes) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_contents(one, (*path, k), hashes) for k, one in enumerate(value)]
    return value


def _content_hash(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files below a folder, such as an unpacked FMU."""
    if not path.is_dir():
        return _sha256(path.read_bytes())
    files = {str(one.relative_to(path)): one for one in path.rglob("*") if one.is_file()}
    return _canonical_hash({name: _sha256(one.read_bytes()) for name, one in files.items()})


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
