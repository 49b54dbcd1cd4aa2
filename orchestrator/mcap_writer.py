"""An MCAP writer for many small messages.

The records are those of the `mcap` package; its `Writer` spends several microseconds of Python on
every message, this one less than one. Schemas and channels stand ahead of the first chunk, so that
even the file of a killed process lists them, and a failed write leaves no torn record behind.
"""

import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from io import RawIOBase
from struct import Struct, pack

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

_MESSAGE = Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_INDEX = Struct("<BQHI")  # opcode, length, channel, length of the entries
_LEVEL = 1  # 3 saves 5 % of the bytes and costs a third more time


def _bytes(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


class McapWriter:
    """Write one file: zstd chunks, all CRCs, all indexes; log time equals publish time.

    Parameters
    ----------
    stream
        An unbuffered binary file, written from its start; not closed by this class.
    library
        Name and version of the writing program.

    Raises
    ------
    OSError
        From every method that writes; the stream then ends after its last whole record.
    """

    def __init__(self, stream: RawIOBase, library: str) -> None:
        self._stream = stream
        self._position = 0
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: list[int] = [0]  # by channel id; ids start at 1
        self._entries: list[list[int]] = [[]]  # by channel id: log time, offset, log time, ...
        self._chunk = bytearray()
        self._first_ns, self._last_ns = 0, 0
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)
        self._write(MCAP0_MAGIC + _bytes([Header("", library)]))

    def schema(self, name: str, data: bytes) -> int:
        """Register a protobuf schema (a serialised FileDescriptorSet) and return its id."""
        record = Schema(id=len(self._schemas) + 1, name=name, encoding="protobuf", data=data)
        self._schemas.append(record)
        self._write(_bytes([record]))
        return record.id

    def channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Register a channel and return its id."""
        record = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="protobuf",
            metadata=dict(metadata),
            schema_id=schema,
        )
        self._channels.append(record)
        self._counts.append(0)
        self._entries.append([])
        self._write(_bytes([record]))
        return record.id

    def message(self, channel: int, time_ns: int, data: bytes) -> None:
        """Add a message to the pending chunk; sequence numbers count from 1 on each channel."""
        chunk = self._chunk
        self._entries[channel] += (time_ns, len(chunk))
        self._counts[channel] = sequence = self._counts[channel] + 1
        chunk += _MESSAGE.pack(Opcode.MESSAGE, 22 + len(data), channel, sequence, time_ns, time_ns)
        chunk += data

    def flush(self) -> None:
        """Write the pending chunk with its message indexes."""
        if not self._chunk:
            return
        data = bytes(self._chunk)
        entries = {channel: e for channel, e in enumerate(self._entries) if e}
        self._chunk.clear()
        self._entries = [[] for _ in self._entries]
        first = min(min(e[0::2]) for e in entries.values())
        last = max(max(e[0::2]) for e in entries.values())
        compressed = self._compressor.compress(data)
        record = _bytes(
            [
                Chunk(
                    compression="zstd",
                    data=compressed,
                    message_start_time=first,
                    message_end_time=last,
                    uncompressed_crc=zlib.crc32(data),
                    uncompressed_size=len(data),
                )
            ]
        )
        start, offset = self._position, self._position + len(record)
        offsets: dict[int, int] = {}
        indexes = bytearray()
        for channel, e in entries.items():
            offsets[channel] = offset + len(indexes)
            size = 8 * len(e)
            indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size)
            indexes += pack(f"<{len(e)}Q", *e)
        self._write(record + indexes)
        self._first_ns = min(self._first_ns, first) if self._chunks else first
        self._last_ns = max(self._last_ns, last)
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=start,
                compression="zstd",
                compressed_size=len(compressed),
                message_end_time=last,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=len(data),
            )
        )

    def attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Write a file into the file."""
        record = Attachment(
            create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data
        )
        offset, length = self._write(_bytes([record]))
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                log_time=time_ns,
                create_time=time_ns,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Write a named table of strings."""
        offset, length = self._write(_bytes([Metadata(name=name, metadata=dict(entries))]))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def finish(self) -> None:
        """Write the pending chunk, the indexes and the footer."""
        self.flush()
        self._write(_bytes([DataEnd(data_section_crc=self._crc)]))
        start = self._position
        groups: list[tuple[Opcode, Sequence[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary = b""
        offsets: list[SummaryOffset] = []
        for opcode, records in groups:
            data = _bytes(records)
            if data:  # an offset without its group is an error to readers
                offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offset_start = start + len(summary)
        summary += _bytes(offsets)
        # the CRC covers the summary and the footer up to the CRC itself
        crc = zlib.crc32(summary + pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start))
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc)
        self._write(summary + _bytes([footer]) + MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        counts = {channel: n for channel, n in enumerate(self._counts) if n}
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=len(self._chunks),
            message_count=sum(counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> tuple[int, int]:
        """Append to the file and return where it stands: offset and length."""
        start = self._position
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._stream.write(rest) :]
        except OSError:
            with suppress(OSError):
                self._stream.seek(start)
                self._stream.truncate()
            raise
        self._position += len(data)
        self._crc = zlib.crc32(data, self._crc)
        return start, len(data)
