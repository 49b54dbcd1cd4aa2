"""Chunks of a recording: which rows share one, and how it is compressed."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter
from typing import Literal

import zstandard

from orchestrator.recording.rows import Told, row_bytes

Compression = Literal["zstd", "lz4", "none"]

# of zstd: as small as level 1 in half its time; level 3 is a seventh smaller and takes twice the time
LEVEL = -4


def compressor(compression: Compression) -> tuple[str, Callable[[bytes], bytes]]:
    """Return what a chunk calls a compression, and the function that does it."""
    match compression:
        case "zstd":
            return "zstd", zstandard.ZstdCompressor(level=LEVEL).compress
        case "lz4":
            from lz4 import frame

            return "lz4", frame.compress
        case "none":
            return "", bytes


def split(told: Sequence[Told], size: int) -> Iterator[Sequence[Told]]:
    """Yield the rows of chunks of at most ``size`` bytes, one after the other in time.

    What belongs to one instant is not parted.
    """
    first, last = told[0][0], told[-1][0]
    if first == last or sum(map(row_bytes, told)) <= size:
        yield told
        return
    k = bisect_left(told, (first + last + 1) // 2, key=itemgetter(0))
    yield from split(told[:k], size)
    yield from split(told[k:], size)
