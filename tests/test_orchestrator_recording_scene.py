"""The scene: what viewers draw, complete in every message, in their frames, where it was."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fake_system import SCENE, TICK_NS, flight, helicopter, make_system, port, tell
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.recorder import Recorder
from orchestrator.recording.rows import messages as told_messages
from orchestrator.recording.scene import Stage
from orchestrator.recording.scene_terrain import MAX_POSTS, Box, mesh_entity, terrain_mesh
from orchestrator.recording.streams import Stream
from orchestrator.recording.topics import topics
from orchestrator.scenario.records import RecordingSpec

DRAWN = {"terrain", "terrain_points", "craft", "rotor", "profile", "reference", "marks", "paths"}
DRAWN |= {"sensed"}
ALL = {f"/scene/{name}" for name in DRAWN}


class Hill:
    """Ground with a crest along north, posts every 50 m."""

    def surface(self):
        """Return the posts."""
        north, east = np.arange(-3000.0, 3001.0, 50.0), np.arange(-1500.0, 1501.0, 50.0)
        return north, east, self.elevation(north[:, None], east[None, :])

    def elevation(self, north, east):
        """Return the elevation, m."""
        return 60.0 * np.exp(-((east / 400.0) ** 2)) + 0.01 * north


class Posts(Hill):
    """The same, known at its posts only, with a hole."""

    elevation = None

    def surface(self):
        """Return the posts."""
        north, east = np.arange(-3000.0, 3001.0, 50.0), np.arange(-1500.0, 1501.0, 50.0)
        z = 60.0 * np.exp(-((east[None, :] / 400.0) ** 2)) + 0.01 * north[:, None]
        z[50:53, 20:24] = np.nan
        return north, east, z


def staged(ground=None, *, roles=(), scene=True, **more):
    """Return the helicopter's system with a terrain and all roles, or these."""
    system = helicopter(cells=40, capacity=8, posts=5, **more)
    every = {**SCENE, "scan": "sensor.scan", "wind": "gust.wind", "terrain": "${terrain}"}
    chosen = {role: every[role] for role in roles or every}
    spec = replace(system.scenario.recording, scene=scene)
    scenario = replace(system.scenario, scene=chosen, recording=spec)
    return replace(system, scenario=scenario, resources={"terrain": ground or Hill()})


def messages(path, topic=None):
    """Return (topic, time in ns, message) of all messages, as other programs read them."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        read = reader.iter_decoded_messages(topics=None if topic is None else [topic])
        return [(c.topic, m.log_time - EPOCH_NS, d) for _, c, m, d in read]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "flight.mcap"
    system = staged()
    tell(Recorder(path), system, flight(system, 3.0))
    return path


def drawn(topic, *given):
    """Return the messages of one topic for what is valid at some log times."""
    told, refusals = Stream({1: topic}).records(given)
    assert refusals == []
    return [data for _, _, data in told_messages(told)]


def poses(message):
    """Yield every pose in a message."""
    for field, value in message.ListFields():
        if field.message_type is None:
            continue
        for one in value if field.is_repeated else [value]:
            if field.message_type.full_name == "foxglove.Pose":
                yield one
            elif field.message_type.full_name not in ("foxglove.Point3", "foxglove.Color"):
                yield from poses(one)


def test_every_message_is_complete_and_in_its_frame(file):
    """Turns have length one, every entity has name, frame and its message's time."""
    found = set()
    for topic, time_ns, message in messages(file):
        found.add(topic)
        for pose in poses(message):
            q = pose.orientation
            assert pose.HasField("position")  # to some readers none is not the origin
            assert q.x**2 + q.y**2 + q.z**2 + q.w**2 == pytest.approx(1.0)
        if message.DESCRIPTOR.full_name == "foxglove.SceneUpdate":
            assert not message.deletions
            assert message.entities
            for entity in message.entities:
                assert entity.timestamp.ToNanoseconds() == EPOCH_NS + time_ns
                assert entity.id
                is_craft = topic == "/scene/craft"
                assert entity.frame_id in (("heli", "rotor") if is_craft else ("map",))
        elif topic in ALL:
            assert message.timestamp.ToNanoseconds() == EPOCH_NS + time_ns
    assert found >= ALL


def test_the_craft_is_where_it_is_told_to_be_every_time(tmp_path):
    """Each pose that is told has its transform and its pose in a frame, in ENU."""
    system = make_system([port("v", f"pose.{n}") for n in POSE], {"pose": "v.pose"})
    told = [dict.fromkeys((f"pose.{n}" for n in POSE), 0.0) | {"pose.north": n} for n in (3.0, 4.0)]
    calls = [("outputs", (k * TICK_NS, "v", values)) for k, values in enumerate(told)]
    path = tmp_path / "a.mcap"
    tell(Recorder(path), system, calls)
    assert [m.translation.y for _, _, m in messages(path, "/tf")] == [3.0, 4.0]
    assert [m.pose.position.y for _, _, m in messages(path, "/scene/pose")] == [3.0, 4.0]


