"""What the orchestrator raises."""

import pickle

from orchestrator.errors import Problem, ScenarioError


def test_a_scenario_error_survives_pickling():
    """A worker process can raise it: problems and text arrive as they were."""
    error = ScenarioError([Problem(("components", "mpc"), "no such basis"), Problem((), "empty")])
    arrived = pickle.loads(pickle.dumps(error))
    assert arrived.problems == error.problems
    assert str(arrived) == str(error) == "no such basis\nempty"
