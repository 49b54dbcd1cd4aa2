"""The container: what `mcap` reads in it is what `mcap` itself would have written."""

from io import BufferedWriter, BytesIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Message, MessageIndex, SummaryOffset
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from orchestrator.recording.container import Container
from orchestrator.recording.rows import Row, instant
from orchestrator.recording.wire import Layout

MESSAGES = [  # channel, log time, data
    (1, 5, b"first"),
    (2, 5, b""),
    (1, 7, b"x" * 1000),
    (2, 9, b"last"),
]


def as_bytes(record):
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def rows(messages):
    """Return messages as the container takes them."""
    whole = Layout((), tail=lambda _, data: data, is_stamped=False)
    layouts = {channel: Row({channel: whole}) for channel, _, _ in messages}
    return [(t, layouts[c], *layouts[c].fill(3, instant(t), data)) for c, t, data in messages]


def written(*chunks):
    """Return the bytes of a file with two topics and these chunks of messages."""
    file = BytesIO()
    stream = BufferedWriter(file)
    container = Container(stream, "hedgehop")
    container.add_metadata("table", {"a": "ä"})
    container.add_attachment(4, "a.txt", "text/plain", b"text")
    for name in ("/one", "/two"):
        container.add_channel(name, f"message{name}", b"schema", {"unit": "m"})
    for messages in chunks:
        container.add_messages(rows(messages))
    container.finish()
    stream.flush()
    return file.getvalue()


def by_library(*chunks):
    """Return the same file as `mcap.writer.Writer` writes it."""
    file = BytesIO()
    writer = Writer(file, enable_data_crcs=True)
    writer.start("", "hedgehop")
    writer.add_metadata("table", {"a": "ä"})
    writer.add_attachment(4, 4, "a.txt", "text/plain", b"text")
    for name in ("/one", "/two"):
        schema = writer.register_schema(f"message{name}", "protobuf", b"schema")
        writer.register_channel(name, "protobuf", schema, {"unit": "m"})
    for messages in chunks:
        for channel, time, data in messages:
            writer.add_message(channel, time, data, time, 3)
        writer.flush()
    writer.finish()
    return file.getvalue()


def summary(data):
    return make_reader(BytesIO(data)).get_summary()


def test_readers_find_what_the_librarys_writer_would_have_written():
    """Messages in order of time, statistics, topics, tables and attachments are the same."""
    ours, theirs = (write(MESSAGES[:2], MESSAGES[2:]) for write in (written, by_library))
    for data in (ours, theirs):
        list(StreamReader(BytesIO(data), validate_crcs=True).records)
    read = [make_reader(BytesIO(data), validate_crcs=True) for data in (ours, theirs)]
    assert list(read[0].iter_messages()) == list(read[1].iter_messages())
    assert list(read[0].iter_attachments()) == list(read[1].iter_attachments())
    assert list(read[0].iter_metadata()) == list(read[1].iter_metadata())
    mine, library = summary(ours), summary(theirs)
    for part in ("statistics", "schemas", "channels"):
        assert getattr(mine, part) == getattr(library, part)


def test_records_are_interleaved_by_time():
    """Whoever reads front to back gets messages in order; those of equal times as they were told."""
    records = StreamReader(BytesIO(written(MESSAGES[2:] + MESSAGES[:2]))).records
    found = [(r.channel_id, r.log_time, r.data) for r in records if isinstance(r, Message)]
    assert found == MESSAGES


def test_the_index_is_true():
    """It is the library's, follows the chunk, and leads to every message of the channel."""
    data = written(MESSAGES)
    (place,) = summary(data).chunk_indexes
    expected = [
        (c, as_bytes(MessageIndex(c, [(t, at) for (d, t, _), at in starts(MESSAGES) if d == c])))
        for c in (1, 2)
    ]
    end = place.chunk_start_offset + place.chunk_length
    indices = b"".join(index for _, index in expected)
    assert data[end : end + place.message_index_length] == indices
    assert place.message_index_offsets == {1: end, 2: end + len(expected[0][1])}


def starts(messages):
    """Return every message with its offset in the chunk."""
    sizes = [31 + len(data) for _, _, data in messages]
    return [(message, sum(sizes[:k])) for k, message in enumerate(messages)]


def test_a_file_without_messages_is_whole():
    """Topics are listed; no chunk is written, and no group of the summary is empty."""
    data = written([])
    found = summary(data)
    assert sorted(c.topic for c in found.channels.values()) == ["/one", "/two"]
    assert (found.statistics.message_count, found.statistics.chunk_count) == (0, 0)
    groups = [r for r in StreamReader(BytesIO(data)).records if isinstance(r, SummaryOffset)]
    assert Opcode.CHUNK_INDEX not in [group.group_opcode for group in groups]
    for group in groups:
        assert data[group.group_start] == group.group_opcode
        assert group.group_length
