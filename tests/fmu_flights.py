"""Fly small scenarios of FMUs, recorded, and look at what came of it."""

import re
from pathlib import Path

import yaml

from orchestrator.flight import fly
from orchestrator.recording.reader import Recording
from orchestrator.recording.topics import LOG


def written(folder, components, connections=(), **keys):
    """Return the file of a scenario; a component is a mapping of its keys, ``use`` may be a path."""
    file = folder / "flight.yaml"
    document = {
        "title": "FMUs",
        "duration_s": 1,
        "recording": {"wall_clock": False},
        **keys,
        "components": {
            name: {k: str(v) if isinstance(v, Path) else v for k, v in one.items()}
            for name, one in components.items()
        },
        "connections": list(connections),
    }
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file


def flown(folder, components, connections=(), **keys):
    """Return the recording of a flight, read back from the file."""
    out = folder / "flight.mcap"
    flight = fly(written(folder, components, connections, **keys), out=out)
    assert flight.recording == out
    return Recording.open(out)


def kinds(recording):
    """Return the kinds of events but for the last, which is the end."""
    assert recording.events[-1].kind == "end"
    return [event.kind for event in recording.events[:-1]]


def log(recording):
    """Return the lines of the log: time in s, level, message."""
    topic = recording.topics[LOG]
    return [
        (time_ns / 1e9, message.level, message.message)
        for (time_ns, _), message in zip(topic.raw, topic.decoded, strict=True)
    ]


def complaints(text):
    """Return the lines of an error message without those that quote the scenario file."""
    return [line for line in text.strip().splitlines() if not re.match(r" *\d* \|", line)]
