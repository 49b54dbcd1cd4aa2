"""What a component's exception is told as."""

import re
import sys
from types import ModuleType

import pytest

from orchestrator.failure import Origin, failure, place, refusal

MODULES = {
    "lab/__init__.py": "",
    "lab/pid.py": """
from lab.parts.gains import gain
import near
import far

class Pid:
    def step(self, time, size):
        return {"gain": gain, "near": near.deep, "far": far.deep}[self.how]()

    def initialize(self):
        pass
""",
    "lab/parts/__init__.py": "",
    "lab/parts/gains.py": "def gain():\n    return 1 / 0\n",
    "lab/near.py": "def deep():\n    return 1 / 0\n",
    "elsewhere/far.py": "def deep():\n\n    return 1 / 0\n",
}


@pytest.fixture
def pid(tmp_path, monkeypatch):
    """Return a component of a package of its own, which calls modules in three places."""
    for name, text in MODULES.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    for folder in (tmp_path, tmp_path / "lab", tmp_path / "elsewhere"):
        monkeypatch.syspath_prepend(str(folder))
    import lab.pid

    yield lab.pid.Pid()
    for name in ("lab", "lab.pid", "lab.parts", "lab.parts.gains", "near", "far"):
        sys.modules.pop(name, None)


def raised(call, *arguments):
    """Return what a call raises, as if the orchestrator had made it."""
    ours = ModuleType("orchestrator.caller")
    exec("def make(call, *arguments): call(*arguments)", vars(ours))
    try:
        ours.make(call, *arguments)
    except Exception as error:  # noqa: BLE001
        error.__traceback__ = error.__traceback__.tb_next  # without this test's own frame
        return error
    raise AssertionError


@pytest.mark.parametrize(
    ("how", "expected"),
    [("gain", "gains.py:2"), ("near", "near.py:2"), ("far", "pid.py:8")],
)
def test_the_place_is_the_innermost_line_of_its_own_code(pid, how, expected):
    """Its package and its folder are its own; of what it uses it is the line that does."""
    pid.how = how
    error = raised(pid.step, 0.0, 0.1)
    told = f"step failed, ZeroDivisionError: division by zero ({expected})"
    assert failure(error, pid, "step") == told


def test_arguments_that_do_not_fit_are_placed_where_the_method_begins(pid):
    """No line of its own has run."""
    error = raised(pid.initialize, 1)
    assert failure(error, pid, "initialize").endswith(" (pid.py:10)")


def test_what_only_we_have_done_has_no_place(pid):
    """No line is better than one that is not the component's."""
    assert place(raised(lambda: None, 1)) == ""
    assert place(ValueError("never raised")) == ""


def test_what_another_process_says_counts():
    """Call and place were found where the component is."""
    error = KeyError("u")
    error.__cause__ = Origin("Traceback", "set", " (pid.py:3)")
    assert failure(error, None, "step") == "set failed, KeyError: 'u' (pid.py:3)"


def test_it_is_one_line(pid):
    """Whatever the exception says, even nothing."""
    assert failure(ValueError("a\n  b"), pid, "get") == "get failed, ValueError: a b"
    assert failure(ValueError(), None, "get") == "get failed, ValueError"


def test_a_refusal_is_told_as_it_is_said():
    """A ValueError is how a component refuses; anything else has gone wrong."""
    assert refusal(ValueError("start: too low"), None, "initialize") == "start: too low"
    assert refusal(KeyError("u"), None, "initialize") == "initialize failed, KeyError: 'u'"
    deep = ValueError("no")
    deep.__cause__ = Origin("Traceback", "set", " (pid.py:3)")
    assert re.match("set failed, ValueError: no", refusal(deep, None, "initialize"))
