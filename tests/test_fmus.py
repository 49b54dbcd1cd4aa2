"""The small FMUs that other tests are made with are what they say: valid, and right in FMPy."""

import zipfile

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
from fmus.archives import BAD
from fmus.models import MODELS

KINDS = [(name, fmi) for name in MODELS for fmi in (2, 3) if (name, fmi) != ("clocked", 2)]


@pytest.mark.parametrize(("name", "fmi"), KINDS)
def test_descriptions_are_valid(fmu, name, fmi):
    """FMPy's full validation, names and structure included, finds nothing."""
    assert validate_fmu(str(fmu(name, fmi=fmi))) == []


def test_a_scheduled_description_is_valid(fmu):
    """The clocked model as a scheduled controller too."""
    assert validate_fmu(str(fmu("clocked", fmi=3, SCHEDULED=1))) == []


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("decay", 0.99**100),
        ("integrator", 3.0),
        ("relay", 2.0),
        ("staircase", 4.0),
        ("fixedstep", 1.0),
        ("faulty", 1.0),
    ],
)
def test_answers_are_right_in_fmpy(fmu, fmi, name, answer):
    """Y after one second under FMPy's own master, with u = 2 where there is a u but in the decay."""
    inputs = {"u": 2.0} if name in ("integrator", "relay") else {}
    result = simulate_fmu(
        str(fmu(name, fmi=fmi)), stop_time=1.0, output_interval=0.1, start_values=inputs,
        output=["y"], use_event_mode=name == "staircase" and fmi == 3,
    )  # fmt: skip
    assert result["y"][-1] == pytest.approx(answer, rel=1e-12)


@pytest.mark.parametrize("fmi", [2, 3])
def test_feedthrough_passes_everything_on(fmu, fmi):
    """Also in the steps of another master."""
    given = {"Float64_in": 2.5, "Int32_in": -4, "Boolean_in": True, "Enumeration_in": 2}
    names = [name.replace("_in", "_out") for name in given]
    path = str(fmu("feedthrough", fmi=fmi))
    result = simulate_fmu(
        path, stop_time=0.1, output_interval=0.1, start_values=given, output=names
    )
    assert [result[name][-1] for name in names] == list(given.values())


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_fault_happens_at_its_step_only(fmu, fmi):
    """Before and after it y is the time."""
    path = str(fmu("faulty", fmi=fmi, FAULT="NOT_A_NUMBER", AT=3))
    y = simulate_fmu(path, stop_time=1.0, output_interval=0.1, output=["y"])["y"]
    expected = np.arange(11) / 10
    expected[4] = np.nan
    np.testing.assert_allclose(y, expected, rtol=1e-12)


def test_a_bomb_is_large_inside_and_small_outside(fmu, tmp_path):
    """Ten GB, by its own directory, in less than 1 MB."""
    bomb = BAD["zip_bomb"](fmu("relay"), tmp_path)
    assert bomb.stat().st_size < 2**20
    with zipfile.ZipFile(bomb) as archive:
        assert sum(info.file_size for info in archive.infolist()) > 10**10
