"""What the orchestrator raises: problems of a scenario, misuse of the component contract."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

Path = tuple[str | int, ...]
RAISED = (Exception, SystemExit)
"""What a component may raise; an interruption is not of its making."""


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with a scenario, and where.

    ``path`` leads through the scenario's keys and indices, such as ``("connections", 2)``; the
    loader turns it into file, line and column.
    """

    path: Path
    message: str


class ScenarioError(ValueError):
    """A scenario cannot be run; ``problems`` holds every reason found, in scenario order."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(problem.message for problem in self.problems))

    def __reduce__(self) -> tuple[type["ScenarioError"], tuple[tuple[Problem, ...]]]:
        """Pickle by the problems, so that a worker process can raise it."""
        return type(self), (self.problems,)


class CouplingError(ValueError):
    """A component does not keep its contract, or is called in an order the contract forbids."""


class ComponentDied(Exception):  # noqa: N818  (as FMI says of an instance)
    """The process of an isolated component has ended by itself."""


class ComponentTimeout(Exception):  # noqa: N818
    """An isolated component did not answer in time; its process has been ended."""


def nearest(name: str, known: Sequence[str]) -> str:
    """Return ``", did you mean 'x' or 'y'"``, or an empty text where nothing is near.

    >>> nearest("hight", ["height", "heading", "speed"])
    ", did you mean 'height'"
    """
    near = get_close_matches(name, known, n=2, cutoff=0.6)
    return f", did you mean {' or '.join(repr(text) for text in near)}" if near else ""