@pytest.mark.parametrize("name", ["trail", "fresh"])
def test_a_component_may_have_any_name(name, tmp_path):
    """Names of the scene's own are no component's."""
    system, path = staged(), tmp_path / "a.mcap"
    ports = system.ports | {name: {"x": port(name, "x")}}
    calls = [("outputs", (k, name, {"x": 1.0})) for k in (0, 10**9)]
    tell(Recorder(path), replace(system, ports=ports), calls[:1] + flight(system, 1.0) + calls[1:])
    assert {topic for topic, _, _ in messages(path)} >= ALL | {f"/{name}/outputs"}


def test_thinning_leaves_what_is_told_once_alone(tmp_path):
    """Every fourth message of the scene, but all cells and all that is written once."""
    counts = {}
    for every in ({}, {"/scene/*": 4}):
        system = staged()
        spec = replace(system.scenario.recording, every=every)
        system = replace(system, scenario=replace(system.scenario, recording=spec))
        tell(Recorder(tmp_path / "a.mcap"), system, flight(system, 4.0))
        found = [topic for topic, _, _ in messages(tmp_path / "a.mcap")]
        counts[bool(every)] = {topic: found.count(topic) for topic in found}
    whole, thinned = counts[False], counts[True]
    for topic in ("rotor", "marks", "pose", "paths", "profile"):
        assert thinned[f"/scene/{topic}"] == -(-whole[f"/scene/{topic}"] // 4)
    for topic in ("sensed", "terrain", "terrain_points", "craft"):
        assert thinned[f"/scene/{topic}"] == whole[f"/scene/{topic}"]


def test_entities_keep_their_names(file):
    """Each message of a topic has the same entities, so that the next one replaces them."""
    names = {}
    for topic, _, message in messages(file):
        if message.DESCRIPTOR.full_name == "foxglove.SceneUpdate":
            here = [entity.id for entity in message.entities]
            assert names.setdefault(topic, here) == here
    assert names["/scene/paths"] == ["reference", "plan", "trail"]
    assert names["/scene/marks"] == ["clearance", "wind"]


def test_what_does_not_change_is_written_once_at_the_start(file):
    """Ground and craft are told at time 0; blades, stick, lines and numbers go on."""
    counts = {}
    for topic, time_ns, _ in messages(file):
        counts.setdefault(topic, []).append(time_ns)
    for name in ("terrain", "terrain_points", "craft"):
        assert counts[f"/scene/{name}"] == [0]
    assert len(counts["/scene/rotor"]) == len(counts["/tf"]) == 61
    assert len(counts["/scene/profile"]) == len(counts["/tf"])
    assert len(counts["/scene/paths"]) == len(counts["/scene/reference"]) == 7


def test_a_switched_off_scene_leaves_all_else_as_it_is(tmp_path):
    """Without it there is nothing that only viewers draw, and every signal is the same."""
    bare, full = staged(scene=False), staged()
    for system, name in ((bare, "bare"), (full, "full"), (full, "again")):
        tell(Recorder(tmp_path / name), system, flight(system, 1.0))
    assert (tmp_path / "full").read_bytes() == (tmp_path / "again").read_bytes()
    found = {topic for topic, _, _ in messages(tmp_path / "bare")}
    assert not [topic for topic in found if topic.startswith(("/scene/", "/tf"))]
    kept = [m for m in messages(tmp_path / "full") if m[0] in found]
    assert [(t, n, m.SerializeToString()) for t, n, m in kept] == [
        (t, n, m.SerializeToString()) for t, n, m in messages(tmp_path / "bare")
    ]


@pytest.mark.parametrize(
    ("roles", "expected"),
    [
        (("pose",), {"craft", "rotor", "profile", "paths"}),
        (("pose", "terrain"), {"craft", "rotor", "profile", "paths", "terrain", "terrain_points"}),
        (("pose", "wind"), {"craft", "rotor", "profile", "paths", "marks"}),
        (("path",), {"paths"}),
        (("scan",), {"sensed"}),
        (("clearance", "terrain", "wind"), set()),
    ],
)
def test_a_missing_role_leaves_its_part_out(roles, expected, tmp_path):
    """Whatever roles a plant fills, it is told what can be drawn of them, and that is drawn."""
    system = staged(roles=roles)
    tell(Recorder(tmp_path / "a.mcap"), system, flight(system, 2.0))
    found = {topic for topic, _, _ in messages(tmp_path / "a.mcap")}
    assert found & ALL == {f"/scene/{name}" for name in expected}
    planned = {topic.name for topic in topics(system, wall_clock=False)}
    assert planned & ALL == found & ALL


def test_a_terrain_that_cannot_be_drawn_is_left_out():
    """A resource without a surface is no error: others may have other uses for it."""
    names = {topic.name for topic in topics(staged(object()), wall_clock=False)}
    assert "/scene/terrain" not in names


def test_the_ground_is_drawn_where_it_is():
    """Vertices lie on the surface, triangles face up, few enough, finest around the flight."""
    box = Box(-500.0, 1500.0, -500.0, 600.0)
    mesh = terrain_mesh(Hill(), box)
    assert mesh.z.size <= MAX_POSTS
    surface = Hill().elevation(mesh.y[:, None], mesh.x[None, :])
    np.testing.assert_allclose(mesh.z, surface, atol=1 / 32)
    assert (np.diff(mesh.x) > 0).all()
    assert (np.diff(mesh.y) > 0).all()
    assert np.diff(mesh.x[mesh.near[1]]).max() < 50.0
    assert (mesh.x[0], mesh.x[-1], mesh.y[0], mesh.y[-1]) == (-1500, 1500, -3000, 3000)
    assert ((mesh.rgb >= 0) & (mesh.rgb <= 1)).all()
    assert up(mesh).min() > 0


def test_a_hole_in_the_ground_stays_one():
    """Known at posts only, it is drawn by them; no triangle has a corner without elevation."""
    mesh = terrain_mesh(Posts(), Box(-500.0, 1500.0, -500.0, 600.0))
    north, east, _ = Posts().surface()
    assert set(mesh.y) <= set(north)
    assert set(mesh.x) <= set(east)
    assert np.isnan(mesh.z).any()
    faces = up(mesh)
    assert faces.min() > 0
    whole = np.isfinite(mesh.z)
    cells = whole[1:, 1:] & whole[1:, :-1] & whole[:-1, 1:] & whole[:-1, :-1]
    assert len(faces) >= 2 * cells.sum()
    assert len(faces) < 2 * cells.size


def up(mesh):
    """Return z of the normals of all triangles, from the message."""
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    stamp = b"\x0a\x0c\x08\x80\x80\x80\x80\x00\x10\x80\x80\x80\x80\x00"
    (entity,) = SceneUpdate.FromString(mesh_entity(mesh, stamp)).entities
    (shape,) = entity.triangles
    points = np.array([(p.x, p.y, p.z) for p in shape.points])
    assert np.isfinite(points).all()
    assert len(shape.colors) == len(points)
    a, b, c = points[np.reshape(shape.indices, (-1, 3))].transpose(1, 0, 2)
    return np.cross(b - a, c - a)[:, 2]


def test_the_trail_ends_at_the_craft_and_forgets():
    """Its last point is the craft's; the others are where it was, at most 60 s ago."""
    system = make_system([port("v", f"pose.{n}") for n in POSE], {"pose": "v.pose"})
    paths = next(t for t in topics(system, wall_clock=False) if t.name == "/scene/paths")
    stage = Stage(system)
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    for tick in range(0, 20 * 100 + 1, 4):
        values = dict.fromkeys((f"pose.{n}" for n in POSE), 0.0) | {"pose.north": 0.5 * tick}
        for topic, moment in stage.outputs(tick * TICK_NS, "v", values):
            if topic == "/scene/paths":
                (data,) = drawn(paths, (EPOCH_NS + tick * TICK_NS, moment))
                (entity,) = SceneUpdate.FromString(data).entities
                y = [point.y for point in entity.lines[0].points]
                assert y[-1] == 0.5 * tick
                assert all(a <= b for a, b in pairwise(y))
                assert y[0] >= 0.5 * tick - 600.0
    assert y[0] == 0.5 * tick - 590.0


POSE = ("north", "east", "down", "phi", "theta", "psi")


@given(st.lists(st.integers(0, 60), max_size=12))
@settings(deadline=None, max_examples=60)
def test_every_sensed_cell_is_drawn_once(sizes):
    """Of a ring, what came since the last look; of more than it holds, the newest."""
    system = staged(roles=("scan",))
    sensed = next(t for t in topics(system, wall_clock=False) if t.name == "/scene/sensed")
    stage, count = Stage(system), 0
    for tick, size in enumerate(sizes):
        cells = np.arange(count, count + size)[-40:]
        count += size
        ring = np.zeros(40)
        ring[cells % 40] = cells
        values = {f"scan.{name}": ring for name in ("north", "east", "elevation", "source")}
        values["scan.count"] = count
        moments = stage.outputs(tick * TICK_NS, "sensor", values)
        assert len(moments) == (size > 0)
        for data in drawn(sensed, *((EPOCH_NS, moment) for _, moment in moments)):
            from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

            cloud = PointCloud.FromString(data)
            points = np.frombuffer(cloud.data, "<f4").reshape(-1, 4)
            np.testing.assert_array_equal(points[:, 1], cells)
            assert cloud.point_stride == 16


NUMBER = st.floats(-50.0, 50.0).map(lambda x: round(x, 3))


@given(st.tuples(*[NUMBER] * 3), st.floats(0.5, 90.0), st.tuples(*[NUMBER] * 3))
@settings(deadline=None, max_examples=60)
def test_marks_show_height_and_wind(position, clearance, wind):
    """The stick goes straight down to the ground; the arrow is the velocity of the air."""
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    system = staged(roles=("pose", "clearance", "wind"))
    marks = next(t for t in topics(system, wall_clock=False) if t.name == "/scene/marks")
    north, east, down = position
    pose = dict(zip((f"pose.{n}" for n in POSE), (*position, 0.1, 0.2, 0.3), strict=True))
    air = dict(zip(("wind.north", "wind.east", "wind.down"), wind, strict=True))
    (data,) = drawn(marks, (EPOCH_NS, (pose | {"clearance": clearance}, air)))
    update = SceneUpdate.FromString(data)
    stick, arrow = update.entities[0].lines[0].points, update.entities[1].arrows[0]
    assert [(p.x, p.y) for p in stick] == [(east, north)] * 2
    assert (stick[0].z, stick[1].z) == (-down, -down - clearance)
    q, length = arrow.pose.orientation, arrow.shaft_length
    ahead = (1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.z * q.w), 2 * (q.x * q.z - q.y * q.w))
    expected = (wind[1], wind[0], -wind[2])
    assert [length * part for part in ahead] == pytest.approx(expected, abs=1e-6)


