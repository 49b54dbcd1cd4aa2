"""Plain data in which every value knows where it was written, and faults that show the place."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from orchestrator.errors import Problem, ScenarioError

KeyPath = tuple[str | int, ...]
Scalar = float | int | bool | str | None


@dataclass(frozen=True)
class Mark:
    """A stretch of one source line: of a file, or of an override (whose ``line`` is 0).

    ``line`` and ``column`` count from 1; ``text`` is the whole line.
    """

    source: str
    line: int = 0
    column: int = 1
    width: int = 1
    text: str = ""

    def __str__(self) -> str:
        return f"{self.source}:{self.line}:{self.column}" if self.line else self.source


@dataclass(frozen=True)
class Node:
    """A value, where it stands, and where the key that names it stands."""

    value: "Scalar | list[Node] | dict[str, Node]"
    mark: Mark
    key: Mark | None = None

    def plain(self) -> object:
        """Return the value as plain dicts, lists and scalars."""
        if isinstance(self.value, dict):
            return {name: node.plain() for name, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.plain() for node in self.value]
        return self.value

    def below(self, part: str | int) -> "Node | None":
        """Return the member or item called ``part``, if there is one."""
        if isinstance(self.value, dict):
            return self.value.get(str(part))
        if isinstance(self.value, list) and isinstance(part, int) and part < len(self.value):
            return self.value[part]
        return None

    def place(self, path: KeyPath) -> Mark:
        """Return where a fault of the value at ``path`` shows.

        That is the value, or the key of a mapping or of a list that begins on a later line. Where
        there is no such value, it is the key of the last part that is there.
        """
        node, is_there = self._find(path)
        if node.key is None:
            return node.mark
        is_long = isinstance(node.value, dict) or node.mark.line != node.key.line
        return node.mark if is_there and not is_long else node.key

    def place_of_key(self, path: KeyPath) -> Mark:
        """Return where the key of the value at ``path`` stands."""
        node, _ = self._find(path)
        return node.key or node.mark

    def _find(self, path: KeyPath) -> "tuple[Node, bool]":
        """Return the node at ``path``, or the last on the way, and whether it is at ``path``."""
        node = self
        for part in path:
            below = node.below(part)
            if below is None:
                return node, False
            node = below
        return node, True


class Origins(Mapping[KeyPath, str]):
    """Path of every value in a tree to where it was written, ``file:line:column``."""

    def __init__(self, root: Node) -> None:
        self.root = root
        self._nodes = dict(_walk(root, ()))

    def __getitem__(self, path: KeyPath) -> str:
        return str(self._nodes[path].mark)

    def __iter__(self) -> Iterator[KeyPath]:
        return iter(self._nodes)

    def __len__(self) -> int:
        return len(self._nodes)


def _walk(node: Node, path: KeyPath) -> Iterator[tuple[KeyPath, Node]]:
    yield path, node
    members = node.value.items() if isinstance(node.value, dict) else ()
    items = enumerate(node.value) if isinstance(node.value, list) else ()
    for part, below in (*members, *items):
        yield from _walk(below, (*path, part))


@dataclass(frozen=True)
class Fault:
    """Something wrong at a mark; its text shows the line with a caret below."""

    mark: Mark
    message: str
    path: KeyPath = ()

    def __str__(self) -> str:
        mark = self.mark
        lines = [f"{mark}: {self.message}"]
        if mark.text:
            # tabs stay tabs, so that the caret stands where the eye expects it
            indent = re.sub(r"[^\t]", " ", mark.text[: mark.column - 1])
            lines.append(f"{mark.line or '':>6} | {mark.text}")
            lines.append(f"{'':>6} | {indent}{'^' * mark.width}")
        return "\n".join(lines)


def scenario_error(faults: Iterable[Fault]) -> ScenarioError:
    """Return the error that reports all faults by file, line and column, overrides last."""
    ordered = sorted(
        dict.fromkeys(faults),
        key=lambda fault: (
            not fault.mark.line,
            fault.mark.source,
            fault.mark.line,
            fault.mark.column,
        ),
    )
    return ScenarioError(Problem(fault.path, str(fault)) for fault in ordered)


def located(error: ScenarioError, origins: Mapping[KeyPath, str]) -> ScenarioError:
    """Return the error with file, line and column of every problem, as far as they are known."""
    root = origins.root if isinstance(origins, Origins) else Node({}, Mark("scenario"))
    return scenario_error(
        Fault(root.place(problem.path), problem.message, problem.path) for problem in error.problems
    )


def dotted(path: KeyPath) -> str:
    """Return a path as messages and overrides write it."""
    return ".".join(map(str, path)) or "scenario"
