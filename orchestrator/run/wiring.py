"""Carry values along links: made once, then called at every instant at which a component reads."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, cast

from orchestrator.assembly.system import Link
from orchestrator.component import Value

Tell = Callable[[int, str, Mapping[str, Value]], None]


class Source(Protocol):
    """What publishes: outputs that are valid now, and those that were valid before."""

    @property
    def values(self) -> Mapping[str, Value]:
        """Outputs valid now."""
        ...

    def value_at(self, time_ns: int, name: str) -> Value | None:
        """Return an output as it was valid at a time, None before the first publishing."""
        ...


def converted(link: Link, value: Value) -> Value:
    """Return a source's value in the unit of the target."""
    if link.factor == 1.0 and link.offset == 0.0:
        return value
    return cast(Any, value) * link.factor + link.offset


def gather(
    links: Iterable[Link], sources: Mapping[str, Source], component: str, tell: Sequence[Tell]
) -> Callable[[int], Mapping[str, Value]]:
    """Return a function of time that brings together the inputs of one component.

    The mapping it returns is used again at the next call. ``tell`` hears the inputs that differ
    from their sources. A delayed input is absent until its delay has passed for the first time.
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    special: list[tuple[Source, Link]] = []
    for link in links:
        if link.is_plain:
            group = groups.setdefault(link.source.component, [])
            group.append((link.target.name, link.source.name))
        else:
            special.append((sources[link.source.component], link))
    plain = [(sources[name], group) for name, group in groups.items()]
    inputs: dict[str, Value] = {}

    def gather_one(_: int) -> Mapping[str, Value]:
        inputs[target] = source.values[name]
        return inputs

    def gather_plain(_: int) -> Mapping[str, Value]:
        for source, group in plain:
            values = source.values
            for target, name in group:  # faster than dict.update with zip
                inputs[target] = values[name]
        return inputs

    def gather_all(time_ns: int) -> Mapping[str, Value]:
        differing: dict[str, Value] = {}
        for source, link in special:
            value = source.value_at(time_ns - link.delay_ns, link.source.name)
            if value is not None:
                differing[link.target.name] = converted(link, value)
        if differing:
            for hear in tell:
                hear(time_ns, component, differing)
        gather_plain(time_ns)
        inputs.update(differing)
        return inputs

    if special:
        return gather_all
    if len(plain) == 1 and len(plain[0][1]) == 1:
        source, ((target, name),) = plain[0]
        return gather_one
    return gather_plain
