"""One planned call as a record, which another process can take without knowing how it was planned."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, cast

from orchestrator.scenario.marks import KeyPath


@dataclass(frozen=True)
class Plan:
    """A checked call that makes one resource or component.

    Attributes
    ----------
    path : tuple
        ``("components", "mpc")``.
    arguments : mapping
        The parameter dataclass, as ``parameters``, and of ``TOLD`` what is taken.
    resources : mapping
        Argument to the name of the resource to inject.
    notes : tuple of str
        Lines for the run's log.
    """

    path: KeyPath
    factory: Callable[..., Any]
    arguments: Mapping[str, Any]
    resources: Mapping[str, str]
    notes: tuple[str, ...] = ()

    @property
    def needs(self) -> list[KeyPath]:
        """Paths of the resources."""
        return [("resources", name) for name in self.resources.values()]

    @property
    def files(self) -> list[Path]:
        """Files and folders among the arguments."""
        return list(_paths(self.arguments))


def _paths(value: object) -> Iterator[Path]:
    if isinstance(value, Path):
        yield value
    elif is_dataclass(value):
        for each in fields(value):
            yield from _paths(getattr(value, each.name))
    elif isinstance(value, Mapping):
        yield from _paths(list(cast(Mapping[str, object], value).values()))
    elif isinstance(value, list | tuple):
        for one in cast(list[object], value):
            yield from _paths(one)
