"""What is in an MCAP file, read front to back; and what damage looks like to the library."""

import struct
from dataclasses import dataclass, field
from io import BytesIO

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zlib_ng.zlib_ng import crc32

# whatever reading a file raises that is not, or not any more, what its writer wrote
DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,  # among them text that is not UTF-8, and CRCs
    LookupError,
    OverflowError,  # a length
    MemoryError,  # a length
    RuntimeError,  # lz4
)


_FOOTER = struct.Struct("<BQQQI8s")  # opcode, length, start of summary and of its offsets, CRC


@dataclass
class Contents:
    """The records of a file.

    Attributes
    ----------
    schemas, channels
        By number; of several that bear the same the first.
    tables, attachments
        By name.
    chunks : list of lists of Message
        In the order of the file.
    """

    library: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    tables: dict[str, dict[str, str]] = field(default_factory=dict[str, dict[str, str]])
    attachments: dict[str, Attachment] = field(default_factory=dict[str, Attachment])
    chunks: list[list[Message]] = field(default_factory=list[list[Message]])

    def take(self, record: McapRecord) -> None:
        """Take what a record holds.

        Raises
        ------
        One of DAMAGE
            If it is a chunk that is not what its CRC says; nothing of it is taken.
        """
        match record:
            case Chunk():
                within = breakup_chunk(record, validate_crc=True)
                for one in within:
                    if not isinstance(one, Message):
                        self.take(one)
                self.chunks.append([one for one in within if isinstance(one, Message)])
            case Message():
                self.chunks.append([record])
            case Schema():
                self.schemas.setdefault(record.id, record)
            case Channel():
                self.channels.setdefault(record.id, record)
            case Metadata():
                self.tables[record.name] = record.metadata
            case Attachment():
                self.attachments[record.name] = record
            case Header():
                self.library = record.library
            case _:
                pass


def read(data: bytes) -> Contents:
    """Return the contents of a whole file.

    Raises
    ------
    One of DAMAGE
        If any CRC does not fit, or the file has no end.
    """
    if summary_start(data) is None:
        raise ValueError("no end")
    contents = Contents()
    size = len(data)
    reader = StreamReader(
        BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=size
    )
    for record in reader.records:
        if isinstance(record, DataEnd):
            break
        contents.take(record)
    return contents


def parse(data: bytes) -> McapRecord:
    """Return the record in these bytes.

    Raises
    ------
    One of DAMAGE
        If there is none.
    """
    return next(iter(StreamReader(BytesIO(data), skip_magic=True, emit_chunks=True).records))


def summary_start(data: bytes) -> int | None:
    """Return where the summary of a file starts; None if the file's end is damaged or missing."""
    if len(data) < _FOOTER.size:
        return None
    opcode, length, start, _, crc, magic = _FOOTER.unpack_from(data, len(data) - _FOOTER.size)
    end = len(data) - 4 - len(MCAP0_MAGIC)  # of what the CRC covers
    start = start or len(data) - _FOOTER.size
    is_whole = (opcode, length, magic) == (Opcode.FOOTER, 20, MCAP0_MAGIC) and start < end
    return start if is_whole and crc in (0, crc32(data[start:end])) else None
