"""What several commands take, and how what they name may be wrong."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from orchestrator.errors import Problem, ScenarioError

Overrides = Annotated[list[str] | None, Parameter(name="--set", negative="")]
Out = Annotated[Path, Parameter(name=("--out", "-o"))]
OutOrDefault = Annotated[Path | None, Parameter(name=("--out", "-o"))]
Flag = Annotated[bool, Parameter(negative="")]
Port = Annotated[int, Parameter(validator=validators.Number(gte=0, lte=65535))]


@contextmanager
def user_errors() -> Generator[None]:
    """Take what a file or component that the user named raises as the user's to mend."""
    try:
        yield
    except ScenarioError:
        raise
    except (OSError, ValueError) as error:
        raise ScenarioError([Problem((), str(error))]) from error
