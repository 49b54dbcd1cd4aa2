"""Message records of an MCAP file, those of several topics at one instant as one row of bytes.

What differs from row to row is packed row by row; what is the same in all of them is laid over many
in one go. Encoding topic by topic costs more.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import accumulate
from struct import Struct, calcsize, pack
from typing import Any, cast

import numpy as np
from mcap.opcode import Opcode

from orchestrator.recording.wire import (
    ENUM,
    STAMP,
    Array,
    Buffer,
    Instant,
    Layout,
    Piece,
    Values,
    pick,
    row_size,
    stretched,
    timestamp,
)

Parts = Sequence[Buffer]  # arrays and tail, which have their places between the bytes of a row
Told = tuple[int, "Row", bytes, Parts]  # log time, ns; a row, its bytes but for the constant ones

# where things are in a record: opcode, length of what follows, channel, number, two times, message
AFTER_LENGTH = calcsize("<BQ")
NUMBER = AFTER_LENGTH + calcsize("<H")
MESSAGE = NUMBER + calcsize("<IQQ")
AFTER_STAMP = MESSAGE + calcsize(STAMP)


class Row:
    """The layout of a row.

    Parameters
    ----------
    layouts
        Of the messages, by channel. One with a tail stands alone.

    Attributes
    ----------
    records
        Their channels, and where they begin.
    constants
        The bytes that are the same in every row; zeros where others go.
    cuts
        Where in these bytes arrays go, and last the tail.
    size
        Of the whole row, but for the tail.
    has_tail
        Whether there is one.
    """

    def __init__(self, layouts: Mapping[int, Layout]) -> None:
        records = [_record(channel, layout) for channel, layout in layouts.items()]
        offsets = accumulate(map(row_size, records), initial=0)
        self.records = list(zip(layouts, offsets, strict=False))
        pieces = [piece for record in records for piece in record]
        fixed = [piece for piece in pieces if not isinstance(piece, Array)]
        blank = (p if isinstance(p, bytes) else bytes(calcsize(f"<{p}")) for p in fixed)
        self.constants = b"".join(blank)
        self.size = row_size(pieces)
        self._pack = Struct(
            "<" + "".join(f"{len(p)}x" if isinstance(p, bytes) else p for p in fixed)
        ).pack
        self._scalars = [_scalars(layout) for layout in layouts.values()]
        self._arrays = [piece.reader() for piece in pieces if isinstance(piece, Array)]
        self.cuts = _cuts(pieces)
        (self._tail,) = {layout.tail for layout in layouts.values()}
        self.has_tail = self._tail is not None
        if self.has_tail:
            self.cuts.append(len(self.constants))

    def fill(self, number: int, instant: Instant, values: Any) -> tuple[bytes, Parts]:
        """Return the bytes of a row but for the constant ones, and what goes between them.

        Raises
        ------
        Exception
            Whatever comes of a value that is missing, or that does not fit its place.
        """
        scalars: list[Any] = []
        between: list[Buffer] = []
        if self._arrays:
            between += [read(values) for read in self._arrays]
        if self._tail is not None:
            between.append(self._tail(instant, values))
            scalars.append(self.size - AFTER_LENGTH + len(between[-1]))
        head = number, instant.times
        for is_computed, find in self._scalars:
            scalars += head
            scalars += find(instant, values) if is_computed else find(values)
        return self._pack(*scalars), between


@lru_cache(1024)  # a second of them, for all topics
def instant(time_ns: int) -> Instant:
    """Return a log time in the forms in which it is written."""
    stamp = timestamp(time_ns)
    return Instant(time_ns, stamp, pack("<QQ", time_ns, time_ns) + stamp)


def row_bytes(told: Told) -> int:
    """Return the size of a row."""
    _, row, _, between = told
    return row.size + (len(between[-1]) if row.has_tail else 0)


def messages(told: Iterable[Told]) -> Iterator[tuple[int, int, bytes]]:
    """Yield channel, log time and bytes of every message of some rows."""
    for time, row, filled, between in told:
        data, _ = assemble([(time, row, filled, between)])
        ends = [*(begin for _, begin in row.records[1:]), len(data)]
        for (channel, begin), end in zip(row.records, ends, strict=True):
            yield channel, time, data[begin + MESSAGE : end]


def assemble(told: Sequence[Told]) -> tuple[bytes, dict[int, list[int]]]:
    """Return the bytes of rows as they follow; and, by channel, log time and offset of each record.

    These are flat lists: time, offset, time, offset...
    """
    constants = [row.constants for _, row, _, _ in told]
    blank, same = (
        np.frombuffer(b"".join(parts), np.uint8)
        for parts in ([filled for _, _, filled, _ in told], constants)
    )
    data = (blank | same).data
    index: defaultdict[int, list[int]] = defaultdict(list)
    pieces: list[Buffer] = []
    start = begin = done = 0  # of a row: where it begins, and where in `data`; so much is in pieces
    for each in told:
        time, row, filled, between = each
        for channel, offset in row.records:
            index[channel] += time, start + offset
        start += row_bytes(each)
        if between:
            for cut, part in zip(row.cuts, between, strict=True):
                pieces += [data[done : begin + cut], part]
                done = begin + cut
        begin += len(filled)
    pieces.append(data[done:])
    return b"".join(cast(list[bytes], pieces)), index  # arrays are as good to it as bytes


def _record(channel: int, layout: Layout) -> list[Piece]:
    """Return the pieces of a Message record; its length counts what is behind the length."""
    times = f"{16 + 14 * layout.is_stamped}s"  # of an instant's, as much as this
    behind = [pack("<H", channel), "I", times, *layout.pieces]
    length = "Q" if layout.tail is not None else pack("<Q", row_size(behind))
    return [bytes([Opcode.MESSAGE]), length, *behind]


def _scalars(layout: Layout) -> tuple[bool, Callable[..., Sequence[Any]]]:
    """Return whether a layout's scalars are computed, and how, or how they are looked up."""
    if layout.computed is not None:
        return True, layout.computed
    find = pick(layout.keys)
    codes = [piece for piece in layout.pieces if isinstance(piece, str)]
    enumerations = [k for k, code in enumerate(codes) if code == ENUM]
    if not enumerations:
        return False, find

    def find_and_stretch(values: Values) -> list[Any]:
        found = list(find(values))
        for k in enumerations:
            found[k] = stretched(found[k])
        return found

    return False, find_and_stretch


def _cuts(pieces: Sequence[Piece]) -> list[int]:
    """Return where arrays go, in bytes of all other pieces."""
    places = accumulate((0 if isinstance(p, Array) else row_size([p]) for p in pieces), initial=0)
    return [place for place, piece in zip(places, pieces, strict=False) if isinstance(piece, Array)]
