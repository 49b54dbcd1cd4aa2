"""Decide once who does what when; the run loop then only walks a table.

At every instant, in this order: results of earlier steps become valid; continuous components are
read and sampled ones step, each after those whose values it passes on; continuous components step.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import gcd, lcm
from typing import TypeVar

from orchestrator.assembly.clock import SECOND, is_multiple, period_ns, whole_ticks
from orchestrator.assembly.connections import Ports
from orchestrator.assembly.feedthrough import calls, ordered
from orchestrator.assembly.system import Link, Operation, Schedule
from orchestrator.component import Execution
from orchestrator.errors import Path, Problem, ScenarioError
from orchestrator.scenario.records import Scenario

Entry = TypeVar("Entry")


def compile_schedule(
    scenario: Scenario,
    executions: Mapping[str, Execution],
    ports: Ports,
    links: Sequence[Link],
    *,
    max_steps: int = 10_000_000,
) -> Schedule:
    """Return the schedule of a scenario, whose components are the keys of ``executions``.

    The base tick is the greatest common divisor of all periods. Latencies, delays and the
    duration are whole numbers of base ticks; the duration is a whole number of steps of every
    continuous component.

    Raises
    ------
    ScenarioError
        With every time that does not fit, or with a cycle of direct feed-through.
    """
    problems: list[Problem] = []
    periods = _periods(scenario, executions, problems)
    if problems:
        raise ScenarioError(problems)
    _check_internal_steps(executions, periods, problems)
    base, hyperperiod = gcd(*periods.values()), lcm(*periods.values())
    end = _ticks(scenario.duration_s, base, ("duration_s",), problems)
    latencies: dict[str, int] = {}
    for spec in scenario.components:
        path: Path = ("components", spec.name, "latency_s")
        latencies[spec.name] = _ticks(spec.latency_s, base, path, problems)
        if executions[spec.name].kind == "continuous":
            if latencies[spec.name]:
                fault = f"continuous components have none, got {spec.latency_s} s, expected 0 s"
                problems.append(_problem(path, fault))
            if end % periods[spec.name]:
                step = periods[spec.name] / SECOND
                fault = (
                    f"not a whole number of steps of component {spec.name!r}, "
                    f"got {scenario.duration_s} s, expected a multiple of {step} s"
                )
                problems.append(_problem(("duration_s",), fault))
    for index, connection in enumerate(scenario.connections):
        _ticks(connection.delay_s, base, ("connections", index, "delay_s"), problems)
    steps = sum(-(-end // period) for period in periods.values())
    if steps > max_steps:
        fault = f"too many steps, got {steps}, expected at most {max_steps}"
        problems.append(_problem(("duration_s",), fault))
    if problems:
        raise ScenarioError(problems)
    # at the start, outputs pass inputs on whatever their latency is later
    at_once = ordered(calls(executions, dict.fromkeys(latencies, 0), ports, links), is_strict=False)
    return Schedule(
        end_ns=end,
        base_ns=base,
        hyperperiod_ns=hyperperiod,
        period_ns=periods,
        latency_ns=latencies,
        initialization=tuple(dict.fromkeys([*(o.component for o in at_once), *executions])),
        table=_table(
            [
                *(Operation("release", name) for name, latency in latencies.items() if latency),
                *ordered(calls(executions, latencies, ports, links)),
                *(Operation("advance", n) for n, e in executions.items() if e.kind == "continuous"),
            ],
            periods,
            latencies,
            min(hyperperiod, end + 1),
        ),
    )


def instants(schedule: Schedule, table: Sequence[tuple[int, Entry]]) -> Iterator[tuple[int, Entry]]:
    """Yield ``(time_ns, entry)`` of a hyperperiod's table, repeated from 0 to the end inclusive."""
    for start in range(0, schedule.end_ns + 1, schedule.hyperperiod_ns):
        for offset, entry in table:
            if start + offset > schedule.end_ns:
                return
            yield start + offset, entry


def _problem(path: Path, fault: str) -> Problem:
    return Problem(path, f"{'.'.join(map(str, path))}: {fault}")


def _periods(
    scenario: Scenario, executions: Mapping[str, Execution], problems: list[Problem]
) -> dict[str, int]:
    if not scenario.components:
        problems.append(_problem(("components",), "there are none, expected at least one"))
    if not scenario.duration_s > 0:
        fault = f"not positive, got {scenario.duration_s} s, expected above 0 s"
        problems.append(_problem(("duration_s",), fault))
    periods: dict[str, int] = {}
    for spec in scenario.components:
        rate = executions[spec.name].rate_hz if spec.rate_hz is None else spec.rate_hz
        try:
            periods[spec.name] = period_ns(rate)
        except ValueError as error:
            problems.append(_problem(("components", spec.name, "rate_hz"), str(error)))
    return periods


def _check_internal_steps(
    executions: Mapping[str, Execution], periods: Mapping[str, int], problems: list[Problem]
) -> None:
    """Refuse communication steps that are no whole number of an FMU's fixed internal steps."""
    for name, execution in executions.items():
        internal: float | None = getattr(execution, "internal_step_s", None)
        step = periods[name] / SECOND
        if internal is not None and not is_multiple(step, internal):
            least = max(1, round(step / internal)) * internal
            fault = (
                f"a communication step that the FMU cannot take, got {step} s, "
                f"expected a multiple of its internal step of {internal} s, such as {least:g} s"
            )
            problems.append(_problem(("components", name, "rate_hz"), fault))


def _ticks(seconds: float, base: int, path: Path, problems: list[Problem]) -> int:
    """Return a time in ns; one that is no whole number of base ticks is added to ``problems``."""
    try:
        return whole_ticks(seconds, base)
    except ValueError as error:
        problems.append(_problem(path, str(error)))
        return 0


def _table(
    operations: Sequence[Operation],
    periods: Mapping[str, int],
    latencies: Mapping[str, int],
    length: int,
) -> tuple[tuple[int, tuple[Operation, ...]], ...]:
    """Return the operations of every instant before ``length`` ns at which there are any."""
    table: dict[int, list[Operation]] = {}
    for operation in operations:
        period = periods[operation.component]
        first = latencies[operation.component] % period if operation.kind == "release" else 0
        for offset in range(first, length, period):
            table.setdefault(offset, []).append(operation)
    return tuple((offset, tuple(table[offset])) for offset in sorted(table))
