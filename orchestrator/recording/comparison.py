"""Say in a few lines where two recordings differ."""

from collections.abc import Sequence

from orchestrator.recording.diff import Difference
from orchestrator.recording.reader import Recording

NAMED = 6  # signals that only one has, at most


def comparison(a: Recording, b: Recording, found: Sequence[Difference]) -> list[str]:
    """Return what was ``found`` between two recordings, and how many signals are equal.

    What only one of them has is told together; so is what comes after the shorter one's end.
    """
    if not found:
        return [f"no difference in {len(a.signals)} signals"]
    ends = a.result.time_ns, b.result.time_ns
    late = {each for each in found if _is_after(each, ends)}
    told = [d for d in found if d not in late and d.what != "missing"]
    lines = [str(difference) for difference in told]
    single = len(a.signals.keys() ^ b.signals.keys())
    for one, other in ((a, b), (b, a)):
        names = [name for name in one.signals if name not in other.signals]
        if names:
            more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
            lines.append(f"only in {one.path}: {', '.join(names[:NAMED])}{more}")
    unlike = {difference.name for difference in told}
    equal = sum(name in b.signals and name not in unlike for name in a.signals)
    until = ""
    if late:
        one, other = (a, b) if ends[0] > ends[1] else (b, a)
        end = f"{min(ends) / 1e9:g} s"
        lines.append(f"{one.path} is longer: {max(ends) / 1e9:g} s, {other.path} ends at {end}")
        until = f" up to {end}"
    count = len({each.name for each in told} & {*a.signals, *b.signals})
    alone = f", {single} in one only" if single else ""
    return [*lines, f"signals: {equal} equal{until}, {count} different{alone}"]


def _is_after(difference: Difference, ends: tuple[int, int]) -> bool:
    """Whether all that differs is that one recording goes on where the other has ended."""
    if ends[0] == ends[1]:
        return False
    if difference.what == "samples":
        is_short = int(difference.a) < int(difference.b)
    elif difference.what == "event" and "none" in (difference.a, difference.b):
        is_short = difference.a == "none"
    else:
        return difference.name == "end_ns"
    is_late = difference.time_s is not None and difference.time_s >= min(ends) / 1e9
    return is_late and is_short == (ends[0] < ends[1])