def test_the_profile_tells_heights_upwards_and_the_reference_beside(tmp_path):
    """Altitude, ground and speed of the craft; the reference where it is nearest to it."""
    names = ("north", "east", "altitude", "heading", "speed")
    ports = [port("v", f"pose.{n}") for n in POSE] + [port("v", "clearance")]
    ports += [port("v", f"velocity.{n}") for n in POSE[:3]]
    ports += [port("c", f"reference.{n}", shape=(4,)) for n in names]
    scene = {"pose": "v.pose", "clearance": "v.clearance", "velocity": "v.velocity"}
    system = make_system(ports, scene | {"reference": "c.reference"})
    craft = {"pose.north": 21.0, "pose.east": 1.0, "pose.down": -30.0, "pose.psi": np.pi / 2}
    craft |= {"pose.phi": 0.0, "pose.theta": 0.0, "clearance": 12.0}
    craft |= {"velocity.north": 3.0, "velocity.east": 0.0, "velocity.down": 4.0}
    reference = {
        "reference.north": np.array([0.0, 10.0, 20.0, 30.0]),
        "reference.east": np.zeros(4),
        "reference.altitude": np.array([1.0, 2.0, 31.0, 4.0]),
        "reference.heading": np.array([0.0, 0.0, np.pi, 0.0]),
        "reference.speed": np.array([0.0, 0.0, 6.0, 0.0]),
    }
    path = tmp_path / "a.mcap"
    tell(Recorder(path), system, [("outputs", (0, "v", craft)), ("outputs", (0, "c", reference))])
    for topic, expected in (
        ("/scene/profile", {"altitude": 30.0, "heading": 90.0, "ground": 18.0, "speed": 5.0}),
        ("/scene/reference", {"altitude": 31.0, "heading": 180.0, "speed": 6.0}),
    ):
        ((_, _, told),) = messages(path, topic)
        values = {field.name: value for field, value in told.ListFields()[1:]}
        assert values == pytest.approx(expected)


def test_the_rotor_turns_clockwise_at_a_steady_rate(file):
    """From message to message it turns by the same angle about its mast, less than a half turn."""
    turns = [m.rotation for _, _, m in messages(file, "/scene/rotor")]
    angles = np.unwrap([2.0 * np.arctan2(q.z, q.w) for q in turns])
    steps = np.diff(angles)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
    assert -np.pi / 4 < steps[0] < 0  # two blades alike: beyond a quarter they would seem to stop
    assert {(q.x, q.y) for q in turns} == {(0.0, 0.0)}


def test_settings_say_whether_there_is_a_scene():
    """The scene is recorded unless a scenario says otherwise."""
    assert RecordingSpec().scene
