"""The orchestrator's clockwork, told by scripted components."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted import Row, Scripted, clock, counter, gain, integrator, system

from orchestrator.errors import CouplingError, ScenarioError
from orchestrator.initialize import component_seed
from orchestrator.records import EventSpec
from orchestrator.simulate import simulate
from orchestrator.trace import Trace


def fly(*arguments, **keys):
    """Return trace and result of a scripted system."""
    trace = Trace()
    simulate(system(*arguments, **keys), [trace])
    return trace


def test_one_second_of_20_and_2_hz():
    """At a shared tick the sampled component reads, steps and is read; then the plant steps."""
    log = []
    plant = integrator(20.0, name="plant", log=log)
    mpc = gain(-1.0, 2.0, name="mpc", log=log)
    plant.values["y"] = 1.0
    made = system({"plant": plant, "mpc": mpc}, ["plant.y -> mpc.u", "mpc.z -> plant.u"])
    simulate(made)
    for one in log: print(one)
