"""A recording as a viewer reads it; needs rerun-sdk, which only ``make check`` installs."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.viewers


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the recording of the main scenario's first five seconds."""
    file = tmp_path_factory.mktemp("viewers") / "flight.mcap"
    scenario = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
    arguments = ["run", str(scenario), "--set", "duration_s=5", "--out", str(file)]
    subprocess.run([sys.executable, "-m", "orchestrator", *arguments], check=True)
    return file


def test_rerun_finds_no_fault(recording):
    """Every channel is well formed and in order on every timeline."""
    rerun = Path(sys.executable).with_name("rerun")
    found = subprocess.run(
        [rerun, "mcap", "check", "--full", recording], check=True, capture_output=True, text=True
    )
    rows = found.stdout.partition("\n──")[2].splitlines()[1:]
    assert rows
    assert [row for row in rows if not row.startswith("ok ")] == []


def test_rerun_decodes_every_channel(recording):
    """No channel stays a blob, and the scene becomes what a viewer draws."""
    from rerun.chunk import McapReader

    columns: dict[str, set[str]] = {}
    for chunk in McapReader(recording).stream():
        columns.setdefault(chunk.entity_path, set()).update(chunk.to_record_batch().schema.names)
    assert [topic for topic, names in columns.items() if "McapMessage:data" in names] == []
    assert "Transform3D:translation" in columns["/tf"]
    assert "InstancePoses3D:translations" in columns["/scene/pose"]
    assert "InstancePoses3D:translations" in columns["/scene/plan"]
    assert "Points3D:positions" in columns["/scene/terrain_points"]
    assert "Points3D:positions" in columns["/scene/sensed"]
    assert "Transform3D:translation" in columns["/scene/rotor"]
    assert "TextLog:text" in columns["/log"]
    assert "hedgehop.vehicle.State:message" in columns["/vehicle/state"]
