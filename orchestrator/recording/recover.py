"""Make a whole recording of what is left of one that was killed, cut short or damaged."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from io import BufferedWriter
from pathlib import Path
from struct import pack

from mcap.records import Message

from orchestrator.recording.container import Container
from orchestrator.recording.contents import Contents, summary_start
from orchestrator.recording.inventory import INVENTORY
from orchestrator.recording.messages import Messages, column, signals
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.reader import Recording, content, ending
from orchestrator.recording.rows import Row, Told
from orchestrator.recording.salvage import salvage
from orchestrator.recording.topics import EVENTS
from orchestrator.recording.whole import whole
from orchestrator.recording.wire import Instant, Layout

SUMMARY, RECOVERED = "hedgehop.summary", "hedgehop.recovered"  # names of metadata


@dataclass(frozen=True)
class Recovery:
    """What was saved and what was lost.

    Attributes
    ----------
    messages, topics : int
        How many were saved.
    complete_s, end_s : float or None
        Simulated time up to which every message is there, and of the last that is; None: of none.
    lost_messages : int
        Known to be missing; of what came behind the end of a file that was cut nothing is known.
    damaged_records : int
        Most are chunks.
    lost : tuple of str
        Topics whose description is damaged, and what else was said about the run.
    is_cut : bool
        Whether the end of the file is missing.
    """

    messages: int
    topics: int
    complete_s: float | None
    end_s: float | None
    lost_messages: int
    damaged_records: int
    lost: tuple[str, ...]
    is_cut: bool

    def __str__(self) -> str:
        saved = f"{self.messages} messages of {self.topics} topics"
        if self.end_s is None:
            return saved
        if self.complete_s is None:
            return f"{saved}, up to {self.end_s:g} s with gaps from the start on"
        gaps = "" if self.complete_s == self.end_s else f", up to {self.end_s:g} s with gaps"
        return f"{saved}, everything up to {self.complete_s:g} s{gaps}"

    @property
    def losses(self) -> tuple[str, ...]:
        """Everything that was lost, in words."""
        least = "at least " if self.is_cut else ""
        return (
            *(["the end of the file"] if self.is_cut else []),
            *([f"damaged records: {self.damaged_records}"] if self.damaged_records else []),
            *([f"messages: {least}{self.lost_messages}"] if self.lost_messages else []),
            *self.lost,
        )


def recover(broken: Path, out: Path) -> Recovery:
    """Write what can be read of a recording as a whole one to ``out``, and say what was lost.

    The result says so too, in its metadata ``hedgehop.recovered``. If there was no ending, it is
    that of an interrupted flight.

    Raises
    ------
    OSError
        If ``broken`` cannot be read or ``out`` not be written.
    ValueError
        If nothing of a recording can be found, or both are the same file.
    """
    data = content(broken)
    contents, statistics, damaged = salvage(data)
    lost = (*_mend(contents, broken), *_drop_damaged(contents))
    is_cut = summary_start(data) is None
    missing, complete_ns = _missing(contents.chunks)
    found = sum(map(len, contents.chunks))
    if not is_cut and statistics is not None:
        missing = max(missing, statistics.message_count - found)
    epoch_ns = int(contents.tables["hedgehop.provenance"]["epoch_ns"])
    end_ns = max((m.log_time for chunk in contents.chunks for m in chunk), default=None)
    recovery = Recovery(
        messages=found,
        topics=len(contents.channels),
        complete_s=None if complete_ns is None else (complete_ns - epoch_ns) / 1e9,
        end_s=None if end_ns is None else (end_ns - epoch_ns) / 1e9,
        lost_messages=missing,
        damaged_records=damaged,
        lost=lost,
        is_cut=is_cut,
    )
    if SUMMARY not in contents.tables:
        after_ns = 0 if end_ns is None else end_ns - epoch_ns
        contents.tables[SUMMARY] = {
            "outcome": "interrupted",
            "reason": f"the recording breaks off at t = {after_ns / 1e9:.3f} s",
            "end_ns": f"{after_ns}",
        }
    contents.tables[RECOVERED] = {
        "reason": ", ".join(recovery.losses) or "nothing was lost",
        "messages": f"{found}",
        "lost_messages": f"{missing}",
        "complete_s": "" if recovery.complete_s is None else f"{recovery.complete_s}",
    }
    with whole(out, broken) as partial:
        with partial.open("wb") as stream:
            _write(stream, contents)
        Recording.open(partial)  # to be sure
    return recovery


def _mend(contents: Contents, file: Path) -> list[str]:
    """Put something in the place of what was said about the run and is lost; return what it was."""
    attached, tables = contents.attachments, contents.tables
    lost: list[str] = []
    if "scenario.json" not in attached and "scenario.yaml" in attached:
        from yaml import safe_load

        text = attached["scenario.yaml"]
        plain = json.dumps(safe_load(text.data), indent=2, ensure_ascii=False).encode()
        attached["scenario.json"] = replace(text, name="scenario.json", data=plain)
    if "scenario.json" not in attached:
        raise ValueError(f"{file}: nothing to recover, expected at least a recording's beginning")
    if INVENTORY not in attached:
        lost.append("what the components were")
    if not tables.get("hedgehop.provenance", {}).get("epoch_ns", "").isdecimal():
        tables["hedgehop.provenance"] = {"epoch_ns": f"{EPOCH_NS}"}
        lost.append("versions and hashes")
    if "hedgehop.scene" not in tables:
        tables["hedgehop.scene"] = json.loads(attached["scenario.json"].data)["scene"]
    try:
        ending(tables.get(SUMMARY, {}))
    except (LookupError, ValueError):
        del tables[SUMMARY]
        lost.append("how the run ended")
    return lost


def _drop_damaged(contents: Contents) -> list[str]:
    """Drop what its description does not fit, or what has none; return what that was."""
    raw: dict[int, list[tuple[int, bytes]]] = {}
    for chunk in contents.chunks:
        for message in chunk:
            raw.setdefault(message.channel_id, []).append((message.log_time, message.data))
    kept = {n for n in contents.channels if _is_readable(contents, n, raw.get(n, []))}
    lost = [f"topic {each.topic}" for n, each in contents.channels.items() if n not in kept]
    lost += ["a topic whose name is lost" for n in raw if n not in contents.channels]
    contents.channels = {n: each for n, each in contents.channels.items() if n in kept}
    contents.chunks = [[m for m in chunk if m.channel_id in kept] for chunk in contents.chunks]
    return lost


def _is_readable(contents: Contents, number: int, raw: list[tuple[int, bytes]]) -> bool:
    """Whether everything on a channel comes back as its description says."""
    channel = contents.channels[number]
    try:
        schema = contents.schemas[channel.schema_id]
        topic = Messages(schema.name, schema.data, channel.metadata, raw)
        for signal in signals(channel.topic, topic):
            column(topic, signal)
        wanted = {"kind", "component", "message"} if channel.topic == EVENTS else set[str]()
        return len(topic.decoded) == len(raw) and wanted <= set(topic.types)
    except Exception:  # noqa: BLE001  (a damaged description can make anything raise)
        return False


def _missing(chunks: Sequence[Sequence[Message]]) -> tuple[int, int | None]:
    """Return how many messages are missing, and the time, ns, up to which none is.

    Messages count up from 1 on every channel.
    """
    counted: dict[int, int] = {}
    missing, complete_ns, newest_ns = 0, None, None
    for chunk in chunks:
        skipped = 0
        for message in chunk:
            skipped += max(message.sequence - counted.get(message.channel_id, 0) - 1, 0)
            counted[message.channel_id] = message.sequence
        if skipped and not missing:
            complete_ns = newest_ns
        missing += skipped
        newest_ns = max((message.log_time for message in chunk), default=newest_ns)
    return missing, complete_ns if missing else newest_ns


def _write(stream: BufferedWriter, contents: Contents) -> None:
    """Write a file with these contents, chunk by chunk."""
    container = Container(stream, contents.library or f"hedgehop {version('hedgehop')}")
    for each in contents.attachments.values():
        container.add_attachment(each.log_time, each.name, each.media_type, each.data)
    for name, table in contents.tables.items():
        container.add_metadata(name, table)
    numbers: dict[int, int] = {}
    for number, channel in contents.channels.items():
        schema = contents.schemas[channel.schema_id]
        numbers[number] = container.add_channel(
            channel.topic, schema.name, schema.data, channel.metadata
        )
    whole_message = Layout((), tail=lambda _, data: data, is_stamped=False)
    rows = {number: Row({number: whole_message}) for number in numbers.values()}
    for chunk in contents.chunks:
        told: list[Told] = []
        for message in chunk:
            row = rows[numbers[message.channel_id]]
            times = pack("<QQ", message.log_time, message.publish_time)
            at = Instant(message.log_time, b"", times)
            told.append((message.log_time, row, *row.fill(message.sequence, at, message.data)))
        container.add_messages(told)
    container.finish()
