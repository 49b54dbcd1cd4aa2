"""The messages of one topic, turned into records of an MCAP file many at a time."""

from collections.abc import Callable, Sequence
from itertools import groupby, pairwise
from operator import is_
from struct import calcsize, pack
from typing import Any

from mcap.opcode import Opcode

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.topics import Topic
from orchestrator.recording.wire import STAMP, Layout, Values, packer, pick, row_size, timestamp

Row = tuple[int, bytes, Values]  # log time, ns, and as `instant` writes it; values
Encode = Callable[[Sequence[Row], int], list[bytes]]  # rows and first sequence number to records

_LENGTH = calcsize("<BQ")  # of a record's opcode and length; the length counts what follows
HEAD = _LENGTH + calcsize("<HIQQ")  # channel, sequence, log and publish time; then the message
_BODY = HEAD + calcsize(STAMP)
_TIMES = calcsize("<QQ")  # log and publish time, with which `instant` begins


def instant(time_ns: int) -> bytes:
    """Return log time, publish time and time stamp as they follow each other in a record."""
    return pack("<QQ", time_ns, time_ns) + timestamp(time_ns)


class Stream:
    """A topic on its channel.

    Where only changes are written, values are compared by identity first: they may be kept, hence
    an object that comes again has not changed.
    """

    def __init__(self, channel: int, topic: Topic) -> None:
        self.channel = channel
        self._topic = topic
        self._sequence = 0
        self._told = 0
        self._encoders: dict[tuple[str, ...], Encode] = {}
        self._watched = pick(topic.watched) if topic.watched else None
        # the last values, and all but the time of their message
        self._seen: tuple[tuple[Any, ...], memoryview] = (), memoryview(b"")

    def message(self, time_ns: int, values: Values) -> bytes:
        """Return one message, the same bytes that its record holds; `time_ns` is the log time.

        Raises
        ------
        ValueError
            If the values cannot be written; the message names topic, time and variable.
        """
        try:
            return self._encode([(time_ns, instant(time_ns), values)], 1)[0][HEAD:]
        except Exception as error:
            what = f"{error.args[0]}: missing" if isinstance(error, KeyError) else f"{error}"
            at = f"{self._topic.name} at t = {(time_ns - EPOCH_NS) / 1e9:.3f} s"
            raise ValueError(f"{at}: cannot be recorded, {what}") from error

    def records(self, rows: Sequence[Row]) -> tuple[list[int], list[bytes], ValueError | None]:
        """Return log times and Message records; and, if one cannot be written, why."""
        every, told = self._topic.every, self._told
        self._told += len(rows)
        rows = rows[-told % every :: every]
        try:
            return *self._records(rows), None
        except Exception:  # noqa: BLE001  (one by one they tell which it is)
            good: list[Row] = []
            refusal = None
            for row in rows:
                try:
                    self.message(row[0], row[2])
                    good.append(row)
                except ValueError as error:
                    refusal = refusal or error
            return *self._records(good), refusal

    def _records(self, rows: Sequence[Row]) -> tuple[list[int], list[bytes]]:
        if self._watched is None:
            times, records = [row[0] for row in rows], self._encode(rows, self._sequence + 1)
        else:
            times, records = self._changes(rows, self._watched)
        self._sequence += len(records)
        return times, records

    def _changes(
        self, rows: Sequence[Row], watched: Callable[[Values], tuple[Any, ...]]
    ) -> tuple[list[int], list[bytes]]:
        """Return the rows whose message, but for the time, is not that of the row before."""
        last, body = self._seen
        new: list[Row] = []
        for row in rows:
            values = watched(row[2])
            if not (last and all(map(is_, values, last))):
                new.append(row)
                last = values
        records = self._encode(new, self._sequence + 1)
        bodies = [body, *(memoryview(record)[_BODY:] for record in records)]
        self._seen = last, bodies[-1]
        equal = [after == before for before, after in pairwise(bodies)]
        if any(equal):  # other objects, but the same values
            new = [row for row, is_equal in zip(new, equal, strict=True) if not is_equal]
            records = self._encode(new, self._sequence + 1)
        return [row[0] for row in new], records

    def _encode(self, rows: Sequence[Row], sequence: int) -> list[bytes]:
        """Return the records of rows; where a message need not hold all, of all alike at once."""
        if not self._topic.is_partial:
            return self._encoder(())(rows, sequence)
        records: list[bytes] = []
        for keys, alike in groupby(rows, key=lambda row: tuple(row[2])):
            records += self._encoder(keys)(list(alike), sequence + len(records))
        return records

    def _encoder(self, keys: tuple[str, ...]) -> Encode:
        if keys not in self._encoders:
            self._encoders[keys] = _encoder(self.channel, self._topic.layout(keys))
        return self._encoders[keys]


def _encoder(channel: int, layout: Layout) -> Encode:
    """Return the encoder of Message records of one channel and layout."""
    scalars, rest = layout.scalars, layout.rest
    at = f"{_TIMES + calcsize(STAMP) * layout.is_stamped}s"  # of an instant, as much as this
    pieces = (pack("<H", channel), "I", at, *layout.pieces)
    least = row_size(pieces)  # of what the length counts
    length = pack("<Q", least) if rest is None else "Q"
    pack_rows = packer((bytes([Opcode.MESSAGE]), length, *pieces))
    size = _LENGTH + least

    def encode(rows: Sequence[Row], sequence: int) -> list[bytes]:
        numbered = enumerate(rows, sequence)
        if rest is None:
            packed = pack_rows((n, at, *scalars(values)) for n, (_, at, values) in numbered)
            return [packed[k : k + size] for k in range(0, len(packed), size)]
        parts = [rest(values) for _, _, values in rows]
        packed = pack_rows(
            (least + sum(map(len, behind)), n, at, *scalars(values))
            for (n, (_, at, values)), behind in zip(numbered, parts, strict=True)
        )
        return [
            b"".join((packed[k * size : (k + 1) * size], *behind)) for k, behind in enumerate(parts)
        ]

    return encode
