"""One planned call as a record, which another process can take without knowing how it was planned."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

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
