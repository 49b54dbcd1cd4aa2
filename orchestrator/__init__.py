"""Couple components by co-simulation, on exact time, and record every signal.

>>> from orchestrator import fly
>>> flight = fly("scenarios/jacksboro.yaml", ["duration_s=10"])  # doctest: +SKIP
>>> flight.metrics["height_rms_m"]  # doctest: +SKIP
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from orchestrator.errors import ScenarioError
    from orchestrator.flight import Flight, fly
    from orchestrator.scenario.load import load

__all__ = ["Flight", "ScenarioError", "fly", "load"]

_HOME = {"Flight": "flight", "ScenarioError": "errors", "fly": "flight", "load": "scenario.load"}


def __getattr__(name: str) -> object:
    """Import what is asked for only then: the command line must answer at once."""
    if name not in _HOME:
        raise AttributeError(f"module 'orchestrator' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"orchestrator.{_HOME[name]}"), name)
