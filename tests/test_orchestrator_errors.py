"""What the orchestrator raises."""

import pickle

import pytest

from orchestrator import errors
from orchestrator.errors import Problem, ScenarioError


def test_a_scenario_error_survives_pickling():
    """A worker process can raise it: problems and text arrive as they were."""
    error = ScenarioError([Problem(("components", "mpc"), "no such basis"), Problem((), "empty")])
    arrived = pickle.loads(pickle.dumps(error))
    assert arrived.problems == error.problems
    assert str(arrived) == str(error) == "no such basis\nempty"


@pytest.mark.parametrize(
    "kind",
    [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, Exception)],
)
def test_every_error_survives_pickling(kind):
    """That holds for all that is raised here, whatever its constructor takes."""
    error = kind([Problem((), "wrong")]) if kind is ScenarioError else kind("wrong")
    arrived = pickle.loads(pickle.dumps(error))
    assert (type(arrived), str(arrived)) == (kind, "wrong")
