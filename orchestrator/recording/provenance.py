"""Where a recording comes from: versions, seed, and hashes of everything the scenario names."""

import hashlib
import json
import platform
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from orchestrator.component import INTERFACE
from orchestrator.recording.frames import CONVENTION
from orchestrator.scenario.records import Scenario

PACKAGES = (
    "hedgehop", "numpy", "scipy", "numba", "cvxpy", "daqp", "piqp", "fmpy", "mcap", "protobuf",
)  # fmt: skip
EPOCH_NS = 1_767_225_600_000_000_000  # 2026-01-01T00:00:00Z


def provenance(scenario: Scenario) -> dict[str, str]:
    """Return what a reader needs to repeat the run, as strings; nothing of it is measured."""
    entries = {f"version.{name}": _version(name) for name in PACKAGES}
    entries |= {
        "python": platform.python_version(),
        "interface": str(INTERFACE),
        "seed": str(scenario.seed),
        "epoch_ns": str(EPOCH_NS),
        "time_base": "simulated",
        "frame_convention": CONVENTION,
        "scenario.sha256": _sha256(canonical(document(scenario))),
    }
    for resource in scenario.resources:
        entries[f"resource.{resource.name}.sha256"] = _sha256(canonical(asdict(resource)))
    for name, file in _files(scenario):
        entries[f"file.{name}.sha256"] = _sha256(file.read_bytes())
    return entries


def document(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as the plain data of a scenario file, with every default written out."""
    plain = asdict(scenario)
    del plain["folder"], plain["origins"]  # where it lay says nothing about the run
    for section in ("resources", "components"):
        plain[section] = {entry.pop("name"): entry for entry in plain[section]}
    plain["connections"] = [
        {"from": link["start"], "to": link["end"], "delay_s": link["delay_s"]}
        for link in plain["connections"]
    ]
    return json.loads(json.dumps(plain, default=str))


def canonical(plain: dict[str, Any]) -> bytes:
    """Return plain data as bytes that depend on its content only."""
    return json.dumps(plain, sort_keys=True, separators=(",", ":"), default=str).encode()


def _files(scenario: Scenario) -> Iterator[tuple[str, Path]]:
    """Yield the files that resources and components name, by the name they are given there."""
    specs = (*scenario.resources, *scenario.components)
    names = {spec.use for spec in specs}
    names |= {str(v) for s in specs for v in s.parameters.values() if isinstance(v, str | Path)}
    for name in sorted(names):
        file = scenario.folder / name
        if file.is_file():
            yield name, file


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
