"""A recording as Rerun's own file, with its blueprint, and with what Rerun does not read itself."""

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from rerun.chunk import McapReader

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.reader import Recording
from orchestrator.viewing.blueprint import FAINT, blueprint, line_path, state_path
from orchestrator.viewing.drawing import log_scene
from orchestrator.viewing.plots import Contents, flight_plots, recorded, states, update_plots

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
    stream.save(out, default_blueprint=blueprint(contents, _start(recording)))
    chunks = McapReader(recording.path).stream()
    stream.send_chunks(chunk for chunk in chunks if chunk.entity_path not in scenes)
    for topic, messages in scenes.items():
        for (time_ns, _), message in zip(messages.raw, messages.decoded, strict=True):
            _set_time(stream, time_ns)
            log_scene(stream, topic, message)
    _log_lines(stream, recording, contents)
    _log_states(stream, recording, contents)
    stream.flush()
    stream.disconnect()


def _log_lines(stream: rr.RecordingStream, recording: Recording, contents: Contents) -> None:
    """Log the lines across the plots, from the beginning to the end."""
    for plot in flight_plots(contents) + update_plots(contents):
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


def _start(recording: Recording) -> tuple[float, float, float]:
    """Return where the craft is first, ENU, m."""
    topic = recording.topics.get("/scene/pose")
    if topic is None or not topic.raw:
        return 0.0, 0.0, 0.0
    first: Any = topic.decoded[0]
    at = first.pose.position
    return at.x, at.y, at.z
