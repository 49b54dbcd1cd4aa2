"""Chunks of a recording: which messages share one, in which order, and how it is compressed."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate, pairwise
from typing import Literal

import numpy as np
import zstandard
from numpy.typing import NDArray

Batch = tuple[int, Sequence[int], Sequence[bytes]]  # channel; log times in order, Message records
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


def split(batches: Sequence[Batch], size: int) -> Iterator[Sequence[Batch]]:
    """Yield the batches of chunks of at most ``size`` bytes, one after the other in time.

    What belongs to one instant is not parted.
    """
    first = min(times[0] for _, times, _ in batches)
    last = max(times[-1] for _, times, _ in batches)
    if first == last or sum(len(record) for *_, records in batches for record in records) <= size:
        yield batches
        return
    middle = (first + last + 1) // 2
    cuts = [bisect_left(times, middle) for _, times, _ in batches]
    parts = list(zip(batches, cuts, strict=True))
    yield from split([(c, times[:k], records[:k]) for (c, times, records), k in parts if k], size)
    yield from split(
        [(c, times[k:], records[k:]) for (c, times, records), k in parts if k < len(times)], size
    )


def interleave(batches: Sequence[Batch]) -> tuple[bytes, list[NDArray[np.int64]]]:
    """Return all records in the order of time; and times and offsets (K, 2) of every batch's."""
    records = [record for _, _, records in batches for record in records]
    index = np.empty((len(records), 2), "<i8")
    index[:, 0] = [time for _, times, _ in batches for time in times]
    order = np.argsort(index[:, 0], kind="stable")
    sizes = np.fromiter(map(len, records), np.int64, len(records))[order]
    index[order, 1] = np.cumsum(sizes) - sizes
    data = b"".join([records[k] for k in order.tolist()])
    bounds = accumulate((len(times) for _, times, _ in batches), initial=0)
    return data, [index[i:j] for i, j in pairwise(bounds)]
