"""Every shipped component keeps every clause of the contract."""

from dataclasses import dataclass
from typing import Annotated

import pytest
from annotated_types import Ge

import controller.variables
from orchestrator.command.app import status
from plant.helicopter import Helicopter
from plant.start import HelicopterParameters
from plant.variables import parameter_variables


@dataclass(frozen=True)
class Unions:
    """Parameters that may be something else."""

    gap: float | None = 10
    noted: Annotated[float | int, "noted"] = 3
    inner: Annotated[float, Ge(0)] | None = 2
    count: int | None = 4


@dataclass(frozen=True)
class Poles:
    """Parameters whose suffixes end alike."""

    pole_per_s: float = 0.5
    lag_s: float = 1.0


@pytest.mark.parametrize(
    "name", ["helicopter", "basis_mpc", "plan_sequencer", "terrain_sensor", "dryden_gust"]
)
def test_it_keeps_the_contract(name, scenarios, capsys):
    """`hedgehop check` passes every clause that applies, state in a new process included."""
    assert status(["check", name, "--scenario", str(scenarios / "gusty.yaml")]) == 0
    rows = [line.split("  ") for line in capsys.readouterr().out.splitlines()]
    verdicts = {row[0]: "  ".join(row) for row in rows if row[0]}
    other = {clause for clause, line in verdicts.items() if "not applicable" in line}
    assert other == {"step sizes", "snapshot"}  # of FMUs
    assert sum("passed" in line for line in verdicts.values()) == 13


def test_a_float_parameter_given_as_an_integer_is_a_float():
    """The type of a parameter's variable is that of its field, not of the value it happens to have."""
    described = Helicopter(HelicopterParameters(height_agl_m=10, speed_mps=30)).describe()
    types = {v.name: (v.type, v.start) for v in described.modelVariables}
    assert types["height_agl_m"] == ("Float64", "10.0")
    assert types["slope_matched"] == ("Boolean", "true")


@pytest.mark.parametrize("rows", [parameter_variables, controller.variables.parameter_variables])
def test_a_union_with_a_float_is_a_float(rows):
    """A field that may be a float has a variable that may be one."""
    types = {v.name: (v.type, v.start, v.description) for v in rows(Unions())}
    assert types == {
        "gap": ("Float64", 10.0, ""),
        "noted": ("Float64", 3.0, "noted"),
        "inner": ("Float64", 2.0, ""),
        "count": ("Int64", 4, ""),
    }


def test_a_rate_of_change_is_not_a_time():
    """The unit of a parameter is that of its whole suffix: per_s is 1/s."""
    assert {v.name: v.unit for v in parameter_variables(Poles())} == {
        "pole_per_s": "1/s",
        "lag_s": "s",
    }
