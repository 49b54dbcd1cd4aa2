"""What `diff` says, in a few lines."""

import pytest
from fake_system import TICK_NS, make_system, port, tell

from orchestrator.recording.comparison import comparison
from orchestrator.recording.diff import differences
from orchestrator.recording.reader import Recording
from orchestrator.recording.recorder import Recorder


@pytest.fixture
def record(tmp_path, monkeypatch):
    """Return a function that records x(k) of several variables, and warnings, and opens that."""
    monkeypatch.chdir(tmp_path)

    def record(name, values, warned=()):
        system = make_system([port("a", each) for each in values])
        count = max(map(len, values.values()))
        calls = [
            ("outputs", (k * TICK_NS, "a", {n: float(x[k]) for n, x in values.items()}))
            for k in range(count)
        ]
        calls += [("event", (k * TICK_NS, "warning", "a", "hot")) for k in warned]
        tell(Recorder(tmp_path / name), system, calls)
        return Recording.open(name)

    return record


def said(a, b):
    """Return what is said of two recordings."""
    return comparison(a, b, differences(a, b))


def test_equal_recordings_are_one_line(record):
    """With the number of signals."""
    values = {"x": [1, 2], "y": [3, 4]}
    assert said(record("a.mcap", values), record("b.mcap", values)) == [
        "no difference in 2 signals"
    ]


def test_what_only_one_has_is_told_together(record):
    """Several names and how many more there are, per recording."""
    a = record("a.mcap", {"x": [1], "y": [1]})
    b = record("b.mcap", {"x": [1], **{f"k{n}": [1] for n in range(8)}})
    assert said(a, b) == [
        "only in a.mcap: a.y",
        "only in b.mcap: a.k0, a.k1, a.k2, a.k3, a.k4, a.k5 and 2 more",
        "signals: 1 equal, 0 different, 9 in one only",
    ]


def test_a_longer_recording_is_told_once(record):
    """Whichever it is; what differs before the other's end is told as ever."""
    a = record("a.mcap", {"x": [1, 2, 3], "y": [1, 2, 3]})
    b = record("b.mcap", {"x": [1, 2], "y": [1, 2]})
    longer = "a.mcap is longer: 0.1 s, b.mcap ends at 0.05 s"
    equal = "signals: 2 equal up to 0.05 s, 0 different"
    assert said(a, b) == said(b, a) == [longer, equal]
    c = record("c.mcap", {"x": [1, 9], "y": [1, 2]})
    assert said(a, c) == [
        "a.x: value differs at t = 0.050 s, got 2.0 and 9.0",
        "a.mcap is longer: 0.1 s, c.mcap ends at 0.05 s",
        "signals: 1 equal up to 0.05 s, 1 different",
    ]


@pytest.mark.parametrize("last", [1, 2])
def test_what_comes_after_an_end_is_what_the_longer_one_has(record, last):
    """What the one that ends first, or as late as the other, has alone at its end is told."""
    a = record("a.mcap", {"x": [1, 2, 3]})
    b = record("b.mcap", {"x": [1, 2, 3][: last + 1]}, warned=[last])
    for pair in ((a, b), (b, a)):
        assert said(*pair)[0].startswith(f"/events: event differs at t = {0.05 * last:.3f} s")
