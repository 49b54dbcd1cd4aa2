"""A component's parameters: its frozen dataclass, read from the constructor, checked by pydantic.

Components know nothing of this. A field's type, bounds (``annotated_types``), default and meaning
(a plain string in ``Annotated``) are all in the dataclass; the unit is in the field's name.
"""

import inspect
import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache, reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    TypeAdapter,
    ValidationInfo,
    create_model,
)
from pydantic import Field as Described

from orchestrator.assembly.discovery import Factory
from orchestrator.errors import nearest

TOLD = ("latency_s", "instance_name")  # arguments that are no resources: a constructor may ask
_CONFIG = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)


@dataclass(frozen=True)
class Constructor:
    """What a factory takes.

    Attributes
    ----------
    record : type or None
        The dataclass of its argument ``parameters``; None if it has none.
    injected : mapping
        Its other arguments, and whether each must be given.
    """

    record: type[Any] | None
    injected: Mapping[str, bool]


def constructor(factory: Factory) -> Constructor:
    """Return what a factory takes.

    Raises
    ------
    ValueError
        If its argument ``parameters`` is not annotated with a dataclass.
    """
    named = {
        name: argument
        for name, argument in inspect.signature(factory).parameters.items()
        if argument.kind not in (argument.VAR_POSITIONAL, argument.VAR_KEYWORD)
    }
    has_parameters = named.pop("parameters", None) is not None
    record = None
    if has_parameters:
        try:
            hints = get_type_hints(factory.__init__ if inspect.isclass(factory) else factory)
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            raise ValueError(f"constructor: annotations cannot be read, {what}") from error
        record = hints.get("parameters")
        if not (isinstance(record, type) and is_dataclass(record)):
            raise ValueError(
                f"constructor: wrong annotation of 'parameters', got {record!r}, "
                "expected a dataclass"
            )
    required = {name: argument.default is argument.empty for name, argument in named.items()}
    return Constructor(record, required)


@cache
def adapter(record: type[Any]) -> TypeAdapter[Any]:
    """Return what validates a mapping and makes the dataclass ``record`` from it.

    Files (``Path``) are looked up in the ``folders`` of the validation context.
    """
    return TypeAdapter(_validated(record))


def _validated(hint: Any) -> Any:
    """Return a type hint in which dataclasses are validated and files are looked up."""
    if isinstance(hint, type) and is_dataclass(hint):
        return Annotated[_model(hint), AfterValidator(lambda model: _make(hint, model))]
    if hint is Path:
        return Annotated[Path, AfterValidator(_file)]
    origin: Any = get_origin(hint)
    arguments = get_args(hint)
    if origin is None or origin is Literal:
        return hint
    if origin is Annotated:
        return Annotated[(_validated(arguments[0]), *arguments[1:])]
    inner = tuple(_validated(one) for one in arguments)
    return reduce(or_, inner) if origin in (Union, types.UnionType) else origin[inner]


def _model(record: type[Any]) -> type[BaseModel]:
    """Return a pydantic model that has a dataclass's fields and allows no others.

    Its attributes end in ``_``, so that no field's name can hide one of pydantic's own.
    """
    hints = get_type_hints(record, include_extras=True)
    members: dict[str, Any] = {
        f"{one.name}_": (
            _validated(hints[one.name]),
            Described(alias=one.name, description=meaning(hints[one.name]), **_default(one)),
        )
        for one in fields(record)
        if one.init
    }
    return create_model(record.__name__, __config__=_CONFIG, __doc__=record.__doc__, **members)


def _make(record: type[Any], model: BaseModel) -> object:
    """Return the dataclass with the values of its model; what is not given is its own default."""
    return record(**{name[:-1]: getattr(model, name) for name in model.model_fields_set})


def _default(one: "Field[Any]") -> dict[str, Any]:
    if one.default is not MISSING:
        return {"default": one.default}
    return {} if one.default_factory is MISSING else {"default_factory": one.default_factory}


def meaning(hint: object) -> str | None:
    """Return the plain string in an ``Annotated`` hint."""
    notes = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    return next((note for note in notes if isinstance(note, str)), None)


def _file(path: Path, info: ValidationInfo) -> Path:
    """Return where a file is: the first of the folders that has it."""
    folders: tuple[Path, ...] = (info.context or {}).get("folders", (Path(),))
    for folder in folders:
        if (folder / path).exists():
            return folder / path
    known = [one.name for one in (folders[0] / path).parent.glob("*")]
    raise ValueError(
        f"file not found, got {str(path)!r}, expected a file beside the scenario"
        f"{nearest(path.name, known)}"
    )
