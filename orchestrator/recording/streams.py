"""What is told of a component, turned into rows of records of its topics."""

from collections.abc import Mapping, Sequence
from itertools import compress, pairwise
from operator import is_
from struct import pack
from typing import Any

from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.rows import AFTER_STAMP, NUMBER, Parts, Row, Told, instant
from orchestrator.recording.topics import Topic
from orchestrator.recording.wire import pick

Given = tuple[int, Any]  # log time, ns, and what is valid then


class Stream:
    """Topics that are written at the same instants, side by side.

    Where only changes are written, values are compared by identity first: they may be kept, hence
    an object that comes again has not changed.

    Parameters
    ----------
    topics
        By channel.
    number
        Of the last record of each.
    """

    def __init__(self, topics: Mapping[int, Topic], number: int = 0) -> None:
        self._topics = topics
        self._rule = next(iter(topics.values()))
        self._rows: dict[tuple[str, ...], Row] = {}
        self._alone: dict[str, Stream] = {}  # by topic, once one of them could not be written
        self._count = 0  # of what was given
        self._number = number  # of the last record
        self._watched = pick(self._rule.watched)
        self._last: tuple[Any, ...] = ()  # of what is watched
        self._body: tuple[bytes, Parts] | None = None  # of that, but for number and times

    def records(self, given: Sequence[Given]) -> tuple[list[Told], list[ValueError]]:
        """Return rows of records, none of what cannot be written; and why that is."""
        every, before = self._rule.every, self._count
        self._count += len(given)
        given = given[-before % every :: every]
        if self._rule.is_once:
            given = [] if before else given[:1]
        if not self._alone:
            try:
                return self.encoded(given), []
            except Exception:  # noqa: BLE001  (whatever the values are)
                parts = {t.name: Stream({n: t}, self._number) for n, t in self._topics.items()}
                self._alone = parts if len(parts) > 1 else {self._rule.name: self}
        told: list[Told] = []
        refusals: list[ValueError] = []
        for name, stream in self._alone.items():
            for each in given:
                try:
                    told += stream.encoded([each])
                except Exception as error:  # noqa: BLE001
                    refusals.append(_refusal(name, each[0], error))
        return told, refusals

    def encoded(self, given: Sequence[Given]) -> list[Told]:
        """Return rows of records; whatever comes of what cannot be written, it leaves no trace."""
        given, last = self._renewed(given)
        told: list[Told] = []
        row, is_partial = self._row(()), self._rule.is_partial
        for number, (time_ns, values) in enumerate(given, self._number + 1):
            if is_partial:
                row = self._row(tuple(values))
            told.append((time_ns, row, *row.fill(number, instant(time_ns), values)))
        if self._rule.watched and told:
            told = self._changed(told)
        self._last = last
        self._number += len(told)
        return told

    def _row(self, keys: tuple[str, ...]) -> Row:
        if keys not in self._rows:
            self._rows[keys] = Row({n: topic.layout(keys) for n, topic in self._topics.items()})
        return self._rows[keys]

    def _renewed(self, given: Sequence[Given]) -> tuple[Sequence[Given], tuple[Any, ...]]:
        """Return what has other objects than what came before it, and the last of these objects."""
        last = self._last
        if not self._rule.watched:
            return given, last
        new: list[Given] = []
        for each in given:
            values = self._watched(each[1])
            if not (last and all(map(is_, values, last))):
                new.append(each)
                last = values
        return new, last

    def _changed(self, told: Sequence[Told]) -> list[Told]:
        """Return the rows that differ from the row before, numbered anew."""
        bodies = [self._body, *((filled[AFTER_STAMP:], between) for _, _, filled, between in told)]
        self._body = bodies[-1]
        is_new = [not _are_equal(*pair) for pair in pairwise(bodies)]
        numbered = enumerate(compress(told, is_new), self._number + 1)
        return [
            (time, row, filled[:NUMBER] + pack("<I", number) + filled[NUMBER + 4 :], between)
            for number, (time, row, filled, between) in numbered
        ]


def _refusal(topic: str, time_ns: int, error: Exception) -> ValueError:
    what = f"{error.args[0]}: missing" if isinstance(error, KeyError) else f"{error}"
    at = f"t = {(time_ns - EPOCH_NS) / 1e9:.3f} s"
    return ValueError(f"{topic} at {at}: cannot be recorded, {what}")


def _are_equal(one: tuple[bytes, Parts] | None, other: tuple[bytes, Parts] | None) -> bool:
    """Whether the bytes of two rows are the same."""
    if one is None or other is None or one[0] != other[0]:
        return False
    return all(a is b or bytes(a) == bytes(b) for a, b in zip(one[1], other[1], strict=True))
