"""Recordings as Rerun's own files; needs rerun-sdk."""

from dataclasses import replace

import numpy as np
import pytest
from fake_system import SCENE, flight, helicopter, make_system, port, tell

from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder

pytestmark = pytest.mark.viewers


class Slope:
    """A plane that rises to the east."""

    def surface(self):
        """Return the posts."""
        north, east = np.arange(-2000.0, 2001.0, 100.0), np.arange(-2000.0, 2001.0, 100.0)
        return north, east, np.zeros((41, 1)) + 0.1 * east[None, :]


def written(folder, system, calls):
    """Return the components of every entity of a recording's .rrd file, and of its blueprint."""
    from rerun.chunk import RrdReader

    from orchestrator.viewing.rrd import write_rrd

    tell(Recorder(folder / "a.mcap"), system, calls)
    write_rrd(Recording.open(folder / "a.mcap"), folder / "a.rrd")
    found = {}
    for chunk in RrdReader(folder / "a.rrd").stream():
        names = chunk.to_record_batch().schema.names
        found.setdefault(chunk.entity_path, set()).update(names)
    return found


@pytest.fixture(scope="module")
def columns(tmp_path_factory):
    system = helicopter(cells=6, capacity=4, posts=3, wall_clock=True)
    scene = {**SCENE, "scan": "sensor.scan", "wind": "gust.wind", "terrain": "${terrain}"}
    system = replace(
        system, resources={"terrain": Slope()}, scenario=replace(system.scenario, scene=scene)
    )
    return written(tmp_path_factory.mktemp("rrd"), system, flight(system, 1.0))


def test_everything_in_the_scene_becomes_something_to_see(columns):
    """Meshes, lines, bodies, arrows, points and frames are there, under the names of the scene."""
    assert "Mesh3D:vertex_positions" in columns["/scene/terrain/terrain/mesh"]
    assert "Mesh3D:vertex_positions" in columns["/scene/craft/fuselage/mesh"]
    assert "Boxes3D:half_sizes" in columns["/scene/craft/rotor/boxes"]
    for name in ("plan", "reference", "trail"):
        assert "LineStrips3D:strips" in columns[f"/scene/paths/{name}/lines"]
    assert "Arrows3D:vectors" in columns["/scene/marks/wind/arrows"]
    assert "Points3D:positions" in columns["/scene/sensed"]
    for frame in ("/tf", "/scene/rotor", "/chase"):
        assert "Transform3D:translation" in columns[frame]


def test_no_scene_message_is_kept_twice(columns):
    """What has become a mesh is not there as a message too."""
    assert not any("foxglove.SceneUpdate:message" in names for names in columns.values())


def test_limits_states_and_log_are_there(columns):
    """Lines across the plots, texts of enumerations, and the log."""
    assert "Scalars:scalars" in columns["/lines/height\\ above\\ ground/m/set\\ height"]
    assert "StateChange:state" in columns["/states/mpc.ladder"]
    assert "TextLog:text" in columns["/log"]


def test_every_series_of_the_blueprint_has_its_message(columns):
    """A selector finds a field in the messages of its topic."""
    assert "hedgehop.vehicle.Actuator:message" in columns["/vehicle/actuator"]
    assert "hedgehop.Profile:message" in columns["/scene/profile"]


@pytest.mark.parametrize(
    "system",
    [
        make_system([port("c", "x"), port("c", "plan.text", kind="String")]),
        make_system([port("c", "p", causality="parameter")]),
    ],
)
def test_any_recording_gives_a_file(tmp_path, system):
    """One without a craft, or without anything, too."""
    calls = [("log", (0, 20, "x", "y"))]
    calls += (
        [("outputs", (0, "c", {"x": 1.0, "plan.text": "é"}))] if len(system.ports["c"]) > 1 else []
    )
    assert "/log" in written(tmp_path, system, calls)
