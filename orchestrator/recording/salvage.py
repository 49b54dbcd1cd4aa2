"""Read what can be read of a damaged recording.

A recording begins with all there is to say about the run, then come chunks of at most one simulated
second, each with a CRC, then a summary that says some of it again. Chunks that fit their CRC are
kept; where a record does not end where the next one begins, reading goes on at whatever looks like
a chunk.
"""

import re
from collections.abc import Iterator
from struct import unpack_from

from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord, Message, Statistics
from mcap.writer import MCAP0_MAGIC
from zlib_ng.zlib_ng import crc32

from orchestrator.recording.contents import DAMAGE, Contents, parse, summary_start
from orchestrator.recording.rows import AFTER_LENGTH

# opcode, length, two times, size, CRC, name of the compression
CHUNK = re.compile(rb"\x06.{5}\0{3}.{28}(?:\x04\0{3}zstd|\x03\0{3}lz4|\0{4})", re.DOTALL)


def salvage(data: bytes) -> tuple[Contents, Statistics | None, int]:
    """Return what can be read of a file, its statistics, and how many records are damaged.

    What an undamaged summary repeats is taken from there. A torn last record is not counted.
    """
    contents = Contents()
    summary = summary_start(data)
    statistics: Statistics | None = None
    if summary is not None:
        for record in _walk(data, summary, len(data) - len(MCAP0_MAGIC)):
            if record is not None:
                contents.take(record)
            if isinstance(record, Statistics):
                statistics = record
    damaged = 0
    for record in _walk(data, len(MCAP0_MAGIC), len(data) if summary is None else summary):
        if record is None:
            damaged += 1
        elif not isinstance(record, Message):  # ours are in chunks: that was something else
            try:
                contents.take(record)
            except DAMAGE:
                damaged += 1
    return contents, statistics, damaged


def _walk(data: bytes, at: int, end: int) -> Iterator[McapRecord | None]:
    """Yield the records between two places, None for what is damaged but for a torn last one.

    The CRCs of chunks are not looked at.
    """
    while at + AFTER_LENGTH <= end:
        opcode, length = unpack_from("<BQ", data, at)
        behind = at + AFTER_LENGTH + length
        record = _record(data[at:behind], opcode) if behind <= end else None
        if record is None:
            looks_like_one = CHUNK.search(data, at + 1, end)
            if looks_like_one is None:
                return
            at = looks_like_one.start()
        else:
            at = behind
        yield record


def _record(data: bytes, opcode: int) -> McapRecord | None:
    """Return the record in these bytes; None if it does not fill them or belies its CRC."""
    try:
        record = parse(data)
        if isinstance(record, Chunk):
            (size,) = unpack_from("<Q", data, AFTER_LENGTH + 32 + len(record.compression))
            if AFTER_LENGTH + 40 + len(record.compression) + size != len(data):
                return None
    except (*DAMAGE, StopIteration):
        return None
    if (
        opcode == Opcode.ATTACHMENT
        and crc32(data[AFTER_LENGTH:-4]) != unpack_from("<I", data[-4:])[0]
    ):
        return None
    return record
