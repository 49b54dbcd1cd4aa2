"""Bring a system to its first instant."""

import hashlib
import logging
from collections.abc import Mapping

import numpy as np

from orchestrator.assembly.clock import SECOND
from orchestrator.assembly.system import System
from orchestrator.errors import (
    ComponentDied,
    ComponentTimeout,
    CouplingError,
    Problem,
    ScenarioError,
)
from orchestrator.run.participant import Participant
from orchestrator.run.report import Report
from orchestrator.run.wiring import converted

Participants = Mapping[str, Participant]


def component_seed(seed: int, name: str) -> int:
    """Return a component's own seed: it depends on the scenario's seed and the name alone."""
    key = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    sequence = np.random.SeedSequence(seed, spawn_key=(key,))
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))  # fits an Int64


def initialize(system: System, participants: Participants) -> None:
    """Initialize every component after those whose first outputs its own depend on.

    Raises
    ------
    ScenarioError
        If a component refuses, or its outputs are not what it described.
    """
    for name in system.schedule.initialization:
        inputs = {
            link.target.name: converted(
                link, participants[link.source.component].values[link.source.name]
            )
            for link in system.links
            if link.target.component == name
            and not link.delay_ns
            and participants[link.source.component].values
        }
        seed = component_seed(system.scenario.seed, name)
        try:
            participants[name].initialize(inputs, system.schedule.end_ns / SECOND, seed)
        except (CouplingError, ComponentDied, ComponentTimeout) as error:
            message = f"component {name!r}: cannot be initialized, {error}"
            raise ScenarioError([Problem(("components", name), message)]) from error


def announce(system: System, participants: Participants, report: Report) -> None:
    """Tell what holds from the start: log, parameters, outputs whose successors come later."""
    for name, ports in system.ports.items():
        parameters = {
            n: port.start
            for n, port in ports.items()
            if port.causality in ("parameter", "structuralParameter") and port.start is not None
        }
        for listener in report.listeners:
            listener.parameters(0, name, parameters)
    for line in system.log:
        for listener in report.listeners:
            listener.log(0, logging.INFO, "orchestrator", line)
    for name, latency in system.schedule.latency_ns.items():
        if latency:
            participants[name].publish(0, participants[name].values)
