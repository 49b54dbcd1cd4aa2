"""Where a recording comes from: hashes of everything that a scenario makes and reads."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from small_components import GROUND, SCENARIO

from orchestrator.assembly import plans as planning
from orchestrator.assembly.build import build
from orchestrator.assembly.plans import make_plans
from orchestrator.recording.provenance import provenance, specification_hashes
from orchestrator.scenario.load import load

GROUND_PATH = ("resources", "ground")


@pytest.fixture(autouse=True)
def scenario(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("glide.yaml").write_text(SCENARIO)
    Path("ground.txt").write_text(GROUND)


def hashes(*overrides):
    return specification_hashes(make_plans(load("glide.yaml", overrides)))


def test_the_hash_of_a_thing_is_that_of_its_content():
    """Names and places of files do not count, their content and every default do."""
    same = hashes()[GROUND_PATH]
    Path("other.txt").write_text(GROUND)
    moved = "resources.ground.parameters.file=other.txt", "resources.ground.parameters.offset_m=0"
    assert hashes(*moved)[GROUND_PATH] == same
    Path("other.txt").write_text("11")
    assert hashes(*moved)[GROUND_PATH] != same


def test_what_a_component_is_given_is_part_of_it():
    """Another content of its resource is another component; the others stay what they are."""
    before = hashes()
    Path("ground.txt").write_text("11")
    after = hashes()
    changed = {path for path in before if before[path] != after[path]}
    assert changed == {GROUND_PATH, (*GROUND_PATH, "parameters", "file"), ("components", "glider")}


def test_files_are_found_as_the_loader_finds_them(tmp_path, monkeypatch):
    """A file that came with the installation is hashed like one beside the scenario."""
    beside = provenance(build(load("glide.yaml")))
    installed = tmp_path / "installed"
    installed.mkdir()
    Path("ground.txt").rename(installed / "ground.txt")
    monkeypatch.setattr(planning, "installed", lambda: installed)
    assert provenance(build(load("glide.yaml"))) == beside
    file = hashlib.sha256(GROUND.encode()).hexdigest()
    assert beside["resources.ground.parameters.file.sha256"] == file


def test_provenance_says_what_a_repetition_needs():
    """Seed, versions and a hash of everything made; nothing in it is measured or local."""
    system = build(load("glide.yaml"))
    entries = provenance(system)
    made = {f"{section}.{name}.sha256" for section, name in (p.path for p in system.plans)}
    assert made <= set(entries)
    assert entries["seed"] == str(system.scenario.seed)
    assert not [value for value in entries.values() if str(Path.cwd()) in value]
    elsewhere = replace(system, scenario=replace(system.scenario, folder=Path("elsewhere")))
    assert provenance(elsewhere) == entries
