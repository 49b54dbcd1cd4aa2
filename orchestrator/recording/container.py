"""An MCAP file, written front to back in chunks; the records are the library's.

But for messages and their index: `mcap` writes them number by number, at several times the cost of
encoding the messages.
"""

from collections.abc import Iterable, Mapping, Sequence
from io import BufferedWriter
from operator import itemgetter
from struct import pack

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
from zlib_ng.zlib_ng import crc32

from orchestrator.recording.chunks import Compression, compressor, split
from orchestrator.recording.rows import Told, assemble


class Container:
    """An MCAP file in a stream that stands at its start; whoever owns the stream closes it.

    All methods raise OSError where the stream cannot be written. Times are ns. No chunk has more
    than ``chunk_size`` bytes before compression, but for one of a single instant.
    """

    def __init__(
        self,
        stream: BufferedWriter,
        library: str,
        *,
        compression: Compression = "zstd",
        chunk_size: int = 1_000_000,
    ) -> None:
        self._stream = stream
        self._crc = 0
        self._compression, self._compress = compressor(compression)
        self._chunk_size = chunk_size
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._put(MCAP0_MAGIC + _bytes(Header("", library)))

    def add_channel(
        self, topic: str, message: str, descriptors: bytes, metadata: Mapping[str, str]
    ) -> int:
        """Write a topic of protobuf messages, and return its channel's number."""
        number = len(self._channels) + 1
        schema = Schema(id=number, name=message, encoding="protobuf", data=descriptors)
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding="protobuf",
            metadata=dict(metadata),
            schema_id=number,
        )
        self._put(_bytes(schema, channel))
        self._schemas.append(schema)
        self._channels.append(channel)
        return number

    def add_attachment(self, time_ns: int, name: str, media_type: str, data: bytes) -> None:
        """Write a file into the file."""
        place = self._put(_bytes(Attachment(time_ns, time_ns, name, media_type, data)))
        self._attachments.append(
            AttachmentIndex(*place, time_ns, time_ns, len(data), name, media_type)
        )

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a table of strings."""
        self._metadata.append(
            MetadataIndex(*self._put(_bytes(Metadata(name, dict(metadata)))), name)
        )

    def add_messages(self, told: Iterable[Told]) -> None:
        """Write rows of records as chunks, in the order of their log times."""
        rows = sorted(told, key=itemgetter(0))
        if rows:
            for part in split(rows, self._chunk_size):
                self._add_chunk(part)

    def _add_chunk(self, told: Sequence[Told]) -> None:
        data, index = assemble(told)
        compressed = self._compress(data)
        chunk = Chunk(
            compression=self._compression,
            data=compressed,
            message_start_time=told[0][0],
            message_end_time=told[-1][0],
            uncompressed_crc=crc32(data),
            uncompressed_size=len(data),
        )
        records = [_bytes(chunk)]
        offsets: dict[int, int] = {}
        start, length = self._stream.tell(), len(records[0])
        end = start + length
        for channel, places in index.items():
            offsets[channel] = end
            records.append(_message_index(channel, places))
            end += len(records[-1])
            self._counts[channel] = self._counts.get(channel, 0) + len(places) // 2
        self._put(b"".join(records))
        self._chunks.append(
            ChunkIndex(
                chunk_start_offset=start,
                chunk_length=length,
                compression=chunk.compression,
                compressed_size=len(compressed),
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                message_index_offsets=offsets,
                message_index_length=end - start - length,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def finish(self) -> None:
        """Write the summary and the end of the file."""
        self._put(_bytes(DataEnd(self._crc)))
        start = self._stream.tell()
        groups: dict[int, Sequence[McapRecord]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: self._attachments,
            Opcode.METADATA_INDEX: self._metadata,
        }
        summary, offsets = b"", b""
        for opcode, records in groups.items():
            group = _bytes(*records)
            if group:
                offsets += _bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        ends = start, start + len(summary)
        summary += offsets
        crc = crc32(_bytes(Footer(*ends, 0))[:-4], crc32(summary))  # all but itself
        self._put(summary + _bytes(Footer(*ends, crc)) + MCAP0_MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _put(self, data: bytes) -> tuple[int, int]:
        """Write and return where, and how much."""
        start = self._stream.tell()
        self._stream.write(data)
        self._crc = crc32(data, self._crc)
        return start, len(data)


def _bytes(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def _message_index(channel: int, places: Sequence[int]) -> bytes:
    """Return a MessageIndex record as the library's would write itself, number by number."""
    size = 8 * len(places)
    head = Opcode.MESSAGE_INDEX, 6 + size, channel, size
    return pack(f"<BQHI{len(places)}Q", *head, *places)
