"""A recording as Rerun's own file, with its blueprint, and with what Rerun does not read itself."""

from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from rerun.chunk import McapReader

from orchestrator.recording.frames import MAP
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.reader import Recording
from orchestrator.viewing.blueprint import CHASE, FAINT, blueprint, line_path, state_path
from orchestrator.viewing.drawing import log_scene
from orchestrator.viewing.plots import Contents, pages, recorded, states

APPLICATION = "hedgehop"
TIMELINE = "message_log_time"


def write_rrd(recording: Recording, out: Path) -> None:
    """Write a recording as an .rrd file that opens as it should look.

    Rerun's own importer reads the messages; scenes, which it does not draw, become meshes, lines
    and bodies, enumerations become states, and limits lines across the plots.

    Raises
    ------
    OSError
        If ``out`` cannot be written.
    """
    contents = recorded(recording)
    scenes = {n: t for n, t in recording.topics.items() if t.message == "foxglove.SceneUpdate"}
    stream = rr.RecordingStream(APPLICATION, recording_id=recording.path.stem)
    stream.save(out, default_blueprint=blueprint(contents))
    reader = McapReader(
        recording.path,
        exclude_topic_regex=[f"^{topic}$" for topic in scenes],
    )
    stream.send_chunks(reader.stream())
    for topic, messages in scenes.items():
        for (time_ns, _), message in zip(messages.raw, messages.decoded, strict=True):
            _set_time(stream, time_ns)
            log_scene(stream, topic, message)
    _log_chase(stream, recording)
    _log_lines(stream, recording, contents)
    _log_states(stream, recording, contents)
    stream.flush()
    stream.disconnect()


def _log_lines(stream: rr.RecordingStream, recording: Recording, contents: Contents) -> None:
    """Log the lines across the plots, from the beginning to the end."""
    for plot in chain.from_iterable(pages(contents).values()):
        for label, value in plot.lines.items():
            path = line_path(plot, label)
            style = rr.SeriesLines(names=f"{label} [{plot.unit}]", colors=[FAINT], widths=1.0)
            stream.log(path, style, static=True)
            for time_ns in (0, recording.result.time_ns):
                _set_time(stream, time_ns)
                stream.log(path, rr.Scalars(value))


def _log_states(stream: rr.RecordingStream, recording: Recording, contents: Contents) -> None:
    """Log the text of enumerations where it changes."""
    for field in states(contents):
        times, values = recording[field.label]
        items = recording.signals[field.label].items
        is_new = np.append(True, values[1:] != values[:-1]) if len(values) else []
        for time_s, value in zip(times[is_new], values[is_new], strict=True):
            _set_time(stream, round(time_s * 1e9))
            text = items.get(int(value), f"{value}")
            stream.log(state_path(field), rr.StateChange(state=text))


def _set_time(stream: rr.RecordingStream, time_ns: int) -> None:
    stream.set_time(TIMELINE, timestamp=np.datetime64(EPOCH_NS + time_ns, "ns"))


def _log_chase(stream: rr.RecordingStream, recording: Recording) -> None:
    """Log the frame in which the scene is looked at: behind the craft, wherever it goes."""
    topic = recording.topics.get("/scene/pose")
    if topic is None or not topic.raw:
        return
    poses: list[Any] = list(topic.decoded)
    at = np.array([(p.x, p.y, p.z) for p in (m.pose.position for m in poses)])
    q = np.array([(q.x, q.y, q.z, q.w) for q in (m.pose.orientation for m in poses)]).T
    heading = np.arctan2(2.0 * (q[3] * q[2] + q[0] * q[1]), 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2))
    turn = np.column_stack([0.0 * heading, 0.0 * heading, np.sin(heading / 2), np.cos(heading / 2)])
    times = np.array([EPOCH_NS + time_ns for time_ns, _ in topic.raw], "datetime64[ns]")
    columns = rr.Transform3D.columns(
        translation=at,
        quaternion=turn,
        parent_frame=[MAP] * len(at),
        child_frame=[CHASE] * len(at),
    )
    stream.send_columns("/chase", [rr.TimeColumn(TIMELINE, timestamp=times)], columns)
