"""Compare two recordings bit by bit, and sum one up; nothing measured in wall-clock time counts."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.recording.messages import Messages, column
from orchestrator.recording.reader import Recording
from orchestrator.recording.topics import EVENTS


@dataclass(frozen=True)
class Difference:
    """The first thing that is not the same about one variable, event or ending.

    Attributes
    ----------
    name : str
        Full name of a signal, or what else differs: `outcome`, `/events`.
    what : str
        `missing`, `unit`, `shape`, `items`, `type`, `samples`, `time`, `value`, `event` or `ending`.
    time_s : float or None
        Simulated time at which the two part, s.
    a, b : str
        What the first and the second recording hold, as text that tells any two values apart.
    """

    name: str
    what: str
    time_s: float | None
    a: str
    b: str

    def __str__(self) -> str:
        when = "" if self.time_s is None else f" at t = {self.time_s:.3f} s"
        return f"{self.name}: {self.what} differs{when}, got {self.a} and {self.b}"


def diff(a: Path, b: Path) -> list[Difference]:
    """Return where two recordings differ: every signal's first difference, events and ending.

    Raises
    ------
    OSError, ValueError
        If one of them cannot be read.
    """
    return differences(Recording.open(a), Recording.open(b))


def differences(one: Recording, two: Recording) -> list[Difference]:
    """Return where two open recordings differ: see :func:`diff`."""
    same = {name for name in one.topics if _is_same(one.topics[name], two.topics.get(name))}
    found = [
        difference
        for name, signal in {**two.signals, **one.signals}.items()
        if signal.topic not in same
        for difference in _signal(name, one, two)
    ]
    found += _events(one, two)
    endings = zip(_ending(one).items(), _ending(two).values(), strict=True)
    found += [Difference(name, "ending", None, x, y) for (name, x), y in endings if x != y]
    return found


def info(path: Path) -> dict[str, Any]:
    """Return what a recording holds, as plain data: topics with counts, rates and units, ending.

    Raises
    ------
    OSError, ValueError
        If it cannot be read.
    """
    recording = Recording.open(path)
    result = recording.result
    return {
        "recording": str(path),
        "bytes": Path(path).stat().st_size,
        "library": recording.library,
        "title": recording.scenario["title"],
        "outcome": result.outcome,
        "reason": result.reason,
        "duration_s": result.time_ns / 1e9,
        "recovered": dict(recording.recovered),
        "topics": [
            {
                "topic": name,
                "message": topic.message,
                "count": len(topic.raw),
                "rate_hz": _rate_hz([time_ns for time_ns, _ in topic.raw]),
                "units": {s.name: s.unit for s in recording.signals.values() if s.topic == name},
            }
            for name, topic in recording.topics.items()
        ],
    }


def _rate_hz(times_ns: list[int]) -> float | None:
    """Return the mean rate between the first and the last message."""
    span = times_ns[-1] - times_ns[0] if times_ns else 0
    return (len(times_ns) - 1) * 1e9 / span if span else None


def _is_same(a: Messages, b: Messages | None) -> bool:
    """Whether two topics hold the same bytes at the same times: no value needs to be looked at."""
    return b is not None and (a.descriptors, a.metadata, a.raw) == (
        b.descriptors,
        b.metadata,
        b.raw,
    )


def _signal(name: str, one: Recording, two: Recording) -> Iterator[Difference]:
    """Yield the first difference of a signal, if there is one."""
    if name not in one.signals or name not in two.signals:
        there = ("there" if name in each.signals else "missing" for each in (one, two))
        yield Difference(name, "missing", None, *there)
        return
    signals = one.signals[name], two.signals[name]
    for what in ("unit", "shape", "items"):
        x, y = (getattr(signal, what) for signal in signals)
        if x != y:
            yield Difference(name, what, None, str(x), str(y))
            return
    (times_a, a), (times_b, b) = (
        column(each.topics[signal.topic], signal)
        for each, signal in zip((one, two), signals, strict=True)
    )
    if a.dtype != b.dtype:
        yield Difference(name, "type", None, str(a.dtype), str(b.dtype))
        return
    n = min(len(times_a), len(times_b))
    unlike = (times_a[:n] != times_b[:n]) | _unlike(a[:n], b[:n])
    if unlike.any():
        k = int(np.argmax(unlike))
        if times_a[k] != times_b[k]:
            first_ns = int(min(times_a[k], times_b[k]))
            x, y = f"{times_a[k]} ns", f"{times_b[k]} ns"
            yield Difference(name, "time", first_ns / 1e9, x, y)
        else:
            yield Difference(name, "value", int(times_a[k]) / 1e9, *_first(a[k], b[k]))
    elif len(times_a) != len(times_b):
        longer = times_a if len(times_a) > n else times_b
        yield Difference(
            name, "samples", int(longer[n]) / 1e9, str(len(times_a)), str(len(times_b))
        )


def _unlike(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which samples differ in any bit; 0.0 and -0.0 do, a NaN and itself do not."""
    if a.dtype.kind == "f":
        a, b = a.view(np.int64), b.view(np.int64)
    return (a != b).reshape(len(a), -1).any(axis=1)


def _first(a: Any, b: Any) -> tuple[str, str]:
    """Return two samples as text, of arrays the first elements that differ."""
    if not isinstance(a, np.ndarray):
        return _text(a), _text(b)
    index = np.unravel_index(int(np.argmax(_unlike(a.ravel(), b.ravel()))), a.shape)
    where = "[" + ", ".join(str(i) for i in index) + "] "
    return where + _text(a[index]), where + _text(b[index])


def _text(value: object) -> str:
    return repr(value.item() if isinstance(value, np.generic) else value)


def _events(one: Recording, two: Recording) -> Iterator[Difference]:
    """Yield the first event that differs; missed deadlines are measured, the end told apart."""
    events = ([e for e in each.events if e.kind not in ("overrun", "end")] for each in (one, two))
    for a, b in zip_longest(*events):
        if a != b:
            time_s = min(event.time_s for event in (a, b) if event is not None)
            texts = (
                "none" if e is None else f"{e.kind} {e.component} {e.message!r} at {e.time_s:g} s"
                for e in (a, b)
            )
            yield Difference(EVENTS, "event", time_s, *texts)
            return


def _ending(recording: Recording) -> dict[str, str]:
    result = recording.result
    return {"outcome": result.outcome, "reason": result.reason, "end_ns": str(result.time_ns)}
