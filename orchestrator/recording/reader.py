"""Read a recording back: every signal by its full name, and everything that was said about it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from orchestrator.errors import nearest
from orchestrator.listener import Result
from orchestrator.recording.contents import DAMAGE, Contents, read
from orchestrator.recording.inventory import INVENTORY
from orchestrator.recording.messages import Messages, Signal, column, signals
from orchestrator.recording.topics import EVENTS, WALL_CLOCK

JSON = ("scenario.json", INVENTORY)  # attachments
EXPECTED = "expected a finished recording, or one that `hedgehop recover` has made whole"


@dataclass(frozen=True)
class Event:
    """Something that happened; the time is simulated, s."""

    time_s: float
    kind: str
    component: str
    message: str


@dataclass(frozen=True)
class Recording:
    """A finished recording; made by :meth:`open`.

    `recording["vehicle.state.u"]` is `(times_s, values)`, as in a trace: simulated seconds (n,) and
    values (n,) or (n, *shape). A variable that was only written where it changed has that many
    samples. ``components`` is what :mod:`orchestrator.recording.inventory` says of each.
    ``result`` is how the run ended; its measured times are 0 where the wall clock was not recorded.
    ``recovered`` says what is missing from one that was made whole; it is empty otherwise.
    """

    path: Path
    library: str
    topics: Mapping[str, Messages]
    signals: Mapping[str, Signal]
    scenario: Mapping[str, Any]
    components: Mapping[str, Any]
    provenance: Mapping[str, str]
    scene: Mapping[str, str]
    summary: Mapping[str, str]
    result: Result
    recovered: Mapping[str, str]

    @classmethod
    def open(cls, path: Path | str) -> "Recording":
        """Read a file.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is not a whole recording; the message names the file.
        """
        file = Path(path)
        data = content(file)
        try:
            contents = read(data)
        except DAMAGE as error:
            is_mcap = data.startswith(MCAP0_MAGIC)
            what = "is cut short or damaged" if is_mcap else "is no MCAP file"
            raise ValueError(f"{file}: {what}, {EXPECTED}") from error
        return recording(file, contents)

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of all signals."""
        return tuple(self.signals)

    def __getitem__(self, name: str) -> tuple[NDArray[np.float64], NDArray[Any]]:
        if name not in self.signals:
            near = nearest(name, list(self.signals))
            raise KeyError(f"{self.path}: no such signal, got {name!r}, expected a variable{near}")
        signal = self.signals[name]
        times_ns, values = column(self.topics[signal.topic], signal)
        return times_ns / 1e9, values

    @cached_property
    def events(self) -> list[Event]:
        """Everything that happened, in order."""
        names = ("kind", "component", "message")
        if EVENTS not in self.topics:
            return []
        topic = self.topics[EVENTS]
        return [
            Event(time_ns / 1e9, *(getattr(message, name) for name in names))
            for (time_ns, _), message in zip(topic.raw, topic.decoded, strict=True)
        ]

    @cached_property
    def wall_clock(self) -> dict[str, NDArray[np.float64]] | None:
        """Measured duration of every step, s, by component; None if it was not recorded."""
        if WALL_CLOCK not in self.topics:
            return None
        topic = self.topics[WALL_CLOCK]
        steps = {
            component: np.array([getattr(message, component) for message in topic.decoded])
            for component in (name[5:] for name in topic.metadata if name.startswith("unit."))
        }
        return {component: elapsed[elapsed > 0] for component, elapsed in steps.items()}


def content(path: Path) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    OSError
        The message names the file.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise OSError(f"{path}: cannot be read, {error.strerror}") from error


def ending(summary: Mapping[str, str]) -> Result:
    """Return how a run ended, as far as that is known.

    Raises
    ------
    LookupError, ValueError
        If something in it is missing, or is no number.
    """
    if not summary:
        return Result("")
    return Result(
        outcome=summary["outcome"],
        reason=summary["reason"],
        time_ns=int(summary["end_ns"]),
        counts=json.loads(summary.get("counts", "{}")),
        cpu_s=float(summary.get("cpu_s", "0")),
        wall_s=float(summary.get("wall_s", "0")),
    )


def recording(path: Path, contents: Contents) -> Recording:
    """Return a file's contents as a recording.

    Raises
    ------
    ValueError
        If they are not that.
    """
    tables, attached = contents.tables, contents.attachments
    if "hedgehop.provenance" not in tables or "scenario.json" not in attached:
        raise ValueError(f"{path}: not recorded by hedgehop, got {contents.library!r}")
    try:
        epoch_ns = int(tables["hedgehop.provenance"]["epoch_ns"])
        raw: dict[int, list[tuple[int, bytes]]] = {number: [] for number in contents.channels}
        for chunk in contents.chunks:
            for message in chunk:
                raw[message.channel_id].append((message.log_time - epoch_ns, message.data))
        topics = {
            channel.topic: Messages(
                contents.schemas[channel.schema_id].name,
                contents.schemas[channel.schema_id].data,
                channel.metadata,
                raw[number],
            )
            for number, channel in contents.channels.items()
        }
        found = [signal for name, topic in topics.items() for signal in signals(name, topic)]
        plain = {name: json.loads(attached[name].data) for name in JSON if name in attached}
        scene = tables["hedgehop.scene"]
        summary = tables.get("hedgehop.summary", {})
        result = ending(summary)
    except (LookupError, ValueError, DecodeError) as error:
        raise ValueError(f"{path}: is damaged, {error}, {EXPECTED}") from error
    return Recording(
        path=path,
        library=contents.library,
        topics=topics,
        signals={signal.name: signal for signal in found},
        scenario=plain["scenario.json"],
        components=plain.get(INVENTORY, {}),
        provenance=tables["hedgehop.provenance"],
        scene=scene,
        summary=summary,
        result=result,
        recovered=tables.get("hedgehop.recovered", {}),
    )
