"""Order what happens at one instant so that every value is made before it is passed on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from orchestrator.assembly.connections import Ports
from orchestrator.assembly.system import Link, Operation
from orchestrator.component import Execution
from orchestrator.errors import Problem, ScenarioError


@dataclass(eq=False)
class Call:
    """A read or a sample, and the calls it waits for at the same instant.

    ``needs`` are those, each with its link, whose values this call passes on: they come first.
    ``prefers`` are its component's other sources: they come first where that closes no cycle.
    ``rank`` is 0 for reads that pass nothing on, 1 for everything else that publishes, 2 for
    samples whose outputs become valid later.
    """

    operation: Operation
    rank: int
    index: int
    through: frozenset[str]
    needs: list[tuple["Call", Link]] = field(default_factory=list["tuple[Call, Link]"])
    prefers: list["Call"] = field(default_factory=list["Call"])


def calls(
    executions: Mapping[str, Execution],
    latencies: Mapping[str, int],
    ports: Ports,
    links: Sequence[Link],
) -> list[Call]:
    """Return the reads and samples of all components, in the order of ``executions``.

    Outputs of a continuous component that pass on different inputs are read apart, since other
    components may lie between them. A sampled component makes all its outputs at once: each waits
    for every input that one of them passes on.
    """
    linked = {(link.target.component, link.target.name) for link in links}
    made: list[Call] = []
    publisher: dict[tuple[str, str], Call] = {}
    for index, (name, execution) in enumerate(executions.items()):
        own = ports[name]
        inputs = [n for n in own if (name, n) in linked]
        outputs = {
            n: port.depends_on.intersection(inputs)
            for n, port in own.items()
            if port.causality == "output"
        }
        if execution.kind == "sampled":
            is_late = latencies[name] > 0
            through = frozenset[str]() if is_late else frozenset[str]().union(*outputs.values())
            operation = Operation("sample", name, tuple(inputs), tuple(outputs))
            new = [Call(operation, 2 if is_late else 1, index, through)]
        else:
            is_late = False
            new = [
                Call(
                    Operation(
                        "read",
                        name,
                        tuple(n for n in inputs if n in through),
                        tuple(n for n, passed in outputs.items() if passed == through),
                    ),
                    1 if through else 0,
                    index,
                    through,
                )
                for through in sorted(dict.fromkeys(outputs.values()), key=len)
            ]
        made += new
        if not is_late:
            publisher |= {(name, output): call for call in new for output in call.operation.outputs}
    for link in links:
        source = publisher.get((link.source.component, link.source.name))
        if source is None or link.delay_ns:
            continue
        for call in made:
            if call.operation.component == link.target.component:
                if link.target.name in call.through:
                    call.needs.append((source, link))
                elif source is not call:
                    call.prefers.append(source)
    return made


def ordered(calls: Sequence[Call], *, is_strict: bool = True) -> list[Operation]:
    """Return the operations in order; ties follow the order of ``calls``.

    Raises
    ------
    ScenarioError
        If calls wait for each other, naming the cycle. Without ``is_strict`` it is cut instead.
    """
    order: list[Operation] = []
    waiting = dict.fromkeys(calls)
    while waiting:
        free = [call for call in waiting if not any(c in waiting for c, _ in call.needs)]
        if not free and is_strict:
            raise ScenarioError([Problem(("connections",), _cycle(waiting))])
        following = min(
            free or waiting,
            key=lambda call: (call.rank, any(c in waiting for c in call.prefers), call.index),
        )
        del waiting[following]
        order.append(following.operation)
    return order


def _cycle(waiting: Mapping[Call, None]) -> str:
    """Return the message that names a cycle among calls that all wait for another."""
    call = next(iter(waiting))
    entered_by: dict[Call, Link] = {}
    while call not in entered_by:
        source, entered_by[call] = next((c, link) for c, link in call.needs if c in waiting)
        call = source
    links = list(entered_by.values())[list(entered_by).index(call) :]
    names = [str(port) for link in reversed(links) for port in (link.source, link.target)]
    return (
        f"connections: cycle of direct feed-through {' -> '.join([*names, names[0]])}, "
        "expected a delay_s on one of its connections or a latency_s on one of its components"
    )
